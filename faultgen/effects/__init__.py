"""The catalogue of effects: named, parametrised changes of a robot."""

# before the catalogue, which loads effects of other packages that need it
from faultgen.effects.prior import Prior  # isort: skip
from faultgen.effects.base import HEALTHY, Applied, Effect, Temperature
from faultgen.effects.catalogue import EFFECTS, get_effect
from faultgen.effects.temperature import set_temperature

__all__ = [
    "EFFECTS",
    "HEALTHY",
    "Applied",
    "Effect",
    "Prior",
    "Temperature",
    "get_effect",
    "set_temperature",
]

"""The catalogue of effects: named, parametrised changes of a robot."""

from faultgen.effects.base import HEALTHY, Applied, Effect
from faultgen.effects.catalogue import EFFECTS, get_effect
from faultgen.effects.hooks import Temperature
from faultgen.effects.prior import Prior
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

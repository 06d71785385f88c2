"""The catalogue of effects: named, parametrised edits of a robot's MJCF."""

from faultgen.effects.catalogue import EFFECTS, HEALTHY, Effect, get_effect
from faultgen.effects.friction import set_temperature

__all__ = ["EFFECTS", "HEALTHY", "Effect", "get_effect", "set_temperature"]

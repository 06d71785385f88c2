"""All numbers of one drive: given, stated by the plain model, of a similar arm, or assumed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from faultgen.building.alike import Like
from faultgen.building.quantities import QUANTITIES, disbelieved_friction
from faultgen.building.seen import Seen


@dataclass(frozen=True)
class Value:
    """A number of a drive and where it comes from."""

    value: float
    """In the unit of its quantity."""
    source: str
    """"given" (in drives.toml), "model" (in the plain model), "like" (of a similar arm) or
    "assumed"."""
    why: str = ""
    """Where the model states it, which arm has it, or why it is assumed."""


_LENT = {
    "speed_limit": ("speed_limit", 0),
    "gear_ratio": ("gear_ratio", 0),
    "torque_limit": ("torque_limit", 0),
    "rotor_inertia": ("reflected_inertia", 2),
    "coulomb_friction": ("coulomb", 1),
    "viscous_friction": ("viscous", 2),
    "gear_stiffness": ("stiffness", 0),
}
"""Name of each number in a `Like`, and the power of the gear ratio by which it is divided."""


def drive_of(
    given: Mapping[str, float], seen: Seen, like: Like | None = None, axis: int = 0
) -> dict[str, Value]:
    """Determine all numbers of one drive.

    Args:
        given: Numbers that the user states, by name.
        seen: What the drive sees of the arm.
        like: A similar arm, whose numbers replace assumed ones. A slide takes none.
        axis: Which of its axes, from 0.

    Returns:
        Every quantity by name. Numbers that are not given have four digits.
    """
    values: dict[str, float] = {}
    found: dict[str, Value] = {}
    for quantity in QUANTITIES:
        name = quantity.name
        if name in given:
            found[name] = Value(float(given[name]), "given")
        else:
            # the sign of a gear ratio is only the direction in which the motor turns
            plain = {key: abs(value) for key, value in values.items()}
            stated = quantity.stated(plain, seen)
            source = "assumed" if stated is None else "model"
            lent = None if like is None or seen.slide else _lent(like, axis, name, plain)
            if stated is None and lent is not None:
                source, stated = "like", lent
            value, why = quantity.assume(plain, seen) if stated is None else stated
            found[name] = Value(float(f"{value:.4g}"), source, why)
        values[name] = found[name].value
    return found


def _lent(
    like: Like, axis: int, name: str, values: Mapping[str, float]
) -> tuple[float, str] | None:
    """A number of a similar arm, and where it comes from; None if it is not known."""
    key, power = _LENT.get(name, ("", 0))
    if key not in like.axes[axis]:
        return None
    value = like.axes[axis][key]
    return (value / values["gear_ratio"] ** power if power else value), like.source[key]


def disbelieved(values: Mapping[str, Value], seen: Seen) -> list[str]:
    """Tell which friction of a plain model is not used, because it would be too large.

    Args:
        values: Numbers of one drive, from `drive_of`.
        seen: What the drive sees of the arm.

    Returns:
        One line for each friction, with the name of the number that is assumed instead.
    """
    numbers = {name: abs(one.value) for name, one in values.items()}
    stated = {"coulomb_friction": "frictionloss", "viscous_friction": "damping"}
    reasons = {
        name: disbelieved_friction(of, numbers, seen)
        for name, of in stated.items()
        if values[name].source in ("assumed", "like")
    }
    return [f"{name}: {reason}" for name, reason in reasons.items() if reason]

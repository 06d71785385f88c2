"""What an alarm is called: effect, axes, severity with its interval, and what else is probable.

verdict_of(named)["verdict"], widened("backlash", severity, low, high)
"""

from __future__ import annotations

from typing import Any

import numpy as np

from faultgen.discovery.terms.candidates import PAYLOAD
from faultgen.effects import get_effect
from faultgen.twin.columns import TEMPERATURE, UNKNOWN

SCALE, SCALE_OF_GEARS = 0.3, 0.6
"""Standard deviation of the logarithm of a severity that is due to the model: a fault of some
severity changes a real robot by more, or by less, than the same fault changes the model. The second
one is for effects behind the gearbox, such as play, whose change of the torque depends on the form
of the play and on the servo. Assumed; docs/twin.md says how often the intervals are right."""

_EXPLAINS = 0.8
"""Share of the log odds of an unknown change that a fault on the same axis must reach to be named
in its place: assumed. A simulated signature is never exact, and the mean of many recordings shows
every error of it, which an unknown change has not."""
_LIKELY = 0.1  # probability from which another fault is named as well
_NORMAL = 1.96  # standard deviations to each end of a 95 % interval


def verdict_of(named: list[dict[str, Any]]) -> dict[str, Any]:
    """Say what an alarm means.

    Args:
        named: Effects and axes that may be there, the most probable first, with `effect`, `axes`,
            `probability`, `log_odds`, `severity`, `interval` and `unit`.

    Returns:
        Entries of an answer: verdict, alarm, those of the first effect, and `alternatives`.
    """
    first, *others = _without_needless(named)
    verdict = {UNKNOWN: "unknown change", TEMPERATURE: "other temperature"}.get(
        str(first["effect"]), "fault"
    )
    first = {name: value for name, value in first.items() if name != "log_odds"}
    told = {"verdict": verdict, "alarm": verdict != "other temperature"} | first
    told["alternatives"] = [
        one for one in others if one["probability"] > _LIKELY and one["effect"] != UNKNOWN
    ]
    if verdict == "unknown change":
        told |= {"effect": None, "severity": None, "interval": None, "unit": None}
    return told


def _without_needless(named: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """What may be there, without unknown changes if a fault on their axis explains nearly as much.

    The probabilities are then those if the change is one of the others.
    """
    first = named[0]
    if first["effect"] != UNKNOWN:
        return named
    known = [one for one in named if one["effect"] != UNKNOWN]
    best = max(known, key=lambda one: float(one["log_odds"]))
    enough = best["log_odds"] >= _EXPLAINS * first["log_odds"]
    if not (enough and set(first["axes"]) <= set(best["axes"])):
        return named
    odds = np.array([one["log_odds"] for one in known])
    shares = np.exp(odds - np.logaddexp.reduce([0.0, *odds]))
    told = [{**one, "probability": float(p)} for one, p in zip(known, shares, strict=True)]
    return sorted(told, key=lambda one: -float(one["probability"]))


def scale_of(effect: str) -> float:
    """Return the standard deviation of the logarithm of a severity that is due to the model.

    Args:
        effect: Name of the effect.
    """
    at_rotor = effect in (UNKNOWN, TEMPERATURE, PAYLOAD) or get_effect(effect).prior.at_motor
    return SCALE if at_rotor else SCALE_OF_GEARS


def widened(effect: str, severity: float, low: float, high: float) -> tuple[float, float]:
    """Widen a 95 % interval of a severity by the error of the model's scale.

    Args:
        effect: Name of the effect.
        severity: Estimate, in the unit of the effect.
        low: Lower end.
        high: Upper end.

    Returns:
        The ends of the wider interval.
    """
    size, scale = abs(severity), scale_of(effect)
    if size == 0:
        return low, high
    more = float(np.expm1(_NORMAL * scale)) * size
    less = float(-np.expm1(-_NORMAL * scale)) * size
    down, up = (less, more) if severity > 0 else (more, less)
    below = severity - float(np.hypot(severity - low, down))
    above = severity + float(np.hypot(high - severity, up))
    return (max(below, 0.0) if low >= 0 else below), above

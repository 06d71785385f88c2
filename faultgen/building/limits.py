"""Torque limits that a model states but that no drive of such an arm has: placeholders.

Many URDF files have effort="100" for every joint, because the format wants a number there.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from faultgen.building.usual import usual_torque

MOST_TORQUE = 5.0
"""Largest torque limit over the usual one that is believed. The limits of the arms whose drives are
known are up to 3.4 times the usual ones."""
ALIKE_TORQUE = 2.7
"""The same if all axes have the same limit, as none of the known arms has: twice the typical error
of the usual limits, in logarithms (1.65 when they are fitted to other arms)."""
LEAST_TORQUE = 0.5
"""Smallest torque limit over the torque against gravity that is believed. The limits of arms with
a balancer that the model lacks can be below 1."""
_ALIKE = 3  # axes from which on the same limit everywhere tells something


def disbelieved_limits(
    joints: Sequence[str],
    efforts: Sequence[float | None],
    weights: np.ndarray,
    gravity: np.ndarray,
) -> list[str]:
    """Tell which torque limits of a model are not used.

    Args:
        joints: Names of the axes.
        efforts: Torque limit that the model states for each axis [N m]; None if it states none.
        weights: Largest torque of the weight of all that each axis carries, if it lay horizontally,
            shape (n_axes,), in [N m]; 0 for slides, whose limits are not judged.
        gravity: Torque against gravity, shape (n_axes,), in [N m].

    Returns:
        For each axis why its limit is not used; empty if it is used or not stated.
    """
    largest = float(weights.max(initial=0.0))
    reasons = [""] * len(joints)
    if largest <= 0:
        return reasons
    hinges = [k for k, weight in enumerate(weights) if weight > 0 and efforts[k] is not None]
    alike = len(hinges) >= _ALIKE and len({efforts[k] for k in hinges}) == 1
    for k in hinges:
        effort = float(efforts[k] or 0.0)
        times = effort / usual_torque(float(weights[k]), largest)
        if times > (ALIKE_TORQUE if alike else MOST_TORQUE):
            reasons[k] = f"it is {times:.2g} times what drives of such an arm have"
        elif effort < LEAST_TORQUE * gravity[k]:
            reasons[k] = f"it cannot hold the arm, which needs {gravity[k]:.3g} N m"
    wrong = next((joints[k] for k in hinges if reasons[k]), None)
    for k in hinges if alike and wrong else ():
        reasons[k] = reasons[k] or f"it is the same for every joint, and not that of '{wrong}'"
    return reasons


def limit_warnings(
    joints: Sequence[str], efforts: Sequence[float | None], reasons: Sequence[str]
) -> list[str]:
    """Write in one line which torque limits of a model are not used.

    Args:
        joints: Names of the axes.
        efforts: Torque limit that the model states for each axis [N m]; None if it states none.
        reasons: For each axis why its limit is not used, from `disbelieved_limits`.

    Returns:
        One line, or none.
    """
    alike: dict[tuple[float, str], list[str]] = {}
    for joint, effort, reason in zip(joints, efforts, reasons, strict=True):
        if reason:
            alike.setdefault((float(effort or 0.0), reason), []).append(f"'{joint}'")
    told = [
        f"{', '.join(names)}: {effort:g} N m ({reason})"
        for (effort, reason), names in alike.items()
    ]
    if not told:
        return []
    return [
        f"torque limits of the model that look like placeholders are not used, {'; '.join(told)}; "
        "usual ones are assumed; state torque_limit in drives.toml for each axis if you know it"
    ]

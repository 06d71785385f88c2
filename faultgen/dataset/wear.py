"""Wear schedules: how severity grows from cycle to cycle.

The cycles are numbered k = 1 ... n. The severity is 0 before the first cycle, and reaches its final
value in the last cycle.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from faultgen.errors import InputError

SCHEDULES = {
    "exponential": "exp(c k^4) - 1, thesis eq. 6.6: slow at first, steep towards the end",
    "sigmoid": "tanh((c k)^4 / 2), thesis eq. 3.7: slow, steep, then level (99 % of its plateau)",
    "linear": "proportional to k",
    "step": "0 in the first half of the cycles, final from then on",
    "constant": "final in every cycle",
}
"""Formula of every schedule by name; an array with the severity of each cycle is one, too."""

# Thesis eq. 3.7 has two constants and one condition; where growth levels off is assumed.
_PLATEAU = 0.99


def severities(schedule: str | Sequence[float], final: float, cycles: int) -> np.ndarray:
    """Compute the severity in each cycle.

    With the constant of the thesis (c = 1.785e-9), eq. 6.6 ends at 19.5 % in cycle 100. Here c is
    chosen so that the curve ends at the final severity. Eq. 3.7 starts from r0 + c1 / 2. Its
    growth, (c1 / 2) tanh((c2 k)^4 / 2), is scaled so that it ends at the final severity.

    Args:
        schedule: A name of `SCHEDULES`, or the severity of each cycle.
        final: Severity in the last cycle, in any unit. It is not used if `schedule` is an array.
        cycles: Number of cycles.

    Returns:
        Shape (cycles,), in the unit of `final`.

    Raises:
        InputError: There is no such schedule, or the array has another length.
    """
    if not isinstance(schedule, str):
        values = np.asarray(schedule, float)
        if values.shape != (cycles,):
            raise InputError(f"schedule has {values.size} severities, but cycles = {cycles}")
        return values
    k = np.arange(1, cycles + 1) / cycles
    if schedule == "exponential":
        return np.expm1(np.log1p(final) * k**4)
    if schedule == "sigmoid":
        end = 2 * np.arctanh(_PLATEAU)
        return final * np.tanh(end * k**4 / 2) / _PLATEAU
    if schedule == "linear":
        return final * k
    if schedule == "step":
        return np.where(np.arange(cycles) >= cycles // 2, final, 0.0)
    if schedule == "constant":
        return np.full(cycles, float(final))
    raise InputError(
        f"unknown schedule '{schedule}': choose {', '.join(SCHEDULES)}, or an array of severities"
    )

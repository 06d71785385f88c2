"""How far the interpolated cycles of a run are from simulated ones.

Some cycles of the run are simulated as well: those in which the interpolation is expected to be
worst. Their errors are measured, and the bounds that a run states for all of its cycles are these
errors times a factor. The factors were chosen on some runs and tried on others, which
docs/surrogate.md lists.

    rows = checked(every, changes, between=[0.05, 0.15])
    within = bounds(told - simulated)   # within.run, within.cycle, within.sample
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

BOUNDS = {"run": "interpolation_error"} | {
    of: f"interpolation_error_{of}" for of in ("cycle", "sample")
}
"""Attribute of a run for each of its `Bounds`."""

# A checked cycle is rarely the very worst one. On the runs on which the factors were chosen, the
# whole run had up to 1.25 times the error of the checked cycles, the worst cycle 2.9 times that of
# the worst checked one, and the worst sample 2.5 times.
_RUN, _CYCLE, _SAMPLE = 1.5, 4.0, 4.0


class Bounds(NamedTuple):
    """Bounds of the error of the torque of each axis, shape (n_axes,) each, in [N m]."""

    run: np.ndarray
    """Of the RMS error over all samples of all cycles together."""
    cycle: np.ndarray
    """Of the RMS error over the samples of any single cycle."""
    sample: np.ndarray
    """Of the magnitude of the error of any single sample."""


def checked(every: np.ndarray, changes: np.ndarray, between: Sequence[float]) -> list[int]:
    """Choose the cycles of a run that are simulated as well.

    These are the cycles at the ends of temperature, payload and severity, those after the largest
    changes, those in which two of these are large together, because the interpolation ignores most
    interactions, and those whose severities are farthest from the simulated ones.

    Args:
        every: Temperature, payload factor and severity of each cycle, shape (cycles, 3).
        changes: Their changes from the cycle before, shape (cycles, 3).
        between: Severities in the middle between simulated ones.

    Returns:
        Numbers of the cycles, from 0, ascending.
    """
    middle = [(every[:, 0].min() + every[:, 0].max()) / 2, 1.0, 0.0]
    away = np.abs(np.hstack([every - middle, changes])).T
    ends = [*every.T, *-every.T, *away]
    ends += [one * other for one, other in combinations(away, 2)]
    found = {int(np.argmax(one)) for one in ends if np.ptp(one) > 0}
    found |= {int(np.argmin(np.abs(every[:, 2] - one))) for one in between}
    return sorted({*found, len(every) // 2})


def bounds(error: np.ndarray) -> Bounds:
    """Bound the error of all cycles of a run by that of the checked ones.

    Args:
        error: Error of the torque in the checked cycles, shape (cycles, samples, n_axes), in [N m].

    Returns:
        The bounds.
    """
    by_cycle = np.sqrt(np.mean(error**2, axis=1))
    return Bounds(
        _RUN * np.sqrt(np.mean(by_cycle**2, axis=0)),
        _CYCLE * by_cycle.max(axis=0),
        _SAMPLE * np.abs(error).max(axis=(0, 1)),
    )


def interpolation_error(told: Mapping[str, Any], of: str = "run") -> float:
    """Read the bound of the error of interpolated torque.

    Args:
        told: Attributes of a run.
        of: "run", "cycle" or "sample", see `Bounds`.

    Returns:
        The largest bound of an axis, over its noise; 0 if every cycle was simulated; nan if the run
        was made by a version that did not state this bound.
    """
    if BOUNDS["run"] not in told:
        return 0.0
    if BOUNDS[of] not in told:
        return float("nan")
    error, noise = np.asarray(told[BOUNDS[of]]), np.asarray(told["interpolation_noise"])
    return float(np.max(error / np.maximum(noise, 1e-300)))

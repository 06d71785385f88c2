"""Sudden errors that a recording has and the recording before the change does not.

Noise with outliers is no effect: it is in both recordings. If an axis has many more sudden errors
after the change than before it, something has been added that nothing in the catalogue explains,
such as a loose plug or a torque limit that is reached for an instant.
"""

from __future__ import annotations

import numpy as np
from scipy.stats import binomtest

from faultgen.discovery.fit.regression import Problem
from faultgen.discovery.laws.patterns import Pattern
from faultgen.discovery.replay.samples import rolling, samples_of

_LARGE = 6.0
"""Whitened error that normal noise does not reach: assumed. Two of a thousand million samples of
normal noise are as large."""

_EVENT = 0.1
"""Time without a sudden error after which the next one is another event [s]: assumed. An effect
that lasts makes errors that follow each other, and they must not count as independent."""


def spikes(problem: Problem, error: np.ndarray) -> list[Pattern]:
    """Compare how many sudden errors there are before and after the change.

    An event belongs to the recording whose torque departs more suddenly from the model. If nothing
    has changed, an event is as likely in one recording as in the other (sign test, corrected for
    the number of axes). Samples near rest and reversals are left out: friction that has changed a
    little jumps there.

    Args:
        problem: The recording and its baseline.
        error: Whitened error that remains, shape (samples, n_axes).

    Returns:
        One pattern for each axis with an event; none without a baseline. `strength` is the squared
        error in the events of the recording less that in the events of the baseline.
    """
    if not problem.baseline:
        return []
    after = problem.whiten(problem.recording.torque - problem.base)
    before = problem.whiten(problem.recording.torque - problem.residual - problem.base)
    used = rolling(problem.recording, problem.robot) & problem.inside
    used &= samples_of([problem.parts[p] for p in problem.fitting], len(error))[:, None]
    apart = max(1, round(_EVENT / problem.recording.sample_period))
    found = []
    for axis in range(error.shape[1]):
        at = np.flatnonzero(used[:, axis] & (np.abs(error[:, axis]) > _LARGE))
        if not len(at):
            continue
        event = np.concatenate([[0], np.cumsum(np.diff(at) > apart)])
        size, of_after, of_before = (
            np.bincount(event, one[at, axis].astype(float) ** 2) for one in (error, after, before)
        )
        is_new = of_after > of_before
        chance = binomtest(int(is_new.sum()), len(is_new), alternative="greater").pvalue
        strength = float(np.sum(np.where(is_new, size, -size)))
        first = at[np.argmax(event == np.argmax(size * is_new))]
        place = float(first * problem.recording.sample_period)
        p_value = min(1.0, error.shape[1] * float(chance))
        found.append(Pattern(axis + 1, "time", strength, p_value, place))
    return found

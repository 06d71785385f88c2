"""Numbers of a model that are fitted to a recording, beside effects, for its error to be reported.

The inference also has numbers that no model can contain, such as other forms of friction. Here only
those of the model vary, within physical ranges, and all samples have the same weight, because the
torque should be right where it is steady as well. Motions to which they were not fitted may refute
them, axis by axis; those kept for scoring have no say in this.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from faultgen.discovery.calibration.compared import compared
from faultgen.discovery.calibration.ranges import severities
from faultgen.discovery.decision.difference import Difference
from faultgen.discovery.decision.near import FARTHEST
from faultgen.discovery.decision.numbers import GENERIC
from faultgen.discovery.fit.bounded import bounded_minimum
from faultgen.discovery.fit.fit import bounds_of
from faultgen.discovery.fit.problem import Problem
from faultgen.discovery.replay.samples import samples_of
from faultgen.discovery.terms.candidates import INERTIA, MASSES

_ARM = (INERTIA, *MASSES)
"""Numbers that act on several axes; all others are those of the drive of one axis."""

_GROUPS = 5  # of neighbouring periods, so that each is judged by other motions: a usual number
_WITHIN = 0.9  # share of the bounds of an effect that a number may reach
_KEPT = (
    "the numbers of its drive are",
    "the numbers of its drive and all links are",
    "the whole model is",
)
"""What is used as given, in turn, until no axis is worse."""


@dataclass(frozen=True, eq=False)
class Calibrated:
    """Fitted numbers."""

    values: np.ndarray
    """Value of every term in prior standard deviations, shape (terms,); 0 for all but numbers."""
    lines: tuple[str, ...]
    """One line for what was taken back."""


def calibrated(
    problem: Problem, difference: Difference, scales: np.ndarray, change: np.ndarray
) -> Calibrated:
    """Fit the numbers of a model beside effects.

    Args:
        problem: The residual and the terms.
        difference: The same, as the inference sees it.
        scales: Logarithm of the scale of each group of numbers.
        change: Change of the torque by the effects, shape (samples, n_axes).

    Returns:
        The numbers. An axis that they make worse on motions to which they were not fitted, beyond
        the interval of the difference, keeps the numbers of its drive as given. If an axis is worse
        still, the links are kept, and at last all numbers.
    """
    fit = _Fit(problem, difference, scales, change)
    back = np.zeros(len(fit.terms), bool)
    weak, kept = np.zeros(problem.robot.n_axes, bool), ""
    for more in _KEPT:
        worse = fit.is_worse(back)
        if not worse.any():
            break
        weak, kept = weak | worse, more
        back = (~fit.arm & weak[fit.axes]) | (fit.arm & (more != _KEPT[0])) | (more == _KEPT[-1])
    values = np.zeros(len(problem.terms))
    scale = np.array([problem.terms[t].prior_std for t in fit.terms])
    values[fit.terms] = fit.exact(fit.values(back)) / scale
    if not kept:
        return Calibrated(values, ())
    told = ", ".join(str(k + 1) for k in np.flatnonzero(weak))
    line = (
        f"axis {told}: {kept} used as given, because after calibration the error on motions that "
        "were not fitted is larger than before"
    )
    return Calibrated(values, (line,))


class _Fit:
    """Least squares of the numbers, on groups of periods."""

    def __init__(
        self, problem: Problem, difference: Difference, scales: np.ndarray, change: np.ndarray
    ) -> None:
        numbers = difference.of_model
        terms: dict[tuple, int] = {}
        for k, term in enumerate(problem.terms):
            terms.setdefault((*term.key, term.parameters), k)
        chosen = [
            k
            for k, which in enumerate(numbers.which)
            if which in terms and numbers.kinds[k] not in (*GENERIC, "hardening")
        ]
        self._problem = problem
        self.terms = np.array([terms[numbers.which[k] or ()] for k in chosen], int)
        self.names = np.array([problem.terms[t].name for t in self.terms])
        self.arm = np.isin(self.names, _ARM)
        n_axes = problem.robot.n_axes  # a payload is one more link
        self.axes = np.array([min(problem.terms[t].axis, n_axes) for t in self.terms], int) - 1
        groups = [numbers.group[k] for k in chosen]
        self._std = np.array([numbers.std[k] for k in chosen]) * np.exp(scales[groups])
        self._columns = np.array([numbers.columns[k] for k in chosen])
        self._residual = difference.from_model - change
        self._given = problem.residual - change
        plain = difference.noise.plain()
        weight = (problem.inside * problem.samples(problem.fitting)[:, None]).astype(np.float32)
        white = plain.whiten(self._columns, problem.parts) * weight
        target = plain.whiten(self._residual, problem.parts) * weight
        folds = problem.folds
        count = len(self._residual)
        self.groups = [
            samples_of([folds[k] for k in own], count)
            for own in np.array_split(np.arange(len(folds)), min(_GROUPS, len(folds)))
        ]
        self._gram, self._right = [], []
        for rows in self.groups:
            x = white[:, rows].reshape(len(chosen), -1).astype(float)
            self._gram.append(x @ x.T)
            self._right.append(x @ target[rows].ravel().astype(float))
        low, high = np.array([severities(problem.terms[t]) for t in self.terms]).reshape(-1, 2).T
        links = np.array([problem.terms[t].name == INERTIA for t in self.terms], bool)
        low[links], high[links] = -FARTHEST, FARTHEST
        smallest, largest = bounds_of(problem, self.terms[~links].tolist())
        low[~links] = np.maximum(low[~links], _WITHIN * smallest)
        high[~links] = np.minimum(high[~links], _WITHIN * largest)
        self._low, self._high = low, high

    def values(self, back: np.ndarray, left_out: int | None = None) -> np.ndarray:
        """Fit to all groups but one; `back` are numbers that stay as given."""
        kept = [k for k in range(len(self.groups)) if k != left_out]
        gram = sum(self._gram[k] for k in kept) + np.diag(1 / self._std**2)
        right = sum(self._right[k] for k in kept)
        low, high = np.where(back, 0.0, self._low), np.where(back, 0.0, self._high)
        return bounded_minimum(gram, right, low, high)

    def exact(self, values: np.ndarray) -> np.ndarray:
        """Take numbers that a log multiplies by its gain out of it.

        A log of the torque t and its changes c v, of a constant that has lost the share s, is
        (t + c v) / (1 - s). Fitted is t + t s' + c w, so that s = s' / (1 + s'), v = w / (1 + s').

        Args:
            values: As fitted, shape (numbers,).

        Returns:
            Same shape. Links, whose torque is in several logs, take the mean gain.
        """
        gains = self.names == "torque_constant"
        logs = np.ones(self._problem.robot.n_axes)
        logs[self.axes[gains]] += values[gains]
        return values / np.where(self.arm, logs.mean(), logs[self.axes])

    def is_worse(self, back: np.ndarray) -> np.ndarray:
        """Axes on which each group is foretold worse by the numbers of the others, (n_axes,)."""
        left = self._given.copy()
        for k, rows in enumerate(self.groups):
            value = self.values(back, k).astype(np.float32)
            left[rows] = self._residual[rows] - np.tensordot(value, self._columns[:, rows], axes=1)
        recording = self._problem.recording
        size = np.sqrt(np.mean(recording.torque**2, axis=0))
        size = np.where(size > 0, size, np.inf)
        return compared(
            left / size,
            self._given / size,
            self._problem.inside,
            self._problem.folds,
            recording.sample_period,
        ).worse

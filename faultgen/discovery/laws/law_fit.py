"""Which curves predict a residual that they were not fitted to, for one axis.

Curves are added one at a time. The recordings are cut into blocks, and each block is predicted with
values that were fitted to the others. A curve is accepted only if the squared errors of these
predictions fall by more than chance allows.

Source: additive models by penalised least squares (Eilers and Marx 1996), forward selection by
cross-validation, block bootstrap of paired differences (Kunsch 1989).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from faultgen.discovery.fit.problem import Problem
from faultgen.discovery.laws.law_curves import Courses, Curve
from faultgen.discovery.laws.law_words import Part
from faultgen.discovery.terms.candidates import INERTIA, NUMBERS
from faultgen.inference.limits import CURVE_CHANCE, CURVE_GAIN, LAW_ERROR

MOST = 4
"""Largest number of curves of an axis."""

_ALLOWED = {name for name in NUMBERS if name != INERTIA}  # what may be wrong besides a law
_FOLDS = 6  # blocks that are predicted in turn, at least
_BLOCK = 0.25  # blocks of the bootstrap [s]
_DRAWS = 3999
_NEAR = 0.05  # share of a gain that a simpler curve may lack
_ROUNDING = 1e-12  # of products, over the largest
_SMOOTH = 2.0  # how much less values bend than they differ from zero: assumed


@dataclass(frozen=True, eq=False)
class Choice:
    """The curves that were chosen for an axis."""

    curves: tuple[Curve, ...]
    """In the order in which they were added."""
    values: tuple[np.ndarray, ...]
    """Values of each curve at its knots [N m], shape (size,) each."""
    gain: float
    """Decrease of the squared whitened error of predictions."""


class Regression:
    """Penalised least squares of the residual of one axis, with cross-validation."""

    def __init__(self, problem: Problem, courses: Courses, left: np.ndarray, axis: int) -> None:
        """Prepare the residual of an axis.

        Args:
            problem: The recording, its noise and its model.
            courses: The commanded motions.
            left: Residual, shape (samples, n_axes).
            axis: Axis, from 1.
        """
        self.problem, self.courses, self.axis = problem, courses, axis
        k = axis - 1
        use = problem.inside[:, k] & problem.samples(problem.fitting)
        self._rows = np.flatnonzero(use)
        self.target = problem.whiten(left)[self._rows, k].astype(float)
        self.rms = float(np.sqrt(np.mean(left[self._rows, k] ** 2))) if len(self._rows) else 0.0
        self.fold = _cut(problem, _FOLDS)[self._rows]
        count = round(len(problem.residual) * problem.recording.sample_period / _BLOCK)
        self._small = _cut(problem, max(count, 1))[self._rows]
        self.scale = self.rms / max(abs(courses.side[k]), 1e-300)
        """Size that the torque of the law is expected to have [N m]."""
        own = [
            number
            for number, term in enumerate(problem.terms)
            if term.axis == axis and term.name in _ALLOWED and not term.parameters
        ]
        # in units of the prior standard deviations, as the parameters of any model may be wrong
        stds = np.array([problem.terms[t].prior_std for t in own])[:, None]
        self.allowed = self.whitened(problem.raw[own][:, :, k]) * stds

    @property
    def is_enough(self) -> bool:
        """Whether there is something to explain, and enough samples for it."""
        return len(self._rows) >= 200 and self.rms > 0

    def whitened(self, columns: np.ndarray) -> np.ndarray:
        """Whiten columns, and keep the rows for fitting.

        Args:
            columns: Shape (columns, samples).

        Returns:
            Shape (columns, rows).
        """
        told = self.problem.whiten_axis(columns.astype(np.float32), self.axis)
        return told[:, self._rows].astype(float)

    def penalty(self, curve: Curve) -> np.ndarray:
        """Compute the precision of the values of a curve before any data.

        Args:
            curve: The curve.

        Returns:
            Shape (size, size), in [1 / (N m)^2].
        """
        size = curve.size
        bend = np.diff(np.eye(len(curve.knots)), 2, axis=0)
        if curve.repeats:
            bend = np.eye(size) - 2 * np.roll(np.eye(size), 1, axis=1)
            bend += np.roll(np.eye(size), 2, axis=1)
        return (np.eye(size) + _SMOOTH**2 * bend.T @ bend) / self.scale**2

    def errors(self, columns: np.ndarray, penalty: np.ndarray) -> np.ndarray:
        """Compute errors of predictions by values that were fitted to the other blocks.

        Args:
            columns: Whitened, shape (columns, rows).
            penalty: Precision before any data, shape (columns, columns).

        Returns:
            Whitened errors, shape (rows,).
        """
        error = self.target.copy()
        for fold in np.unique(self.fold):
            own = self.fold == fold
            train = columns[:, ~own]
            value = _minimum(train @ train.T + penalty, train @ self.target[~own])
            error[own] -= value @ columns[:, own]
        return error

    def fit(self, columns: np.ndarray, penalty: np.ndarray) -> np.ndarray:
        """Fit values to all rows.

        Args:
            columns: Whitened, shape (columns, rows).
            penalty: Precision before any data, shape (columns, columns).

        Returns:
            Shape (columns,), in [N m].
        """
        return _minimum(columns @ columns.T + penalty, columns @ self.target)

    def design(self, parts: Sequence[Part]) -> tuple[np.ndarray, np.ndarray]:
        """Compute the whitened columns of some curves or formulas, and their penalty.

        Args:
            parts: The curves or formulas.

        Returns:
            Columns, shape (columns, rows), and penalty, shape (columns, columns).
        """
        columns, penalties = [np.zeros((0, len(self._rows)))], []
        for part in parts:
            if part.formula is None:
                told = self.courses.columns(part.curve, self.axis)
                penalties.append(self.penalty(part.curve))
            else:
                dense = part.formula.curve(part.curve)
                shapes = part.formula.shapes[:, : dense.size]
                told = shapes @ self.courses.columns(dense, self.axis)
                size = np.abs(shapes).max(axis=1)
                penalties.append(np.diag((size / self.scale) ** 2))
            columns.append(self.whitened(told))
        return np.concatenate(columns), block_diag(*penalties) if penalties else np.zeros((0, 0))

    def squares(self, *designs: tuple[np.ndarray, np.ndarray]) -> float:
        """Sum of the squared errors of predictions with the columns of some designs."""
        columns = np.concatenate([self.allowed, *(columns for columns, _ in designs)])
        penalties = [penalty for _, penalty in designs if len(penalty)]
        error = self.errors(columns, block_diag(np.eye(len(self.allowed)), *penalties))
        return float(error @ error)

    def fitted(self, parts: Sequence[Part]) -> list[Part]:
        """The same curves and formulas with values that were fitted together."""
        columns, penalty = self.design(parts)
        count = len(self.allowed)
        value = self.fit(
            np.concatenate([self.allowed, columns]), block_diag(np.eye(count), penalty)
        )[count:]
        ends = np.cumsum([len(part.values) for part in parts])[:-1]
        return [
            replace(part, values=own)
            for part, own in zip(parts, np.split(value, ends), strict=True)
        ]

    def factor(self, left: np.ndarray, change: np.ndarray) -> tuple[float, float]:
        """Factor by which a change of the torque best explains a residual, and its error.

        Args:
            left: The residual, shape (samples, n_axes).
            change: The change, same shape and unit.
        """
        k = self.axis - 1
        own, target = (self.problem.whiten(x)[self._rows, k].astype(float) for x in (change, left))
        total = max(float(own @ own), 1e-300)
        factor = float(own @ target) / total
        rest = target - factor * own
        return factor, float(np.sqrt(max(rest @ rest / len(rest), 1.0) / total))

    def chance(self, before: np.ndarray, after: np.ndarray) -> float:
        """Probability that squared errors do not fall, by a block bootstrap.

        Args:
            before: Whitened errors, shape (rows,).
            after: The same with one more curve.
        """
        fall = before**2 - after**2
        names, index = np.unique(self._small, return_inverse=True)
        sums = np.bincount(index, fall)
        rng = np.random.default_rng(0)
        drawn = sums[rng.integers(len(names), size=(_DRAWS, len(names)))].sum(axis=1)
        return float((1 + np.sum(drawn <= 0)) / (_DRAWS + 1))


def _minimum(precision: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Values of least squares; 0 for a shape that is 0 on all samples."""
    raised = precision + _ROUNDING * np.diag(precision).max(initial=1.0) * np.eye(len(right))
    return np.asarray(np.linalg.solve(raised, right))


def _cut(problem: Problem, count: int) -> np.ndarray:
    """Number of the block to which each sample belongs, at least `count` blocks for fitting."""
    parts = [problem.parts[p] for p in problem.fitting]
    each = -(-count // len(parts))
    block = np.full(len(problem.residual), -1)
    for number, part in enumerate(parts):
        length = part.stop - part.start
        block[part] = number * each + np.arange(length) * each // length
    return block


def choose_curves(regression: Regression) -> Choice:
    """Choose the curves that predict best, one at a time.

    Args:
        regression: The residual of an axis.

    Returns:
        The curves and their values; none if no curve predicts more than chance.
    """
    candidates = regression.courses.curves(regression.axis)
    white = [
        regression.whitened(regression.courses.columns(one, regression.axis)) for one in candidates
    ]
    prior = [regression.penalty(one) for one in candidates]
    chosen: list[int] = []
    error = regression.errors(*_together(regression, white, prior, []))
    first = 0.0
    while len(chosen) < MOST:
        gains = _gains(regression, white, prior, chosen)
        gains[chosen] = -np.inf
        top = float(gains.max())
        if top < max(CURVE_GAIN, LAW_ERROR * first):
            break
        near = np.flatnonzero(gains >= (1 - _NEAR) * top).tolist()
        best = min(near, key=lambda k: (candidates[k].size, -gains[k]))
        after = regression.errors(*_together(regression, white, prior, [*chosen, best]))
        if regression.chance(error, after) > CURVE_CHANCE:
            break
        chosen.append(best)
        first = first or top
        error = after
    if not chosen:
        return Choice((), (), 0.0)
    value = regression.fit(*_together(regression, white, prior, chosen))[len(regression.allowed) :]
    ends = np.cumsum([candidates[k].size for k in chosen])[:-1]
    gain = float(regression.target @ regression.target - error @ error)
    return Choice(tuple(candidates[k] for k in chosen), tuple(np.split(value, ends)), gain)


def _together(
    regression: Regression,
    white: Sequence[np.ndarray],
    prior: Sequence[np.ndarray],
    chosen: Sequence[int],
) -> tuple[np.ndarray, np.ndarray]:
    """Columns and penalty of the parameters that may be wrong and of some curves."""
    allowed = regression.allowed
    columns = np.concatenate([allowed, *(white[k] for k in chosen)])
    return columns, block_diag(np.eye(len(allowed)), *(prior[k] for k in chosen))


def _gains(
    regression: Regression,
    white: Sequence[np.ndarray],
    prior: Sequence[np.ndarray],
    chosen: Sequence[int],
) -> np.ndarray:
    """Decrease of the squared error of predictions with each further curve, shape (curves,)."""
    own, penalty = _together(regression, white, prior, chosen)
    gains = np.zeros(len(white))
    for fold in np.unique(regression.fold):
        test = regression.fold == fold
        train, y = own[:, ~test], regression.target[~test]
        inverse = np.linalg.inv(train @ train.T + penalty)
        base = inverse @ (train @ y)
        error = regression.target[test] - base @ own[:, test]
        for k, column in enumerate(white):
            new = column[:, ~test]
            cross = new @ train.T @ inverse
            # the values of the new curve, with all others fitted again: Schur's complement
            gram = new @ new.T + prior[k] - cross @ (train @ new.T)
            value = np.linalg.solve(gram, new @ y - cross @ (train @ y))
            left = error - value @ (column[:, test] - cross @ own[:, test])
            gains[k] += float(error @ error - left @ left)
    return gains

"""Laws for effects that are in no catalogue, learned from the torque that remains unexplained.

    for one in learn(problem, left, changes):
        one.axis, one.sentence, one.formula, one.share
        robot = robot.with_effects([one.applied])

For each axis, curves over the variables of the commanded motion are added one at a time, as long as
they predict recordings that they were not fitted to (`law_fit`). The law is then put into the model
and the recording is simulated again, because the servo reacts to a torque. A law is kept only if
the simulation comes nearer to the motions that were used neither for fitting nor for choosing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from faultgen.discovery.fit.problem import Problem
from faultgen.discovery.laws.law_curves import Courses
from faultgen.discovery.laws.law_fit import Choice, Regression, choose_curves
from faultgen.discovery.laws.law_words import Formula, Part, formulas
from faultgen.discovery.replay.replay import Changes
from faultgen.discovery.replay.torque_error import relative_error
from faultgen.effects import Applied
from faultgen.effects.law_course import UNITS
from faultgen.effects.learned import NAME
from faultgen.errors import SimulationFailed
from faultgen.inference.limits import LAW_SAME, LAW_SHOWN, LAW_SIZE

_WORTH = 0.9  # share of the gain of curves that a formula has to reach
_BLOCK = 0.25  # blocks of the bootstrap [s]
_DRAWS = 999
_ALIKE = 0.5  # correlation from which an effect of the catalogue is told


@dataclass(frozen=True, eq=False)
class Learned:
    """A law for one axis."""

    axis: int
    """From 1."""
    terms: tuple[dict[str, Any], ...]
    """The law, as the effect `effects.learned` takes it."""
    depends_on: tuple[str, ...]
    """Names of its variables."""
    formula: str
    """The law as a formula. f(x) stands for a curve that no short formula describes."""
    sentence: str
    """The law in words."""
    ranges: dict[str, tuple[float, float, str]]
    """Lowest and highest value of each variable in the data, and its unit. Beyond them the law
    keeps its last value."""
    resembles: tuple[tuple[str, int, float], ...]
    """Effects of the catalogue whose torque is most alike: name, axis and correlation."""
    size: float
    """RMS torque of the law on the recording [N m]."""
    interval: tuple[float, float]
    """Interval that contains this size with 95 % probability."""
    confidence: float
    """Probability that the law predicts the scoring motions better than no law."""
    share: float
    """Share of the squared gap of the axis, noise included, that the law closes on the scoring
    motions."""
    change: np.ndarray
    """Simulated change of the torque with this law and those before it, shape (samples, n_axes)."""

    @property
    def applied(self) -> Applied:
        """The law as an effect."""
        return Applied(NAME, self.axis, 1.0, {"law": list(self.terms)})


def learn(problem: Problem, left: np.ndarray, changes: Changes = ()) -> list[Learned]:
    """Learn laws for the torque that neither effects nor calibration explain.

    Args:
        problem: The recording, its noise and the model.
        left: The torque that remains, shape (samples, n_axes), in the unit of the recording.
        changes: Changes of the model that explain the rest.

    Returns:
        The laws that come nearer to the scoring motions after re-simulation, at most one for each
        axis, in the order in which they were added.
    """
    courses = Courses(problem.replay, problem.inside)
    found: list[Learned] = []
    nothing = np.zeros_like(left)
    for axis in _by_strength(problem, left):
        regression = Regression(problem, courses, left, axis)
        choice = choose_curves(regression) if regression.is_enough else None
        if choice is None or not choice.curves:
            continue
        before = found[-1].change if found else nothing
        one = _added(problem, left, before, changes, found, regression, _parts(regression, choice))
        if one is not None:
            found.append(one)
    return found


def _by_strength(problem: Problem, left: np.ndarray) -> list[int]:
    """Axes, from 1, those with the largest whitened residual first."""
    use = problem.inside & problem.samples(problem.fitting)[:, None]
    squares = np.where(use, problem.whiten(left) ** 2, 0.0).sum(axis=0)
    return [int(k) + 1 for k in np.argsort(-(squares - use.sum(axis=0)))]


def _parts(regression: Regression, choice: Choice) -> list[Part]:
    """The chosen curves, with a short formula in place of each that one describes as well."""
    parts = [Part(*pair) for pair in zip(choice.curves, choice.values, strict=True)]
    for place in range(len(parts)):
        others = [part for k, part in enumerate(parts) if k != place]
        own = parts[place].curve
        rest = regression.design(others)
        best = regression.squares(rest, regression.design([parts[place]]))
        none = regression.squares(rest)
        good: tuple[int, float, Formula] | None = None
        for formula in formulas(own):
            size = len(formula.shapes)
            if good is not None and size > good[0]:
                break
            part = Part(own, np.zeros(size), formula)
            now = regression.squares(rest, regression.design([part]))
            if none - now >= _WORTH * (none - best) and (good is None or now < good[1]):
                good = size, now, formula
        if good is not None:
            parts[place] = Part(own, np.zeros(good[0]), good[2])
    return regression.fitted(parts)


def _added(
    problem: Problem,
    left: np.ndarray,
    before: np.ndarray,
    changes: Changes,
    found: Sequence[Learned],
    regression: Regression,
    parts: list[Part],
) -> Learned | None:
    """Put the law of an axis into the model after those that were found, or reject it."""
    axis, k = regression.axis, regression.axis - 1
    factor, error, change = 1.0, 0.0, before
    for _ in range(2):  # the second time with the factor by which the simulation falls short
        parts = [part.scaled(factor) for part in parts]
        own = Applied(NAME, axis, 1.0, {"law": [part.term for part in parts]})
        new = _simulated(problem, [*(one.applied for one in found), own], changes)
        if new is None:
            return None
        change = new
        factor, error = regression.factor(left - before, change - before)
        if not LAW_SHOWN < factor < 1 / LAW_SHOWN:
            return None
    torque = problem.recording.torque[problem.inside[:, k], k]
    logged = float(np.sqrt(np.mean((change - before)[problem.inside[:, k], k] ** 2)))
    if not problem.baseline and logged < LAW_SIZE * float(np.sqrt(np.mean(torque**2))):
        return None
    judged = _judged(problem, left - before, left - change, axis)
    if judged is None:
        return None
    alike = _resembles(problem, change - before)
    if alike and alike[0][2] > LAW_SAME:
        return None
    size = logged / abs(float(regression.courses.side[k]))
    wide = 1.96 * error
    return Learned(
        axis=axis,
        terms=tuple(part.term for part in parts),
        depends_on=tuple(dict.fromkeys(part.name(axis) for part in parts)),
        formula=" + ".join(part.written(axis) for part in parts).replace("+ -", "- "),
        sentence=f"axis {axis}: a torque "
        + ", and one ".join(part.described(axis) for part in parts),
        ranges={
            part.name(axis): (
                float(part.curve.knots[0]),
                float(part.curve.knots[-1]),
                UNITS[part.curve.over],
            )
            for part in parts
        },
        resembles=alike,
        size=size,
        interval=(max(size * (factor - wide), 0.0), size * (factor + wide)),
        confidence=judged[1],
        share=judged[0],
        change=change,
    )


def _simulated(problem: Problem, laws: Sequence[Applied], changes: Changes) -> np.ndarray | None:
    """Change of the torque by laws, in a model that has the changes; None if it diverges."""
    try:
        with_laws = problem.given.with_effects(laws).torque(changes)
        change = with_laws - problem.given.torque(changes)
    except SimulationFailed:
        return None
    return change if np.isfinite(change).all() else None


def _judged(
    problem: Problem, before: np.ndarray, after: np.ndarray, axis: int
) -> tuple[float, float] | None:
    """Share of the gap that is closed on the scoring motions, and the probability that it is.

    Args:
        problem: The recording.
        before: Torque that remained, shape (samples, n_axes).
        after: The same with the law in the model.
        axis: Axis of the law, from 1.

    Returns:
        Share and probability, or None if the model does not come nearer to the motions. Their
        error has to fall in torque and in units of the noise.
    """
    k = axis - 1
    use = problem.inside & problem.samples(problem.scoring)[:, None]
    gaps = [relative_error(x**2, problem.recording, use) for x in (before, after)]
    rows = np.flatnonzero(use[:, k])
    fall = np.subtract(*(problem.whiten(x)[rows, k].astype(float) ** 2 for x in (before, after)))
    if gaps[1] >= gaps[0] or not fall.sum() > 0:
        return None
    length = max(1, round(_BLOCK / problem.recording.sample_period))
    _, block = np.unique(rows // length, return_inverse=True)
    sums = np.bincount(block, fall)
    rng = np.random.default_rng(0)
    drawn = sums[rng.integers(len(sums), size=(_DRAWS, len(sums)))].sum(axis=1)
    confidence = float((1 + np.sum(drawn > 0)) / (_DRAWS + 2))
    was, now = (float(np.mean(x[rows, k] ** 2)) for x in (before, after))
    return 1 - now / was, confidence


def _resembles(problem: Problem, change: np.ndarray) -> tuple[tuple[str, int, float], ...]:
    """Effects of the catalogue whose sensitivities correlate most with a change of the torque."""
    own = problem.whiten(change).ravel().astype(float)
    best: dict[tuple[str, int], float] = {}
    for term, raw in zip(problem.terms, problem.raw, strict=True):
        if not term.is_effect:
            continue
        column = problem.whiten(raw).ravel().astype(float)
        size = float(np.linalg.norm(column) * np.linalg.norm(own))
        if size > 0:
            alike = abs(float(column @ own)) / size
            best[term.key] = max(best.get(term.key, 0.0), alike)
    top = sorted(best.items(), key=lambda item: -item[1])[:3]
    return tuple((*key, round(alike, 3)) for key, alike in top if alike > _ALIKE)

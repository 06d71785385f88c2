"""Whether the scoring motions, and a simulation, bear out the effects that were chosen."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from faultgen.discovery.fit import Fit, Group, fit
from faultgen.discovery.gap import gap, scored, unexplained
from faultgen.discovery.model_edit import build
from faultgen.discovery.regression import Problem
from faultgen.discovery.selection import Choice, needed

LARGER_TWIN, LARGER_OWN_TWIN = 1.005, 1.03
"""Gap with an effect, over that without it, from which the effect counts as refuted if there is a
twin: gap of all axes, and of the axis on which the effect acts. Assumed."""

LARGER, LARGER_OWN = 1.02, 1.06
"""The same without a twin, where the model's own numbers imitate an effect that is left out:
assumed."""

REFUTED = -1.0
"""Decrease of the error by an effect, over its standard error, from which the effect counts as
refuted: assumed."""

MISSED = 4.0
"""Standard errors by which what an effect foretells on the scoring motions may be missing, if the
error there does not decrease at all. It holds without a twin. Of 7 real effects of development
cases one reaches 2.6; of 6 false ones whose error does not decrease all reach 5."""


Gap = tuple[float, list[float]]
"""Relative error of all axes, and of each axis."""


def confirmed(problem: Problem, choice: Choice, calibrated: Gap) -> Choice:
    """Keep only the effects that are borne out by the scoring motions.

    An effect is removed for one of three reasons, where the set without it is fitted again. Its
    error on the scoring motions is clearly larger than without it. It foretells a change there that
    is not seen. Or it reduces the misfit by too little for a model that foretells the scoring
    motions as badly as this one does. Finally, a set is removed effect by effect until the model
    with it, simulated again, is not clearly worse than the calibrated model.

    Without an effect, the model's own numbers may explain the same at the price of values that
    healthy robots do not have, so that an equal error does not refute an effect.

    Args:
        problem: The residual and the terms.
        choice: The chosen set and its rivals.
        calibrated: Gap of the calibrated model without effects, simulated.

    Returns:
        The same choice, or one with fewer effects and without rivals.
    """
    best = choice.best
    while best.groups:
        trials = [
            _Trial.of(problem, rest, best, problem.terms[group[0]].axis, needed(problem, group))
            for group, rest in _without_one(choice.problem, best)
        ]
        if not trials:
            break
        refuted = [one for one in trials if one.is_refuted]
        if refuted:
            best = min(refuted, key=lambda one: one.gain).rest
        # each effect may compensate for another one, while none of them is right
        elif _gain(problem, _errors(problem, choice.fits[0], best)) < REFUTED:
            best = min(trials, key=lambda one: one.gain).rest
        else:
            break
    best = _buildable(problem, choice, best, calibrated)
    return choice if best is choice.best else replace(choice, best=best, rivals=())


def _without_one(problem: Problem, best: Fit) -> list[tuple[Group, Fit]]:
    """Each effect of a set, and the set without it, fitted again."""
    found = []
    for place, group in enumerate(best.groups):
        rest = fit(problem, [g for k, g in enumerate(best.groups) if k != place])
        if rest is not None:
            found.append((group, rest))
    return found


@dataclass(frozen=True, eq=False)
class _Trial:
    """What the scoring motions say about one effect of a set."""

    rest: Fit
    """The set without it."""
    gain: float
    """See `_gain`."""
    missed: float
    """Decrease of the squared error that the effect foretells on the scoring motions, less that
    which is seen, over its standard error."""
    seen: float
    """Decrease of the squared error on the scoring motions."""
    share: float
    """Decrease of the misfit, over that which is needed."""

    @property
    def is_refuted(self) -> bool:
        """Whether the effect is to be removed."""
        not_there = self.seen < 0 and self.missed > MISSED
        return self.gain < REFUTED or not_there or self.share < 1

    @classmethod
    def of(cls, problem: Problem, rest: Fit, best: Fit, axis: int, least: float) -> _Trial:
        """Try an effect.

        Args:
            problem: The residual and the terms.
            rest: The set without the effect.
            best: The set with it.
            axis: Axis on which it acts.
            least: Amount by which it must reduce the misfit, if noise alone is left.
        """
        errors = _errors(problem, rest, best)
        without, having = errors.whitened
        foretold = float(np.sum((without - having) ** 2))
        seen = float(np.sum(without**2 - having**2))
        over = max(1.0, float(np.sum(having**2) / max(scored(problem).sum(), 1)))
        # if the effect is real, the decrease is normal about what it foretells; where there is a
        # twin, the law of the effect decides how much, and real laws differ from the catalogue's
        missed = (foretold - seen) / (2 * np.sqrt(max(foretold * over, 1e-300)))
        missed = 0.0 if problem.twin else missed
        share = (rest.misfit - best.misfit) / (over * least)
        return cls(rest, _gain(problem, errors, axis), missed, seen, share)


def _buildable(problem: Problem, choice: Choice, best: Fit, calibrated: Gap) -> Fit:
    """The largest part of a set with which the simulated model is not clearly worse.

    The fit may foretell large effects and large numbers of the model that cancel each other, which
    they do not if they are simulated.
    """
    larger, larger_own = _tolerated(problem)
    whole, by_axis = _simulated_gap(problem, best) if best.groups else calibrated
    while best.groups:
        axes = {problem.terms[group[0]].axis for group in best.groups}
        own = [
            by_axis[k - 1] > larger_own * calibrated[1][k - 1]
            for k in axes
            if 1 <= k <= len(by_axis)
        ]
        if whole <= larger * calibrated[0] and not any(own):
            return best
        rests = [rest for _, rest in _without_one(choice.problem, best)]
        if not rests:
            break
        tried = [(_simulated_gap(problem, rest), rest) for rest in rests]
        (whole, by_axis), best = min(tried, key=lambda one: one[0][0])
    return choice.fits[0]


def _simulated_gap(problem: Problem, fitted: Fit) -> Gap:
    """Gap on the scoring motions, simulated with a set and the calibrated numbers."""
    return gap(problem, build(problem, fitted, unexplained(problem, fitted)[1]).left)


def _tolerated(problem: Problem) -> tuple[float, float]:
    """Gap of all axes, and of the effect's own axis, from which an effect counts as refuted."""
    return (LARGER_TWIN, LARGER_OWN_TWIN) if problem.twin else (LARGER, LARGER_OWN)


@dataclass(frozen=True, eq=False)
class _Errors:
    """Errors without and with an effect."""

    torque: tuple[np.ndarray, np.ndarray]
    """In N m, each of shape (samples, n_axes)."""
    whitened: tuple[np.ndarray, np.ndarray]
    """Without unit, same shapes; 0 outside the scoring motions."""


def _errors(problem: Problem, without: Fit, having: Fit) -> _Errors:
    inside = scored(problem)
    first, second = (unexplained(problem, one)[0] for one in (without, having))
    return _Errors(
        (first, second), (problem.whiten(first) * inside, problem.whiten(second) * inside)
    )


def _gain(problem: Problem, errors: _Errors, axis: int | None = None) -> float:
    """Whitened squared error on the scoring motions that an effect takes away, over its error.

    It is very negative if the gap, which is not whitened, becomes clearly larger: that of all axes,
    or that of the effect's own axis.
    """
    (before, own_before), (after, own_after) = (gap(problem, error) for error in errors.torque)
    larger, larger_own = _tolerated(problem)
    if after > larger * before:
        return -after / before - 100.0
    if axis is not None and 1 <= axis <= len(own_after):
        was, now = own_before[axis - 1], own_after[axis - 1]
        if now > larger_own * was:
            return -now / was - 50.0
    gain = np.subtract(*(error**2 for error in errors.whitened)).sum(axis=1)
    length = max(5, round(0.1 / problem.recording.sample_period))
    blocks = gain[: len(gain) // length * length].reshape(-1, length).sum(axis=1)
    return float(gain.sum() / max(np.sqrt(np.sum(blocks**2)), 1e-300))

"""Whether the scoring motions, and a simulation, bear out the effects that were chosen."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from faultgen.discovery.calibration.model_edit import build, simulated_numbers
from faultgen.discovery.decision.scoring_errors import (
    LARGER_OWN_SURE,
    LARGER_SURE,
    Error,
    Errors,
    Gap,
    is_larger,
    is_worse,
    limits_of,
)
from faultgen.discovery.decision.selection import Choice, needed, rivals_of
from faultgen.discovery.decision.small_waves import without_small_waves
from faultgen.discovery.fit.fit import Fit, Group, fit
from faultgen.discovery.fit.gap import gap, scored_in_motion
from faultgen.discovery.fit.regression import Problem
from faultgen.discovery.terms.candidates import Term
from faultgen.effects import get_effect

MISSED = 4.0
"""Standard errors by which what an effect foretells on the scoring motions may be missing, if the
error there does not decrease at all. It holds without a baseline. Of 7 real effects of development
cases one reaches 2.6; of 6 false ones whose error does not decrease all reach 5."""

STRONG = 2.5
"""Decrease of the misfit, less any increase on the scoring motions, over the needed one, from which
an effect is not refuted by a larger squared error there. Real laws of friction differ from those of
the catalogue, most of all at other speeds. It holds without a baseline: assumed."""

EVIDENT = 8.0
"""The same from which a wave is evident, although it is small beside other errors. Of development
cases, real waves have 13 to 209, and false ones at most 4."""

MOSTLY = 0.5
"""Share of the decrease that an effect foretells of the squared error on the scoring motions, from
which they bear it out although more is missing than chance explains. The law of a real effect
differs from the catalogue's: assumed."""

DOMINANT = 0.75
"""Share of what several effects of one kind explain on an axis, from which one of them stands for
all: assumed."""


@dataclass(frozen=True, eq=False)
class Confirmed:
    """A set of effects that is borne out, and the model that goes with it."""

    choice: Choice
    """The set that is borne out, and its rivals; a rival that took its place has none."""
    solution: np.ndarray
    """Calibrated value of every term in its prior standard deviations, shape (terms,); 0 for the
    effects of the set."""
    resembled: tuple[Term, ...] = ()
    """Effects that are refuted although, with a baseline, they explain most of what differs on
    their axis. Nothing is left of the set then: something has changed that only resembles them."""


def confirmed(
    problem: Problem, choice: Choice, calibrated: np.ndarray, numbers: np.ndarray
) -> Confirmed:
    """Keep only the effects that are borne out by the scoring motions.

    Samples in motion are compared. An effect is removed for one of five reasons, where the set
    without it is fitted again. The squared error on the scoring motions is clearly larger than
    without it, or so is the gap. It foretells a change there that is not seen. Or it reduces the
    misfit by too little for a model that foretells the scoring motions as badly as this one does.
    With a baseline, it explains only a small part of what differs on its axis.
    Finally, a set is removed effect by effect until the model with it, simulated again, is not
    clearly worse than the calibrated model. If nothing is left of a set, the sets that the data do
    not exclude in its place are tried.

    Without an effect, the model's own numbers may explain the same at the price of values that
    healthy robots do not have, so that an equal error does not refute an effect.

    Args:
        problem: The residual and the terms.
        choice: The chosen set and its rivals.
        calibrated: Torque error of the calibrated model without effects, simulated, in N m; shape
            (samples, n_axes).
        numbers: Its calibrated values in prior standard deviations, shape (terms,).

    Returns:
        The same choice, or one with fewer effects and their rivals, or with a rival; and the
        calibrated values with which the scoring motions are foretold best.
    """
    inside = scored_in_motion(problem)
    resembled: list[Term] = []
    for best in chain([choice.best], _rivals(choice)):
        kept, trials, refuted = _borne_out(problem, choice, best, inside)
        resembled += [problem.terms[one.group[0]] for one in refuted if one.is_major]
        is_sure = bool(trials) and all(one.is_supported for one in trials)
        kept = _with_dominant(choice, kept)
        kept, solution = _buildable(problem, choice, kept, calibrated, numbers, inside, is_sure)
        if not problem.baseline:
            evident = {one.group for one in trials if one.is_evident}
            kept = without_small_waves(problem, choice.problem, kept, solution, inside, evident)
        if kept.groups:
            resembled = []
            break
    if kept is choice.best:
        return Confirmed(choice, solution)
    rivals: tuple[tuple[int, Group, float], ...] = ()
    if kept.groups and set(kept.groups) <= set(choice.best.groups):  # no rival of the chosen set
        found = rivals_of(choice.problem, kept)
        rivals = tuple(one for one in found if one[1] not in choice.best.groups)
    return Confirmed(replace(choice, best=kept, rivals=rivals), solution, tuple(resembled))


def _rivals(choice: Choice) -> Iterator[Fit]:
    """Sets that the data do not exclude, best first, in case that the best one is refuted."""
    for place, group, _ in sorted(choice.rivals, key=lambda one: one[2]):
        groups = [group if k == place else own for k, own in enumerate(choice.best.groups)]
        rival = fit(choice.problem, groups)
        if rival is not None:
            yield rival


def _borne_out(
    problem: Problem, choice: Choice, best: Fit, inside: np.ndarray
) -> tuple[Fit, list[Trial], list[Trial]]:
    """The part of a set that the scoring motions bear out.

    Args:
        problem: The residual and the terms.
        choice: The chosen set and its rivals.
        best: The set to begin with.
        inside: Samples that are compared, shape (samples, n_axes).

    Returns:
        The part; what the scoring motions say about each effect of it; and the same of each effect
        that was refuted.
    """
    trials: list[Trial] = []
    gone: list[Trial] = []
    while best.groups:
        having = Error.of(problem, best, inside)
        trials = [
            Trial.of(problem, group, (rest, best), Errors.of(problem, rest, having, inside))
            for group, rest in _without_one(choice.problem, best)
        ]
        if not trials:
            break
        refuted = [one for one in trials if one.is_refuted]
        if refuted:  # the weakest first: a false effect distorts what the others seem to do
            gone.append(min(refuted, key=lambda one: one.share))
            best = gone[-1].rest
        # each effect may compensate for another one, while none of them is right
        elif not all(one.is_supported or one.is_strong for one in trials) and Errors.of(
            problem, choice.fits[0], having, inside
        ).are_worse(problem):
            best = min(trials, key=lambda one: one.gain).rest
        else:
            return best, trials, gone
    return best, [], gone


def shared_kinds(problem: Problem, best: Fit) -> set[tuple[str, int]]:
    """Find the axes with several kinds of speed-dependent friction, or several kinds of waves.

    Together they make a curve, or a wave, that no single effect of the catalogue has. A ripple of
    several orders is one kind: motors have it at the orders of their poles and of their slots.

    Args:
        problem: The residual and the terms.
        best: The set of effects.

    Returns:
        Group of effects and axis.
    """
    terms = [problem.terms[group[0]] for group in best.groups]
    kinds = {(_kind(one), one.name, one.axis) for one in terms if _kind(one)}
    count = Counter((kind, axis) for kind, _, axis in kinds)
    return {key for key, several in count.items() if several > 1}


def _kind(term: Term) -> str:
    """What effects have in common that may stand for each other; empty for others."""
    prior = get_effect(term.name).prior
    return "periodic" if prior.use == "periodic" else prior.group


def _with_dominant(choice: Choice, best: Fit) -> Fit:
    """The set in which one effect stands for several of one kind, if it explains almost as much.

    The others then only make up for the form of its law, which is not that of the catalogue.
    """
    problem = choice.problem
    while shared := shared_kinds(problem, best):
        tried = [
            rest
            for group, rest in _without_one(problem, best)
            if (_kind(one := problem.terms[group[0]]), one.axis) in shared
        ]
        simpler = min(tried, key=lambda rest: rest.misfit, default=None)
        if simpler is None or _likeness(choice, simpler, best) < DOMINANT:
            break
        best = simpler
    return best


def _likeness(choice: Choice, simpler: Fit, best: Fit) -> float:
    """How much of what a set explains is also explained by a smaller one.

    With a baseline, their torques are compared, because the misfit depends on how much the friction
    may differ from day to day. Without one, much of a torque may be due to the numbers of the
    model.
    """
    problem, empty = choice.problem, choice.fits[0].misfit
    if not problem.baseline:
        return (empty - simpler.misfit) / max(empty - best.misfit, 1e-300)
    missing, whole = (
        float(np.sum((problem.whiten(change) * problem.inside) ** 2))
        for change in (best.change - simpler.change, best.change)
    )
    return 1 - missing / max(whole, 1e-300)


def _without_one(problem: Problem, best: Fit) -> list[tuple[Group, Fit]]:
    """Each effect of a set, and the set without it, fitted again."""
    found = []
    for place, group in enumerate(best.groups):
        rest = fit(problem, [g for k, g in enumerate(best.groups) if k != place])
        if rest is not None:
            found.append((group, rest))
    return found


@dataclass(frozen=True, eq=False)
class Trial:
    """What the scoring motions say about one effect of a set."""

    group: Group
    """The terms of the effect."""
    rest: Fit
    """The set without it."""
    gain: float
    """Decrease of the squared whitened error on the scoring motions, over its standard error."""
    grows: bool
    """Whether the gap there, which is not whitened, becomes clearly larger."""
    missed: float
    """Decrease of the squared whitened error that the effect foretells there, less that which is
    seen, over its standard error."""
    seen: float
    """Decrease of the squared whitened error there, over the overdispersion."""
    share: float
    """Decrease of the misfit, less any increase of the squared whitened error on the scoring
    motions, over the decrease that is needed."""
    is_supported: bool
    """Whether the scoring motions bear out the effect by themselves."""
    is_minor: bool
    """Whether, with a baseline, it explains only a small part of what differs on its axis."""
    is_major: bool
    """Whether, with a baseline, it explains most of what differs on its axis."""
    is_strong: bool
    """Whether, without a baseline, the evidence of all motions together is `STRONG`."""

    @property
    def is_refuted(self) -> bool:
        """Whether the effect is to be removed."""
        is_absent = self.seen < 0 and self.missed > MISSED
        worse = is_absent or is_worse(self.gain, self.seen)
        grows = self.grows and not self.is_supported
        return grows or (worse and not self.is_strong) or self.is_minor or self.share < 1

    @property
    def is_evident(self) -> bool:
        """Whether all motions show it so clearly that its torque may be a small part of the gap."""
        return self.is_supported and self.share >= EVIDENT

    @classmethod
    def of(cls, problem: Problem, group: Group, fits: tuple[Fit, Fit], errors: Errors) -> Trial:
        """Try an effect.

        Args:
            problem: The residual and the terms.
            group: The terms of the effect.
            fits: The set without the effect, and with it.
            errors: Their errors on the scoring motions.
        """
        rest, best = fits
        least = needed(problem, group)
        foretold = float(np.sum((errors.without.whitened - errors.having.whitened) ** 2))
        foretold, seen = foretold / errors.over, errors.seen / errors.over
        # if the effect is real, the decrease is normal about what it foretells; where there is a
        # baseline, the law of the effect decides how much, and real laws differ from the
        # catalogue's
        missed = (foretold - seen) / (2 * np.sqrt(max(foretold, 1e-300)))
        missed = 0.0 if problem.baseline else missed
        share = (rest.misfit - best.misfit + min(errors.seen, 0.0)) / (errors.over * least)
        is_strong = not problem.baseline and share >= STRONG
        limits = limits_of(problem, built=is_strong)
        return cls(
            group=group,
            rest=rest,
            gain=errors.gain,
            grows=errors.grows(problem, [problem.terms[group[0]].axis], limits),
            missed=missed,
            seen=seen,
            share=share,
            is_supported=seen >= least and (abs(missed) <= MISSED or seen >= MOSTLY * foretold),
            is_minor=problem.baseline and errors.is_minor(problem, problem.terms[group[0]].axis),
            is_major=problem.baseline and errors.is_major(problem, problem.terms[group[0]].axis),
            is_strong=is_strong,
        )


def _buildable(
    problem: Problem,
    choice: Choice,
    best: Fit,
    calibrated: np.ndarray,
    numbers: np.ndarray,
    inside: np.ndarray,
    is_sure: bool,
) -> tuple[Fit, np.ndarray]:
    """The largest part of a set with which the simulated model is not clearly worse.

    The fit may foretell large effects and large numbers of the model that cancel each other, which
    they do not if they are simulated.

    Args:
        problem: The residual and the terms.
        choice: The chosen set and its rivals.
        best: The set, as far as it is borne out.
        calibrated: Torque error of the calibrated model without effects, shape (samples, n_axes).
        numbers: Its calibrated values, shape (terms,).
        inside: Samples that are compared, shape (samples, n_axes).
        is_sure: Whether the scoring motions bear out every effect by themselves.

    Returns:
        The part of the set, and the calibrated values that go with it.
    """
    before = gap(problem, calibrated, inside)

    def simulated(fitted: Fit) -> tuple[Gap, np.ndarray]:
        """Smallest gap, with calibrated values that were found with the set or without effects."""
        found = []
        for solution in (simulated_numbers(problem, fitted), numbers)[
            : 1 if problem.baseline else 2
        ]:
            own = solution.copy()
            own[fitted.terms] = 0.0
            found.append((gap(problem, build(problem, fitted, own).left, inside), own))
        return min(found, key=lambda one: one[0][0])

    limits = (LARGER_SURE, LARGER_OWN_SURE) if is_sure else limits_of(problem, built=True)
    after, solution = simulated(best) if best.groups else (before, numbers)
    while best.groups:
        axes = {problem.terms[group[0]].axis for group in best.groups}
        if not is_larger(before, after, limits, axes):
            return best, solution
        tried = [(*simulated(rest), rest) for _, rest in _without_one(choice.problem, best)]
        if not tried:
            break
        after, solution, best = min(tried, key=lambda one: one[0][0])
    return choice.fits[0], numbers

"""The effects that a difference shows, with severities from simulations.

choice = choose(problem, difference)
choice.best
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from faultgen.building.doubts import moving_mass
from faultgen.discovery.decision.difference import Difference
from faultgen.discovery.decision.dispersion import dispersion, of_effect, shrunk
from faultgen.discovery.decision.hypotheses import UNKNOWN, Group
from faultgen.discovery.decision.numbers import GEARS, GENERIC
from faultgen.discovery.fit.fit import Fit, bounds_of, fit_at, no_effect
from faultgen.discovery.fit.problem import Problem
from faultgen.discovery.replay.servo_errors import DELAY
from faultgen.discovery.terms.candidates import PAYLOAD, Term
from faultgen.effects import get_effect
from faultgen.effects.structure import MASSLESS
from faultgen.inference.confirm import confirmed, without_refuted
from faultgen.inference.limits import (
    FALSE_ALARMS,
    LIKELY,
    OF_MODEL,
    SHORTEST_SHARE,
    SMALLEST_ERROR,
)
from faultgen.inference.search import Found, log_priors, search

SURE = float(np.log((1 - FALSE_ALARMS) / FALSE_ALARMS))
"""Logarithm of the posterior odds from which an effect counts."""

_AROUND = 0.2  # farthest severity of a play from its column, over it: neighbours are 25 % apart
_FAR = 0.8  # the same of another effect that is not linear, from its linear estimate
# ratio of a linear severity and a simulated one, up to which they are one: on development robots a
# true effect whose law has another form had 1.6, and a payload taken for a stiffer gearbox had 8
_SAME = 2.0
_STRAIGHTENED = 2  # simulations of an effect that is nearly linear: the second changes little
_LITTLE = 0.01  # change of its severity by the first, from which there is a second: assumed
_PROBES, _FINER = 9, 3  # severities that are simulated, and how often closer ones


@dataclass(frozen=True, eq=False)
class Choice:
    """The chosen set of effects and its rivals."""

    problem: Problem
    """The residual and the terms."""
    difference: Difference
    """The same, as the inference sees it."""
    found: Found
    """What the inference found."""
    groups: tuple[Group, ...]
    """Terms of each effect of the catalogue that was found."""
    odds: tuple[float, ...]
    """Logarithm of the odds that each is there."""
    shares: tuple[float, ...]
    """Probability of each among its rivals."""
    best: Fit
    """The effects with their severities."""
    empty: Fit
    """No effect."""
    rivals: tuple[tuple[int, Group, float], ...]
    """Exchanges that are not excluded: position in the set, the effect that is put there, and its
    probability."""
    unknown: tuple[tuple[int, str], ...]
    """Axis, and the variable on which it depends, of each effect that no catalogue has."""
    refuted: tuple[tuple[str, int, float], ...]
    """Effect and axis of what motions that were not fitted refute, and the logarithm of the ratio
    of the probabilities of these motions with and without it."""
    variance: np.ndarray
    """From `dispersion`, shape (n_axes,)."""
    doubtful: tuple[tuple[str, int], ...] = ()
    """Effect and axis of what would be sure if the model were exact."""

    @property
    def is_sure(self) -> bool:
        """Whether every effect is certain, and not only likely."""
        return all(one >= SURE for one in self.odds)


def choose(problem: Problem, difference: Difference) -> Choice:
    """Choose the effects, and find their severities by simulation.

    Args:
        problem: The residual and the terms.
        difference: The same, as the inference sees it.

    Returns:
        The chosen set and its rivals.
    """
    sure, least = (SURE, LIKELY) if problem.baseline else (SURE + OF_MODEL, SURE)
    others = difference.held_out.only(difference.model.places_without(GENERIC))
    if problem.baseline:  # rings of the arm that smoothing has changed look like these numbers
        known = without_refuted(difference.exact, others, GEARS)
        difference = replace(difference, model=replace(difference.model, groups=known.groups))
    found = search(difference.model, difference.hypotheses, sure, GENERIC)
    named = [one for one in difference.hypotheses if not one.unknown]
    if problem.baseline:
        found = found.or_likely(named)
    found, refuted = confirmed(found, others)
    prior = dict(zip([one.key for one in named], log_priors(named).tolist(), strict=True))
    groups: list[Group] = []
    odds, shares, priors = [], [], []
    rivals: list[tuple[int, Group, float]] = []
    unknown: list[tuple[int, str]] = []
    for effect in found.by_size():
        first = effect.forms[0][0]
        if effect.keys[0][0] == UNKNOWN:
            if effect.odds >= SURE + OF_MODEL:
                unknown.append((effect.keys[0][1], difference.over[first]))
            continue
        place = len(groups)
        groups.append(difference.groups[first])
        odds.append(effect.odds)
        priors.append(prior[effect.keys[0]])
        shares.append(float(effect.probabilities[0]))
        for key, share, form in list(
            zip(effect.keys, effect.probabilities, effect.forms, strict=True)
        )[1 : effect.credible]:
            rival = difference.groups[form[0]]
            if rival and key[:2] != effect.keys[0][:2]:
                rivals.append((place, rival, float(share)))
    best = severities(problem, difference, groups, found.fitted.log_scales)
    variance, error = dispersion(problem, difference, found.fitted, best.change)
    ratios, exact = shrunk(variance, error), tuple(odds)
    for k, group in enumerate(groups):
        evidence = odds[k] - priors[k] - best.lost[k]
        evidence /= of_effect(problem, difference, group, ratios)
        odds[k] = evidence + priors[k] - (sure - SURE)
    choice = Choice(
        problem,
        difference,
        found,
        tuple(groups),
        tuple(odds),
        tuple(shares),
        best,
        no_effect(problem),
        tuple(rivals),
        tuple(unknown),
        tuple((one.keys[0][0], one.keys[0][1], gained) for one, gained in refuted),
        variance,
        tuple(
            problem.terms[group[0]].key
            for group, one, before in zip(groups, odds, exact, strict=True)
            if one < least and before >= sure
        ),
    )
    real = [k for k in range(len(groups)) if odds[k] >= least and _can_be(choice, k)]
    return choice if len(real) == len(groups) else only(choice, real)


def _can_be(choice: Choice, place: int) -> bool:
    """Whether an effect is within its bounds, is no smaller than what is told, and is simulated."""
    group, value, _ = list(choice.best.members())[place]
    low, high = bounds_of(choice.problem, group)
    pairs = [(choice.problem.terms[t], float(v)) for t, v in zip(group, value, strict=True)]
    inside = bool(np.all((value > low) & (value < high)))
    name = choice.problem.terms[group[0]].name
    if name == DELAY:
        period = choice.problem.recording.sample_period
        inside &= abs(float(value[0])) >= SHORTEST_SHARE * period
    if name == PAYLOAD and len(group) > 1:  # points, of which each may be negative
        mass = float(value.sum())
        inside &= MASSLESS < mass < moving_mass(choice.problem.robot.model)
    if name == "transmission_error":  # sine and cosine
        inside &= float(np.linalg.norm(value)) >= SMALLEST_ERROR
    return inside and choice.problem.change(pairs) is not None


def only(choice: Choice, kept: Sequence[int]) -> Choice:
    """Leave out effects of a choice.

    Args:
        choice: The choice.
        kept: Positions of the effects that stay.
    """
    groups = [choice.groups[k] for k in kept]
    scales = choice.found.fitted.log_scales
    return replace(
        choice,
        groups=tuple(groups),
        odds=tuple(choice.odds[k] for k in kept),
        shares=tuple(choice.shares[k] for k in kept),
        best=severities(choice.problem, choice.difference, groups, scales),
        rivals=tuple((kept.index(k), group, p) for k, group, p in choice.rivals if k in kept),
    )


def severities(
    problem: Problem, difference: Difference, groups: Sequence[Group], scales: np.ndarray
) -> Fit:
    """Find the severities of effects, where need be with simulations.

    An effect that is far from linear is simulated at several severities. No slope leads to the
    right one, because the strokes of a play of another size come at other times, and because a real
    law may resemble that of another severity more.

    Args:
        problem: The residual and the terms.
        difference: The same, as the inference sees it.
        groups: Terms of each effect.
        scales: Logarithm of the scale of each group of numbers.

    Returns:
        The effects with their severities, within the bounds of the effects.
    """
    if not groups:
        return no_effect(problem)
    terms = [k for group in groups for k in group]
    columns = problem.raw[terms].copy()
    low, high = bounds_of(problem, terms)
    own = [problem.terms[t] for t in terms]
    first, spread = difference.beside(columns, own, None, scales)
    size, error = np.zeros(len(terms)), np.zeros(len(terms))
    lost = np.zeros(len(terms))
    bent = [k for k, t in enumerate(terms) if _is_bent(problem, t)]
    for k in bent:
        centre, reach = float(np.clip(first[k], low[k], high[k])), _FAR
        if get_effect(own[k].name).prior.play:
            centre, reach = own[k].step, _AROUND
        columns[k], size[k], error[k], fall = _simulated(
            problem, difference, terms, columns, k, scales, centre, reach
        )
        if not 1 / _SAME < size[k] / (first[k] or np.inf) < _SAME:  # the column does not hold there
            lost[k] = max(0.0, 0.5 * (float(first[k] ** 2 / spread[k, k]) - fall))
    value, covariance = difference.beside(columns, own, size, scales)
    value, covariance = np.clip(value, low, high), covariance.copy()
    value[bent] = size[bent]
    covariance[bent] = covariance[:, bent] = 0.0
    covariance[bent, bent] = error[bent] ** 2
    single = {group[0] for group in groups if len(group) == 1}
    for k, (term, number) in enumerate(zip(own, terms, strict=True)):
        if k not in bent and number in single:
            share = _curvature(problem, difference, term, columns[k], float(value[k]))
            value[k] *= share
            covariance[k] *= share
            covariance[:, k] *= share
    value = np.clip(value, low, high)
    places = np.cumsum([0, *(len(group) for group in groups)])[:-1]
    found = fit_at(problem, tuple(groups), value, covariance)
    return replace(found, lost=tuple(lost[places].tolist()))


def _curvature(
    problem: Problem, difference: Difference, term: Term, column: np.ndarray, value: float
) -> float:
    """Severity of a simulation that changes the torque as a linear effect does, over that of it.

    Args:
        problem: The residual and the terms.
        difference: The same, as the inference sees it.
        term: The effect.
        column: Its change of the torque per unit, shape (samples, n_axes).
        value: Its severity, as if it was linear.
    """
    wanted, share = difference.whiten(column * value), 1.0
    for _ in range(_STRAIGHTENED):
        change = problem.change([(term, share * value)])
        if change is None:
            return 1.0
        white = difference.whiten(change)
        size = float(np.sum(white**2))
        more = float(np.sum(white * wanted)) / size if size else 1.0
        share *= more
        if abs(more - 1) < _LITTLE:
            break
    return share if 1 / _SAME < share < _SAME else 1.0


def _simulated(
    problem: Problem,
    difference: Difference,
    terms: Sequence[int],
    columns: np.ndarray,
    place: int,
    scales: np.ndarray,
    centre: float,
    reach: float,
) -> tuple[np.ndarray, float, float, float]:
    """Find a severity by simulations of several, beside numbers and other effects.

    Args:
        problem: The residual and the terms.
        difference: The same, as the inference sees it.
        terms: All terms.
        columns: Their changes of the torque per unit, shape (terms, samples, n_axes).
        place: Which of them.
        scales: Logarithm of the scale of each group of numbers.
        centre: Severity about which to look.
        reach: How far, as a share of it.

    Returns:
        Its change of the torque per unit at this severity, shape (samples, n_axes), the severity,
        its standard error, from the curvature of the misfit, and the fall of the misfit.
    """
    term = problem.terms[terms[place]]
    others = [k for k in range(len(terms)) if k != place]
    steps = [3 * problem.terms[terms[k]].step for k in others]
    misfit_of = _misfit(difference, columns[others], steps, scales)
    misfits: dict[float, float] = {}
    changes: dict[float, np.ndarray] = {}

    def simulate(size: float) -> None:
        change = problem.change([(term, size)]) if size not in misfits else None
        if change is not None:
            misfits[size], changes[size] = misfit_of(change), change

    width = 2 * reach / (_PROBES - 1) * abs(centre)
    for k in range(_PROBES if centre else 0):
        simulate(centre + (k - _PROBES // 2) * width)
    for _ in range(_FINER if misfits else 0):
        best, width = min(misfits, key=lambda size: misfits[size]), width / 2
        simulate(best - width)
        simulate(best + width)
    if len(misfits) < 3:  # the simulation diverges
        return columns[place], centre, reach * abs(centre), np.inf
    best = min(misfits, key=lambda size: misfits[size])
    near = sorted(misfits, key=lambda size: abs(size - best))[:3]
    curved, slope, _ = np.polyfit(np.array(near) - best, [misfits[size] for size in near], 2)
    error = reach * abs(centre)
    if curved > 0:
        simulate(best + float(np.clip(-slope / (2 * curved), -width, width)))
        best = min(misfits, key=lambda size: misfits[size])
        error = min(error, float(np.sqrt(1 / curved)))  # there the misfit is larger by 1
    return changes[best] / best, best, error, misfit_of(0 * changes[best]) - misfits[best]


def _misfit(
    difference: Difference, columns: np.ndarray, stds: Sequence[float], scales: np.ndarray
) -> Callable[[np.ndarray], float]:
    """Squared whitened residual less a change of the torque, after a fit of all numbers.

    Args:
        difference: The difference.
        columns: Of other effects, shape (effects, samples, n_axes).
        stds: Their sizes.
        scales: Logarithm of the scale of each group of numbers.
    """
    size = difference.residual.size
    others = [std * one for std, one in zip(stds, columns, strict=True)]
    beside = np.array(others, np.float32).reshape(-1, *difference.residual.shape)
    white = np.concatenate([difference.white_numbers(scales), difference.whiten(beside)])
    white = white.reshape(len(white), size)
    factor = cho_factor(white.astype(float) @ white.T.astype(float) + np.eye(len(white)))

    def misfit(change: np.ndarray) -> float:
        left = difference.whiten(difference.residual - change).ravel()
        right = white @ left
        return float(left @ left - right @ cho_solve(factor, right))

    return misfit


def _is_bent(problem: Problem, index: int) -> bool:
    """Whether the torque of an effect is far from proportional to its severity."""
    prior = get_effect(problem.terms[index].name).prior
    return prior.play or len(prior.steps) > 1

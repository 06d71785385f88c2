"""The verdict: nothing missing, effects named or partly named, ambiguous, or unknown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from faultgen.discovery.calibration.model_edit import build, build_stable
from faultgen.discovery.decision.calibrated import Calibrated, calibrated
from faultgen.discovery.decision.choice import SURE, Choice, only
from faultgen.discovery.decision.gate import gate
from faultgen.discovery.decision.hypotheses import UNKNOWN as UNKNOWN_FORM
from faultgen.discovery.decision.numbers import ALL_FRICTION, PARTS_OF_FRICTION
from faultgen.discovery.fit.diagnostics import where
from faultgen.discovery.fit.fit import Fit, first_of
from faultgen.discovery.fit.gap import gap, scored
from faultgen.discovery.fit.problem import Problem
from faultgen.discovery.result import (
    AMBIGUOUS,
    MODEL,
    NAMED,
    NONE,
    PARTLY,
    UNKNOWN,
    Answer,
    Named,
)
from faultgen.discovery.terms.candidates import INERTIA, MASSES, PAYLOAD, Term, payload_of
from faultgen.effects import get_effect
from faultgen.inference.limits import CONSIDERABLE, NAMED_SHARE, USUAL_SHOWN

_WIDE = 1.96  # standard errors that contain a normal value with 95 % probability
_DRAWS = 1999  # of the bootstrap


def answer(problem: Problem, choice: Choice) -> Answer:
    """Judge the chosen set of effects.

    Args:
        problem: The residual and the terms.
        choice: The chosen set and its rivals.

    Returns:
        The answer.
    """
    empty, best = choice.empty, choice.best
    difference = choice.difference
    without = difference.left(difference.exact.healthy)
    numbers = _numbers(problem, choice, empty)
    base_values = solution = numbers.values
    if best.groups and not problem.baseline:  # beside a baseline, both are the same
        solution = _numbers(problem, choice, best).values
    basic = build(problem, empty, base_values)
    healthy, given = gap(problem, basic.left), gap(problem, problem.residual)
    left = difference.left(choice.found.fitted, best.change)
    shown = left + best.change  # the residual that is to be explained, less calibration
    shares = where(problem, problem.whiten(shown))
    p_value = significance(problem, problem.whiten(without))
    effects, alternatives = _named(problem, choice, solution)
    doubts = gate(problem, choice, healthy[0])
    known, lines = bool(effects) and not doubts, []
    built, robot, lacks = build_stable(
        problem, *(best, solution) if known else (empty, base_values)
    )
    least = min(given[0], healthy[0])
    is_open = _beyond_noise(problem, least, _floor(problem, given, healthy))
    gaps = [given[0] if problem.baseline else least, *(one.gap_after for one in effects)]
    closing = [k for k in range(len(effects)) if gaps[k + 1] < gaps[k]]
    refuted = False
    if known and not (gap(problem, built.left)[0] < given[0] and len(closing) == len(effects)):
        why = "because the error on motions that were not fitted is not smaller with"
        if 0 < len(closing) < len(effects):
            told = answer(problem, only(choice, closing))
            verdict = PARTLY if told.verdict == NAMED else told.verdict
            others = _names([one for k, one in enumerate(effects) if k not in closing])
            return replace(
                told, verdict=verdict, lacks=(*told.lacks, f"{others}: not named, {why} it")
            )
        lines.append(f"{_names(effects)}: not named, {why} it")
        known, refuted = False, True
        built, robot, lacks = build_stable(problem, empty, base_values)
    before, after = given, gap(problem, built.left)
    floor = _floor(problem, given, healthy, after)
    of_noise = float(np.sqrt(np.mean(floor[scored(problem).any(axis=0)] ** 2)))
    if refuted and is_open:
        remedy = "more healthy recordings" if problem.baseline else "--healthy"
        doubts = [
            "more than noise is left, which no effect makes smaller on motions that were not "
            f"fitted: give {remedy}, or record more kinds of motion"
        ]
    if doubts:
        verdict = MODEL
    elif not known:
        verdict = UNKNOWN if choice.unknown else NONE
    elif choice.rivals or not choice.is_sure:  # what is listed in part must be certain
        verdict = AMBIGUOUS
    elif choice.unknown:
        verdict = PARTLY
    else:
        verdict = PARTLY if is_part(before[0], after[0], of_noise) else NAMED
    lines += [
        f"axis {axis}: a torque that no effect of the catalogue explains depends on the {over}"
        for axis, over in choice.unknown
    ]
    lines += [
        f"{effect} of axis {axis} is not named: motions that were not fitted speak against it "
        f"(logarithm of the ratio of probabilities {gained:.1f})"
        for effect, axis, gained in choice.refuted
        if effect != UNKNOWN_FORM
    ]
    lines += [
        f"{effect} of axis {axis} is not named: it would be certain if the model were exact, but "
        "the error on motions that were not fitted is larger than the model expects, or a "
        "simulation of the effect does not explain what its linear signature does"
        for effect, axis in choice.doubtful
    ]
    chosen = best if known else empty
    return Answer(
        verdict=verdict,
        effects=effects if known else (),
        alternatives=alternatives
        if known
        else tuple((one.effect, one.axis, one.confidence) for one in effects if not refuted),
        before=before[0],
        calibrated=healthy[0],
        after=after[0],
        floor=of_noise,
        per_axis=tuple(
            {"axis": k + 1, "before": a, "calibrated": b, "after": c, "floor": d}
            for k, (a, b, c, d) in enumerate(
                zip(before[1], healthy[1], after[1], floor.tolist(), strict=True)
            )
        ),
        p_value=p_value,
        where=tuple(shares),
        left=_strange(choice),
        changes=built.changes,
        robot=robot,
        lacks=(*lacks, *doubts, *lines, *numbers.lines),
        calibration=_told(problem, chosen, built.changes),
        usual=_usual_differences(problem, choice, base_values),
        left_torque=built.left,
        reasons=tuple(doubts),
        residual_variance=choice.variance,
        strange_torque=left if known else without,
    )


def _names(effects: Sequence[Named]) -> str:
    """Names and axes of effects."""
    return ", ".join(f"{one.effect} of axis {one.axis}" for one in effects)


def _strange(choice: Choice) -> tuple[tuple[int, str], ...]:
    """Axes and variables of torques of no known form beside the effects, the surest first."""
    difference = choice.difference
    fitted = choice.found.fitted
    forms = [form for one in difference.hypotheses if one.unknown for form in one.forms]
    places = [one.place for one in difference.hypotheses if one.unknown for _ in one.forms]
    odds = fitted.model.bayes_factors(fitted.log_scales, forms, fitted.effects)
    found: dict[int, str] = {}
    for k in np.argsort(-odds).tolist():
        if odds[k] >= SURE:
            found.setdefault(places[k], difference.over[forms[k][0]])
    return tuple(found.items())


def _numbers(problem: Problem, choice: Choice, fitted: Fit) -> Calibrated:
    """Calibrated numbers beside a set of effects. With a baseline, few differ: those that help."""
    if problem.baseline:
        return Calibrated(_helpful(problem, choice.best, usual(problem, choice)), ())
    scales = choice.found.fitted.log_scales
    return calibrated(problem, choice.difference, scales, fitted.change)


def _floor(problem: Problem, *errors: tuple[float, list[float]]) -> np.ndarray:
    """Gap that noise alone leaves on each axis, shape (n_axes,).

    Every error holds the noise, so that it is no larger than any of them.
    """
    noise = gap(problem, problem.noise.of_samples())
    return np.asarray(np.min([one[1] for one in (noise, *errors)], axis=0))


def _beyond_noise(problem: Problem, error: float, floor: np.ndarray) -> bool:
    """Whether an error is considerably larger than noise alone."""
    of_noise = float(np.mean(floor[scored(problem).any(axis=0)] ** 2))
    return error**2 - of_noise > CONSIDERABLE * of_noise


def _helpful(problem: Problem, best: Fit, values: np.ndarray) -> np.ndarray:
    """Numbers that make the error smaller beside the effects, shape (terms,); 0 for others.

    Differences of the day were fitted to other motions of the day. Those of a drive are judged by
    its axis, and those of masses by all axes.
    """
    pair = [gap(problem, build(problem, best, one).left) for one in (values, 0 * values)]
    (all_with, with_), (all_without, without) = pair
    helps = np.array([a <= b for a, b in zip(with_, without, strict=True)])
    own = np.minimum([term.axis for term in problem.terms], len(helps)).astype(int) - 1
    of_arm = np.array([term.name in (INERTIA, *MASSES) for term in problem.terms], bool)
    return np.where(np.where(of_arm, all_with <= all_without, helps[own]), values, 0.0)


def _of_terms(choice: Choice) -> dict[tuple, tuple[float, float]]:
    """Value and standard error of each number that is a term, by name, axis and parameters.

    Those of the friction of an axis include what all its friction differs by.
    """
    fitted, numbers = choice.found.fitted, choice.difference.numbers
    values, covariance = fitted.model.at(fitted.log_scales, fitted.effects)
    places = {numbers.which[k]: [place] for place, k in enumerate(numbers.known)}
    for which, own in places.items():
        if which and which[0] in PARTS_OF_FRICTION:
            own += places.get((ALL_FRICTION, *which[1:]), [])
    return {
        which: (float(values[own].sum()), float(np.sqrt(covariance[np.ix_(own, own)].sum())))
        for which, own in places.items()
        if which
    }


def usual(problem: Problem, choice: Choice) -> np.ndarray:
    """Compute by how much numbers differ between recording and baseline, beside the effects.

    Args:
        problem: The residual and the terms.
        choice: The chosen set.

    Returns:
        Value of every term in prior standard deviations, shape (terms,); 0 for effects.
    """
    value = {which: of for which, (of, _) in _of_terms(choice).items()}
    out = np.zeros(len(problem.terms))
    seen = set()
    for k, term in enumerate(problem.terms):
        which = (*term.key, term.parameters)
        if which in value and which not in seen:
            out[k] = value[which] / term.prior_std
            seen.add(which)
    return out


def significance(problem: Problem, white: np.ndarray) -> float:
    """Probability that noise alone gives the largest mean square of any motion and axis.

    The mean squares minus 1 are divided by their standard errors. They are compared with the same
    of random blocks of 0.1 s about their own mean, so that remaining correlation and heavy tails
    are taken into account. Source: block bootstrap (Kunsch 1989) of a studentized maximum (Romano
    and Wolf 2005).

    Args:
        problem: The recording.
        white: Whitened error, shape (samples, n_axes).

    Returns:
        The share of values that are as large, among `_DRAWS` random ones and the observed one.
    """
    length = max(5, round(0.1 / problem.recording.sample_period))
    rng = np.random.default_rng(0)
    seen, largest = -np.inf, np.full(_DRAWS, -np.inf)
    for part in problem.parts:
        for axis in range(white.shape[1]):
            rows = problem.inside[part, axis]
            if rows.sum() < 4 * length:
                continue
            squares = white[part, axis][rows] ** 2
            blocks = squares[: len(squares) // length * length].reshape(-1, length).mean(axis=1)
            # one block that is far off must not hide itself in the error
            error = min(float(blocks.std()), 3 * np.sqrt(2 / length)) + 1e-12
            seen = max(seen, (blocks.mean() - 1) / error * np.sqrt(len(blocks)))
            drawn = blocks[rng.integers(len(blocks), size=(_DRAWS, len(blocks)))]
            spread = drawn.std(axis=1) + 1e-12
            t = (drawn.mean(axis=1) - blocks.mean()) / spread * np.sqrt(len(blocks))
            largest = np.maximum(largest, t)
    if not np.isfinite(seen):
        return 1.0
    return float((1 + np.sum(largest >= seen)) / (_DRAWS + 1))


def is_part(before: float, after: float, floor: float) -> bool:
    """Tell whether effects explain only a part of what can be explained.

    Args:
        before: Gap of the unchanged model, without unit.
        after: Gap with the effects.
        floor: Gap of noise alone.

    Returns:
        Whether less than `NAMED_SHARE` of before² − floor² is explained, and the rest is
        considerable beside the noise.
    """
    open_ = after**2 - floor**2
    return open_ > (1 - NAMED_SHARE) * (before**2 - floor**2) and open_ > CONSIDERABLE * floor**2


def _named(
    problem: Problem, choice: Choice, solution: np.ndarray
) -> tuple[tuple[Named, ...], tuple[tuple[str, int, float], ...]]:
    """Effects of the answer, and their alternatives with probabilities."""
    best = choice.best
    effects, others = [], []
    for place, (group, value, covariance) in enumerate(best.members()):
        there = 1 / (1 + float(np.exp(-choice.odds[place])))
        others += [
            (*problem.terms[rival[0]].key, there * share)
            for at, rival, share in choice.rivals
            if at == place
        ]
        left = build(problem, first_of(problem, best, place + 1), solution).left
        severity, error = _severity(problem, group, value, covariance)
        effect = get_effect(problem.terms[group[0]].name)
        parameters = _parameters(problem, best, place)
        least = 0.0 if len(group) > 1 else effect.smallest
        most = effect.largest_with(dict(problem.terms[group[0]].parameters))
        effects.append(
            Named(
                *problem.terms[group[0]].key,
                severity,
                error,
                (max(severity - _WIDE * error, least), min(severity + _WIDE * error, most)),
                parameters,
                there * choice.shares[place],
                gap(problem, left)[0],
            )
        )
    own = {(one.effect, one.axis) for one in effects}
    return tuple(effects), tuple(one for one in others if (one[0], one[1]) not in own)


def _severity(
    problem: Problem, group: tuple[int, ...], value: np.ndarray, covariance: np.ndarray
) -> tuple[float, float]:
    """Severity of an effect, a sum of its values times weights, and its standard error."""
    size = float(np.linalg.norm(value))
    weight = np.ones(len(group))
    if len(group) > 1 and problem.terms[group[0]].name != PAYLOAD:  # sine and cosine
        weight = value / max(size, 1e-300)
    return float(weight @ value), float(np.sqrt(weight @ covariance @ weight))


def _parameters(problem: Problem, best: Fit, place: int) -> dict[str, float]:
    """Further parameters of an effect."""
    group, values, _ = list(best.members())[place]
    term = problem.terms[group[0]]
    parameters = dict(term.parameters)
    if term.name == PAYLOAD and len(group) > 1:
        places = np.array([[x for _, x in problem.terms[t].parameters] for t in group])
        _, centre = payload_of(values, places)
        parameters = dict(zip("xyz", centre.tolist(), strict=True))
    elif len(group) == 2:  # sine and cosine
        parameters["phase"] = float(np.arctan2(values[1], values[0]))
    return parameters


def _told(
    problem: Problem, fitted: Fit, changes: list[tuple[Term, float]]
) -> dict[str, dict[str, float]]:
    """Calibrated numbers that differ from the model by more than half their prior_std."""
    named = {problem.terms[t].key for t in fitted.terms}
    told: dict[str, dict[str, float]] = {}
    for term, value in changes:
        if not term.is_effect or term.parameters or term.key in named:
            continue
        if abs(value) > 0.5 * term.prior_std:
            told.setdefault(term.name, {})[str(term.axis)] = value
    return told


def _usual_differences(
    problem: Problem, choice: Choice, values: np.ndarray
) -> tuple[tuple[str, int, float, float], ...]:
    """Numbers that differ from the model, or the baseline, by more than their errors.

    The clearest comes first. They could be effects, but for what a healthy robot may differ by.
    """
    error = {which: of for which, (_, of) in _of_terms(choice).items()}
    named = {problem.terms[t].key for t in choice.best.terms}
    told = []
    for term, value in zip(problem.terms, values.tolist(), strict=True):
        size = float(value * term.prior_std)
        its = error.get((*term.key, term.parameters), np.inf)
        is_plain = term.is_effect and not term.parameters and term.key not in named
        if is_plain and abs(size) > USUAL_SHOWN * its:
            told.append((term.name, term.axis, size, its))
    return tuple(sorted(told, key=lambda one: -abs(one[2]) / one[3]))

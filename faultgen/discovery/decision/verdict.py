"""The verdict on a residual: nothing missing, effects named or partly named, ambiguous, unknown."""

from __future__ import annotations

import numpy as np

from faultgen.discovery.calibration.model_edit import build, build_stable, simulated_numbers
from faultgen.discovery.calibration.refuted import without_refuted
from faultgen.discovery.decision.certainty import certainty
from faultgen.discovery.decision.confirmation import confirmed, shared_kinds
from faultgen.discovery.decision.selection import Choice
from faultgen.discovery.fit.diagnostics import where
from faultgen.discovery.fit.fit import Fit, first_of
from faultgen.discovery.fit.gap import gap, scored, unexplained
from faultgen.discovery.fit.regression import Problem
from faultgen.discovery.laws.patterns import Pattern, patterns
from faultgen.discovery.laws.spikes import spikes
from faultgen.discovery.result import (
    AMBIGUOUS,
    CONSIDERABLE,
    EXPLAINED,
    NAMED,
    NONE,
    PART,
    PARTLY,
    UNKNOWN,
    UNLIKELY,
    Answer,
    Named,
)
from faultgen.discovery.terms.candidates import PAYLOAD, Term, payload_of

BAND = {
    "time": 0.004,
    "joint angle": 0.0036,
    "motor turn": 0.0025,
    "speed": 0.0026,
    "acceleration": 0.0026,
}
"""Largest RMS of a pattern, divided by the RMS torque of its axis, that is normal for a calibrated
model without a baseline: 1.35 times the largest of healthy development cases."""

WORSE = 1.05
"""Gap with effects, over that without them, from which they are not what has changed: assumed.
Motions on which they are borne out sample by sample may also hold rest and slow motion."""

_DRAWS = 1999  # of the bootstrap


def answer(problem: Problem, choice: Choice) -> Answer:
    """Judge the chosen set of effects.

    Args:
        problem: The residual and the terms.
        choice: The chosen set and its rivals.

    Returns:
        The answer.
    """
    empty = choice.fits[0]
    without, _ = unexplained(problem, empty)
    base_values = simulated_numbers(problem, empty)
    basic = build(problem, empty, base_values)
    calibrated, given = gap(problem, basic.left), gap(problem, problem.residual)
    refuted: list[str] = []
    if not problem.baseline:
        basic, base_values, refuted = without_refuted(problem, empty, basic, base_values)
        calibrated = gap(problem, basic.left)
    kept = confirmed(problem, choice, basic.left, base_values)
    choice, best = kept.choice, kept.choice.best
    left, _ = unexplained(problem, best)
    white = problem.whiten(left)
    own = [(problem.terms[t].axis, problem.white[t]) for t in best.terms]
    found = patterns(problem, white, problem.fitting, own) + spikes(problem, white)
    found.sort(key=lambda one: (one.p_value, -one.strength))
    shown = left + best.change  # the residual that is to be explained, less calibration
    white_shown = problem.whiten(shown)
    shares = where(problem, white_shown)
    p_value = significance(problem, problem.whiten(without))
    noise = problem.noise.of_samples()
    strange = strange_patterns(problem, found, white)
    contrived = bool(shared_kinds(problem, best))
    known = bool(best.groups) and not contrived
    effects, alternatives = _named(problem, choice, kept.solution)
    chosen = (best, kept.solution) if known else (empty, base_values)
    built, robot, lacks = build_stable(problem, *chosen)
    worse = known and gap(problem, built.left)[0] > WORSE * max(given[0], calibrated[0])
    if worse:
        known, chosen = False, (empty, base_values)
        built, robot, lacks = build_stable(problem, *chosen)
        lacks.append(
            "the effects that explain most of what differs are not named, because they make the "
            "error on other motions larger: something else has changed, which resembles them"
        )
    lacks += refuted
    lacks += [
        f"axis {one.axis}: {one.name} explains most of what differs on the motions for fitting, "
        "but not on the others: something else has changed, which resembles it"
        for one in dict.fromkeys(kept.resembled)
    ]
    before, after = given, gap(problem, built.left)
    # an error holds the noise, so that the noise of an axis is no larger than any of its errors
    floor = np.min([gap(problem, noise)[1], before[1], calibrated[1], after[1]], axis=0)
    of_noise = float(np.sqrt(np.mean(floor[scored(problem).any(axis=0)] ** 2)))
    if not known:
        verdict = UNKNOWN if contrived or worse or strange or kept.resembled else NONE
    elif choice.rivals:  # what is listed in part must be certain
        verdict = AMBIGUOUS
    else:
        verdict = PARTLY if is_part(before[0], after[0], of_noise) else NAMED
    return Answer(
        verdict=verdict,
        effects=effects if known else (),
        alternatives=alternatives
        if known
        else tuple((one.effect, one.axis, one.confidence) for one in effects),
        before=before[0],
        calibrated=calibrated[0],
        after=after[0],
        floor=of_noise,
        per_axis=tuple(
            {"axis": k + 1, "before": a, "calibrated": b, "after": c, "floor": d}
            for k, (a, b, c, d) in enumerate(
                zip(before[1], calibrated[1], after[1], floor.tolist(), strict=True)
            )
        ),
        p_value=p_value,
        where=tuple(shares),
        left=tuple(found),
        changes=built.changes,
        robot=robot,
        lacks=tuple(lacks),
        calibration=_told(problem, chosen[0], built.changes),
        left_torque=built.left,
        strange_torque=built.left if problem.baseline else (left if known else without),
    )


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
        Whether less than `EXPLAINED` of before² − floor² is explained, and the rest is considerable
        beside the noise.
    """
    open_ = after**2 - floor**2
    return open_ > (1 - EXPLAINED) * (before**2 - floor**2) and open_ > CONSIDERABLE * floor**2


def strange_patterns(problem: Problem, found: list[Pattern], white: np.ndarray) -> list[Pattern]:
    """Select the patterns that neither noise nor the usual errors of models explain.

    Args:
        problem: The recording and the model.
        found: All patterns.
        white: Whitened error in which they were found, shape (samples, n_axes).

    Returns:
        The selected patterns, strongest first.
    """
    strange = [one for one in found if one.p_value < UNLIKELY and _is_large(problem, one, white)]
    return sorted(strange, key=lambda one: -one.strength)


def _is_large(problem: Problem, pattern: Pattern, white: np.ndarray) -> bool:
    """Whether a pattern is larger than the usual errors of models, or differences between runs."""
    axis = pattern.axis - 1
    if problem.baseline:
        rows = problem.inside[:, axis] & problem.samples(problem.fitting)
        beyond = float(np.sum(white[rows, axis] ** 2 - 1))  # noise is not known to within a little
        return beyond < CONSIDERABLE * rows.sum() or pattern.strength > PART * beyond
    rows = problem.inside[:, axis]
    torque = float(np.sqrt(np.mean(problem.recording.torque[rows, axis] ** 2)))
    size = np.sqrt(max(pattern.strength, 0.0) / rows.sum()) * problem.noise.deviation[axis]
    return bool(size > BAND[pattern.along] * torque)


def _named(
    problem: Problem, choice: Choice, solution: np.ndarray
) -> tuple[tuple[Named, ...], tuple[tuple[str, int, float], ...]]:
    best = choice.best
    effects, others = [], []
    for place, group in enumerate(best.groups):
        known = certainty(choice.problem, best, place)
        rivals = [(g, worse) for where, g, worse in choice.rivals if where == place]
        odds = np.exp([-max(worse, 0.0) / 2 for _, worse in rivals])
        total = 1 + float(odds.sum()) + float(np.exp(-known.absent / 2))
        others += [
            (*problem.terms[g[0]].key, float(odd) / total)
            for (g, _), odd in zip(rivals, odds, strict=True)
        ]
        left = build(problem, first_of(problem, best, place + 1), solution).left
        effects.append(
            Named(
                *problem.terms[group[0]].key,
                known.severity,
                known.error,
                (known.low, known.high),
                _parameters(problem, best, place),
                1 / total,
                gap(problem, left)[0],
            )
        )
    own = {(one.effect, one.axis) for one in effects}
    return tuple(effects), tuple(one for one in others if (one[0], one[1]) not in own)


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
    if problem.baseline:
        return told
    for term, value in changes:
        if not term.is_effect or term.parameters or term.key in named:
            continue
        if abs(value) > 0.5 * term.prior_std:
            told.setdefault(term.name, {})[str(term.axis)] = value
    return told

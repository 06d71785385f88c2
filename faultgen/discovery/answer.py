"""What is said of a gap: nothing missing, named, ambiguous, or unknown."""

from __future__ import annotations

import numpy as np

from faultgen.discovery.choose import Choice
from faultgen.discovery.fit import Fit, Group, changes_of
from faultgen.discovery.problem import Problem
from faultgen.discovery.regimes import Pattern, patterns, where
from faultgen.discovery.replay import relative_error, relative_errors
from faultgen.discovery.result import AMBIGUOUS, NAMED, NONE, UNKNOWN, UNLIKELY, Answer, Named
from faultgen.discovery.terms import FRICTION, INERTIA, PAYLOAD, PERIODIC, Term, payload_of
from faultgen.effects import get_effect

LEFT = 0.05
"""Share of a gap with a pattern from which effects do not explain it: chosen on development
cases."""

OPEN, OPEN_NOISE = 0.1, 1.5
"""Share of an axis' squared gap to its twin, and RMS over that of the noise, beyond which a gap is
left open by what explains it: assumed."""

BAND = {
    "time": 0.004,
    "joint angle": 0.0036,
    "motor turn": 0.0025,
    "speed": 0.0026,
    "acceleration": 0.0026,
    "motion": np.inf,
}
"""RMS of a pattern over RMS torque of its axis up to which a calibrated model without twin is as
good as models are: 1.35 times the largest of healthy development cases."""

_DRAWS = 1999  # of the bootstrap


def answer(problem: Problem, choice: Choice) -> Answer:
    """Weigh what was chosen.

    Args:
        problem: The gap and the terms.
        choice: The sets that were chosen among.
    """
    empty, best = choice.fits[0], choice.best
    calibrated, base_values = _left(problem, empty)
    left, values = _left(problem, best)
    white = problem.whiten(left)
    own = [(problem.terms[t].axis, problem.white[t]) for t in best.terms]
    found = patterns(problem, white, problem.fitting, own)
    shown = left + best.change  # the gap that is to be explained, less calibration
    white_shown = problem.whiten(shown)
    shares = where(problem, white_shown)
    p_value = significance(problem, problem.whiten(calibrated))
    scores = [_score(problem, x) for x in (problem.gap, calibrated, left)]
    floor = _score(problem, np.broadcast_to(problem.noise.deviation, problem.gap.shape))
    is_open = problem.twin and _is_open(scores[0][1], scores[2][1], floor[1])
    verdict = _verdict(problem, choice, found, white_shown, is_open)
    known = verdict in (NAMED, AMBIGUOUS)
    effects, alternatives = _named(problem, choice)
    changes = _calibration(problem, best if known else empty, values if known else base_values)
    after = scores[2] if known else scores[1]
    return Answer(
        verdict=verdict,
        effects=effects if known else (),
        alternatives=alternatives
        if known
        else tuple((one.effect, one.axis, one.confidence) for one in effects),
        before=scores[0][0],
        calibrated=scores[1][0],
        after=after[0],
        floor=floor[0],
        per_axis=tuple(
            {"axis": k + 1, "before": a, "calibrated": b, "after": c, "floor": d}
            for k, (a, b, c, d) in enumerate(
                zip(scores[0][1], scores[1][1], after[1], floor[1], strict=True)
            )
        ),
        p_value=p_value,
        where=tuple(shares),
        left=tuple(found),
        changes=changes,
        calibration=_told(problem, empty if not known else best, changes),
        calibrated_torque=shown,
        left_torque=left if known else calibrated,
    )


def _left(problem: Problem, fitted: Fit) -> tuple[np.ndarray, np.ndarray]:
    """Torque that a set and the calibration leave, and values of all terms in tolerances."""
    free = fitted.terms
    solution, _, _ = fitted.evidence.solve(free)
    solution = solution.copy()
    solution[free] = 0.0  # at the fit already
    scale = np.array([term.tolerance for term in problem.terms])
    explained = np.tensordot((solution * scale).astype(np.float32), problem.raw, axes=1)
    return problem.gap - fitted.change - explained, solution


def _score(problem: Problem, error: np.ndarray) -> tuple[float, list[float]]:
    """Relative error on the scoring motions: all axes, and each."""
    inside = problem.inside & problem.samples(problem.scoring)[:, None]
    recording = problem.recording
    by_axis = relative_errors(error**2, recording, inside)
    return relative_error(error**2, recording, inside), by_axis.tolist()


def significance(problem: Problem, white: np.ndarray) -> float:
    """Probability by noise of the largest mean square of any motion and axis.

    Mean squares less 1, over their standard errors, are held against the same of blocks of 0.1 s
    drawn again about their own mean, so that correlation and tails that are left count. Source:
    block bootstrap (Kunsch 1989) of a studentized maximum (Romano and Wolf 2005).

    Args:
        problem: The recording.
        white: Whitened error, shape (samples, n_axes).

    Returns:
        The share of draws that are as large, of `_DRAWS` and the one seen.
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


def _verdict(
    problem: Problem,
    choice: Choice,
    found: list[Pattern],
    white: np.ndarray,
    is_open: bool,
) -> str:
    strange = strange_patterns(problem, found)
    if not choice.best.groups:
        return UNKNOWN if strange else NONE
    if is_open or _contrived(problem, choice.best):
        return UNKNOWN
    gap = max(float((white[problem.inside] ** 2).sum()) - problem.inside.sum(), 1.0)
    if strange and strange[0].strength > LEFT * gap:
        return UNKNOWN
    return AMBIGUOUS if choice.rivals else NAMED


def _is_open(before: list[float], after: list[float], floor: list[float]) -> bool:
    """Whether the gap of an axis is left open on motions that nothing was fitted to."""
    was, left, noise = (np.square(x) for x in (before, after, floor))
    return bool(np.any((left > OPEN_NOISE**2 * noise) & (left - noise > OPEN * (was - noise))))


def _contrived(problem: Problem, best: Fit) -> bool:
    """Whether one axis has several kinds of friction by speed, or several periodic effects.

    Together they make a curve, or a wave, that no single effect of the catalogue has.
    """
    kinds = []
    for group in best.groups:
        term = problem.terms[group[0]]
        if term.name in FRICTION:
            kinds.append(("friction", term.axis))
        elif term.parameters and term.name in PERIODIC:
            kinds.append(("periodic", term.axis))
    return len(set(kinds)) < len(kinds)


def strange_patterns(problem: Problem, found: list[Pattern]) -> list[Pattern]:
    """Patterns that neither noise nor what models are usually wrong by explains, largest first."""
    strange = [one for one in found if one.p_value < UNLIKELY and _is_large(problem, one)]
    return sorted(strange, key=lambda one: -one.strength)


def _is_large(problem: Problem, pattern: Pattern) -> bool:
    """Whether a pattern is larger than what a model may be wrong by."""
    if problem.twin:
        return True
    axis = pattern.axis - 1
    rows = problem.inside[:, axis]
    torque = float(np.sqrt(np.mean(problem.recording.torque[rows, axis] ** 2)))
    size = np.sqrt(max(pattern.strength, 0.0) / rows.sum()) * problem.noise.deviation[axis]
    return bool(size > BAND[pattern.along] * torque)


def _named(
    problem: Problem, choice: Choice
) -> tuple[tuple[Named, ...], tuple[tuple[str, int, float], ...]]:
    best = choice.best
    effects, others = [], []
    steps = {len(one.groups): one for one in choice.fits}
    for place, (group, values, errors) in enumerate(best.members()):
        rivals = [(g, worse) for where, g, worse in choice.rivals if where == place]
        odds = np.exp([-max(worse, 0.0) / 2 for _, worse in rivals])
        total = 1 + float(odds.sum())
        others += [
            (*problem.terms[g[0]].key, float(odd) / total)
            for (g, _), odd in zip(rivals, odds, strict=True)
        ]
        until = steps.get(place + 1, best)
        effects.append(
            _one(
                problem,
                group,
                values,
                errors,
                1 / total,
                _score(problem, _left(problem, until)[0])[0],
            )
        )
    own = {(one.effect, one.axis) for one in effects}
    return tuple(effects), tuple(one for one in others if (one[0], one[1]) not in own)


def _one(
    problem: Problem,
    group: Group,
    values: np.ndarray,
    errors: np.ndarray,
    confidence: float,
    after: float,
) -> Named:
    term = problem.terms[group[0]]
    parameters = dict(term.parameters)
    severity, error = float(values[0]), float(errors[0])
    if term.name == PAYLOAD and len(group) > 1:
        places = np.array([[x for _, x in problem.terms[t].parameters] for t in group])
        severity, place = payload_of(values, places)
        error = float(np.linalg.norm(errors))  # of masses that offset one another: too large
        parameters = dict(zip("xyz", place.tolist(), strict=True))
    elif len(group) == 2:  # sine and cosine
        severity = float(np.hypot(*values))
        error = float(np.hypot(*(values * errors)) / max(severity, 1e-300))
        parameters["phase"] = float(np.arctan2(values[1], values[0]))
    return Named(term.name, term.axis, severity, error, parameters, confidence, after)


def _calibration(problem: Problem, fitted: Fit, solution: np.ndarray) -> list[tuple[Term, float]]:
    """All that is changed in the model."""
    effects = changes_of(problem, fitted)
    if problem.twin:
        return effects
    numbers = [
        (term, float(value * term.tolerance))
        for term, value in zip(problem.terms, solution, strict=True)
        if abs(value) > 1e-3
    ]
    return effects + [(term, value) for term, value in numbers if _possible(term, value)]


def _possible(term: Term, value: float) -> bool:
    """Whether a model is given it: no waves that nobody named, no play below none."""
    if not term.is_effect:
        return term.name == INERTIA
    return term.name not in PERIODIC and value > get_effect(term.name).smallest


def _told(
    problem: Problem, fitted: Fit, changes: list[tuple[Term, float]]
) -> dict[str, dict[str, float]]:
    """Calibrated numbers that are off by more than half their tolerance."""
    named = {problem.terms[t].key for t in fitted.terms}
    told: dict[str, dict[str, float]] = {}
    if problem.twin:
        return told
    for term, value in changes:
        if not term.is_effect or term.parameters or term.key in named:
            continue
        if abs(value) > 0.5 * term.tolerance:
            told.setdefault(term.name, {})[str(term.axis)] = value
    return told

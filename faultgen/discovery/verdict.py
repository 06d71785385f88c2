"""The verdict on a residual: nothing missing, effects named or partly named, ambiguous, unknown."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from faultgen.discovery.candidates import PAYLOAD, Term, payload_of
from faultgen.discovery.certainty import certainty
from faultgen.discovery.diagnostics import where
from faultgen.discovery.fit import Fit, Group, first_of, fit
from faultgen.discovery.model_edit import build, build_stable
from faultgen.discovery.patterns import Pattern, patterns
from faultgen.discovery.regression import Problem
from faultgen.discovery.replay import relative_error, relative_errors
from faultgen.discovery.result import (
    AMBIGUOUS,
    EXPLAINED,
    NAMED,
    NONE,
    PARTLY,
    UNKNOWN,
    UNLIKELY,
    Answer,
    Named,
)
from faultgen.discovery.selection import Choice, needed
from faultgen.effects import get_effect

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

CONSIDERABLE = 0.25
"""Squared error beyond that of noise, over that of noise, from which a gap counts as open:
assumed."""

BAND = {
    "time": 0.004,
    "joint angle": 0.0036,
    "motor turn": 0.0025,
    "speed": 0.0026,
    "acceleration": 0.0026,
}
"""Largest RMS of a pattern, divided by the RMS torque of its axis, that is normal for a calibrated
model without a twin: 1.35 times the largest of healthy development cases."""

_DRAWS = 1999  # of the bootstrap


def answer(problem: Problem, choice: Choice) -> Answer:
    """Judge the chosen set of effects.

    Args:
        problem: The residual and the terms.
        choice: The chosen set and its rivals.

    Returns:
        The answer.
    """
    choice = confirmed(problem, choice)
    empty, best = choice.fits[0], choice.best
    without, base_values = _left(problem, empty)
    left, values = _left(problem, best)
    white = problem.whiten(left)
    own = [(problem.terms[t].axis, problem.white[t]) for t in best.terms]
    found = patterns(problem, white, problem.fitting, own)
    shown = left + best.change  # the residual that is to be explained, less calibration
    white_shown = problem.whiten(shown)
    shares = where(problem, white_shown)
    p_value = significance(problem, problem.whiten(without))
    noise = problem.noise.of_samples()
    strange = strange_patterns(problem, found)
    known = bool(best.groups) and not _contrived(problem, best)
    effects, alternatives = _named(problem, choice)
    basic = build(problem, empty, base_values)
    chosen = (best, values) if known else (empty, base_values)
    built, robot, lacks = build_stable(problem, *chosen)
    before, calibrated, after = (
        _score(problem, x) for x in (problem.residual, basic.left, built.left)
    )
    # an error holds the noise, so that the noise of an axis is no larger than any of its errors
    floor = np.min([_score(problem, noise)[1], before[1], calibrated[1], after[1]], axis=0)
    of_noise = float(np.sqrt(np.mean(floor[_scored(problem).any(axis=0)] ** 2)))
    if not known:
        verdict = UNKNOWN if strange else NONE
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
    )


def confirmed(problem: Problem, choice: Choice) -> Choice:
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
        elif _gain(problem, choice.fits[0], best) < REFUTED:
            best = min(trials, key=lambda one: one.gain).rest
        else:
            break
    best = _buildable(problem, choice, best)
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
        scored = _scored(problem)
        errors = [problem.whiten(_left(problem, one)[0]) * scored for one in (rest, best)]
        foretold = float(np.sum((errors[0] - errors[1]) ** 2))
        seen = float(np.sum(errors[0] ** 2 - errors[1] ** 2))
        over = max(1.0, float(np.sum(errors[1] ** 2) / max(scored.sum(), 1)))
        # if the effect is real, the decrease is normal about what it foretells; where there is a
        # twin, the law of the effect decides how much, and real laws differ from the catalogue's
        missed = (foretold - seen) / (2 * np.sqrt(max(foretold * over, 1e-300)))
        missed = 0.0 if problem.twin else missed
        share = (rest.misfit - best.misfit) / (over * least)
        return cls(rest, _gain(problem, rest, best, axis), missed, seen, share)


def _buildable(problem: Problem, choice: Choice, best: Fit) -> Fit:
    """The largest part of a set with which the simulated model is not clearly worse.

    The fit may foretell large effects and large numbers of the model that cancel each other, which
    they do not if they are simulated.
    """
    if not best.groups:
        return best
    limit = _simulated_gap(problem, choice.fits[0])
    larger, larger_own = _tolerated(problem)
    while best.groups:
        whole, by_axis = _simulated_gap(problem, best)
        axes = {problem.terms[group[0]].axis for group in best.groups}
        own = [
            by_axis[k - 1] > larger_own * limit[1][k - 1] for k in axes if 1 <= k <= len(by_axis)
        ]
        if whole <= larger * limit[0] and not any(own):
            return best
        rests = [rest for _, rest in _without_one(choice.problem, best)]
        if not rests:
            break
        best = min(rests, key=lambda rest: _simulated_gap(problem, rest)[0])
    return choice.fits[0]


def _simulated_gap(problem: Problem, fitted: Fit) -> tuple[float, list[float]]:
    """Gap on the scoring motions, simulated with a set and the calibrated numbers."""
    return _score(problem, build(problem, fitted, _left(problem, fitted)[1]).left)


def _tolerated(problem: Problem) -> tuple[float, float]:
    """Gap of all axes, and of the effect's own axis, from which an effect counts as refuted."""
    return (LARGER_TWIN, LARGER_OWN_TWIN) if problem.twin else (LARGER, LARGER_OWN)


def _gain(problem: Problem, without: Fit, fitted: Fit, axis: int | None = None) -> float:
    """Whitened squared error on the scoring motions that an effect takes away, over its error.

    It is very negative if the gap, which is not whitened, becomes clearly larger: that of all axes,
    or that of the effect's own axis.
    """
    scored = _scored(problem)
    errors = [_left(problem, one)[0] for one in (without, fitted)]
    (before, own_before), (after, own_after) = (_score(problem, error) for error in errors)
    larger, larger_own = _tolerated(problem)
    if after > larger * before:
        return -after / before - 100.0
    if axis is not None and 1 <= axis <= len(own_after):
        was, now = own_before[axis - 1], own_after[axis - 1]
        if now > larger_own * was:
            return -now / was - 50.0
    gain = np.subtract(*(problem.whiten(error) ** 2 * scored for error in errors)).sum(axis=1)
    length = max(5, round(0.1 / problem.recording.sample_period))
    blocks = gain[: len(gain) // length * length].reshape(-1, length).sum(axis=1)
    return float(gain.sum() / max(np.sqrt(np.sum(blocks**2)), 1e-300))


def _left(problem: Problem, fitted: Fit) -> tuple[np.ndarray, np.ndarray]:
    """Torque that a set and the calibration do not explain, and all values in their prior_std."""
    free = fitted.terms
    solution, _, _ = fitted.evidence.solve(free)
    solution = solution.copy()
    solution[free] = 0.0  # at the fit already
    scale = np.array([term.prior_std for term in problem.terms])
    explained = np.tensordot((solution * scale).astype(np.float32), problem.raw, axes=1)
    return problem.residual - fitted.change - explained, solution


def _scored(problem: Problem) -> np.ndarray:
    """Samples of the scoring motions that are used, as a mask of shape (samples, n_axes)."""
    return problem.inside & problem.samples(problem.scoring)[:, None]


def _score(problem: Problem, error: np.ndarray) -> tuple[float, list[float]]:
    """Relative error on the scoring motions: of all axes, and of each axis."""
    inside, recording = _scored(problem), problem.recording
    by_axis = relative_errors(error**2, recording, inside)
    return relative_error(error**2, recording, inside), by_axis.tolist()


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


def _contrived(problem: Problem, best: Fit) -> bool:
    """Whether one axis has several kinds of speed-dependent friction, or several periodic effects.

    Together they make a curve, or a wave, that no single effect of the catalogue has.
    """
    kinds = []
    for group in best.groups:
        term = problem.terms[group[0]]
        prior = get_effect(term.name).prior
        if prior.group:
            kinds.append((prior.group, term.axis))
        elif prior.use == "periodic":
            kinds.append((prior.use, term.axis))
    return len(set(kinds)) < len(kinds)


def strange_patterns(problem: Problem, found: list[Pattern]) -> list[Pattern]:
    """Select the patterns that neither noise nor the usual errors of models explain.

    Args:
        problem: The recording and the model.
        found: All patterns.

    Returns:
        The selected patterns, strongest first.
    """
    strange = [one for one in found if one.p_value < UNLIKELY and _is_large(problem, one)]
    return sorted(strange, key=lambda one: -one.strength)


def _is_large(problem: Problem, pattern: Pattern) -> bool:
    """Whether a pattern is larger than the usual errors of models."""
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
    solution = _left(problem, best)[1]
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
                _score(problem, left)[0],
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
    if problem.twin:
        return told
    for term, value in changes:
        if not term.is_effect or term.parameters or term.key in named:
            continue
        if abs(value) > 0.5 * term.prior_std:
            told.setdefault(term.name, {})[str(term.axis)] = value
    return told

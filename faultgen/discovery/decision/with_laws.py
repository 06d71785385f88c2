"""An answer completed by learned laws, where effects of the catalogue explain too little."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from faultgen.discovery.decision.choice import Choice, only
from faultgen.discovery.decision.verdict import answer, is_part
from faultgen.discovery.fit.gap import gap
from faultgen.discovery.fit.problem import Problem
from faultgen.discovery.laws.law_curves import Courses, Curve
from faultgen.discovery.laws.law_words import NAMES
from faultgen.discovery.laws.learned_law import Learned, learn
from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.replay.torque_error import relative_error, relative_errors
from faultgen.discovery.result import MODEL, NAMED, NONE, PARTLY, UNKNOWN, Answer
from faultgen.errors import InputError, SimulationFailed
from faultgen.inference.limits import LAW_ALIKE, LAW_ALONE, LAW_CERTAIN

LEARNED = "learned"
"""Name of a learned law among the effects of ``discovery.json``."""

UNIT = "N m, RMS on the recording"
"""Unit of its severity."""

_BEYOND = 0.02  # share of the range of a variable by which other motions may leave it


def with_laws(problem: Problem, choice: Choice, told: Answer) -> tuple[Answer, list[Learned]]:
    """Learn laws for what an answer leaves unexplained, and put them into its model.

    Where nothing is missing, nothing is learned. If the model is not good enough for the difference
    to a baseline, a law that is certain makes it an unknown effect. Effects that were named on the
    axis of a law that is certain are left out if the law alone comes as near to the scoring
    motions: then they only imitated it.

    Args:
        problem: The recording and the model.
        choice: The set of effects from which the answer was made.
        told: The answer.

    Returns:
        The answer with the laws in its model and its gaps, and the laws. If nothing can be learned,
        the answer is unchanged.
    """
    if told.verdict == NONE or (told.verdict == MODEL and not problem.baseline):
        return told, []  # what is left is usual, or the model's error
    laws = learn(problem, told.strange_torque, told.changes)
    if told.verdict == MODEL:  # of the difference to a baseline, only a certain law says more
        laws = [one for one in laws if one.confidence >= LAW_CERTAIN]
        whole, laws = if_smaller(problem, told, _with(problem, told, laws), laws)
        return (replace(whole, verdict=UNKNOWN, reasons=()), laws) if laws else (told, [])
    if told.verdict == UNKNOWN:
        return if_smaller(problem, told, _with(problem, told, laws), laws)
    # beside a part that is known, less certain laws are told as well
    least = 0.0 if told.verdict == PARTLY else LAW_CERTAIN
    axes = {one.axis for one in laws if one.confidence >= least}
    if not axes:
        return told, []
    whole = _with(problem, told, laws)
    groups = choice.best.groups
    kept = [k for k, group in enumerate(groups) if problem.terms[group[0]].axis not in axes]
    if len(kept) < len(groups):
        other = answer(problem, only(choice, kept))
        own = learn(problem, other.strange_torque, other.changes)
        simpler = _with(problem, other, own)
        left_out = {problem.terms[g[0]].key for k, g in enumerate(groups) if k not in kept}
        alike = {one[:2] for law in own for one in law.resembles if one[2] >= LAW_ALIKE}
        if own and simpler.after <= LAW_ALONE * whole.after and not left_out & alike:
            return replace(simpler, verdict=PARTLY if simpler.effects else UNKNOWN), own
    if told.verdict == PARTLY:
        return if_smaller(problem, told, whole, laws)
    if is_part(told.before, told.after, whole.floor):
        return replace(whole, verdict=PARTLY if told.verdict == NAMED else told.verdict), laws
    return told, []


def if_smaller(
    problem: Problem, told: Answer, whole: Answer, laws: list[Learned]
) -> tuple[Answer, list[Learned]]:
    """Return the answer with laws, or without them if they do not make the gap smaller.

    Args:
        problem: The recording and the model.
        told: The answer without the laws.
        whole: The answer with them.
        laws: The laws.
    """
    before, _ = gap(problem, told.left_torque)
    return (whole, laws) if laws and whole.after < before else (told, [])


def _with(problem: Problem, told: Answer, laws: Sequence[Learned]) -> Answer:
    """The answer with laws in its model and its gaps."""
    if not laws:
        return told
    left = told.left_torque - laws[-1].change
    use = problem.inside & problem.samples(problem.scoring)[:, None]
    after = relative_errors(left**2, problem.recording, use).tolist()
    per_axis = tuple(
        {**one, "after": value, "floor": min(one["floor"], value)}
        for one, value in zip(told.per_axis, after, strict=True)
    )
    seen = np.any(use & (problem.recording.torque != 0), axis=0)
    floors = np.array([one["floor"] for one in per_axis])[seen]
    robot, lacks = told.robot.with_effects([one.applied for one in laws]), told.lacks
    try:
        stable = np.isfinite(problem.given.on(robot).torque()).all()
    except (InputError, SimulationFailed):
        stable = False
    if not stable:
        robot = told.robot
        lacks = (*lacks, "the model lacks the learned laws: with them its simulation diverges")
    return replace(
        told,
        after=relative_error(left**2, problem.recording, use),
        per_axis=per_axis,
        floor=float(np.sqrt(np.mean(floors**2))),
        left_torque=left,
        robot=robot,
        lacks=lacks,
    )


def contract(problem: Problem, told: Answer, laws: Sequence[Learned]) -> list[dict[str, Any]]:
    """Return laws as effects of ``discovery.json``.

    Args:
        problem: The recording and the model.
        told: The answer that `with_laws` returned.
        laws: Its laws, in the order in which they were added.
    """
    use = problem.inside & problem.samples(problem.scoring)[:, None]
    before = told.left_torque + laws[-1].change if laws else told.left_torque
    return [
        {
            "effect": LEARNED,
            "axis": one.axis,
            "parameters": {
                "severity": one.size,
                "unit": UNIT,
                "depends_on": list(one.depends_on),
                "formula": one.formula,
                "sentence": one.sentence,
                "resembles": [
                    {"effect": name, "axis": axis, "correlation": alike}
                    for name, axis, alike in one.resembles
                ],
                "range": {
                    name: {"low": low, "high": high, "unit": unit}
                    for name, (low, high, unit) in one.ranges.items()
                },
                "closes": one.share,
                "law": list(one.terms),
            },
            "interval": {"severity": list(one.interval)},
            "confidence": one.confidence,
            "gap_after": relative_error((before - one.change) ** 2, problem.recording, use),
        }
        for one in laws
    ]


def outside(laws: Sequence[Learned], replay: Replay) -> list[str]:
    """Say where a recording leaves the range of the data from which laws were learned.

    Args:
        laws: The laws.
        replay: The other recording, and the model.

    Returns:
        One line for each variable of a law that leaves its range.
    """
    courses = Courses(replay, np.ones(replay.recording.torque.shape, bool))
    lines = []
    for one in laws:
        for term in one.terms:
            low, high = term["knots"][0], term["knots"][-1]
            x = courses.variable(
                Curve(term["over"], term["of"], term["times"], (low, high), term["scale"])
            )
            room = _BEYOND * (high - low)
            if x.min() < low - room or x.max() > high + room:
                lines.append(
                    f"{replay.recording.source}: axis {one.axis}: the learned law holds for "
                    f"the {NAMES[term['over']]} of axis {term['of']} from {low:.3g} to "
                    f"{high:.3g}, but here it goes from {x.min():.3g} to {x.max():.3g}; beyond its "
                    "range the law keeps its last value"
                )
    return lines

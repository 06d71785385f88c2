"""The content of ``discovery.json``: the answer of a discovery, and what else was found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from faultgen.discovery.decision.with_laws import LEARNED, contract
from faultgen.discovery.discover import Discovery
from faultgen.discovery.fit.gap import gap
from faultgen.discovery.fit.problem import Problem
from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.replay.samples import counted
from faultgen.discovery.replay.servo_errors import DELAY, SHOWN
from faultgen.discovery.replay.servo_faults import ServoFaults
from faultgen.discovery.replay.suited import suited_replay
from faultgen.discovery.replay.torque_error import relative_error
from faultgen.discovery.result import NAMED, NONE, PARTLY, UNKNOWN
from faultgen.discovery.rigid.drives import GAIN
from faultgen.discovery.summary import summary
from faultgen.discovery.terms.candidates import Term
from faultgen.effects.words import THAN_BEFORE, THAN_MODEL, in_words
from faultgen.recordings.recording import LogFault, Recording
from faultgen.robot import Robot


def contents(found: Discovery) -> dict[str, Any]:
    """Return the answer of a discovery as the content of ``discovery.json``.

    Args:
        found: The results of a discovery.

    Returns:
        The content, to which the other functions of this module add.
    """
    result = found.answer_.contract()
    result["effects"] += contract(found.problem_, found.answer_, found.laws_)
    if found.laws_:
        learned = "; ".join(one.sentence for one in found.laws_)
        result["unexplained"] = f"{result['unexplained']}; learned: {learned}".removeprefix("; ")
    if found.experiment_ is not None:
        result["next_experiment"] = {
            "task": found.experiment_.task,
            "file": "next_experiment.toml",
            "separates": [{"effect": e, "axis": a} for e, a in found.experiment_.separates],
            "distance": found.experiment_.distance,
            "now": found.experiment_.now,
        }
    return result


def add_words(result: dict[str, Any], robot: Robot, baseline: bool) -> None:
    """Add what was found in one sentence, and each severity in words and in other units.

    Args:
        result: The content. It is changed.
        robot: The model, whose nominal values count.
        baseline: Whether severities are differences from a healthy recording.
    """
    than = THAN_BEFORE if baseline else THAN_MODEL
    for one in [*result["effects"], *result["usual_differences"]]:
        if one["effect"] != LEARNED:
            given = one["parameters"]
            others = {k: v for k, v in given.items() if k not in ("severity", "unit")}
            low, high = one["interval"]["severity"]
            said = in_words(
                robot, one["effect"], one["axis"], given["severity"], (low, high), others, than=than
            )
            one |= said.contract()
    result["summary"] = summary(result, baseline)


def add_log_faults(result: dict[str, Any], faults: Sequence[LogFault]) -> list[str]:
    """Add faults of the log.

    Args:
        result: The content. It is changed.
        faults: The faults.

    Returns:
        One line for each fault of which nothing else tells.
    """
    gap_of = result["gap"]
    first = [one.contract(gap_of["calibrated"]) for one in faults if one.effect in SHOWN]
    others = [one.contract(gap_of["after"]) for one in faults if one.effect not in SHOWN]
    first = _without_those_of(result["effects"], first)
    result["effects"] = [*first, *result["effects"], *others]
    if faults:
        result["verdict"] = {NONE: NAMED, UNKNOWN: PARTLY}.get(result["verdict"], result["verdict"])
    return [
        f"axis {one.axis}: the servo makes the logged torque of the logged positions if its set "
        f"points are {1e3 * one.severity:.3g} ms late; the model has this delay"
        if one.effect == DELAY
        else f"axis {one.axis}: {one.effect} is seen in the log itself; samples that it spoils are "
        "not used, and it is not put into the model"
        for one in faults
        if one.effect not in SHOWN or one.effect == DELAY  # what is corrected is told already
    ]


def _without_those_of(
    effects: Sequence[dict[str, Any]], faults: list[dict[str, Any]]
) -> list[dict[str, Any]]:
    """Add what was corrected in a log to effects that explain the rest of it.

    Args:
        effects: Effects of a result, changed where one is the same effect of the same axis.
        faults: Faults of the log, as effects of a result.

    Returns:
        The faults that are no such part.
    """
    left = []
    for fault in faults:
        key = (fault["effect"], fault["axis"])
        same = next((one for one in effects if (one["effect"], one["axis"]) == key), None)
        if same is None:
            left.append(fault)
            continue
        same["parameters"]["severity"] += fault["parameters"]["severity"]
        bounds = zip(same["interval"]["severity"], fault["interval"]["severity"], strict=True)
        same["interval"]["severity"] = [one + other for one, other in bounds]
    return left


def state_gap_before(result: dict[str, Any], problem: Problem, change: np.ndarray) -> None:
    """State the gap before delays were put into the model and the log was corrected.

    Args:
        result: The content. It is changed.
        problem: The residual.
        change: What both took from the residual, shape (samples, n_axes), in [N m].
    """
    result["gap"]["before"], by_axis = gap(problem, problem.residual + change)
    for row, one in zip(result["gap"]["per_axis"], by_axis, strict=True):
        row["before"] = one


def run_to_run(found: Discovery) -> list[dict[str, float]] | None:
    """Return how the unchanged robot differs from run to run.

    Args:
        found: The results of a discovery.

    Returns:
        RMS torque of each axis [N m]; None if it was not measured.
    """
    if found.runs_ is None:
        return None
    return [{"axis": k + 1, "torque": one} for k, one in enumerate(found.runs_.torque.tolist())]


def torque_constants(found: Discovery) -> list[dict[str, float]] | None:
    """Return the torque constants and offsets of motor currents.

    Without a healthy recording they are calibrated with the other numbers of the model.

    Args:
        found: The results of a discovery.

    Returns:
        Constant and offset of each axis; None if the torque was measured.
    """
    constants = found.problem_.recording.constants
    if constants is None:
        return None
    constant, offset = constants.constant.copy(), constants.offset.copy()
    if not found.problem_.baseline:
        for term, value in found.answer_.changes:
            if term.name == GAIN:
                constant[term.axis - 1] *= 1 - value
            elif term.name == "torque_offset":  # pushes forward, which spares the motor torque
                offset[term.axis - 1] -= value / constants.constant[term.axis - 1]
    return replace(constants, constant=constant, offset=offset).contract()


def validation(
    found: Discovery, validate: Recording, given: Robot, seen: ServoFaults
) -> dict[str, float]:
    """Score the model, never a baseline, on motions that were not used before.

    Args:
        found: The results of a discovery.
        validate: The other motions.
        given: The model as it was given.
        seen: The delays that the model lacked, and the faults of the log.

    Returns:
        Relative torque errors before and after.

    Raises:
        InputError: No sample of the recording can be used.
        SimulationFailed: The model diverges on these motions.
    """
    problem = found.problem_
    replay = suited_replay(validate, given)
    full = replay.with_effects([*seen.applied(), *(one.applied for one in found.laws_)])
    inside = counted(validate, problem.robot, baseline=False)

    def error_of(logged: Recording, model: Replay, changes: list[tuple[Term, float]]) -> float:
        return relative_error((logged.torque - model.torque(changes)) ** 2, validate, inside)

    return {
        "before": error_of(validate, replay, []),
        "after": error_of(seen.corrected(validate), full, found.answer_.changes),
    }

"""Discovery from files to files: the result, the model, the next experiment and the report.

result = discover("measured.h5", "puma560", healthy="healthy.h5", out="out")
result["verdict"], result["effects"]
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from threadpoolctl import threadpool_limits

from faultgen.discovery.calibration.limits import with_limits_of
from faultgen.discovery.calibration.own_friction import with_own_friction
from faultgen.discovery.calibration.own_numbers import with_own_numbers
from faultgen.discovery.decision.posterior import posterior_beside
from faultgen.discovery.decision.with_laws import LEARNED, contract, outside
from faultgen.discovery.discover import Discovery
from faultgen.discovery.fit.gap import gap
from faultgen.discovery.fit.problem import Problem
from faultgen.discovery.inputs import check_positive, read_together, usable
from faultgen.discovery.replay.own_servo import nearest_servo, with_own_servo
from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.replay.samples import counted
from faultgen.discovery.replay.servo_errors import DELAY, SHOWN
from faultgen.discovery.replay.servo_faults import (
    ServoFaults,
    find_servo_faults,
    no_servo_faults,
)
from faultgen.discovery.replay.suited import suited_replay
from faultgen.discovery.replay.torque_error import relative_error
from faultgen.discovery.result import NAMED, NONE, PARTLY, UNKNOWN
from faultgen.discovery.rigid.drives import GAIN
from faultgen.discovery.terms.candidates import FREE_GAINS, Term, check_names, names_by_use
from faultgen.effects import EFFECTS, get_effect
from faultgen.effects.friction import SPEED_FRICTION
from faultgen.effects.words import in_words
from faultgen.errors import InputError, SimulationFailed
from faultgen.recordings.recording import LogFault, Recording, mean_of
from faultgen.robot import Robot, load_robot

_T = TypeVar("_T")

_MANY = 3  # axes whose friction hardly wears at the same time: assumed
_FEWEST_AXES = 4  # that together show how much friction differs from day to day: assumed


def discover(
    measured: str | Path | Sequence[str | Path],
    robot: str | Path,
    healthy: str | Path | Sequence[str | Path] | None = None,
    validate: str | Path | None = None,
    *,
    out: str | Path | None = None,
    workers: int = 1,
    exclude: Collection[str] = (),
    include: Collection[str] = (),
    prior_scale: float | None = None,
    white_noise: bool = False,
    low_pass: float | None = None,
    trust_log: bool = False,
    cache: str | Path | None = None,
) -> dict[str, Any]:
    """Find the physical effect that a measured robot has and its model lacks.

    Args:
        measured: Recording of the robot, or several that are used together; docs/measured.md
            describes the format.
        robot: Name of the robot, or path of its MJCF file or folder.
        healthy: Recording of the same motions from before the change, or several of them in any
            order, equally many for each measured recording. Several runs also show how much the
            unchanged robot differs from run to run, and such differences are not reported. Without
            any, the model is first calibrated on the recording itself, and an effect is reported
            only if it is larger than the errors of this model.
        validate: Recording of other motions with the effect. It is used only to score the result.
        out: Folder for ``discovery.json``, ``report.html``, the folder ``model`` that is a robot
            with all that was found, its MJCF part ``model.xml`` and, if there is one, the next
            experiment. With None, no files are written.
        workers: Number of processes. The result does not depend on it.
        exclude: Names of effects that are not considered.
        include: Names of effects that are considered only on request, with the use
            "on request".
        prior_scale: How uncertain the model's parameters (`candidates.NUMBERS`) are, as a multiple
            of the default. None: it is learned from the recording, for each kind of parameter.
        white_noise: Whether long-lasting errors get full weight. Otherwise part of them is treated
            as drifting noise. Use it for recordings that were filtered; see `regression.plain`.
        low_pass: Cut-off frequency [Hz] of a low-pass filter for recordings without a reference
            position, in which the simulation follows the measured position. With None, they are
            not filtered.
        trust_log: Whether the recordings are taken as they are. Otherwise signs and units of the
            log that the recordings show to be wrong are corrected, and axes without a usable
            torque are left out; each is told in `findings`.
        cache: Folder that keeps simulated sensitivities, so that later calls with recordings of the
            same program, and with the same healthy recording, are faster.

    Returns:
        The content of ``discovery.json``.

    Raises:
        InputError: A recording or an option cannot be used, or `measured` and `healthy` are not
            recordings of the same motions.
        SimulationFailed: The model diverges on the recorded motion.
    """
    started = time.monotonic()
    check_names("include", include, names_by_use("on request"))
    check_names("exclude", exclude, EFFECTS)
    if prior_scale is not None:
        check_positive("prior-scale", prior_scale)
    for name, folder in (("out", out), ("cache", cache)):
        if folder is not None and Path(folder).is_file():
            raise InputError(f"{name}: must be a folder, not the file {folder}")
    model, posterior = load_robot(str(robot)), posterior_beside(robot)
    given = read_together(_paths(measured), model, _paths(healthy), low_pass, trust_log=trust_log)
    recording, runs, warnings = given.recording, given.runs, given.warnings
    findings = list(given.findings)
    model, more = with_limits_of([recording, *runs], model)
    warnings += more
    before = mean_of(runs) if runs else recording
    stage = _Stages(warnings)
    unchanged: tuple[Robot, list[str]] = (model, [])
    model, more = stage(
        "friction that the model lacks",
        lambda: with_own_friction(before, model, healthy=bool(runs)),
        unchanged,
    )
    warnings += more
    with threadpool_limits(limits=1):
        model, servo = stage("fit of the servo", lambda: with_own_servo(before, model), (model, ""))
        fitted, controller = "", model
        if runs:
            model, fitted = stage(
                "fit of the numbers", lambda: with_own_numbers(before, model), (model, "")
            )
            controller = nearest_servo(before, controller, model)
        other = None
        if validate is not None:
            other, more = usable(validate, model, low_pass, recording, trust_log=trust_log)
            warnings += more
            findings += more
        seen = stage(
            "search for faults of servo and log",
            lambda: find_servo_faults(
                recording, controller, runs, arm=model, exclude=exclude, trust_log=trust_log
            ),
            no_servo_faults(recording),
        )
        if seen.are_all:
            exclude = {*exclude, DELAY}
        more = [f"{recording.source}: {one}" for one in seen.findings()]
        findings += more
        warnings += more
        given_model, change = model, recording.torque
        recording = seen.corrected(recording)
        change = change - recording.torque
        if seen.delays:
            model = model.with_effects(seen.applied())
            runs = [replace(run, torque=run.torque + seen.change) for run in runs]
        found = Discovery(
            model,
            posterior=posterior,
            exclude=exclude,
            include=include,
            prior_scale=prior_scale,
            white_noise=white_noise,
            workers=workers,
            cache=_path(cache),
        ).fit(recording, runs)
        result = _result(found)
        if seen.delays and (runs or not found.problem_.replay.measured):
            change = change + seen.change
        if seen.faults:
            _put_before(result, found.problem_, change)
        warnings += _add_log_faults(
            result, [*seen.faults, *(one for one in given.faults if one.effect not in exclude)]
        )
        if other is not None:
            try:
                result["gap"]["validation"] = _validation(found, other, given_model, seen)
                if found.laws_:
                    warnings += outside(found.laws_, suited_replay(other, model))
            except (InputError, SimulationFailed) as error:  # what was found is not lost
                result["gap"]["validation"] = None
                warnings.append(f"{validate}: not scored: {error}")
    _say(result, model)
    result["findings"] = findings
    result["following"] = "; ".join(filter(None, (servo, fitted)))
    result["torque_constants"] = _torque_constants(found)
    if recording.constants is not None and not runs:
        warnings.append(
            f"{' and '.join(FREE_GAINS)} are not named: the torque constants and offsets of "
            "motor_current are not known, and explain the same; --healthy makes them visible"
        )
    if recording.link:
        warnings.append(
            "torque_sensor is 'link': what acts on the rotors is not visible and not named, that "
            "is friction, ripple, rotor inertia, torque constant and offset"
        )
    result["prior_scales"] = {kind: round(one, 3) for kind, one in found.prior_scales_.items()}
    result["run_to_run"] = _run_to_run(found)
    result["warnings"] = [
        *warnings,
        *_on_noise(found.problem_),
        *friction_warnings(found),
        *found.notes_,
        *found.answer_.lacks,
    ]
    result["seconds"] = round(time.monotonic() - started, 1)
    if out is not None:
        from faultgen.report.discovery_report import write_discovery

        write_discovery(Path(out), result, found)
    return result


def _say(result: dict[str, Any], robot: Robot) -> None:
    """Add what each effect means in words, and its severity in other units."""
    for one in result["effects"]:
        if one["effect"] != LEARNED:
            given = one["parameters"]
            others = {k: v for k, v in given.items() if k not in ("severity", "unit")}
            low, high = one["interval"]["severity"]
            said = in_words(
                robot, one["effect"], one["axis"], given["severity"], (low, high), others
            )
            one |= said.contract()


class _Stages:
    """Stages that improve an answer, but without which there is one."""

    def __init__(self, warnings: list[str]) -> None:
        self._warnings = warnings

    def __call__(self, what: str, stage: Callable[[], _T], without: _T) -> _T:
        """Run a stage; if it fails, warn and go on without it.

        Args:
            what: What the stage does, for the warning.
            stage: The stage.
            without: What holds if it fails.
        """
        try:
            return stage()
        except (InputError, SimulationFailed) as error:
            self._warnings.append(f"{what}: left out, because it failed: {error}")
            return without


def _on_noise(problem: Problem) -> list[str]:
    """A line for the report about noise that the two recordings share."""
    if not problem.shared.any():
        return []
    axes = ", ".join(str(axis + 1) for axis in np.flatnonzero(problem.shared))
    return [
        f"axis {axes}: the recording and its baseline differ by far less than the noise in "
        "each, as runs of one dataset with paired = true do; they are compared as if each had "
        "noise of its own, and runs with paired = false are the better test"
    ]


def _add_log_faults(result: dict[str, Any], faults: Sequence[LogFault]) -> list[str]:
    """Add faults of the log to a result. Returns one line for the report about each."""
    gap_of = result["gap"]
    first = [one.contract(gap_of["calibrated"]) for one in faults if one.effect in SHOWN]
    others = [one.contract(gap_of["after"]) for one in faults if one.effect not in SHOWN]
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


def _put_before(result: dict[str, Any], problem: Problem, change: np.ndarray) -> None:
    """State the gap before delays were put into the model and the log was corrected.

    The `change` is what both took from the residual, shape (samples, n_axes), in [N m].
    """
    result["gap"]["before"], by_axis = gap(problem, problem.residual + change)
    for row, one in zip(result["gap"]["per_axis"], by_axis, strict=True):
        row["before"] = one


def friction_warnings(found: Discovery) -> list[str]:
    """Warn of what a single healthy recording cannot show.

    Args:
        found: The results of a discovery.

    Returns:
        One line for each warning; none without a baseline, or if several runs were compared.
    """
    difference = found.choice_.difference
    if not found.problem_.baseline or found.runs_ is not None:
        return []
    several = "give several healthy recordings, which show how much it differs on this robot"
    friction = [
        number for number, kind in enumerate(difference.numbers.kinds) if kind == "friction"
    ]
    scale = found.prior_scales_.get("friction", 0.0)
    day = scale * max((difference.numbers.std[k] for k in friction), default=0.0)
    moving = int(found.problem_.inside.any(axis=0).sum())
    if moving < _FEWEST_AXES:
        return [
            f"one healthy recording with {moving} moving axes does not show how much friction "
            f"differs from day to day; {100 * day:.2g} % is taken, so that a smaller change of "
            f"friction cannot be told from another day; {several}"
        ]
    named = [
        one for one in found.answer_.effects if get_effect(one.effect).prior.group == SPEED_FRICTION
    ]
    axes = sorted({one.axis for one in named})
    if len(axes) < _MANY:
        return []
    shown = ", ".join(str(axis) for axis in axes)
    return [
        f"axes {shown}: friction differs on all of them at once, as between two temperatures; "
        f"{several}"
    ]


def _run_to_run(found: Discovery) -> list[dict[str, float]] | None:
    """RMS torque by which the unchanged robot differs from run to run; None if not measured."""
    if found.runs_ is None:
        return None
    return [{"axis": k + 1, "torque": one} for k, one in enumerate(found.runs_.torque.tolist())]


def _torque_constants(found: Discovery) -> list[dict[str, float]] | None:
    """Torque constants and offsets of motor currents; None if the torque was measured.

    Without a healthy recording they are calibrated with the other numbers of the model.
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


def _paths(given: str | Path | Sequence[str | Path] | None) -> Sequence[str | Path]:
    return [given] if isinstance(given, str | Path) else given or ()


def _path(folder: str | Path | None) -> Path | None:
    return None if folder is None else Path(folder)


def _result(found: Discovery) -> dict[str, Any]:
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


def _validation(
    found: Discovery, validate: Recording, given: Robot, seen: ServoFaults
) -> dict[str, float]:
    """Errors of the model, never of a baseline, on motions that were not used before.

    Args:
        found: The results of a discovery.
        validate: The other motions.
        given: The model as it was given.
        seen: The delays that the model lacked, and the faults of the log.

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

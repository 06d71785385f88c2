"""Discovery with all that surrounds it: faults of the log, own friction and servo, and scores.

result, found = examine("measured.h5", "puma560", healthy="healthy.h5")
result["verdict"], result["summary"]
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from threadpoolctl import threadpool_limits

from faultgen.discovery.calibration.limits import with_limits_of
from faultgen.discovery.calibration.own_friction import with_own_friction
from faultgen.discovery.calibration.own_numbers import with_own_numbers
from faultgen.discovery.contents import (
    add_log_faults,
    add_words,
    contents,
    run_to_run,
    state_gap_before,
    torque_constants,
    validation,
)
from faultgen.discovery.decision.posterior import posterior_beside
from faultgen.discovery.decision.with_laws import outside
from faultgen.discovery.discover import Discovery
from faultgen.discovery.doubts import friction_warnings, noise_warnings
from faultgen.discovery.inputs import USUAL, Options, read_together, usable
from faultgen.discovery.replay.own_servo import nearest_servo, with_own_servo
from faultgen.discovery.replay.servo_errors import DELAY
from faultgen.discovery.replay.servo_faults import find_servo_faults, no_servo_faults
from faultgen.discovery.replay.suited import suited_replay
from faultgen.discovery.terms.candidates import FREE_GAINS
from faultgen.errors import InputError, SimulationFailed
from faultgen.recordings.recording import mean_of
from faultgen.robot import Robot, load_robot

_T = TypeVar("_T")


def examine(
    measured: str | Path | Sequence[str | Path],
    robot: str | Path,
    healthy: str | Path | Sequence[str | Path] | None = None,
    validate: str | Path | None = None,
    options: Options = USUAL,
) -> tuple[dict[str, Any], Discovery]:
    """Find what a measured robot has and its model lacks.

    Args:
        measured: As in `faultgen.discover`, and so are the others.
        robot: Name of the robot, or path of its MJCF file or folder.
        healthy: Recordings from before the change.
        validate: Recording of other motions, which is only scored.
        options: What is considered, and how.

    Returns:
        The content of ``discovery.json`` without the time that it took, and the discovery.

    Raises:
        InputError: A recording cannot be used.
        SimulationFailed: The model diverges on the recorded motion.
    """
    exclude: Collection[str] = options.exclude
    model, posterior = load_robot(str(robot)), posterior_beside(robot)
    given = read_together(
        _paths(measured), model, _paths(healthy), options.low_pass, trust_log=options.trust_log
    )
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
            other, more = usable(
                validate, model, options.low_pass, recording, trust_log=options.trust_log
            )
            warnings += more
            findings += more
        seen = stage(
            "search for faults of servo and log",
            lambda: find_servo_faults(
                recording, controller, runs, arm=model, exclude=exclude, trust_log=options.trust_log
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
            include=options.include,
            prior_scale=options.prior_scale,
            white_noise=options.white_noise,
            workers=options.workers,
            cache=_path(options.cache),
        ).fit(recording, runs)
        result = contents(found)
        if seen.delays and (runs or not found.problem_.replay.measured):
            change = change + seen.change
        if seen.faults:
            state_gap_before(result, found.problem_, change)
        warnings += add_log_faults(
            result, [*seen.faults, *(one for one in given.faults if one.effect not in exclude)]
        )
        if other is not None:
            try:
                result["gap"]["validation"] = validation(found, other, given_model, seen)
                if found.laws_:
                    warnings += outside(found.laws_, suited_replay(other, model))
            except (InputError, SimulationFailed) as error:  # what was found is not lost
                result["gap"]["validation"] = None
                warnings.append(f"{validate}: not scored: {error}")
    add_words(result, model, found.problem_.baseline)
    result["findings"] = findings
    result["following"] = "; ".join(filter(None, (servo, fitted)))
    result["torque_constants"] = torque_constants(found)
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
    result["run_to_run"] = run_to_run(found)
    result["warnings"] = [
        *warnings,
        *noise_warnings(found.problem_),
        *friction_warnings(found),
        *found.notes_,
        *found.answer_.lacks,
    ]
    return result, found


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


def _paths(given: str | Path | Sequence[str | Path] | None) -> Sequence[str | Path]:
    return [given] if isinstance(given, str | Path) else given or ()


def _path(folder: str | Path | None) -> Path | None:
    return None if folder is None else Path(folder)

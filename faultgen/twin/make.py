"""A twin: a calibrated model of a robot, with the noise and the differences that it shows.

    twin = make_twin(["healthy1.h5", "healthy2.h5"], "arm.xml", Path("my_robot"))

The folder is a robot's folder, which every command accepts. Beside the model it holds
``sensors.toml`` (noise, differences from run to run, and what the model still lacks on the recorded
motion), the recorded motion as a task, ``twin.json`` and ``report.html``.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from faultgen.dataset.experiment import check_seed
from faultgen.discovery.calibration.calibrate import calibrate
from faultgen.discovery.calibration.limits import with_limits_for, with_limits_of
from faultgen.discovery.inputs import read_all
from faultgen.discovery.replay.replay import Replay
from faultgen.errors import InputError
from faultgen.monitoring.autoregression import impulse_response
from faultgen.monitoring.sensors import FILE, Remainder, Sensors
from faultgen.recordings.in_step import in_step
from faultgen.recordings.recorded_task import recorded_task
from faultgen.recordings.recording import Recording, mean_of, write_recording
from faultgen.recordings.several import check_own_noise, check_same_motion
from faultgen.report.discover import discover
from faultgen.report.twin_report import twin_page
from faultgen.robot import Robot, load_robot
from faultgen.simulation.motion import plan
from faultgen.simulation.nominal import Nominal, nominal
from faultgen.simulation.plant import Plant
from faultgen.simulation.stepping import decimation, simulate
from faultgen.system.arrays import write_arrays
from faultgen.system.files import write_text
from faultgen.system.sums import write_listed
from faultgen.system.terminal import tell
from faultgen.tasks import load_task
from faultgen.twin.alignment import KnownMotion, find_cycles, mean_cycle, stretches_of
from faultgen.twin.disturbances import moving_average, run_differences, torque_noise_of
from faultgen.twin.folder import HEALTHY, RESULT, TASK
from faultgen.twin.likeness import CYCLES, generated_cycles, likeness, summary
from faultgen.twin.warming import temperature_of

_SLOW = 0.02  # time over which what the model lacks is averaged [s]
_AROUND = 0.08  # time over which its fast changes are compared with the noise [s]
_SAFE = 1.5  # noise over what is expected, up to which fast changes are taken for noise
_SAMPLE_PERIOD = 0.004  # of generated data, at least [s]

Say = Callable[[str], None]


def make_twin(
    healthy: Sequence[str | Path],
    robot: str | Path,
    out: Path,
    *,
    with_discovery: bool = False,
    workers: int = 1,
    seed: int = 0,
    trust_log: bool = False,
    say: Say | None = None,
) -> dict[str, Any]:
    """Learn a twin of a robot from healthy recordings of one program.

    Args:
        healthy: Recordings of the same motions.
        robot: Name of the robot, or path of its MJCF file or folder.
        out: Folder for the twin. It is created if it does not exist.
        with_discovery: Whether effects that the model lacks are searched and added.
        workers: Number of processes. The result does not depend on it.
        seed: Seed of the generated data in the report.
        trust_log: Whether the recordings are taken as they are, without tests and corrections.
        say: Function that is told what happens.

    Returns:
        The content of ``twin.json``.

    Raises:
        InputError: A recording cannot be used, or they do not hold the same motions.
        SimulationFailed: The model diverges on the recorded motion.
    """
    say = say or (lambda line: None)
    started = time.monotonic()
    if out.is_file() or out.suffix == ".xml":
        raise InputError(f"out: must be a folder, not {out}")
    check_seed(seed)
    model = load_robot(robot)
    recordings, warnings = _read(healthy, model, trust_log)
    model, more = with_limits_of(recordings, model)
    warnings += more
    for warning in warnings:
        tell(warning)
    if len(recordings) == 1:
        say("one recording cannot show how runs differ; usual differences are assumed")
    mean = mean_of(recordings)
    with threadpool_limits(limits=1):
        say("calibrating the model")
        calibrated = calibrate(mean, model, workers=workers)
        found, verdict = calibrated.robot, "not searched"
        effects: list[dict[str, Any]] = []
        if with_discovery:
            say("searching for effects that the model lacks")
            found, effects, verdict = _discovered(mean, found, out, workers, trust_log)
        result: dict[str, Any] = {
            "robot": model.name,
            "recordings": [one.source for one in recordings],
            "torque_constants": _constants(recordings[0]),
            "calibration": calibrated.report(),
            "discovery": {"verdict": verdict, "effects": effects},
        }
        result |= furnish(found, recordings, out, seed=seed, say=say)
    result["warnings"] = [*warnings, *calibrated.lacks, *calibrated.findings]
    result["seconds"] = round(time.monotonic() - started, 1)
    write_listed(out, RESULT, json.dumps(result, indent=1) + "\n")
    return result


def furnish(
    robot: Robot,
    recordings: Sequence[Recording],
    out: Path,
    *,
    seed: int = 0,
    say: Say | None = None,
    compare: bool = True,
) -> dict[str, Any]:
    """Write a robot's folder with task, noise, differences of runs and remainder.

    Args:
        robot: The model, calibrated.
        recordings: Healthy recordings of the same motions.
        out: The folder.
        seed: Seed of the generated data in the report.
        say: Function that is told what happens.
        compare: Whether generated and measured data are compared, and the report is written.

    Returns:
        What was learned, ready for JSON.
    """
    say = say or (lambda line: None)
    say("learning noise and differences of the runs")
    mean = mean_of(recordings)
    replay = Replay(mean, robot)
    text = recorded_task(mean, robot, TASK)
    robot, raised = with_limits_for(load_task(robot.name, TASK, {TASK: text}), robot)
    for line in raised:
        say(line)
    robot = replace(robot, tasks={**robot.tasks, TASK: text})
    robot.write(out)
    period = _period(mean.sample_period, robot)
    shared = nominal(str(out), TASK, period)
    known, clean = nominal_cycle(shared, period)
    runs = run_differences(replay, recordings)
    _, speed, _ = mean.derivatives(mean.motor_position(robot))
    noise = torque_noise_of(runs, replay, np.abs(speed), np.abs(mean.torque))
    side = robot.gear_ratio if mean.side == "joint" else np.ones(robot.n_axes)
    deviation = noise.deviation / np.abs(side)
    by_recording = [find_cycles(one, known) for one in recordings]
    means = [mean_cycle(cycles) for cycles in by_recording]

    def lacking(mean: np.ndarray, count: int) -> np.ndarray:
        return _remainder(mean - clean, known, deviation, count)

    remainder = lacking(np.mean(means, axis=0), len(recordings))
    colour = _recoloured(noise.colour, mean.sample_period, period)
    sensors = Sensors(
        description=f"learned from {len(recordings)} recordings of {robot.name}",
        torque_noise=[float(f"{x:.5g}") for x in deviation / shared.mean_torque],
        torque_colour=colour,
        torque_growth=noise.growth,
        sample_period=period,
        quantised=bool((robot.encoder_counts > 0).any()),
        run_to_run=runs.table(robot.n_axes),
        remainder=Remainder(
            task_sha256=load_task(robot.name, TASK, robot.tasks).sha256,
            sample_period=period,
            torque=remainder.tolist(),
        ),
    )
    write_listed(out, FILE, sensors.to_toml())
    arrays = {"torque": np.stack(means)}
    warm = [one for one in map(temperature_of, recordings) if one is not None]
    if len(warm) == len(recordings):
        arrays["temperature"] = np.array(warm)
    write_arrays(out / HEALTHY, arrays, {"sample_period": period})
    rms = np.sqrt(np.nanmean(np.mean(means, axis=0) ** 2, axis=0))
    left = np.sqrt(np.nanmean((np.mean(means, axis=0) - clean)[known.compared] ** 2, axis=0))
    result: dict[str, Any] = {
        "task": TASK,
        "sample_period": period,
        "cycles": [len(cycles) for cycles in by_recording],
        "noise": {
            "deviation": deviation.tolist(),
            "over_rms_torque": (deviation / np.maximum(rms, 1e-300)).tolist(),
            "growth_with_speed_and_load": noise.growth,
        },
        "run_to_run": runs.table(robot.n_axes),
        "remainder_over_rms_torque": (left / np.maximum(rms, 1e-300)).tolist(),
    }
    if compare:
        say("comparing generated with measured data")
        made = generated_cycles(out, TASK, CYCLES, seed)
        told = likeness(by_recording, made, known, lacking)
        result["likeness"] = told
        result["summary"] = summary(robot.name, told, result["remainder_over_rms_torque"])
        page = twin_page(
            robot,
            result,
            by_recording,
            list(made),
            compared=known.compared,
            sample_period=period,
            position=shared.position,
        )
        write_text(out / "report.html", page)
    return result


def _read(
    healthy: Sequence[str | Path], robot: Robot, trust_log: bool
) -> tuple[list[Recording], list[str]]:
    """Read recordings of the same motions, with the torque constants of the first one."""
    if robot.gearing.coupled.any():
        axis = int(np.argmax(robot.gearing.coupled)) + 1
        raise InputError(
            f"robot {robot.name}: gearbox{axis} also turns with another joint; a twin is made of a "
            "robot whose gearboxes turn with their own joint alone"
        )
    read = read_all(healthy, robot, trust_log=trust_log)
    recordings, warnings = read.recordings, read.warnings
    if recordings[0].link:
        raise InputError(
            f"{recordings[0].source}: its torque sensor is behind the gearbox; a twin needs the "
            "torque or current of the motors"
        )
    for one in recordings:
        if one.left_out:
            axes = ", ".join(map(str, one.left_out))
            raise InputError(
                f"{one.source}: the torque of axis {axes} cannot be used, and a twin needs that of "
                "every axis; --trust-log takes the file as it is"
            )
    recordings = in_step(recordings)
    for other in recordings[1:]:
        check_same_motion(recordings[0], other)
    check_own_noise(recordings)
    return recordings, warnings


def _constants(recording: Recording) -> list[dict[str, float]] | None:
    return None if recording.constants is None else recording.constants.contract()


def _discovered(
    mean: Recording, robot: Robot, out: Path, workers: int, trust_log: bool
) -> tuple[Robot, list[dict[str, Any]], str]:
    """The model with what discovery names or learns, its effects and its verdict."""
    folder = out / "discovery"
    calibrated = out / "calibrated"
    robot.write(calibrated)
    folder.mkdir(parents=True, exist_ok=True)
    measured = folder / "mean.h5"
    write_recording(mean, measured)
    found = discover(measured, calibrated, out=folder, workers=workers, trust_log=trust_log)
    effects = [
        {
            "effect": one["effect"],
            "axis": one["axis"],
            "severity": one["parameters"]["severity"],
            "confidence": one["confidence"],
        }
        for one in found["effects"]
    ]
    # without an effect or law, the model of the discovery differs by its own calibration only
    model = load_robot(folder / "model") if effects else robot
    return model, effects, str(found["verdict"])


def _period(recorded: float, robot: Robot) -> float:
    """Sample period of generated data: that of the recordings, in whole steps of the model."""
    step = robot.model.opt.timestep
    period = max(1, round(max(recorded, _SAMPLE_PERIOD) / step)) * step
    period = float(f"{period:.9g}")
    decimation(step, period)
    return period


def nominal_cycle(shared: Nominal, period: float) -> tuple[KnownMotion, np.ndarray]:
    """Simulate one healthy cycle without noise.

    Args:
        shared: What the runs of the robot and task share.
        period: Time between samples [s].

    Returns:
        The motion, and the torque of the motors, shape (samples, n_axes), in [N m].
    """
    robot = shared.robot
    (cycle,) = simulate(robot, shared.control, [Plant(robot.model)], sample_period=period)
    motion = plan(load_task(robot.name, TASK, robot.tasks), robot)
    known = KnownMotion(
        path=cycle.motor_position / robot.gear_ratio,
        stretches=stretches_of(motion, len(cycle.motor_position), period),
        sample_period=period,
        gear_ratio=robot.gear_ratio,
    )
    return known, cycle.motor_torque


def _remainder(
    apart: np.ndarray, known: KnownMotion, noise: np.ndarray, recordings: int
) -> np.ndarray:
    """What the model lacks by place, with little of the noise that a mean of recordings still has.

    Slow changes are kept as they are. Of fast ones, the share is kept by which they exceed the
    noise around their place (Wiener 1949).

    Args:
        apart: Mean torque less that of the model, shape (samples, n_axes), in [N m]; nan where
            nothing was recorded.
        known: The motion.
        noise: Standard deviation of the noise of a recording, shape (n_axes,), in [N m].
        recordings: Number of recordings.

    Returns:
        Shape (samples, n_axes), in [N m]; 0 where nothing was recorded.
    """
    out = np.zeros_like(apart)
    half = max(1, round(_SLOW / known.sample_period / 2))
    around = max(half, round(_AROUND / known.sample_period / 2))
    for start, end in known.stretches:
        own = apart[start:end]
        slow = moving_average(own, 2 * half + 1)
        fast = own - slow
        energy = np.maximum(moving_average(fast**2, 2 * around + 1), 1e-300)
        expected = _SAFE * noise**2 / recordings
        share = np.clip(1 - expected / energy, 0.0, 1.0) if recordings > 1 else 0.0
        out[start:end] = slow + share * fast
    return np.array([[float(f"{x:.5g}") for x in row] for row in out])


def _recoloured(colour: list[list[float]], recorded: float, period: float) -> list[list[float]]:
    """The autoregression at another sample period: one of first order with the same decay."""
    if abs(recorded - period) < 1e-9:
        return colour
    out = []
    for own in colour:
        state = impulse_response(own)
        correlation = float(np.clip((state[1:] * state[:-1]).sum() / (state**2).sum(), 0.0, 0.98))
        out.append([float(f"{correlation ** (period / recorded):.5g}")])
    return out

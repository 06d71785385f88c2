"""The measured position that a model follows: smoothed as far as noise and torque require.

A position is first smoothed according to its own noise, which is taken as white. Noise of real logs
may last for some milliseconds, for example because the samples are late by different times. Smooth
positions then still have far too large accelerations. The measured torque shows this: a rigid arm
on a motion that is smoothed further explains it better. So does the arm with its gearboxes, if
their resonances, which may be wrong in the model, answer to what is left of the noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline

from faultgen.discovery.replay.prescribed import prescribed
from faultgen.errors import SimulationFailed
from faultgen.recordings.recording import Recording
from faultgen.recordings.smoothing import smoothed_with, strengths
from faultgen.robot import Robot
from faultgen.simulation.arm import Arm, motor_torque
from faultgen.simulation.cycle import Cycle
from faultgen.simulation.plant import assemble

STRONGER = tuple(range(11))
"""Common logarithms of the factors of the penalty of smoothing that are tried. A factor of a
million lowers the bandwidth to a tenth."""

_CLEARLY = 0.75  # squared torque error, over that without more smoothing, that requires it: assumed
_MORE = 0.9  # the same with gearboxes: assumed
_NEARLY = 1.02  # the same over the smallest one, up to which weaker smoothing is preferred: assumed
_FEWEST = 100  # samples of an axis that can tell
_ENOUGH = 2000  # samples at which a rigid arm is compared, spread evenly over the recording


@dataclass(frozen=True, eq=False)
class Followed:
    """A measured motion, smoothed."""

    position: np.ndarray
    """What the joints do without twist of the gearboxes, shape (samples, n_axes), in [rad], or [m]
    for slides."""
    cycles: list[Cycle] | None
    """What the model logs on this motion at every step of a simulation, in each separate recording;
    None if it was not simulated."""
    strengths: list[list[float | None]]
    """Common logarithm of the penalty with which each axis of each separate recording was smoothed;
    None where it was not."""


def followed(recording: Recording, robot: Robot, inside: np.ndarray) -> Followed:
    """Smooth the measured positions for a simulation of the robot with its gearboxes.

    Args:
        recording: The measured data.
        robot: The model.
        inside: Samples whose torque is compared, shape (samples, n_axes).

    Returns:
        The motion.
    """
    trials = _Trials.of(recording, recording.joint_position(robot))
    best, cycles = _for_rigid_arm(recording, robot, inside, trials), None
    if not recording.link:
        best, cycles = _with_gearboxes(recording, robot, trials.positions, best, inside)
    return Followed(np.asarray(trials.positions[best]), cycles, trials.strengths[best])


def rotor_steps(robot: Robot, position: np.ndarray, period: float) -> np.ndarray:
    """Compute the position of the rotors at every step of a simulation.

    Args:
        robot: The model.
        position: What the joints do without twist of the gearboxes in a separate recording, shape
            (samples, n_axes), in [rad].
        period: Time between samples [s].

    Returns:
        Shape (steps, n_axes), in [rad].
    """
    timestep = robot.model.opt.timestep
    times = np.arange(len(position)) * period
    steps = np.arange(round((times[-1] + timestep) / timestep)) * timestep
    way = make_interp_spline(times, position)(np.minimum(steps, times[-1]))
    return np.asarray(robot.gearing.outputs(way) * robot.gear_ratio)


def followed_by_rigid_arm(
    recording: Recording, robot: Robot, inside: np.ndarray, position: np.ndarray
) -> np.ndarray:
    """Smooth the measured positions for the dynamics of a rigid arm.

    All axes are smoothed equally much more than their own noise requires, because what is late in a
    log is late on all axes, and because the torque of an axis with little inertia tells nothing.

    Args:
        recording: The measured data.
        robot: The model.
        inside: Samples whose torque is compared, shape (samples, n_axes).
        position: Its position, joint side, shape (samples, n_axes).

    Returns:
        Joint side, shape (samples, n_axes), in [rad], or [m] for slides.
    """
    trials = _Trials.of(recording, position)
    return np.asarray(trials.positions[_for_rigid_arm(recording, robot, inside, trials)])


@dataclass(frozen=True, eq=False)
class _Trials:
    """A position with each smoothing of `STRONGER`."""

    positions: np.ndarray
    """Shape (trials, samples, n_axes)."""
    strengths: list[list[list[float | None]]]
    """As in `Followed`, for each trial."""

    @classmethod
    def of(cls, recording: Recording, position: np.ndarray) -> _Trials:
        """Smooth a position of shape (samples, n_axes)."""
        out = np.empty((len(STRONGER), *position.shape))
        found: list[list[list[float | None]]] = [[] for _ in STRONGER]
        for part in recording.parts:
            of_axes = [strengths(own, STRONGER) for own in position[part].T]
            for trial, (own, row) in enumerate(zip(zip(*of_axes, strict=True), found, strict=True)):
                row.append(list(own))
                for axis, strength in enumerate(own):
                    out[trial, part, axis] = smoothed_with(position[part, axis], strength)
        return cls(out, found)


def _for_rigid_arm(recording: Recording, robot: Robot, inside: np.ndarray, trials: _Trials) -> int:
    """The number of the smoothing that suits a rigid arm."""
    arm, rows = Arm(robot), np.flatnonzero(inside.any(axis=1))
    some = np.zeros_like(inside)
    rows = rows[:: max(1, len(rows) // _ENOUGH)]
    some[rows] = inside[rows]
    errors = [_rigid_error(recording, arm, one, some) for one in trials.positions]
    clearly = min(errors) < _CLEARLY * errors[0]
    best = next(k for k, one in enumerate(errors) if one <= _NEARLY * min(errors))
    return best if clearly else 0


def _with_gearboxes(
    recording: Recording, robot: Robot, trials: np.ndarray, first: int, inside: np.ndarray
) -> tuple[int, list[Cycle] | None]:
    """How much smoothing the arm with its gearboxes requires.

    Args:
        recording: The measured data.
        robot: The model.
        trials: Smoothed positions, shape (trials, samples, n_axes).
        first: Number of the trial that suits the rigid arm.
        inside: Samples whose torque is compared, shape (samples, n_axes).

    Returns:
        Number of a trial: 0 if the first one is not clearly better, otherwise the first one; or
        the number up to which more smoothing makes the error smaller, if it does so enough. And its
        simulation, if it did not diverge.
    """
    runs: dict[int, list[Cycle]] = {}

    def error(k: int) -> float:
        try:
            runs[k] = _simulated(recording, robot, trials[k])
        except SimulationFailed:
            return np.inf
        torque = _logged(recording, robot, runs[k])
        torque = torque if recording.side == "motor" else torque * robot.gear_ratio
        return unexplained(
            recording, differences(recording, trials[k])[0], torque, inside, scaled=False
        )

    own, least = first, error(first)
    if first:
        without = error(0)
        if least >= _CLEARLY * without:
            own, least = 0, without
    best, lowest = own, least
    for k in range(own + 1, len(trials)):
        more = error(k)
        if more >= lowest:
            break
        best, lowest = k, more
        runs = {number: run for number, run in runs.items() if number in (own, best)}
    chosen = best if lowest < _MORE * least else own
    return chosen, runs.get(chosen)


def _simulated(recording: Recording, robot: Robot, position: np.ndarray) -> list[Cycle]:
    """Simulate each separate recording of a motion of shape (samples, n_axes), see `prescribed`."""
    plant, period = assemble(robot), recording.sample_period
    return [
        prescribed(robot, plant, rotor_steps(robot, position[part], period))
        for part in recording.parts
    ]


def _logged(recording: Recording, robot: Robot, runs: Sequence[Cycle]) -> np.ndarray:
    """Torque of the motors at the samples [N m], shape (samples, n_axes)."""
    torque = np.empty_like(recording.torque)
    for part, run in zip(recording.parts, runs, strict=True):
        times = np.arange(part.stop - part.start) * recording.sample_period
        steps = np.arange(len(run.motor_torque)) * robot.model.opt.timestep
        for axis in range(robot.n_axes):
            needed = run.motor_torque[:, axis] * robot.torque_gain[axis]
            torque[part, axis] = np.interp(times, steps, needed)
    return torque


def _rigid_error(recording: Recording, arm: Arm, position: np.ndarray, inside: np.ndarray) -> float:
    """The error of `unexplained` for a rigid arm."""
    speed, acceleration = differences(recording, position)
    rows, torque = inside.any(axis=1), np.zeros_like(position)
    motion = (position[rows], speed[rows], acceleration[rows])
    torque[rows] = arm.inverse_dynamics(*motion) if recording.link else motor_torque(arm, *motion)
    return unexplained(recording, speed, torque, inside, scaled=True)


def differences(recording: Recording, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute velocity and acceleration by differences, which stay within each separate recording.

    Args:
        recording: The measured data.
        position: Smooth position, shape (samples, n_axes).

    Returns:
        Velocity and acceleration, of the same shape.
    """
    speed, acceleration = np.empty_like(position), np.empty_like(position)
    for part in recording.parts:
        speed[part] = np.gradient(position[part], recording.sample_period, axis=0)
        acceleration[part] = np.gradient(speed[part], recording.sample_period, axis=0)
    return speed, acceleration


def unexplained(
    recording: Recording,
    speeds: np.ndarray,
    torque: np.ndarray,
    inside: np.ndarray,
    *,
    scaled: bool,
) -> float:
    """Compute the mean squared torque that a model leaves, with further friction of any size.

    It is the geometric mean over the axes, as a share of the squared torque of each.

    Args:
        recording: The measured data.
        speeds: Speed of the joints, shape (samples, n_axes).
        torque: Torque of the model on this motion, same shape.
        inside: Samples whose torque is compared, same shape.
        scaled: Whether the torque of each axis may be multiplied by any number, as if masses were
            wrong. A resonance that is far too large could then be scaled down.

    Returns:
        The mean, without unit; 1 if no axis has enough samples.
    """
    left = []
    for axis in range(speeds.shape[1]):
        rows = inside[:, axis]
        measured, speed = recording.torque[rows, axis], speeds[rows, axis]
        if rows.sum() < _FEWEST or not measured.any():
            continue
        known = [np.sign(speed), speed, np.ones_like(speed)]
        known += [torque[rows, axis]] if scaled else []
        target = measured if scaled else measured - torque[rows, axis]
        columns = np.stack(known, axis=1)
        size = np.linalg.lstsq(columns, target, rcond=None)[0]
        left.append(np.mean((target - columns @ size) ** 2) / np.mean(measured**2))
    return float(np.exp(np.mean(np.log(np.maximum(left, 1e-12))))) if left else 1.0

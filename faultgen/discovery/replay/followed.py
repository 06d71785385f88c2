"""The measured position that a model follows: smoothed as far as noise and torque require.

A position is first smoothed according to its own noise, which is taken as white. Noise of real logs
may last for some milliseconds, for example because the samples are late by different times. Smooth
positions then still have far too large accelerations. The measured torque shows this: a rigid arm
on a motion that is smoothed further explains it better. So does the arm with its gearboxes, if
their resonances, which may be wrong in the model, answer to what is left of the noise.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import make_interp_spline

from faultgen.discovery.replay.prescribed import prescribed_torque
from faultgen.errors import SimulationFailed
from faultgen.recordings.recording import Recording
from faultgen.recordings.smoothing import smoothings
from faultgen.robot import Robot
from faultgen.simulation.arm import Arm, motor_torque

STRONGER = tuple(range(11))
"""Common logarithms of the factors of the penalty of smoothing that are tried. A factor of a
million lowers the bandwidth to a tenth."""

_CLEARLY = 0.75  # squared torque error, over that without more smoothing, that requires it: assumed
_MORE = 0.9  # the same with gearboxes: assumed
_NEARLY = 1.02  # the same over the smallest one, up to which weaker smoothing is preferred: assumed
_FEWEST = 100  # samples of an axis that can tell


def followed(recording: Recording, robot: Robot, inside: np.ndarray) -> np.ndarray:
    """Smooth the measured positions for a simulation of the robot with its gearboxes.

    Args:
        recording: The measured data.
        robot: The model.
        inside: Samples whose torque is compared, shape (samples, n_axes).

    Returns:
        What the joints do without twist of the gearboxes, shape (samples, n_axes), in [rad], or [m]
        for slides.
    """
    trials, first = _for_rigid_arm(recording, robot, inside, recording.joint_position(robot))
    if not recording.link:
        first = _with_gearboxes(recording, robot, trials, first, inside)
    return np.asarray(trials[first])


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
    trials, first = _for_rigid_arm(recording, robot, inside, position)
    return np.asarray(trials[first])


def _for_rigid_arm(
    recording: Recording, robot: Robot, inside: np.ndarray, position: np.ndarray
) -> tuple[np.ndarray, int]:
    """The position with each smoothing, and the number of the one that suits a rigid arm."""
    arm = Arm(robot)
    trials = _smoothed(position, recording)
    errors = [_rigid_error(recording, arm, one, inside) for one in trials]
    clearly = min(errors) < _CLEARLY * errors[0]
    best = next(k for k, one in enumerate(errors) if one <= _NEARLY * min(errors))
    return trials, best if clearly else 0


def _with_gearboxes(
    recording: Recording, robot: Robot, trials: np.ndarray, first: int, inside: np.ndarray
) -> int:
    """How much smoothing the arm with its gearboxes requires.

    Args:
        recording: The measured data.
        robot: The model.
        trials: Smoothed positions, shape (trials, samples, n_axes).
        first: Number of the trial that suits the rigid arm.
        inside: Samples whose torque is compared, shape (samples, n_axes).

    Returns:
        Number of a trial: 0 if the first one is not clearly better, otherwise the first one; or
        the number up to which more smoothing makes the error smaller, if it does so enough.
    """

    def error(k: int) -> float:
        try:
            torque = _elastic_torque(recording, robot, trials[k])
        except SimulationFailed:
            return np.inf
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
    return best if lowest < _MORE * least else own


def _elastic_torque(recording: Recording, robot: Robot, position: np.ndarray) -> np.ndarray:
    """Compute the motor torque of a motion with elastic gearboxes, see `prescribed_torque`.

    Args:
        recording: The measured data.
        robot: The model.
        position: What the joints do without twist of the gearboxes, shape (samples, n_axes).

    Returns:
        Torque of the motors, shape (samples, n_axes), in [N m].

    Raises:
        SimulationFailed: The simulation diverged.
    """
    timestep = robot.model.opt.timestep
    torque = np.empty_like(position)
    for part in recording.parts:
        times = np.arange(part.stop - part.start) * recording.sample_period
        steps = np.arange(round((times[-1] + timestep) / timestep)) * timestep
        rotors = robot.gearing.outputs(make_interp_spline(times, position[part])(steps))
        needed = prescribed_torque(robot, rotors * robot.gear_ratio)
        for axis in range(position.shape[1]):
            torque[part, axis] = np.interp(times, steps, needed[:, axis])
    return torque


def _smoothed(position: np.ndarray, recording: Recording) -> np.ndarray:
    """The position for each of `STRONGER`, shape (trials, samples, n_axes)."""
    out = np.empty((len(STRONGER), *position.shape))
    for part in recording.parts:
        for axis in range(position.shape[1]):
            out[:, part, axis] = smoothings(position[part, axis], STRONGER)
    return out


def _rigid_error(recording: Recording, arm: Arm, position: np.ndarray, inside: np.ndarray) -> float:
    """The error of `unexplained` for a rigid arm."""
    speed, acceleration = differences(recording, position)
    if recording.link:
        torque = arm.inverse_dynamics(position, speed, acceleration)
    else:
        torque = motor_torque(arm, position, speed, acceleration)
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

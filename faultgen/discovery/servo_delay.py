"""Delays of single axes, from what the servo makes of the tracking error.

The torque of a servo follows from its set points and from the measured motion, whatever the arm is:

    torque = kp (r - q) + kd (dr/dt - dq/dt) + feed-forward torque

with the motor's commanded position r and its measured position q. If the set points of an axis
reach the drive late by d, the left side lacks d times the rate of all that depends on them. So d is
found by linear regression, without the masses, friction and stiffness of the robot, all of which
hide a delay in a comparison of torques. All signals are smoothed by the same filter, which leaves
the equation true.

The equation is that of the model's servo. If it does not explain the torque, nothing is found.

    late = find_delays(recording, robot, runs)
    late.faults
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from faultgen.applied import Applied
from faultgen.discovery.recording import LogFault, Recording
from faultgen.discovery.replay import Replay, settled
from faultgen.effects import get_effect
from faultgen.errors import SimulationFailed
from faultgen.mjcf.dcmotor import POSITION_GAIN, VELOCITY_GAIN
from faultgen.robot import Robot
from faultgen.simulation.arm import Arm, motor_torque

DELAY = "delay"

_BLOCKS = 8  # parts of a recording that are left out in turn, for the standard error
_FEWEST = 25  # samples of a block
_EXPLAINED = 0.3  # torque error of the servo's equation, over the torque, up to which it holds
_SURE = 8.0  # delay over its standard error from which it counts: assumed
_SHORTEST = 1e-4  # delay [s] below which the clocks of drives may differ: assumed
_WIDTH = 2.36  # of intervals in standard errors: 95 % of Student's t with 7 degrees of freedom
_BETTER = 0.9  # torque error of the equation with the delay, over that without it: assumed
_AXES = 3  # from which a delay of all axes, which is that of the log, can be told from one axis'


@dataclass(frozen=True, eq=False)
class Delays:
    """Delays of single axes."""

    faults: tuple[LogFault, ...]
    """The delays that count."""
    change: np.ndarray
    """By how much they change the torque, shape (samples, n_axes), in [N m]."""

    def applied(self) -> list[Applied]:
        """The delays as effects of a robot."""
        return [Applied(one.effect, one.axis, one.severity) for one in self.faults]


def no_delays(recording: Recording) -> Delays:
    """Return that no delay counts."""
    return Delays((), np.zeros_like(recording.torque))


def find_delays(recording: Recording, robot: Robot, runs: Sequence[Recording] = ()) -> Delays:
    """Find axes whose set points reach the drive late.

    Args:
        recording: The measured data.
        robot: The model.
        runs: Recordings of the same motions from before the change. Without any, a delay counts if
            the other axes do not have it.

    Returns:
        The delays; none if the recording has no commanded position or no torque of the motors, or
        if the torque is not what the model's servo makes of them.
    """
    nothing = no_delays(recording)
    given = [recording, *runs]
    if any(one.reference_position is None or one.side != "motor" for one in given):
        return nothing
    found = [_delays(one, robot) for one in given]
    own = found[0]
    if runs:
        before = np.array([one.delay for one in found[1:]])
        usual = before.mean(axis=0)
        errors = np.array([one.error for one in found[1:]])
        spread = np.hypot(errors.mean(axis=0), before.std(axis=0))
        holds = np.all([one.holds for one in found], axis=0)
    else:
        holds = own.holds
        if holds.sum() < max(_AXES, robot.n_axes / 2):
            return nothing
        usual, spread = np.median(own.delay[holds]), np.median(own.error[holds])
    late, error = own.delay - usual, np.hypot(own.error, spread)
    low, high = late - _WIDTH * error, late + _WIDTH * error
    counts = holds & own.helps & (np.abs(late) > np.maximum(_SURE * error, _SHORTEST))
    counts &= np.abs(late) <= get_effect(DELAY).largest
    faults = tuple(
        LogFault(DELAY, k + 1, float(late[k]), (float(low[k]), float(high[k])))
        for k in np.flatnonzero(counts).tolist()
    )
    if not faults:
        return nothing
    delays = Delays(faults, nothing.change)
    replay = Replay(recording, robot, measured=False)
    try:
        change = replay.with_effects(delays.applied()).torque() - replay.torque()
    except SimulationFailed:
        return nothing
    return replace(delays, change=change)


@dataclass(frozen=True, eq=False)
class _Late:
    """What the equation of the servo says of each axis. Arrays have shape (n_axes,)."""

    delay: np.ndarray
    """[s]."""
    error: np.ndarray
    """Standard error of the delay, from leaving out blocks in turn [s]."""
    holds: np.ndarray
    """Whether the equation explains the torque."""
    helps: np.ndarray
    """Whether it explains it clearly better with the delay than without."""


def _delays(recording: Recording, robot: Robot) -> _Late:
    """Regress the error of the servo's equation on the rate of the set points."""
    made, rate, torque = _equation(recording, robot)
    inside = settled(recording, robot)
    if recording.lost is not None:
        inside &= ~recording.lost
    n = robot.n_axes
    delay, error = np.zeros(n), np.full(n, np.inf)
    holds, helps = np.zeros((2, n), bool)
    for axis in range(n):
        rows = np.flatnonzero(inside[:, axis])
        if len(rows) < _BLOCKS * _FEWEST:
            continue
        columns = np.stack([-rate[rows, axis], np.ones(len(rows))], axis=1)
        target = (torque - made)[rows, axis]
        delay[axis], offset = np.linalg.lstsq(columns, target, rcond=None)[0]
        left = (target - columns @ [delay[axis], offset]).std()
        holds[axis] = left < _EXPLAINED * torque[rows, axis].std()
        helps[axis] = left < _BETTER * target.std()
        apart = [
            np.linalg.lstsq(np.delete(columns, block, 0), np.delete(target, block), rcond=None)[0]
            for block in np.array_split(np.arange(len(rows)), _BLOCKS)
        ]
        error[axis] = np.sqrt((_BLOCKS - 1) * np.array(apart)[:, 0].var())
    for one in robot.effects:
        if one.effect == DELAY:  # the model has it
            delay[one.axis - 1] -= one.severity
    return _Late(delay, error, holds, helps)


def _equation(recording: Recording, robot: Robot) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The torque that the servo makes, its rate from set points alone, and the measured torque.

    All have shape (samples, n_axes); [N m], motor side, and [N m/s].
    """
    assert recording.reference_position is not None
    wanted = recording.derivatives(recording.reference_position)
    position, speed = recording.derivatives(recording.motor_position(robot))[:2]
    torque = recording.derivatives(recording.torque / robot.torque_gain)[0]
    outputs = robot.gearing.outputs
    gains = robot.model.actuator_gainprm[robot.ids("actuator", "drive")]
    stiffness, damping = gains[:, POSITION_GAIN], gains[:, VELOCITY_GAIN]
    from_points = stiffness * outputs(wanted[0]) * robot.gear_ratio
    from_points += damping * outputs(wanted[1]) * robot.gear_ratio * robot.set_points[1]
    if robot.set_points[2]:
        forward = motor_torque(Arm(robot), *wanted) * robot.set_points[2]
        from_points += forward
    made = from_points - stiffness * position - damping * speed
    rate = np.zeros_like(made)
    for part in recording.parts:
        rate[part] = np.gradient(from_points[part], recording.sample_period, axis=0)
    return made, rate, torque

"""Delays of single axes, from what the servo makes of the tracking error.

The torque of a servo follows from its set points and from the measured motion, whatever the arm is
(`servo_equation`). If the set points of an axis reach the drive late by d, its torque lacks d times
the rate of all that depends on them. So d is found by linear regression, without the masses,
friction and stiffness of the robot, all of which hide a delay in a comparison of torques.

The equation is that of the model's servo, which `own_servo` has replaced if the robot has another
one. If it does not explain the torque, nothing is found.

    late = find_delays(recording, robot, runs)
    late.faults
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from faultgen.applied import Applied
from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.replay.servo_equation import ServoSignals, has_equation
from faultgen.effects import get_effect
from faultgen.errors import SimulationFailed
from faultgen.recordings.recording import LogFault, Recording
from faultgen.robot import Robot

DELAY = "delay"

_BLOCKS = 8  # parts of a recording that are left out in turn, for the standard error
_FEWEST = 25  # samples of a block
_EXPLAINED = 0.3  # torque error of the servo's equation, over the torque, up to which it holds
_SURE = 8.0  # delay over its standard error from which it counts: assumed
_PLAIN = 1e-3  # delay [s] that the equation has to show, before it is trusted alone: assumed
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
    are_all: bool = False
    """Whether the equation would show a delay of `_PLAIN` on every axis that moves, so that there
    are no others."""

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
    if not all(has_equation(one) for one in given):
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
    moves = np.isfinite(own.error)
    are_all = bool(moves.any() and (holds & (_SURE * error < _PLAIN))[moves].all())
    faults = tuple(
        LogFault(DELAY, k + 1, float(late[k]), (float(low[k]), float(high[k])))
        for k in np.flatnonzero(counts).tolist()
    )
    delays = Delays(faults, nothing.change, are_all)
    if not faults:
        return delays
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
    signals = ServoSignals(recording, robot)
    made, rate = signals.of_servo(robot)
    n = robot.n_axes
    delay, error = np.zeros(n), np.full(n, np.inf)
    holds, helps = np.zeros((2, n), bool)
    for axis, rows in enumerate(signals.rows):
        if len(rows) < _BLOCKS * _FEWEST:
            continue
        column = -rate[rows, axis][:, None]
        target = (signals.torque - made)[rows, axis]
        (delay[axis],), left, before = signals.regress(axis, column, target)
        holds[axis] = left < _EXPLAINED * signals.torque[rows, axis].std()
        helps[axis] = left < _BETTER * before
        apart = [
            signals.regress(
                axis, np.delete(column, block, 0), np.delete(target, block), np.delete(rows, block)
            )[0]
            for block in np.array_split(np.arange(len(rows)), _BLOCKS)
        ]
        error[axis] = np.sqrt((_BLOCKS - 1) * np.array(apart)[:, 0].var())
    for one in robot.effects:
        if one.effect == DELAY:  # the model has it
            delay[one.axis - 1] -= one.severity
    return _Late(delay, error, holds, helps)

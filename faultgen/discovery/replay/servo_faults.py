"""Late set points, and logs of a wrong gain or zero, from the servo's tracking error.

The torque of a servo follows from its set points and from the measured motion, whatever the arm is
(`servo_equation`). So three faults are found and told apart by linear regression (`servo_errors`),
without the masses, friction and stiffness of the robot, all of which hide them in a comparison of
torques. A motor that gives less torque than its drive believes is none of them: its drive logs what
the servo makes.

The equation is that of the model's servo, which `own_servo` has replaced if the robot has another
one. If it does not explain the torque, nothing is found.

    seen = find_servo_faults(recording, robot, runs)
    seen.faults
    recording = seen.corrected(recording)
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from faultgen.applied import Applied
from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.replay.servo_equation import has_equation
from faultgen.discovery.replay.servo_errors import (
    BLOCKS,
    DELAY,
    GAIN,
    OFFSET,
    SHOWN,
    ServoErrors,
    servo_errors,
)
from faultgen.effects import get_effect
from faultgen.effects.spreads import SPREADS
from faultgen.errors import SimulationFailed
from faultgen.inference.limits import LOG_UNUSUAL, SERVO_PLAIN, SERVO_SURE, SHORTEST_DELAY
from faultgen.recordings.finding import CORRECTED, TRUST, Finding
from faultgen.recordings.recording import LogFault, Recording, mean_of
from faultgen.robot import Robot

_WIDTH = 2.09  # of intervals in standard errors: 95 % of Student's t with `BLOCKS` - 1 degrees
_SCATTER = 1.48  # standard deviation over the median distance from the median, of normal numbers
_AXES = 3  # from which what all axes have in common can be told from what one has

assert BLOCKS == 20, "_WIDTH belongs to it"


@dataclass(frozen=True, eq=False)
class ServoFaults:
    """What the equation of the servo shows."""

    delays: tuple[LogFault, ...]
    """The delays of single axes that count."""
    change: np.ndarray
    """By how much the delays change the torque, shape (samples, n_axes), in [N m]."""
    log: tuple[LogFault, ...] = ()
    """Gains and offsets of the log that count: severities of `torque_constant`, the share of the
    log that is too much, and of `torque_offset`, in [N m] of the motor."""
    are_all: bool = False
    """Whether the equation would show a delay of `SERVO_PLAIN` on every axis that moves, so that
    there are no others."""

    @property
    def faults(self) -> tuple[LogFault, ...]:
        """All that counts."""
        return (*self.delays, *self.log)

    def applied(self) -> list[Applied]:
        """The delays as effects of a robot."""
        return [Applied(one.effect, one.axis, one.severity) for one in self.delays]

    def corrected(self, recording: Recording) -> Recording:
        """A recording of these sensors as if its torque log had none of the faults.

        Args:
            recording: The recording, motor side.
        """
        if not self.log:
            return recording
        gain, offset = np.ones(recording.n_axes), np.zeros(recording.n_axes)
        for one in self.log:
            if one.effect == GAIN:
                gain[one.axis - 1] = 1 - one.severity
            else:
                offset[one.axis - 1] = one.severity
        factor = np.array(recording.torque_factor or np.ones(recording.n_axes)) * gain
        torque = recording.torque * gain + offset
        return replace(recording, torque=torque, torque_factor=tuple(factor.tolist()))

    def findings(self) -> list[Finding]:
        """What is corrected in the log, in words."""
        texts = {
            GAIN: "the logged torque is {:.4g} times what the servo makes of the logged positions: "
            "it is divided by that",
            OFFSET: "the logged torque is {:.4g} N m more than the servo makes of the logged "
            "positions: this is subtracted",
        }
        shown = [
            (one, 1 / (1 - one.severity) if one.effect == GAIN else -one.severity)
            for one in self.log
        ]
        return [
            Finding(CORRECTED, one.axis, f"{texts[one.effect].format(number)}; {TRUST}")
            for one, number in shown
        ]


def no_servo_faults(recording: Recording) -> ServoFaults:
    """Return that nothing counts."""
    return ServoFaults((), np.zeros_like(recording.torque))


def find_servo_faults(
    recording: Recording,
    robot: Robot,
    runs: Sequence[Recording] = (),
    *,
    arm: Robot | None = None,
    exclude: Collection[str] = (),
    trust_log: bool = False,
) -> ServoFaults:
    """Find late set points, and wrong gains and zeros of the torque log.

    Args:
        recording: The measured data.
        robot: The model with the servo of the robot, and with the masses that its controller knows.
        runs: Recordings of the same motions from before the change. Without any, a fault counts if
            the other axes do not have it.
        arm: The model with the masses that the robot has, if they are others.
        exclude: Names of effects that are not told.
        trust_log: Whether gain and zero of the log count as right.

    Returns:
        What is found; nothing if the recording has no commanded position or no torque of the
        motors, or if the torque is not what the model's servo makes of them.
    """
    nothing = no_servo_faults(recording)
    if not all(has_equation(one) for one in (recording, *runs)):
        return nothing
    limits, before = robot.motor_torque_limit, mean_of(runs) if runs else None

    def beyond(one: Recording) -> np.ndarray:
        torque = Replay(one, robot if arm is None else arm).torque()
        return np.asarray(one.torque - torque) / robot.torque_gain

    known = bool(robot.set_points[2])  # what a controller knows is in its feed-forward torque
    base = 0.0 if before is None or not known else beyond(before)

    def errors(one: Recording) -> ServoErrors:
        return servo_errors(one, robot, before, beyond(one) - base if known else None)

    own = errors(recording)
    if runs:
        among = [errors(run).value for run in runs if len(runs) > 1]
        value, error = own.value, own.error
        if among:
            error = np.hypot(error, np.std(among, axis=0, ddof=1))
    else:
        if own.holds.sum() < max(_AXES, robot.n_axes / 2):
            return nothing
        value, error = _beside_others(own, limits)
    untold = set(exclude)
    if trust_log or (not runs and recording.constants is not None):
        untold |= {GAIN, OFFSET}
    counts = _counting(own, value, error, limits)
    by_column = np.array([1.0, 0.0, 0.0])[:, None] * np.where(own.holds, own.misfit, 0)
    width = _WIDTH * np.hypot(error, value * by_column)  # the rate is as right as the equation
    # a torque on the rotor that spares the motor torque is positive
    unit = np.stack([np.ones_like(limits), np.ones_like(limits), -robot.torque_gain])
    found = {
        name: tuple(
            LogFault(name, k + 1, float(one[k]), (float(one[k] - by[k]), float(one[k] + by[k])))
            for k in np.flatnonzero(count).tolist()
            if name not in untold
        )
        for name, one, by, count in zip(
            SHOWN, value * unit, width * np.abs(unit), counts, strict=True
        )
    }
    moves = np.isfinite(own.error[0])
    shown = own.holds & (SERVO_SURE * error[0] < SERVO_PLAIN)
    are_all = bool(moves.any() and shown[moves].all() and DELAY not in untold)
    seen = ServoFaults(found[DELAY], nothing.change, found[GAIN] + found[OFFSET], are_all)
    if not seen.delays:
        return seen
    replay = Replay(recording, robot if arm is None else arm, measured=False)
    try:
        change = replay.with_effects(seen.applied()).torque() - replay.torque()
    except SimulationFailed:
        return replace(seen, delays=(), are_all=False)
    return replace(seen, change=change)


def _beside_others(own: ServoErrors, limits: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values and standard errors of each axis against the median of all.

    What the model does not know of the controller, such as masses within its feed-forward torque,
    differs from axis to axis, so that their scatter is an error of each.
    """
    scale = np.stack([np.ones_like(limits), np.ones_like(limits), _finite(limits)])
    value, error = own.value / scale, own.error / scale
    for k in range(len(SHOWN)):
        used = own.holds & np.isfinite(error[k])
        if used.any():
            middle = np.median(value[k, used])
            scatter = _SCATTER * np.median(np.abs(value[k, used] - middle))
            value[k] -= middle
            error[k] = np.hypot(error[k], max(scatter, np.median(error[k, used])))
    return value * scale, error * scale


def _counting(
    own: ServoErrors, value: np.ndarray, error: np.ndarray, limits: np.ndarray
) -> np.ndarray:
    """Which values count as faults, shape (3, n_axes)."""
    smallest = np.array(
        [
            np.full_like(limits, SHORTEST_DELAY),
            np.full_like(limits, LOG_UNUSUAL * SPREADS[GAIN].std),
            LOG_UNUSUAL * SPREADS[OFFSET].std * _finite(limits),
        ]
    )
    largest = np.array([[get_effect(name).largest] for name in SHOWN])
    size = np.abs(value)
    clear = (size > np.maximum(SERVO_SURE * error, smallest)) & (size <= largest)
    return np.asarray(own.holds & own.helps & clear)


def _finite(limits: np.ndarray) -> np.ndarray:
    """Torque limits of the motors [N m]; 1 N m where there is none."""
    return np.where(np.isfinite(limits), limits, 1.0)

"""What the equation of the servo shows of the delay, the log's gain and its offset, of each axis.

    torque = (1 - s) logged - c = servo's torque - d (rate of what comes from the set points)

with the share s of the log that is too much, the error c of its zero and the delay d of the set
points. All three are found by one regression, because each alone takes in the others: a log whose
gain is 15 % off would look like a delay.

With a healthy recording of the same motions, the errors of the two equations are subtracted. So
all cancels that the model does not know of the controller, such as the masses within its
feed-forward torque, and what is left is what has changed. The gain of a log that is wrong on both
days does not cancel where the torques differ: it is a share of this difference, which is taken into
account if that leaves less than the three.

A controller may also have learned another friction, which would look like a delay. The friction
that the robot has beyond that of the model, or of the healthy recording, is seen at its measured
motion, whatever the servo is. The share of it that the controller knows is found by the same
regression. Without a healthy recording, the controller may also know less viscous friction than the
model; a delay must then show in more than a torque that follows the commanded speed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from faultgen.discovery.replay.servo_equation import ServoSignals
from faultgen.recordings.recording import Recording
from faultgen.robot import Robot

DELAY, GAIN, OFFSET = "delay", "torque_constant", "torque_offset"
SHOWN = (DELAY, GAIN, OFFSET)
"""Effects of the catalogue that the equation tells apart, in the order of the arrays."""

BLOCKS = 20
"""Parts of a recording that are left out in turn. Of 8, standard errors are known to a quarter
only, and more than 3 of them are then usual (28 recordings of the sealed simulator)."""
_FEWEST = 10  # samples of a block
_EXPLAINED = 0.3  # torque error of the servo's equation, over the torque, up to which it holds
_BETTER = 0.9  # torque error of the equation with one of the three, over that without: assumed
_WRONG = 0.25  # share of a log that may be too much on both days: assumed
_STEPS = (0.003, 0.01, 0.03, 0.1, 0.3)
"""Speeds over which friction may turn its sign, over the largest speed: assumed, each about three
times the one before."""
_SATURATED = 0.95  # of the torque limit, from which the servo gets less than it asks for: assumed


@dataclass(frozen=True, eq=False)
class ServoErrors:
    """What the equation of the servo says of each axis."""

    value: np.ndarray
    """Delay [s], share of the log that is too much, error of its zero at the motor [N m]; shape
    (3, n_axes). 0 where the recording does not show it."""
    error: np.ndarray
    """Standard errors, from leaving out blocks in turn, same shape; infinite where it does not."""
    holds: np.ndarray
    """Whether the equation explains the torque, shape (n_axes,)."""
    helps: np.ndarray
    """Whether it does so clearly better with each of the three than without, shape (3, n_axes).
    Never with a gain of the log, where no feed-forward torque tells it from kp and kd."""
    misfit: np.ndarray
    """What the equation leaves over the torque, shape (n_axes,)."""


class _Equation:
    """The equation of one recording. Arrays have shape (samples, n_axes)."""

    def __init__(self, recording: Recording, robot: Robot) -> None:
        self.signals = ServoSignals(recording, robot)
        self.made = self.signals.of_servo(robot)
        self.lacks = self.signals.torque - self.made.torque
        free = np.abs(self.made.torque) < _SATURATED * robot.motor_torque_limit
        self.rows = [rows[free[rows, k]] for k, rows in enumerate(self.signals.rows)]

    def friction(self, axis: int, beyond: np.ndarray) -> np.ndarray:
        """The part of a torque of an axis that is an odd function of its motor speed."""
        speed, rows = self.signals.speed[:, axis], self.rows[axis]
        share = speed / max(float(np.abs(speed).max()), 1e-12)
        steps = [np.tanh(share / one) for one in _STEPS]
        logged = self.signals.torque[:, axis]  # a gain of the log is no friction
        columns = np.stack([*steps, share, share * np.abs(share), logged], axis=1)
        values, _, _ = self.signals.regress(axis, columns[rows], beyond[rows, axis], rows)
        return np.asarray(columns[:, :-1] @ values[:-1])

    def holds(self, axis: int, rows: np.ndarray) -> tuple[bool, float]:
        """Whether it explains the logged torque of an axis, and what it leaves of it."""
        size = self.signals.torque[rows, axis].std()
        late = -self.made.rate[rows, axis][:, None]
        left = self.signals.regress(axis, late, self.lacks[rows, axis], rows)[1]
        return bool(left < _EXPLAINED * size), left / max(size, 1e-12)


def servo_errors(
    recording: Recording,
    robot: Robot,
    before: Recording | None = None,
    beyond: np.ndarray | None = None,
) -> ServoErrors:
    """Find delays, gains and offsets of the log from the equation of the servo.

    Args:
        recording: The measured data, see `has_equation`.
        robot: The model, with the servo of the robot.
        before: A recording of the same motions, with which it is compared. None: with the model.
        beyond: Torque that the motors bear at the measured motion beyond that of the model, or of
            `before`, shape (samples, n_axes), in [N m]. The controller may know a share of the
            friction in it. None: it knows none.

    Returns:
        What it shows; with `before`, what has changed.
    """
    now = _Equation(recording, robot)
    other = None if before is None else _Equation(before, robot)
    n = robot.n_axes
    value, error = np.zeros((3, n)), np.full((3, n), np.inf)
    holds, helps, misfit = np.zeros(n, bool), np.zeros((3, n), bool), np.full(n, np.inf)
    if beyond is not None:
        beyond = recording.derivatives(beyond)[0]
    has_integral = now.made.integral > 0
    for axis in range(n):
        rows, target = now.rows[axis], now.lacks[:, axis]
        if other is not None:
            rows = np.intersect1d(rows, other.rows[axis])
            target = target - other.lacks[:, axis]
        if len(rows) < BLOCKS * _FEWEST:
            continue
        told = [one.holds(axis, rows) for one in (now, other) if one is not None]
        holds[axis] = all(does for does, _ in told)
        misfit[axis] = told[-1][1]
        # what an integral held before a recording began is not known
        starts = _starts(now.signals.number[rows], other is None or has_integral[axis])
        shown = [-now.made.rate[rows, axis], now.signals.torque[rows, axis], np.ones(len(rows))]
        friction = None
        if beyond is not None:
            friction = now.friction(axis, beyond)[rows]
        # without a healthy recording, viscous friction of the controller is not known either
        known = [now.signals.rate[rows, axis]] if other is None and beyond is not None else []
        targets = [target[rows]]
        if other is not None:  # a log that is wrong on both days shows where the torques differ
            differs = now.signals.torque[rows, axis] - other.signals.torque[rows, axis]
            own = _Fit(np.column_stack([differs, shown[0], shown[2], starts]), targets[0])
            share = own.values()[0]
            if abs(share) < _WRONG:
                targets.append(targets[0] - share * differs)
        fits = [_fitted(one, shown, known, friction, starts) for one in targets]
        fit = min(fits, key=_Fit.left)
        value[:, axis] = fit.values()[:3]
        apart = [fit.values(without=block)[:3] for block in range(BLOCKS)]
        error[:, axis] = np.sqrt((BLOCKS - 1) * np.var(apart, axis=0))
        helps[:, axis] = [fit.left() < _BETTER * fit.left(but=k) for k in range(3)]
        if not robot.set_points[2]:  # other gains kp and kd would explain the same
            helps[1, axis] = False
        if has_integral[axis]:
            value[2, axis], error[2, axis], helps[2, axis] = 0.0, np.inf, False
    for one in robot.effects:
        if one.effect == DELAY and before is None:  # the model has it
            value[0, one.axis - 1] -= one.severity
    return ServoErrors(value, error, holds, helps, misfit)


def _fitted(
    target: np.ndarray,
    shown: Sequence[np.ndarray],
    known: Sequence[np.ndarray],
    friction: np.ndarray | None,
    starts: np.ndarray,
) -> _Fit:
    """The fit of what is shown beside the friction that a controller knows a share of."""
    columns = [*shown, *known]
    if friction is not None:
        fit = _Fit(np.column_stack([*shown, friction, *known, starts]), target)
        share = fit.values()[len(shown)]
        if 0 <= share <= 1:
            columns.append(friction)
        else:  # a controller knows none of it, or all
            target = target - np.clip(share, 0, 1) * friction
    return _Fit(np.column_stack([*columns, starts]), target)


def _starts(number: np.ndarray, apart: bool) -> np.ndarray:
    """Columns with which each separate recording but the first has its own constant."""
    parts = np.unique(number)[1:] if apart else np.zeros(0)
    own = (number[:, None] == parts).astype(float)
    return np.asarray(own - own.mean(axis=0))


class _Fit:
    """Least-squares fits of some columns, and those without a block, from sums over the blocks."""

    def __init__(self, columns: np.ndarray, target: np.ndarray) -> None:
        self._size = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        both = np.column_stack([columns / self._size, target])
        self._blocks = np.array([x.T @ x for x in np.array_split(both, BLOCKS)])
        self._all = self._blocks.sum(axis=0)

    def values(self, but: int | None = None, without: int | None = None) -> np.ndarray:
        """Values of all columns but one, in their order, without one of the blocks."""
        sums = self._all if without is None else self._all - self._blocks[without]
        kept = [k for k in range(len(self._size)) if k != but]
        square, product = sums[np.ix_(kept, kept)], sums[kept, -1]
        return np.asarray(np.linalg.lstsq(square, product, rcond=None)[0] / self._size[kept])

    def left(self, but: int | None = None) -> float:
        """Root of the squared sum of what all columns but one leave."""
        kept = [k for k in range(len(self._size)) if k != but]
        explained = self.values(but) * self._size[kept] @ self._all[kept, -1]
        return float(np.sqrt(max(self._all[-1, -1] - explained, 0.0)))

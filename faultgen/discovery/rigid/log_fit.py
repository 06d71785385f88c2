"""How well a recorded torque fits an arm that can exist, for either sign and any gain of the log.

    fit = LogFit(recording, robot)
    np.diff(fit.misfit(axis, np.array([1.0, -1.0])))  # twice the log likelihood ratio of the signs

The torque of an axis at its gearbox is `gain` times

    model + D z + J a + Fc sign(v) + Fv v + offset

Here `model` is the torque of the given links, D z that of their errors with z ~ N(0, 1), J the
rotor inertia, v and a speed and acceleration of the axis. The errors are generous, so that wrong
masses and a payload that the model lacks, off its centre too, are possible. J, Fc and Fv are not
negative: rotors are heavy, and friction brakes. This is what tells a sign. Each axis has link
errors of its own, so that a wrong axis does not spoil the others.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np

from faultgen.discovery.rigid.free_fit import BLOCKS, independent, left_by
from faultgen.discovery.terms.inertia import size_of
from faultgen.discovery.terms.regressor import gear_regressor, link_ids
from faultgen.effects.prior import torque_offset_std
from faultgen.recordings.checks import STILL
from faultgen.recordings.recording import Recording
from faultgen.robot import Robot
from faultgen.simulation.arm import Arm

LINKS = 0.5
"""Standard deviation of masses, first moments and inertias of links, as a share of them: assumed.
Models out of CAD data and URDF files are often as wrong as that."""

PAYLOAD, OFF_CENTRE = 0.1, 0.1
"""Mass of a payload that the model lacks over that of the arm, and its distance from the last frame
over the length of the arm; standard deviations, assumed. `robot build` assumes the same mass."""

PARTS = 0.1
"""Error of an identified rigid arm over the torques of its links, before they cancel each other:
assumed. Published fits of real arms are wrong by 4 to 22 %."""

_SAMPLES = 2000  # of a recording, at which it is compared: enough, and quick
_SLOW = 0.05  # of the largest speed, from which friction counts as that of sliding
_QUICKEST = 0.99  # share of the samples that are slower than what counts as the largest speed
_EDGE = 0.06  # time at both ends of a motion whose derivatives are not used [s]
_LOOSE = 3.0  # standard deviation of friction, over what alone would explain the torque: assumed
_OFFSETS, _OFFSET_SHARE = 10.0, 0.05  # offset of an unknown sensor, over a usual one; over torque
_PER_PIECE = 3.0  # independent errors in each piece of motion at most: assumed
_ROUNDING = 1e-12  # of products of columns that depend on each other, over the largest
_ACCURACIES = (1.0, 0.3, 0.1)  # of the links' errors over those above: with wide errors alone, a
# gain would come out too small where they make more torque than the links do
_ROUNDS = 3  # in which the noise of a hypothesis settles


@dataclass(frozen=True, eq=False)
class _Axis:
    """What is known of one axis where it moves."""

    at: np.ndarray
    """Which samples of the fit, shape (samples,)."""
    columns: np.ndarray
    """For each error of the links of one standard deviation the torque of the gearbox [N m]; then
    1, the direction, the speed, the acceleration, and the torques of the model and the log [N m];
    shape (samples, errors + 6)."""
    noise: float
    """Variance that free parameters leave on blocks that were not fitted [(N m)^2]."""
    pieces: float
    """Number of independent errors."""

    @property
    def torque(self) -> np.ndarray:
        """Measured torque, shape (samples,)."""
        return self.columns[:, -1]

    @cached_property
    def gram(self) -> np.ndarray:
        """Mean products of the columns."""
        return np.asarray(self.columns.T @ self.columns / len(self.columns))

    @cached_property
    def principal(self) -> tuple[np.ndarray, np.ndarray]:
        """The mean products with uncorrelated errors of the links, and the mean squares of these.

        Combinations of errors that make no torque are left out.
        """
        count = len(self.gram) - 6
        square, basis = np.linalg.eigh(self.gram[:count, :count])
        seen = square > _ROUNDING * square.max(initial=0.0)
        turn = np.eye(len(self.gram))
        turn = np.column_stack([turn[:, :count] @ basis[:, seen], turn[:, count:]])
        return np.asarray(turn.T @ self.gram @ turn), square[seen]


class LogFit:
    """The torque of a recording against the arm of a model."""

    def __init__(self, recording: Recording, robot: Robot) -> None:
        """Compute the columns of the fit.

        Args:
            recording: The measured data, in units of torque.
            robot: The model.
        """
        self.recording, self.robot = recording, robot
        n, arm = robot.n_axes, Arm(robot)
        q, qd, qdd = recording.derivatives(recording.joint_position(robot))
        speed = robot.gearing.outputs(qd)
        slow = _SLOW * np.quantile(np.abs(speed), _QUICKEST, axis=0)
        moving = np.abs(speed) > np.maximum(slow, 1e-9)
        moving[:, np.ptp(q, axis=0) < STILL] = False
        inner = np.zeros(len(q), bool)
        edge = max(2, round(_EDGE / recording.sample_period))
        for part in recording.parts:
            inner[part.start + edge : max(part.stop - edge, part.start)] = True
        rows = np.flatnonzero(inner & moving.any(axis=1))
        self.rows = rows[:: max(1, len(rows) // _SAMPLES)]
        """Indices of the samples."""
        rows = self.rows
        self.measured = gear_torque(recording, robot)
        """Torque of the gearboxes, smoothed, shape (all samples, n_axes), in [N m]."""
        still = np.zeros((len(rows), n))
        self.gravity = robot.gearing.torque(arm.inverse_dynamics(q[rows], still, still))
        """Torque that holds the model, shape (rows, n_axes)."""
        self.model = robot.gearing.torque(arm.inverse_dynamics(q[rows], qd[rows], qdd[rows]))
        self.speed, self.acceleration = speed[rows], robot.gearing.outputs(qdd)[rows]
        self.rotor = robot.model.dof_M0[list(robot.motors)] * robot.gear_ratio**2
        """Inertia of each rotor at its gearbox [kg m^2]."""
        usual = np.array([torque_offset_std(robot, k + 1) for k in range(n)])
        self.offset = _OFFSETS * usual * np.abs(robot.gear_ratio)
        """Standard deviation of each offset [N m]."""
        links = gear_regressor(arm, q[rows], qd[rows], qdd[rows]) * _link_errors(arm, n)
        self.axes = [self._axis(k, moving[rows, k], links[:, k]) for k in range(n)]

    def _axis(self, axis: int, moving: np.ndarray, links: np.ndarray) -> _Axis | None:
        """Gather what is known of an axis; None if it hardly moves, or its torque is constant."""
        at = np.flatnonzero(moving)
        torque = self.measured[self.rows[at], axis]
        if len(at) < 2 * BLOCKS or np.ptp(torque) == 0:
            return None
        seen = np.flatnonzero(np.abs(links).max(axis=0) > 0)
        speed, acceleration = self.speed[at, axis], self.acceleration[at, axis]
        drive = [np.ones_like(speed), np.sign(speed), speed, acceleration]
        columns = np.column_stack([links[np.ix_(at, seen)], *drive, self.model[at, axis], torque])
        given = _Axis(at, columns, 0.0, 1.0)
        left, around = self._held_out(axis, given), torque - torque.mean()
        noise = float(min(np.mean(left**2), np.mean(around**2)))
        pieces = min(independent(left), _PER_PIECE * independent(around))
        return replace(given, noise=noise, pieces=pieces)

    def _held_out(self, axis: int, given: _Axis) -> np.ndarray:
        """Error of each block of a fit of the other blocks, whose parameters may have any value.

        The axis may also share friction with its neighbours, as in a wrist.
        """
        torque, speed = given.torque, self.speed[given.at, axis]
        shared = []
        for other in (axis - 1, axis + 1):
            if 0 <= other < self.robot.n_axes:
                theirs = self.speed[given.at, other]
                shared += [np.sign(speed + theirs), np.sign(speed - theirs), theirs]
        few = given.columns[:, -6:-1]
        best = torque - torque.mean()
        for x in (few, np.column_stack([given.columns[:, :-1], *shared])):
            left = left_by(x, torque)
            if np.sum(left**2) < np.sum(best**2):
                best = left
        return best

    def error(self, axis: int) -> float:
        """Compute the error of free parameters on blocks that were not fitted.

        Args:
            axis: From 0; one that is not None in `axes`.

        Returns:
            RMS error over the standard deviation of the torque, at most 1.
        """
        given = self._of(axis)
        return float(np.sqrt(given.noise) / given.torque.std())

    def parts(self, axis: int) -> float:
        """Compute the torque of the links before they cancel each other, over that measured."""
        gram = self._of(axis).gram
        return float(np.sqrt(np.trace(gram[:-6, :-6]) / gram[-1, -1]) / LINKS)

    def misfit(
        self, axis: int, gain: float | np.ndarray, *, links: bool = True, parts: bool = True
    ) -> np.ndarray:
        """Compute minus two times the log likelihood of gains of the log, but for a constant.

        Args:
            axis: From 0; one that is not None in `axes`.
            gain: Logged torque over the torque, shape (gains,) or a number; negative if its sign
                is reversed.
            links: Whether the arm is part of the torque; otherwise it is friction only.
            parts: Whether the error of the model grows with the torques of its links (`PARTS`);
                otherwise it is the same share of the measured torque, which favours no gain, and
                the links may be as accurate as the data show.

        Returns:
            The misfits, shape (gains,); differences between hypotheses of the same `parts` have a
            meaning.
        """
        given, gains = self._of(axis), np.atleast_1d(np.asarray(gain, float))
        accuracies = _ACCURACIES[:1] if parts or not links else _ACCURACIES
        found = [self._misfit(given, axis, gains, links, parts, one) for one in accuracies]
        return np.asarray(np.min(found, axis=0))

    def _misfit(
        self,
        given: _Axis,
        axis: int,
        gain: np.ndarray,
        links: bool,
        parts: bool,
        accuracy: float,
    ) -> np.ndarray:
        """Misfits for one accuracy of the links, shape (gains,).

        The links are uncorrelated in the basis of `_Axis.principal`, whatever the noise, which
        leaves a small problem of offset, friction and rotor inertia.
        """
        gram, error = given.principal
        if not links:
            gram, error = gram[-6:, -6:], error[:0]
        count = len(error)
        error = error * accuracy**2
        least = given.noise / gain**2
        if not parts:
            least = least + (PARTS * given.torque.std() / gain) ** 2
        elif links:
            least = least + (PARTS / LINKS) ** 2 * float(given.gram.diagonal()[:-6].sum())
        size = np.sqrt(np.maximum(gram.diagonal(), 1e-24))
        rms = size[-1] / np.abs(gain)
        rotor = links and not self.recording.link
        # standard deviation of offset, friction and rotor inertia, the last of which is expected
        scale = np.column_stack(
            [
                self.offset[axis] + _OFFSET_SHARE * rms,
                *(_LOOSE * rms / one for one in size[count + 1 : count + 3]),
                *([np.full(len(gain), self.rotor[axis])] if rotor else []),
            ]
        )
        few = slice(count, count + scale.shape[1])
        expected = np.zeros(scale.shape[1])
        expected[3:] = 1.0
        model = np.zeros((len(gain), len(gram)))  # of what is left of the torque
        model[:, -2], model[:, -1] = -float(links), 1 / gain
        shown = model @ gram
        square = np.sum(shown * model, axis=1)
        right = [accuracy * shown[:, :count], scale * shown[:, few]]
        inner = scale[:, :, None] * gram[few, few] * scale[:, None, :]
        across = accuracy * gram[:count, few] * scale[:, None, :]
        noise = least
        for _ in range(_ROUNDS):
            weight = (given.pieces / noise)[:, None]
            known = weight * error + 1.0  # precision of the links
            force = weight * right[0] / known
            lever = weight[:, :, None] * across / known[:, :, None]
            system = weight[:, :, None] * (inner - across.mT @ lever) + np.eye(len(expected))
            target = weight * (right[1] - np.einsum("gce,gc->ge", across, force)) + expected
            some = _not_negative(system, target)
            value = force - np.einsum("gce,ge->gc", lever, some)
            left = square - 2 * np.sum(value * right[0], axis=1) - 2 * np.sum(some * right[1], 1)
            left += value**2 @ error + 2 * np.einsum("gc,gce,ge->g", value, across, some)
            left += np.einsum("ge,gef,gf->g", some, inner, some)
            noise = np.maximum(left, least)
        distance = np.sum(value**2, axis=1) + np.sum((some - expected) ** 2, axis=1)
        volume = np.log1p(weight * error).sum(axis=1)
        return np.asarray(given.pieces * np.log(noise * gain**2) + distance + volume)

    def _of(self, axis: int) -> _Axis:
        given = self.axes[axis]
        assert given is not None
        return given


def _not_negative(system: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Minima of quadratic functions of an offset and of numbers that are not negative.

    The minimum is the best of those with each choice of numbers that are zero.

    Args:
        system: Positive definite, shape (functions, values, values); the offset comes first.
        right: Shape (functions, values).

    Returns:
        Shape (functions, values).
    """
    best, least = np.zeros_like(right), np.full(len(right), np.inf)
    count = right.shape[1]
    for free in product((True, False), repeat=count - 1):
        at = np.flatnonzero([True, *free])
        value = np.zeros_like(right)
        value[:, at] = np.linalg.solve(system[:, at[:, None], at], right[:, at, None])[..., 0]
        cost = np.where(np.all(value[:, 1:] >= 0, axis=1), -np.sum(value * right, axis=1), np.inf)
        better = cost < least
        best[better], least[better] = value[better], cost[better]
    return best


def gear_torque(recording: Recording, robot: Robot) -> np.ndarray:
    """Return the torque of the gearboxes, smoothed as the motion is.

    Args:
        recording: The recording, in units of torque.
        robot: The model.

    Returns:
        Shape (samples, n_axes), in [N m].
    """
    torque = recording.derivatives(recording.torque)[0]
    if not recording.link:
        torque = torque * robot.torque_gain
    if recording.side == "motor":
        return np.asarray(torque * robot.gear_ratio)
    return np.asarray(robot.gearing.torque(torque))


def _link_errors(arm: Arm, n_axes: int) -> np.ndarray:
    """Standard deviations of `regressor.link_parameters`, shape (10 bodies,)."""
    model, ids = arm.model, link_ids(arm)
    std = np.empty((len(ids), 10))

    def of(mass: float, size: float) -> np.ndarray:
        return mass * np.array([1.0, *[size] * 3, *[size**2] * 6])

    for row, body in zip(std, ids, strict=True):
        mass = float(model.body_mass[body])
        size = size_of(mass, model.body_inertia[body], model.body_ipos[body])
        row[:] = of(LINKS * mass, size)
    length = float(np.linalg.norm(model.body_pos[1:], axis=1).sum())
    carried = of(PAYLOAD * float(model.body_mass[ids].sum()), OFF_CENTRE * length)
    std[n_axes - 1] = np.hypot(std[n_axes - 1], carried)
    return std.ravel()

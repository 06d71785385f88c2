"""How well a recorded torque fits an arm that can exist, for either sign and any gain of the log.

    fit = LogFit(recording, robot)
    fit.misfit(axis, -1.0) - fit.misfit(axis, 1.0)  # twice the log likelihood ratio of the signs

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

import numpy as np

from faultgen.discovery.fit.bounded import bounded_minimum
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

    def misfit(self, axis: int, gain: float, *, links: bool = True, parts: bool = True) -> float:
        """Compute minus two times the log likelihood of a gain of the log, but for a constant.

        Args:
            axis: From 0; one that is not None in `axes`.
            gain: Logged torque over the torque; negative if its sign is reversed.
            links: Whether the arm is part of the torque; otherwise it is friction only.
            parts: Whether the error of the model grows with the torques of its links (`PARTS`);
                otherwise it is the same share of the measured torque, which favours no gain, and
                the links may be as accurate as the data show.

        Returns:
            The misfit; differences between hypotheses of the same `parts` have a meaning.
        """
        pieces = self._of(axis).pieces
        found = [
            self._solve(axis, gain, links, parts, accuracy)
            for accuracy in (_ACCURACIES[:1] if parts or not links else _ACCURACIES)
        ]
        return min(
            float(pieces * np.log(noise * gain**2) + distance + volume)
            for noise, distance, volume in found
        )

    def _solve(
        self, axis: int, gain: float, links: bool, parts: bool, accuracy: float = 1.0
    ) -> tuple[float, float, float]:
        """Noise of a hypothesis, distance of its parameters from the model, and their volume."""
        given = self._of(axis)
        gram, count = given.gram, len(given.gram) - 6
        size = np.sqrt(np.maximum(np.diag(gram), 1e-24))
        rms = size[-1] / abs(gain)
        least = given.noise / gain**2
        if not parts:
            least += (PARTS * given.torque.std() / gain) ** 2
        elif links:
            least += (PARTS / LINKS) ** 2 * float(np.trace(gram[:count, :count]))
        # standard deviation of each factor, and what is expected, both in this unit
        scale = np.ones(count + 4)
        scale[:count] = accuracy
        scale[count] = self.offset[axis] + _OFFSET_SHARE * rms
        scale[count + 1 : count + 3] = _LOOSE * rms / size[count + 1 : count + 3]
        scale[count + 3] = self.rotor[axis]
        expected = np.zeros(count + 4)
        expected[-1] = 1.0
        use = np.ones(count + 4, bool)
        use[:count], use[-1] = links, links and not self.recording.link
        low = np.where(np.arange(count + 4)[use] > count, 0.0, -np.inf)
        high = np.full(len(low), np.inf)
        scale, expected = scale[use], expected[use]
        model = np.append(np.zeros(len(gram) - 2), [-float(links), 1 / gain])  # of what is left
        own = np.flatnonzero(use)
        inner = gram[np.ix_(own, own)] * np.outer(scale, scale)
        right, square = scale * (gram[own] @ model), float(model @ gram @ model)
        noise = least
        for _ in range(_ROUNDS):
            weight = given.pieces / noise
            system = weight * inner
            system += (1 + _ROUNDING * np.diag(system).max()) * np.eye(len(own))
            value = bounded_minimum(system, weight * right + expected, low, high)
            error = square - 2 * value @ right + value @ inner @ value
            noise = max(float(error), least)
        distance = float(np.sum((value - expected) ** 2))
        some = slice(count if links else 0)
        curved = np.linalg.eigvalsh(weight * inner[some, some])
        volume = float(np.log1p(np.maximum(curved, 0.0)).sum())
        return noise, distance, volume

    def _of(self, axis: int) -> _Axis:
        given = self.axes[axis]
        assert given is not None
        return given


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

"""The torque of a recording as a linear function of all parameters, without simulation.

The measured motion is smoothed and differentiated. The motor torques of a rigid arm are then linear
in the inertial parameters of the links and, for each axis, in rotor inertia, Coulomb friction,
viscous friction and a constant offset. The servo does not matter. `base_parameters.identify` solves
for the parameters; both together are classical identification.

    regression = Regression(read_recording("measured.h5"), load_robot("model.xml"))
    regression.torque(identify(regression.products))  # that the identified parameters predict

Source: Gautier (1997) for the filters, which are the same for torque and regressor.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, filtfilt

from faultgen.discovery.replay.followed import followed_by_rigid_arm
from faultgen.discovery.replay.replay import settled
from faultgen.discovery.replay.samples import blocks, counted
from faultgen.discovery.rigid.base_parameters import Products, identify
from faultgen.discovery.terms.regressor import link_parameters, link_regressor
from faultgen.recordings.recording import Recording
from faultgen.robot import COULOMB, STICTION, STRIBECK_VELOCITY, Robot
from faultgen.simulation.arm import Arm

CUT_OFF = 20.0
"""Cut-off frequency of the filters [Hz]: assumed. Robots move at lower frequencies, and their
resonances and most of the noise lie above."""

_MOTION = 5.0  # cut-off of the filter of the motion, in cut-offs of torque and regressor: assumed

DRIVE = ("rotor inertia", "Coulomb", "viscous", "offset")
"""Parameters of each axis, motor side: [kg m^2], [N m], [N m s/rad], [N m]."""

COUPLING = ("inertia", "Coulomb", "viscous")
"""Parameters of a coupling, joint side: [kg m^2], [N m], [N m s/rad]."""

STATIC = 3.0
"""Largest static over Coulomb friction that is physical: assumed. The robots of this project have
1.2 to 2.3; the largest is that of the ABB IRB 6700 after Bittencourt et al. 2010."""

_EDGE = 1.0  # time at the ends of a recording that is not used, in periods of the cut-off
_CHUNK = 20_000  # samples of which the regressor is in memory
_PADDING = 15  # samples that a filter needs beyond each end


@dataclass(frozen=True)
class Coupling:
    """Friction and inertia that two neighbouring axes share, as in a wrist.

    They act on the speed of an axis plus `ratio` times that of the axis before. Both speeds are
    those of the motors over their gear ratios.
    """

    axis: int
    """The later axis of the two, from 2."""
    ratio: float
    """1 for the sum of the speeds, -1 for the difference."""


class Regression:
    """The regressor of a recording, and its inner products with the measured torque.

    The columns are the ten parameters of each link (`regressor.link_parameters`), `DRIVE` for each
    axis, and `COUPLING` for each coupling. What else the model has, such as springs, the payload
    and the rise of friction at low speed, counts as known. Where Coulomb friction is far from that
    of the model, so that this rise would make static friction impossible, the rise is in
    proportion to it (`possible_regression`).
    """

    def __init__(
        self,
        recording: Recording,
        robot: Robot,
        *,
        couplings: Sequence[Coupling] = (),
        cut_off: float = CUT_OFF,
        scaled: np.ndarray | None = None,
    ) -> None:
        """Compute the inner products of all blocks.

        Args:
            recording: The measured data.
            robot: The model, for the kinematics and the gear ratios.
            couplings: Couplings with columns.
            cut_off: Cut-off frequency of the filters [Hz].
            scaled: Axes on which static friction keeps its ratio to Coulomb friction, mask of shape
                (n_axes,). Default: none.
        """
        self.recording = recording
        self.robot = robot
        self.couplings = tuple(couplings)
        self.cut_off = cut_off
        self.scaled = np.zeros(robot.n_axes, bool) if scaled is None else scaled
        """Axes on which static friction keeps its ratio to Coulomb friction."""
        self.gearing = robot.gearing.matrix
        self.parts = blocks(recording, robot)
        """Blocks, each a slice of samples."""
        self.inside = (
            counted(recording, robot, baseline=False) & _inner(recording, cut_off)[:, None]
        )
        """Samples that are used, shape (samples, n_axes)."""
        self._arm = Arm(robot)
        self._nominal = link_parameters(self._arm)
        joint = recording.position
        if recording.side == "motor":
            joint = np.linalg.solve(self.gearing, joint.T).T
        joint = followed_by_rigid_arm(recording, robot, settled(recording, robot), joint)
        self._motion = np.empty((3, *joint.shape))
        for part in recording.parts:
            smooth = _low_pass(joint[part], recording.sample_period, _MOTION * cut_off)
            spline = CubicSpline(np.arange(len(smooth)) * recording.sample_period, smooth)
            for order in range(3):
                self._motion[order, part] = spline(spline.x, order)
        self.products = self._products()

    @property
    def size(self) -> int:
        """Number of parameters."""
        n = self.robot.n_axes
        return len(self._nominal) + len(DRIVE) * n + len(COUPLING) * len(self.couplings)

    def drive(self, name: str) -> np.ndarray:
        """Columns of a parameter of the drives, by axis.

        Args:
            name: One of `DRIVE`.

        Returns:
            Indices, shape (n_axes,).
        """
        first = len(self._nominal) + DRIVE.index(name)
        return first + len(DRIVE) * np.arange(self.robot.n_axes)

    def coupling(self, number: int) -> np.ndarray:
        """Columns of a coupling, in the order of `COUPLING`.

        Args:
            number: Number of the coupling, from 0.

        Returns:
            Indices, shape (3,).
        """
        first = self.size - len(COUPLING) * (len(self.couplings) - number)
        return first + np.arange(len(COUPLING))

    def torque(self, value: np.ndarray) -> np.ndarray:
        """Predict the torque of the recorded motion.

        Args:
            value: Parameters, shape (size,).

        Returns:
            Torque on the recording's side and in its unit, shape (samples, n_axes).
        """
        torque = np.empty_like(self.recording.torque)
        for part in self._chunks():
            columns, rest = self._columns(part)
            motor = columns @ value + rest
            torque[part] = motor if self.recording.side == "motor" else motor @ self.gearing
        return torque

    def _chunks(self) -> Iterator[slice]:
        for part in self.parts:
            for start in range(part.start, part.stop, _CHUNK):
                yield slice(start, min(start + _CHUNK, part.stop))

    def _columns(self, part: slice) -> tuple[np.ndarray, np.ndarray]:
        """Motor torque for each unit of each parameter, and motor torque of all that is known.

        Shapes (samples, n_axes, parameters) and (samples, n_axes).
        """
        n, robot = self.robot.n_axes, self.robot
        q, qd, qdd = self._motion[:, part]
        to_motor = np.linalg.inv(self.gearing)
        links = link_regressor(self._arm, q, qd, qdd)
        arm = self._arm.inverse_dynamics(q, qd, qdd)
        columns = np.zeros((len(q), n, self.size))
        columns[..., : links.shape[2]] = np.einsum("sjp,ji->sip", links, to_motor)
        if self.recording.link:  # neither rotors nor their friction are behind the gearbox
            return columns, (arm - links @ self._nominal) @ to_motor
        speed, acceleration = qd @ self.gearing.T, qdd @ self.gearing.T
        each = np.arange(n)
        shapes, rise = self._drives(speed, acceleration)
        for name, shape in zip(DRIVE, shapes, strict=True):
            columns[:, each, self.drive(name)] = shape
        for number, coupling in enumerate(self.couplings):
            own, before = coupling.axis - 1, coupling.axis - 2
            weight = np.zeros(n)
            weight[own] = 1 / robot.gear_ratio[own]
            weight[before] = coupling.ratio / robot.gear_ratio[before]
            shared = speed @ weight
            for at, shape in zip(
                self.coupling(number), (acceleration @ weight, np.sign(shared), shared), strict=True
            ):
                columns[..., at] = np.outer(shape, weight)
        return columns, (arm - links @ self._nominal) @ to_motor + rise

    def _drives(
        self, speed: np.ndarray, acceleration: np.ndarray
    ) -> tuple[tuple[np.ndarray, ...], np.ndarray]:
        """Motor torque for each unit of `DRIVE`, and what friction has beside it at low speed."""
        friction = self.robot.model.actuator_biasprm[self.robot.ids("actuator", "friction")]
        width = np.where(friction[:, STRIBECK_VELOCITY] > 0, friction[:, STRIBECK_VELOCITY], 1.0)
        curve = np.exp(-((speed / width) ** 2)) * np.sign(speed)
        coulomb = friction[:, COULOMB]
        height = friction[:, STICTION] - coulomb
        share = np.where(self.scaled, height / np.where(self.scaled, coulomb, 1.0), 0.0)
        shapes = (acceleration, np.sign(speed) + share * curve, speed, np.ones_like(speed))
        return shapes, np.where(self.scaled, 0.0, height) * curve

    def drive_torque(self) -> np.ndarray:
        """Compute the motor torque for each unit of the parameters of the drives.

        Returns:
            In the order of `DRIVE`, shape (DRIVE, samples, n_axes).
        """
        _, speed, acceleration = self._motion @ self.gearing.T
        return np.stack(self._drives(speed, acceleration)[0])

    def _products(self) -> Products:
        recording, n = self.recording, self.robot.n_axes
        shape = (len(self.parts), n)
        gram = np.zeros((*shape, self.size, self.size))
        right = np.zeros((*shape, self.size))
        energy, squares, count = np.zeros(shape), np.zeros(shape), np.zeros(shape, int)
        period = recording.sample_period
        every = max(1, int(1 / (2.5 * self.cut_off * period) + 1e-9))
        measured = recording.torque
        if recording.side == "joint":
            measured = measured @ np.linalg.inv(self.gearing)
        for block, part in enumerate(self.parts):
            for chunk in self._chunks():
                if not part.start <= chunk.start < part.stop:
                    continue
                columns, known = self._columns(chunk)
                filtered, torque, rest = (
                    _low_pass(x, period, self.cut_off)[::every]
                    for x in (columns, measured[chunk], known)
                )
                use = self.inside[chunk][::every]
                for axis in range(n):
                    x = filtered[use[:, axis], axis]
                    y = (torque - rest)[use[:, axis], axis]
                    gram[block, axis] += x.T @ x
                    right[block, axis] += x.T @ y
                    energy[block, axis] += y @ y
                    squares[block, axis] += np.sum(torque[use[:, axis], axis] ** 2)
                    count[block, axis] += len(y)
        return Products(gram, right, energy, squares, count)


def possible_regression(
    recording: Recording, robot: Robot, couplings: Sequence[Coupling] = ()
) -> Regression:
    """Make a regression whose static friction can exist.

    Args:
        recording: The measured data.
        robot: The model.
        couplings: Couplings with columns.

    Returns:
        The regression. Static friction keeps its ratio to Coulomb friction on axes on which it
        would be more than `STATIC` times the identified Coulomb friction, and than in the model.
    """
    regression = Regression(recording, robot, couplings=couplings)
    if recording.link:
        return regression
    friction = robot.model.actuator_biasprm[robot.ids("actuator", "friction")]
    given, static = friction[:, COULOMB], friction[:, STICTION]
    own = identify(regression.products)[regression.drive("Coulomb")]
    most = np.maximum(STATIC, static / np.where(given > 0, given, np.inf))
    moves = regression.products.count.sum(axis=0) > 0
    scaled = moves & (given > 0) & (static > given) & (own + static - given > most * own)
    if not scaled.any():
        return regression
    return Regression(recording, robot, couplings=couplings, scaled=scaled)


def _inner(recording: Recording, cut_off: float) -> np.ndarray:
    """Samples that are not near the ends of a recording, where filters do not know the motion."""
    away = round(_EDGE / cut_off / recording.sample_period)
    inner = np.zeros(len(recording.position), bool)
    for part in recording.parts:
        inner[part.start + away : max(part.stop - away, part.start)] = True
    return inner


def _low_pass(x: np.ndarray, period: float, cut_off: float) -> np.ndarray:
    """Filter along the first axis (Butterworth, 4th order, forward and backward)."""
    if 2.5 * cut_off * period >= 1 or len(x) <= _PADDING:
        return x
    b, a = butter(4, 2 * cut_off * period)
    return np.asarray(filtfilt(b, a, x, axis=0))

"""The noise that measured positions bring into a comparison of torques.

The model is on measured positions, whose noise n a filter S has smoothed (see `recordings.
smoothing`). The torque that it needs on this noise, in one pose of the arm, is

    noise = (J s^2 + F G (1 - G' A G) / r^2) S n,      A = (M s^2 + G' K G)^-1 K,   K = k + d s

with the inertia J of rotors and M of the links, stiffness k and damping d of the gearboxes, the
turns G of the gearboxes for one turn of each joint, their ratios r, and the share F of loads that
is seen in the comparison (see `smoothed_load`). It is large at frequencies at which the links swing
behind rotors that are held. They change with the pose, so that the colour of the noise changes with
time. tests/discovery/test_position_noise.py compares it with simulations.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from faultgen.discovery.replay.prescribed import STIFFER
from faultgen.recordings.smoothing import kept, noise_of_position
from faultgen.recordings.varying_noise import VaryingNoise
from faultgen.robot import Robot
from faultgen.simulation.arm import Arm

if TYPE_CHECKING:
    from faultgen.discovery.replay.replay import Replay
    from faultgen.recordings.recording import Recording

_FRAME = 0.1  # time in which the pose counts as constant [s]
_COUNT = 1024  # delays of an autocovariance, of which the first ones are needed


def position_noise(replay: Replay, order: int) -> VaryingNoise | None:
    """Compute the noise of torques on noisy measured positions.

    The noise of positions and of torques is white, as `noise_of_position` finds it.

    Args:
        replay: The model on measured positions.
        order: Of the autoregression.

    Returns:
        The noise; None where the model is not on measured positions.
    """
    recording, robot, period = replay.recording, replay.robot, replay.recording.sample_period
    if not replay.strengths:
        return None
    frequency = np.fft.rfftfreq(_COUNT, period)
    needed = Needed(robot, frequency, link=recording.link)
    unit = needed.unit(recording)
    length = max(1, round(_FRAME / period))
    frame = np.zeros(len(recording.torque), int)
    covariances: list[np.ndarray] = []
    white: list[np.ndarray] = []
    for part, strengths in zip(recording.parts, replay.strengths, strict=True):
        smooth, seen = (np.ones((len(frequency), robot.n_axes), complex) for _ in range(2))
        for axis, strength in enumerate(strengths):
            if strength is not None:
                smooth[:, axis] = kept(strength, frequency, period)
            if replay.load is not None:
                seen[:, axis] = replay.load.transfer(axis, strength, frequency)
        of_position, of_torque = noises(recording, robot, part)
        poses = recording.joint_position(robot)[part]
        for start in range(0, len(poses), length):
            frame[part.start + start : part.stop] = len(white)  # or until the next frame
            pose = poses[min(start + length // 2, len(poses) - 1)]
            torque = needed.torque(pose, seen) * unit[:, None]
            power = np.abs(torque * (smooth * of_position)[:, None, :]) ** 2
            covariance = np.fft.irfft(power.sum(axis=2), _COUNT, axis=0)
            covariances.append(covariance[: order + 1])
            white.append(of_torque**2)
    return VaryingNoise.of_covariances(np.array(covariances), np.array(white), frame)


def noises(recording: Recording, robot: Robot, part: slice) -> tuple[np.ndarray, np.ndarray]:
    """Estimate the noise of positions and torques of a separate recording.

    Args:
        recording: The measured data.
        robot: The model.
        part: Its samples.

    Returns:
        Standard deviations of the position of the rotors, or of the joints if torques are those of
        the gearboxes, in [rad], and of the torque; both of shape (n_axes,).
    """
    position = recording.position if recording.link else recording.motor_position(robot)
    columns = (position[part].T, recording.torque[part].T)
    of_position, of_torque = (np.array([noise_of_position(x) for x in own]) for own in columns)
    return of_position, of_torque


class Needed:
    """Torque that a model needs on small motions of its rotors, or of its joints."""

    def __init__(self, robot: Robot, frequency: np.ndarray, *, link: bool) -> None:
        """Prepare the model.

        Args:
            robot: The model.
            frequency: Shape (frequencies,), in [Hz].
            link: Whether joints are moved, and torques are those of the gearboxes.
        """
        model, tendons = robot.model, robot.ids("tendon", "gearbox")
        self.robot, self.s = robot, 2j * np.pi * frequency
        self.ratio = np.ones(robot.n_axes) if link else robot.gear_ratio
        self.rotor = np.zeros(robot.n_axes) if link else model.dof_M0[list(robot.motors)]
        stiffer = STIFFER if link else 1.0
        stiffness, damping = model.tendon_stiffness[tendons], model.tendon_damping[tendons]
        self.gear = stiffer * stiffness + np.sqrt(stiffer) * self.s[:, None] * damping
        self.turns = robot.gearing.matrix / robot.gear_ratio[:, None]
        self.arm = Arm(robot)

    def unit(self, recording: Recording) -> np.ndarray:
        """Compute the torque of a log per torque of the rotors, or of the gearboxes.

        Args:
            recording: The measured data.

        Returns:
            Shape (n_axes,).
        """
        if recording.link:
            return np.ones(self.robot.n_axes)
        side = 1.0 if recording.side == "motor" else self.robot.gear_ratio
        return np.asarray(side / self.robot.torque_gain)

    def torque(self, pose: np.ndarray, seen: np.ndarray) -> np.ndarray:
        """Compute the torque per unit of motion.

        Args:
            pose: Of the joints, shape (n_axes,), in [rad].
            seen: Share of loads that is seen, shape (frequencies, n_axes).

        Returns:
            Shape (frequencies, n_axes, n_axes), in [N m/rad]; the last axis is that of the motion.
        """
        squared = self.s[:, None, None] ** 2
        behind = np.einsum("ji,fj,jk->fik", self.turns, self.gear, self.turns)
        pull = self.turns.T * (self.gear / self.ratio)[:, None, :]
        joints = np.linalg.solve(squared * self.arm.inertia(pose) + behind, pull)
        twist = np.eye(len(pose)) / self.ratio - self.turns @ joints
        gears = (seen * self.gear / self.ratio)[:, :, None] * twist
        return np.asarray(gears + squared * np.diag(self.rotor))

"""What a load on a rotor changes in a comparison on smoothed positions.

The torque of a drive is compared with the torque that the model needs on the measured motion, S q,
which a filter S has smoothed. A further load d on a rotor makes the servo answer with the torque
T d and moves the rotor by what is left, whose torque of inertia and gearbox, Z x = T d - d, is
compared only as far as the smoothing leaves it:

    change = T d - S (T d - d) = S d + (1 - S) T d

Slow loads are seen as they are. Of loads that are too fast for the smoothed motion, the answer of
the servo is seen. With the gains of the servo and the impedance Z of rotor, gearbox and links,

    T = C / (C + Z),      C = kp + ki / s + kd s,
    Z = J s^2 + G L / (G + L),      G = (D s + K) / n^2,      L = M s^2 / n^2

with the mean inertia M of the links about their own axis. What axes do to each other is left out.
tests/discovery/test_smoothed_load.py compares it with simulations.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.fft import next_fast_len

from faultgen.mjcf.dcmotor import INTEGRAL_GAIN, POSITION_GAIN, VELOCITY_GAIN
from faultgen.recordings.recording import Recording
from faultgen.recordings.smoothing import kept, smoothed_with
from faultgen.robot import Robot
from faultgen.simulation.arm import Arm

_POSES = 50  # of which the inertia of the links is the mean


class SmoothedLoad:
    """The change that loads make in a comparison on smoothed positions."""

    def __init__(
        self, recording: Recording, robot: Robot, strengths: Sequence[Sequence[float | None]]
    ) -> None:
        """Prepare the filters.

        Args:
            recording: The measured data, whose positions are those of the motors.
            robot: The model.
            strengths: Common logarithm of the penalty with which the position of each axis of each
                separate recording was smoothed; None where it was not.
        """
        self.parts, self.strengths = list(recording.parts), strengths
        self.period = recording.sample_period
        model = robot.model
        gains = model.actuator_gainprm[robot.ids("actuator", "drive")]
        self._gains = gains[:, [POSITION_GAIN, INTEGRAL_GAIN, VELOCITY_GAIN]]
        self._inertia = model.dof_M0[list(robot.motors)]
        tendons = robot.ids("tendon", "gearbox")
        self._stiffness = model.tendon_stiffness[tendons] / robot.gear_ratio**2
        arm = Arm(robot)
        poses = recording.joint_position(robot)[:: max(1, len(recording.torque) // _POSES)]
        inertia = np.mean([np.diag(arm.inertia(pose)) for pose in poses], axis=0)
        self._links = inertia / robot.gear_ratio**2
        self._damping = model.tendon_damping[tendons] / robot.gear_ratio**2

    def seen(self, load: np.ndarray, axes: Sequence[int] | None = None) -> np.ndarray:
        """Compute what is seen of loads.

        Args:
            load: Torque on the rotors, shape (samples, n_axes, ...), in any unit.
            axes: Axes that have any, from 0; by default all.

        Returns:
            Change of the compared torque, same shape and unit.
        """
        out = np.array(load, float)
        flat = out.reshape(*out.shape[:2], -1)
        for part, strengths in zip(self.parts, self.strengths, strict=True):
            for axis in range(out.shape[1]) if axes is None else axes:
                strength, own = strengths[axis], flat[part, axis]
                there = np.flatnonzero(own.any(axis=0))
                if strength is None or not len(there):
                    continue
                slow = smoothed_with(own[:, there], strength)
                own[:, there] = slow + self._answer(own[:, there] - slow, axis)
        return out

    def transfer(self, axis: int, strength: float | None, frequency: np.ndarray) -> np.ndarray:
        """Compute how much of a load is seen at some frequencies.

        Args:
            axis: Of the load, from 0.
            strength: Common logarithm of the penalty of smoothing; None for none.
            frequency: Shape (frequencies,), in [Hz]; the first one is 0.

        Returns:
            S + (1 - S) T, complex, same shape.
        """
        slow = kept(strength, frequency, self.period)
        return slow + (1 - slow) * self._answered(axis, frequency)

    def _answered(self, axis: int, frequency: np.ndarray) -> np.ndarray:
        """The transfer T at some frequencies, of which the first is 0."""
        s = 2j * np.pi * frequency[1:]
        kp, ki, kd = self._gains[axis]
        servo = kp + ki / s + kd * s
        gear, link = self._damping[axis] * s + self._stiffness[axis], self._links[axis] * s**2
        rotor = self._inertia[axis] * s**2 + gear * link / (gear + link)
        return np.concatenate([[1.0], servo / (servo + rotor)])

    def _answer(self, load: np.ndarray, axis: int) -> np.ndarray:
        """Torque of the servo that fast loads call for; both of shape (samples, loads)."""
        count = len(load)
        padded = next_fast_len(2 * count, real=True)
        spectrum = np.fft.rfft(load, padded, axis=0)
        answer = self._answered(axis, np.fft.rfftfreq(padded, self.period))[:, None]
        return np.asarray(np.fft.irfft(spectrum * answer, padded, axis=0)[:count])

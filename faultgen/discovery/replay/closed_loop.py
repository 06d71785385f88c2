"""The robot about the simulated motion of a servo that follows commands, linear in small changes.

Where rotors follow commands, a cause moves the rotors by the small y and the joints by x:

    J y'' + f + g / r + kp y + kd y' + ki int y dt = -c,     M x'' - G' g = -l
    g = K (u + y / r - G x) + D (y' / r - G x')

with the inertia J of rotors, the gains kp, ki and kd of the servo, the torque c that a cause takes
from a rotor, the errors u and loads l of `formulas`, and M, G, K and D as there. The friction f is
that of bristles (symbols of `bristles`), linear about their own motion:

    f = s0 v + s1 v' + b y',     v' = y' (1 - s0 z d(|w| / g(w)) / dw) - s0 |w| / g(w) v

The drives log -(kp y + kd y' + ki int y dt), without a limit. Bristles are integrated backwards
(Euler), as they can be faster than a step, and all else with constant mean acceleration.
tests/discovery/test_closed_loop.py compares the answers with simulations.
"""

from __future__ import annotations

import numpy as np

from faultgen.discovery.replay.bristles import bending
from faultgen.discovery.replay.elastic import Newmark
from faultgen.mjcf.dcmotor import BRISTLE_STIFFNESS, INTEGRAL_GAIN, POSITION_GAIN, VELOCITY_GAIN
from faultgen.robot import Robot
from faultgen.simulation.starting import MOVING

_RIGID = 1e9  # stiffness of a servo with an integral against a constant torque, over its own


class Servo(Newmark):
    """Joints, then rotors with their servo and friction."""

    def __init__(
        self,
        robot: Robot,
        arm: tuple[np.ndarray, np.ndarray, np.ndarray],
        steps: int,
        rotors: np.ndarray,
        every: int,
    ) -> None:
        """Prepare the steps.

        Args:
            robot: The model.
            arm: Changes of the torque of the joints at each of the poses, from
                `behind_gears.linear`.
            steps: Steps for which a pose counts.
            rotors: Motion of the rotors at every step of the simulation, shape (steps, n_axes), in
                [rad].
            every: Steps of the simulation in a step.
        """
        model, n = robot.model, robot.n_axes
        self._h = h = every * model.opt.timestep
        gears = robot.ids("tendon", "gearbox")
        drives = model.actuator_gainprm[robot.ids("actuator", "drive")]
        self._kp, self._ki, self._kd = (
            drives[:, [k]] for k in (POSITION_GAIN, INTEGRAL_GAIN, VELOCITY_GAIN)
        )
        self._poses = steps
        self._mass, self._damping, self._stiffness = (
            np.pad(one, ((0, 0), (0, n), (0, n))) for one in arm
        )
        self._mass[:, n:, n:] = np.diag(model.dof_M0[list(robot.motors)])
        turns = relative(robot)
        servo = np.zeros((2, 2 * n))
        servo[:, n:] = (self._kp + self._ki * h / 2)[:, 0], self._kd[:, 0]
        self._stiffness += (turns.T * model.tendon_stiffness[gears]) @ turns + np.diag(servo[0])
        self._damping += (turns.T * model.tendon_damping[gears]) @ turns + np.diag(servo[1])
        self._friction = bending(robot, rotors, every)
        speed = np.abs(rotors[1] - rotors[0]) / model.opt.timestep
        rests = speed <= MOVING * robot.motor_velocity_limit
        bristles = model.actuator_dynprm[robot.ids("actuator", "friction"), BRISTLE_STIFFNESS]
        self._bristles = np.where(rests, bristles, 0.0)[:, None]
        carry = np.where(self._ki > 0, _RIGID * self._kp, self._bristles)[:, 0]
        self._flexible = np.linalg.inv(
            self._stiffness[0] + np.diag(np.concatenate([np.zeros(n), carry]))
        )
        self._state = None
        self._gain = robot.torque_gain[:, None]
        self._n = n

    def _prepare(self, first: int, count: int) -> None:
        n = self._n
        rows = np.arange(first, first + count)
        poses = rows // self._poses
        damping = self._damping[poses]
        rotors = np.arange(n, 2 * n)
        damping[:, rotors, rotors] += self._friction.damping[rows]
        self._first, self._held = first, 1
        self._solve(self._mass[poses], damping, self._stiffness[poses])

    def _begin(self, place: np.ndarray, push: np.ndarray) -> None:
        rotors = place[self._n :]
        left = (push - self._stiffness[0] @ place)[self._n :]
        self._total = np.divide(left, self._ki, out=np.zeros_like(left), where=self._ki > 0)
        self._bent = np.where(self._bristles > 0, rotors, 0.0) * (self._ki == 0)

    def _react(self, step: int, place: np.ndarray, push: np.ndarray) -> None:
        rotors = push[self._n :]
        rotors -= self._friction.stiffness[step][:, None] * self._bent
        if self._ki.any():
            self._before = place[self._n :].copy()
            rotors -= self._ki * (self._total + self._h / 2 * self._before)

    def _moved(self, step: int, place: np.ndarray, rate: np.ndarray) -> None:
        h, friction = self._h, self._friction
        self._bent += h * friction.gain[step][:, None] * rate[self._n :]
        self._bent /= 1 + h * friction.rate[step][:, None]
        if self._ki.any():
            self._total += h / 2 * (self._before + place[self._n :])

    def _seen(self, place: np.ndarray, rate: np.ndarray) -> np.ndarray:
        moved, turning = place[self._n :], rate[self._n :]
        torque = self._kp * moved + self._kd * turning + self._ki * self._total
        return np.asarray(-torque / self._gain, np.float32)


def relative(robot: Robot) -> np.ndarray:
    """Compute how much less a gearbox is twisted per motion of the joints, and of the rotors.

    Args:
        robot: The model.

    Returns:
        Shape (n_axes, 2 n_axes).
    """
    ratio = robot.gear_ratio
    return np.concatenate([robot.gearing.matrix / ratio[:, None], -np.diag(1 / ratio)], axis=1)

"""The rigid arm of a robot, without its drivetrain: kinematics and inverse dynamics."""

from __future__ import annotations

from functools import lru_cache

import mujoco
import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from faultgen.errors import InputError
from faultgen.mjcf.gearing import tendon_coefficients
from faultgen.mjcf.rotors import delete_drives
from faultgen.mjcf.warnings import mujoco_warnings
from faultgen.robot import COULOMB, COUPLING, OFFSET, STICTION, STRIBECK_VELOCITY, Robot

_SLOWEST = 1e-9  # Stribeck velocity of shared friction that jumps at rest [rad/s]
_NEWTON_STEPS = 30  # of `Arm.follow`; a pose that is close needs 3 to 5
_FOLLOWED = 1e-12  # miss at which `Arm.follow` ends [m] and [rad]: some 1e3 times the rounding


@lru_cache(maxsize=8)
def _rigid(
    xml: str, assets: tuple[tuple[str, bytes], ...], n_axes: int, payload: bool
) -> mujoco.MjModel:
    """The arm without rotors, gearboxes and actuators; compiled once, and not to be edited."""
    spec = mujoco.MjSpec.from_string(xml, assets=dict(assets))
    delete_drives(spec, n_axes)
    if not payload:
        spec.delete(spec.body("payload"))
    with mujoco_warnings():
        model = spec.compile()
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    return model


class Arm:
    """Forward and inverse kinematics, and inverse dynamics, of a robot's rigid arm.

    Positions, velocities and torques are those of the joints, shape (samples, n_axes), in [rad],
    [rad/s] and [N m]. A tool pose is the pose of the site ``tool`` in the base frame.
    """

    def __init__(self, robot: Robot, *, payload: bool = True) -> None:
        """Build the arm.

        Args:
            robot: The robot.
            payload: Whether the body ``payload`` is on the flange.
        """
        self.robot = robot
        self.model = _rigid(robot.xml, tuple(sorted(robot.assets.items())), robot.n_axes, payload)
        self._data = mujoco.MjData(self.model)
        self._tool = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_SITE, "tool")

    def inverse_dynamics(
        self, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
    ) -> np.ndarray:
        """Compute the joint torque of a motion, by recursive Newton-Euler (``mj_inverse``).

        Args:
            position: Shape (samples, n_axes), in [rad].
            velocity: Shape (samples, n_axes), in [rad/s].
            acceleration: Shape (samples, n_axes), in [rad/s^2].

        Returns:
            Torque, shape (samples, n_axes), in [N m], without rotor inertia and friction.
        """
        model, data = self.model, self._data
        torque = np.empty_like(position)
        for k in range(len(position)):
            data.qpos[:] = position[k]
            data.qvel[:] = velocity[k]
            data.qacc[:] = acceleration[k]
            mujoco.mj_inverse(model, data)
            torque[k] = data.qfrc_inverse
        return torque

    def inertia(self, position: np.ndarray) -> np.ndarray:
        """Compute the inertia matrix at one pose.

        Args:
            position: Joint angles, shape (n_axes,), in [rad].

        Returns:
            Shape (n_axes, n_axes), in [kg m^2].
        """
        self._data.qpos[:] = position
        mujoco.mj_forward(self.model, self._data)
        matrix = np.zeros((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, self._data, matrix)
        return matrix

    def tool_pose(self, position: np.ndarray) -> tuple[np.ndarray, Rotation]:
        """Compute the pose of the tool.

        Args:
            position: Joint angles, shape (n_axes,), in [rad].

        Returns:
            Position of the tool, shape (3,), in [m], and its orientation, both in the base frame.
        """
        self._place(position)
        point = self._data.site_xpos[self._tool].copy()
        return point, Rotation.from_matrix(self._data.site_xmat[self._tool].reshape(3, 3))

    def inverse_kinematics(
        self,
        point: np.ndarray,
        orientation: Rotation,
        near: np.ndarray,
        *,
        is_close: bool = False,
    ) -> np.ndarray:
        """Find joint angles that bring the tool to a pose.

        Args:
            point: Position of the tool, shape (3,), in [m].
            orientation: Orientation of the tool.
            near: Joint angles from which the search starts, shape (n_axes,), in [rad].
            is_close: Whether the pose is close to that of `near`, which makes the search short.

        Returns:
            Joint angles within the joint ranges, shape (n_axes,), in [rad].

        Raises:
            InputError: From `near`, the pose cannot be reached to within 1e-6 m and 1e-6 rad.
        """
        if is_close or self.model.nv > 6:  # the search below is slow if there are many solutions
            close = self.follow(point, orientation, near)
            if close is not None:
                return close
        low, high = self.robot.joint_range.T

        def residual(q: np.ndarray) -> np.ndarray:
            return self._miss(q, point, orientation)

        start = np.clip(near, low + 1e-9, high - 1e-9)
        tight = 1e-15
        solution = least_squares(
            residual,
            start,
            jac=self._slope,
            bounds=(low, high),
            xtol=tight,
            ftol=tight,
            gtol=tight,
        )
        if np.abs(solution.fun).max() > 1e-6:
            where = ", ".join(f"{v:.3f}" for v in point)
            raise InputError(
                f"robot {self.robot.name}: tool pose ({where}) m cannot be reached "
                f"(the nearest pose that was found is {np.abs(solution.fun[:3]).max() * 1000:.1f} "
                "mm away)"
            )
        return solution.x

    def follow(
        self, point: np.ndarray, orientation: Rotation, near: np.ndarray
    ) -> np.ndarray | None:
        """Find joint angles for a pose of the tool that is close to the present one, quickly.

        Args:
            point: Position of the tool, shape (3,), in [m].
            orientation: Orientation of the tool.
            near: Present joint angles, shape (n_axes,), in [rad].

        Returns:
            Joint angles within the joint ranges, shape (n_axes,), in [rad]; None if Newton's method
            does not find them.
        """
        low, high = self.robot.joint_range.T
        q = np.clip(near, low, high)
        for _ in range(_NEWTON_STEPS):
            miss = self._miss(q, point, orientation)
            if np.abs(miss).max() < _FOLLOWED:
                return q
            slope = self._slope(q)
            damped = slope @ slope.T + 1e-9 * np.eye(6)
            q = np.clip(q - slope.T @ np.linalg.solve(damped, miss), low, high)
        return None

    def _miss(self, q: np.ndarray, point: np.ndarray, orientation: Rotation) -> np.ndarray:
        """How far the tool is from a pose: [m], and rotation vector [rad].

        It computes with MuJoCo's quaternions, as `Rotation` takes several times longer.
        """
        self._place(q)
        turned, turn, vector = np.empty(4), np.empty(4), np.empty(3)
        mujoco.mju_mat2Quat(turned, self._data.site_xmat[self._tool])
        mujoco.mju_negQuat(turned, turned)
        mujoco.mju_mulQuat(turn, orientation.as_quat(scalar_first=True), turned)
        mujoco.mju_quat2Vel(vector, turn, 1.0)
        return np.concatenate([self._data.site_xpos[self._tool] - point, vector])

    def _slope(self, q: np.ndarray) -> np.ndarray:
        """Derivative of `_miss` with respect to the joint angles."""
        self._place(q)
        mujoco.mj_comPos(self.model, self._data)
        linear = np.zeros((3, self.model.nv))
        angular = np.zeros((3, self.model.nv))
        mujoco.mj_jacSite(self.model, self._data, linear, angular, self._tool)
        return np.vstack([linear, -angular])

    def _place(self, q: np.ndarray) -> None:
        """Compute where all links are at given joint angles."""
        self._data.qpos[:] = q
        mujoco.mj_kinematics(self.model, self._data)


def nominal_friction(robot: Robot, speed: np.ndarray, width: float = 1.0) -> np.ndarray:
    """Compute the friction torque of steady motion: Coulomb, asymmetry and viscous.

    Args:
        robot: The healthy robot.
        speed: Motor speed, shape (samples, n_axes), in [rad/s].
        width: Speed over which the step at zero speed is smoothed, over the Stribeck velocity.

    Returns:
        Torque that overcomes friction, shape (samples, n_axes), in [N m]. Its step at zero speed is
        smoothed to tanh(speed / (width stribeck_velocity)).
    """
    friction = robot.ids("actuator", "friction")
    bias = robot.model.actuator_biasprm[friction]
    widths = width * bias[:, STRIBECK_VELOCITY]  # 0 only where there is no dry friction
    share = np.tanh(speed / np.where(widths > 0, widths, 1.0))
    sliding = bias[:, COULOMB] * share - bias[:, OFFSET] * np.abs(share)
    return sliding + robot.model.actuator_damping[friction] * speed


def steady_friction(
    robot: Robot, model: mujoco.MjModel, axis: int, speed: np.ndarray
) -> np.ndarray:
    """Compute the friction of an axis in steady sliding, with its Stribeck curve.

    Equation: sign(w) (F_c + (F_s - F_c) exp(-(w / v_s)^2)) - f_0 + f_v w + f_2 w |w| + ...

    Args:
        robot: The healthy robot.
        model: Its model, or one with effects.
        axis: Axis, from 1.
        speed: Motor speed, shape (n,), in [rad/s].

    Returns:
        Torque that overcomes friction, shape (n,), in [N m].

    Source: docs/physics.md, LuGre friction.
    """
    element = robot.ids("actuator", "friction", model)[axis - 1]
    bias = model.actuator_biasprm[element]
    width = bias[STRIBECK_VELOCITY] if bias[STRIBECK_VELOCITY] > 0 else 1.0
    static = bias[STICTION] - bias[COULOMB]
    sliding = np.sign(speed) * (bias[COULOMB] + static * np.exp(-((speed / width) ** 2)))
    viscous = model.actuator_damping[element] * speed
    for power, coefficient in enumerate(model.actuator_dampingpoly[element], start=1):
        viscous = viscous + coefficient * speed * np.abs(speed) ** power
    return sliding - bias[OFFSET] + viscous


def motor_torque(arm: Arm, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
    """Compute the motor torque that a motion needs: rigid arm, rotor inertia, nominal friction.

    Args:
        arm: The rigid arm.
        q: Joint angle, shape (samples, n_axes), in [rad].
        qd: Joint velocity, same shape, in [rad/s].
        qdd: Joint acceleration, same shape, in [rad/s^2].

    Returns:
        Torque at the motors, shape (samples, n_axes), in [N m].
    """
    return _loads(arm, q, qd, qdd)[1]


def shared_torque(
    robot: Robot, speed: np.ndarray, acceleration: np.ndarray, *, sliding: bool = True
) -> np.ndarray:
    """Compute the motor torque of the friction and inertia that two axes share in the model.

    Args:
        robot: The robot.
        speed: Speed of the motors, shape (samples, n_axes), in [rad/s].
        acceleration: Acceleration of the motors, same shape, in [rad/s^2].
        sliding: Whether shared Coulomb friction counts, as well as viscous friction and inertia.

    Returns:
        Same shape, in [N m].
    """
    model, torque = robot.model, np.zeros_like(speed)
    for actuator in range(model.nactuator):
        if not model.actuator(actuator).name.startswith(COUPLING):
            continue
        tendon = model.actuator_trnid[actuator, 0]
        own = tendon_coefficients(model, tendon)[list(robot.motors)]
        shared, bias = speed @ own, model.actuator_biasprm[actuator]
        width = max(bias[STRIBECK_VELOCITY], _SLOWEST)
        of_pair = bias[COULOMB] * np.tanh(shared / width) if sliding else np.zeros_like(shared)
        of_pair += model.actuator_damping[actuator] * shared
        of_pair += model.tendon_armature[tendon] * (acceleration @ own)
        torque += np.outer(of_pair, own)
    return torque


def loads(
    robot: Robot, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Compute the load of the motors on a motion, and the torque that they need.

    Args:
        robot: The healthy robot.
        q: Joint angle, shape (samples, n_axes), in [rad].
        qd: Joint velocity, same shape, in [rad/s].
        qdd: Joint acceleration, same shape, in [rad/s^2].

    Returns:
        Torque of the rigid arm at the motors, and `motor_torque`. Both have the shape of q and are
        in [N m].
    """
    return _loads(Arm(robot), q, qd, qdd)


def _loads(
    arm: Arm, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    robot = arm.robot
    load = robot.gearing.torque(arm.inverse_dynamics(q, qd, qdd)) / robot.gear_ratio
    qd, qdd = robot.gearing.outputs(qd), robot.gearing.outputs(qdd)
    rotor = robot.model.dof_M0[list(robot.motors)] * robot.gear_ratio * qdd
    torque = load + rotor + nominal_friction(robot, qd * robot.gear_ratio)
    torque += shared_torque(robot, qd * robot.gear_ratio, qdd * robot.gear_ratio)
    return load, torque

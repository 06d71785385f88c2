"""An independent integration of a robot, to check `faultgen.simulation.stepping` against.

The arm is MuJoCo's rigid arm without drivetrain; rotors, gearboxes, friction and servo are written
out here as differential equations. Set points are continuous in time (no zero-order hold), and
scipy integrates with an adaptive step. Numbers are read from the compiled models.

    motion = from_busy_move(plan(load_task("puma560", "pick_and_place"), load_robot("puma560")))
    cycle = integrate(motion, motion.robot.model, times, start=0)
    cycle.motor_torque.shape  # (samples, n_axes)
"""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from faultgen.robot import Robot
from faultgen.simulation.arm import Arm
from faultgen.simulation.motion import Motion
from faultgen.simulation.stepping import Cycle

TOLERANCE = 1e-6
"""Relative tolerance of the integration; a tenth of it changes no motor torque by 1e-4 RMS."""

_GRID = (
    1e-4  # on which set points are tabulated [s]; a cubic spline joins them to 1e-6 of the torque
)


def from_busy_move(motion: Motion, seconds: float = 1.5) -> Motion:
    """The same cycle, begun at rest, at the move that sets all axes in motion most.

    Args:
        motion: The motion.
        seconds: Time from the beginning of the move on in which axes are to move [s].

    Returns:
        The motion with another origin of time.
    """
    whole = np.square(motion(np.arange(0, motion.period, 0.01))[1]).mean(axis=0)

    def laziest(start: float) -> float:
        part = np.square(motion(start + np.arange(0, seconds, 0.01))[1]).mean(axis=0)
        return float(np.min(part / whole))

    begin = max((piece.start for piece in motion.pieces), key=laziest)
    moved = (replace(piece, start=(piece.start - begin) % motion.period) for piece in motion.pieces)
    return replace(motion, pieces=tuple(sorted(moved, key=lambda piece: piece.start)))


class _Arm:
    """Accelerations of the rigid arm: M(q)^-1 (torque - bias + balancing spring)."""

    def __init__(self, robot: Robot) -> None:
        self.model = Arm(robot).model
        self.data = mujoco.MjData(self.model)

    def update(self, q: np.ndarray, qd: np.ndarray) -> None:
        """Set the state; all shape (n_axes,), in [rad] and [rad/s]."""
        self.data.qpos[:] = q
        self.data.qvel[:] = qd
        mujoco.mj_fwdPosition(self.model, self.data)
        mujoco.mj_fwdVelocity(self.model, self.data)

    def acceleration(self, torque: np.ndarray) -> np.ndarray:
        """Joint acceleration, shape (n_axes,), in [rad/s^2]."""
        force = (torque - self.data.qfrc_bias + self.data.qfrc_passive)[None]
        solution = np.empty_like(force)
        mujoco.mj_solveM(self.model, self.data, solution, force)
        return solution[0]

    def torque(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """Joint torque M qdd + bias - balancing spring, shape (n_axes,), in [N m]."""
        self.update(q, qd)
        inertia = np.zeros((len(q), len(q)))
        mujoco.mj_fullM(self.model, self.data, inertia)
        return inertia @ qdd + self.data.qfrc_bias - self.data.qfrc_passive


class Drivetrain:
    """Parameters of rotors, gearboxes, servo and friction, shape (n_axes,), SI units."""

    def __init__(self, robot: Robot, model: mujoco.MjModel) -> None:
        def find(kind: mujoco.mjtObj, name: str) -> list[int]:
            return [mujoco.mj_name2id(model, kind, f"{name}{i + 1}") for i in range(robot.n_axes)]

        motor = find(mujoco.mjtObj.mjOBJ_JOINT, "motor")
        gearbox = find(mujoco.mjtObj.mjOBJ_TENDON, "gearbox")
        drive = find(mujoco.mjtObj.mjOBJ_ACTUATOR, "drive")
        friction = find(mujoco.mjtObj.mjOBJ_ACTUATOR, "friction")
        self.n = 1 / np.array([model.wrap_prm[model.tendon_adr[g]] for g in gearbox])
        # rotors turn about z through their centre of mass
        self.rotor_inertia = model.body_inertia[model.jnt_bodyid[motor], 2]
        self.stiffness = model.tendon_stiffness[gearbox]
        self.damping = model.tendon_damping[gearbox]
        self.kp = model.actuator_gainprm[drive, 4]
        self.kd = model.actuator_gainprm[drive, 6]
        self.limit = model.actuator_forcerange[drive, 1]
        self.sigma0 = model.actuator_dynprm[friction, 5]
        self.sigma1 = model.actuator_dynprm[friction, 6]
        self.coulomb = model.actuator_biasprm[friction, 3]
        self.stiction = model.actuator_biasprm[friction, 4]
        self.stribeck_velocity = model.actuator_biasprm[friction, 5]
        amplitude, poles, phase = model.actuator_biasprm[friction, :3].T
        if poles.any():
            raise ValueError("cogging with poles is not written out here")
        self.offset = amplitude * np.sin(phase)
        self.viscous = model.actuator_damping[friction]

    def drive_torque(self, setpoint: np.ndarray, th: np.ndarray, w: np.ndarray) -> np.ndarray:
        """Servo and saturation [N m]; set points are (position, velocity, feed-forward)."""
        position, velocity, ff = setpoint
        torque = self.kp * (position - th) + self.kd * (velocity - w) + ff
        return np.clip(torque, -self.limit, self.limit)

    def bristle_rate(self, w: np.ndarray, z: np.ndarray) -> np.ndarray:
        """LuGre dz/dt = w - sigma0 |w| z / g(w) [rad/s]."""
        decay = np.exp(-((w / self.stribeck_velocity) ** 2))
        g = self.coulomb + (self.stiction - self.coulomb) * decay
        return w - self.sigma0 * np.abs(w) * z / g

    def friction_torque(self, w: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Torque of friction on the rotor [N m]."""
        bristle = self.sigma0 * z + self.sigma1 * self.bristle_rate(w, z)
        return self.offset - bristle - self.viscous * w

    def gear_torque(
        self, q: np.ndarray, qd: np.ndarray, th: np.ndarray, w: np.ndarray
    ) -> np.ndarray:
        """Torque of the gearbox on the joint, thesis eq. 6.2a [N m]."""
        return self.stiffness * (th / self.n - q) + self.damping * (w / self.n - qd)


def setpoints(motion: Motion, start: float, end: float) -> CubicSpline:
    """Set points as continuous functions of time: values of shape (3, n_axes)."""
    times = np.arange(start - 3 * _GRID, end + 3 * _GRID, _GRID)
    q, qd, qdd = motion(times)
    robot = motion.robot
    healthy = Drivetrain(robot, robot.model)
    arm = _Arm(robot)
    load = np.array([arm.torque(*state) for state in zip(q, qd, qdd, strict=True)])
    n, w = healthy.n, healthy.n * qd
    step = np.tanh(w / healthy.stribeck_velocity)
    ff = load / n + healthy.rotor_inertia * n * qdd
    ff += healthy.coulomb * step - healthy.offset * np.abs(step) + healthy.viscous * w
    return CubicSpline(times, np.stack([n * q, w, ff], axis=1))


def integrate(
    motion: Motion,
    model: mujoco.MjModel,
    times: np.ndarray,
    *,
    start: float,
    tolerance: float = TOLERANCE,
) -> Cycle:
    """Integrate a robot along a motion.

    Args:
        motion: The motion; the robot starts on it, with gearboxes wound up by gravity.
        model: The robot as it is, perhaps worn.
        times: Times at which to return the state, shape (samples,), in [s].
        start: Time at which to start, not after any of `times` [s].
        tolerance: Relative tolerance.

    Returns:
        The channels of `faultgen.simulation.stepping.Cycle` at `times`.
    """
    robot = motion.robot
    axes = robot.n_axes
    drivetrain = Drivetrain(robot, model)
    arm = _Arm(robot)
    setpoint = setpoints(motion, start, times[-1])

    q, qd, _ = (values[0] for values in motion(np.array([start])))
    load = arm.torque(q, 0 * q, 0 * q)
    n = drivetrain.n
    state = np.concatenate([q - load / drivetrain.stiffness, qd, n * q, n * qd, 0 * q])

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        q, qd, th, w, z = y.reshape(5, axes)
        gear = drivetrain.gear_torque(q, qd, th, w)
        motor = drivetrain.drive_torque(setpoint(t), th, w)
        motor += drivetrain.friction_torque(w, z) - gear / n
        arm.update(q, qd)
        return np.concatenate(
            [
                qd,
                arm.acceleration(gear),
                w,
                motor / drivetrain.rotor_inertia,
                drivetrain.bristle_rate(w, z),
            ]
        )

    # errors that matter: twist of a gearbox, and bristle deflection of the order Fc / sigma0
    bristle = drivetrain.coulomb / drivetrain.sigma0
    twist = robot.motor_torque_limit * np.abs(n) / drivetrain.stiffness
    scale = np.concatenate([twist, 10 * twist, np.abs(n) * twist, 10 * np.abs(n) * twist, bristle])
    solution = solve_ivp(
        rate,
        (start, times[-1]),
        state,
        method="LSODA",
        t_eval=times,
        rtol=tolerance,
        atol=tolerance * scale,
        max_step=0.01,
    )
    if not solution.success:
        raise RuntimeError(solution.message)
    q, qd, th, w, z = solution.y.reshape(5, axes, -1).swapaxes(1, 2)
    command = setpoint(times).swapaxes(0, 1)
    return Cycle(
        motor_position=th,
        motor_velocity=w,
        motor_torque=drivetrain.drive_torque(command, th, w),
        friction_torque=drivetrain.friction_torque(w, z),
        gear_torque=drivetrain.gear_torque(q, qd, th, w),
        joint_position=q,
        joint_velocity=qd,
    )

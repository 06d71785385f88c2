"""Stepping: the only module that steps MuJoCo.

`simulate` runs one robot through its cycles, one after another and without a break; the model may
change at the boundary of two cycles (wear, temperature, payload). It yields a cycle at a time, so
memory does not grow with the number of cycles. Python does nothing within a chunk of steps.

    for cycle in simulate(robot, control, models, sample_period=0.004):
        cycle.motor_torque.shape  # (samples, n_axes)
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco.batch import Batch, SimulationError

from faultgen.arm import Arm
from faultgen.errors import InputError, SimulationFailed
from faultgen.robot import Robot

RECORD = ("actuator_length", "actuator_velocity", "actuator_force", "ten_length", "ten_velocity")
"""What is recorded: derived fields, which all describe the state before the step."""

LEAD_IN = 2.0
"""Time before the first cycle [s], simulated and not recorded: the end of the cycle before."""

_CHUNK = 4000  # steps recorded at once; bounds the memory
_BAD = (
    (mujoco.mjtWarning.mjWARN_BADQPOS, "position"),
    (mujoco.mjtWarning.mjWARN_BADQVEL, "velocity"),
    (mujoco.mjtWarning.mjWARN_BADQACC, "acceleration"),
    (mujoco.mjtWarning.mjWARN_BADCTRL, "control"),
)


@dataclass(frozen=True)
class Cycle:
    """What happened in one cycle, free of noise. Arrays have shape (samples, n_axes), SI units."""

    motor_position: np.ndarray
    """[rad], motor side."""
    motor_velocity: np.ndarray
    """[rad/s], motor side."""
    motor_torque: np.ndarray
    """Torque of the drive, which a controller logs [N m]."""
    friction_torque: np.ndarray
    """Friction on the rotor, against the motion [N m]."""
    gear_torque: np.ndarray
    """Torque of the gearbox on the joint, arm side [N m]."""
    joint_position: np.ndarray
    """[rad], arm side."""
    joint_velocity: np.ndarray
    """[rad/s], arm side."""


def decimation(timestep: float, sample_period: float) -> int:
    """Steps a sample.

    Raises:
        InputError: The sample period is not a whole number of steps.
    """
    steps = round(sample_period / timestep)
    if steps < 1 or abs(steps * timestep - sample_period) > 1e-9:
        raise InputError(
            f"sample period {sample_period} s must be a whole number of steps of {timestep} s"
        )
    return steps


def simulate(
    robot: Robot,
    control: np.ndarray,
    models: Iterable[mujoco.MjModel],
    *,
    sample_period: float,
    lead_in: float = LEAD_IN,
) -> Iterator[Cycle]:
    """Simulate cycles, each with its own model, as one uninterrupted run.

    Args:
        robot: The healthy robot.
        control: Control of one cycle, shape (steps, n_controls), from `servo.control_signal`.
        models: The robot as it is in each cycle; all compiled from edits of `robot`.
        sample_period: Time between samples [s].
        lead_in: Time before the first cycle [s], of the end of the cycle before; 0 for a motion
            that does not repeat.

    Yields:
        One `Cycle` for each model.

    Raises:
        SimulationFailed: The state became bad (not finite or huge), or MuJoCo raised an error.
        InputError: The sample period does not fit the step.
    """
    every = decimation(robot.model.opt.timestep, sample_period)
    control = np.ascontiguousarray(control)
    batch = Batch(robot.model, 1, 1)
    recorder = _Recorder(robot, every)
    for index, model in enumerate(models):
        batch.set_models(model)
        if index == 0:
            lead = min(len(control), round(lead_in / model.opt.timestep))
            _start(robot, batch, control[-lead])  # the first one without a lead
            for _ in recorder.run(batch, control[len(control) - lead :], 0):
                pass
        yield recorder.cycle(batch, model, control, index + 1)


class _Recorder:
    """Rolls a batch of one out, chunk by chunk, into arrays that are used again."""

    def __init__(self, robot: Robot, every: int) -> None:
        self.robot = robot
        self.every = every
        self.chunk = max(1, _CHUNK // every) * every
        self.out: dict[int, dict[str, np.ndarray]] = {}
        self.drive = robot.ids("actuator", "drive")
        self.friction = robot.ids("actuator", "friction")
        self.gearbox = robot.ids("tendon", "gearbox")

    def run(self, batch: Batch, control: np.ndarray, cycle: int) -> Iterator[dict[str, np.ndarray]]:
        """Step through a control signal; yield what was recorded, chunk by chunk."""
        for start in range(0, len(control), self.chunk):
            part = control[None, start : start + self.chunk]
            steps = part.shape[1]
            try:
                with _quiet():
                    out = batch.rollout(steps, part, record=RECORD, out=self.out.get(steps))
            except SimulationError as error:
                raise SimulationFailed(f"cycle {cycle}: {error}") from None
            self.out[steps] = out
            for warning, what in _BAD:
                if batch.warning[0, int(warning), 1]:  # (last info, count)
                    seconds = (start + steps) * batch.model.opt.timestep
                    raise SimulationFailed(
                        f"cycle {cycle}: the simulation diverged before {seconds:.2f} s of the "
                        f"cycle: bad {what}"
                    )
            yield out

    def cycle(self, batch: Batch, model: mujoco.MjModel, control: np.ndarray, number: int) -> Cycle:
        """Simulate one cycle and keep its samples."""
        samples = -(-len(control) // self.every)
        kept: dict[str, np.ndarray] = {}
        at = 0
        for out in self.run(batch, control, number):
            for name in RECORD:
                part = out[name][0, :: self.every]
                if name not in kept:
                    kept[name] = np.empty((samples, part.shape[1]))
                kept[name][at : at + len(part)] = part
            at += len(part)
        return self._channels(model, kept)

    def _channels(self, model: mujoco.MjModel, kept: dict[str, np.ndarray]) -> Cycle:
        drive = model.actuator_outadr[self.drive]
        friction = model.actuator_outadr[self.friction]
        position = kept["actuator_length"][:, drive]
        velocity = kept["actuator_velocity"][:, drive]
        twist = kept["ten_length"][:, self.gearbox]
        twist_rate = kept["ten_velocity"][:, self.gearbox]
        # MuJoCo applies an actuator's damping apart from its force
        viscous = -model.actuator_damping[self.friction] * velocity
        for power, coefficient in enumerate(model.actuator_dampingpoly[self.friction].T, start=1):
            viscous = viscous - coefficient * velocity * np.abs(velocity) ** power
        return Cycle(
            motor_position=position,
            motor_velocity=velocity,
            motor_torque=kept["actuator_force"][:, drive],
            friction_torque=kept["actuator_force"][:, friction] + viscous,
            gear_torque=gearbox_torque(model, self.gearbox, twist, twist_rate),
            joint_position=position / self.robot.gear_ratio - twist,
            joint_velocity=velocity / self.robot.gear_ratio - twist_rate,
        )


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep MuJoCo's warnings from stderr and from a log file; they are read from its counters."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda message: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)


def gearbox_torque(
    model: mujoco.MjModel, gearbox: np.ndarray, twist: np.ndarray, twist_rate: np.ndarray
) -> np.ndarray:
    """Torque of gearboxes on their joints, thesis eq. 6.2a with MuJoCo's dead band and polynomials.

    Args:
        model: The robot as simulated.
        gearbox: Tendon ids, shape (n_axes,).
        twist: q_motor / n - q_joint, shape (samples, n_axes), in [rad].
        twist_rate: Its rate, same shape, in [rad/s].

    Returns:
        Torque, shape (samples, n_axes), in [N m].
    """
    low, high = model.tendon_lengthspring[gearbox].T
    stretch = twist - np.clip(twist, low, high)
    stiffness = model.tendon_stiffness[gearbox] * stretch
    for power, coefficient in enumerate(model.tendon_stiffnesspoly[gearbox].T, start=2):
        stiffness = stiffness + coefficient * stretch**power
    damping = model.tendon_damping[gearbox] * twist_rate
    for power, coefficient in enumerate(model.tendon_dampingpoly[gearbox].T, start=1):
        damping = damping + coefficient * twist_rate * np.abs(twist_rate) ** power
    return stiffness + damping


def _start(robot: Robot, batch: Batch, control: np.ndarray) -> None:
    """Put the robot on the reference, with the gearboxes wound up by the load there."""
    model = robot.model
    at = model.actuator_ctrladr[robot.ids("actuator", "drive")]
    motor, speed = control[at], control[at + 1]
    joint = motor / robot.gear_ratio
    load = Arm(robot).inverse_dynamics(joint[None], 0 * joint[None], 0 * joint[None])[0]
    stiffness = model.tendon_stiffness[robot.ids("tendon", "gearbox")]
    position, velocity = batch.qpos, batch.qvel
    position[0, list(robot.motors)] = motor
    position[0, list(robot.joints)] = joint - load / stiffness
    velocity[0, list(robot.motors)] = speed
    velocity[0, list(robot.joints)] = speed / robot.gear_ratio

"""Simulating cycles; this is the only module that steps MuJoCo.

`simulate` runs one robot through its cycles without interruption. Wear, temperature and payload may
change from one cycle to the next. The cycles are yielded one by one, so the memory that is needed
does not grow with their number. MuJoCo takes thousands of steps at once without Python, except for
plants with effects that act between steps; these are stepped a few steps at a time.

    for cycle in simulate(robot, control, models, sample_period=0.004):
        cycle.motor_torque.shape  # (samples, n_axes)
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

import mujoco
import numpy as np
from mujoco.batch import Batch, SimulationError

from faultgen.effects.hooks import Moment
from faultgen.errors import InputError, SimulationFailed
from faultgen.mjcf.warnings import mujoco_warnings
from faultgen.robot import Robot
from faultgen.simulation.channels import RECORD, Channels
from faultgen.simulation.cycle import Cycle
from faultgen.simulation.plant import Plant
from faultgen.simulation.starting import start_in_equilibrium, start_on_reference
from faultgen.simulation.timers import stop_timers

stop_timers()

LEAD_IN = 2.0
"""Time that is simulated before the first cycle and not recorded [s]. In this time the robot moves
as at the end of a cycle."""

CHUNK = 4000
"""Number of steps that are recorded at once. It bounds the memory and changes no result."""

_BAD = (
    (mujoco.mjtWarning.mjWARN_BADQPOS, "position"),
    (mujoco.mjtWarning.mjWARN_BADQVEL, "velocity"),
    (mujoco.mjtWarning.mjWARN_BADQACC, "acceleration"),
    (mujoco.mjtWarning.mjWARN_BADCTRL, "control"),
)
_SEARCH = 64  # steps of the first search for the one that diverged
_BAD_IDS = [int(warning) for warning, _ in _BAD]


def decimation(timestep: float, sample_period: float) -> int:
    """Compute the number of simulation steps from one sample to the next.

    Args:
        timestep: Step of the simulation [s].
        sample_period: Time between samples [s].

    Returns:
        The number of steps.

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
    plants: Iterable[Plant | mujoco.MjModel],
    *,
    sample_period: float,
    lead_in: float = LEAD_IN,
) -> Iterator[Cycle]:
    """Simulate cycles, each with its own plant, as one uninterrupted run.

    Args:
        robot: The healthy robot.
        control: Control signal of one cycle, shape (steps, n_controls), from
            `servo.control_signal`.
        plants: The robot as it is in each cycle, from `plant.assemble`, or models compiled from
            edits of `robot`.
        sample_period: Time between samples [s].
        lead_in: Time that is simulated before the first cycle and not recorded [s]. In this time
            the robot moves as at the end of a cycle. It must be 0 for a motion that does not
            repeat.

    Yields:
        One `Cycle` for each plant.

    Raises:
        SimulationFailed: The state became infinite, not a number or very large, or MuJoCo raised
            an error.
        InputError: The sample period is not a whole number of steps.
    """
    timestep = robot.model.opt.timestep
    every = decimation(timestep, sample_period)
    control = np.ascontiguousarray(control)
    lead = min(len(control), round(lead_in / timestep))
    stepper = _Stepper(robot, every)
    plant: Plant | None = None
    for index, given in enumerate(plants):
        before, plant = plant, given if isinstance(given, Plant) else Plant(given)
        if before is None or plant is not before:
            stepper.use(plant)
            command = np.ascontiguousarray(plant.command(control, lead > 0))
        if before is None:
            if lead == 0:
                start_in_equilibrium(robot, stepper.batch, command)
            else:
                start_on_reference(robot, stepper.batch, command[-lead])
            for _ in stepper.run(command[len(command) - lead :], 0, -lead):
                pass
        yield plant.log(stepper.cycle(command, index + 1))


class _Stepper:
    """Steps one plant, chunk by chunk, and records into arrays that are used again."""

    batch: Batch
    plant: Plant

    def __init__(self, robot: Robot, every: int) -> None:
        self.robot = robot
        self.every = every

    def use(self, plant: Plant) -> None:
        """Continue with another plant from the present state."""
        model = plant.model
        before = getattr(self, "batch", None)
        if before is None or plant.updates or self.plant.updates or not self._fits(model):
            self.batch = Batch(model, 1, 1)
            self.out: dict[int, dict[str, np.ndarray]] = {}
            if before is not None:
                carry(before, self.batch)
        else:
            self.batch.set_models(model)
        self.plant = plant
        self.channels = Channels(self.robot, model)
        # steps between two updates; all of a chunk where there are none
        self.stride = round(plant.interval / model.opt.timestep) if plant.updates else CHUNK
        self.stride = max(1, self.stride)
        whole = math.lcm(self.every, self.stride) if plant.updates else self.every
        self.chunk = max(1, CHUNK // whole) * whole

    def _fits(self, model: mujoco.MjModel) -> bool:
        """Whether a model has the same elements as the model of the batch."""
        return bool(model.names == self.batch.model.names)

    def run(
        self, control: np.ndarray, cycle: int, first: int = 0
    ) -> Iterator[tuple[dict[str, np.ndarray], np.ndarray]]:
        """Step through a control signal, chunk by chunk.

        Args:
            control: Shape (steps, n_controls).
            cycle: Number of the cycle for messages.
            first: Number of the first step; 0 is the start of a cycle.

        Yields:
            The recorded fields by name, each of shape (1, steps, elements), and the viscous damping
            of each axis, shape (n_axes,) or (steps, n_axes), in [N m s/rad].
        """
        for start in range(0, len(control), self.chunk):
            part = control[None, start : start + self.chunk]
            before = self.batch.state.copy()
            out, damping = self._roll(part, cycle, first + start)
            if self._broken():
                raise SimulationFailed(self._diverged(before, part, cycle, first + start))
            yield out, damping

    def _roll(
        self, control: np.ndarray, cycle: int, first: int
    ) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """Step through a chunk and return what `run` yields."""
        steps = control.shape[1]
        try:
            with mujoco_warnings():
                if self.plant.updates:
                    out, damping = self._update_and_step(control, first)
                else:
                    out = self.batch.rollout(steps, control, record=RECORD, out=self.out.get(steps))
                    damping = self.plant.model.actuator_damping[self.channels.friction]
        except SimulationError as error:
            raise SimulationFailed(f"{_when(cycle)}: {error}") from None
        self.out[steps] = out
        return out, damping

    def _broken(self) -> str:
        """What MuJoCo has reported as bad since its counts were set to zero; empty if nothing."""
        for warning, what in _BAD:
            if self.batch.warning[0, int(warning), 1]:  # (last info, count)
                return what
        return ""

    def _diverged(self, before: np.ndarray, control: np.ndarray, cycle: int, first: int) -> str:
        """Find where and when a chunk diverged by stepping it again in ever shorter parts.

        Args:
            before: State before the chunk.
            control: Control signal of the chunk, shape (1, steps, n_controls).
            cycle: Number of the cycle for the message.
            first: Number of the first step.

        Returns:
            The message.
        """
        steps = control.shape[1]
        whole = self.stride if self.plant.updates else 1
        start = 0
        for width in (_SEARCH * whole, whole):
            while start < steps:
                self.batch.state[:] = before
                self.batch.warning[:] = 0
                self._roll(control[:, start : start + width], cycle, first + start)
                if self._broken():
                    break
                before = self.batch.state.copy()
                start += width
        what = self._broken() or "state"
        self.batch.state[:] = before
        axis = self._wildest()
        seconds = (first + start + whole) * self.batch.model.opt.timestep
        return (
            f"{_when(cycle)}: the simulation diverged before {seconds:.3f} s of the cycle, "
            f"on {self.robot.label('axis ', axis)}: bad {what}"
        )

    def _wildest(self) -> int:
        """The axis whose rotor exceeds its acceleration limit by the largest factor, from 1."""
        model = self.plant.model
        data = self.batch.get_data(0)
        with mujoco_warnings():
            mujoco.mj_forward(model, data)
        motors, _ = self.robot.addresses(model)
        acceleration = np.nan_to_num(np.abs(data.qacc[motors]), nan=np.inf)
        usual = self.robot.joint_acceleration_limit * np.abs(self.robot.gear_ratio)
        return int(np.argmax(acceleration / usual)) + 1

    def _update_and_step(
        self, control: np.ndarray, first: int
    ) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """Step through a chunk, and call the plant's updates after every `stride` steps."""
        batch, model, steps = self.batch, self.plant.model, control.shape[1]
        out = self.out.get(steps) or {
            "actuator_length": np.empty((1, steps, model.nout)),
            "actuator_velocity": np.empty((1, steps, model.nout)),
            "actuator_force": np.empty((1, steps, model.nout)),
            "ten_length": np.empty((1, steps, model.ntendon)),
            "ten_velocity": np.empty((1, steps, model.ntendon)),
        }
        damping = np.empty((steps, self.robot.n_axes))
        nominal = model.actuator_biasprm, model.actuator_dynprm, model.actuator_damping
        moment = Moment(
            time=0.0,
            interval=self.stride * model.opt.timestep,
            qpos=batch.qpos,
            qvel=batch.qvel,
            biasprm=batch.expand("actuator_biasprm"),
            dynprm=batch.expand("actuator_dynprm"),
            damping=batch.expand("actuator_damping"),
        )
        for at in range(0, steps, self.stride):
            moment.time = (first + at) * model.opt.timestep
            moment.biasprm[:], moment.dynprm[:], moment.damping[:] = nominal
            moment.control = control[:, at : at + self.stride].mean(axis=1)
            for update in self.plant.updates:
                update(moment)
            part = slice(at, min(at + self.stride, steps))
            damping[part] = moment.damping[0, self.channels.friction]
            into = {name: values[:, part] for name, values in out.items()}
            batch.rollout(part.stop - at, control[:, part], record=RECORD, out=into)
            if batch.warning[0, _BAD_IDS, 1].any():
                break  # reported by `run`
        return out, damping

    def cycle(self, control: np.ndarray, number: int) -> Cycle:
        """Simulate one cycle and keep its samples."""
        samples = -(-len(control) // self.every)
        kept: dict[str, np.ndarray] = {}
        damping = np.empty((samples, self.robot.n_axes))
        at = 0
        for out, damped in self.run(control, number):
            for name in RECORD:
                part = out[name][0, :: self.every]
                if name not in kept:
                    kept[name] = np.empty((samples, part.shape[1]))
                kept[name][at : at + len(part)] = part
            damping[at : at + len(part)] = damped if damped.ndim == 1 else damped[:: self.every]
            at += len(part)
        return self.channels.cycle(kept, damping)


def carry(before: Batch, after: Batch) -> None:
    """Copy the state to a batch whose model may have more or fewer actuators and joints.

    Args:
        before: A batch of one simulation.
        after: Another one, whose state is set.
    """
    if before.model.names == after.model.names:
        after.state[:] = before.state
        return
    old, new = before.model, after.model
    after.time[:] = before.time
    for k in range(new.njnt):
        source = mujoco.mj_name2id(old, mujoco.mjtObj.mjOBJ_JOINT, new.joint(k).name)
        if source < 0:
            continue  # starts at rest in the middle of its play
        after.qpos[:, new.jnt_qposadr[k]] = before.qpos[:, old.jnt_qposadr[source]]
        at, to = old.jnt_dofadr[source], new.jnt_dofadr[k]
        after.qvel[:, to] = before.qvel[:, at]
        after.qacc_warmstart[:, to] = before.qacc_warmstart[:, at]
    there = {old.actuator(k).name: k for k in range(old.nactuator)}
    for k in range(new.nactuator):
        source = there.get(new.actuator(k).name)
        if source is not None and new.actuator_actnum[k]:
            at, to = old.actuator_actadr[source], new.actuator_actadr[k]
            count = new.actuator_actnum[k]
            after.act[:, to : to + count] = before.act[:, at : at + count]


def _when(cycle: int) -> str:
    return f"cycle {cycle}" if cycle else "before cycle 1"

"""Stepping many robots at once, on a graphics card, with MuJoCo Warp.

Every robot is a world of a batch, with a model of its own. As in `stepping`, wear may change the
models from one cycle to the next. Warp computes in single precision, which resolves 1e-5 rad of a
motor that has turned by 100 rad, more than a slow motor turns in a step. The positions are
therefore summed up in double precision, and rounded for the computation of the forces only.

MuJoCo Warp is installed by ``pip install 'faultgen[gpu]'``.

    for cycles in simulate_together(robot, control, courses, sample_period=0.004, device="cuda"):
        cycles[0].motor_torque.shape  # (samples, n_axes), of the first robot
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import mujoco
import mujoco_warp
import numpy as np
import warp
from mujoco.batch import MODEL_FIELDS, Batch

from faultgen.effects import get_effect
from faultgen.errors import InputError, SimulationFailed
from faultgen.robot import Robot
from faultgen.simulation.batch_on_device import OWN, State, Worlds
from faultgen.simulation.channels import Channels
from faultgen.simulation.cycle import Cycle
from faultgen.simulation.plant import Plant
from faultgen.simulation.starting import start_in_equilibrium, start_on_reference
from faultgen.simulation.stepping import LEAD_IN, carry, decimation

_SHARED = ("names",) + tuple(
    sorted({field.name for field in fields(mujoco_warp.Model)} & set(MODEL_FIELDS) - set(OWN))
)
_OPTIONS = tuple(name for name in dir(mujoco.MjOption) if not name.startswith("_"))
_LARGEST = 1e10  # state from which MuJoCo, too, counts a simulation as diverged


def check_device(name: str) -> str:
    """Check that a device can be used.

    Args:
        name: Name of the device, as Warp knows it: "cuda", "cuda:1", or "cpu".

    Returns:
        The same name.

    Raises:
        InputError: There is no such device.
    """
    try:
        warp.get_device(name)
    except (RuntimeError, ValueError):
        known = ", ".join(str(device) for device in warp.get_devices())
        raise InputError(f"device: no '{name}' here; Warp finds {known}") from None
    return name


def refuse_effects(names: Iterable[str]) -> None:
    """Refuse effects that act between the steps of the simulation.

    Args:
        names: Names of effects.

    Raises:
        InputError: Some of them do.
    """
    refused = sorted(name for name in names if get_effect(name).between is not None)
    if refused:
        raise InputError(
            f"device: {', '.join(refused)} acts between the steps of the simulation, which "
            "a device cannot do; generate these runs without --device"
        )


def version() -> str:
    """What steps the worlds, for the provenance of runs."""
    return f"Warp {mujoco_warp.__version__} in single precision, {warp.__version__}"


def simulate_together(
    robot: Robot,
    control: np.ndarray,
    courses: Sequence[Iterable[Plant]],
    *,
    sample_period: float,
    device: str,
    lead_in: float = LEAD_IN,
) -> Iterator[list[Cycle | SimulationFailed | None]]:
    """Simulate cycles of many robots, each as one uninterrupted run.

    Args:
        robot: The healthy robot.
        control: Control signal of one cycle, shape (steps, n_controls).
        courses: For every robot, its plant in each cycle; all have the same number of cycles.
        sample_period: Time between samples [s].
        device: Name of the device, such as "cuda".
        lead_in: Time that is simulated before the first cycle and not recorded [s].

    Yields:
        For each cycle, what `simulate` yields for every robot. A robot that fails yields the error
        once, and None from then on.

    Raises:
        InputError: The device does not exist, a plant has an effect that acts between steps, or the
            sample period is not a whole number of steps.
    """
    check_device(device)
    timestep = robot.model.opt.timestep
    every = decimation(timestep, sample_period)
    lead = min(len(control), round(lead_in / timestep))
    robots: list[_Robot | None] = [None] * len(courses)
    failed = np.zeros(len(courses), dtype=bool)
    groups: dict[tuple[Any, ...], Worlds] = {}
    for number, plants in enumerate(zip(*courses, strict=True), start=1):
        told: list[Cycle | SimulationFailed | None] = [None] * len(courses)
        members: dict[bytes, list[int]] = {}
        present: dict[int, _Robot] = {}
        as_before: dict[int, _Robot] = {}
        for k in np.flatnonzero(~failed).tolist():
            plant, one = plants[k], robots[k]
            if one is None or one.plant is not plant:
                same = as_before.get(id(plant))
                if same is None:
                    same = _Robot(plant, _structure(plant), Channels(robot, plant.model))
                one = replace(same, state=None if one is None else one.state_for(plant))
                robots[k] = one
            present[k] = as_before[id(plant)] = one
            members.setdefault(one.structure, []).append(k)
        before, groups = groups, {}
        for structure, numbers in members.items():
            chosen = [plants[k] for k in numbers]
            commands = [np.ascontiguousarray(one.command(control, lead > 0)) for one in chosen]
            own = [present[k] for k in numbers]
            starts: dict[tuple[int, int], State] = {}  # by what stays alive in this block
            for one, command in zip(own, commands, strict=True):
                if one.state is None:
                    start = id(command), 0 if lead else id(one.plant)
                    if start not in starts:
                        starts[start] = _start(robot, one.plant, command, lead)
                    one.state = starts[start]
            key = structure, *numbers
            worlds = groups[key] = before.get(key) or Worlds(chosen, device)
            worlds.use(chosen, commands)
            worlds.put_states([one.state for one in own if one.state is not None])
            if number == 1 and lead:
                worlds.run(len(control) - lead, every)
            recorded = worlds.run(0, every)
            for one, state in zip(own, worlds.get_states(), strict=True):
                one.state = state
            for place, k in enumerate(numbers):
                kept = {name: values[place].astype(float) for name, values in recorded.items()}
                told[k] = _cycle(own[place], kept, number, sample_period)
                failed[k] = isinstance(told[k], SimulationFailed)
        yield told


@dataclass(eq=False)
class _Robot:
    """One robot: what it is in this cycle, and its state."""

    plant: Plant
    structure: bytes
    """As from `_structure`."""
    channels: Channels
    state: State | None = None
    """None before the first cycle."""

    def state_for(self, plant: Plant) -> State | None:
        """The state of the same robot as another plant, which may have other elements."""
        old, new = self.plant.model, plant.model
        if self.state is None or old.names == new.names:
            return self.state
        after = Batch(new, 1, 1)
        carry(self.state.batch(old), after)
        return State.of(after)


def _start(robot: Robot, plant: Plant, command: np.ndarray, lead: int) -> State:
    """The state of a robot at the begin of the lead-in, or of the first cycle if there is none."""
    state = Batch(plant.model, 1, 1)
    if lead == 0:
        start_in_equilibrium(robot, state, command)
    else:
        start_on_reference(robot, state, command[-lead])
    return State.of(state)


def _structure(plant: Plant) -> bytes:
    """A hash of all that worlds of one batch must have in common.

    Warp leaves out elements without stiffness, friction and so on, so that worlds of one batch also
    have the same zeros.
    """
    if plant.updates:
        refuse_effects({effect.name for effect, _ in plant.effects})
    model = plant.model
    told = hashlib.sha256()
    for name in _SHARED:
        told.update(np.asarray(getattr(model, name)).tobytes())
    for name in OWN:
        told.update((np.asarray(getattr(model, name)) != 0).tobytes())
    for name in _OPTIONS:
        told.update(np.asarray(getattr(model.opt, name)).tobytes())
    return told.digest()


def _cycle(
    one: _Robot, kept: dict[str, np.ndarray], number: int, sample_period: float
) -> Cycle | SimulationFailed:
    """The cycle of a robot from its records, or what went wrong."""
    channels = one.channels
    position = kept["actuator_length"][:, channels.drive]
    sizes = np.abs(np.stack([position, kept["actuator_velocity"][:, channels.drive]]))
    bad = ~(sizes < _LARGEST).all(axis=0)
    if bad.any():
        sample = int(np.argmax(bad.any(axis=1)))
        axis = int(np.argmax(bad[sample])) + 1
        return SimulationFailed(
            f"cycle {number}: the simulation diverged before {sample * sample_period:.3f} s of the "
            f"cycle, on {channels.robot.label('axis ', axis)}: bad state"
        )
    damping = channels.model.actuator_damping[channels.friction]
    cycle = channels.cycle(kept, np.tile(damping, (len(position), 1)))
    return one.plant.log(cycle)

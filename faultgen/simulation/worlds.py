"""Stepping many robots at once, on a graphics card, with MuJoCo Warp.

Every robot is a world of a batch, with a model of its own. As in `stepping`, wear may change the
models from one cycle to the next. Warp computes in single precision, which resolves 1e-5 rad of a
motor that has turned by 100 rad, more than a slow motor turns in a step. The positions are
therefore summed up in double precision, and rounded for the computation of the forces only.

MuJoCo Warp is installed by ``pip install 'faultgen[gpu]'``.

    for cycles in simulate_together(robot, control, courses, sample_period=0.004, device="cuda"):
        cycles[0].motor_torque.shape  # (samples, n_axes), of the first robot
"""

# mypy: disable-error-code="valid-type, misc"
# (arguments of kernels are annotated with arrays, and `tid` gives as many numbers as are asked for)
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
from faultgen.errors import InputError, SimulationFailed, one_line
from faultgen.robot import Robot
from faultgen.simulation.channels import RECORD, Channels
from faultgen.simulation.cycle import Cycle
from faultgen.simulation.plant import Plant
from faultgen.simulation.starting import start_in_equilibrium, start_on_reference
from faultgen.simulation.stepping import LEAD_IN, carry, decimation

OWN = tuple(
    field.name
    for field in fields(mujoco_warp.Model)
    if getattr(field.type, "shape", ())[:1] == ("*",)
)
"""Names of the fields of a model that each world may have for itself."""

_SHARED = ("names",) + tuple(
    sorted({field.name for field in fields(mujoco_warp.Model)} & set(MODEL_FIELDS) - set(OWN))
)
_OPTIONS = tuple(name for name in dir(mujoco.MjOption) if not name.startswith("_"))
_STATE = ("qpos", "qvel", "act", "qacc_warmstart")
_SAMPLES = 250  # that are stepped at once; bounds the memory on the device
_LARGEST = 1e10  # state from which MuJoCo, too, counts a simulation as diverged

warp.config.log_level = warp.LOG_WARNING  # stdout belongs to the results of the command


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
    groups: dict[tuple[Any, ...], _Worlds] = {}
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
            starts: dict[tuple[int, int], _State] = {}  # by what stays alive in this block
            for one, command in zip(own, commands, strict=True):
                if one.state is None:
                    start = id(command), 0 if lead else id(one.plant)
                    if start not in starts:
                        starts[start] = _start(robot, one.plant, command, lead)
                    one.state = starts[start]
            key = structure, *numbers
            worlds = groups[key] = before.get(key) or _Worlds(chosen, device)
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


@dataclass(frozen=True, eq=False)
class _State:
    """State of one robot: one-dimensional arrays."""

    qpos: np.ndarray
    qvel: np.ndarray
    act: np.ndarray
    qacc_warmstart: np.ndarray

    @classmethod
    def of(cls, batch: Batch) -> _State:
        """Read the state of a batch of one simulation."""
        return cls(*(getattr(batch, name)[0].copy() for name in _STATE))

    def batch(self, model: mujoco.MjModel) -> Batch:
        """A batch of one simulation with this state."""
        made = Batch(model, 1, 1)
        for name in _STATE:
            getattr(made, name)[0] = getattr(self, name)
        return made


@dataclass(eq=False)
class _Robot:
    """One robot: what it is in this cycle, and its state."""

    plant: Plant
    structure: bytes
    """As from `_structure`."""
    channels: Channels
    state: _State | None = None
    """None before the first cycle."""

    def state_for(self, plant: Plant) -> _State | None:
        """The state of the same robot as another plant, which may have other elements."""
        old, new = self.plant.model, plant.model
        if self.state is None or old.names == new.names:
            return self.state
        after = Batch(new, 1, 1)
        carry(self.state.batch(old), after)
        return _State.of(after)


def _start(robot: Robot, plant: Plant, command: np.ndarray, lead: int) -> _State:
    """The state of a robot at the begin of the lead-in, or of the first cycle if there is none."""
    state = Batch(plant.model, 1, 1)
    if lead == 0:
        start_in_equilibrium(robot, state, command)
    else:
        start_on_reference(robot, state, command[-lead])
    return _State.of(state)


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


@warp.kernel
def _command(
    control: warp.array3d(dtype=float),
    which: warp.array(dtype=int),
    at: warp.array(dtype=int),
    out: warp.array2d(dtype=float),
) -> None:
    world, k = warp.tid()  # type: ignore[misc]
    out[world, k] = control[which[world], at[0], k]


@warp.kernel
def _move(
    velocity: warp.array2d(dtype=float),
    timestep: warp.float64,
    exact: warp.array2d(dtype=warp.float64),
    position: warp.array2d(dtype=float),
) -> None:
    world, k = warp.tid()  # type: ignore[misc]
    exact[world, k] += timestep * warp.float64(velocity[world, k])
    position[world, k] = float(exact[world, k])


@warp.kernel
def _keep(
    values: warp.array2d(dtype=float),
    at: warp.array(dtype=int),
    every: int,
    out: warp.array3d(dtype=float),
) -> None:
    world, k = warp.tid()  # type: ignore[misc]
    out[world, at[0] // every, k] = values[world, k]


@warp.kernel
def _count(at: warp.array(dtype=int)) -> None:
    at[0] = at[0] + 1


class _Worlds:
    """Robots whose models have the same structure, on a device."""

    def __init__(self, plants: Sequence[Plant], device: str) -> None:
        model = plants[0].model
        if model.nhistory or model.nq != model.nv:
            raise InputError(
                "device: joints with more coordinates than degrees of freedom, and delays of "
                "actuators in the MJCF, cannot be simulated there; generate without a device"
            )
        self.device = warp.get_device(device)
        self.count = len(plants)
        self.timestep = float(model.opt.timestep)
        with warp.ScopedDevice(self.device):
            try:
                self.model = mujoco_warp.put_model(model)
            except NotImplementedError as error:
                raise InputError(
                    f"device: MuJoCo Warp cannot simulate this model: {one_line(error)}"
                ) from None
            # channels are made of the state and of forces, so that no sensor has to be computed
            self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_SENSOR
            self.data = mujoco_warp.make_data(model, nworld=self.count)
            self.exact = warp.zeros((self.count, model.nv), dtype=warp.float64)
            self.at = warp.zeros(1, dtype=int)
            self.which = warp.zeros(self.count, dtype=int)
        self.expanded: set[str] = set()
        self.signals: list[np.ndarray] = []
        self.used: tuple[mujoco.MjModel, ...] = ()
        self.buffers: tuple[Any, ...] = ()
        self.graph: Any = None

    def use(self, plants: Sequence[Plant], commands: Sequence[np.ndarray]) -> None:
        """Give every world the numbers of its plant, and its control signal of one cycle.

        A plant that leaves the signal alone returns the same array, which is then kept once.
        """
        different = {id(one): one for one in commands}
        places = {key: place for place, key in enumerate(different)}
        self.signals = [one.astype(np.float32) for one in different.values()]
        self.which.assign(np.array([places[id(one)] for one in commands], dtype=np.int32))
        models = tuple(plant.model for plant in plants)
        if models == self.used:
            return
        for name in OWN:
            values = [np.asarray(getattr(model, name)) for model in models]
            if values[0].size == 0:
                continue
            stacked = np.stack(values).astype(getattr(self.model, name).numpy().dtype)
            array = getattr(self.model, name)
            if name not in self.expanded and (stacked == stacked[0]).all():
                array.assign(stacked[:1].reshape(array.numpy().shape))
                continue
            if name not in self.expanded:
                self.expanded.add(name)
                self.graph = None  # it holds the address of the shared numbers
                array = warp.empty(
                    (self.count, *array.shape[1:]), dtype=array.dtype, device=self.device
                )
                setattr(self.model, name, array)
            array.assign(stacked.reshape(array.numpy().shape))
        self.used = models

    def put_states(self, states: Sequence[_State]) -> None:
        """Set the state of every world."""
        self.exact.assign(np.stack([one.qpos for one in states]))
        for name in _STATE:
            values = np.stack([getattr(one, name) for one in states])
            if values.size:
                getattr(self.data, name).assign(values.astype(np.float32))

    def get_states(self) -> list[_State]:
        """Read the state of every world."""
        values = [self.exact.numpy().copy()]
        values += [getattr(self.data, name).numpy().astype(float) for name in _STATE[1:]]
        return [_State(*one) for one in zip(*values, strict=True)]

    def run(self, first: int, every: int) -> dict[str, np.ndarray]:
        """Step all worlds through their control signals.

        Args:
            first: Number of the step of the signals that comes first, from 0.
            every: Number of steps from one sample to the next.

        Returns:
            The recorded fields by name, each of shape (worlds, samples, elements).
        """
        steps, size = len(self.signals[0]), _SAMPLES * every
        kept: dict[str, list[np.ndarray]] = {name: [] for name in RECORD}
        with warp.ScopedDevice(self.device):
            for start in range(first, steps, size):
                part = np.stack([one[start : start + size] for one in self.signals])
                for name, values in self._part(part, every).items():
                    kept[name].append(values)
        return {name: np.concatenate(parts, axis=1) for name, parts in kept.items()}

    def _part(self, signals: np.ndarray, every: int) -> dict[str, np.ndarray]:
        """Step through a part of the control signals, of shape (signals, steps, n_controls)."""
        control, records = self._buffers(len(signals), every, signals.shape[2])
        padded = np.zeros(control.shape, dtype=np.float32)
        padded[:, : signals.shape[1]] = signals
        control.assign(padded)
        self.at.zero_()
        whole, left = divmod(signals.shape[1], every)
        for _ in range(whole):
            self._sample(control, records, every)
        if left:
            self._steps(control, records, every, left)
        kept = {name: records[name].numpy()[:, : whole + (left > 0)] for name in RECORD}
        if self.device.is_cuda:
            return kept
        return {name: values.copy() for name, values in kept.items()}  # these are the arrays

    def _buffers(self, signals: int, every: int, controls: int) -> tuple[Any, dict[str, Any]]:
        """Arrays on the device for a part of the control signals and for the samples of it."""
        if not self.buffers or self.buffers[0] != (signals, every):
            self.graph = None
            control = warp.zeros(
                (signals, _SAMPLES * every, controls), dtype=float, device=self.device
            )
            records = {
                name: warp.zeros(
                    (self.count, _SAMPLES, getattr(self.data, name).shape[1]),
                    dtype=float,
                    device=self.device,
                )
                for name in RECORD
            }
            self.buffers = (signals, every), control, records
        return self.buffers[1], self.buffers[2]

    def _sample(self, control: Any, records: dict[str, Any], every: int) -> None:
        """Step from one sample to the next; on a graphics card, by a graph that is made once."""
        if not self.device.is_cuda:
            self._steps(control, records, every, every)
            return
        if self.graph is None:
            self._load(control, records, every)
            with warp.ScopedCapture(device=self.device) as capture:
                self._steps(control, records, every, every)
            self.graph = capture.graph
        warp.capture_launch(self.graph)

    def _load(self, control: Any, records: dict[str, Any], every: int) -> None:
        """Compile and load what a step needs, which cannot be done while a graph is made."""
        data = self.data
        arrays = (self.exact, data.qpos, data.qvel, data.act, data.qacc_warmstart, self.at)
        before = [array.numpy().copy() for array in arrays]
        self._steps(control, records, every, 1)
        for array, values in zip(arrays, before, strict=True):
            if values.size:
                array.assign(values)

    def _steps(self, control: Any, records: dict[str, Any], every: int, steps: int) -> None:
        """Make steps, the first of which is a sample."""
        data = self.data
        for step in range(steps):
            warp.launch(
                _command,
                dim=data.ctrl.shape,
                inputs=[control, self.which, self.at],
                outputs=[data.ctrl],
                device=self.device,
            )
            mujoco_warp.step(self.model, data)
            if step == 0:  # these fields describe the state before the step
                for name in RECORD:
                    values = getattr(data, name)
                    if values.size:
                        warp.launch(
                            _keep,
                            dim=values.shape,
                            inputs=[values, self.at, every],
                            outputs=[records[name]],
                            device=self.device,
                        )
            warp.launch(
                _move,
                dim=data.qvel.shape,
                inputs=[data.qvel, self.timestep],
                outputs=[self.exact, data.qpos],
                device=self.device,
            )
            warp.launch(_count, dim=1, inputs=[self.at], device=self.device)

"""Robots whose models have the same structure, as worlds of MuJoCo Warp on a device.

    batch = Worlds(plants, "cuda")
    batch.use(plants, commands)
    batch.put_states(states)
    batch.run(0, every)["actuator_force"]  # (worlds, samples, elements)

`worlds` says how positions are summed up in double precision.
"""

# mypy: disable-error-code="valid-type, misc"
# (arguments of kernels are annotated with arrays, and `tid` gives as many numbers as are asked for)
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import mujoco
import mujoco_warp
import numpy as np
import warp
from mujoco.batch import Batch

from faultgen.errors import InputError, one_line
from faultgen.simulation.channels import RECORD
from faultgen.simulation.plant import Plant

OWN = tuple(
    field.name
    for field in fields(mujoco_warp.Model)
    if getattr(field.type, "shape", ())[:1] == ("*",)
)
"""Names of the fields of a model that each world may have for itself."""


_STATE = ("qpos", "qvel", "act", "qacc_warmstart")
_SAMPLES = 250  # that are stepped at once; bounds the memory on the device

warp.config.log_level = warp.LOG_WARNING  # stdout belongs to the results of the command


@dataclass(frozen=True, eq=False)
class State:
    """State of one robot, with the names of MuJoCo."""

    qpos: np.ndarray
    """Positions, shape (nq,)."""
    qvel: np.ndarray
    """Velocities, shape (nv,)."""
    act: np.ndarray
    """States of the actuators, such as deflections of bristles, shape (na,)."""
    qacc_warmstart: np.ndarray
    """Accelerations from which the next step starts its search, shape (nv,)."""

    @classmethod
    def of(cls, batch: Batch) -> State:
        """Read the state of a batch of one simulation.

        Args:
            batch: The batch.
        """
        return cls(*(getattr(batch, name)[0].copy() for name in _STATE))

    def batch(self, model: mujoco.MjModel) -> Batch:
        """Make a batch of one simulation with this state.

        Args:
            model: Its model.
        """
        made = Batch(model, 1, 1)
        for name in _STATE:
            getattr(made, name)[0] = getattr(self, name)
        return made


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


class Worlds:
    """Robots whose models have the same structure, on a device."""

    def __init__(self, plants: Sequence[Plant], device: str) -> None:
        """Make the worlds.

        Args:
            plants: The robots.
            device: Name of the device, as Warp knows it.

        Raises:
            InputError: MuJoCo Warp cannot simulate their model.
        """
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

        Args:
            plants: Of each world, with the structure of the first ones.
            commands: Control signal of each world, shape (steps, n_controls).
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

    def put_states(self, states: Sequence[State]) -> None:
        """Set the state of every world.

        Args:
            states: Of each world.
        """
        self.exact.assign(np.stack([one.qpos for one in states]))
        for name in _STATE:
            values = np.stack([getattr(one, name) for one in states])
            if values.size:
                getattr(self.data, name).assign(values.astype(np.float32))

    def get_states(self) -> list[State]:
        """Read the state of every world."""
        values = [self.exact.numpy().copy()]
        values += [getattr(self.data, name).numpy().astype(float) for name in _STATE[1:]]
        return [State(*one) for one in zip(*values, strict=True)]

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

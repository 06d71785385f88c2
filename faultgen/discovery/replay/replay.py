"""Replay of a recording: the recorded motion, simulated with the model in closed loop."""

from __future__ import annotations

import copy
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from faultgen.discovery.replay.followed import Followed, followed, rotor_steps
from faultgen.discovery.replay.prescribed import TURN, prescribed, stiffen
from faultgen.discovery.replay.smoothed_load import SmoothedLoad
from faultgen.discovery.terms.candidates import INERTIA, Term, applied
from faultgen.discovery.terms.inertia import Moved, apply_inertia
from faultgen.effects import Applied, get_effect
from faultgen.errors import InputError, SimulationFailed, one_line
from faultgen.recordings.recording import Recording
from faultgen.robot import Robot
from faultgen.simulation.cycle import Cycle
from faultgen.simulation.plant import Plant, assemble
from faultgen.simulation.servo import control_signal
from faultgen.simulation.stepping import simulate

SETTLING = 0.3
"""Time that the simulation needs to settle after an axis begins to turn [s]: assumed."""

Changes = Sequence[tuple[Term, float]]
"""Terms and their values."""


@dataclass(frozen=True, eq=False)
class _Motion:
    """A recorded position as a motion, by cubic splines."""

    robot: Robot
    period: float
    spline: BSpline

    def __call__(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return self.spline(times), self.spline(times, 1), self.spline(times, 2)


class Replay:
    """The motion of a recording, which can be simulated with changes of the model.

    Either the rotors are on their measured positions (see `prescribed`), smoothed according to
    their own noise, so that neither the servo nor its errors have a part in the torque. Or the
    model's own servo tracks the commanded positions; the controller is always that of the unchanged
    model.
    """

    def __init__(self, recording: Recording, robot: Robot, *, measured: bool = True) -> None:
        """Prepare the motion.

        Args:
            recording: The measured data.
            robot: The model.
            measured: Whether the rotors are on their measured positions. Otherwise the servo of the
                model follows the commanded ones; the measured ones if none were recorded.
        """
        self.recording = recording
        self.robot = robot
        self.measured = measured
        """Whether the rotors are on their measured positions."""
        self.left_out: np.ndarray | None = None
        """Samples that are not compared, beside those of `samples.counted`; shape (samples,
        n_axes)."""
        self.moved: Moved | None = None
        """How the robot's links came from those to which terms refer; None if they are the same."""
        self.load: SmoothedLoad | None = None
        """What loads on the rotors change; None where they change the torque by themselves."""
        self.strengths: list[list[float | None]] = []
        """Common logarithm of the penalty with which the measured position of each axis of each
        separate recording was smoothed; empty where the rotors are not on measured positions."""
        self._cycles: list[Cycle] | None = None
        if measured:
            found = _followed(recording, robot)
            self.wanted, self.strengths = found.position, found.strengths
            if not recording.link:
                self.load = SmoothedLoad(recording, robot, found.strengths)
            # simulated there without a temperature
            self._cycles = None if self.by_temperature(()) else found.cycles
        else:
            self.wanted = recording.commanded(robot)
        """Measured position, smoothed, or the commanded one; joint side, shape (samples, n_axes),
        without twist of the gearboxes."""
        at = robot.model.actuator_ctrladr[robot.ids("actuator", "drive")]
        self.controls = [] if measured else self._controls(self.wanted)
        self.rotors = (
            [
                rotor_steps(robot, self.wanted[part], recording.sample_period)
                for part in recording.parts
            ]
            if measured
            else [control[:, at] for control in self.controls]
        )
        """Position of the rotors at every step, measured or commanded, of each separate recording;
        shape (steps, n_axes), in [rad]."""

    def _controls(self, reference: np.ndarray) -> list[np.ndarray]:
        """Control signal of each separate recording, for positions of shape (samples, n_axes)."""
        recording = self.recording
        robot = self.robot
        timestep = robot.model.opt.timestep
        controls = []
        for part in recording.parts:
            times = np.arange(part.stop - part.start) * recording.sample_period
            spline = make_interp_spline(times, reference[part])
            motion = _Motion(robot, times[-1] + timestep, spline)
            controls.append(control_signal(motion, timestep))  # type: ignore[arg-type]
        return controls

    def without(self, samples: np.ndarray) -> Replay:
        """Return the same replay, with further samples that are not compared.

        Args:
            samples: Mask of shape (samples, n_axes).
        """
        other = copy.copy(self)
        other.left_out = samples
        return other

    def on(self, robot: Robot) -> Replay:
        """Return the same motion and commands for another robot.

        Args:
            robot: A model that differs from that of this replay in its numbers and effects only.
        """
        if robot is self.robot:
            return self
        other = copy.copy(self)
        other.robot, other._cycles = robot, None
        return other

    def with_links(self, robot: Robot, moved: Moved) -> Replay:
        """Return the same motion for a robot with other links.

        Args:
            robot: The robot with these links.
            moved: How they came from those of this replay.
        """
        other = self.on(robot)
        other.moved = moved
        return other

    def with_effects(self, effects: Sequence[Applied]) -> Replay:
        """Return the same motion and commands for the robot with further effects.

        Args:
            effects: Effects of the catalogue, or learned laws.
        """
        return self.on(self.robot.with_effects(effects))

    def torque(self, changes: Changes = (), disturbance: np.ndarray | None = None) -> np.ndarray:
        """Simulate the torque on the recorded motion.

        Args:
            changes: Changes of the model: terms and values.
            disturbance: Torque on the rotors in addition to the drives', shape (samples, n_axes),
                in [N m].

        Returns:
            Torque that the robot would have logged, on the recording's side and in its unit, shape
            (samples, n_axes). For sensors behind the gearbox, it is the torque of the gearbox.

        Raises:
            SimulationFailed: The simulation diverged, or the model cannot have the changes.
        """
        if self.recording.link:
            return self._logged("gear_torque", changes, disturbance)
        if self.measured:
            torque = self._compared(changes)
        else:
            torque = self._logged("motor_torque", changes, disturbance)
        if disturbance is not None:  # the drives log their part of what is needed
            pushed = disturbance if self.load is None else self.load.seen(disturbance)
            torque -= pushed / self.robot.torque_gain
        return torque if self.recording.side == "motor" else torque * self.robot.gear_ratio

    @property
    def cycles(self) -> list[Cycle]:
        """What the unchanged model on its measured positions would log, at every simulation step.

        There is one for each separate recording. They are simulated once.
        """
        if self._cycles is None:
            self._cycles = list(self._prescribed(()))
        return self._cycles

    def __getstate__(self) -> dict[str, Any]:
        """What other processes get; they simulate with changes."""
        return {**vars(self), "_cycles": None}

    def held(self) -> Replay:
        """Return the same motion with rotors that are held on the simulated motion of the model."""
        other = copy.copy(self)
        other._cycles = list(self._commanded((), None, self.robot.model.opt.timestep))
        other.measured, other.rotors = True, [run.motor_position for run in other._cycles]
        return other

    def position(self, changes: Changes = ()) -> np.ndarray:
        """Simulate the position on the recorded motion.

        Args:
            changes: Changes of the model: terms and values.

        Returns:
            Position that would have been measured, on the recording's side, shape (samples,
            n_axes), in [rad], or [m] for slides.

        Raises:
            SimulationFailed: The simulation diverged, or the model cannot have the changes.
        """
        position = self._logged("motor_position", changes)
        return position if self.recording.side == "motor" else position / self.robot.gear_ratio

    def _logged(
        self, channel: str, changes: Changes, disturbance: np.ndarray | None = None
    ) -> np.ndarray:
        """A channel of the simulation at the samples of the recording."""
        return self._sampled(channel, self._runs(changes, disturbance))

    def _runs(self, changes: Changes, disturbance: np.ndarray | None = None) -> Iterable[Cycle]:
        """Simulate each separate recording."""
        if self.measured:
            return self._prescribed(changes) if changes else self.cycles
        return self._commanded(changes, disturbance, self._every * self.robot.model.opt.timestep)

    @property
    def _every(self) -> int:
        """Steps of the simulation in a sample of the recording, see `_whole`."""
        return _whole(self.recording.sample_period / self.robot.model.opt.timestep)

    def _sampled(self, channel: str, runs: Iterable[Cycle]) -> np.ndarray:
        """A channel of simulations at the samples of the recording."""
        recording, timestep = self.recording, self.robot.model.opt.timestep
        logged, every = np.empty_like(recording.torque), self._every
        for part, run in zip(recording.parts, runs, strict=True):
            values = getattr(run, channel)[:: every if self.measured else 1]
            if every > 1 or np.isclose(recording.sample_period, timestep):
                logged[part] = values[: part.stop - part.start]
                continue
            times = np.arange(part.stop - part.start) * recording.sample_period
            simulated = np.arange(len(values)) * timestep
            for axis in range(self.robot.n_axes):
                logged[part, axis] = np.interp(times, simulated, values[:, axis])
        return logged

    def _compared(self, changes: Changes) -> np.ndarray:
        """Torque of the motors that smoothed positions let expect; see `smoothed_load`."""
        if self.load is None:
            return self._logged("motor_torque", changes)
        runs = list(self._runs(changes))
        torque, speed = (self._sampled(name, runs) for name in ("motor_torque", "motor_velocity"))
        inertia = self.robot.model.dof_M0[list(self.robot.motors)] / self.robot.torque_gain
        of_motion = np.empty_like(torque)
        for part in self.recording.parts:
            rate = np.gradient(speed[part], self.recording.sample_period, axis=0)
            of_motion[part] = inertia * rate
        return of_motion + self.load.seen(torque - of_motion)

    def _prescribed(self, changes: Changes) -> Iterator[Cycle]:
        """Simulate each separate recording on its measured positions, at every step."""
        for plant, rotors in zip(self._plants(changes), self.rotors, strict=True):
            yield prescribed(self.robot, plant, rotors)

    def _commanded(
        self, changes: Changes, disturbance: np.ndarray | None, period: float
    ) -> Iterator[Cycle]:
        """Simulate each separate recording with a servo that follows commands."""
        of_parts = zip(self._plants(changes), self.controls, self.recording.parts, strict=True)
        for plant, control, part in of_parts:
            if disturbance is not None:
                control = self._pushed(control, disturbance[part])
            yield from simulate(self.robot, control, [plant], sample_period=period, lead_in=0.0)

    def _plants(self, changes: Changes) -> Iterator[Plant]:
        """The robot with changes in each separate recording."""
        plant, differs = None, self.by_temperature(changes)
        for part in self.recording.parts:
            if plant is None or differs:
                plant = self._plant(changes, part)
            yield plant

    def by_temperature(self, changes: Changes) -> bool:
        """Whether the robot with changes has an effect that depends on the temperature.

        Args:
            changes: Changes of the model: terms and values.
        """
        names = {one.effect for one in (*self.robot.effects, *applied(changes))}
        return any("temperature" in get_effect(name).parameters for name in names)

    def _pushed(self, control: np.ndarray, disturbance: np.ndarray) -> np.ndarray:
        """Control signals with a torque added to the feed-forward."""
        model = self.robot.model
        at = model.actuator_ctrladr[self.robot.ids("actuator", "drive")] + 2
        steps = np.arange(len(control)) * model.opt.timestep
        times = np.arange(len(disturbance)) * self.recording.sample_period
        control = control.copy()
        for axis, column in enumerate(at):
            control[:, column] += np.interp(steps, times, disturbance[:, axis])
        return control

    def refusal(self, changes: Changes) -> str:
        """Say why the model cannot have changes; empty if it can.

        Args:
            changes: Changes of the model: terms and values.
        """
        try:
            self._plant(changes, self.recording.parts[0])
        except SimulationFailed as error:
            return str(error)
        return ""

    def _plant(self, changes: Changes, part: slice) -> Plant:
        recording, robot = self.recording, self.robot
        spec = robot.spec()
        if self.measured and recording.link:
            for axis in range(1, robot.n_axes + 1):
                stiffen(spec.tendon(f"gearbox{axis}"))
        apply_inertia(spec, robot, [change for change in changes if change[0].name == INERTIA])
        effects = applied(changes)
        temperature = None
        if recording.temperature is not None:
            times = np.arange(part.stop - part.start) * recording.sample_period
            temperature = times, recording.temperature[part]
        try:
            return assemble(robot, effects, temperature=temperature, spec=spec)
        except InputError as error:  # a candidate that this model cannot have, such as no payload
            raise SimulationFailed(str(error)) from error
        except ValueError as error:  # of MuJoCo's compiler
            line = one_line(error)
            raise SimulationFailed(f"MuJoCo cannot compile the changed model: {line}") from None


_KEPT: deque[tuple[Recording, str, Followed]] = deque(maxlen=4)
# a comparison of two recordings needs each with its model several times


def _followed(recording: Recording, robot: Robot) -> Followed:
    """The smoothed motion of a recording; its arrays must not be changed."""
    for known, content, found in _KEPT:
        if known is recording and content == robot.sha256:
            return found
    found = followed(recording, robot, settled(recording, robot))
    _KEPT.append((recording, robot.sha256, found))
    return found


def _whole(steps: float) -> int:
    """Number of simulation steps per sample, or 1 if it is not a whole number."""
    whole = round(steps)
    return whole if whole >= 1 and abs(steps - whole) < 1e-6 else 1


def settled(recording: Recording, robot: Robot) -> np.ndarray:
    """Find the samples at which a replay can be compared with the recording.

    At rest, the torque of an axis depends on how it came to rest, and the recording does not
    contain that. In each separate recording, an axis is used from `SETTLING` after it has turned
    its motor by `TURN`.

    Args:
        recording: The measured data.
        robot: The model.

    Returns:
        Mask of shape (samples, n_axes).
    """
    position = recording.motor_position(robot)
    skipped = round(SETTLING / recording.sample_period)
    mask = np.zeros(recording.position.shape, bool)
    for part in recording.parts:
        turned = np.abs(position[part] - position[part.start]) > TURN
        for axis in np.flatnonzero(turned.any(axis=0)):
            first = part.start + int(np.argmax(turned[:, axis])) + skipped
            mask[first : part.stop, axis] = True
    return mask

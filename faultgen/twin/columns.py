"""What faults and healthy days would change on a program: columns for the detector.

    columns = Columns(recording, robot)
    columns.days(program), columns.effects(program, faults)

What acts on a rotor, and masses, change the torque on the measured motion by a formula, whatever
the controller knows (`faultgen.discovery.replay.formulas`). What acts behind a gearbox moves the
rotor as well, and the servo answers: its change is the mean of generated runs, in closed loop.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from faultgen.analysis import Cause, Days, Effects, Form
from faultgen.discovery.decision.arrays import at_rest
from faultgen.discovery.decision.numbers import KINDS, Numbers, is_number, numbers_of
from faultgen.discovery.decision.processes import Process, processes
from faultgen.discovery.laws.friction_forms import forms_of
from faultgen.discovery.replay.bristles import FRICTION
from faultgen.discovery.replay.formulas import Formulas
from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.replay.sensitivities import FOLLOWS, sensitivities
from faultgen.discovery.terms.candidates import ARM, PAYLOAD, Term, effect_terms, payload_terms
from faultgen.discovery.terms.inertia import inertia_terms
from faultgen.effects import get_effect
from faultgen.effects.temperature import friction_ratios
from faultgen.recordings.recording import Recording
from faultgen.robot import COULOMB, STICTION, STRIBECK_VELOCITY, Robot
from faultgen.twin.program import Program
from faultgen.twin.warming import Warming

TEMPERATURE = "temperature"
"""Name of the cause that friction of all axes follows another temperature."""

UNKNOWN = "unknown"
"""Name of the family of causes that no fault explains."""

INEXACT = 0.15
"""Error of a simulated signature, over its size, as a smooth function of speed, angle or load:
assumed."""

SEVERITIES = (1 / 16, 1 / 8, 1 / 4, 1 / 2, 1.0)
"""Severities at which forms of a fault are compared, over the largest one in the data. A factor of
2 lies between neighbours, and each covers half of its own severity (one standard deviation)."""

_COVERS = 0.5
_UNKNOWN_ON = f"{UNKNOWN} change of axis"
_SHAPES = 6  # independent errors of a signature: those beyond change less than the noise
_UNLIKE = 1.5  # by how much axes differ in their days; with it, 1 % was stated and 1 to 2 % found
_UNKNOWN_SIZES = (0.01, 0.1)  # of torques of no known form, over the RMS torque of an axis
_OFF_CENTRE = 0.2  # of an unknown payload [m]: assumed
_KELVIN = (3.0, 10.0)  # differences of the temperature between days [K]: assumed
_DAILY_LOAD = 0.01  # usual difference of the payload between recordings, over its mass: assumed
_UNEVEN = 0.3  # share by which an axis may be warmer than others: assumed


@dataclass(frozen=True, kw_only=True)
class Fault:
    """An effect on some axes, which the detector can name."""

    effect: str
    """Name in the catalogue."""
    axes: tuple[int, ...]
    """From 1."""
    largest: float
    """Largest severity in the data, in the unit of the effect."""
    unit: str
    """SI unit of severity, "1" for a fraction."""

    @property
    def name(self) -> str:
        """Effect and axes as text."""
        axes = " and ".join(map(str, self.axes))
        return f"{self.effect} on {'axis' if len(self.axes) == 1 else 'axes'} {axes}"


@dataclass(frozen=True, eq=False, kw_only=True)
class Generated:
    """Generated cycles with one fault."""

    fault: Fault
    """The fault."""
    parameters: Mapping[str, float] = field(default_factory=dict)
    """Further parameters of the effect."""
    change: np.ndarray
    """Torque less the healthy mean, at the places that are compared, shape (cycles, places,
    n_axes), in [N m]."""
    severity: np.ndarray
    """Severity over the largest one, shape (cycles,)."""
    measured: bool = False
    """Whether these are cycles of the robot itself, and not of its model."""

    def signature(self, at: float) -> np.ndarray:
        """Compute the change of the torque per unit of severity about one severity.

        Args:
            at: Severity over the largest one.

        Returns:
            Shape (places, n_axes), in [N m] per unit of the effect.
        """
        linear, quadratic = self._curve
        return np.asarray((linear + quadratic * at) / self.fault.largest)

    @cached_property
    def _curve(self) -> np.ndarray:
        """Linear and quadratic part of the change."""
        powers = np.stack([self.severity, self.severity**2], axis=1)
        return np.tensordot(np.linalg.pinv(powers), self.change, axes=1)


@dataclass(eq=False)
class _Causes:
    """Columns and causes that are collected."""

    columns: list[np.ndarray] = field(default_factory=list)
    causes: list[Cause] = field(default_factory=list)
    faults: list[Fault] = field(default_factory=list)

    def add(self, columns: Sequence[np.ndarray]) -> tuple[int, ...]:
        """Add columns, and return their numbers."""
        first = len(self.columns)
        self.columns += columns
        return tuple(range(first, len(self.columns)))


class Columns:
    """Columns of one program of one robot."""

    def __init__(self, recording: Recording, robot: Robot) -> None:
        """Simulate the robot on the motion.

        Args:
            recording: The healthy robot, from `as_recording`.
            robot: Its model.
        """
        self.robot = robot
        self._replay = Replay(recording, robot)
        terms = [t for t in effect_terms(robot) + inertia_terms(robot) if is_number(t)]
        self._base, raw = sensitivities(self._replay, terms)
        self._formulas = Formulas.of(self._replay)
        self.numbers: Numbers = numbers_of(
            self._formulas, forms_of(self._formulas), terms, raw, self._base, baseline=True
        )
        """What may differ from day to day."""
        shape = (len(FOLLOWS), robot.n_axes, *self._base.shape)
        self._of_friction = np.zeros(shape)  # per unit of the ratios of a temperature
        coulomb = robot.model.actuator_biasprm[robot.ids("actuator", "friction"), COULOMB]
        self._direction = np.zeros_like(self._base)
        for term, column in zip(terms, raw, strict=True):
            k = term.axis - 1
            if term.name == "coulomb_friction" and not term.parameters and coulomb[k] > 0:
                self._direction[:, k] = column[:, k] * robot.torque_gain[k] / coulomb[k]
            if term.name in FOLLOWS:
                self._of_friction[FOLLOWS.index(term.name), term.axis - 1] = column
        if len(load := self._payload(robot.n_axes)):
            usual = robot.payload_mass or payload_terms(robot, robot.n_axes)[0].step
            self.numbers.add(load[0], _DAILY_LOAD * usual, "load at the flange")

    def law_of_temperature(self, temperature: np.ndarray) -> Warming:
        """Return how friction follows the temperature by the law of the catalogue.

        Args:
            temperature: Of the gearboxes in healthy recordings, shape (recordings, n_axes), in
                [deg C].
        """
        robot = self.robot
        elements = robot.ids("actuator", "friction")
        bias = robot.model.actuator_biasprm[elements]
        friction = [
            (bias[:, STICTION] - bias[:, COULOMB]) / robot.torque_gain,
            bias[:, STRIBECK_VELOCITY],
            robot.model.actuator_damping[elements] / robot.torque_gain,
        ]
        return Warming(
            reference=robot.friction_temperature,
            mean=temperature.mean(axis=0),
            friction=np.array(friction),
            speed=self._formulas.motion.speed,
            direction=self._direction,
            range=np.array([temperature.min(axis=0), temperature.max(axis=0)]),
            share=np.ones((len(friction), robot.n_axes)),
        )

    def apart(self, healthy: np.ndarray) -> np.ndarray:
        """Compare one recording with the model: two that differ by as much as noise would.

        What the model lacks counts as noise, so that less is detected.

        Args:
            healthy: Torque of the recording, shape (places, n_axes), in [N m].

        Returns:
            Shape (2, places, n_axes).
        """
        return np.stack([self._base + np.sqrt(2.0) * (healthy - self._base), self._base])

    @property
    def drivers(self) -> list[np.ndarray]:
        """Quantities with which noise may grow: speed and torque, shape (places, n_axes) each."""
        return [self._formulas.motion.speed, self._replay.recording.torque]

    @cached_property
    def _processes(self) -> list[Process]:
        return list(processes(self._replay.recording, self._formulas.motion))

    def days(self, program: Program) -> Days:
        """Return the differences from day to day as features.

        Args:
            program: The program.
        """
        numbers = self.numbers
        names = [name for name in KINDS if name in numbers.kinds]
        return Days(
            program.whiten(np.array(numbers.columns)),
            np.array(numbers.std),
            np.array([names.index(kind) for kind in numbers.kinds], int),
            np.array([KINDS[name].spread_of_days for name in names]),
            _UNLIKE,
        )

    def effects(
        self, program: Program, generated: Sequence[Generated]
    ) -> tuple[Effects, tuple[Fault, ...]]:
        """Return all causes: the faults, a payload, the temperature, and unknown torques.

        Args:
            program: The program.
            generated: Cycles of each fault.

        Returns:
            The causes, and all faults among them. A fault's name is the label of its cause.
        """
        out = _Causes()
        by_formula = self._by_formula(generated)
        for k, one in enumerate(generated):
            if k in by_formula:
                forms = self._forms(out, program, one.fault, by_formula[k], SEVERITIES)
            else:
                forms = []
                for at in SEVERITIES:
                    forms += self._forms(out, program, one.fault, one.signature(at), (at,))
            fault = one.fault
            out.faults.append(fault)
            out.causes.append(Cause(fault.name, fault.effect, tuple(forms), positive=True))
        if (PAYLOAD, (self.robot.n_axes,)) not in [(f.effect, f.axes) for f in out.faults]:
            self._add_payload(out, program)
        self._add_temperature(out, program)
        self._add_unknown(out, program)
        return Effects(np.array(out.columns), tuple(out.causes)), tuple(out.faults)

    def _by_formula(self, generated: Sequence[Generated]) -> dict[int, np.ndarray]:
        """Change of the torque per unit of each fault that has a formula on the measured motion."""
        terms = {
            k: [
                Term(f.effect, axis, f.largest, f.largest, tuple(sorted(complete.items())))
                for axis in f.axes
            ]
            for k, one in enumerate(generated)
            for f in [one.fault]
            for complete in [get_effect(f.effect).complete(one.parameters)]
            if not one.measured and (get_effect(f.effect).prior.at_motor or f.effect == PAYLOAD)
        }
        known = self._formulas.columns([term for own in terms.values() for term in own])
        return {
            k: np.asarray(sum(known[term] for term in own))
            for k, own in terms.items()
            if all(term in known and known[term].any() for term in own)
        }

    def _forms(
        self,
        out: _Causes,
        program: Program,
        fault: Fault,
        signature: np.ndarray,
        severities: Sequence[float],
    ) -> list[Form]:
        """Forms of a fault, whose signature is inexact."""
        stuck = self._stuck(signature) if fault.effect in FRICTION else 0.0 * signature
        own = program.whiten(signature - stuck)
        size = float(own @ own)
        if size == 0:
            return [Form(out.add([own]), (s * fault.largest,)) for s in severities]
        wrong = np.array(
            [INEXACT * program.whiten(signature * by) for by in self._smooth(fault.axes)]
        )
        wrong -= np.outer(wrong @ own / size, own)  # the rest is an error of the severity
        _, lengths, shapes = np.linalg.svd(wrong, full_matrices=False)
        count = min(_SHAPES, int(np.count_nonzero(lengths)))
        moments = self._payload(fault.axes[0])[1:] if fault.effect == PAYLOAD else []
        other = [_OFF_CENTRE * program.whiten(one) for one in moments]
        other += [program.whiten(stuck)] if stuck.any() else []
        numbers = out.add([own, *(lengths[:count, None] * shapes[:count]), *other])
        sizes = [s * fault.largest for s in severities]
        others = len(numbers) - 1
        return [Form(numbers, (_COVERS * size, *(size,) * others), size) for size in sizes]

    def _stuck(self, signature: np.ndarray) -> np.ndarray:
        """Half of a change of friction on axes at rest: there it may be anything up to the whole.

        How far the bristles of an axis at rest are bent depends on how its servo came to rest.
        """
        return signature * at_rest(self._formulas.motion.speed) / 2

    def _smooth(self, axes: Sequence[int]) -> Iterator[np.ndarray]:
        """Smooth functions of the motion of some axes, shape (places, 1) each."""
        for one in self._processes:
            if one.axis in axes and one.over in ("speed", "joint angle", "load"):
                for bump in one.bumps:
                    yield bump[:, None]

    def _payload(self, axis: int) -> list[np.ndarray]:
        """Change of the torque per unit of a mass at the flange, and of its distance from there.

        Returns:
            The mass, and its moment in each direction, shape (places, n_axes) each; none if masses
            have no formula.
        """
        terms = payload_terms(self.robot, axis)
        known = self._formulas.columns(terms)
        if any(term not in known for term in terms):
            return []
        first = known[terms[0]]
        return [first, *((known[term] - first) / ARM for term in terms[1:])]

    def _add_payload(self, out: _Causes, program: Program) -> None:
        """Add a payload that the healthy robot has not, or that it has lost."""
        axis = self.robot.n_axes
        columns = self._payload(axis)
        if not columns or not columns[0].any():
            return
        usual = payload_terms(self.robot, axis)[0].step
        # in kg also where severities of the catalogue are a share of the model's payload
        fault = Fault(effect=PAYLOAD, axes=(axis,), largest=usual, unit="kg")
        mass, *moments = (program.whiten(one) for one in columns)
        numbers = out.add([mass, *(_OFF_CENTRE * one for one in moments)])
        forms = [Form(numbers, (s * usual,) * len(numbers)) for s in SEVERITIES]
        out.faults.append(fault)
        out.causes.append(Cause(fault.name, fault.effect, tuple(forms)))

    def _add_temperature(self, out: _Causes, program: Program) -> None:
        """Add friction of all axes that follows another temperature, by Bittencourt's law."""
        reference = self.robot.friction_temperature
        warmer, colder = (friction_ratios(reference + side, reference) for side in (1.0, -1.0))
        slopes = (np.array(warmer) - colder) / 2
        by_axis = np.tensordot(slopes, self._of_friction, axes=1)
        columns = [by_axis.sum(axis=0), *by_axis[by_axis.any(axis=(1, 2))]]
        if not columns[0].any():
            return
        numbers = out.add([program.whiten(one) for one in columns])
        sizes = (1.0, *(_UNEVEN,) * (len(numbers) - 1))
        forms = [Form(numbers, tuple(k * s for s in sizes)) for k in _KELVIN]
        out.causes.append(Cause(TEMPERATURE, TEMPERATURE, tuple(forms)))

    def _add_unknown(self, out: _Causes, program: Program) -> None:
        """Add torques of no known form of each axis over each variable."""
        rms = np.sqrt(np.mean(self._base**2, axis=0))
        for one in self._processes:
            columns = []
            for bump in one.bumps:
                column = np.zeros_like(self._base)
                column[:, one.axis - 1] = bump * rms[one.axis - 1]
                columns.append(program.whiten(column))
            numbers = out.add(columns)
            forms = [Form(numbers, (size,) * len(numbers)) for size in _UNKNOWN_SIZES]
            label = f"{_UNKNOWN_ON} {one.axis} over {one.over}"
            out.causes.append(Cause(label, UNKNOWN, tuple(forms)))


def unknown_axis(label: str) -> int | None:
    """Return the axis of an unknown change, from 1; None if the cause is another one.

    Args:
        label: Label of a cause.
    """
    return int(label.split()[4]) if label.startswith(_UNKNOWN_ON) else None

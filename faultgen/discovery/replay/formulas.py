"""How terms change the torque of rotors on their measured positions, without a simulation of each.

What acts on a rotor changes the torque of its drive and nothing else, because the rotor moves as it
was measured. What acts behind the gearbox moves the arm by a small x, about the simulated motion of
the unchanged model:

    M x'' + G' D G x' + G' K (G x - u) = l,        change of the gear torque  K (u - G x) - D G x'

with the inertia M of the arm at its pose, stiffness K and damping D of the gearboxes, the turns G
of the gearboxes for one turn of each joint (the unit matrix in most robots), errors u of the
gearboxes and loads l of the joints. Coriolis terms and the change of gravity with x are left out.
The play b of a gearbox is an error that depends on x. With the twist w of the unchanged model,

    u = -clip(w - G x, -b/2, b/2),

which each step of the integration solves exactly. So it does for a share s of the stiffness that
is lost, u = -s (w - G x).
Friction with bristles is in `bristles`, a loose tool in `loose`, the integration in `elastic`.
The time integration is that of Newmark (1959) with constant mean acceleration: it is stable and
adds no damping. tests/discovery/test_formulas.py compares every formula with the simulation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from faultgen.discovery.replay.bristles import FRICTION, friction_columns
from faultgen.discovery.replay.elastic import LAWS, GearLaws, Newmark, Nonlinear, interpolated
from faultgen.discovery.replay.loose import LOOSE, LooseTools, Slide
from faultgen.discovery.replay.prescribed import STIFFER
from faultgen.discovery.terms.candidates import INERTIA, MASSES, Term
from faultgen.discovery.terms.inertia import slopes_of
from faultgen.discovery.terms.regressor import LinkMotion, link_motion
from faultgen.effects.friction import QUADRATIC_SPEED
from faultgen.effects.structure import is_loaded
from faultgen.effects.transmission import REFERENCE_TWIST
from faultgen.robot import COULOMB
from faultgen.simulation.arm import Arm

if TYPE_CHECKING:
    from faultgen.discovery.replay.replay import Replay
    from faultgen.simulation.cycle import Cycle

GEAR_DAMPING = "gear_damping"
"""Term of the damping of a gearbox, a fraction of that of the model. It is no effect."""

_STEP = 1e-3  # of the integration [s]: some 30 steps in a period of a resonance of 30 Hz
_POSE = 0.01  # time in which the inertia of the arm counts as constant [s]
_CHUNK = 2000  # steps of which the causes are in memory
_SHIFT = 1e-3  # of a position, for the slope of the torque of the arm [rad]


@dataclass(frozen=True, eq=False)
class Motion:
    """What effects on the rotors need to know about a motion.

    Arrays have shape (samples, n_axes).
    """

    angle: np.ndarray
    """Of the motors [rad]."""
    speed: np.ndarray
    """Of the motors [rad/s]."""
    acceleration: np.ndarray
    """Of the motors [rad/s^2]."""
    joint: np.ndarray
    """Position of the joints [rad]."""
    gear: np.ndarray
    """Torque of the gearboxes, joint side [N m]."""
    torque: np.ndarray
    """Logged torque of the motors [N m]."""
    rate: np.ndarray
    """Its rate of change [N m/s]."""


class Formulas:
    """Changes of the torque on the measured motion, for terms whose law is simple enough."""

    def __init__(self, replay: Replay) -> None:
        """Prepare the formulas.

        Args:
            replay: The model with its rotors on their measured positions.
        """
        self.replay, self.robot = replay, replay.robot
        self._stiffness = self.robot.model.tendon_stiffness[self.robot.ids("tendon", "gearbox")]
        self._damping = self.robot.model.tendon_damping[self.robot.ids("tendon", "gearbox")]
        if replay.recording.link:
            self._stiffness, self._damping = STIFFER * self._stiffness, STIFFER**0.5 * self._damping
        self._of_links: dict[int, LinkMotion] = {}
        self._turns = self.robot.gearing.matrix / self.robot.gear_ratio[:, None]

    def columns(self, terms: Sequence[Term]) -> dict[Term, np.ndarray]:
        """Compute the change of the torque per unit of each term that has a formula.

        Args:
            terms: Any terms.

        Returns:
            Shape (samples, n_axes) for each term that has a formula, on the recording's side and in
            its unit.
        """
        recording = self.replay.recording
        at_rotor = [term for term in terms if term.name in _AT_ROTOR and not recording.link]
        rubs = [] if recording.link else [term for term in terms if self._rubs(term)]
        in_gear = [term for term in terms if term.name in LAWS]
        in_gear += [term for term in terms if self._slides(term)]
        in_gear += [term for term in terms if term.name in (GEAR_DAMPING, *_IN_GEAR)]
        links = [term for term in terms if term.name in (INERTIA, *MASSES, *_AT_JOINT)]
        out = {term: np.zeros(recording.torque.shape, np.float32) for term in at_rotor}
        for number, part in enumerate(recording.parts if at_rotor else ()):
            seen = self._at_samples(number)
            for term in at_rotor:
                change = _AT_ROTOR[term.name](self, seen, term)
                if term.name not in _OF_LOG:
                    change = change / self.robot.torque_gain[term.axis - 1]
                out[term][part, term.axis - 1] = change
        if rubs:
            out |= self._friction(rubs)
        if in_gear or links:
            out |= self._behind_gears(in_gear, links)
        load = self.replay.load
        if load is not None:
            for term in out:
                if term.name not in _OF_LOG:
                    out[term] = load.seen(out[term])
        scale = 1.0 if recording.side == "motor" or recording.link else self.robot.gear_ratio
        return {term: (column * scale).astype(np.float32) for term, column in out.items()}

    def _slides(self, term: Term) -> bool:
        """Whether a term is a loose tool of a robot that holds its payload firmly."""
        firm = all(one.effect != LOOSE for one in self.robot.effects)
        return term.name == LOOSE and firm and is_loaded(self.robot, term.axis)

    def _rubs(self, term: Term) -> bool:
        """Whether a term is friction on rotors whose law does not change with the temperature."""
        return term.name in FRICTION and not self.replay.by_temperature(())

    def _friction(self, terms: Sequence[Term]) -> dict[Term, np.ndarray]:
        """Change of the motor torque by terms of friction on the rotors."""
        recording = self.replay.recording
        out: dict[Term, np.ndarray] = {}
        for number, part in enumerate(recording.parts):
            at, rotors = self._steps(number), self.replay.rotors[number]
            gear = self._runs[number].gear_torque[at]
            for term, column in friction_columns(self.robot, terms, rotors, at, gear).items():
                out.setdefault(term, np.zeros(recording.torque.shape, np.float32))[part] = column
        return out

    @property
    def _runs(self) -> list[Cycle]:
        return self.replay.cycles

    def _steps(self, number: int) -> np.ndarray:
        """Steps of the simulation at which a separate recording has its samples."""
        part = self.replay.recording.parts[number]
        timestep = self.robot.model.opt.timestep
        times = np.arange(part.stop - part.start) * self.replay.recording.sample_period
        last = len(self._runs[number].motor_position) - 1
        return np.minimum(np.round(times / timestep).astype(int), last)

    @cached_property
    def motion(self) -> Motion:
        """Of all separate recordings, one after the other."""
        motions = [vars(self._at_samples(k)) for k in range(len(self.replay.recording.parts))]
        return Motion(**{name: np.concatenate([m[name] for m in motions]) for name in motions[0]})

    def _at_samples(self, number: int) -> Motion:
        run, at = self._runs[number], self._steps(number)
        timestep = self.robot.model.opt.timestep
        return Motion(
            angle=run.motor_position[at],
            speed=run.motor_velocity[at],
            acceleration=_slope(run.motor_velocity, at, timestep),
            joint=run.joint_position[at],
            gear=run.gear_torque[at],
            torque=run.motor_torque[at],
            rate=_slope(run.motor_torque, at, timestep),
        )

    def friction(self, name: str, axis: int) -> float:
        """Read a parameter of the model's friction, motor side.

        Args:
            name: 'coulomb' [N m] or 'viscous' [N m s/rad].
            axis: Axis, from 1.
        """
        element = self.robot.ids("actuator", "friction")[axis - 1]
        if name == "coulomb":
            return float(self.robot.model.actuator_biasprm[element, COULOMB])
        return float(self.robot.model.actuator_damping[element])

    def inertia(self, axis: int) -> float:
        """Read the inertia of a rotor [kg m^2].

        Args:
            axis: Axis, from 1.
        """
        return float(self.robot.model.dof_M0[self.robot.motors[axis - 1]])

    @cached_property
    def _arm(self) -> Arm:
        return Arm(self.robot)

    def _joints(self, number: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Position, velocity and acceleration of the joints at the samples."""
        timestep, at = self.robot.model.opt.timestep, self._steps(number)
        joint = self._runs[number].joint_position
        before, after = _beside(at, len(joint))
        less, more = (_slope(joint, steps, timestep) for steps in (before, after))
        acceleration = (more - less) / ((after - before)[:, None] * timestep)
        return joint[at], _slope(joint, at, timestep), acceleration

    def _links(self, number: int) -> LinkMotion:
        """Motion of the links at the samples."""
        if number not in self._of_links:
            self._of_links[number] = link_motion(self._arm, *self._joints(number))
        return self._of_links[number]

    def _loads(self, number: int, terms: Sequence[Term], slopes: np.ndarray) -> np.ndarray:
        """Loads of the joints at the samples for a unit of each term.

        Args:
            number: Of the separate recording, from 0.
            terms: Terms of masses, and of `_AT_JOINT`.
            slopes: As from `slopes_of`, for the terms of masses.

        Returns:
            Shape (samples, n_axes, terms), in [N m].
        """
        q, qd, qdd = self._joints(number)
        out = np.zeros((len(q), self.robot.n_axes, len(terms)))
        masses = [k for k, term in enumerate(terms) if term.name not in _AT_JOINT]
        if masses:
            out[:, :, masses] = self._links(number).regressor() @ slopes
        for k, term in enumerate(terms):
            if term.name not in _AT_JOINT:
                continue
            if term.name == "gravity_spring":
                out[:, term.axis - 1, k] = q[:, term.axis - 1]
            else:  # the true angle is the logged one plus the offset
                shift = _SHIFT * np.eye(self.robot.n_axes)[term.axis - 1]
                more, less = (
                    self._arm.inverse_dynamics(q + side * shift, qd, qdd) for side in (1, -1)
                )
                out[:, :, k] = (more - less) / (2 * _SHIFT)
        return out

    def _behind_gears(
        self, in_gear: Sequence[Term], links: Sequence[Term]
    ) -> dict[Term, np.ndarray]:
        """Change of the torque by terms that act behind the gearboxes, motor side."""
        recording, ratio = self.replay.recording, self.robot.gear_ratio
        terms = [*in_gear, *links]
        out = np.zeros((*recording.torque.shape, len(terms)), np.float32)
        slopes = slopes_of(
            self.robot, [term for term in links if term.name not in _AT_JOINT], self.replay.moved
        )
        for number, part in enumerate(recording.parts):
            loads = self._loads(number, links, slopes)
            gear = self._gear_changes(number, in_gear, loads)
            if not recording.link:
                gear /= ratio[:, None]
                run, at = self._runs[number], self._steps(number)
                for k, term in enumerate(in_gear):
                    if term.name == "transmission_error":
                        order, phase = _wave(term)
                        own = term.axis - 1
                        slope = order * np.cos(order * run.motor_position[at, own] + phase)
                        gear[:, own, k] += run.gear_torque[at, own] * slope
                gear /= self.robot.torque_gain[:, None]
            out[part] = gear
        return {term: out[..., k] for k, term in enumerate(terms)}

    def _gear_changes(self, number: int, in_gear: Sequence[Term], loads: np.ndarray) -> np.ndarray:
        """Change of the gear torques at the samples: (samples, n_axes, terms), joint side [N m]."""
        run, timestep = self._runs[number], self.robot.model.opt.timestep
        every = max(1, round(_STEP / timestep))
        h = every * timestep
        angle, joint = run.motor_position[::every], run.joint_position[::every]
        twist = angle / self.robot.gear_ratio - joint @ self._turns.T
        rate = np.gradient(twist, h, axis=0)
        count, n = twist.shape
        samples = np.minimum(np.round(self._steps(number) / every).astype(int), count - 1)
        # numbers of the samples at the steps, not whole
        times = np.arange(count) * h / self.replay.recording.sample_period
        pull = self._turns.T * self._stiffness
        laws = GearLaws([t for t in in_gear if t.name in LAWS], twist, pull, self._turns)
        solved: list[Nonlinear] = [laws]
        loose = [term for term in in_gear if term.name == LOOSE]
        if loose:
            slide = Slide.of(self.robot, self._links(number)).at(times)
            solved.append(LooseTools(slide, loose, h))
        sizes = np.array([term.step for term in in_gear[: laws.count + len(loose)]])
        others = in_gear[len(sizes) :]
        axes = np.array([term.axis - 1 for term in others], int)
        errors = np.empty((count, len(others)))
        for k, (term, own) in enumerate(zip(others, axes, strict=True)):
            if term.name == GEAR_DAMPING:
                errors[:, k] = self._damping[own] / self._stiffness[own] * rate[:, own]
            else:
                errors[:, k] = _IN_GEAR[term.name](twist[:, own], angle[:, own], term)
        held = max(1, round(_POSE / h))
        inertia = np.stack([self._arm.inertia(q) for q in joint[::held]])
        damping = (self._turns.T * self._damping) @ self._turns
        system = Newmark(inertia, held, pull @ self._turns, damping, h)
        out = np.zeros((len(samples), n, len(in_gear) + loads.shape[2]), np.float32)
        to_twist, to_rate = (one[:, None] * self._turns for one in (self._stiffness, self._damping))
        for start in range(0, count, _CHUNK):
            rows = slice(start, min(start + _CHUNK, count))
            # a load turns the joint back: the gearbox has to carry it
            force = [pull[:, axes] * errors[rows, None], -interpolated(loads, times[rows])]
            inside = slice(*np.searchsorted(samples, [start, rows.stop]))
            wanted = samples[inside]
            moved, turning = system.advance(
                start, np.concatenate(force, axis=2), solved, wanted - start
            )
            change = -(to_twist @ moved) - to_rate @ turning
            for own, of, first in ((laws.axes, laws.errors, 0), (axes, errors, len(sizes))):
                places = first + np.arange(len(own))
                change[:, own, places] += self._stiffness[own] * of[wanted]
            change[:, :, : len(sizes)] /= sizes
            out[inside] = change
        return out


def _beside(at: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """The steps before and after steps, of `count` steps."""
    return np.maximum(at - 1, 0), np.minimum(at + 1, count - 1)


def _slope(values: np.ndarray, at: np.ndarray, timestep: float) -> np.ndarray:
    """Central differences over time at some steps, as those of `numpy.gradient`."""
    before, after = _beside(at, len(values))
    return np.asarray((values[after] - values[before]) / ((after - before)[:, None] * timestep))


def _wave(term: Term) -> tuple[float, float]:
    """Order, per turn of the motor, and phase of a periodic effect."""
    given = dict(term.parameters)
    return given["order"], given["phase"]


def _sine(angle: np.ndarray, term: Term) -> np.ndarray:
    order, phase = _wave(term)
    return np.sin(order * angle + phase)


_AT_ROTOR: dict[str, Callable[[Formulas, Motion, Term], np.ndarray]] = {
    "viscous_friction": lambda of, seen, term: (
        of.friction("viscous", term.axis) * seen.speed[:, term.axis - 1]
    ),
    "quadratic_viscous_friction": lambda of, seen, term: (
        of.friction("coulomb", term.axis)
        * (seen.speed * np.abs(seen.speed))[:, term.axis - 1]
        / QUADRATIC_SPEED**2
    ),
    # of a growth in forward motion, as which it is probed
    "viscous_asymmetry": lambda of, seen, term: (
        of.friction("viscous", term.axis) * np.maximum(seen.speed[:, term.axis - 1], 0.0)
    ),
    "torque_offset": lambda of, seen, term: -np.ones(len(seen.speed)),
    "torque_constant": lambda of, seen, term: seen.torque[:, term.axis - 1],
    "rotor_inertia": lambda of, seen, term: (
        of.inertia(term.axis) * seen.acceleration[:, term.axis - 1]
    ),
    "delay": lambda of, seen, term: -seen.rate[:, term.axis - 1],
    "torque_ripple": lambda of, seen, term: -_sine(seen.angle[:, term.axis - 1], term),
}
"""Change of the motor torque of the term's axis per unit of the term. Set points that come late
have no part in a measured motion; what shows is a log whose torque is later than its position."""

_OF_LOG = ("torque_constant", "delay")
"""Those that change the log of a torque, and no torque. The others are in the log as the drives
state torque; see `Robot.torque_gain`."""

_IN_GEAR: dict[str, Callable[[np.ndarray, np.ndarray, Term], np.ndarray]] = {
    "stiffness_hardening": lambda twist, angle, term: twist**3 / REFERENCE_TWIST**2,
    "transmission_error": lambda twist, angle, term: _sine(angle, term),
}
"""Error of the gearbox per unit of the term, of its twist and the angle of the motor [rad]."""

_AT_JOINT = ("gravity_spring", "encoder_offset")

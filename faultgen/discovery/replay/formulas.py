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

from collections import deque
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from faultgen.discovery.replay.behind_gears import (
    GEAR_DAMPING,
    IN_GEAR,
    WAVE,
    BehindGears,
    Course,
    Linear,
    linear,
    poses_of,
    sine,
    slope_along,
    steps_of,
    wave_torque,
)
from faultgen.discovery.replay.bristles import FRICTION, friction_columns
from faultgen.discovery.replay.elastic import LAWS
from faultgen.discovery.replay.loose import LOOSE, Slide
from faultgen.discovery.replay.motion import Motion, beside, slope
from faultgen.discovery.replay.prescribed import STIFFER
from faultgen.discovery.terms.candidates import INERTIA, MASSES, Term
from faultgen.discovery.terms.inertia import slopes_of
from faultgen.discovery.terms.regressor import LinkMotion, link_motion
from faultgen.effects.friction import QUADRATIC_SPEED
from faultgen.effects.structure import is_loaded
from faultgen.robot import COULOMB
from faultgen.simulation.arm import Arm

if TYPE_CHECKING:
    from faultgen.discovery.replay.replay import Replay
    from faultgen.simulation.cycle import Cycle


class Formulas:
    """Changes of the torque on the measured motion, for terms whose law is simple enough."""

    def __init__(self, replay: Replay) -> None:
        """Prepare the formulas.

        Args:
            replay: The model on a motion.
        """
        self.given = replay
        self.follows = not replay.measured
        """Whether a servo reacts to the causes; otherwise, rotors are on measured positions."""
        self.replay, self.robot = replay.held() if self.follows else replay, replay.robot
        self.stiffness = self.robot.model.tendon_stiffness[self.robot.ids("tendon", "gearbox")]
        self.damping = self.robot.model.tendon_damping[self.robot.ids("tendon", "gearbox")]
        if replay.recording.link:
            self.stiffness, self.damping = STIFFER * self.stiffness, STIFFER**0.5 * self.damping
        self._of_links: dict[int, LinkMotion] = {}
        self._linear: dict[int, Linear] = {}

    @classmethod
    def of(cls, replay: Replay) -> Formulas:
        """Return the formulas of a replay, which are prepared once.

        Args:
            replay: The model on a motion.
        """
        for known in _KEPT:
            if known.given is replay:
                return known
        _KEPT.append(cls(replay))
        return _KEPT[-1]

    def columns(self, terms: Sequence[Term]) -> dict[Term, np.ndarray]:
        """Compute the change of the torque per unit of each term that has a formula.

        Args:
            terms: Any terms.

        Returns:
            Shape (samples, n_axes) for each term that has a formula, on the recording's side and in
            its unit.
        """
        recording = self.replay.recording
        link = recording.link
        rotors = [] if link else [term for term in terms if term.name in _AT_ROTOR]
        rotors += [] if link else [term for term in terms if self._rubs(term)]
        in_gear = [term for term in terms if term.name in LAWS]
        in_gear += [term for term in terms if self._slides(term)]
        in_gear += [term for term in terms if term.name in (GEAR_DAMPING, *IN_GEAR)]
        links = [term for term in terms if term.name in (INERTIA, *MASSES, *_AT_JOINT)]
        out: dict[Term, np.ndarray] = {}
        if self.follows:  # late set points are no late log
            rotors = [term for term in rotors if term.name != "delay"]
            if rotors or in_gear or links:
                out = self._behind_gears(in_gear, links, rotors)
        else:
            for number, part in enumerate(recording.parts if rotors else ()):
                needed = self._at_rotors(number, rotors, self.steps(number))
                for term, change in needed.items():
                    out.setdefault(term, np.zeros(recording.torque.shape, np.float32))[part] = (
                        change
                    )
            if in_gear or links:
                out |= self._behind_gears(in_gear, links, ())
        load = self.replay.load
        loads = [term for term in out if term.name not in _OF_LOG]
        if load is not None and loads:
            seen = load.seen(np.stack([out[term] for term in loads], axis=2))
            out |= {term: seen[..., k] for k, term in enumerate(loads)}
        scale = 1.0 if recording.side == "motor" or recording.link else self.robot.gear_ratio
        return {term: (column * scale).astype(np.float32) for term, column in out.items()}

    def _slides(self, term: Term) -> bool:
        """Whether a term is a loose tool of a robot that holds its payload firmly."""
        firm = all(one.effect != LOOSE for one in self.robot.effects)
        return term.name == LOOSE and firm and is_loaded(self.robot, term.axis)

    def _rubs(self, term: Term) -> bool:
        """Whether a term is friction on rotors whose law does not change with the temperature."""
        return term.name in FRICTION and not self.replay.by_temperature(())

    def _at_rotors(
        self, number: int, terms: Sequence[Term], at: np.ndarray
    ) -> dict[Term, np.ndarray]:
        """Change of the logged torque of held rotors at some steps, shape (steps, n_axes)."""
        out, seen = {}, self._at_steps(number, at)
        for term in terms:
            if term.name not in _AT_ROTOR:
                continue
            change = _AT_ROTOR[term.name](self, seen, term)
            if term.name not in _OF_LOG:
                change = change / self.robot.torque_gain[term.axis - 1]
            out[term] = np.zeros((len(at), self.robot.n_axes), np.float32)
            out[term][:, term.axis - 1] = change
        rubs = [term for term in terms if term.name in FRICTION]
        if rubs:
            rotors = self.replay.rotors[number]
            out |= friction_columns(self.robot, rubs, rotors, at, seen.gear)
        return out

    @property
    def runs(self) -> list[Cycle]:
        """The unchanged model at every step of each separate recording."""
        return self.replay.cycles

    def steps(self, number: int) -> np.ndarray:
        """Find the steps of the simulation at which a separate recording has its samples.

        Args:
            number: Of the separate recording, from 0.

        Returns:
            Shape (samples,).
        """
        part = self.replay.recording.parts[number]
        timestep = self.robot.model.opt.timestep
        times = np.arange(part.stop - part.start) * self.replay.recording.sample_period
        last = len(self.runs[number].motor_position) - 1
        return np.minimum(np.round(times / timestep).astype(int), last)

    @cached_property
    def motion(self) -> Motion:
        """Of all separate recordings, one after the other."""
        motions = [
            vars(self._at_steps(k, self.steps(k))) for k in range(len(self.replay.recording.parts))
        ]
        return Motion(**{name: np.concatenate([m[name] for m in motions]) for name in motions[0]})

    def _at_steps(self, number: int, at: np.ndarray) -> Motion:
        run = self.runs[number]
        timestep = self.robot.model.opt.timestep
        return Motion(
            angle=run.motor_position[at],
            speed=run.motor_velocity[at],
            acceleration=slope(run.motor_velocity, at, timestep),
            joint=run.joint_position[at],
            gear=run.gear_torque[at],
            torque=run.motor_torque[at],
            rate=slope(run.motor_torque, at, timestep),
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
    def arm(self) -> Arm:
        """The rigid arm."""
        return Arm(self.robot)

    def _joints(self, number: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Position, velocity and acceleration of the joints at the samples."""
        timestep, at = self.robot.model.opt.timestep, self.steps(number)
        joint = self.runs[number].joint_position
        before, after = beside(at, len(joint))
        less, more = (slope(joint, steps, timestep) for steps in (before, after))
        acceleration = (more - less) / ((after - before)[:, None] * timestep)
        return joint[at], slope(joint, at, timestep), acceleration

    def linear(self, number: int) -> Linear:
        """Compute how the torque of the joints changes with small changes of their motion.

        Args:
            number: Of the separate recording, from 0.

        Returns:
            As `behind_gears.linear`, shape (poses, n_axes, n_axes).
        """
        if number not in self._linear:
            timestep = self.robot.model.opt.timestep
            every = steps_of(timestep)
            h, joint = every * timestep, self.runs[number].joint_position[::every]
            speed = np.gradient(joint, h, axis=0)
            rows = slice(None, None, poses_of(h))
            motion = (joint[rows], speed[rows], np.gradient(speed, h, axis=0)[rows])
            self._linear[number] = linear(self.arm, *motion)
        return self._linear[number]

    def links(self, number: int) -> LinkMotion:
        """Motion of the links at the samples."""
        if number not in self._of_links:
            self._of_links[number] = link_motion(self.arm, *self._joints(number))
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
            out[:, :, masses] = self.links(number).regressor() @ slopes
        for k, term in enumerate(terms):
            if term.name not in _AT_JOINT:
                continue
            if term.name == "gravity_spring":
                out[:, term.axis - 1, k] = q[:, term.axis - 1]
            else:  # the true angle is the logged one plus the offset
                out[:, :, k] = slope_along(self.arm, (q, qd, qdd), 0, term.axis - 1)
        return out

    def _behind_gears(
        self, in_gear: Sequence[Term], links: Sequence[Term], rotors: Sequence[Term]
    ) -> dict[Term, np.ndarray]:
        """Change of the torque by terms that act behind the gearboxes, and on rotors with a servo.

        It is that of the motors, or of the gearboxes if their torque is measured.
        """
        recording = self.replay.recording
        slopes = slopes_of(
            self.robot, [term for term in links if term.name not in _AT_JOINT], self.replay.moved
        )
        out: dict[Term, np.ndarray] = {}
        for number, part in enumerate(recording.parts):
            loads = self._loads(number, links, slopes)
            pushes = self._at_rotors(number, rotors, self._every(number)) if rotors else {}
            needed = self._needed(number, pushes)
            causes = BehindGears(self._course(number), in_gear, loads, needed)
            change = causes.changes()
            if not recording.link and not self.follows:
                change = self._of_motors(number, change, in_gear)
            for k, term in enumerate([*in_gear, *links, *pushes]):
                out.setdefault(term, np.zeros(recording.torque.shape, np.float32))[part] = change[
                    ..., k
                ]
        return out

    def _course(self, number: int) -> Course:
        """What the integration needs to know of a separate recording."""
        return Course(
            self.robot,
            self.runs[number],
            self.steps(number),
            self.replay.recording.sample_period,
            self.stiffness,
            self.damping,
            self.linear(number),
            self.follows,
            lambda: Slide.of(self.robot, self.links(number)),
        )

    def _every(self, number: int) -> np.ndarray:
        """Steps of the simulation at which the causes are integrated."""
        every = steps_of(self.robot.model.opt.timestep)
        return np.arange(0, len(self.runs[number].motor_position), every)

    def _needed(self, number: int, pushes: dict[Term, np.ndarray]) -> np.ndarray:
        """Torque that causes take from rotors, shape (steps, n_axes, causes), in [N m]."""
        if not pushes:
            return np.zeros((len(self._every(number)), self.robot.n_axes, 0))
        return np.stack([*pushes.values()], axis=2) * self.robot.torque_gain[:, None]

    def _of_motors(self, number: int, gear: np.ndarray, in_gear: Sequence[Term]) -> np.ndarray:
        """Change of the torque of held motors by a change of the gear torques, same shape."""
        out = gear / self.robot.gear_ratio[:, None]
        run, at = self.runs[number], self.steps(number)
        for k, term in enumerate(in_gear):
            if term.name == WAVE:
                own = term.axis - 1
                gear_torque, angle = run.gear_torque[at, own], run.motor_position[at, own]
                out[:, own, k] += wave_torque(gear_torque, angle, term)
        return np.asarray(out / self.robot.torque_gain[:, None])


_KEPT: deque[Formulas] = deque(maxlen=2)
# of a recording and its baseline: each is needed several times


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
    "torque_ripple": lambda of, seen, term: -sine(seen.angle[:, term.axis - 1], term),
}
"""Change of the motor torque of the term's axis per unit of the term. Set points that come late
have no part in a measured motion; what shows is a log whose torque is later than its position."""

_OF_LOG = ("torque_constant", "delay")
"""Those that change the log of a torque, and no torque. The others are in the log as the drives
state torque; see `Robot.torque_gain`."""

_AT_JOINT = ("gravity_spring", "encoder_offset")

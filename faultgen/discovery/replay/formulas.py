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
The time integration is that of Newmark (1959) with constant mean acceleration: it is stable and
adds no damping. tests/test_formulas.py compares every formula with the simulation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from faultgen.discovery.replay.bristles import FRICTION, friction_columns
from faultgen.discovery.replay.prescribed import STIFFER
from faultgen.discovery.terms.candidates import INERTIA, Term
from faultgen.discovery.terms.inertia import MASSES, slopes_of
from faultgen.discovery.terms.regressor import link_regressor
from faultgen.effects.friction import QUADRATIC_SPEED
from faultgen.effects.transmission import REFERENCE_TWIST
from faultgen.robot import COULOMB
from faultgen.simulation.arm import Arm

if TYPE_CHECKING:
    from faultgen.discovery.replay.replay import Replay
    from faultgen.simulation.cycle import Cycle

PLAY, STIFFNESS = "backlash", "gear_stiffness"
"""Effects that change how the torque of a gearbox follows from its twist."""

GEAR_DAMPING = "gear_damping"
"""Term of the damping of a gearbox, a fraction of that of the model. It is no effect."""

_LAWS = (PLAY, STIFFNESS)
_STEP = 1e-3  # of the integration [s]: some 30 steps in a period of a resonance of 30 Hz
_POSE = 0.01  # time in which the inertia of the arm counts as constant [s]
_CHUNK = 2000  # steps of which the causes are in memory
_SHIFT = 1e-3  # of a position, for the slope of the torque of the arm [rad]


@dataclass(frozen=True, eq=False)
class _Motion:
    """What effects need to know about a separate recording. Arrays have shape (times, n_axes)."""

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
        in_gear = [term for term in terms if term.name in (*_LAWS, GEAR_DAMPING, *_IN_GEAR)]
        links = [term for term in terms if term.name in (INERTIA, *MASSES, *_AT_JOINT)]
        out = {term: np.zeros(recording.torque.shape, np.float32) for term in at_rotor}
        for number, part in enumerate(recording.parts):
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
        scale = 1.0 if recording.side == "motor" or recording.link else self.robot.gear_ratio
        return {term: (column * scale).astype(np.float32) for term, column in out.items()}

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

    def _at_samples(self, number: int) -> _Motion:
        run, at = self._runs[number], self._steps(number)
        timestep = self.robot.model.opt.timestep
        acceleration = np.gradient(run.motor_velocity, timestep, axis=0)
        return _Motion(
            angle=run.motor_position[at],
            speed=run.motor_velocity[at],
            acceleration=acceleration[at],
            joint=run.joint_position[at],
            gear=run.gear_torque[at],
            torque=run.motor_torque[at],
            rate=np.gradient(run.motor_torque, timestep, axis=0)[at],
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

    def _loads(self, number: int, terms: Sequence[Term], slopes: np.ndarray) -> np.ndarray:
        """Loads of the joints at the samples for a unit of each term.

        Args:
            number: Of the separate recording, from 0.
            terms: Terms of masses, and of `_AT_JOINT`.
            slopes: As from `slopes_of`, for the terms of masses.

        Returns:
            Shape (samples, n_axes, terms), in [N m].
        """
        timestep, at = self.robot.model.opt.timestep, self._steps(number)
        joint = self._runs[number].joint_position
        rate = np.gradient(joint, timestep, axis=0)
        q, qd, qdd = joint[at], rate[at], np.gradient(rate, timestep, axis=0)[at]
        out = np.zeros((len(at), self.robot.n_axes, len(terms)))
        masses = [k for k, term in enumerate(terms) if term.name not in _AT_JOINT]
        if masses:
            regressor = link_regressor(self._arm, q, qd, qdd)
            out[:, :, masses] = regressor @ slopes
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
        slopes = slopes_of(self.robot, [term for term in links if term.name not in _AT_JOINT])
        for number, part in enumerate(recording.parts):
            loads = self._loads(number, links, slopes)
            gear = self._gear_changes(number, in_gear, loads)
            if not recording.link:
                gear /= ratio[:, None]
                seen = self._at_samples(number)
                for k, term in enumerate(in_gear):
                    if term.name == "transmission_error":
                        order, phase = _wave(term)
                        turned = order * seen.angle[:, term.axis - 1] + phase
                        slope = order * np.cos(turned)
                        gear[:, term.axis - 1, k] += seen.gear[:, term.axis - 1] * slope
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
        period = self.replay.recording.sample_period
        of_load = np.arange(count) * h / period  # number of the sample, not whole
        axes = np.array([term.axis - 1 for term in in_gear], int)
        laws = _Laws.of(in_gear)
        system = _Newmark(self._poses(joint, h), self._stiffness, self._damping, self._turns, h)
        system.laws = laws
        out = np.zeros((len(samples), n, len(in_gear) + loads.shape[2]), np.float32)
        done = 0
        for start in range(0, count, _CHUNK):
            rows = slice(start, min(start + _CHUNK, count))
            errors = np.zeros((rows.stop - rows.start, n, len(in_gear)))
            for k in sorted({*range(len(in_gear))} - {*laws.causes.tolist()}):
                own, term = axes[k], in_gear[k]
                if term.name == GEAR_DAMPING:
                    errors[:, own, k] = self._damping[own] / self._stiffness[own] * rate[rows, own]
                    continue
                errors[:, own, k] = _IN_GEAR[term.name](twist[rows, own], angle[rows, own], term)
            changes = system.advance(
                start, errors, _interpolated(loads, of_load[rows]), twist[rows]
            )
            changes[:, :, laws.causes] /= laws.sizes
            last = int(np.searchsorted(samples, rows.stop))
            out[done:last] = changes[samples[done:last] - start]
            done = last
        return out

    def _poses(self, joint: np.ndarray, h: float) -> Callable[[int], np.ndarray]:
        """Inertia of the arm at any step, by its number; shape (n_axes, n_axes)."""
        held = max(1, round(_POSE / h))
        matrices = [self._arm.inertia(q) for q in joint[::held]]
        return lambda step: matrices[step // held]


@dataclass(frozen=True, eq=False)
class _Laws:
    """Causes that change how the torque of a gearbox follows from its twist.

    Arrays have shape (laws,).
    """

    causes: np.ndarray
    """Their numbers among all causes, from 0."""
    axes: np.ndarray
    """Their axes, from 0."""
    sizes: np.ndarray
    """Plays [rad], or shares of the stiffness that are lost."""
    is_play: np.ndarray
    """Whether each is a play."""

    @staticmethod
    def of(terms: Sequence[Term]) -> _Laws:
        """Find them among terms."""
        names = np.array([term.name for term in terms], object)
        causes = np.flatnonzero(np.isin(names.astype(str), _LAWS))
        chosen = [terms[k] for k in causes.tolist()]
        return _Laws(
            causes,
            np.array([term.axis - 1 for term in chosen], int),
            np.array([term.step for term in chosen], float),
            np.array([term.name == PLAY for term in chosen], bool),
        )

    def errors(self, twist: np.ndarray, share: np.ndarray | float = 0.0) -> np.ndarray:
        """Solve for the errors of the gearboxes at the end of a step.

        Args:
            twist: Twist of the own gearbox if there were no error, shape (laws,), in [rad].
            share: Share of an error by which the twist becomes less, shape (laws,), below 1.

        Returns:
            The errors, shape (laws,), in [rad]. Where a gearbox is within its play, no torque is
            left.
        """
        lost = np.where(self.is_play, 0.0, self.sizes)
        half = self.sizes / 2
        free = twist / np.maximum(1 - np.asarray(share), 1e-9)
        soft = lost * twist / (1 - lost * share)
        return -np.where(self.is_play, np.clip(free, -half, half), soft)

    def at_rest(self, twist: np.ndarray) -> np.ndarray:
        """The errors at which the gearboxes carry the same torque, for the same arguments."""
        lost = np.where(self.is_play, 0.0, self.sizes)
        return -np.where(self.is_play, np.sign(twist) * self.sizes / 2, lost * twist / (1 - lost))


class _Newmark:
    """The arm behind its gearboxes in time, linear about its motion; see the top of the module."""

    def __init__(
        self,
        inertia: Callable[[int], np.ndarray],
        stiffness: np.ndarray,
        damping: np.ndarray,
        turns: np.ndarray,
        h: float,
    ) -> None:
        self._inertia, self._h = inertia, h
        self._pull = turns.T * stiffness  # of the errors of the gearboxes on the joints
        self._stiffness = self._pull @ turns
        self._damping = (turns.T * damping) @ turns
        self._gear = stiffness[:, None], stiffness[:, None] * turns, damping[:, None] * turns
        self._turns = turns
        self.laws = _Laws.of([])
        self._state: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None

    def advance(
        self, start: int, errors: np.ndarray, loads: np.ndarray, twist: np.ndarray
    ) -> np.ndarray:
        """Advance by some steps.

        Args:
            start: Number of the first step.
            errors: Of the gearboxes, shape (steps, n_axes, causes), in [rad]; 0 for `laws`.
            loads: Of the joints, shape (steps, n_axes, further causes), in [N m].
            twist: Of the gearboxes of the unchanged model, shape (steps, n_axes), in [rad].

        Returns:
            Change of the gear torques for both kinds of causes, shape (steps, n_axes, all causes).
        """
        h, damping = self._h, self._damping
        number = errors.shape[2]
        # a load turns the joint back: the gearbox has to carry it
        force = np.concatenate([np.einsum("ij,tjk->tik", self._pull, errors), -loads], axis=2)
        out = np.empty_like(force)
        of_error, of_place, of_rate = self._gear
        causes, own = self.laws.causes, self.laws.axes
        known: np.ndarray | None = None
        for k in range(len(force)):
            matrix = self._inertia(start + k)
            if self._state is None:  # at rest, in equilibrium
                sizes = self.laws.at_rest(twist[0, own])
                force[0][:, causes] += self._pull[:, own] * sizes
                place = np.linalg.solve(self._stiffness, force[0])
                self._state = place, np.zeros_like(place), np.zeros_like(place)
            else:
                if matrix is not known:
                    inverse = np.linalg.inv(4 / h**2 * matrix + 2 / h * damping + self._stiffness)
                    known, answer = matrix, inverse @ self._pull[:, own]
                    share = np.einsum("ki,ik->k", self._turns[own], answer)
                place, rate, change = self._state
                new = inverse @ (
                    force[k]
                    + matrix @ (4 / h**2 * place + 4 / h * rate + change)
                    + damping @ (2 / h * place + rate)
                )
                turned = np.einsum("ki,ik->k", self._turns[own], new[:, causes])
                sizes = self.laws.errors(twist[k, own] - turned, share)
                new[:, causes] += answer * sizes
                acceleration = 4 / h**2 * (new - place) - 4 / h * rate - change
                self._state = new, rate + h / 2 * (change + acceleration), acceleration
            place, rate, _ = self._state
            errors[k, own, causes] = sizes
            out[k] = -of_place @ place - of_rate @ rate
            out[k, :, :number] += of_error * errors[k]
        return out


def _interpolated(values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Values at numbers of samples that are not whole, linear in between."""
    at = np.clip(at, 0, len(values) - 1)
    low = np.minimum(at.astype(int), max(len(values) - 2, 0))
    share = (at - low)[:, None, None]
    return values[low] * (1 - share) + values[np.minimum(low + 1, len(values) - 1)] * share


def _wave(term: Term) -> tuple[float, float]:
    """Order, per turn of the motor, and phase of a periodic effect."""
    given = dict(term.parameters)
    return given["order"], given["phase"]


def _sine(angle: np.ndarray, term: Term) -> np.ndarray:
    order, phase = _wave(term)
    return np.sin(order * angle + phase)


_AT_ROTOR: dict[str, Callable[[Formulas, _Motion, Term], np.ndarray]] = {
    "viscous_friction": lambda of, seen, term: (
        of.friction("viscous", term.axis) * seen.speed[:, term.axis - 1]
    ),
    "quadratic_viscous_friction": lambda of, seen, term: (
        of.friction("coulomb", term.axis)
        * (seen.speed * np.abs(seen.speed))[:, term.axis - 1]
        / QUADRATIC_SPEED**2
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

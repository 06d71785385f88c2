"""Integration of the arm behind its gearboxes for many causes at once; `formulas` has the equation.

Where the servo follows commands, its rotors move, too, and rotors have causes of their own; see
`closed_loop`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from faultgen.discovery.replay.closed_loop import Servo, relative
from faultgen.discovery.replay.elastic import LAWS, GearLaws, Newmark, Nonlinear, interpolated
from faultgen.discovery.replay.loose import LOOSE, LooseTools, Slide
from faultgen.discovery.terms.candidates import Term
from faultgen.effects.transmission import REFERENCE_TWIST
from faultgen.robot import Robot
from faultgen.simulation.arm import Arm
from faultgen.simulation.cycle import Cycle

GEAR_DAMPING = "gear_damping"
"""Term of the damping of a gearbox, a fraction of that of the model. It is no effect."""

WAVE = "transmission_error"

_STEP = 1e-3  # of the integration [s]: some 30 steps in a period of a resonance of 30 Hz
_POSE = 0.01  # time in which the inertia of the arm counts as constant [s]
_SHIFT = 1e-3  # of a motion, for the slope of the torque of the arm [rad] and [rad/s]
_CHUNK = 2000  # steps of which the causes are in memory


def steps_of(timestep: float) -> int:
    """Return the number of steps of a simulation in a step of the integration."""
    return max(1, round(_STEP / timestep))


def poses_of(h: float) -> int:
    """Return the number of steps of the integration for which the arm counts as in one pose.

    Args:
        h: Step of the integration [s].
    """
    return max(1, round(_POSE / h))


Linear = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Changes of the torque of joints, from `linear`."""


@dataclass(frozen=True, eq=False)
class Course:
    """A separate recording, and the unchanged model on its motion."""

    robot: Robot
    """The model."""
    run: Cycle
    """What it logs at every step of a simulation."""
    steps: np.ndarray
    """Steps at which the recording has its samples, shape (samples,)."""
    period: float
    """Time between samples [s]."""
    stiffness: np.ndarray
    """Of the gearboxes, shape (n_axes,), in [N m/rad]."""
    damping: np.ndarray
    """Of the gearboxes, shape (n_axes,), in [N m s/rad]."""
    linear: Linear
    """Changes of the torque of the joints, at the poses of the integration."""
    follows: bool
    """Whether a servo reacts; otherwise rotors are held on their motion."""
    slide: Callable[[], Slide]
    """Gives the motion of a loose tool at the samples."""


class BehindGears:
    """The causes in a separate recording.

    They stand in this order: laws of gearboxes, loose tools, errors of gearboxes, loads of joints,
    torques on rotors.
    """

    def __init__(
        self, course: Course, in_gear: Sequence[Term], loads: np.ndarray, rotors: np.ndarray
    ) -> None:
        """Prepare the causes.

        Args:
            course: The motion.
            in_gear: Terms of gearboxes and loose tools, in this order.
            loads: Torque that each further cause puts on the joints at the samples, shape (samples,
                n_axes, causes), in [N m].
            rotors: Torque that each further cause takes from the rotors at the steps of the
                integration, shape (steps, n_axes, causes), in [N m]. None has a part where rotors
                are held.
        """
        robot, run = course.robot, course.run
        timestep = robot.model.opt.timestep
        every = steps_of(timestep)
        h = every * timestep
        self._course, self._loads, self._rotors = course, loads, rotors
        angle, joint = run.motor_position[::every], run.joint_position[::every]
        both = relative(robot)
        turns = both[:, : robot.n_axes]
        twist = angle / robot.gear_ratio - joint @ turns.T
        rate = np.gradient(twist, h, axis=0)
        self._count = len(twist)
        at = np.round(course.steps / every).astype(int)
        self._samples = np.minimum(at, self._count - 1)
        # numbers of the samples at the steps, not whole
        self._times = np.arange(self._count) * h / course.period
        self._turns = both if course.follows else turns
        stiffness, damping = course.stiffness, course.damping
        self._pull = self._turns.T * stiffness
        laws = [term for term in in_gear if term.name in LAWS]
        self._laws = GearLaws(laws, twist, self._pull, self._turns)
        self._solved: list[Nonlinear] = [self._laws]
        loose = [term for term in in_gear if term.name == LOOSE]
        if loose:
            slide = course.slide().at(self._times).among(len(self._pull))
            self._solved.append(LooseTools(slide, loose, h))
        self._sizes = np.array([term.step for term in in_gear[: len(laws) + len(loose)]])
        others = in_gear[len(self._sizes) :]
        self._axes = np.array([term.axis - 1 for term in others], int)
        self._errors = np.empty((self._count, len(others)))
        self._pushes = np.zeros_like(self._errors)
        for k, (term, own) in enumerate(zip(others, self._axes, strict=True)):
            if term.name == GEAR_DAMPING:
                self._errors[:, k] = damping[own] / stiffness[own] * rate[:, own]
            else:
                self._errors[:, k] = IN_GEAR[term.name](twist[:, own], angle[:, own], term)
            if term.name == WAVE:  # the rotor feels the slope of the error, too
                self._pushes[:, k] = wave_torque(run.gear_torque[::every, own], angle[:, own], term)
        held, arm = poses_of(h), course.linear
        if course.follows:
            self._system: Newmark = Servo(robot, arm, held, run.motor_position, every)
        else:
            inertia, of_speed, of_place = arm
            of_speed = of_speed + (self._turns.T * damping) @ self._turns
            of_place = of_place + self._pull @ self._turns
            self._system = Newmark(inertia, held, of_place, of_speed, h)

    def changes(self) -> np.ndarray:
        """Compute the change at the samples by each cause, per unit of its term.

        Returns:
            Shape (samples, n_axes, causes), in [N m]: of the gear torque, joint side, where rotors
            are held; of the logged torque of the motors where they follow commands.
        """
        n = self._course.robot.n_axes
        causes = len(self._sizes) + sum(
            one.shape[-1] for one in (self._errors, self._loads, self._rotors)
        )
        out = np.zeros((len(self._samples), n, causes), np.float32)
        for start in range(0, self._count, _CHUNK):
            rows = slice(start, min(start + _CHUNK, self._count))
            inside = slice(*np.searchsorted(self._samples, [start, rows.stop]))
            wanted = self._samples[inside]
            seen = self._system.advance(start, self._force(rows), self._solved, wanted - start)
            change = seen if self._course.follows else self._of_gears(seen, wanted)
            change[:, :, : len(self._sizes)] /= self._sizes
            out[inside] = change
        return out

    def _force(self, rows: slice) -> np.ndarray:
        """Forces on the moves by all causes but the solved ones, shape (steps, moves, causes)."""
        n = self._course.robot.n_axes
        of_errors = self._pull[:, self._axes] * self._errors[rows, None]
        # a load turns the joint back: the gearbox has to carry it
        of_loads = -interpolated(self._loads, self._times[rows])
        if not self._course.follows:
            return np.concatenate([of_errors, of_loads], axis=2)
        of_errors[:, n + self._axes, np.arange(len(self._axes))] -= self._pushes[rows]
        of_rotors = -self._rotors[rows]
        return np.concatenate(
            [
                of_errors,
                np.concatenate([of_loads, np.zeros_like(of_loads)], axis=1),
                np.concatenate([np.zeros_like(of_rotors), of_rotors], axis=1),
            ],
            axis=2,
        )

    def _of_gears(self, seen: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """Change of the gear torques where rotors are held, shape (wanted, n_axes, causes)."""
        stiffness = self._course.stiffness
        moved, turning = np.split(seen, 2, axis=1)
        change = -((stiffness[:, None] * self._turns) @ moved)
        change -= (self._course.damping[:, None] * self._turns) @ turning
        for own, of, first in (
            (self._laws.axes, self._laws.errors, 0),
            (self._axes, self._errors, len(self._sizes)),
        ):
            places = first + np.arange(len(own))
            change[:, own, places] += stiffness[own] * of[wanted]
        return np.asarray(change)


def linear(
    arm: Arm, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
) -> Linear:
    """Compute how the torque of joints changes with small changes of their motion.

    Args:
        arm: The rigid arm.
        position: Shape (poses, n_axes), in [rad].
        velocity: Same shape, in [rad/s].
        acceleration: Same shape, in [rad/s^2].

    Returns:
        Changes per unit of acceleration (the inertia), of velocity and of position; shape (poses,
        n_axes, n_axes), in [kg m^2], [N m s/rad] and [N m/rad].
    """
    inertia = np.stack([arm.inertia(q) for q in position])
    of_speed, of_place = np.empty_like(inertia), np.empty_like(inertia)
    motion = (position, velocity, acceleration)
    for k in range(position.shape[1]):
        of_place[:, :, k] = slope_along(arm, motion, 0, k)
        of_speed[:, :, k] = slope_along(arm, motion, 1, k)
    return inertia, of_speed, of_place


def slope_along(
    arm: Arm, motion: tuple[np.ndarray, np.ndarray, np.ndarray], which: int, axis: int
) -> np.ndarray:
    """Compute how the torque of joints changes with one quantity of one joint.

    Args:
        arm: The rigid arm.
        motion: Position, velocity and acceleration, each of shape (poses, n_axes).
        which: 0 for the position, 1 for the velocity.
        axis: Of the joint, from 0.

    Returns:
        Shape (poses, n_axes), in [N m] per unit of the quantity.
    """
    torques = []
    for side in (1, -1):
        moved = [one.copy() for one in motion]
        moved[which][:, axis] += side * _SHIFT
        torques.append(arm.inverse_dynamics(*moved))
    return np.asarray((torques[0] - torques[1]) / (2 * _SHIFT))


def wave(term: Term) -> tuple[float, float]:
    """Return order, per turn of the motor, and phase of a periodic effect."""
    given = dict(term.parameters)
    return given["order"], given["phase"]


def wave_torque(gear: np.ndarray, angle: np.ndarray, term: Term) -> np.ndarray:
    """Compute what a unit of a transmission error adds to the torque that a rotor needs.

    Args:
        gear: Torque of the gearbox, shape (samples,), in [N m].
        angle: Of the motor, same shape, in [rad].
        term: The effect.

    Returns:
        Same shape, in [N m]: the work of the gearbox along the error is that of the rotor.
    """
    order, phase = wave(term)
    return np.asarray(gear * (order * np.cos(order * angle + phase)))


def sine(angle: np.ndarray, term: Term) -> np.ndarray:
    """Compute the wave of a periodic effect.

    Args:
        angle: Of the motor, shape (samples,), in [rad].
        term: The effect.

    Returns:
        Same shape.
    """
    order, phase = wave(term)
    return np.asarray(np.sin(order * angle + phase))


IN_GEAR: dict[str, Callable[[np.ndarray, np.ndarray, Term], np.ndarray]] = {
    "stiffness_hardening": lambda twist, angle, term: twist**3 / REFERENCE_TWIST**2,
    WAVE: lambda twist, angle, term: sine(angle, term),
}
"""Error of the gearbox per unit of the term, of its twist and the angle of the motor [rad]."""

"""A tool that slides on its flange, about the motion of the unchanged model.

The payload of mass m is at x along the direction d of the flange, whose motion changes by the small
y of the joints. With the stops k beyond the play, their damping c, the acceleration a of the
payload's centre in the unchanged model and the motion J of that centre along d per motion of the
joints,

    m (x'' + J y'') + c x' + k dz(x) = -m d . (a - g)

where dz(x) is how far x is beyond its play. The joints carry J' m x'' and what the payload's weight
and inertia take at x. `faultgen.effects.loose` is the same in a simulation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from faultgen.discovery.replay.elastic import interpolated
from faultgen.discovery.terms.candidates import Term
from faultgen.discovery.terms.inertia import slopes_of
from faultgen.discovery.terms.regressor import LinkMotion
from faultgen.effects.loose import stops_of
from faultgen.robot import Robot

LOOSE = "loose_tool"
"""The effect."""

_SHIFT = 1e-4  # for the slope of weight and inertia [m]


@dataclass(frozen=True, eq=False)
class Slide:
    """Motion along three directions of the flange, or along some of them."""

    mass: float
    """[kg]."""
    reach: np.ndarray
    """Motion of the payload's centre per motion of each joint, shape (times, n_axes, 3)."""
    moved: np.ndarray
    """Torque of the joints per shift of the payload, same shape, in [N m/m]."""
    force: np.ndarray
    """Force of gravity and inertia on the payload, shape (times, 1, 3), in [N]."""

    @staticmethod
    def of(robot: Robot, motion: LinkMotion) -> Slide:
        """Compute it from the motion of the arm.

        Args:
            robot: The model, which has a payload.
            motion: Of its links; the last one is the payload.
        """
        payload = robot.model.body("payload")
        mass, centre = float(payload.mass[0]), np.array(payload.ipos)
        rate, turn = motion.velocity[:, -1, :3], motion.acceleration[:, -1, :3]
        felt = motion.acceleration[:, -1, 3:] + np.cross(turn, centre)
        felt = felt + np.cross(rate, np.cross(rate, centre))
        turned, along = np.split(np.swapaxes(motion.jacobian[:, -1], 1, 2), 2, axis=2)
        reach = along + np.cross(turned, centre)
        shifts = [
            Term("payload_offset", robot.n_axes, _SHIFT, 1.0, (("direction", k),)) for k in range(3)
        ]
        moved = motion.regressor() @ slopes_of(robot, shifts)
        return Slide(mass, reach, moved, -mass * felt[:, None])

    def at(self, times: np.ndarray) -> Slide:
        """Interpolate to times, as numbers of samples that need not be whole."""
        parts = (interpolated(one, times) for one in (self.reach, self.moved, self.force))
        return Slide(self.mass, *parts)

    def among(self, moves: int) -> Slide:
        """Return the same for a system of moves of which the joints are the first."""
        more = ((0, 0), (0, moves - self.reach.shape[1]), (0, 0))
        return replace(self, reach=np.pad(self.reach, more), moved=np.pad(self.moved, more))


class LooseTools:
    """Payloads that slide along one direction; see `elastic.Nonlinear`."""

    def __init__(self, slide: Slide, terms: Sequence[Term], h: float) -> None:
        """Take the tools.

        Args:
            slide: The motion at each step.
            terms: Terms of loose tools.
            h: Step [s].
        """
        self.count, self._h, self._slide = len(terms), h, slide
        self._directions = np.array([int(dict(one.parameters)["direction"]) for one in terms], int)
        self._half = np.array([term.step for term in terms], float) / 2
        self._stiffness, self._damping = stops_of(slide.mass)
        self._state = (np.zeros(self.count),) * 3

    def start(self, first: int, place: np.ndarray, flexible: np.ndarray) -> None:
        """Begin at rest on the stop to which weight and inertia push.

        Args:
            first: Number of the step.
            place: Moves of the joints, shape (n_axes, tools), changed in place.
            flexible: Inverse of the stiffness of the arm.
        """
        force = self._slide.force[first, 0, self._directions]
        lies = np.sign(force) * self._half + force / self._stiffness
        place -= flexible @ (self._slide.moved[first][:, self._directions] * lies)
        self._state = lies, np.zeros(self.count), np.zeros(self.count)

    def pose(self, step: int, inverse: np.ndarray, held: int) -> None:
        """Prepare steps in one pose; see `elastic.Nonlinear`.

        Args:
            step: Number of the first one.
            inverse: Answer of the joints to a unit of force within a step.
            held: Number of these steps.
        """
        rows, inertia = slice(step, step + held), 4 / self._h**2
        reach = self._slide.mass * self._slide.reach[rows]
        push = inverse @ reach
        shift = inverse @ self._slide.moved[rows] + inertia * push
        free = inertia * (self._slide.mass - (reach * shift).sum(axis=1))
        free = free + 2 / self._h * self._damping
        chosen = self._directions
        self._first = step
        self._reach, self._push, self._shift = (one[..., chosen] for one in (reach, push, shift))
        self._free, self._force = free[:, chosen], self._slide.force[rows, 0][:, chosen]

    def step(self, step: int, new: np.ndarray, old: np.ndarray) -> None:
        """Solve for the places of the tools, and add what they do to the joints.

        Args:
            step: Number of the step.
            new: Moves of the joints without them, shape (n_axes, tools), changed in place.
            old: As in `elastic.Nonlinear.step`.
        """
        k, inertia, stops = step - self._first, 4 / self._h**2, self._stiffness
        x, rate, change = self._state
        before = -inertia * x - 4 / self._h * rate - change  # of the acceleration, as `old`
        new -= self._push[k] * before
        known = self._force[k] - (self._reach[k] * (inertia * new + old)).sum(axis=0)
        known += self._damping * (2 / self._h * x + rate) - self._slide.mass * before
        free = known / self._free[k]
        inside = np.minimum(np.maximum(free, -self._half), self._half)
        # beyond the play, the stop takes its part of the force
        place = inside + (free - inside) * (self._free[k] / (self._free[k] + stops))
        new -= self._shift[k] * place
        acceleration = inertia * place + before
        rate = rate + self._h / 2 * (change + acceleration)
        self._state = place, rate, acceleration

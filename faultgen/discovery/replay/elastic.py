"""The arm behind its gearboxes in time, linear about its motion; `formulas` states the equations.

The causes of one integration stand in this order: laws of gearboxes, loose tools, errors of
gearboxes, loads of joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from faultgen.discovery.terms.candidates import Term

PLAY, STIFFNESS = "backlash", "gear_stiffness"
"""Effects that change how the torque of a gearbox follows from its twist."""

LAWS = (PLAY, STIFFNESS)


class Nonlinear(Protocol):
    """Causes whose size follows from the answer of the arm, solved in each step."""

    count: int

    def start(self, first: int, place: np.ndarray, flexible: np.ndarray) -> None:
        """Begin at rest, in equilibrium.

        Args:
            first: Number of the step.
            place: Moves of the joints, shape (n_axes, causes), changed in place.
            flexible: Inverse of the stiffness of the arm.
        """

    def pose(self, step: int, inverse: np.ndarray, held: int) -> None:
        """Prepare steps in which the arm counts as being in one pose.

        Args:
            step: Number of the first one.
            inverse: Answer of the joints to a unit of force within a step.
            held: Number of these steps.
        """

    def step(self, step: int, new: np.ndarray, old: np.ndarray) -> None:
        """Add their part to the moves of the joints, which are changed in place.

        Args:
            step: Number of the step.
            new: Moves without them, shape (n_axes, causes).
            old: Part of the acceleration at the end of the step that does not depend on the moves:
                it is 4/h^2 new + old.
        """


class GearLaws:
    """Causes that change how the torque of a gearbox follows from its twist."""

    def __init__(
        self, terms: Sequence[Term], twist: np.ndarray, pull: np.ndarray, turns: np.ndarray
    ) -> None:
        """Take the laws.

        Args:
            terms: Terms with a name of `LAWS`.
            twist: Of the gearboxes of the unchanged model, shape (steps, n_axes), in [rad].
            pull: Force on the joints for a unit of error of each gearbox.
            turns: Turns of the gearboxes for one turn of each joint.
        """
        self.count = len(terms)
        self.axes = np.array([term.axis - 1 for term in terms], int)
        self.sizes = np.array([term.step for term in terms], float)
        is_play = np.array([term.name == PLAY for term in terms], bool)
        self._play = np.where(is_play, self.sizes, 0.0)
        self._lost = np.where(is_play, 1.0, self.sizes)
        self._most = np.where(is_play, self.sizes / 2, np.inf)
        self._is_play = is_play
        self._twist, self._pull, self._turns = twist, pull[:, self.axes], turns[self.axes].T
        self.errors = np.zeros((len(twist), self.count))
        """Errors of the own gearboxes at all steps, in [rad]."""

    def start(self, first: int, place: np.ndarray, flexible: np.ndarray) -> None:
        """Begin with the errors at which the gearboxes carry the same torque; see `Nonlinear`.

        Args:
            first: Number of the step.
            place: Moves of the joints, shape (n_axes, laws), changed in place.
            flexible: Inverse of the stiffness of the arm.
        """
        twist = self._twist[first, self.axes]
        soft = self._lost * twist / np.where(self._is_play, 1.0, 1 - self._lost)
        self.errors[first] = -np.where(self._is_play, np.sign(twist) * self._play / 2, soft)
        place += flexible @ (self._pull * self.errors[first])

    def pose(self, step: int, inverse: np.ndarray, held: int) -> None:
        """Prepare steps in one pose; see `Nonlinear`.

        Args:
            step: Number of the first one.
            inverse: Answer of the joints to a unit of force within a step.
            held: Number of these steps.
        """
        self._answer = inverse @ self._pull
        # by which share of an error the twist becomes less
        share = (self._turns * self._answer).sum(axis=0)
        self._gain = self._lost / np.maximum(1 - self._lost * share, 1e-9)

    def step(self, step: int, new: np.ndarray, old: np.ndarray) -> None:
        """Solve for the errors; where a gearbox is within its play, no torque is left.

        Args:
            step: Number of the step.
            new: Moves of the joints without them, shape (n_axes, laws), changed in place.
            old: As in `Nonlinear.step`; it is not needed.
        """
        twist = self._twist[step, self.axes] - (self._turns * new).sum(axis=0)
        twist *= -self._gain
        error = self.errors[step]
        np.minimum(np.maximum(twist, -self._most, out=twist), self._most, out=error)
        new += self._answer * error


class Newmark:
    """Integration with constant mean acceleration, about rotors that are held."""

    def __init__(
        self,
        inertia: np.ndarray,
        held: int,
        stiffness: np.ndarray,
        damping: np.ndarray,
        h: float,
    ) -> None:
        """Prepare the steps.

        Args:
            inertia: Of the arm at each of its poses, shape (poses, n_axes, n_axes).
            held: Steps for which a pose counts.
            stiffness: Of the arm on its gearboxes, same shape.
            damping: Same shape.
            h: Step [s].
        """
        self._held, self._h, self._first = held, h, 0
        self._flexible = np.linalg.inv(stiffness[0])
        self._state: np.ndarray | None = None
        self._solve(inertia, damping, stiffness)

    def _solve(self, inertia: np.ndarray, damping: np.ndarray, stiffness: np.ndarray) -> None:
        """Prepare the poses from the first one on."""
        h = self._h
        self._inverse = np.linalg.inv(4 / h**2 * inertia + 2 / h * damping + stiffness)
        parts = [4 / h**2 * inertia + 2 / h * damping, 4 / h * inertia + damping, inertia]
        parts.append(np.broadcast_to(np.eye(inertia.shape[1]), inertia.shape))
        self._next = self._inverse @ np.concatenate(parts, axis=2)

    def _prepare(self, first: int, count: int) -> None:
        """Prepare some steps."""

    def _begin(self, place: np.ndarray, push: np.ndarray) -> None:
        """Begin with moves under forces."""

    def _react(self, step: int, place: np.ndarray, push: np.ndarray) -> None:
        """Add forces that follow from the moves before a step."""

    def _moved(self, step: int, place: np.ndarray, rate: np.ndarray) -> None:
        """Take note of a step."""

    def _seen(self, place: np.ndarray, rate: np.ndarray) -> np.ndarray:
        """What is returned of a step, shape (rows, causes): the moves, then their rates."""
        return np.concatenate([place, rate])

    def advance(
        self, first: int, force: np.ndarray, solved: Sequence[Nonlinear], wanted: np.ndarray
    ) -> np.ndarray:
        """Advance by some steps.

        Args:
            first: Number of the first step.
            force: Forces by the causes that do not depend on the answer, shape (steps, moves,
                causes), in [N m].
            solved: The other causes, which come before them.
            wanted: Steps of which something is returned, counted from the first.

        Returns:
            Moves by all causes, then their rates, shape (wanted, 2 moves, causes).
        """
        h, n = self._h, force.shape[1]
        self._prepare(first, len(force))
        ends = np.cumsum([one.count for one in solved])
        groups = [(one, slice(end - one.count, end)) for one, end in zip(solved, ends, strict=True)]
        groups = [(one, own) for one, own in groups if one.count]
        others = slice(int(ends[-1]), int(ends[-1]) + force.shape[2])
        keep = np.zeros(len(force), bool)
        keep[wanted] = True
        known, seen = -1, []
        starts = self._state is None
        state = np.zeros((4 * n, others.stop)) if self._state is None else self._state
        self._state = state
        place, rate, change, push = np.split(state, 4)
        for k in range(len(force)):
            step = first + k
            pose = (step - self._first) // self._held
            push[:, : others.start] = 0
            push[:, others] = force[k]
            if pose != known:
                known = pose
                for one, _ in groups:
                    one.pose(step, self._inverse[pose], self._held)
            if starts and k == 0:
                place[:] = self._flexible @ push
                for one, own in groups:
                    one.start(step, place[:, own], self._flexible)
                self._begin(place, push)
            else:
                self._react(step, place, push)
                new = self._next[pose] @ state
                old = place * (-4 / h**2)
                old -= 4 / h * rate
                old -= change
                for one, own in groups:
                    one.step(step, new[:, own], old[:, own])
                place[:] = new
                new *= 4 / h**2
                new += old  # the acceleration
                change += new
                change *= h / 2
                rate += change
                change[:] = new
                self._moved(step, place, rate)
            if keep[k]:
                seen.append(self._seen(place, rate))
        index = np.cumsum(keep)[wanted] - 1
        return np.array(seen)[index]


def interpolated(values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Interpolate values at numbers of samples that are not whole.

    Args:
        values: Shape (samples, ..., ...).
        at: Numbers of samples, shape (times,).

    Returns:
        Shape (times, ..., ...).
    """
    at = np.clip(at, 0, len(values) - 1)
    low = np.minimum(at.astype(int), max(len(values) - 2, 0))
    share = (at - low)[:, None, None]
    high = np.minimum(low + 1, len(values) - 1)
    return np.asarray(values[low] * (1 - share) + values[high] * share)

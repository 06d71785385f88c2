"""Effects that act at one place: an angle of the joint, or a phase of a turn, that is not known.

The reaction to such an effect is told for many places without a simulation, see `reaction`. The
place is the one at which the effect best explains what all other terms leave. The effect is then
simulated there, and becomes a candidate. Simulating it takes long, so this is done only where it
explains more than every other effect, or enough of what the best other effects would leave.

    terms, columns = places(posed, difference)
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from faultgen.discovery.decision.arrays import Posed
from faultgen.discovery.decision.difference import Difference
from faultgen.discovery.decision.reaction import Reaction
from faultgen.discovery.laws.friction_discrepancy import (
    discrepancy_sensitivities,
    discrepancy_terms,
    shapes_of,
)
from faultgen.discovery.replay.sensitivities import sensitivities
from faultgen.discovery.terms.candidates import Term, names_by_use
from faultgen.effects import get_effect
from faultgen.effects.prior import Search, Seen
from faultgen.inference.limits import AGAIN, FALL, PROMISING
from faultgen.inference.products import ROUNDING

_WAVE = "transmission_error"  # its simulated reactions tell those to other errors of the gearbox
_CLOSER = 0.5 ** np.arange(1, 5)  # distances from the best place so far, over the spacing
_BESIDE = 2.0  # distance of places that are simulated beside the best one, over the spacing
_MOST = 2  # axes of one effect that are simulated
_APART = 0.5  # time between two passes of a place, at least [s]
_LONGEST = 1.0  # a pass that takes longer counts as several [s]
_FELT = 0.02  # square of the reaction during a pass, over the largest
_BEFORE = 3  # other effects whose best explanation is left to a place at most
_USUAL = 0.01  # standard deviation among healthy robots, over the severity that is probed: assumed


def places(
    posed: Posed,
    difference: Difference,
    *,
    workers: int = 1,
    exclude: Collection[str] = (),
    cache: Path | None = None,
) -> tuple[list[Term], list[np.ndarray]]:
    """Find effects that act at one place, where a place is promising.

    Args:
        posed: The recording and what may differ.
        difference: The same, as the inference sees it.
        workers: Number of processes. It has no effect on the result.
        exclude: Effects that are not considered.
        cache: Folder in which simulations are kept.

    Returns:
        A term for each such effect and axis, and its change of the torque per unit, shape (samples,
        n_axes).
    """
    names = [name for name in names_by_use("searched") if name not in exclude]
    if not names:
        return [], []
    others, strongest = _others(difference)
    white = difference.white_numbers(difference.exact.healthy.log_scales)
    left = _Left(posed, difference, white)
    beside = _Left(posed, difference, white, others) if others else left
    known = _Known(posed, workers, cache)
    best: dict[tuple[str, int], _Place] = {}
    for axis in range(1, posed.replay.robot.n_axes + 1):
        if not difference.inside[:, axis - 1].any():
            continue
        here = _Axis(posed, known, axis)
        for name in names:
            found = [here.best(left, name, search) for search in get_effect(name).prior.search]
            best[name, axis] = max(found, key=lambda one: one.gain)
    terms: list[Term] = []
    columns: list[np.ndarray] = []
    for name in names:
        least = PROMISING * FALL
        of_name = sorted(
            (place for (own, _), place in best.items() if own == name), key=lambda one: -one.gain
        )
        for place in of_name[:_MOST]:
            if place.gain > least and (
                place.gain > strongest or beside.gain(place.column, place.axis) > least
            ):
                term, column = _simulated(posed, left, place, workers)
                own = column[:, place.axis - 1].astype(float)
                period = posed.replay.recording.sample_period
                if left.is_repeated(own, place.axis, least, period):
                    terms.append(term)
                    columns.append(column)
    return terms, columns


def _others(difference: Difference) -> tuple[list[int], float]:
    """Columns of the effects that explain most, chosen one after another with usual scales.

    Returns:
        The columns, and the fall of the misfit by the first effect.
    """
    exact = difference.exact
    forms = [form for one in difference.hypotheses if not one.unknown for form in one.forms]
    known: list[int] = []
    strongest = 0.0
    for _ in range(_BEFORE):
        left = [form for form in forms if not set(form) & set(known)]
        if not left:
            break
        falls = 2 * exact.bayes_factors(exact.healthy.log_scales, left, known)
        k = int(np.argmax(falls))
        strongest = max(strongest, float(falls[k]))
        if falls[k] < FALL:
            break
        known += left[k]
    return known, strongest


@dataclass(frozen=True, eq=False)
class _Place:
    """An effect at the best place of one of its searches."""

    gain: float
    """Decrease of the misfit, as the linear reaction tells it."""
    effect: str
    axis: int
    search: Search
    at: float
    """The place."""
    column: np.ndarray
    """The linear reaction of the axis, shape (samples,); empty if the effect cannot act there."""

    def term(self, at: float) -> Term:
        """The effect at a place."""
        step = get_effect(self.effect).step
        own = {self.search.parameter: at, **self.search.others}
        return Term(self.effect, self.axis, step, _USUAL * step, tuple(own.items()))


def _simulated(posed: Posed, left: _Left, place: _Place, workers: int) -> tuple[Term, np.ndarray]:
    """Simulate an effect at a place and beside it, and at the place that a parabola tells.

    The linear reaction is not exact at frequencies that friction hardly has.

    Returns:
        The effect at the best of these places, and its column.
    """
    apart = _BESIDE * place.search.spacing
    terms = [place.term(place.at + k * apart) for k in (-1, 0, 1)]
    _, columns = sensitivities(posed.replay, terms, posed.base, workers=workers)

    def gain(column: np.ndarray) -> float:
        return left.gain(column[:, place.axis - 1].astype(float), place.axis)

    low, middle, high = (gain(column) for column in columns)
    bend = low - 2 * middle + high
    if bend < 0:
        shift = float(np.clip((low - high) / (2 * bend), -2.0, 2.0))
        new = place.term(place.at + shift * apart)
        _, column = sensitivities(posed.replay, [new], posed.base, workers=workers)
        terms, columns = [*terms, new], np.concatenate([columns, column])
    best = int(np.argmax([gain(column) for column in columns]))
    return terms[best], columns[best]


class _Known:
    """Torques on rotors whose reactions are known, and the motion."""

    def __init__(self, posed: Posed, workers: int, cache: Path | None) -> None:
        replay = posed.replay
        self.motor = replay.recording.motor_position(replay.robot)
        self.velocity = replay.recording.derivatives(self.motor)[1]
        self.pushes = -shapes_of(replay)  # friction is positive against the motion
        forms = discrepancy_terms(replay.robot)
        self.reactions = discrepancy_sensitivities(
            replay, forms, posed.base, workers=workers, cache=cache
        )
        self.axes = np.array([term.axis for term in forms])

    def of_axis(self, axis: int) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Torques on the rotor of an axis, and their reactions, shape (samples,) each."""
        own = self.reactions[self.axes == axis]
        return list(self.pushes[:, :, axis - 1]), list(own[:, :, axis - 1])


class _Axis:
    """Searched effects on one axis, and the reactions to them."""

    def __init__(self, posed: Posed, known: _Known, axis: int) -> None:
        recording, robot, k = posed.replay.recording, posed.replay.robot, axis - 1
        torque = posed.base[:, k]
        if recording.side == "joint":
            torque = torque / robot.gear_ratio[k]
        motor = known.motor[:, k]
        joint = posed.replay.wanted[:, k]
        self._seen = Seen(robot, axis, joint, motor, known.velocity[:, k], torque)
        causes, reactions = [], []
        for term, raw in zip(posed.terms, posed.raw, strict=True):
            if term.key == (_WAVE, axis):
                given = dict(term.parameters)
                causes.append(np.sin(given["order"] * motor + given["phase"]))
                reactions.append(raw[:, k])
        self._reactions = {
            twists: Reaction(both[0], both[1], recording.parts, recording.sample_period)
            for twists, both in ((False, known.of_axis(axis)), (True, (causes, reactions)))
            if both[0]
        }

    def best(self, left: _Left, name: str, search: Search) -> _Place:
        """Find the best place of an effect, first among all places and then closer.

        Args:
            left: What is to be explained.
            name: Effect with the use "searched".
            search: One of its searches.

        Returns:
            The place. Its gain is 0 if the effect cannot act on the axis.
        """
        effect, seen = get_effect(name), self._seen
        reaction = self._reactions.get(search.twists)
        if reaction is None or seen.axis not in effect.axes_on(seen.robot):
            return _Place(0.0, name, seen.axis, search, 0.0, np.empty(0))

        def best_of(places: np.ndarray) -> _Place:
            own = {**effect.parameters, **search.others}
            causes = [search.cause(seen, own | {search.parameter: float(at)}) for at in places]
            columns = reaction.to(np.array(causes))
            gains = left.gains(columns, seen.axis)
            k = int(np.argmax(gains))
            return _Place(
                float(gains[k]), name, seen.axis, search, float(places[k]), columns[k].copy()
            )

        places, spacing = _places(search, seen)
        best = best_of(places)
        for distance in spacing * _CLOSER if best.gain > 0 else ():
            sides = best_of(best.at + distance * np.array([-1.0, 1.0]))
            best = max(best, sides, key=lambda one: one.gain)
        return best


def _places(search: Search, seen: Seen) -> tuple[np.ndarray, float]:
    """All places, and the distance between two of them."""
    low, high = -np.pi, np.pi
    if search.within_motion:
        low, high = float(seen.joint.min()), float(seen.joint.max())
    count = max(1, int(np.ceil((high - low) / search.spacing)))
    spacing = (high - low) / count
    return low + (np.arange(count) + 0.5) * spacing, spacing


class _Left:
    """What numbers and some effects leave of a difference, to be explained by further effects."""

    def __init__(
        self,
        posed: Posed,
        difference: Difference,
        white: np.ndarray,
        effects: Sequence[int] = (),
    ) -> None:
        """Fit all numbers of known form, with the scales of a healthy robot.

        Args:
            posed: The recording and what may differ.
            difference: The same, as the inference sees it.
            white: From `Difference.white_numbers`, shape (numbers, samples, n_axes).
            effects: Columns of the effects that are fitted beside them.
        """
        self._difference, model = difference, difference.model
        placed = [model.count + k for k in effects]
        terms = [t for k in effects for t in difference.groups[k]]
        scaled = [model.std[k] * posed.raw[t] for k, t in zip(placed, terms, strict=True)]
        beside = np.array(scaled, np.float32).reshape(-1, *difference.residual.shape)
        count = len(white)
        columns = np.concatenate([white, difference.whiten(beside)])
        mean = (model.mean[placed] / model.std[placed]).astype(np.float32)  # of plays
        target = difference.whiten(difference.residual).astype(np.float32)
        self._target = target - np.tensordot(mean, columns[count:], axes=1)
        # most columns act on one axis only
        acting = [np.flatnonzero(columns[:, :, k].any(axis=1)) for k in range(target.shape[1])]
        self._of_axis = [
            (which, np.ascontiguousarray(columns[which, :, k])) for k, which in enumerate(acting)
        ]
        # products of single precision would not be positive beside columns of other sizes
        gram, right = np.eye(len(columns)), np.zeros(len(columns))
        for axis, (which, single) in enumerate(self._of_axis):
            own = single.astype(float)
            gram[np.ix_(which, which)] += own @ own.T
            right[which] += own @ self._target[:, axis]
        gram[np.diag_indices_from(gram)] *= 1 + ROUNDING
        self._inverse = cho_solve(cho_factor(gram), np.eye(len(gram)))
        self._solution = self._inverse @ right

    def gain(self, column: np.ndarray, axis: int) -> float:
        """Compute the decrease of the misfit by a term that acts on one axis.

        Args:
            column: Change of the torque of the axis per unit of the term, shape (samples,).
            axis: From 1.

        Returns:
            The decrease; 0 if the severity would be negative.
        """
        return float(self.gains(column[None], axis)[0])

    def gains(self, columns: np.ndarray, axis: int) -> np.ndarray:
        """Compute the decrease of the misfit by each of several terms that act on one axis.

        Args:
            columns: Change of the torque of the axis per unit of each term, shape (terms, samples).
            axis: From 1.

        Returns:
            The decreases, shape (terms,); 0 where the severity would be negative.
        """
        own = self._difference.whiten_axis(columns, axis)
        which, known = self._of_axis[axis - 1]
        others = own.astype(np.float32) @ known.T
        pull = own @ self._target[:, axis - 1] - others @ self._solution[which]
        energy = np.einsum("ij,ij->i", own, own)
        inverse = self._inverse[np.ix_(which, which)]
        size = energy - np.einsum("ij,ij->i", others @ inverse, others)
        useful = (pull > 0) & (size > 1e-6 * energy)
        return np.where(useful, pull**2 / np.where(useful, size, 1.0), 0.0)

    def is_repeated(self, column: np.ndarray, axis: int, least: float, period: float) -> bool:
        """Whether an effect is seen at more than one pass of its place, and about equally large.

        What happens once, such as a lost sample or a bump, happens at some place too.

        Args:
            column: Change of the torque of the axis per unit of the term, shape (samples,).
            axis: From 1.
            least: Decrease of the misfit that is needed.
            period: Time between samples [s].
        """
        own = self._difference.whiten_axis(column, axis)
        which, known = self._of_axis[axis - 1]
        rest = self._target[:, axis - 1] - self._solution[which] @ known
        starts = _passes(own, period)
        if len(starts) < 2:
            return False
        size = np.add.reduceat(own**2, starts)
        pull = np.add.reduceat(own * rest, starts)
        most = np.argmax(pull**2 / size)
        if np.delete(pull, most).sum() < AGAIN * np.sqrt(np.delete(size, most).sum()):
            return False
        severity = pull.sum() / size.sum()
        scatter = np.sum((pull - severity * size) ** 2 / size) / (len(starts) - 1)
        return bool(severity**2 * size.sum() > least * max(1.0, scatter))


def _passes(own: np.ndarray, period: float) -> np.ndarray:
    """First sample of each pass, shape (passes,); a pass lasts until the next one."""
    felt = np.flatnonzero(own**2 > _FELT * np.max(own**2))
    starts: list[int] = []
    last = 0
    for sample in felt.tolist():
        ended = sample - last > _APART / period
        if not starts or ended or sample - starts[-1] > _LONGEST / period:
            starts.append(sample)
        last = sample
    return np.array(starts)

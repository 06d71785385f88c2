"""Effects that act at one place: an angle of the joint, or a phase of a turn, that is not known.

The reaction to such an effect is told for many places without a simulation, see `reaction`. The
place is the one at which the effect best explains what all other terms leave. The effect is then
simulated there, and becomes a candidate. Simulating it takes long, so this is done only where it
explains more than every other effect, or enough of what the best other effects would leave.

    problem = with_places(problem)
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve

from faultgen.discovery.decision.hypotheses import FALL, groups_of
from faultgen.discovery.decision.reaction import Reaction
from faultgen.discovery.fit.evidence import FREE, factored
from faultgen.discovery.fit.regression import Problem, posed_again
from faultgen.discovery.laws.friction_discrepancy import shapes_of
from faultgen.discovery.replay.sensitivities import sensitivities
from faultgen.discovery.terms.candidates import FORM, Term, names_by_use
from faultgen.effects import get_effect
from faultgen.effects.prior import Search, Seen

_WAVE = "transmission_error"  # its simulated reactions tell those to other errors of the gearbox
_PROMISING = 0.75  # share of the evidence that is needed, from which a place is simulated
_CLOSER = 0.5 ** np.arange(1, 5)  # distances from the best place so far, over the spacing
_BESIDE = 2.0  # distance of places that are simulated beside the best one, over the spacing
_MOST = 2  # axes of one effect that are simulated
_APART = 0.5  # time between two passes of a place, at least [s]
_LONGEST = 1.0  # a pass that takes longer counts as several [s]
_FELT = 0.02  # square of the reaction during a pass, over the largest
_AGAIN = 2.0  # standard errors of the severity that all passes but the most telling one show
_BEFORE = 3  # other effects whose best explanation is left to a place at most
_USUAL = 0.01  # standard deviation among healthy robots, over the severity that is probed: assumed


def with_places(problem: Problem, *, workers: int = 1, exclude: Collection[str] = ()) -> Problem:
    """Return the same problem with candidates for effects that act at one place.

    Args:
        problem: The residual and the terms.
        workers: Number of processes. It has no effect on the result.
        exclude: Effects that are not considered.

    Returns:
        The problem with a term for each effect and axis where a place is promising; the given one
        if there is none.
    """
    names = [name for name in names_by_use("searched") if name not in exclude]
    left = _Left(problem)
    others, strongest = _others(problem) if names else ([], 0.0)
    beside = _Left(problem, others) if others else left
    best: dict[tuple[str, int], _Place] = {}
    for axis in range(1, problem.robot.n_axes + 1) if names else ():
        if not problem.inside[left.rows, axis - 1].any():
            continue
        here = _Axis(problem, axis)
        for name in names:
            found = [here.best(left, name, search) for search in get_effect(name).prior.search]
            best[name, axis] = max(found, key=lambda one: one.gain)
    simulated: list[tuple[Term, np.ndarray]] = []
    for name in names:
        least = _PROMISING * FALL
        of_name = sorted(
            (place for (own, _), place in best.items() if own == name), key=lambda one: -one.gain
        )
        for place in of_name[:_MOST]:
            if place.gain > least and (
                place.gain > strongest or beside.gain(place.column, place.axis) > least
            ):
                term, column = _simulated(problem, left, place, workers)
                own = column[:, place.axis - 1].astype(float)
                if left.is_repeated(own, place.axis, least):
                    simulated.append((term, column))
    if not simulated:
        return problem
    terms, columns = zip(*simulated, strict=True)
    return posed_again(problem, terms, np.array(columns))


def _others(problem: Problem) -> tuple[list[int], float]:
    """Terms of the effects that explain most, chosen one after another to first order.

    Returns:
        Indices of the terms, and the decrease of the misfit by the first effect.
    """
    evidence, groups = problem.evidence(), groups_of(problem.terms)
    free: list[int] = []
    strongest = 0.0
    for _ in range(_BEFORE):
        rest = [group for group in groups if not set(group) & set(free)]
        gains, _ = evidence.gains(rest, free) if rest else (np.zeros(1), None)
        k = int(np.argmax(gains))
        strongest = max(strongest, float(gains[k]))
        if not rest or gains[k] < FALL:
            break
        free += rest[k]
    return free, strongest


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


def _simulated(
    problem: Problem, left: _Left, place: _Place, workers: int
) -> tuple[Term, np.ndarray]:
    """Simulate an effect at a place and beside it, and at the place that a parabola tells.

    The linear reaction is not exact at frequencies that friction hardly has.

    Returns:
        The effect at the best of these places, and its column.
    """
    apart = _BESIDE * place.search.spacing
    terms = [place.term(place.at + k * apart) for k in (-1, 0, 1)]
    _, columns = sensitivities(problem.replay, terms, problem.base, workers=workers)

    def gain(column: np.ndarray) -> float:
        return left.gain(column[:, place.axis - 1].astype(float), place.axis)

    low, middle, high = (gain(column) for column in columns)
    bend = low - 2 * middle + high
    if bend < 0:
        shift = float(np.clip((low - high) / (2 * bend), -2.0, 2.0))
        new = place.term(place.at + shift * apart)
        _, column = sensitivities(problem.replay, [new], problem.base, workers=workers)
        terms, columns = [*terms, new], np.concatenate([columns, column])
    best = int(np.argmax([gain(column) for column in columns]))
    return terms[best], columns[best]


class _Axis:
    """Searched effects on one axis, and the reactions to them."""

    def __init__(self, problem: Problem, axis: int) -> None:
        recording, robot, k = problem.recording, problem.robot, axis - 1
        torque = problem.base[:, k]
        if recording.side == "joint":
            torque = torque / robot.gear_ratio[k]
        motor = problem.motion.position[:, k]
        joint = problem.replay.wanted[:, k]
        self._seen = Seen(robot, axis, joint, motor, problem.motion.velocity[:, k], torque)
        parts, period = recording.parts, recording.sample_period
        own = {False: FORM, True: _WAVE}
        shapes = -shapes_of(problem.replay)[:, :, k]  # friction is positive against the motion
        self._reactions = {}
        for twists, name in own.items():
            causes, reactions = [], []
            for term, raw in zip(problem.terms, problem.raw, strict=True):
                if term.key != (name, axis):
                    continue
                given = dict(term.parameters)
                if twists:
                    causes.append(np.sin(given["order"] * motor + given["phase"]))
                else:
                    causes.append(shapes[int(given["shape"])])
                reactions.append(raw[:, k])
            if causes:
                self._reactions[twists] = Reaction(causes, reactions, parts, period)

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
    """What all terms of a problem leave, to be explained by further ones."""

    def __init__(self, problem: Problem, free: Sequence[int] = ()) -> None:
        """Fit all terms.

        Args:
            problem: The residual and the terms.
            free: Terms without a prior.
        """
        self._problem = problem
        evidence = problem.evidence()
        gram = evidence.gram.sum(axis=0)
        weight = np.ones(len(gram))
        weight[list(free)] = FREE
        gram[np.diag_indices_from(gram)] += weight
        self._inverse = cho_solve(factored(gram), np.eye(len(gram)))
        self._solution = self._inverse @ evidence.right.sum(axis=0)
        self.rows = problem.samples(problem.fitting)
        """Samples that are used for fitting, shape (samples,)."""
        self._target = problem.whiten(problem.residual)

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
        own = self._problem.whiten_axis(columns, axis)[:, self.rows]
        others = own.astype(np.float32) @ self._columns(axis).T
        pull = own @ self._target[self.rows, axis - 1] - others @ self._solution
        energy = np.einsum("ij,ij->i", own, own)
        size = energy - np.einsum("ij,ij->i", others @ self._inverse, others)
        useful = (pull > 0) & (size > 1e-6 * energy)
        return np.where(useful, pull**2 / np.where(useful, size, 1.0), 0.0)

    def is_repeated(self, column: np.ndarray, axis: int, least: float) -> bool:
        """Whether an effect is seen at more than one pass of its place, and about equally large.

        What happens once, such as a lost sample or a bump, happens at some place too.

        Args:
            column: Change of the torque of the axis per unit of the term, shape (samples,).
            axis: From 1.
            least: Decrease of the misfit that is needed.
        """
        own = self._problem.whiten_axis(column, axis)[self.rows]
        rest = self._target[self.rows, axis - 1] - self._solution @ self._columns(axis)
        starts = self._passes(own)
        if len(starts) < 2:
            return False
        size = np.add.reduceat(own**2, starts)
        pull = np.add.reduceat(own * rest, starts)
        most = np.argmax(pull**2 / size)
        if np.delete(pull, most).sum() < _AGAIN * np.sqrt(np.delete(size, most).sum()):
            return False
        severity = pull.sum() / size.sum()
        scatter = np.sum((pull - severity * size) ** 2 / size) / (len(starts) - 1)
        return bool(severity**2 * size.sum() > least * max(1.0, scatter))

    def _passes(self, own: np.ndarray) -> np.ndarray:
        """First sample of each pass, shape (passes,); a pass lasts until the next one."""
        period = self._problem.recording.sample_period
        felt = np.flatnonzero(own**2 > _FELT * np.max(own**2))
        starts: list[int] = []
        last = 0
        for sample in felt.tolist():
            ended = sample - last > _APART / period
            if not starts or ended or sample - starts[-1] > _LONGEST / period:
                starts.append(sample)
            last = sample
        return np.array(starts)

    def _columns(self, axis: int) -> np.ndarray:
        """Whitened columns of all terms on an axis, kept for the next call."""
        if getattr(self, "_of", None) != axis:
            self._of = axis
            self._own = np.ascontiguousarray(self._problem.white[:, self.rows, axis - 1])
        return self._own

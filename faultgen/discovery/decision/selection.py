"""Choice of the missing effects: they are added one at a time, and sets are fitted together.

Candidates are first ranked by how much they reduce the misfit, to first order. The best ones are
judged by how well they predict recordings that they were not fitted to. Sets are compared after
re-simulation, and effects of a set may be dropped or exchanged.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from faultgen.discovery.decision.certainty import overdispersion
from faultgen.discovery.fit import law_error
from faultgen.discovery.fit.fit import Fit, Group, fit
from faultgen.discovery.fit.regression import Problem
from faultgen.discovery.terms.candidates import PAYLOAD, Term
from faultgen.effects import get_effect

SHARE = 0.03
"""Smallest share that an effect must have in what all effects explain together."""

SURE_WITH_BASELINE = 18.0
"""Amount by which an effect must reduce the misfit if there is a baseline. Of 104 healthy
development robots one reaches 17.5, and all others stay at 14 or below."""

SURE = 21.0
"""The same without a baseline. Healthy robots reach 16."""

SURE_IMITATED = 35.0
"""The same without a baseline for effects that wrong friction or links imitate (`Prior.imitated`).
Of 152 healthy development robots one reaches 37, two reach 32, and all others stay at 24 or
below."""

COMPANION = 0.1
"""Smallest share for a second kind of speed-dependent friction on one axis. The friction of a real
robot has another form than the catalogue's, and a small amount of a second kind compensates for
it."""

SIMILAR = 9.0
"""A set is not excluded if its misfit is larger by less than this times the overdispersion."""

FORM_ERROR = 0.002
"""Share of what an effect explains that its true form may shift from one effect to another. An
effect of a real robot differs from its law by some 10 %, and about a fifth of the difference looks
like another effect: assumed."""

LONGEST_SEARCH = 150
"""Simulations after which no further effect is sought: assumed. They take some minutes. One with an
effect that acts between the time steps counts as `_BETWEEN`."""

_JUDGED = 8  # candidates that are judged on held-out recordings
_TRIED = 3  # of them that are simulated
_RIVALS = 3  # swaps that are simulated
_NEAR = 0.25  # share of what an effect explains that one put in its place may miss, to first order
_ALIKE = 0.5  # the same for two kinds of friction of speed on one axis, which nuisances confuse
_BETWEEN = 4  # time of such a simulation over that of another: 3 to 6 were measured


@dataclass(frozen=True, eq=False)
class Choice:
    """The chosen set of effects and its rivals."""

    problem: Problem
    """The residual on which sets were compared."""
    fits: tuple[Fit, ...]
    """The empty set, and then the set after each effect that was added."""
    best: Fit
    """The set that is reported."""
    rivals: tuple[tuple[int, Group, float], ...]
    """Exchanges that are not excluded: position in the set, the effect that is put there, and by
    how much the misfit increases."""
    is_complete: bool = True
    """Whether the search went on until no further effect was found. If not, it ended at
    `LONGEST_SEARCH`."""


def groups_of(terms: Sequence[Term]) -> list[Group]:
    """List the candidates. Sine and cosine, like the points of a payload, make one candidate."""
    groups: dict[tuple, list[int]] = {}
    for index, term in enumerate(terms):
        if not term.is_effect or term.nuisance:
            continue
        order = dict(term.parameters).get("order")
        key: tuple = (index,) if order is None else (term.name, term.axis, order)
        if term.name == PAYLOAD and term.parameters:
            key = term.key
        groups.setdefault(key, []).append(index)
    return [tuple(group) for group in groups.values()]


def needed(problem: Problem, group: Group) -> float:
    """Return the amount by which an effect must reduce the misfit, if noise alone is left.

    Args:
        problem: The residual and the terms.
        group: The terms of the effect.
    """
    return needed_of(problem.terms[group[0]].name, baseline=problem.baseline)


def needed_of(effect: str, *, baseline: bool) -> float:
    """Return the same for an effect by its name.

    Args:
        effect: Name.
        baseline: Whether the residual is the difference of two recordings.
    """
    if baseline:
        return SURE_WITH_BASELINE
    return SURE_IMITATED if get_effect(effect).prior.imitated else SURE


def choose(problem: Problem) -> Choice:
    """Find the set of effects that explains a residual.

    Args:
        problem: The residual and the terms.

    Returns:
        The chosen set and its rivals.
    """
    search = _Search(problem)
    current = search.empty
    fits = [current]
    is_complete = True
    while search.simulated < LONGEST_SEARCH:
        new = search.addition(current)
        if new is None:
            break
        new = search.pruned(new)
        if not search.is_better(new, current):
            break
        new = search.swapped(new, current)
        if len(new.groups) <= len(current.groups):
            current = min(new, current, key=lambda one: one.misfit)
            break
        current = new
        fits.append(current)
    else:
        is_complete = False
    return Choice(problem, tuple(fits), current, tuple(search.rivals(current)), is_complete)


def rivals_of(problem: Problem, fitted: Fit) -> tuple[tuple[int, Group, float], ...]:
    """Find the exchanges of a set that the residual does not exclude.

    Args:
        problem: The residual on which sets are compared.
        fitted: The set.

    Returns:
        As `Choice.rivals`.
    """
    return tuple(_Search(problem).rivals(fitted))


class _Search:
    """Search among sets of effects of one problem. Each set is fitted only once."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.candidates = groups_of(problem.terms)
        self._seen: dict[frozenset[Group], Fit | None] = {}
        self.simulated = 0
        """Number of simulations so far, in units of the cheapest."""
        empty = self._fitted(())
        assert empty is not None
        self.empty = empty

    def _explained(self, fitted: Fit) -> float:
        """Amount by which a set reduces the misfit."""
        return max(self.empty.misfit - fitted.misfit, 0.0)

    def _fitted(self, groups: Sequence[Group], start: np.ndarray | None = None) -> Fit | None:
        key = frozenset(groups)
        if key not in self._seen:
            effects = [get_effect(self._term(group).name) for group in groups]
            cost = _BETWEEN if any(effect.between is not None for effect in effects) else 1
            self._seen[key] = fit(self.problem, groups, start, simulating=lambda: self._count(cost))
        return self._seen[key]

    def _count(self, cost: int) -> None:
        self.simulated += cost

    def _term(self, group: Group) -> Term:
        return self.problem.terms[group[0]]

    def _sure(self, group: Group) -> float:
        return needed(self.problem, group)

    def is_better(self, new: Fit, current: Fit) -> bool:
        """Whether a set reduces the misfit by the amount that its new effects require."""
        came = [self._sure(group) for group in new.groups if group not in current.groups]
        return new.misfit < current.misfit - max(came, default=SURE)

    def _others(self, groups: Sequence[Group]) -> list[Group]:
        """Candidates that are not in a set, also not with another probing severity."""
        taken = {self._which(group) for group in groups}
        return [group for group in self.candidates if self._which(group) not in taken]

    def _share(self, group: Group) -> float:
        """Smallest share that an effect must have in what all explain.

        Friction that may differ from day to day explains less than its torque.
        """
        is_usual = self.problem.friction_spread and get_effect(self._term(group).name).prior.group
        return 0.0 if is_usual else SHARE

    def _which(self, group: Group) -> tuple:
        """Effect, axis and parameters, without the probing severity."""
        return (*self._term(group).key, self._term(group).parameters)

    def _allowed(self, group: Group, first: float) -> bool:
        """Whether a value of the first term, in its prior_std, is within the effect's bounds."""
        term = self._term(group)
        return len(group) > 1 or first * term.prior_std > get_effect(term.name).smallest

    def addition(self, current: Fit) -> Fit | None:
        """The set with one more candidate: the one that best predicts held-out recordings."""
        free = current.terms
        others = self._others(current.groups)
        gains, first = law_error.gains(self.problem, current.evidence, others, free, current.values)
        strong: dict[tuple, int] = {}  # one probing severity of each effect
        for k in np.argsort(-gains):
            if self._allowed(others[k], first[k]) and gains[k] > self._sure(others[k]):
                strong.setdefault(self._which(others[k]), k)
        before = law_error.score(current.evidence, free)
        judged = [
            (before - self._score(current, others[k], first[k]), k)
            for k in list(strong.values())[:_JUDGED]
        ]
        found: list[Fit] = []
        for gain, k in sorted(judged, reverse=True)[:_TRIED]:
            group = others[k]
            is_play = get_effect(self._term(group).name).prior.play
            if found and not is_play:
                continue
            least = max(self._sure(group) / 2, self._share(group) * self._explained(current))
            if gain < least:
                break
            if self._is_companion(current, group) and gain < COMPANION * self._explained(current):
                continue
            start = np.append(current.values, self._start(current, group))
            new = self._fitted([*current.groups, group], start)
            if new is not None and new.misfit < current.misfit - least:
                found.append(new)
                if not is_play:
                    break
        # slopes do not show which play is the right one, so that several are simulated
        return min(found, key=lambda one: one.misfit) if found else None

    def _score(self, current: Fit, group: Group, first: float) -> float:
        """Score to first order with a further candidate, and what its law may miss."""
        own = np.append(first * self._term(group).prior_std, np.zeros(len(group) - 1))
        weight = law_error.weights(
            self.problem, [*current.terms, *group], np.append(current.values, own)
        )
        return law_error.score(current.evidence.weighted(weight), [*current.terms, *group])

    def _is_companion(self, current: Fit, group: Group) -> bool:
        """Whether an axis already has another effect of the same group."""
        return any(self._is_alike(group, has) for has in current.groups)

    def _start(self, current: Fit, group: Group) -> np.ndarray:
        solution, _, _ = current.evidence.solve(free=[*current.terms, *group])
        return np.array([solution[t] * self.problem.terms[t].prior_std for t in group])

    def pruned(self, new: Fit) -> Fit:
        """Return the set without effects that have become superfluous."""
        while len(new.groups) > 1:
            losses = [float(np.sum((values / errors) ** 2)) for _, values, errors in new.members()]
            k = int(np.argmin(losses))
            group = new.groups[k]
            least = max(self._sure(group), self._share(group) * self._explained(new))
            if losses[k] > 3 * least:
                return new
            without = self._fitted([g for j, g in enumerate(new.groups) if j != k])
            if without is None or without.misfit - new.misfit > least:
                return new
            new = without
        return new

    def _swaps(self, current: Fit, over: float, most: int) -> Iterator[tuple[int, Group, Fit]]:
        """Simulated sets with one effect exchanged that are about as good to first order."""
        nominal = self.problem.evidence()
        found: dict[tuple, tuple[float, int, Group]] = {}  # with one probing severity
        for place, group in enumerate(current.groups):
            rest = [t for j, g in enumerate(current.groups) if j != place for t in g]
            others = self._others(current.groups)
            values = np.concatenate(
                [np.empty(0), *(v for j, (_, v, _) in enumerate(current.members()) if j != place)]
            )
            gains, first = law_error.gains(self.problem, nominal, [group, *others], rest, values)
            for k, other in enumerate(others, start=1):
                loss = float(gains[0] - gains[k])
                share = _ALIKE if self._is_alike(group, other) else _NEAR
                near = loss <= max(3 * SIMILAR * over, share * gains[0])
                if near and self._allowed(other, first[k]):
                    key = (place, *self._which(other))
                    found[key] = min(found.get(key, (np.inf, 0, ())), (loss, place, other))
        for _, place, other in sorted(found.values())[:most]:
            groups = [other if j == place else g for j, g in enumerate(current.groups)]
            rival = self._fitted(groups)
            if rival is not None:
                yield place, other, rival

    def swapped(self, new: Fit, current: Fit) -> Fit:
        """The best set among a new one and its exchanges that are better than the present one."""
        rivals = [rival for _, _, rival in self._swaps(new, 1.0, _RIVALS)]
        good = [rival for rival in rivals if self.is_better(rival, current)]
        return min([new, *good], key=lambda one: one.score)

    def rivals(self, current: Fit) -> list[tuple[int, Group, float]]:
        """Exchanges that are not excluded. Differences are divided by the overdispersion.

        The larger an effect is, the more of the difference may come from the error of its form.
        """
        over = overdispersion(self.problem, current)
        size = [self._size(*member) for member in current.members()]
        found = [
            (place, other, (rival.score - current.score) / (over + FORM_ERROR * size[place]))
            for place, other, rival in self._swaps(current, over, 2 * _RIVALS)
        ]
        return [one for one in found if one[2] < SIMILAR]

    def _size(self, group: Group, values: np.ndarray, errors: np.ndarray) -> float:
        """How much an effect explains: of its torque, or less what other terms may explain too.

        With a baseline, friction that may differ from day to day would hide most of its torque.
        """
        if not self.problem.baseline:
            return float(np.sum((values / errors) ** 2))
        share = values / [self.problem.terms[term].prior_std for term in group]
        used = self.problem.samples(self.problem.fitting)
        white = self.problem.white[list(group)][:, used].astype(float)
        return float(np.sum(np.tensordot(share, white, axes=1) ** 2))

    def _is_alike(self, group: Group, other: Group) -> bool:
        """Whether two effects are kinds of friction of speed on one axis."""
        one, two = self._term(group), self._term(other)
        kind = get_effect(one.name).prior.group
        return bool(kind) and one.axis == two.axis and get_effect(two.name).prior.group == kind

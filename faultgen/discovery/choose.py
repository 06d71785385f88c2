"""Which effects are missing: added one at a time, refitted together, with drops and swaps.

Terms are screened by what they take off the misfit, to first order; the best are judged by how they
predict recordings that they were not fitted to; and sets are compared after re-simulation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from faultgen.discovery.fit import Fit, Group, fit
from faultgen.discovery.problem import Problem
from faultgen.discovery.terms import FRICTION, PAYLOAD
from faultgen.effects import get_effect

MOST = 3
"""Effects that are added at most."""

SHARE = 0.03
"""Smallest share of the gap that an effect has to explain."""

SURE = {True: 21.0, False: 32.0}
"""What an effect has to take off the misfit, with a twin and without: chosen on development cases,
where healthy robots reach 13 and 49."""

COMPANION = 0.1
"""Smallest share of the gap for a second kind of friction by speed on one axis: a true one is of
another form than the catalogue's, and a little of another makes up for it."""

SIMILAR = 9.0
"""What another set may be worse by and still not be excluded, over the overdispersion."""

_JUDGED = 8  # candidates that are judged on held-out recordings
_RIVALS = 3  # swaps that are simulated


@dataclass(frozen=True, eq=False)
class Choice:
    """What was chosen."""

    fits: tuple[Fit, ...]
    """The empty set, and after it the set after each effect that was added."""
    best: Fit
    """The set that is answered with."""
    rivals: tuple[tuple[int, Group, float], ...]
    """Swaps that are not excluded: place in the set, what is put there, and how much worse."""
    overdispersion: float
    """Squared whitened error over what noise alone would leave, at least 1."""


def groups_of(problem: Problem) -> list[Group]:
    """Candidates: each effect term; sine and cosine, and the points of a payload, together."""
    groups: dict[tuple, list[int]] = {}
    for index, term in enumerate(problem.terms):
        if not term.is_effect:
            continue
        order = dict(term.parameters).get("order")
        key: tuple = (index,) if order is None else (term.name, term.axis, order)
        if term.name == PAYLOAD and term.parameters:
            key = term.key
        groups.setdefault(key, []).append(index)
    return [tuple(group) for group in groups.values()]


def choose(problem: Problem) -> Choice:
    """Find the set of effects that explains a gap.

    Args:
        problem: The gap and the terms.
    """
    candidates = groups_of(problem)
    seen: dict[frozenset[Group], Fit | None] = {}

    def fitted(groups: Sequence[Group], start: np.ndarray | None = None) -> Fit | None:
        key = frozenset(groups)
        if key not in seen:
            seen[key] = fit(problem, groups, start)
        return seen[key]

    current = fitted(())
    assert current is not None
    empty = current
    fits = [empty]
    while len(current.groups) < MOST:
        new = _best_addition(problem, candidates, current, empty, fitted)
        if new is None:
            break
        new = _pruned(problem, new, empty, fitted)
        if new.misfit >= current.misfit - SURE[problem.twin]:
            break
        new = _swapped(problem, candidates, new, fitted)
        if len(new.groups) <= len(current.groups):
            current = new if new.misfit < current.misfit else current
            break
        current = new
        fits.append(current)
    over = _over(problem, current)
    rivals = _rivals(problem, candidates, current, fitted, over)
    return Choice(tuple(fits), current, tuple(rivals), over)


def _over(problem: Problem, fitted: Fit) -> float:
    count = sum(problem.inside[problem.parts[p]].sum() for p in problem.fitting)
    return max(1.0, fitted.misfit / max(count, 1))


def _excess(problem: Problem, empty: Fit) -> float:
    """Misfit of the model beyond noise."""
    count = sum(problem.inside[problem.parts[p]].sum() for p in problem.fitting)
    return max(empty.misfit - count, 0.0)


def _allowed(problem: Problem, group: Group, first: float) -> bool:
    """Whether a value of the first term, in tolerances, is within the effect's bounds."""
    if len(group) > 1:
        return True
    term = problem.terms[group[0]]
    return first * term.tolerance > get_effect(term.name).smallest


def _others(
    problem: Problem, candidates: Sequence[Group], groups: Sequence[Group]
) -> list[Group]:
    """Candidates that are no effect of a set, nor such a one probed at another severity."""

    def which(group: Group) -> tuple:
        term = problem.terms[group[0]]
        return (*term.key, term.parameters)

    taken = {which(group) for group in groups}
    return [group for group in candidates if which(group) not in taken]


def _best_addition(problem, candidates, current, empty, fitted) -> Fit | None:  # type: ignore[no-untyped-def]
    """The set with the candidate that predicts best what it was not fitted to."""
    free = current.terms
    others = _others(problem, candidates, current.groups)
    gains, first = current.evidence.gains(others, free)
    order = [
        k
        for k in np.argsort(-gains)
        if _allowed(problem, others[k], first[k]) and gains[k] > SURE[problem.twin]
    ][:_JUDGED]
    before = current.evidence.score(free)
    judged = []
    for k in order:
        after = current.evidence.score([*free, *others[k]])
        judged.append((before - after, k))
    judged.sort(reverse=True)
    least = max(SURE[problem.twin] / 2, SHARE * _excess(problem, empty))
    for gain, k in judged[:3]:
        if gain < least:
            return None
        group = others[k]
        if _is_companion(problem, current, group):
            if gain < COMPANION * _excess(problem, empty):
                continue
        start = np.append(current.values, _start(problem, current, group))
        new = fitted([*current.groups, group], start)
        if new is not None and new.misfit < current.misfit - least:
            return new
    return None


def _is_companion(problem: Problem, current: Fit, group: Group) -> bool:
    """Whether an axis has another kind of friction by speed already."""
    term = problem.terms[group[0]]
    has = [problem.terms[g[0]] for g in current.groups]
    return term.name in FRICTION and any(
        one.name in FRICTION and one.axis == term.axis for one in has
    )


def _start(problem: Problem, current: Fit, group: Group) -> np.ndarray:
    solution, _, _ = current.evidence.solve(free=[*current.terms, *group])
    return np.array([solution[t] * problem.terms[t].tolerance for t in group])


def _pruned(problem, new, empty, fitted) -> Fit:  # type: ignore[no-untyped-def]
    """Without effects that others have made superfluous."""
    least = max(SURE[problem.twin], SHARE * _excess(problem, empty))
    while len(new.groups) > 1:
        losses = []
        at = 0
        for k, group in enumerate(new.groups):
            values = new.values[at : at + len(group)]
            errors = new.errors[at : at + len(group)]
            losses.append((float(np.sum((values / errors) ** 2)), k))
            at += len(group)
        loss, k = min(losses)
        if loss > 3 * least:
            return new
        without = fitted([g for j, g in enumerate(new.groups) if j != k])
        if without is None or without.misfit - new.misfit > least:
            return new
        new = without
    return new


def _swaps(problem, candidates, current):  # type: ignore[no-untyped-def]
    """Swaps of one effect by how they would do, to first order: (loss, place, candidate)."""
    nominal = problem.evidence()
    found = []
    for place, group in enumerate(current.groups):
        rest = [t for j, g in enumerate(current.groups) if j != place for t in g]
        others = _others(problem, candidates, current.groups)
        gains, first = nominal.gains([group, *others], rest)
        for k, other in enumerate(others, start=1):
            if _allowed(problem, other, first[k]):
                found.append((float(gains[0] - gains[k]), float(gains[0]), place, other))
    return sorted(found, key=lambda one: one[0])


def _swapped(problem, candidates, current, fitted) -> Fit:  # type: ignore[no-untyped-def]
    """The best of the set and its swaps, after re-simulation."""
    best = current
    for loss, gain, place, other in _swaps(problem, candidates, current)[:_RIVALS]:
        if loss > max(3 * SIMILAR, 0.25 * gain):
            break
        groups = [other if j == place else g for j, g in enumerate(current.groups)]
        rival = fitted(groups)
        if rival is not None and rival.score < best.score:
            best = rival
    return best


def _rivals(problem, candidates, current, fitted, over):  # type: ignore[no-untyped-def]
    found = []
    for loss, gain, place, other in _swaps(problem, candidates, current)[: 2 * _RIVALS]:
        if loss > max(3 * SIMILAR * over, 0.25 * gain):
            break
        groups = [other if j == place else g for j, g in enumerate(current.groups)]
        rival = fitted(groups)
        if rival is None:
            continue
        worse = (rival.score - current.score) / over
        if worse < SIMILAR:
            found.append((place, other, float(worse)))
    return found

"""What a dataset holds and what isolators make of it, in one sentence.

summary(dataset, worst, result)  # "Axes 1 to 6 of puma560 have up to 20 % more friction; ..."
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from faultgen.dataset.stored_run import StoredRun
from faultgen.effects import get_effect
from faultgen.effects.words import amount
from faultgen.evaluation.outcomes import Isolation
from faultgen.robot import Robot
from faultgen.system.words import in_series

_MOST = 3  # effects, or methods, that the sentence names


@dataclass(frozen=True, eq=False)
class Worst:
    """The run in which an effect is strongest on an axis."""

    effect: str
    """Name of the effect."""
    axis: int
    """From 1."""
    severity: float
    """In the last cycle, in the unit of the effect."""
    share: float
    """The same over the largest severity of this effect on any axis."""
    text: str
    """The severity in words, such as "20 % more friction"."""
    run: StoredRun
    """The run."""


def worst_runs(runs: Sequence[StoredRun], robot: Robot | None) -> list[Worst]:
    """Find where each effect is strongest, axis by axis. Only the main fault of a run counts.

    Args:
        runs: Runs of one robot.
        robot: The healthy robot, whose units are used; None if it cannot be found any more.

    Returns:
        One entry for each effect and axis that occur, in order of effect and axis.
    """
    found: dict[tuple[str, int], StoredRun] = {}
    for run in runs:
        if run["axis"] == 0:
            continue
        for axis in run["axes"]:
            known = found.get((run["effect"], int(axis)))
            if known is None or abs(run["severity"]) > abs(known["severity"]):
                found[run["effect"], int(axis)] = run
    largest: dict[str, float] = {}
    for (effect, _), run in found.items():
        largest[effect] = max(largest.get(effect, 0.0), abs(float(run["severity"])))
    return [
        Worst(
            effect,
            axis,
            float(run["severity"]),
            abs(float(run["severity"])) / largest[effect] if largest[effect] else 0.0,
            _in_words(run, axis, robot),
            run,
        )
        for (effect, axis), run in sorted(found.items(), key=lambda one: one[0])
    ]


def _in_words(run: StoredRun, axis: int, robot: Robot | None) -> str:
    if robot is not None:
        return amount(robot, run["effect"], axis, float(run["severity"]))
    shown = get_effect(run["effect"]).shown(run["severity"], run["severity_units"])
    return f"{run['effect'].replace('_', ' ')} {shown}"


def summary(robots: dict[str, list[Worst]], result: Isolation | None) -> str:
    """Say what a dataset holds and which isolators name the worn axis most often.

    Args:
        robots: Of each robot, what `worst_runs` found.
        result: Results of the isolators; None if there are none.

    Returns:
        One sentence, with its full stop.
    """
    parts = [_of_robot(name, worst) for name, worst in robots.items()]
    more = [f"{len(parts) - _MOST} more robots"] if len(parts) > _MOST else []
    shown = "; ".join([*parts[:_MOST], *more])
    text = f"{shown}{_best(result)}."
    return text[:1].upper() + text[1:]


def _of_robot(name: str, worst: Sequence[Worst]) -> str:
    if not worst:
        return f"no axis of {name} has a fault"
    by_effect: dict[str, list[Worst]] = {}
    for one in worst:
        by_effect.setdefault(one.effect, []).append(one)
    told = []
    for of_effect in list(by_effect.values())[:_MOST]:
        axes, strongest = [one.axis for one in of_effect], max(of_effect, key=lambda one: one.share)
        verb = "has" if len(axes) == 1 else "have"
        told.append(f"{listed_axes(axes)} of {name} {verb} up to {strongest.text}")
    more = len(by_effect) - _MOST
    return ", ".join(told) + (f" and {more} more effects" if more > 0 else "")


def listed_axes(axes: Collection[int]) -> str:
    """Name axes in words.

    Args:
        axes: From 1, at least one.

    Returns:
        For example "axis 2", "axes 1 to 6" or "axes 1, 3 and 4".
    """
    own = sorted(set(axes))
    if len(own) == 1:
        return f"axis {own[0]}"
    if len(own) > 2 and own == list(range(own[0], own[-1] + 1)):
        return f"axes {own[0]} to {own[-1]}"
    return f"axes {in_series([str(axis) for axis in own])}"


def _best(result: Isolation | None) -> str:
    """Which methods are right most often, at the largest severities."""
    worn = [] if result is None else [one for one in result.outcomes if one.level > 0 and one.total]
    if not worn:
        return ""
    top: dict[tuple[str, str, str], float] = {}
    for one in worn:
        place = (one.robot, one.task, one.effect)
        top[place] = max(top.get(place, 0.0), one.level)
    right: dict[str, list[int]] = {}
    for one in worn:
        if one.level == top[one.robot, one.task, one.effect]:
            counts = right.setdefault(one.method, [0, 0])
            counts[0] += one.right
            counts[1] += one.total
    shares = {method: own / total for method, (own, total) in right.items()}
    best = max(shares.values())
    names = [method for method, share in shares.items() if share == best]
    if len(names) > _MOST:
        names = [*names[:_MOST], f"{len(names) - _MOST} more isolators"]
    verb = "names" if len(names) == 1 else "name"
    share = f"{100 * best:.0f} % of the runs with most wear"
    return f"; {in_series(names)} {verb} the worn axis in {share}"

"""Counts of the isolators' answers, in the form of thesis table 6.2."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from faultgen.effects import HEALTHY, get_effect
from faultgen.evaluation import markdown
from faultgen.evaluation.shares import wilson
from faultgen.system.files import write_text
from faultgen.system.terminal import visible

# Thesis table 6.2, percent right of six axes, one simulation each; columns TE 10, TE 5 and CC
THESIS = {
    ("pick_and_place", 0.01): (50.0, 100.0, 16.7),
    ("pick_and_place", 0.05): (100.0, 83.3, 33.3),
    ("pick_and_place", 0.10): (100.0, 83.3, 33.3),
    ("pick_and_place", 0.15): (100.0, 100.0, 33.3),
    ("spot_weld", 0.01): (83.3, 66.7, 16.7),
    ("spot_weld", 0.05): (83.3, 66.7, 0.0),
    ("spot_weld", 0.10): (100.0, 66.7, 33.3),
    ("spot_weld", 0.15): (100.0, 50.0, 33.3),
    ("arc_weld", 0.01): (100.0, 83.3, 50.0),
    ("arc_weld", 0.05): (100.0, 66.7, 66.7),
    ("arc_weld", 0.10): (100.0, 66.7, 83.3),
    ("arc_weld", 0.15): (100.0, 66.7, 100.0),
}


THEIRS = ("TE 10 bins", "TE 5 bins", "CC", "CC, eq. 3.5")
"""Methods of the thesis. Its CC can be read in two ways, and both are listed."""


@dataclass
class Outcomes:
    """Counted answers of one method for one robot, task and level of wear."""

    robot: str
    """Name of the robot."""
    task: str
    """Name of the task."""
    effect: str
    """Name of the effect; 'healthy' if there is none."""
    level: float
    """Severity at the last cycle used; 0 for the healthy robot with all of its cycles."""
    method: str
    """Name of the method."""
    right: int = 0
    """Answers that named a worn axis; on a healthy robot, answers that named none."""
    named: int = 0
    """Answers that named any axis."""
    total: int = 0
    """Number of all answers."""
    right_by_axis: dict[int, int] = field(default_factory=dict)
    """Number of right answers by worn axis."""
    total_by_axis: dict[int, int] = field(default_factory=dict)
    """Number of answers by worn axis."""
    answers: dict[int, int] = field(default_factory=dict)
    """How often each axis was named; 0 is none."""

    @property
    def accuracy(self) -> float:
        """Share of right answers."""
        return self.right / self.total

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson interval of the accuracy, 95 %."""
        return wilson(self.right, self.total)

    def add(self, answer: int, worn: tuple[int, ...]) -> None:
        """Count one answer.

        Args:
            answer: The axis that was named, from 1, or 0 for none.
            worn: The axes that are worn, from 1.
        """
        right = answer in worn if worn else answer == 0
        self.total += 1
        self.right += right
        self.named += answer > 0
        self.answers[answer] = self.answers.get(answer, 0) + 1
        for axis in worn:
            self.total_by_axis[axis] = self.total_by_axis.get(axis, 0) + 1
            self.right_by_axis[axis] = self.right_by_axis.get(axis, 0) + (answer == axis)


@dataclass(frozen=True)
class Isolation:
    """Results of the isolators on a dataset."""

    sensors: str
    """Name of the noise in the data."""
    seeds: int
    """Number of noise draws for each run."""
    redrawn: bool
    """Whether new noise was drawn, instead of using the noise of the dataset."""
    outcomes: list[Outcomes]
    """One for each robot, task, level and method."""
    unobservable: dict[str, list[int]]
    """Axes that are never within the speed window, by robot and task."""
    too_short: str
    """Levels of wear that were reached after too few cycles, in words; empty if there are none."""
    left_out: dict[str, str]
    """Why isolators were not used, by robot and task."""
    made_by: str
    """Versions and code that made the result, with that of isolators of other packages."""
    split: str = ""
    """Division by which the methods were tested; empty if they were asked about all runs."""


def tested_on(split: str) -> str:
    """Say on which runs methods were tested.

    Args:
        split: The division, or an empty text.

    Returns:
        A sentence that begins with a space, or an empty text.
    """
    if not split:
        return ""
    return f" Only runs of the test part of the division by {split} are counted."


def shown_level(effect: str, level: float) -> str:
    """Return a severity in the unit of its effect as text.

    Args:
        effect: Name of the effect.
        level: Severity, 0 for the healthy robot.

    Returns:
        The text; '-' for the healthy robot. Where the unit depends on the axis, it names both.
    """
    if not level:
        return "-"
    one = get_effect(effect)
    return f"{level:g} of nominal, or {one.point_units}" if one.point_units else one.shown(level)


def other_effects(effects: Iterable[str]) -> list[str]:
    """Lines for the report if a dataset contains other effects than friction wear."""
    others = sorted(set(effects) - {HEALTHY, "friction_wear", "coulomb_friction"})
    if not others:
        return []
    return [
        f"{', '.join(others)}: our isolators look for friction wear (Coulomb and static friction); "
        "on other effects they may name a wrong axis with certainty."
    ]


Key = tuple[str, str, str, float]
"""Robot, task, effect and severity."""


def method_tables(
    cells: Mapping[tuple[Key, str], str], methods: Sequence[str], count: Mapping[Key, int]
) -> list[str]:
    """Return a Markdown table for each robot, task and effect: methods by severity.

    Args:
        cells: What a method has reached, by what was done and the name of the method.
        methods: Names of the methods, in the order of the rows.
        count: Number of answers of which each cell consists.

    Returns:
        For each table a line that says what it is about, and the table.
    """
    keys = sorted({key for key, _ in cells})
    texts = []
    for robot, task in dict.fromkeys(key[:2] for key in keys):
        here = [key for key in keys if key[:2] == (robot, task)]
        healthy = [key for key in here if key[2] == HEALTHY]
        for effect in dict.fromkeys(key[2] for key in here if key[2] != HEALTHY) or [HEALTHY]:
            columns = [key for key in here if key[2] == effect != HEALTHY] + healthy
            head = [
                f"{shown_level(effect, key[3]) if key[3] else HEALTHY} (n = {count[key]})"
                for key in columns
            ]
            body = [[name, *(cells.get((key, name), "-") for key in columns)] for name in methods]
            texts += [
                visible(f"**{robot}, {task}, {effect}**"),
                markdown.table(["method \\ severity", *head], body),
            ]
    return texts


def table(result: Isolation) -> str:
    """Return Markdown tables with the content of table 6.2: methods by wear."""
    by_method = {((t.robot, t.task, t.effect, t.level), t.method): t for t in result.outcomes}
    methods = list(dict.fromkeys(t.method for t in result.outcomes))
    beside = any(robot == "irb6700" for (robot, *_), _ in by_method)
    drawn = f"{result.seeds} draws of" if result.redrawn else "the stored"
    cells = {}
    for (key, method), one in by_method.items():
        cells[key, method] = _cell(one)
        if key[0] == "irb6700" and (key[1], key[3]) in THESIS and method in THEIRS:
            cells[key, method] += f" / {thesis_value(key[1], key[3], method):g}"
    said = [
        f"Axis isolated, percent of n answers [95 % Wilson interval]; {drawn} "
        f"'{visible(result.sensors)}' noise"
        + ("; thesis' figure after the slash." if beside else ".")
        + tested_on(result.split)
    ]
    said += method_tables(cells, methods, {key: one.total for (key, _), one in by_method.items()})
    if result.too_short:
        said.append("Not asked, since wear gets there within 4 cycles: " + result.too_short)
    if any(key[3] == 0 for key, _ in cells):
        said.append(f"In columns '{HEALTHY}': how often an axis was named though none is worn.")
    said += [
        visible(f"{place}: axes {axes} never turn within the speed window; left out.")
        for place, axes in result.unobservable.items()
        if axes
    ]
    said += [f"{place}: {reason}" for place, reason in result.left_out.items()]
    said += other_effects(t.effect for t in result.outcomes)
    return "\n\n".join(said)


def thesis_value(task: str, level: float, method: str) -> float:
    """Return the value of thesis table 6.2; cross-correlation has one for both of its readings.

    Args:
        task: Name of the task.
        level: Severity as a fraction.
        method: A method of `THEIRS`.

    Returns:
        Axes named correctly [%].
    """
    return THESIS[task, level][min(THEIRS.index(method), 2)]


def _cell(one: Outcomes) -> str:
    if one.level == 0:
        most = max(one.answers, key=lambda axis: one.answers[axis])
        often = f", mostly axis {most}" if most else ""
        return f"named {100 * one.named / one.total:.0f} %{often}"
    low, high = one.interval
    return f"{100 * one.accuracy:.0f} [{100 * low:.0f}, {100 * high:.0f}]"


def to_dict(result: Isolation) -> dict[str, Any]:
    """The result for JSON."""
    rows = []
    for one in result.outcomes:
        low, high = one.interval
        known = one.robot == "irb6700" and (one.task, one.level) in THESIS
        known &= one.method in THEIRS
        figure = thesis_value(one.task, one.level, one.method) / 100 if known else None
        rows.append(
            asdict(one) | {"accuracy": one.accuracy, "low": low, "high": high, "thesis": figure}
        )
    return {
        "sensors": result.sensors,
        "seeds": result.seeds,
        "redrawn": result.redrawn,
        "results": rows,
        "unobservable": result.unobservable,
        "too_short": result.too_short,
        "left_out": result.left_out,
        "made_by": result.made_by,
        "split": result.split,
    }


def save(result: Isolation, folder: Path) -> None:
    """Write the result to ``isolation.json`` in a dataset's folder.

    Args:
        result: The result.
        folder: Folder of the dataset.
    """
    write_text(folder / "isolation.json", json.dumps(to_dict(result), indent=1) + "\n")

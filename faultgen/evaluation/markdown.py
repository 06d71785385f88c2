"""Markdown tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from tabulate import tabulate

from faultgen.system.terminal import visible


def table(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """Return a Markdown table whose columns are aligned, so that it is legible in a terminal too.

    Args:
        head: Names of the columns.
        rows: Cells of each row, which are shown as str shows them.

    Returns:
        The table.
    """
    shown = [[visible(cell) for cell in row] for row in rows]
    return tabulate(shown, list(map(visible, head)), tablefmt="github", disable_numparse=True)


def goals_table(goals: Sequence[dict[str, Any]]) -> str:
    """Return the goals of a study, with the thesis' values and the measured ones, as a table."""
    return table(
        ["", "thesis", "goal", "measured", "reached"],
        [
            [g["name"], g["thesis"], g["goal"], g["measured"], "yes" if g["reached"] else "no"]
            for g in goals
        ],
    )


def goals_answer(goals: Sequence[dict[str, Any]]) -> str:
    """One sentence: how many goals of a study are reached."""
    reached = sum(bool(goal["reached"]) for goal in goals)
    return f"In short: this run reaches {reached} of the {len(goals)} goals in the first table."


def percent(row: dict[str, Any]) -> str:
    """Return a share with its interval, in percent."""
    return f"{100 * row['share']:.1f} [{100 * row['low']:.1f}, {100 * row['high']:.1f}]"


def stars(p: float) -> str:
    """Return the marks of significance: one each for p below 0.05, 0.01, 0.001 and 0.0001."""
    return "*" * sum(p < limit for limit in (0.05, 0.01, 0.001, 0.0001))

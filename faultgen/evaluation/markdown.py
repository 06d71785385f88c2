"""Markdown tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any


def table(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """A table; cells are shown by str."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(str(cell) for cell in line) + " |" for line in lines)


def goals_table(goals: Sequence[dict[str, Any]]) -> str:
    """Goals of a study beside the thesis and what was measured."""
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
    """A share with its interval, in percent."""
    return f"{100 * row['share']:.1f} [{100 * row['low']:.1f}, {100 * row['high']:.1f}]"


def stars(p: float) -> str:
    """Marks of significance: one each for p below 0.05, 0.01, 0.001 and 0.0001."""
    return "*" * sum(p < limit for limit in (0.05, 0.01, 0.001, 0.0001))

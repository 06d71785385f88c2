"""The ranking of methods by the standard comparison, and the page that shows it."""

from __future__ import annotations

from typing import Any

import numpy as np

from faultgen.evaluation.markdown import percent, table
from faultgen.evaluation.outcomes import shown_level
from faultgen.evaluation.shares import share

LEVELS = (0.05, 0.10, 0.15)
"""Severities at which methods are asked about effects in fractions of nominal. About other effects
they are asked at the end of the run."""


def leaders(result: dict[str, Any], what: str) -> list[dict[str, Any]]:
    """Rank methods by the mean of their scores.

    The score of a method on one kind of data is the mean of two shares: of right answers about worn
    robots, and of right answers about healthy ones. A method that always names an axis, or raises
    an alarm, therefore has at most 0.5.

    Args:
        result: Result of `run_benchmark`.
        what: "isolation" or "detection".

    Returns:
        One row for each method, the best first: its name, score, and shares with 95 % Wilson
        intervals for each kind of data, or None where it was left out.
    """
    kinds = list(dict.fromkeys(one["kind"] for one in result["sets"]))
    counts: dict[str, dict[str, list[int]]] = {}
    for one in result["sets"]:
        for row in one[what]:
            state = "worn" if row["level"] else "healthy"
            cell = counts.setdefault(row["method"], {}).setdefault(f"{one['kind']} {state}", [0, 0])
            cell[0] += row["right"]
            cell[1] += row["total"]
    rows = []
    for method, cells in counts.items():
        shares = {
            f"{kind} {state}": share(*cells[f"{kind} {state}"])
            if f"{kind} {state}" in cells
            else None
            for kind in kinds
            for state in ("worn", "healthy")
        }
        # what a method cannot answer counts as wrong
        told = [one["share"] if one else 0.0 for one in shares.values()]
        rows.append({"method": method, "score": float(np.mean(told)), **shares})
    return sorted(rows, key=lambda row: (-row["score"], row["method"]))


def benchmark_board(result: dict[str, Any], what: str) -> str:
    """Return the leader board as a Markdown table.

    Args:
        result: Result of `run_benchmark`.
        what: "isolation" or "detection".
    """
    rows = result["leaders"][what]
    columns = [name for name in rows[0] if name not in ("method", "score")]
    body = [
        [
            number,
            row["method"],
            f"{100 * row['score']:.1f}",
            *(percent(row[name]) if row[name] else "left out" for name in columns),
        ]
        for number, row in enumerate(rows, start=1)
    ]
    return table(["", "method", "score", *columns], body)


def _details(one: dict[str, Any]) -> str:
    """Right answers on one dataset by robot, task, effect and severity."""
    cells: dict[tuple[Any, ...], tuple[int, int]] = {}
    for row in one["isolation"]:
        key = (row["robot"], row["task"], row["effect"], row["level"])
        cells[*key, row["method"]] = (row["right"], row["total"])
    names = list(dict.fromkeys(key[-1] for key in cells))
    lines = sorted({key[:4] for key in cells}, key=lambda k: (k[0], k[1], k[3] == 0, k[2], k[3]))
    body = [
        [
            *key[:3],
            shown_level(key[2], key[3]),
            max(cells[*key, name][1] for name in names if (*key, name) in cells),
            *(
                f"{100 * cells[*key, name][0] / cells[*key, name][1]:.0f}"
                if (*key, name) in cells
                else "-"
                for name in names
            ),
        ]
        for key in lines
    ]
    return table(["robot", "task", "effect", "severity", "answers", *names], body)


def benchmark_page(result: dict[str, Any]) -> str:
    """Write the page that shows the leader board.

    Args:
        result: Result of `run_benchmark`.

    Returns:
        The page as Markdown.
    """
    command = "faultgen benchmark" + (" --quick" if result["quick"] else "") + " -o DIR"
    boards = result["leaders"]
    best = boards["isolation"][0]
    levels = ", ".join(f"{100 * level:g} %" for level in LEVELS)
    lines = [
        "# Benchmark",
        "**Which method names the worn axis best, and how do you enter one of your own?** "
        f"Of the isolators below, '{best['method']}' has the highest score: "
        f"{100 * best['score']:.1f} of 100.",
        f"This page was written by `{command}`. "
        + (
            "It shows the quick version with little data, whose intervals are wide. The full "
            "version, without `--quick`, has all axes, more effects and more robots. "
            if result["quick"]
            else ""
        )
        + "The data come from fixed experiments and seeds, and their divisions into training and "
        "test runs are stored with them, so everybody with the same version of faultgen measures "
        "on the same runs.",
        "To enter a method, write one class ([how](extending.md)) and run "
        f"`{command} --method ./my_file.py:MyClass`. It then appears in every table of `DIR/"
        "benchmark.md`.",
        "## Leader board: which axis is worn?",
        "Right answers in percent, with 95 % Wilson intervals. A worn robot is judged at a "
        f"severity of {levels}, or in the last cycle if the effect has a unit. The answer is right "
        "if it names the worn axis. Severities that a run reaches in fewer than 5 cycles do not "
        "count. An answer about a healthy robot is right if it names no axis. The score is the "
        "mean of the columns. "
        "What a method could not answer counts as wrong.",
        benchmark_board(result, "isolation"),
        "## Leader board: is anything worn?",
        "Right answers of the detectors in the same form: an alarm up to that severity, and no "
        "alarm in any cycle of a healthy run.",
        benchmark_board(result, "detection"),
        "## The data",
        "The standard data have two robots and three tasks, with friction wear of one axis and "
        "`realistic` noise. Each robot behaves exactly like its model, and methods are tested on "
        "other runs of the same robots. In the harder data, robots of one model differ: Coulomb "
        "friction by 15 %, viscous friction by 20 % and rotor inertia by 3 % (standard "
        "deviations; assumed). Several effects occur, and methods that learn from labels are "
        "tested on other robots. In both, temperature and payload drift.",
        table(
            ["dataset", "division", "runs", "test runs", "cycles", "runs (SHA-256 of their ids)"],
            [
                [s["name"], s["split"], s["runs"], s["tested"], s["cycles"], s["runs_sha256"]]
                for s in result["sets"]
            ],
        ),
    ]
    for one in result["sets"]:
        lines += [f"## Isolators on `{one['name']}`", "Right answers in percent.", _details(one)]
        for kind, reasons in one["left_out"].items():
            lines += [f"{kind}, {place}: {reason}" for place, reason in reasons.items()]
    lines += [
        "## What falls short",
        "- The answers at several severities of one run are not independent, and neither are runs "
        "of one robot. The intervals are therefore too narrow.\n"
        "- The isolators that use directions of wear get them from the true parameters of each "
        "robot, also in the harder data. They look only for friction wear.\n"
        "- The training and test parts hold the same effects. No method is tested on an effect "
        "that it has never seen.",
        f"Made by {result['sets'][0]['made_by'][0]}; seed {result['seed']}.",
    ]
    return "\n\n".join(lines) + "\n"

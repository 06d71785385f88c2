"""The ranking of methods by the standard comparison, and the page that shows it."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from faultgen.evaluation.baselines import ISOLATION_BASELINES
from faultgen.evaluation.markdown import percent, table
from faultgen.evaluation.outcomes import shown_level
from faultgen.evaluation.shares import share

LEVELS = (0.05, 0.10, 0.15)
"""Severities at which methods are asked about effects in fractions of nominal. About other effects
they are asked at the end of the run."""

_HEALTHY = "healthy"
_BASELINES = {one.name for one in ISOLATION_BASELINES}

_Class = tuple[str, str]
"""Kind of data, and the worn axis or `_HEALTHY`."""


def leaders(result: dict[str, Any], what: str) -> list[dict[str, Any]]:
    """Rank methods by the mean of their scores on all kinds of data.

    The score on one kind of data is R - F / n. R is the share of right answers about worn robots:
    the mean of the shares of the n axes that wear. F is the share of healthy robots of which an
    axis is named. The score is 1 for a method that is always right. It is 0 for answers that do not
    depend on the data, such as "none", always the same of the n axes, or one of them at random;
    worse answers are negative. For detectors, n is 1 and R the share of worn robots with an alarm.

    Where a method was left out, it counts as if it had answered "none", or raised no alarm.

    Source: this is the balanced accuracy of the n + 1 classes, rescaled so that chance is 0, as
    `balanced_accuracy_score(adjusted=True)` of scikit-learn; for n = 1 it is the J of Youden
    (1950), Index for rating diagnostic tests, also called informedness.

    Args:
        result: Result of `run_benchmark`.
        what: "isolation" or "detection".

    Returns:
        One row for each method, the best first: its name, score, and shares of right answers with
        95 % Wilson intervals for each kind of data, or None where it was left out.
    """
    kinds = list(dict.fromkeys(one["kind"] for one in result["sets"]))
    asked: Counter[_Class] = Counter()
    answers: dict[str, dict[_Class, tuple[int, int]]] = {}
    for one in result["sets"]:
        questions: dict[tuple[tuple[Any, ...], _Class], int] = {}
        for row in one[what]:
            mine = answers.setdefault(row["method"], {})
            for state, (right, total) in _by_class(row).items():
                cell = (one["kind"], state)
                place = (tuple(row[k] for k in ("robot", "task", "effect", "level")), cell)
                questions[place] = max(questions.get(place, 0), total)
                before = mine.get(cell, (0, 0))
                mine[cell] = (before[0] + right, before[1] + total)
        for (_, cell), total in questions.items():
            asked[cell] += total
    rows = []
    for method, mine in answers.items():
        shares: dict[str, Any] = {}
        scores = []
        for kind in kinds:
            worn = [cell for cell in asked if cell[0] == kind and cell[1] != _HEALTHY]
            found = [mine.get(cell, (0, 0))[0] for cell in worn]
            recall = np.mean([n / asked[cell] for n, cell in zip(found, worn, strict=True)])
            healthy = (kind, _HEALTHY)
            none, answered = mine.get(healthy, (0, 0))
            false_alarms = (answered - none) / asked[healthy]
            scores.append(float(recall - false_alarms / len(worn)))
            told = any(cell in mine for cell in worn)
            shares[f"{kind} worn"] = (
                share(sum(found), sum(asked[c] for c in worn)) if told else None
            )
            silent = asked[healthy] - answered
            shares[f"{kind} healthy"] = share(none + silent, asked[healthy]) if answered else None
        rows.append({"method": method, "score": float(np.mean(scores)), **shares})
    return sorted(rows, key=lambda row: (-row["score"], row["method"]))


def _by_class(row: dict[str, Any]) -> dict[str, tuple[int, int]]:
    """Right answers and all answers of a row: about healthy robots, or by worn axis."""
    if not row["level"]:
        return {_HEALTHY: (row["right"], row["total"])}
    if "total_by_axis" not in row:  # an alarm names no axis
        return {"worn": (row["right"], row["total"])}
    return {
        axis: (row["right_by_axis"][axis], total) for axis, total in row["total_by_axis"].items()
    }


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
    names = [name for name in dict.fromkeys(key[-1] for key in cells) if name not in _BASELINES]
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
    learned = sorted({n for one in result["sets"] for n in one["healthy_cycles"].values()})
    learned_from = " to ".join(map(str, dict.fromkeys([learned[0], learned[-1]])))
    lines = [
        "# Benchmark",
        "**Which method names the worn axis best, and how do you enter one of your own?** "
        f"Of the isolators below, '{best['method']}' has the highest score: "
        f"{100 * best['score']:.1f}. The score of a perfect method is 100, and that of answers "
        "which do not depend on the data is 0.",
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
        "count. An answer about a healthy robot is right if it names no axis. Methods learn from "
        f"{learned_from} healthy cycles of the same robot in the same task, which is few: the page "
        "on [isolation](isolation.md) shows what they do after 2000.",
        "The **score** on one kind of data is R − F / n. R is the share of right answers about "
        "worn robots, and F the share of healthy robots of which an axis is named: 100 % minus the "
        "column *healthy*. n is the number of axes that wear in these data; each of them has the "
        "same weight in R. The score of the board is the mean over both kinds of data. It is 0 for "
        'answers that do not depend on the data: always "none" (R = 0, F = 0), always the same of '
        "the n axes (R = 1 / n, F = 1), or one of them at random. Rows with *always* or *never* "
        "are such answers. A negative score is worse than guessing. A method that is left out "
        'counts as if it had answered "none". This score is the balanced accuracy, rescaled so '
        "that chance is 0, as in scikit-learn's `balanced_accuracy_score(adjusted=True)`.",
        benchmark_board(result, "isolation"),
        "## Leader board: is anything worn?",
        "Right answers of the detectors in the same form: an alarm up to that severity, and no "
        "alarm in any cycle of a healthy run. The score is that above with n = 1, that is, "
        "Youden's J: the share of worn robots with an alarm minus that of healthy ones.",
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

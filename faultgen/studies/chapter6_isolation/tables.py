"""Tables of the study `isolation`, with the thesis' values for comparison."""

from __future__ import annotations

from typing import Any

import numpy as np

from faultgen.evaluation.isolate import LEVELS
from faultgen.evaluation.isolators import (
    FRICTION,
    ISOLATORS,
    AllTorques,
    FrictionResidual,
    OwnTorque,
)
from faultgen.evaluation.markdown import goals_answer, goals_table, percent, table
from faultgen.evaluation.outcomes import THEIRS, THESIS, thesis_value
from faultgen.evaluation.shares import share
from faultgen.studies.chapter6_isolation.series import NOISES

Rows = list[dict[str, Any]]

_SHOWN_AS = {"irb6700": "IRB 6700", "puma560": "PUMA 560"}

_DESCRIBED = (*THEIRS, *(one.name for one in (OwnTorque, AllTorques, FrictionResidual)))

# Thesis table 6.1: task, worn axis, then mean and standard deviation of axis 1 to 6 [N m]
_THESIS_6_1 = """
pick_and_place 0 18.42 6.85 7.45 4.29 15.20 2.39 1.95 2.00 2.53 0.97 1.90 1.05
pick_and_place 1 18.66 6.38 7.45 4.29 15.20 2.39 1.95 2.00 2.54 0.97 2.12 1.05
pick_and_place 2 18.64 6.38 7.72 4.40 15.18 2.36 1.95 2.00 2.54 0.97 2.12 1.05
pick_and_place 3 18.62 6.36 7.79 4.39 15.59 2.50 1.96 2.01 2.54 0.97 2.12 1.06
pick_and_place 4 18.63 6.37 7.78 4.38 15.67 2.51 1.89 2.01 2.54 0.97 2.12 1.06
pick_and_place 5 18.42 6.85 7.45 4.29 15.20 2.39 1.95 1.99 2.65 0.96 2.11 1.04
pick_and_place 6 18.42 6.85 7.45 4.29 15.20 2.40 1.95 1.99 2.67 0.96 2.02 1.05
spot_weld 0 3.22 5.10 7.67 7.72 10.61 7.12 1.14 1.34 1.45 1.34 1.07 1.04
spot_weld 1 3.36 5.20 7.67 7.72 10.61 7.12 1.14 1.34 1.45 1.34 1.07 1.04
arc_weld 0 6.23 2.29 10.30 4.16 13.99 5.60 1.93 1.72 2.45 1.01 2.27 0.68
arc_weld 1 6.68 2.34 10.30 4.16 13.99 5.60 1.93 1.72 2.45 1.01 2.27 0.68
"""


def _thesis_6_1() -> dict[tuple[str, int], list[tuple[float, float]]]:
    """(task, worn axis) to mean and standard deviation of each axis."""
    rows = {}
    for line in _THESIS_6_1.split("\n")[1:-1]:
        task, worn, *numbers = line.split()
        values = [float(x) for x in numbers]
        rows[task, int(worn)] = list(zip(values[::2], values[1::2], strict=True))
    return rows


def pooled(rows: Rows, **where: Any) -> dict[str, Any]:
    """Add the counts of all rows with given values, as one share with its interval.

    Args:
        rows: Rows with the counts "right" and "total".
        where: Values that a row must have, by name.

    Returns:
        The share, as in `share`.
    """
    chosen = [row for row in rows if all(row[name] == value for name, value in where.items())]
    return share(sum(row["right"] for row in chosen), sum(row["total"] for row in chosen))


def goals(result: dict[str, Any]) -> Rows:
    """The goals of the study and what was measured.

    Returns:
        Rows with name, thesis, goal, measured and reached.
    """
    isolation, best = result["isolation"], {"noise": "realistic", "method": FRICTION}
    te = {"noise": "thesis", "method": "TE 10 bins", "level": 0.10}
    robots = list(dict.fromkeys(row["robot"] for row in isolation))
    te_of = [pooled(isolation, **te, robot=robot) for robot in robots]
    five, one = (pooled(isolation, **best, level=level) for level in (0.05, 0.01))
    healthy = pooled(result["healthy"], **best)
    answers = [row["at_any_level"] for row in _where(result["healthy"], **best)]
    all_answers = pooled(answers)
    pairs = pooled(result["pairs"], **best)
    severity = _where(result["severity"], **best, level=0.10)
    errors = [np.inf if row["rms_error"] is None else row["rms_error"] for row in severity]
    rms, worst = float(np.sqrt(np.mean(np.square(errors)))), max(errors)
    return [
        {
            "name": "axis isolated, TE 10 bins, 10 % wear, `thesis` noise, "
            + " / ".join(_SHOWN_AS.get(robot, robot) for robot in robots),
            "thesis": "100 %",
            "goal": "reproduce, or show why not",
            "measured": f"{' / '.join(percent(one) for one in te_of)} %",
            "reached": all(one["share"] == 1 for one in te_of),
        },
        {
            "name": "axis isolated at 5 % wear",
            "thesis": "83-100 %",
            "goal": ">= 99 %",
            "measured": f"{percent(five)} %",
            "reached": bool(five["share"] >= 0.99),
        },
        {
            "name": "axis isolated at 1 % wear",
            "thesis": "50-100 %",
            "goal": ">= 95 %",
            "measured": f"{percent(one)} %",
            "reached": bool(one["share"] >= 0.95),
        },
        {
            "name": "healthy robot called worn, after 100 cycles / any of 5 answers within them",
            "thesis": "always",
            "goal": "<= 1 %",
            "measured": f"{percent(healthy)} / {percent(all_answers)} %",
            "reached": bool(max(healthy["share"], all_answers["share"]) <= 0.01),
        },
        {
            "name": "severity, RMS error at 10 % wear, all / worst robot and task",
            "thesis": "none",
            "goal": "<= 1 percentage point",
            "measured": f"{100 * rms:.2f} / {100 * worst:.2f} percentage points",
            "reached": bool(worst <= 0.01),
        },
        {
            "name": "two worn axes at 10 %: these two named, and no other",
            "thesis": "none",
            "goal": ">= 95 %",
            "measured": f"{percent(pairs)} %",
            "reached": bool(pairs["share"] >= 0.95),
        },
    ]


def tables(result: dict[str, Any]) -> str:
    """All tables in Markdown."""
    isolation = result["isolation"]
    methods = _methods(isolation)
    controlled = _methods(result["controls"])
    others = _others(methods)
    which = "next" if others else "last"
    parts = [
        f"# Study isolation, seed {result['seed']}, {result['seeds']} seeds",
        "This page answers the question: is the worn axis named, and its severity estimated? "
        f"{goals_answer(goals(result))}",
        "Shares are in percent, with 95 % Wilson intervals in brackets. The noise levels are a "
        "tenth of the thesis' torque noise, the thesis' noise, and `realistic`. Unless a table "
        "states otherwise, the wear grows to 20 % after 100 cycles, as in thesis eq. 6.6.",
        "TE names the axis with the largest net transfer entropy, in quantile bins. CC names the "
        "axis with negative lags of the cross-correlation, as the thesis words its rule. 'CC, "
        f"eq. 3.5' uses the sign of the lags in that equation. The {which} three methods are ours. "
        "'Own torque' uses the mean torque of each axis alone, 'all torques' those of all axes and "
        "the temperature, and 'friction residual' the friction terms in the torque of all axes and "
        f"the temperature.{others}",
        f"## Goals (`realistic` noise, method '{FRICTION}', unless said otherwise)",
        goals_table(goals(result)),
        "## Axis isolated, all robots, tasks and axes",
        table(
            ["noise", "wear %", *methods],
            [
                [
                    noise,
                    f"{100 * level:g}",
                    *(
                        percent(pooled(isolation, noise=noise, level=level, method=method))
                        for method in methods
                    ),
                ]
                for noise in NOISES
                for level in LEVELS
            ],
        ),
        "## Healthy robot called worn, after 100 cycles",
        table(
            ["noise", *methods],
            [
                [
                    noise,
                    *(percent(pooled(result["healthy"], noise=noise, method=m)) for m in methods),
                ]
                for noise in NOISES
            ],
        ),
        "## Table 6.2 beside the thesis (percent right; IRB 6700: ours / thesis)",
        *(_table_6_2(isolation, noise) for noise in ("thesis", "realistic")),
        "## Severity of the worn axis",
        "The root-mean-square (RMS) error and the bias are in percentage points. The last column "
        "is the share of 95 % intervals that contain the true severity.",
        _severity_table(result["severity"]),
        "## Two axes worn by 10 %",
        table(
            ["robot", "task", "method", "these two and no other", "these two among others"],
            [
                [r["robot"], r["task"], r["method"], percent(r), f"{100 * r['both_among']:.0f}"]
                for r in result["pairs"]
            ],
        ),
        "## Smallest wear that can be found",
        "The smallest wear in percent, for axes 1 to 6, that is expected to be found in 95 of 100 "
        "cases. It is computed from healthy cycles alone, for means over the last 12 cycles.",
        table(
            ["robot", "task", "noise", "method", "smallest wear"],
            [
                [r["robot"], r["task"], r["noise"], r["method"], _smallest(r["smallest"])]
                for r in result["observable"]
            ],
        ),
        "## Table 6.1: torque of each axis",
        "Mean ± standard deviation of |torque| in [N m] at motor speeds of 50 to 120 rad/s, in "
        "cycle 100 with 20 % wear and without noise. The thesis' row is below ours.",
        _table_6_1(result["table_6_1"]),
        "## Number of bins of transfer entropy",
        "Right axis named in percent, with a fixed number of bins (5, 10, 20), with the number "
        "that a rule chooses on healthy series, and with the number that is best in hindsight. The "
        "column 'which' lists the numbers that the rule chooses. The column 'cycles' gives the "
        "number of cycles in which the wear grows to this level.",
        _bins_table(result["bins"]),
        "## Controls: what is left when causes or order are removed",
        "Worn axis named at 10 % wear, in percent. A method that detects causes must fail on "
        "every control but the first, 'as measured'.",
        table(
            ["noise", "control", *controlled],
            [
                [
                    noise,
                    control,
                    *(
                        percent(
                            pooled(result["controls"], noise=noise, control=control, method=method)
                        )
                        for method in controlled
                    ),
                ]
                for noise in NOISES
                for control in dict.fromkeys(row["control"] for row in result["controls"])
            ],
        ),
    ]
    return "\n\n".join(parts) + "\n"


def _methods(rows: Rows) -> list[str]:
    """Names of the methods that have rows, in their order."""
    return list(dict.fromkeys(row["method"] for row in rows))


def _others(methods: list[str]) -> str:
    """Sentences on methods that the text does not describe."""
    others = [ISOLATORS[name] for name in methods if name in ISOLATORS and name not in _DESCRIBED]
    return "".join(f" '{one.name}': {one.idea}." for one in others)


def _where(rows: Rows, **where: Any) -> Rows:
    return [row for row in rows if all(row[name] == value for name, value in where.items())]


def _table_6_2(isolation: Rows, noise: str) -> str:
    lines = []
    methods = _methods(isolation)
    places = dict.fromkeys((row["robot"], row["task"]) for row in isolation)
    for robot, task in places:
        for level in LEVELS:
            here = _where(isolation, robot=robot, task=task, level=level, noise=noise)
            by_method = {row["method"]: row for row in here}
            cells = []
            for method in methods:
                cell = f"{100 * by_method[method]['share']:.0f}"
                if robot == "irb6700" and method in THEIRS and (task, level) in THESIS:
                    cell += f" / {thesis_value(task, level, method):g}"
                cells.append(cell)
            by_axis = " ".join(f"{100 * x:.0f}" for x in by_method["TE 10 bins"]["by_axis"])
            lines.append([robot, task, f"{100 * level:g}", by_axis, *cells])
    head = ["robot", "task", "wear %", "TE 10 bins by axis", *methods]
    return f"Noise: {noise}.\n\n" + table(head, lines)


def _severity_table(rows: Rows) -> str:
    lines = []
    for row in rows:
        if row["level"] not in (0.05, 0.10) or row["noise"] == "thesis / 10":
            continue
        known = row["rms_error"] is not None
        shown = (
            [f"{100 * row['rms_error']:.2f}", f"{100 * row['bias']:+.2f}", f"{row['covered']:.2f}"]
            if known
            else ["-", "-", "-"]
        )
        wear = f"{100 * row['severity']:.1f}"
        lines.append([row["robot"], row["task"], row["noise"], row["method"], wear, *shown])
    head = ["robot", "task", "noise", "method", "wear %", "RMS error", "bias", "intervals hold"]
    return table(head, lines)


def _smallest(values: list[float | None]) -> str:
    return " ".join("-" if v is None else f"{100 * v:.2g}" for v in values)


def _table_6_1(rows: Rows) -> str:
    def shown(values: Any) -> list[str]:
        return ["-" if mean is None else f"{mean:.2f} ± {sd:.2f}" for mean, sd in values]

    lines: list[list[Any]] = []
    theirs = _thesis_6_1()
    for row in _where(rows, robot="irb6700"):
        key = (row["task"], row["worn"])
        if key in theirs:
            lines.append([*key, *shown(zip(row["mean"], row["sd"], strict=True))])
            lines.append(["", "thesis", *shown(theirs[key])])
    if not lines:  # the thesis has values of this robot only
        for row in rows:
            place = f"{row['robot']}, {row['task']}"
            lines.append([place, row["worn"], *shown(zip(row["mean"], row["sd"], strict=True))])
    n_axes = max(len(line) for line in lines) - 2
    lines = [line + ["-"] * (n_axes + 2 - len(line)) for line in lines]
    return table(["task", "worn axis", *(f"axis {k + 1}" for k in range(n_axes))], lines)


def _bins_table(rows: Rows) -> str:
    lines = []
    for noise in NOISES:
        for level in LEVELS:
            here = _where(rows, noise=noise, level=level)
            fixed = [percent(pooled(here, bins=bins)) for bins in (5, 10, 20)]
            chosen = pooled(here, chosen=True)
            numbers = sorted(row["bins"] for row in here if row["chosen"])
            places = dict.fromkeys((row["robot"], row["task"]) for row in here)
            best = [
                max(_where(here, robot=robot, task=task), key=lambda row: row["right"])
                for robot, task in places
            ]
            lines.append(
                [
                    noise,
                    f"{100 * level:g}",
                    here[0]["cycles"],
                    *fixed,
                    percent(chosen),
                    " ".join(map(str, numbers)),
                    percent(pooled(best)),
                ]
            )
    head = ["noise", "wear %", "cycles", "5", "10", "20", "by the rule", "which", "best"]
    return table(head, lines)

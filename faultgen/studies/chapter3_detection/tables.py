"""Tables of the study `detection`, with the thesis' values for comparison."""

from __future__ import annotations

from typing import Any

import numpy as np

from faultgen.evaluation.markdown import goals_answer, goals_table, percent, table
from faultgen.evaluation.shares import share
from faultgen.studies.chapter3_detection.detectors import DETECTORS, LEFT_OUT, WEAR
from faultgen.studies.chapter3_detection.study import (
    IN_A_ROW,
    NOISES,
    OPERATING,
    ROBOT,
    TASKS,
    WEARS,
)

Rows = list[dict[str, Any]]

# Thesis tables 3.5 (hours to detection, 0: not detected), 3.6 [N m] and 3.7; rows are axis 1 to 6,
# columns tasks 1 to 3 with 10 % wear, then with 20 %
_THESIS_3_5 = """
60 60 0 50 50 40
0 0 0 0 0 0
100 90 0 85 78 105
0 80 0 0 60 90
0 115 0 0 95 0
0 90 95 0 90 90
"""
_THESIS_3_6 = """
28.520 29.705 29.070 29.724 29.475 28.799
81.842 64.176 71.769 82.533 64.665 71.735
26.240 9.248 25.620 26.421 9.484 25.442
2.292 1.381 2.226 2.292 1.409 2.249
2.434 3.183 2.822 2.446 3.231 2.803
0.000 0.912 0.834 0.000 0.928 0.873
"""
_THESIS_3_7 = """
0.733 0.049 0.047 0.733 0.048 0.051
0.210 0.227 0.230 0.225 0.233 0.233
0.766 0.254 0.350 0.773 0.242 0.351
0.625 0.192 0.824 0.625 0.189 0.798
0.758 0.614 0.675 0.757 0.607 0.677
0.731 0.409 0.445 0.692 0.405 0.422
"""
# Thesis table 3.3: lags [h], axis 1 worn
_THESIS_3_3 = """
0 -3 -3 -27 0 -4
3 0 0 0 -38 -2
3 0 0 0 6 0
27 0 0 0 -22 5
0 38 -6 22 0 32
4 2 0 -5 -32 0
"""


def _of_thesis(result: dict[str, Any]) -> bool:
    """Whether the robot and tasks are those of the thesis, so that its values can be compared."""
    return result["robot"] == ROBOT and tuple(result["turning"]) == TASKS


def _columns(result: dict[str, Any]) -> list[tuple[float, str]]:
    """Wear and task of each column."""
    return [(wear, task) for wear in WEARS for task in result["turning"]]


def _axes(result: dict[str, Any]) -> range:
    """Numbers of the axes."""
    return range(1, len(next(iter(result["turning"].values()))) + 1)


def _numbers(text: str) -> np.ndarray:
    return np.array([[float(x) for x in line.split()] for line in text.strip().split("\n")])


def goals(result: dict[str, Any]) -> Rows:
    """The goal of the study and what was measured."""
    rows = []
    for noise in reversed(NOISES):
        best = _detector(result, noise, WEAR, OPERATING)
        cells = [c for c in best["cells"] if result["turning"][c["task"]][c["axis"] - 1]]
        every = share(sum(c["located"] for c in cells), sum(c["seeds"] for c in cells))
        whole = sum(c["located"] == c["seeds"] for c in cells)
        usually = sum(c["located"] > c["seeds"] / 2 for c in cells)
        rate = best["false_alarms_a_month"]
        rows.append(
            {
                "name": f"chapter 3, `{noise}` noise: wear detected and located within 120 h; "
                "conditions in which most seeds are / all are; false alarms",
                "thesis": "8 of 18 (10 %), 11 of 18 (20 %)",
                "goal": f"all {len(best['cells'])}, <= 1 a month",
                "measured": f"{percent(every)} % of runs; {usually} / {whole} of {len(cells)} "
                f"observable conditions; {rate:.2f} a month",
                "reached": bool(whole == len(best["cells"]) and rate <= 1),
            }
        )
    return rows


def tables(result: dict[str, Any]) -> str:
    """All tables in Markdown."""
    still = [
        f"axis {axis + 1} in {task}"
        for task, turning in result["turning"].items()
        for axis, turns in enumerate(turning)
        if not turns
    ]
    robot = "a PUMA 560" if result["robot"] == ROBOT else result["robot"]
    tasks = "T1 to T3 are the three tasks."
    if not _of_thesis(result):
        tasks = " ".join(
            f"T{k + 1} is the task {name}." for k, name in enumerate(result["turning"])
        )
    parts = [
        f"# Study detection, seed {result['seed']}, {result['seeds']} seeds",
        "This page answers the question: how many hours after its start is wear detected, and is "
        f"the right axis named? {goals_answer(goals(result))}",
        f"The robot is {robot}. It works for 120 healthy hours, then for 120 hours in which one "
        f"axis wears as in thesis eq. 3.7. Hours count from the start of wear. {tasks} Numbers in "
        "square brackets are 95 % confidence intervals.",
        "Wear cannot be observed if the axis turns at none of the six places of the cycle at which "
        f"its torque is sampled. This concerns: {', '.join(still) or 'none'}. The tables by axis "
        "show such runs; no total includes them.",
        "## Goals",
        goals_table(goals(result)),
        "## Table 3.5: the thesis' procedure",
        "The thesis' procedure computes the Kullback-Leibler (KL) divergence between the torque "
        "histogram of each hour and the healthy one. It fits a principal component analysis (PCA) "
        "to the divergences. Q is the squared distance of an hour from the space of the "
        "components. Wear is detected if Q is above its 95 % limit in "
        f"{IN_A_ROW} consecutive hours; this rule is assumed. The axis is then located by the lags "
        "of the cross-correlations.",
        "Each cell gives three numbers of runs, of "
        f"{result['seeds']}: detected / also located with negative lags, as the thesis words the "
        "rule / also located with the sign of the lags in eq. 3.5. The median hours to detection "
        "follow in brackets. After the semicolon comes the thesis' result: ✓ with its hours, or × "
        "if it did not detect the wear.",
        *(_table_3_5(result, noise) for noise in NOISES),
        "The same procedure applied to healthy months:",
        table(
            ["task", "noise", "hours above the limit %", "alarms a month"],
            [
                [
                    r["task"],
                    r["noise"],
                    f"{100 * r['hours_over']:.1f}",
                    f"{r['alarms_a_month']:.2f}",
                ]
                for r in result["thesis_false_alarms"]
            ],
        ),
        f"## The same data, best detector ('{WEAR}'), {OPERATING:g} false alarms a month",
        f"Each cell gives the runs, of {result['seeds']}, in which wear is detected / also "
        "located, and the median hours to detection in brackets.",
        *(_best_table(result, noise) for noise in NOISES),
        "## Detectors at equal false alarms (observable conditions, both wears)",
        "The thresholds are set on healthy months for the given number of false alarms a month. "
        "The column 'measured' gives the number on other healthy months.",
        _detector_table(result),
        "Detectors:\n\n" + "\n".join(f"- {one.name}: {one.idea}" for one in DETECTORS.values()),
        *(f"'{name}' is left out: an hour has no {lacking}" for name, lacking in LEFT_OUT.items()),
        "## Table 3.3: lags between the axes",
        "Lags in hours for axis 1 worn by 10 % in task 1, at the thesis' noise (ours / thesis).",
        _lags_table(result),
        "## Table 3.6: largest torque of the worn axis",
        "Largest |joint torque| in [N m] in the hour of detection, or in the last hour if nothing "
        "is detected (ours, mean over seeds at the thesis' noise / thesis).",
        _torque_table(result, "largest_torque", _THESIS_3_6),
        "## Table 3.7: variation of the torque of the worn axis",
        "Coefficient of variation (standard deviation over mean) of |torque| in the same hour "
        "(ours / thesis).",
        _torque_table(result, "variation", _THESIS_3_7),
    ]
    return "\n\n".join(parts) + "\n"


def _detector(result: dict[str, Any], noise: str, name: str, rate: float) -> dict[str, Any]:
    return next(
        row
        for row in result["detectors"]
        if (row["noise"], row["detector"], row["rate"]) == (noise, name, rate)
    )


def _head(result: dict[str, Any], first: str) -> list[str]:
    number = {task: k + 1 for k, task in enumerate(result["turning"])}
    return [first, *(f"{100 * wear:g} %, T{number[task]}" for wear, task in _columns(result))]


def _runs(result: dict[str, Any], noise: str, axis: int, wear: float, task: str) -> Rows:
    return [
        row
        for row in result["thesis_procedure"]
        if (row["noise"], row["axis"], row["wear"], row["task"]) == (noise, axis, wear, task)
    ]


def _table_3_5(result: dict[str, Any], noise: str) -> str:
    theirs = _numbers(_THESIS_3_5)
    lines = []
    for axis in _axes(result):
        cells = []
        for column, (wear, task) in enumerate(_columns(result)):
            found = [r for r in _runs(result, noise, axis, wear, task) if r["hours"] is not None]
            hours = f" ({np.median([r['hours'] for r in found]):.0f})" if found else ""
            located = sum(r["located"] for r in found)
            by_letter = sum(r["located_by_letter"] for r in found)
            cell = f"{len(found)}/{located}/{by_letter}{hours}"
            if _of_thesis(result):
                thesis = theirs[axis - 1, column]
                cell += f"; ✓({thesis:.0f})" if thesis else "; ×"
            cells.append(cell)
        lines.append([axis, *cells])
    return f"Noise: {noise}.\n\n" + table(_head(result, "axis"), lines)


def _best_table(result: dict[str, Any], noise: str) -> str:
    cells = _detector(result, noise, WEAR, OPERATING)["cells"]
    by_key = {(c["axis"], c["wear"], c["task"]): c for c in cells}
    lines = []
    for axis in _axes(result):
        line: list[Any] = [axis]
        for wear, task in _columns(result):
            cell = by_key[axis, wear, task]
            if not result["turning"][task][axis - 1]:
                line.append("not observable")
                continue
            hours = f" ({cell['median_hours']:.0f})" if cell["median_hours"] else ""
            line.append(f"{cell['detected']}/{cell['located']}{hours}")
        lines.append(line)
    return f"Noise: {noise}.\n\n" + table(_head(result, "axis"), lines)


def _detector_table(result: dict[str, Any]) -> str:
    lines = []
    for row in result["detectors"]:
        hours = "-" if row["median_hours"] is None else f"{row['median_hours']:.0f}"
        lines.append(
            [
                row["noise"],
                row["detector"],
                f"{row['rate']:g}",
                f"{row['false_alarms_a_month']:.2f}",
                percent(row["detected"]),
                "-" if row["located"] is None else percent(row["located"]),
                hours,
            ]
        )
    head = ["noise", "detector", "alarms a month, set", "measured", "alarm %", "right axis %"]
    return table([*head, "median hours"], lines)


def _lags_table(result: dict[str, Any]) -> str:
    theirs = _numbers(_THESIS_3_3) if _of_thesis(result) else None
    lines = [
        [axis + 1, *(_beside(f"{own}", theirs, (axis, k), 0) for k, own in enumerate(row))]
        for axis, row in enumerate(result["example"]["lags"])
    ]
    return table(["axis", *(str(axis) for axis in _axes(result))], lines)


def _torque_table(result: dict[str, Any], name: str, thesis: str) -> str:
    theirs = _numbers(thesis) if _of_thesis(result) else None
    lines = []
    for axis in _axes(result):
        own = [
            np.mean([r[name] for r in _runs(result, "thesis", axis, wear, task)])
            for wear, task in _columns(result)
        ]
        cells = [
            _beside(f"{value:.2f}", theirs, (axis - 1, column), 2)
            for column, value in enumerate(own)
        ]
        lines.append([axis, *cells])
    return table(_head(result, "axis"), lines)


def _beside(shown: str, theirs: np.ndarray | None, cell: tuple[int, int], digits: int) -> str:
    """Our value, and the thesis' behind a slash if it has one."""
    return shown if theirs is None else f"{shown} / {theirs[cell]:.{digits}f}"

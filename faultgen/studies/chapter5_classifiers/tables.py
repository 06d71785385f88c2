"""Tables of the study `classifiers`, with the thesis' values for comparison."""

from __future__ import annotations

from typing import Any

import numpy as np

from faultgen.analysis.classification import CLASSIFIERS
from faultgen.analysis.preprocessing import COMBINATIONS
from faultgen.analysis.statistics import SIGNIFICANT
from faultgen.evaluation.markdown import goals_answer, goals_table, table
from faultgen.studies.chapter5_classifiers.findings import FULL_CHAIN
from faultgen.studies.chapter5_classifiers.study import HORIZON
from faultgen.studies.chapter5_classifiers.thesis import (
    AUC,
    HEADLINE,
    HYPOTHESES,
    INVARIANCE,
    MEAN_P,
    MINUTES,
    PAIRS,
    VARIANCE_P,
    WINDOWS_P,
)
from faultgen.studies.classifiers_ahead import DAYS, OWN, OWN_EVENTS, UNTRAINED

Rows = list[dict[str, Any]]

_GOAL = 0.90


def goals(result: dict[str, Any]) -> Rows:
    """Goals of the study and what was measured."""
    own = {name: _cell(result, HORIZON, name, "LR")["mean"] for name in (OWN, OWN_EVENTS)}
    shown = _shown(result)
    control = [_cell(result, HORIZON, "control", name)["mean"] for name in shown]
    theirs = [AUC["control", name][0] for name in CLASSIFIERS]
    changes = {
        name: _cell(result, HORIZON, FULL_CHAIN, name)["mean"] - before
        for name, before in zip(shown, control, strict=True)
    }
    thesis = {name: AUC[FULL_CHAIN, name][0] - AUC["control", name][0] for name in shown}
    return [
        *(
            {
                "name": f"mean AUC of {name}, {HORIZON} days ahead, pairs left out",
                "thesis": f"{max(value for value, _ in AUC.values()):.2f} (its best)",
                "goal": f">= {_GOAL:.2f}",
                "measured": f"{mean:.3f}",
                "reached": bool(mean >= _GOAL),
            }
            for name, mean in own.items()
        ),
        {
            "name": "mean AUC of control, every classifier: as hard as the thesis' fleet",
            "thesis": f"{min(theirs):.2f} to {max(theirs):.2f}",
            "goal": "within",
            "measured": ", ".join(
                f"{name} {mean:.2f}" for name, mean in zip(shown, control, strict=True)
            ),
            "reached": bool(
                min(theirs) <= round(min(control), 2) and round(max(control), 2) <= max(theirs)
            ),
        },
        {
            "name": f"{FULL_CHAIN} over control: gain of mean AUC, every classifier",
            "thesis": ", ".join(f"{name} {gain:+.2f}" for name, gain in thesis.items()),
            "goal": "all above 0",
            "measured": ", ".join(f"{name} {gain:+.2f}" for name, gain in changes.items()),
            "reached": bool(min(changes.values()) > 0),
        },
    ]


def tables(result: dict[str, Any]) -> str:
    """All tables in Markdown."""
    fleet = result["fleet"]
    parts = [
        f"# Study classifiers, seed {result['seed']}",
        "This page answers the question: does preprocessing help classifiers to foresee gearbox "
        f"failures? {goals_answer(goals(result))}",
        f"The fleet of seed {fleet['seed']} has {fleet['failed']} failing and {fleet['normal']} "
        f"normal robots and {fleet['days']} days. The AUC (area under the receiver operating "
        "characteristic curve) is the chance that a row of a failing robot gets a higher score "
        "than a row of a normal one. It is measured by leaving out each failing robot with each "
        f"normal one (procedure 1). Unless a table states otherwise, it is over {DAYS} days that "
        f"end {HORIZON} days before the last day. 'a / b' means ours / thesis.",
        "LR is logistic regression, SVM a support vector machine, RF a random forest, and ES a "
        "stack: a logistic regression that combines LR and SVM. The steps of preprocessing are "
        "estimated torque and speed (estM), absolute differences from day to day (diff), windows "
        "of three days (var3) and principal components (pca). Control has no step.",
        "## Goals",
        goals_table(goals(result)),
        "## Table 5.2: mean AUC (standard deviation over pairs)",
        _table_5_2(result),
        "## Days ahead: mean AUC",
        "A row without a classifier is a single measure without training, over the same pairs. The "
        "last two rows need no method. One is the root-mean-square (RMS) torque of the last week "
        "over that of the first week. The other is the standard deviation of the daily RMS torque "
        "in the last 14 days over its mean. Both are of the worst axis.",
        _horizons(result),
        "## Procedure 2 over all combinations",
        "Levene's test first tests whether the variances are equal. If they are, an analysis of "
        "variance (ANOVA) and Tukey's test follow. If they are not, Welch's test and the test of "
        "Games and Howell follow.",
        table(
            ["classifier", "p of Levene", "test", "F", "p"],
            [
                [r["classifier"], _p(r["levene"]), r["test"], f"{r['f']:.2f}", _p(r["p"])]
                for r in result["overall"]
            ],
        ),
        "## Table A.1: execution time",
        "The time is divided by that of control (ours / thesis).",
        _table_a_1(result),
        "## Table A.2: p-values of equal variances (ours / thesis)",
        "A star marks where the step lowers the variance (p < 0.05).",
        _pair_table(result, "variance_p"),
        "## Table A.3: p-values of equal means (ours / thesis)",
        "A star marks where the step raises the mean (p < 0.05). The post hoc tests are over all "
        "combinations of table 5.2. The value is 1 if the ANOVA finds no difference at all.",
        _pair_table(result, "mean_p"),
        "## Hypotheses",
        "The table counts the pairs of combinations of table A.3 whose mean rises or falls, and "
        "whose variance falls, each with p < 0.05. The column on the hypothesis' own pair gives "
        "the change of the mean AUC with a 95 % interval over robots. The tests above treat pairs "
        "of robots as independent although they share robots; this interval does not.",
        _hypotheses(result),
        *_windows(result),
        "## Task: mean AUC of a robot against its mean speed or torque",
        "The speed and torque of each axis are divided by the largest value in the fleet and "
        "averaged over the axes. For LR without differences, the thesis has "
        f"slope {INVARIANCE['slope']}, r² {INVARIANCE['r2']}, p {INVARIANCE['p']}.",
        table(
            ["", "combination", "classifier", "slope", "r²", "p"],
            [
                [
                    r["quantity"],
                    r["combination"],
                    r["classifier"],
                    f"{r['slope']:+.2f}",
                    f"{r['r2']:.2f}",
                    _p(r["p"]),
                ]
                for r in result["invariance"]
            ],
        ),
        "## Importance of the measurements",
        f"AUC that is lost if a measurement is shuffled, with {FULL_CHAIN}.",
        *(_importance(result, name) for name in _unique(result["importance"], "classifier")),
    ]
    return "\n\n".join(parts) + "\n"


def _p(value: float | None) -> str:
    if value is None:
        return "-"
    return f"{value:.2f}" if value >= 0.01 or value == 0 else f"{value:.0e}"


def _unique(rows: Rows, key: str) -> list[Any]:
    return list(dict.fromkeys(row[key] for row in rows))


def _shown(result: dict[str, Any]) -> list[str]:
    found = _unique(result["cells"], "classifier")
    return [name for name in CLASSIFIERS if name in found]


def _find(result: dict[str, Any], horizon: int, name: str, classifier: str) -> Rows:
    return [
        cell
        for cell in result["cells"]
        if (cell["horizon"], cell["combination"], cell["classifier"]) == (horizon, name, classifier)
    ]


def _cell(result: dict[str, Any], horizon: int, name: str, classifier: str) -> dict[str, Any]:
    (cell,) = _find(result, horizon, name, classifier)
    return cell


def _table_5_2(result: dict[str, Any]) -> str:
    shown = _shown(result)
    lines = []
    for name in [*COMBINATIONS, OWN, OWN_EVENTS]:
        cells = []
        for classifier in shown:
            found = _find(result, HORIZON, name, classifier)
            thesis = AUC.get((name, classifier))
            ours = f"{found[0]['mean']:.2f} ({found[0]['deviation']:.2f})" if found else "-"
            cells.append(ours + (f" / {thesis[0]:.2f} ({thesis[1]:.2f})" if thesis else ""))
        if any(cell[0] != "-" for cell in cells):
            lines.append([name, *cells])
    return table(["preprocessing", *shown], lines)


def _horizons(result: dict[str, Any]) -> str:
    horizons = _unique(result["cells"], "horizon")
    lines = []
    for name in _unique(result["cells"], "combination"):
        for classifier in _shown(result):
            found = [_find(result, horizon, name, classifier) for horizon in horizons]
            if sum(map(bool, found)) > 1:
                means = [f"{cells[0]['mean']:.3f}" if cells else "-" for cells in found]
                lines.append([name, classifier, *means])
    untrained = {(r["column"], r["horizon"]): r["auc"] for r in result["untrained"]}
    for name in UNTRAINED:
        lines.append([name, "-", *(f"{untrained[name, h]:.3f}" for h in horizons)])
    return table(["preprocessing", "classifier", *(f"{h} d" for h in horizons)], lines)


def _table_a_1(result: dict[str, Any]) -> str:
    shown = _shown(result)
    lines = []
    for name, minutes in MINUTES.items():
        cells = []
        for k, classifier in enumerate(shown):
            found = _find(result, HORIZON, name, classifier)
            control = _cell(result, HORIZON, "control", classifier)["seconds"]
            ours = f"{found[0]['seconds'] / control:.2f}" if found and control > 0 else "-"
            theirs = f" / {minutes[k] / MINUTES['control'][k]:.2f}" if k < len(minutes) else ""
            cells.append(ours + theirs)
        lines.append([name, *cells])
    seconds = [_cell(result, HORIZON, "control", name)["seconds"] for name in shown]
    lines.append(["control, processor time", *(f"{s:.1f} s" for s in seconds)])
    return table(["preprocessing", *shown], lines)


def _pair_table(result: dict[str, Any], key: str) -> str:
    shown = _shown(result)
    theirs = VARIANCE_P if key == "variance_p" else MEAN_P
    lines = []
    for step, pairs in PAIRS.items():
        for without, with_step in pairs:
            own = {
                r["classifier"]: r
                for r in result["pairs"]
                if (r["step"], r["without"], r["with"]) == (step, without, with_step)
            }
            if not own:
                continue
            cells = []
            for name in shown:
                better = _lower_variance(own[name]) if key == "variance_p" else _rises(own[name])
                star = " *" if better else ""
                cells.append(f"{_p(own[name][key])}{star} / {_p(theirs[without, with_step][name])}")
            lines.append([f"+{step}", without, with_step, *cells])
    return table(["step", "without", "with", *shown], lines)


def _rises(row: dict[str, Any], sign: float = 1.0) -> bool:
    return row["mean_p"] < SIGNIFICANT and sign * row["mean_change"] > 0


def _lower_variance(row: dict[str, Any]) -> bool:
    ratio = row["variance_ratio"]
    return row["variance_p"] < SIGNIFICANT and ratio is not None and ratio < 1


def _hypotheses(result: dict[str, Any]) -> str:
    lines = []
    for step, (number, wording) in HYPOTHESES.items():
        for classifier in _shown(result):
            rows = [
                r for r in result["pairs"] if (r["step"], r["classifier"]) == (step, classifier)
            ]
            if not rows:
                continue
            change = "-"
            for r in result["headlines"]:
                if (r["step"], r["classifier"]) == (step, classifier):
                    change = f"{r['mean']:+.2f} [{r['low']:+.2f}, {r['high']:+.2f}]"
            before, after = (AUC[name, classifier][0] for name in HEADLINE[step])
            lines.append(
                [
                    f"{number}: {wording}",
                    classifier,
                    f"{sum(map(_rises, rows))} / {sum(_rises(r, -1) for r in rows)} of {len(rows)}",
                    f"{sum(map(_lower_variance, rows))} of {len(rows)}",
                    f"{change} / {after - before:+.2f}",
                    supported(rows),
                ]
            )
    head = ["hypothesis", "classifier", "mean rises / falls", "variance falls"]
    return table([*head, "its own pair (ours / thesis)", "supported"], lines)


def supported(rows: Rows) -> str:
    """State whether a step raises the mean of some pair, and lowers that of none.

    Args:
        rows: Pairs with and without the step, with "mean_p" and "mean_change".

    Returns:
        "yes", "mixed" if it also lowers one, or "no".
    """
    rises, falls = any(map(_rises, rows)), any(_rises(r, -1) for r in rows)
    return "yes" if rises and not falls else "mixed" if rises else "no"


def _windows(result: dict[str, Any]) -> list[str]:
    if not result["windows"]:
        return []
    lines = [
        [r["classifier"], f"{r['change']:+.3f}", f"{_p(r['p'])} / {WINDOWS_P[r['classifier']]}"]
        for r in result["windows"]
    ]
    return [
        "## Windows of five days over three",
        table(["classifier", "change of AUC", "p (ours / thesis)"], lines),
    ]


def _importance(result: dict[str, Any], classifier: str) -> str:
    rows = [r for r in result["importance"] if r["classifier"] == classifier]
    axes = [axis for axis in _unique(rows, "axis") if axis]
    lost = {(r["measurement"], r["axis"]): r["lost"] for r in rows}
    lines = [
        [name, *(f"{lost[name, axis]:+.3f}" for axis in axes), f"{lost[name, 0]:+.3f}"]
        for name in _unique(rows, "measurement")
    ]
    together = np.sum([r["lost"] for r in rows if r["axis"] == 0])
    head = ["measurement", *(f"axis {axis}" for axis in axes), "all axes"]
    return f"{classifier} (sum of the last column {together:+.3f}):\n\n" + table(head, lines)

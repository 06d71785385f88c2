"""Tables of the study `training-data`, with the thesis' values for comparison."""

from __future__ import annotations

from typing import Any

from faultgen.evaluation.markdown import goals_answer, goals_table, stars, table
from faultgen.studies.chapter4_training_data.signals import SIGNALS, TEST, TRAIN
from faultgen.studies.chapter4_training_data.thesis import (
    ANOVA,
    ERROR,
    FOUND,
    MODELS,
    NULL,
    TERM_BY_TERM,
)

Rows = list[dict[str, Any]]

NAMES = {
    "variation": "coefficient of variation of Q",
    "above": "days above the limit of Q",
    "lead": "lead time [d]",
}
"""Names of the descriptors."""

_ANOVA_TABLES = {"variation": "4.2", "above": "4.3", "lead": "4.4"}
_MODEL_TABLES = {"variation": "4.6", "lead": "4.8", "above": "4.10"}
_TERM_TABLES = {"variation": "4.7", "lead": "4.9", "above": "4.11"}


def goals(result: dict[str, Any]) -> Rows:
    """The thesis' findings, and whether they are confirmed."""
    rows = []
    for name, (source, signal, _) in FOUND.items():
        found = _found(result, name, TEST)
        again = f"{source}, {signal}" in found
        rows.append(
            {
                "name": f"chapter 4, {NAMES[name]}: where failing robots differ (Tukey, p < 0.05)",
                "thesis": f"{source}, {signal}",
                "goal": "the same",
                "measured": "; ".join(found) or "nowhere",
                "reached": again,
            }
        )
    return rows


def tables(result: dict[str, Any]) -> str:
    """All tables in Markdown."""
    columns = ", ".join(f"{name} {result['columns'][name]}" for name in SIGNALS)
    parts = [
        f"# Study training-data, fleet of seed {result['fleet']['seed']}",
        "This page answers the question: should PCA learn from the same robot or from others, and "
        f"from which signal, to recognise a failing robot? {goals_answer(goals(result))}",
        "PCA (principal component analysis) finds the directions, called components, in which the "
        "training days vary most. Q is the squared distance of a day from the space of these "
        "components. OTO (one to one): the model is tested on the set that it learned from. OTM "
        "(one to many): it is tested on sets of other robots. 'Difference' means the absolute "
        "differences from day to day, 'combined' both these and the raw measurements. 'a / b' "
        "means ours / thesis. Stars mark p < 0.05, 0.01, 0.001 and 0.0001. "
        "The failing robots have worn gearboxes. Those of the thesis have failures of two "
        "gearboxes, two motors, two brakes and a computer unit.",
        f"Each set has {TRAIN} days of training and {TEST} days of test. The last five days are "
        f"left out. Number of columns: {columns}. Sets: "
        + "; ".join(
            f"{one['robot']} from day {one['first_day']} ({'fails' if one['failed'] else 'normal'})"
            for one in result["sets"]
        )
        + ".",
        "## Goals",
        goals_table(goals(result)),
        "## Table 4.1: cases, and figures 4-4 to 4-6: mean (standard error)",
        "The coefficient of variation is the standard deviation divided by the mean. The lead time "
        "is the number of test days after the first day above the limit.",
        "The limit of Q is the 95 % quantile of training days that are held out of the fit in "
        "turn. With a normal robot's own model, "
        f"{100 * result['healthy_above']['limit']:.0f} % of its days are above this limit, and "
        f"{100 * result['healthy_above']['gaussian_limit']:.0f} % are above the limit of Jackson "
        "and Mudholkar.",
        _groups(result),
        *(
            part
            for name, number in _ANOVA_TABLES.items()
            for part in (
                f"## Table {number}: analysis of variance (ANOVA) of {NAMES[name]}",
                _anova(result, name),
            )
        ),
        "## Generalised linear models (GLMs) of table 4.5",
        "The coefficient of variation has a gamma distribution, the two numbers of days have a "
        "Poisson distribution. The link is logarithmic. The deviance measures what a model leaves "
        "unexplained.",
        *(
            part
            for name in _MODEL_TABLES
            for part in (
                f"### Table {_MODEL_TABLES[name]}: {NAMES[name]}",
                _models(result, name),
                f"### Table {_TERM_TABLES[name]}: {NAMES[name]}, term by term",
                _terms(result, name),
            )
        ),
        "## Fewer days of test",
        "Each cell gives the mean of failing robots, the mean of normal robots, and the p-value of "
        "Tukey's test over all 12 groups.",
        _cuts(result),
        "## The same with 15 days, without tests of a robot by its own data",
        "Table 4.1 counts 36 normal cases of one to many. In 12 of them, the model is tested on "
        "the robot from which it learned, at another time or the same. Failing robots have no such "
        "cases. These 12 cases are left out here.",
        table(
            ["descriptor", "signal", "failing : normal, p"],
            [
                [NAMES[r["descriptor"]], r["signal"], _contrast(r)]
                for r in result["other_robots"]
                if r["source"] == "OTM"
            ],
        ),
    ]
    return "\n\n".join(parts) + "\n"


def _found(result: dict[str, Any], name: str, days: int) -> list[str]:
    return [
        f"{r['source']}, {r['signal']}"
        for r in result["cuts"]
        if (r["descriptor"], r["days"]) == (name, days) and r["found"]
    ]


def _p(value: float) -> str:
    return f"{value:.3f} {stars(value)}".strip()


def _groups(result: dict[str, Any]) -> str:
    lines = [
        [
            r["source"],
            r["signal"],
            r["condition"],
            r["cases"],
            *(f"{r[name]:.2f} ({r[f'{name}_error']:.2f})" for name in NAMES),
        ]
        for r in result["groups"]
    ]
    return table(["source", "signal", "condition", "cases", *NAMES.values()], lines)


def _anova(result: dict[str, Any], name: str) -> str:
    lines = []
    for row in result["anova"][name]:
        thesis = ANOVA[name].get(row["source"])
        if thesis:
            lines.append(
                [
                    row["source"],
                    row["df"],
                    f"{row['ss']:.3f} / {thesis['ss']:g}",
                    f"{row['ms']:.3f}",
                    f"{row['f']:.2f} / {thesis['f']:g}",
                    f"{_p(row['p'])} / {_p(thesis['p'])}",
                ]
            )
        else:
            ms = f"{row['ms']:.3f}" if "ms" in row else ""
            theirs = f" / {ERROR[name]:g}" if row["source"] == "Error" else ""
            shown = f"{row['ss']:.3f}{theirs}"
            lines.append([row["source"], row["df"], shown, ms, "", ""])
    return table(["source", "df", "SS", "MS", "F", "p"], lines)


def _deviance(row: dict[str, Any], thesis: dict[str, float]) -> list[Any]:
    return [
        row["residual_df"],
        f"{row['residual_deviance']:.2f} / {thesis['residual_deviance']:g}",
        row["df"],
        f"{row['deviance']:.2f} / {thesis['deviance']:g}",
        f"{_p(row['p'])} / {_p(thesis['p'])}",
    ]


_HEAD = ["residual df", "residual deviance", "df", "deviance", "p"]


def _models(result: dict[str, Any], name: str) -> str:
    first, *others = result["models"][name]
    null = f"{first['residual_deviance']:.2f} / {NULL[name]:g}"
    lines: list[list[Any]] = [[1, first["residual_df"], null, "", "", ""]]
    for row, thesis in zip(others, MODELS[name], strict=True):
        lines.append([f"{row['model']} (to {row['against']})", *_deviance(row, thesis)])
    return table(["model", *_HEAD], lines)


def _terms(result: dict[str, Any], name: str) -> str:
    first, *others = result["terms"][name]
    null = f"{first['residual_deviance']:.2f} / {NULL[name]:g}"
    lines: list[list[Any]] = [["null", first["residual_df"], null, "", "", ""]]
    for row, thesis in zip(others, TERM_BY_TERM[name], strict=True):
        lines.append([row["term"], *_deviance(row, thesis)])
    return table(["term", *_HEAD], lines)


def _cuts(result: dict[str, Any]) -> str:
    days = list(dict.fromkeys(r["days"] for r in result["cuts"]))
    lines = []
    for name, (source, signal, least) in FOUND.items():
        for r in result["cuts"]:
            if r["descriptor"] != name or r["days"] != days[0]:
                continue
            key = r["source"], r["signal"]
            cells = [
                _contrast(own)
                for own in result["cuts"]
                if (own["descriptor"], own["source"], own["signal"]) == (name, *key)
            ]
            thesis = f"differ, from {least} d" if key == (source, signal) else "do not"
            lines.append([NAMES[name], *key, *cells, thesis])
    return table(["descriptor", "source", "signal", *(f"{d} d" for d in days), "thesis"], lines)


def _contrast(row: dict[str, Any]) -> str:
    return f"{row['failure']:.2f} : {row['normal']:.2f}, {_p(row['p'])}"

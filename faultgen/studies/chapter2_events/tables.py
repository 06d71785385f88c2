"""Tables of the study `events`, with the thesis' findings for comparison."""

from __future__ import annotations

from typing import Any

from faultgen.evaluation.markdown import goals_answer, goals_table, percent, table
from faultgen.studies.chapter2_events.study import BEFORE, DETECTORS

Rows = list[dict[str, Any]]


def goals(result: dict[str, Any]) -> Rows:
    """The claims of the chapter and what was measured."""
    rise, warnings = result["rise"]["Q"], result["warnings"]["Q"]
    ours = result["warnings"]["supervision, charted"]
    fails = sum(result["failed"])
    return [
        {
            "name": "failures looked at",
            "thesis": 1,
            "goal": 20,
            "measured": fails,
            "reached": fails >= 20,
        },
        {
            "name": f"Q rises more in the last {BEFORE} days before a failure than without (p)",
            "thesis": "one robot, no test",
            "goal": "p < 0.05",
            "measured": f"p = {rise['p']:.2g}, AUC {rise['auc']:.2f}",
            "reached": rise["p"] < 0.05,
        },
        {
            "name": "failing robots with a warning by Q",
            "thesis": "1 of 1, about 30 days",
            "goal": "more than healthy ones",
            "measured": f"{percent(warnings['warned'])} % of failing, "
            f"{percent(warnings['healthy_warned'])} % of healthy",
            "reached": warnings["warned"]["low"] > warnings["healthy_warned"]["high"],
        },
        {
            "name": "the same by a chart of supervisions",
            "thesis": "-",
            "goal": "more than healthy ones",
            "measured": f"{percent(ours['warned'])} % of failing, "
            f"{percent(ours['healthy_warned'])} % of healthy",
            "reached": ours["warned"]["low"] > ours["healthy_warned"]["high"],
        },
    ]


def tables(result: dict[str, Any]) -> str:
    """The page of the study."""
    parts = [
        "# Event logs before failures",
        "This page answers the question: does the event log of a robot change before a gearbox "
        f"fails? {goals_answer(result['goals'])}",
        f"The fleet has {result['robots']} robots, {sum(result['failed'])} of which fail after "
        f"{result['days']} days. A PCA (principal component analysis) with 5 components is fitted "
        "to the first 28 days of each robot. The components explain "
        f"{100 * result['variance_of_five']:.0f} % of the variance (thesis 85 %). T² measures how "
        "far a day lies from the mean along the components. Q is its squared distance from the "
        "space of the components. An EWMA (exponentially weighted moving average) smooths a "
        "statistic over time. Numbers in square brackets are 95 % confidence intervals.",
        goals_table(result["goals"]),
        "## Warnings",
        table(
            [
                "detector",
                "failing robots warned [%]",
                "days of warning, median",
                "healthy robots warned [%]",
                "share of healthy days in alarm",
            ],
            [
                [
                    f"{name}: {what}",
                    percent(one["warned"]),
                    "-" if one["days"] is None else f"{one['days']:.0f}",
                    percent(one["healthy_warned"]),
                    f"{100 * one['healthy_in_alarm']:.0f} %",
                ]
                for name, what in DETECTORS.items()
                for one in [result["warnings"][name]]
            ],
        ),
        "A robot counts as warned of if the alarm is on for at least half of its last 32 days. The "
        "days of warning count from the start of the alarm that lasts to the end; breaks of up to "
        "a week do not end an alarm. The columns on healthy robots show how many warnings come by "
        "chance.",
        "## Days above the limit",
        "Share of days on which a statistic is above its limit, in the last 32 days of the record "
        "and before them.",
        table(
            [
                "",
                "failing, last 32 days",
                "failing, before",
                "healthy, last 32 days",
                "healthy, before",
            ],
            [
                [name, *[f"{100 * value:.0f} %" for value in row.values()]]
                for name, row in result["exceeding"].items()
            ],
        ),
        "## Rise in the last 32 days",
        "The AUC (area under the receiver operating characteristic curve) is the chance that the "
        "statistic rises more in a failing robot than in a healthy one. It is 0.5 if the statistic "
        "carries no information. The p-value is that of the Mann-Whitney test.",
        table(
            ["", "AUC, failing against healthy", "p (Mann-Whitney)"],
            [
                [name, f"{row['auc']:.2f}", f"{row['p']:.2g}"]
                for name, row in result["rise"].items()
            ],
        ),
    ]
    return "\n\n".join(parts) + "\n"

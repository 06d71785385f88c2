"""Tables of the study `events`, with the thesis' findings for comparison."""

from __future__ import annotations

from typing import Any

from faultgen.evaluation.markdown import goals_table, percent, table
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
        f"{result['robots']} robots, {sum(result['failed'])} of which fail after "
        f"{result['days']} days; PCA of 5 components of the first 28 days, which explain "
        f"{100 * result['variance_of_five']:.0f} % of the variance (thesis 85 %).",
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
        "A robot is warned of where the alarm is on for at least half of the last 32 days; days of "
        "warning count from the start of the alarm that lasts to the end, breaks of a week aside. "
        "What healthy robots do says how much of it is chance.",
        "## Days above the limit",
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
        table(
            ["", "AUC, failing against healthy", "p (Mann-Whitney)"],
            [
                [name, f"{row['auc']:.2f}", f"{row['p']:.2g}"]
                for name, row in result["rise"].items()
            ],
        ),
    ]
    return "\n\n".join(parts) + "\n"

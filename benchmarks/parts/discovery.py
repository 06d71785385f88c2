"""How often discovery is right: docs/results/discovery.md."""

from __future__ import annotations

from typing import Any

from parts.part import Part, table
from scoring.judging import Row
from scoring.table import shown

_PAGE = "results/discovery.md"
_CASES = ("sealed.cases", "laboratories.make", "real_robots.real_arms")
_LABORATORIES = {
    "lift1_a": "slide",
    "scara4_a": "SCARA",
    "puma560_a": "PUMA 560",
    "arm7_a": "7 axes",
}
_STEPS = {
    "A": ("true", "true", "true"),
    "C": ("of discovery, true positions", "true", "true"),
    "D": ("of discovery, measured positions", "found", "true"),
    "E": ("as above", "as above", "as discovery learns them"),
}
"""What is known of signatures, noise and healthy robots, see `laboratories.ablation_steps`."""


def score(told: dict[str, Any]) -> str:
    """Shares by set of cases, and how good the stated probabilities are."""
    rows = [
        Row(**case | {"stated": tuple((p, there) for p, there in case["stated"])})
        for case in told["cases"]
    ]
    return shown(rows, told)


def ablation(told: dict[str, Any]) -> str:
    """Share of right answers by laboratory, step by step."""
    laboratories = told["summary"]["by_laboratory"]
    rows = []
    for step, words in _STEPS.items():
        found = [laboratories[name][step] for name in _LABORATORIES]
        found.append(told["summary"]["total"][step])
        rows.append([*words, *(f"{one['right']:.0f} %" for one in found)])
    head = ["signatures", "noise", "healthy robots", *_LABORATORIES.values(), "all"]
    return table(head, rows)


PARTS = (
    Part(
        name="discovery_score",
        commands=(
            "python -m benchmarks.discovery.score --set report --out . --workers 2 "
            "--save discovery_score.json",
        ),
        code=("discovery.score", "scoring.batches", *_CASES, "faultgen.cli"),
        page=_PAGE,
        table=score,
        minutes=60,
    ),
    Part(
        name="discovery_ablation",
        commands=(
            "python -m benchmarks.discovery.ablation --workers 2 --parts laboratories "
            "--save discovery_ablation.json",
        ),
        code=("discovery.ablation", "laboratories.ablation", "scoring.answering"),
        page=_PAGE,
        table=ablation,
        minutes=60,  # assumed
    ),
)

"""Counted answers."""

from __future__ import annotations

from typing import Any

from statsmodels.stats.proportion import proportion_confint


def wilson(right: int, total: int) -> tuple[float, float]:
    """Wilson interval of a share, 95 %."""
    low, high = proportion_confint(right, total, method="wilson")
    return float(low), float(high)


def share(right: int, total: int) -> dict[str, Any]:
    """A count as a share with its 95 % Wilson interval."""
    low, high = wilson(right, total)
    return {
        "right": int(right),
        "total": int(total),
        "share": right / total,
        "low": low,
        "high": high,
    }

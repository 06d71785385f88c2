"""Counted answers."""

from __future__ import annotations

from typing import Any

from statsmodels.stats.proportion import proportion_confint


def share(right: int, total: int) -> dict[str, Any]:
    """A count as a share with its 95 % Wilson interval."""
    low, high = proportion_confint(right, total, method="wilson")
    return {
        "right": int(right),
        "total": int(total),
        "share": right / total,
        "low": float(low),
        "high": float(high),
    }

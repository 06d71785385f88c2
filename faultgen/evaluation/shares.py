"""Shares of counted answers, with their intervals."""

from __future__ import annotations

from typing import Any

from statsmodels.stats.proportion import proportion_confint


def wilson(right: int, total: int) -> tuple[float, float]:
    """Compute the 95 % Wilson interval of a share.

    Args:
        right: Number of right answers.
        total: Number of all answers.

    Returns:
        Lower and upper end.
    """
    low, high = proportion_confint(right, total, method="wilson")
    return float(low), float(high)


def share(right: int, total: int) -> dict[str, Any]:
    """Compute a share with its 95 % Wilson interval.

    Args:
        right: Number of right answers.
        total: Number of all answers, at least 1.

    Returns:
        The counts "right" and "total", the "share", and the ends "low" and "high" of the interval.
    """
    low, high = wilson(right, total)
    return {
        "right": int(right),
        "total": int(total),
        "share": right / total,
        "low": low,
        "high": high,
    }

"""Statistics of columns that are read in pieces, as datasets for robot learning state them."""

from __future__ import annotations

from typing import Any

import numpy as np

QUANTILES = (0.01, 0.10, 0.50, 0.90, 0.99)


class Statistics:
    """Smallest and largest value, mean, standard deviation and quantiles of each column.

    Quantiles of joined pieces are means of those of the pieces, weighted by length, as lerobot
    computes them. Everything else is exact.
    """

    def __init__(self) -> None:
        self._columns: dict[str, dict[str, np.ndarray]] = {}

    def add(self, name: str, values: np.ndarray) -> None:
        """Compute the statistics of a column.

        Args:
            name: Name of the column.
            values: Its values, shape (rows,) or (rows, length).
        """
        numbers = np.asarray(values, float).reshape(len(values), -1)
        quantiles = np.quantile(numbers, QUANTILES, axis=0)
        self._columns[name] = {
            "min": numbers.min(axis=0),
            "max": numbers.max(axis=0),
            "mean": numbers.mean(axis=0),
            "std": numbers.std(axis=0),
            "count": np.array([len(numbers)]),
            **{f"q{100 * q:02.0f}": found for q, found in zip(QUANTILES, quantiles, strict=True)},
        }

    def join(self, other: Statistics) -> None:
        """Take in the statistics of a further piece of the same columns.

        Args:
            other: Its statistics.
        """
        for name, new in other._columns.items():
            old = self._columns.get(name)
            self._columns[name] = new if old is None else _joined(old, new)

    def told(self) -> dict[str, dict[str, Any]]:
        """Return all statistics as lists, by column and kind."""
        return {
            name: {kind: values.tolist() for kind, values in one.items()}
            for name, one in self._columns.items()
        }


def _joined(a: dict[str, np.ndarray], b: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    count = a["count"] + b["count"]
    share = b["count"] / count
    found = {kind: a[kind] + share * (b[kind] - a[kind]) for kind in a}
    variance = (1 - share) * a["std"] ** 2 + share * b["std"] ** 2
    between = share * (1 - share) * (b["mean"] - a["mean"]) ** 2
    return found | {
        "min": np.minimum(a["min"], b["min"]),
        "max": np.maximum(a["max"], b["max"]),
        "std": np.sqrt(variance + between),
        "count": count,
    }

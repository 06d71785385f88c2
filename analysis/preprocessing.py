"""Preprocessing of monitoring data before a classifier, thesis 5.3.2.

    combination = Combination.of("+estM+diff+var3+pca")
    day, X = prepare(record, combination)  # rows of one robot, one a day
    make_pipeline(StandardScaler(), *combination.reduction(), LogisticRegression())

What is done with the series of one robot (daily maximum, divergences, estimates, differences,
windows) uses that robot's own rows only. What is learned from rows of several robots, the principal
components, is a transformer for a scikit-learn pipeline and so sees training rows only.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.decomposition import PCA

from .daily import DIVERGENCES, ESTIMATES, INDICATORS, Daily, Record, daily
from .divergence import kl_divergence

Floats = NDArray[np.float64]
Ints = NDArray[np.int_]

SMOOTHING = 1e-3
"""Share of time added to every bin of a histogram before a divergence: assumed."""

COMBINATIONS = (
    "control",
    "+estM",
    "+diff",
    "+pca",
    "+var3",
    "+estM+diff",
    "+estM+pca",
    "+estM+var3",
    "+diff+pca",
    "+var3+pca",
    "+estM+diff+pca",
    "+estM+var3+pca",
    "+diff+pca+var3",
    "+diff+var3+pca",
    "+estM+diff+var3+pca",
)
"""The 15 of thesis table 5.2, in its order."""

_STEPS = ("estM", "diff", "var3", "var5", "pca")


@dataclass(frozen=True)
class Combination:
    """Steps of preprocessing, by the names of thesis table 5.2."""

    name: str
    """Steps in their order, `+` before each, or `control`."""
    estimates: bool = False
    """`+estM`: estimated speed and torque beside the indicators."""
    difference: bool = False
    """`+diff`: absolute differences, and divergences, to the day before."""
    days: int = 1
    """`+var3`, `+var5`: that many days side by side."""
    pca: bool = False
    """`+pca`: principal components in place of columns."""
    pca_before_days: bool = False
    """Components of single days, which are then put side by side, rather than of windows."""

    @classmethod
    def of(cls, name: str) -> Self:
        """The combination of that name.

        Raises:
            ValueError: A step is unknown, comes twice, or estimates come after differences.
        """
        steps = [] if name == "control" else name.removeprefix("+").split("+")
        unknown = [step for step in steps if step not in _STEPS]
        if unknown:
            raise ValueError(f"{name}: unknown step '{unknown[0]}': choose {', '.join(_STEPS)}")
        windows = [step for step in steps if step.startswith("var")]
        if len(set(steps)) < len(steps) or len(windows) > 1:
            raise ValueError(f"{name}: each step may be there once, and one window")
        order = {step: steps.index(step) for step in steps}
        if "estM" in order and order["estM"] > 0:
            raise ValueError(f"{name}: estimates of torque and speed come first")
        if "diff" in order and any(
            order["diff"] > order[step] for step in ("pca", *windows) if step in order
        ):
            raise ValueError(f"{name}: differences come before windows and components")
        return cls(
            name=name,
            estimates="estM" in order,
            difference="diff" in order,
            days=int(windows[0][3:]) if windows else 1,
            pca="pca" in order,
            pca_before_days=bool(windows) and order.get("pca", len(steps)) < order[windows[0]],
        )

    @property
    def measurements(self) -> tuple[str, ...]:
        """Measurements of each axis."""
        return INDICATORS + (ESTIMATES if self.estimates else ()) + DIVERGENCES

    def columns(self, n_axes: int) -> dict[tuple[str, int], Ints]:
        """Columns of each measurement and axis, from 1, in the rows of `prepare`."""
        names = self.measurements
        first = np.arange(self.days) * len(names) * n_axes
        return {
            (name, axis + 1): first + k * n_axes + axis
            for k, name in enumerate(names)
            for axis in range(n_axes)
        }

    def reduction(self) -> list[DailyPCA]:
        """Steps for a pipeline, after columns have been standardised."""
        if not self.pca:
            return []
        return [DailyPCA(days=self.days if self.pca_before_days else 1)]


def measurements(
    series: Daily, *, estimates: bool, difference: bool, smoothing: float = SMOOTHING
) -> tuple[Ints, Floats]:
    """Rows of table 5.1: indicators, estimates, and a divergence for each histogram.

    Args:
        series: Record by days.
        estimates: Whether estimated speed and torque are among them.
        difference: Absolute differences to the day before, and divergences from it, rather than
            values, and divergences from the first day.
        smoothing: Share of time added to each bin of both histograms.

    Returns:
        Days, and values [rad/s, N m, rad/s, N m, bit, bit, bit], measurement by measurement and
        axis by axis. Shapes (days,) and (days, measurements * n_axes); with differences the first
        day is left out.
    """
    names = INDICATORS + (ESTIMATES if estimates else ())
    values = np.hstack([series.values[name] for name in names])
    if difference:
        pairs = [(own[1:], own[:-1]) for own in series.histograms.values()]
        values = np.abs(np.diff(values, axis=0))
    else:
        pairs = [(own, np.broadcast_to(own[0], own.shape)) for own in series.histograms.values()]
    divergences = [kl_divergence(now, before, smoothing=smoothing) for now, before in pairs]
    return series.day[int(difference) :], np.hstack([values, *divergences])


def windows(values: ArrayLike, days: int) -> Floats:
    """Each row beside those before it, the oldest first: [X_{k-n+1}, ..., X_k].

    Args:
        values: Shape (rows, columns).
        days: n, at least 1.

    Returns:
        Shape (rows - n + 1, n * columns).

    Raises:
        ValueError: There are fewer than n rows.
    """
    rows = np.asarray(values, dtype=float)
    if not 1 <= days <= len(rows):
        raise ValueError(f"windows of {days} rows need as many, got {len(rows)}")
    return np.hstack([rows[k : len(rows) - days + 1 + k] for k in range(days)])


def prepare(record: Record, combination: Combination) -> tuple[Ints, Floats]:
    """Rows of one robot, all steps but the principal components, see `Combination.reduction`.

    Args:
        record: Monitoring of the robot, see `daily`.
        combination: Steps.

    Returns:
        Day of each row, from 0, and rows. Shapes (rows,) and (rows, columns).

    Raises:
        ValueError: As `daily` and `windows`.
    """
    day, values = measurements(
        daily(record), estimates=combination.estimates, difference=combination.difference
    )
    return day[combination.days - 1 :], windows(values, combination.days)


class DailyPCA(TransformerMixin, BaseEstimator):
    """Principal components of each day in a row of several days.

    Components are learned from the newest day of the training rows: the days before it are, as a
    rule, newest days of other rows. With one day this is PCA of the whole row.

    Args:
        days: Days side by side in a row.
        share: Share of the variance that the components kept explain, within (0, 1).
    """

    def __init__(self, *, days: int = 1, share: float = 0.9) -> None:
        self.days = days
        self.share = share

    def fit(self, X: ArrayLike, y: object = None) -> Self:
        """Learn the components.

        Args:
            X: Rows. Shape (rows, days * columns).
            y: Not used.
        """
        newest = self._by_day(np.asarray(X, dtype=float))[:, -1]
        self.pca_ = PCA(n_components=self.share, svd_solver="full").fit(newest)
        return self

    def transform(self, X: ArrayLike) -> Floats:
        """Scores of each day, side by side. Shape (rows, days * components)."""
        by_day = self._by_day(np.asarray(X, dtype=float))
        return np.hstack([self.pca_.transform(by_day[:, k]) for k in range(self.days)])

    def _by_day(self, X: Floats) -> Floats:
        return X.reshape(len(X), self.days, -1)

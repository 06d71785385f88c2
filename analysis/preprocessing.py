"""Preprocessing of monitoring data for a classifier, thesis 5.3.2.

    combination = Combination.of("+estM+diff+var3+pca")
    day, X = prepare(record, combination)  # rows of one robot, one per day
    make_pipeline(StandardScaler(), *combination.reduction(), LogisticRegression())

All steps on the series of one robot (daily maximum, divergences, estimates, differences, windows)
use the rows of that robot only. The principal components are learned from rows of several robots.
They are a transformer of a scikit-learn pipeline, so that they are learned from training rows only.
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
"""Share of time that is added to every bin of a histogram before a divergence: assumed."""

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
"""The 15 combinations of thesis table 5.2, in its order."""

_STEPS = ("estM", "diff", "var3", "var5", "pca")


@dataclass(frozen=True)
class Combination:
    """Steps of preprocessing, with the names of thesis table 5.2."""

    name: str
    """Steps in their order, each with a leading `+`, or `control`."""
    estimates: bool = False
    """`+estM`: estimated speed and torque in addition to the indicators."""
    difference: bool = False
    """`+diff`: absolute differences, and divergences, from the day before."""
    days: int = 1
    """`+var3`, `+var5`: number of days in one row."""
    pca: bool = False
    """`+pca`: principal components instead of columns."""
    pca_before_days: bool = False
    """Whether components are those of single days, which are then combined, instead of those of
    windows."""

    @classmethod
    def of(cls, name: str) -> Self:
        """Return the combination with a name.

        Raises:
            ValueError: A step is unknown, occurs twice, or estimates come after differences.
        """
        steps = [] if name == "control" else name.removeprefix("+").split("+")
        unknown = [step for step in steps if step not in _STEPS]
        if unknown:
            raise ValueError(f"{name}: unknown step '{unknown[0]}': choose {', '.join(_STEPS)}")
        windows = [step for step in steps if step.startswith("var")]
        if len(set(steps)) < len(steps) or len(windows) > 1:
            raise ValueError(f"{name}: each step, and one window, may occur only once")
        order = {step: steps.index(step) for step in steps}
        if "estM" in order and order["estM"] > 0:
            raise ValueError(f"{name}: estimates of torque and speed come first")
        if "diff" in order and any(
            order["diff"] > order[step] for step in ("pca", *windows) if step in order
        ):
            raise ValueError(f"{name}: differences must come before windows and components")
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
        """Find the columns of each measurement and axis in the rows of `prepare`.

        Args:
            n_axes: Number of axes.

        Returns:
            Indices of the columns by measurement and axis (from 1), shape (days,) each.
        """
        names = self.measurements
        first = np.arange(self.days) * len(names) * n_axes
        return {
            (name, axis + 1): first + k * n_axes + axis
            for k, name in enumerate(names)
            for axis in range(n_axes)
        }

    def reduction(self) -> list[DailyPCA]:
        """Steps of a pipeline that follow the standardisation of the columns."""
        if not self.pca:
            return []
        return [DailyPCA(days=self.days if self.pca_before_days else 1)]


def measurements(
    series: Daily, *, estimates: bool, difference: bool, smoothing: float = SMOOTHING
) -> tuple[Ints, Floats]:
    """Compute the rows of table 5.1: indicators, estimates, and a divergence for each histogram.

    Args:
        series: Record by days.
        estimates: Whether estimated speed and torque are included.
        difference: Whether to use absolute differences and divergences from the day before, instead
            of values and divergences from the first day.
        smoothing: Share of time that is added to each bin of both histograms.

    Returns:
        Days, and values [rad/s, N m, rad/s, N m, bit, bit, bit], measurement by measurement and
        axis by axis. Shapes (days,) and (days, measurements * n_axes). With differences, the first
        day has no row.
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
    """Combine each row with those before it, the oldest first: [X_{k-n+1}, ..., X_k].

    Args:
        values: Shape (rows, columns).
        days: n, at least 1.

    Returns:
        Shape (rows - n + 1, n * columns), in the units of the values.

    Raises:
        ValueError: There are fewer than n rows.
    """
    rows = np.asarray(values, dtype=float)
    if not 1 <= days <= len(rows):
        raise ValueError(f"windows of {days} rows need at least as many rows, got {len(rows)}")
    return np.hstack([rows[k : len(rows) - days + 1 + k] for k in range(days)])


def prepare(record: Record, combination: Combination) -> tuple[Ints, Floats]:
    """Compute the rows of one robot: all steps except `Combination.reduction`.

    Args:
        record: Monitoring data of the robot, see `daily`.
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

    Components are learned from the newest day of the training rows. The days before it are usually
    newest days of other rows. With one day this is PCA of the whole row.

    Args:
        days: Number of days in a row.
        share: Share of the variance that the components explain, within (0, 1).
    """

    def __init__(self, *, days: int = 1, share: float = 0.9) -> None:
        self.days = days
        self.share = share

    def fit(self, X: ArrayLike, y: object = None) -> Self:
        """Learn the components.

        Args:
            X: Rows. Shape (rows, days * columns).
            y: Not used.

        Returns:
            The transformer itself.
        """
        newest = self._by_day(np.asarray(X, dtype=float))[:, -1]
        self.pca_ = PCA(n_components=self.share, svd_solver="full").fit(newest)
        return self

    def transform(self, X: ArrayLike) -> Floats:
        """Compute the scores of each day.

        Args:
            X: Rows. Shape (rows, days * columns).

        Returns:
            The scores, day after day. Shape (rows, days * components).
        """
        by_day = self._by_day(np.asarray(X, dtype=float))
        return np.hstack([self.pca_.transform(by_day[:, k]) for k in range(self.days)])

    def _by_day(self, X: Floats) -> Floats:
        return X.reshape(len(X), self.days, -1)

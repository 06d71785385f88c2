"""The isolators. Each is a class and one line of the table `ISOLATORS`.

Installed packages can add isolators. Such a package declares an entry point of the group
``faultgen.isolators``, which names a subclass of `faultgen.evaluation.Isolator` or a list of them.
docs/extending.md shows both ways.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from faultgen.analysis.cross_correlation import (
    cross_correlation_lags,
    isolate_axis_by_lags,
    leading_axis,
)
from faultgen.analysis.isolation import Answer, ChangeIsolator
from faultgen.analysis.transfer_entropy import isolate_axis
from faultgen.evaluation.methods import Isolator, registered
from faultgen.plugins import ISOLATORS as GROUP


class ByOrder(Isolator):
    """An isolator of the thesis. It compares the axes with each other, and learns nothing."""

    features = ("mean_abs_torque",)
    learns = False

    def fit(self, *healthy: Sequence[np.ndarray]) -> None:
        """Learn nothing."""

    def isolate(self, *features: np.ndarray) -> int:
        """Name an axis by the order in which the mean |torque| of the axes changes.

        Args:
            features: Mean |torque|, shape (cycles, n_axes), in [N m].

        Returns:
            The axis from 0, or -1 for none.
        """
        (torque,) = features
        # an axis that is sometimes outside the speed window has no complete series
        return self.named(np.where(np.isfinite(torque).all(axis=0), torque, 0.0))

    def named(self, series: np.ndarray) -> int:
        """Name an axis by a series of shape (cycles, n_axes); -1 for none."""
        raise NotImplementedError


class TransferEntropy10(ByOrder):
    """The axis with the largest net transfer entropy, in 10 bins."""

    name = "TE 10 bins"
    idea = "largest net transfer entropy to the other axes, 10 bins"

    def named(self, series: np.ndarray) -> int:
        """Name the axis with the largest net transfer entropy."""
        return isolate_axis(series, bins=10)


class TransferEntropy5(ByOrder):
    """The axis with the largest net transfer entropy, in 5 bins."""

    name = "TE 5 bins"
    idea = "largest net transfer entropy to the other axes, 5 bins"

    def named(self, series: np.ndarray) -> int:
        """Name the axis with the largest net transfer entropy."""
        return isolate_axis(series, bins=5)


class CrossCorrelation(ByOrder):
    """The axis that leads all others, as the text of the thesis words its rule."""

    name = "CC"
    idea = "negative lags of the cross-correlation with all other axes"

    def named(self, series: np.ndarray) -> int:
        """Name the axis that leads all others."""
        return isolate_axis_by_lags(series)


class CrossCorrelationAsPrinted(ByOrder):
    """The axis that trails all others.

    Thesis eq. 3.5 gives the leading axis a positive lag, but its rule asks for negative lags. Taken
    literally, the rule names the axis that trails. Its results are closer to those of the thesis.
    """

    name = "CC, eq. 3.5"
    idea = "the same with the sign of the lags in thesis eq. 3.5"

    def named(self, series: np.ndarray) -> int:
        """Name the axis that trails all others."""
        return leading_axis(-cross_correlation_lags(series))


class ByChange(Isolator):
    """An isolator that compares with the healthy spread, in the directions of wear of the model."""

    change: ChangeIsolator

    def fit(self, *healthy: Sequence[np.ndarray]) -> None:
        """Learn the healthy spread.

        Args:
            healthy: For each feature, one array for each series.

        Raises:
            ValueError: There are too few healthy cycles.
        """
        self.change = self.made()
        self.change.fit([self.columns(*series) for series in zip(*healthy, strict=True)])

    def isolate(self, *features: np.ndarray) -> Answer:
        """Determine which axes are worn, and by how much.

        Args:
            features: Features of the cycles up to now.

        Returns:
            The answer.
        """
        return self.change.isolate(self.columns(*features))

    def smallest(self) -> np.ndarray:
        """Predict the smallest wear that would be found in 95 of 100 cases.

        Returns:
            Severity, shape (n_axes,).
        """
        return self.change.smallest(power=0.95)

    def made(self) -> ChangeIsolator:
        """Make the isolator, not yet fitted."""
        direction = self.setting.directions[self.features[0]]
        return direction.isolator(temperature_varies=self.setting.temperature_varies)

    def columns(self, *features: np.ndarray) -> np.ndarray:
        """Put the features side by side, shape (cycles, columns).

        The temperature comes last, and only if it varies.

        Returns:
            Shape (cycles, columns).
        """
        values, temperature = features
        if not self.setting.temperature_varies:
            return values
        return np.hstack([values, temperature[:, None]])


class OwnTorque(ByChange):
    """The change of each axis over its own spread."""

    name = "own torque"
    idea = "change of an axis' mean |torque| over its own healthy spread"
    features = ("mean_abs_torque",)

    def made(self) -> ChangeIsolator:
        """Make the isolator, not yet fitted."""
        value = self.setting.directions["mean_abs_torque"].value
        return ChangeIsolator(directions=np.diag(np.diagonal(value)), covariance="diagonal")

    def columns(self, *features: np.ndarray) -> np.ndarray:
        """Return the mean |torque|, 0 for an axis that is outside the speed window.

        Returns:
            Shape (cycles, columns).
        """
        return np.nan_to_num(features[0])


class AllTorques(ByChange):
    """The change of all axes together, beside what temperature and payload do."""

    name = "all torques"
    idea = "mean |torque| of all axes and the temperature, with their healthy covariance"
    features = ("mean_abs_torque", "temperature")

    def columns(self, *features: np.ndarray) -> np.ndarray:
        """Put the features side by side; the torque is 0 outside the speed window.

        Returns:
            Shape (cycles, columns).
        """
        torque, temperature = features
        return super().columns(np.nan_to_num(torque), temperature)


class FrictionResidual(ByChange):
    """The change of friction terms of all axes together."""

    name = "friction residual"
    idea = (
        "friction terms in the torque of all axes, and the temperature, with their "
        "healthy covariance"
    )
    features = ("friction_terms", "temperature")


FRICTION = FrictionResidual.name
"""Name of the best of them."""

ISOLATORS = registered(
    Isolator,  # type: ignore[type-abstract]
    GROUP,
    (
        TransferEntropy10,
        TransferEntropy5,
        CrossCorrelation,
        CrossCorrelationAsPrinted,
        OwnTorque,
        AllTorques,
        FrictionResidual,
    ),
)
"""Every isolator by its name, in the order of the tables."""

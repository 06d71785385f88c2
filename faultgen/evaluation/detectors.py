"""The detectors of `faultgen detect`. Each is a class and one line of the table `DETECTORS`.

They learn from healthy cycles. Their limits are meant for one false alarm in 1000 cycles.

Installed packages can add detectors. Such a package declares an entry point of the group
``faultgen.detectors``, which names a subclass of `faultgen.evaluation.Detector` or a list of them.
docs/extending.md shows both ways. The detectors of hours of the study `detection` are in
`faultgen.studies.chapter3_detection.detectors`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from faultgen.analysis.detection import CUSUMChart, EWMAChart
from faultgen.analysis.divergence import kl_divergence
from faultgen.analysis.pca import PCAMonitor
from faultgen.evaluation.isolators import AllTorques, ByChange, FrictionResidual, OwnTorque
from faultgen.evaluation.methods import CYCLES, Detector, registered
from faultgen.plugins import DETECTORS as GROUP

RUN_LENGTH = 1000.0
"""Mean number of cycles between false alarms for which detectors are set."""

_CONFIDENCE = 1 - 1 / RUN_LENGTH


class HistogramPCA(Detector):
    """Q of a PCA of the divergences of the torque histograms."""

    name = "KL + PCA, Q"
    idea = "KL divergence of each axis' torque histogram from the healthy one; Q of a PCA"
    features = ("torque_histogram",)
    rows = (CYCLES,)

    def fit(self, *healthy: Sequence[np.ndarray]) -> None:
        """Learn the healthy histogram, and the components.

        Args:
            healthy: Torque histograms of each series.
        """
        (histograms,) = healthy
        counted = [self.setting.samples * series for series in histograms]
        self._healthy = np.sum([series.sum(axis=0) for series in counted], axis=0)
        self._pca = PCAMonitor(n_components=0.75, confidence=_CONFIDENCE)
        self._pca.fit(np.vstack([self._divergence(series) for series in histograms]))
        self.limit_ = self._pca.q_limit_

    def score(self, *features: np.ndarray) -> np.ndarray:
        """Compute Q of each cycle.

        Returns:
            Shape (cycles,).
        """
        return self._pca.q(self._divergence(features[0]))

    def _divergence(self, histograms: np.ndarray) -> np.ndarray:
        return kl_divergence(self.setting.samples * histograms, self._healthy, smoothing=0.5)


class TorquePCA(Detector):
    """The larger of T² and Q of a PCA of the mean torques, each over its limit."""

    name = "PCA, T² and Q"
    idea = "mean |torque| of all axes, and the temperature where it is measured"
    features = ("mean_abs_torque", "temperature")
    rows = (CYCLES,)

    def fit(self, *healthy: Sequence[np.ndarray]) -> None:
        """Learn the components.

        Args:
            healthy: Mean |torque| and temperature of each series.
        """
        self._pca = PCAMonitor(n_components=0.9, confidence=_CONFIDENCE)
        self._pca.fit(np.vstack([self._columns(*one) for one in zip(*healthy, strict=True)]))
        self.limit_ = -self._pca.offset_

    def score(self, *features: np.ndarray) -> np.ndarray:
        """Compute the larger of T² and Q of each cycle, each over its limit.

        Returns:
            Shape (cycles,).
        """
        return -self._pca.score_samples(self._columns(*features))

    def _columns(self, torque: np.ndarray, temperature: np.ndarray) -> np.ndarray:
        values = np.nan_to_num(torque)
        varies = self.setting.temperature_varies
        return np.hstack([values, temperature[:, None]]) if varies else values


class Charts(Detector):
    """A two-sided chart of the mean torque of each axis."""

    features = ("mean_abs_torque",)
    rows = (CYCLES,)
    chart: ClassVar[type[EWMAChart] | type[CUSUMChart]]

    def fit(self, *healthy: Sequence[np.ndarray]) -> None:
        """Learn the charts of all axes whose torque varies.

        Args:
            healthy: Mean |torque| of each series.
        """
        torque = np.nan_to_num(np.vstack(healthy[0]))
        self._charts = {}
        for axis in np.flatnonzero(np.ptp(torque, axis=0) > 0):
            chart = self.chart(
                in_control_run_length=RUN_LENGTH * self.setting.n_axes, two_sided=True
            )
            self._charts[int(axis)] = chart.fit(torque[:, axis])
        # all charts have the same settings, and therefore the same limit
        self.limit_ = max((chart.limit_ for chart in self._charts.values()), default=np.inf)

    def score(self, *features: np.ndarray) -> np.ndarray:
        """Compute the largest |statistic| of the axes in each cycle.

        Returns:
            Shape (cycles,).
        """
        torque = np.nan_to_num(features[0])
        statistics = [
            np.abs(chart.statistic(torque[:, axis])) for axis, chart in self._charts.items()
        ]
        return np.max(statistics, axis=0) if statistics else np.zeros(len(torque))


class EWMA(Charts):
    """Exponentially weighted moving averages."""

    name = "EWMA"
    idea = "mean |torque| of each axis, two-sided charts"
    chart = EWMAChart


class CUSUM(Charts):
    """Cumulative sums."""

    name = "CUSUM"
    idea = "mean |torque| of each axis, two-sided charts"
    chart = CUSUMChart


class ByIsolator(Detector):
    """An alarm if an isolator calls any axis worn."""

    rows = (CYCLES,)
    isolator: ClassVar[type[ByChange]]

    def fit(self, *healthy: Sequence[np.ndarray]) -> None:
        """Let the isolator learn.

        Args:
            healthy: Features of the isolator, of each series.
        """
        self._isolator = self.isolator(self.setting)
        self._isolator.fit(*healthy)
        self.limit_ = self._isolator.change.limit_

    def score(self, *features: np.ndarray) -> np.ndarray:
        """Compute the largest z of the axes. There is none before the first window is full.

        Returns:
            Shape (cycles,).
        """
        cycles = len(features[0])
        scores = np.full(cycles, -np.inf)
        for end in range(self._isolator.change.window, cycles + 1):
            scores[end - 1] = self._isolator.isolate(*(one[:end] for one in features)).z.max()
        return scores


class OwnTorqueWorn(ByIsolator):
    """An alarm if the isolator 'own torque' calls any axis worn."""

    name, idea, features = OwnTorque.name, OwnTorque.idea, OwnTorque.features
    isolator = OwnTorque


class AllTorquesWorn(ByIsolator):
    """An alarm if the isolator 'all torques' calls any axis worn."""

    name, idea, features = AllTorques.name, AllTorques.idea, AllTorques.features
    isolator = AllTorques


class FrictionWorn(ByIsolator):
    """An alarm if the isolator 'friction residual' calls any axis worn."""

    name, idea, features = FrictionResidual.name, FrictionResidual.idea, FrictionResidual.features
    isolator = FrictionResidual


DETECTORS = registered(
    Detector,  # type: ignore[type-abstract]
    GROUP,
    (
        HistogramPCA,
        TorquePCA,
        EWMA,
        CUSUM,
        OwnTorqueWorn,
        AllTorquesWorn,
        FrictionWorn,
    ),
)
"""Every detector by its name, in the order of the tables."""

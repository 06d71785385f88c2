"""Methods that do not look at the data: what every other method must surpass.

They take part in the benchmark. Its score gives 0 to each of them, and to any other answer that
does not depend on the data.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from faultgen.evaluation.methods import CYCLES, Detector, Isolator, LabelledRun

# a method must name a feature, although only the number of cycles is used
_FEATURE = ("temperature",)


class AlwaysNone(Isolator):
    """Never names an axis."""

    name = "always none"
    idea = "baseline: says of every robot that nothing is worn"
    features = _FEATURE
    learns = False

    def fit(self, *healthy: Sequence[np.ndarray]) -> None:
        """Learn nothing."""

    def isolate(self, *features: np.ndarray) -> int:
        """Name no axis."""
        return -1


class AlwaysOneAxis(Isolator):
    """Names the same axis of every robot."""

    name = "always one axis"
    idea = "baseline: names the first axis that wears in the training part, of every robot"
    features = _FEATURE
    learns = False
    supervised = True

    def fit(self, *healthy: Sequence[np.ndarray]) -> None:
        """Learn nothing from healthy cycles; see `learn`."""

    def learn(self, runs: Sequence[LabelledRun]) -> None:
        """Take the first axis that wears.

        Args:
            runs: Runs of the training part.

        Raises:
            ValueError: No run is worn.
        """
        axes = {axis for run in runs for axis in run.axes}
        if not axes:
            raise ValueError("no training run is worn")
        self._axis = min(axes)

    def isolate(self, *features: np.ndarray) -> int:
        """Name this axis."""
        return self._axis


class NeverAnAlarm(Detector):
    """Never raises an alarm."""

    name = "never an alarm"
    idea = "baseline: calls every cycle healthy"
    features = _FEATURE
    learns = False
    rows = (CYCLES,)
    limit_ = 0.0
    _score = -1.0

    def fit(self, *healthy: Sequence[np.ndarray]) -> None:
        """Learn nothing."""

    def score(self, *features: np.ndarray) -> np.ndarray:
        """Score every cycle alike.

        Returns:
            Shape (cycles,).
        """
        return np.full(len(features[0]), self._score)


class AlwaysAnAlarm(NeverAnAlarm):
    """Raises an alarm in every cycle."""

    name = "always an alarm"
    idea = "baseline: calls every cycle abnormal"
    _score = 1.0


ISOLATION_BASELINES = (AlwaysNone, AlwaysOneAxis)
"""Baselines of the leader board of isolators."""

DETECTION_BASELINES = (NeverAnAlarm, AlwaysAnAlarm)
"""Baselines of the leader board of detectors."""

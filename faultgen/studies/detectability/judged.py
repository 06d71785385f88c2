"""How the detectors of the package do at severities that the ideal detector would see.

They get what a monitoring system stores of every logged cycle. Their thresholds are set so that
each of them raises an alarm on one healthy day in thirty.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from faultgen.evaluation.calls import create, fit, score
from faultgen.evaluation.detectors import DETECTORS
from faultgen.evaluation.features import Features
from faultgen.evaluation.methods import CYCLES, Detector, needed
from faultgen.monitoring.environment import Surroundings
from faultgen.monitoring.sensors import Sensors
from faultgen.studies.chapter6_isolation.monitored import Monitored
from faultgen.studies.detectability.disturbed import Before
from faultgen.studies.detectability.ideal import BASELINE, DETECTED, FALSE_ALARM, LOGGED

HISTORY = 24
"""Healthy cycles before a day that is judged."""

_POOL = 300  # healthy cycles, of which those before a day are chosen
_FEWEST = 5  # days for each severity
_APART = 0.1  # memory of the temperature from one logged cycle to the next [cycles]: hours apart


@dataclass(frozen=True, eq=False)
class Judged:
    """Fitted detectors with their thresholds."""

    monitored: Monitored
    """The robot at its task."""
    sensors: Sensors
    """Noise and disturbances of logged cycles."""
    detectors: dict[str, Detector]
    """Fitted detectors by name."""
    threshold: dict[str, float]
    """Score above which each raises an alarm."""
    left_out: dict[str, str]
    """Detectors that cannot be used, and why."""
    before: Before
    """What the cycles before leave in the logged ones."""
    history: Features
    """Features of healthy cycles, of which some come before each day."""

    def share(
        self, change: np.ndarray, days: int, rng: np.random.Generator, names: Collection[str]
    ) -> dict[str, float]:
        """Measure on how many days a change raises an alarm.

        It stops early if no detector can reach `DETECTED` any more.

        Args:
            change: Change of a cycle, shape (3, samples, n_axes), at the rate of the log.
            days: Number of days.
            rng: Source of randomness.
            names: Detectors that are asked.

        Returns:
            Share of the days by detector.
        """
        asked = replace(self, detectors={name: self.detectors[name] for name in names})
        alarms: dict[str, list[bool]] = {name: [] for name in names}
        most_missed = int((1 - DETECTED) * days + 1e-9)
        for day in range(1, days + 1):
            for name, top in _tops(asked, asked.series(change, rng)).items():
                alarms[name].append(top > self.threshold[name])
            if day >= _FEWEST and all(day - sum(one) > most_missed for one in alarms.values()):
                break
        return {name: float(np.mean(one)) for name, one in alarms.items()}

    def series(self, change: np.ndarray | None, rng: np.random.Generator) -> Features:
        """Put some healthy cycles before a day with a change.

        Args:
            change: As for `share`; None for a healthy day.
            rng: Source of randomness.

        Returns:
            Features of the cycles, with the shapes of `FEATURES`.
        """
        day = self.observe(LOGGED, rng, change)
        chosen = rng.choice(_POOL, HISTORY, replace=False)
        return {name: np.concatenate([self.history[name][chosen], day[name]]) for name in day}

    def observe(
        self, cycles: int, rng: np.random.Generator, change: np.ndarray | None = None
    ) -> Features:
        """Observe logged cycles, each after another cycle.

        Args:
            cycles: Number of cycles.
            rng: Source of randomness.
            change: Change of the cycles of the last day, as for `share`; None: they are healthy.

        Returns:
            Features of the cycles, with the shapes of `FEATURES`.
        """
        rng_before, rng_cycles = rng.spawn(2)
        changed = (np.arange(cycles) >= cycles - LOGGED).astype(float)
        names = needed(self.detectors.values())
        weights: list[np.ndarray] = []

        def further(around: Surroundings, part: slice) -> np.ndarray:
            if not weights:  # the same draw for all parts
                weights.append(self.before.changes(around, rng_before))
            found = np.tensordot(weights[0][part], self.before.nodes, axes=1)
            if change is not None:
                found += np.multiply.outer(changed[part], change)
            return found

        severity = np.zeros((cycles, self.monitored.surrogate.n_axes))
        return self.monitored.observe(self.sensors, severity, rng_cycles, names, further)


def _tops(judged: Judged, seen: Features) -> dict[str, float]:
    """Largest score of each detector on the last day."""
    return {name: float(score(one, seen)[-LOGGED:].max()) for name, one in judged.detectors.items()}


def judged(
    monitored: Monitored, sensors: Sensors, days: int, rng: np.random.Generator, before: Before
) -> Judged:
    """Fit all detectors on healthy cycles, and find their thresholds.

    Args:
        monitored: The robot at its task.
        sensors: Noise and disturbances.
        days: Number of healthy days from which thresholds are found.
        rng: Source of randomness.
        before: What the cycles before leave in the logged ones.

    Returns:
        The detectors.
    """
    sensors = replace(sensors, temperature_memory=_APART)
    setting = monitored.setting(temperature_varies=sensors.changes_motion)
    detectors = {
        name: create(kind, setting)
        for name, kind in DETECTORS.items()
        if CYCLES in kind.rows and not kind.supervised
    }
    left_out: dict[str, str] = {}
    ready = Judged(monitored, sensors, detectors, {}, left_out, before, {})
    healthy = ready.observe(BASELINE, rng)
    ready = replace(ready, history=ready.observe(_POOL, rng))
    for name, one in list(detectors.items()):
        try:
            fit(one, [healthy] if one.learns else [])
        except ValueError as error:
            left_out[name] = str(error)
            del detectors[name]
    tops = [_tops(ready, ready.series(None, rng)) for _ in range(days)]
    limits = {
        name: float(np.quantile([top[name] for top in tops], 1 - FALSE_ALARM)) for name in detectors
    }
    return replace(ready, threshold=limits)


def smallest(severities: Sequence[float], shares: Sequence[float]) -> float | None:
    """Find the severity from which on an alarm is raised often enough.

    Between two severities, the share is interpolated over the logarithm of the severity.

    Args:
        severities: Ascending.
        shares: Share of days with an alarm, for each.

    Returns:
        The severity; None if the largest one is not detected.
    """
    enough = [share >= DETECTED for share in shares]
    if not enough or not enough[-1]:
        return None
    first = len(enough) - enough[::-1].index(False) if False in enough else 0
    if first == 0:
        return float(severities[0])
    low, high = shares[first - 1], shares[first]
    way = (DETECTED - low) / max(high - low, 1e-9)
    return float(severities[first - 1] * (severities[first] / severities[first - 1]) ** way)

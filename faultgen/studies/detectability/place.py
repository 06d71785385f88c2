"""What all effects on one robot at one task share: its cycles, and all detectors."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from faultgen.effects import EFFECTS
from faultgen.evaluation.places import place_name
from faultgen.monitoring.sensors import Sensors
from faultgen.simulation.nominal import nominal
from faultgen.simulation.state import Condition
from faultgen.simulation.surrogate import Surrogate
from faultgen.studies.chapter6_isolation.monitored import Monitored
from faultgen.studies.detectability.disturbed import Before, disturbances, draw
from faultgen.studies.detectability.ideal import LOGGED, MatchedFilter, matched_filter
from faultgen.studies.detectability.judged import Judged, judged
from faultgen.studies.detectability.limits import Bench
from faultgen.studies.detectability.trained import BEFORE, LearnedDetector
from faultgen.studies.detectability.training import learned_detector
from faultgen.studies.detectability.views import views


@dataclass(frozen=True)
class Size:
    """Amount of random data for each robot and task."""

    healthy_days: int
    """Days from which the thresholds of the detectors are found, and false alarms counted."""
    days: int
    """Days for each effect, axis and severity."""
    trained_days: int
    """The same for the detector of `faultgen train`."""
    quick: bool = False
    """Whether to look at few effects only."""


FULL = Size(healthy_days=200, days=20, trained_days=40)
QUICK = Size(healthy_days=60, days=20, trained_days=20, quick=True)


@dataclass(frozen=True)
class Healthy:
    """Alarms of the detector of `faultgen train` on healthy days."""

    days: int
    """Number of days."""
    stated: int
    """Days with an alarm at the limit that the detector states."""
    alarms: int
    """The same at the limit that was set on other healthy days."""
    raised: float
    """This limit over the stated one."""


@dataclass(frozen=True, eq=False)
class Place:
    """What the jobs of one robot and task share."""

    bench: Bench
    """The robot at its task."""
    healthy: np.ndarray
    """A healthy cycle, shape (3, samples, n_axes): position [rad], velocity [rad/s] and torque
    [N m] of the motors."""
    filters: dict[str, MatchedFilter]
    """The ideal detector of each view, by name."""
    trained: LearnedDetector
    """The detector of `faultgen train`."""
    false_alarms: Healthy
    """Its alarms on healthy days."""
    judged: Judged
    """The detectors of `faultgen detect`."""


_LATEST: dict[tuple[Any, ...], Place] = {}
"""The place of the last job, which the next one usually shares."""


def place_of(
    robot: str,
    task: str,
    surrogate: Path,
    sensors: Sensors,
    effects: Sequence[str],
    size: Size,
    seed: int,
) -> Place:
    """Prepare a robot and task, or return that of the last call if it is the same.

    Args:
        robot: Name of the robot, or path of its MJCF file or folder.
        task: Name of the task, or path of its file.
        surrogate: File of its interpolated cycles.
        sensors: Noise and disturbances.
        effects: Names of the effects that the detector of `faultgen train` learns.
        size: Amount of random data.
        seed: Root seed of all random draws.

    Returns:
        What all effects share.
    """
    key = (robot, task, surrogate, repr(sensors), tuple(effects), size, seed)
    if key in _LATEST:
        return _LATEST[key]
    _LATEST.clear()
    ways = views(sensors)
    bench = Bench.of(robot, task, ways[0].sample_period)
    period = ways[0].sample_period
    shared = nominal(robot, task, period)
    healthy = bench.cycle(Condition(bench.robot.friction_temperature))
    rng = np.random.default_rng([seed, *number_of(*place_name(robot, task))])
    rng_drawn, rng_days, rng_trained = rng.spawn(3)
    drawn = draw(bench, sensors, rng_drawn)
    filters = {
        view.name: matched_filter(
            view,
            bench.robot,
            healthy,
            disturbances(view, drawn),
            shared.mean_torque,
            step=bench.step,
        )
        for view in ways
    }
    cycles = Surrogate.load(surrogate)
    before = Before.of(shared, sensors, cycles.temperatures, period)
    ready = judged(Monitored.of(cycles), sensors, size.healthy_days, rng_days, before)
    trained = learned_detector(
        bench,
        task,
        ways[0],
        healthy,
        drawn,
        shared.mean_torque,
        [EFFECTS[name] for name in effects],
        rng_trained,
    )
    numbers = trained.recordings(size.healthy_days, BEFORE + LOGGED, rng_trained)
    tops = trained.tops(trained.pool[numbers])
    trained = trained.with_limit_of(size.healthy_days, rng_trained)
    limit = trained.detector.posterior.limit_
    told = Healthy(
        days=len(tops),
        stated=int((tops > trained.stated).sum()),
        alarms=int((tops > limit).sum()),
        raised=limit / trained.stated,
    )
    _LATEST[key] = Place(bench, healthy, filters, trained, told, ready)
    return _LATEST[key]


def number_of(*words: object) -> list[int]:
    """Return numbers that depend on some words, for seeds."""
    digest = hashlib.sha256(" ".join(map(str, words)).encode()).digest()
    return [int.from_bytes(digest[:4]), int.from_bytes(digest[4:8])]

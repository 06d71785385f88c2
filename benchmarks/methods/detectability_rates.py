"""Do the limits of the map of detectability hold on data of `faultgen generate`?

    python -m benchmarks.methods.detectability_rates [--robot puma560] [--task pick_and_place]
        [--cells friction_wear:1,backlash:1] [--healthy 1200] [--days 60] [--seed 7]
        [--quick] [--only ideal or train]

For each cell, the smallest severity that the map states is found as the study finds it: for the
ideal detector, for that of `faultgen train`, which learns all effects of the cells on all axes, and
for every detector of `faultgen detect` that sees the effect. Then runs are generated
with the sensors 'realistic', of consecutive cycles at this constant severity. Every second cycle of
them is logged, and they are put into another order, because cycles are logged hours apart. Days of
eight logged cycles are compared with 120 healthy ones, and alarms are counted. The detector of
`faultgen train` has learned from healthy cycles of the study. It finds each generated cycle by its
measured positions, as `faultgen judge` does; 24 healthy cycles come before each day.

Printed as Markdown: alarms on healthy days (1 in 30 is promised) and on days with the fault (95 %
are promised), each with its 95 % interval (Wilson); for `train`, also how many alarms at the end of
a day name effect and axis, or the axis. Its alarms on healthy days are also counted at the limit
that it states itself, which the map raises until it keeps the promise on days of the study.
Healthy days and those with a fault are the
same for all detectors, but the cycles are others than those with which the map was made.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
from scipy.stats import norm
from threadpoolctl import threadpool_limits

from faultgen.dataset.experiment import make_experiment
from faultgen.dataset.interpolated import interpolated
from faultgen.dataset.planning import plan_runs
from faultgen.dataset.run import prepare
from faultgen.effects import get_effect
from faultgen.errors import InputError
from faultgen.evaluation.calls import score
from faultgen.evaluation.features import Features, features
from faultgen.evaluation.methods import needed
from faultgen.evaluation.places import place_name
from faultgen.evaluation.shares import wilson
from faultgen.monitoring.sensors import SENSORS, Measured, measure
from faultgen.recordings.recording import Recording
from faultgen.simulation.nominal import nominal
from faultgen.simulation.stepping import simulate
from faultgen.simulation.surrogate import surrogate_file
from faultgen.studies.detectability.ideal import (
    BASELINE,
    FALSE_ALARM,
    LOGGED,
    MatchedFilter,
    of_day,
)
from faultgen.studies.detectability.judged import HISTORY
from faultgen.studies.detectability.limits import find_limit
from faultgen.studies.detectability.place import (
    FULL,
    QUICK,
    Place,
    Size,
    number_of,
    place_of,
)
from faultgen.studies.detectability.study import effects_to_map, tried
from faultgen.studies.detectability.trained import BEFORE
from faultgen.studies.detectability.views import REFERENCE
from faultgen.studies.runner import REPORT_SEED
from faultgen.twin.alignment import find_cycles

CELLS = (
    "payload_mass:6,friction_wear:1,backlash:1,gear_stiffness:2,torque_ripple:3,torque_constant:2,"
    "delay:1,torque_offset:4"
)
"""Cells that are tried: of every kind of effect at least one, as effect:axis."""
SENSORS_NAME = "realistic"
_EVERY = 2  # every so many-th cycle is logged, so that the cycle before is another one


def main() -> None:
    """Try every cell."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robot", default="puma560")
    parser.add_argument("--task", default="pick_and_place")
    parser.add_argument("--cells", default=CELLS)
    parser.add_argument("--healthy", type=int, default=1200, help="healthy logged cycles")
    parser.add_argument("--days", type=int, default=60, help="days for each cell")
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--only", choices=["ideal", "train"], help="only one detector")
    parser.add_argument("--quick", action="store_true", help="thresholds of the quick study")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, threadpool_limits(1):
        surrogate = surrogate_file(Path(folder), args.robot, args.task)
        size = QUICK if args.quick else FULL
        names = [cell.split(":")[0] for cell in args.cells.split(",")]
        effects = [effect.name for effect in effects_to_map(False, names)]
        sensors = SENSORS[SENSORS_NAME]
        if args.only == "ideal":  # no thresholds are needed
            size, effects = Size(healthy_days=1, days=1, trained_days=1), effects[:1]
        place = place_of(args.robot, args.task, surrogate, sensors, effects, size, REPORT_SEED)
        trial = _Trial(place, args.robot, args.task, args.seed)
        healthy = trial.logged(None, args.healthy)
        if args.only != "ideal":
            scores = trial.day_scores(healthy, None)
            count = int((place.trained.tops(scores) > place.trained.stated).sum())
            print(f"train, at its stated limit, healthy days: {_share(count, len(scores))}\n")
        print("| detector | effect, axis | severity | healthy days | days with the fault | named |")
        print("|" + " --- |" * 6)
        for cell in args.cells.split(","):
            effect, axis = get_effect(cell.split(":")[0]), int(cell.split(":")[1])
            found = find_limit(effect, axis, place.bench, partial(_distance, place))
            if found.severity is None:
                print(f"| ideal | {cell} | not seen | | |")
                continue
            # the random numbers of the map, so that its limits are tried
            words = number_of(*place_name(args.robot, args.task), effect.name, axis)
            rng = np.random.default_rng([REPORT_SEED, *words])
            limits: dict[str, float | None] = {}
            if args.only != "train":
                limits["ideal"] = found.severity
            if args.only != "ideal":
                limits["train"] = place.trained.limit(
                    effect,
                    axis,
                    place.bench,
                    first=found.severity,
                    days=size.trained_days,
                    rng=rng.spawn(1)[0],
                )["severity"]
            if args.only is None:
                limits |= tried(place, effect, axis, found.severity, size.days, rng)
            for name, severity in limits.items():
                if severity is None:
                    print(f"| {name} | {cell} | not seen | | | |", flush=True)
                    continue
                worn = trial.logged((effect.name, axis, severity), args.days * LOGGED)
                shares = [
                    trial.alarms(name, healthy, one, effect.name, axis, severity)
                    for one in (None, worn)
                ]
                cells = [_share(sum(one), len(one)) for one in shares]
                told = ""
                if name == "train":
                    called = place.trained.names(effect.name, axis, trial.day_scores(healthy, worn))
                    told = f"{called['named']:.0%}; axis {called['axis_named']:.0%}"
                    told += f"; else {called['called']}" if called["called"] else ""
                cells.append(told)
                print(f"| {name} | {cell} | {severity:.3g} | {' | '.join(cells)} |", flush=True)


def _share(count: int, of: int) -> str:
    low, high = wilson(count, of)
    return f"{count} of {of} [{low:.2f}, {high:.2f}]"


def _distance(place: Place, cycle: np.ndarray) -> float:
    return of_day(place.filters[REFERENCE].distance(cycle - place.healthy))


class _Logged:
    """Whitened torque, scores of the detector of train, and features of logged cycles."""

    def __init__(self, white: np.ndarray, scores: np.ndarray, seen: Features) -> None:
        self.white, self.scores, self.seen = white, scores, seen


class _Trial:
    """Generated cycles of one robot and task."""

    def __init__(self, place: Place, robot: str, task: str, seed: int) -> None:
        self.place, self.robot, self.task, self.seed = place, robot, task, seed
        self.rng = np.random.default_rng(seed)
        self.period = place.judged.monitored.surrogate.sample_period

    def logged(self, fault: tuple[str, int, float] | None, cycles: int) -> _Logged:
        """Generate a run, and keep what is logged of every second cycle."""
        self.seed += 1
        name, axis, severity = fault or ("friction_wear", 1, 0.0)
        entries = {
            "robot": self.robot,
            "task": self.task,
            "effect": name,
            "axis": axis,
            "schedule": [severity] * (_EVERY * cycles),
            "cycles": _EVERY * cycles,
            "sensors": SENSORS_NAME,
            "seed": self.seed,
            "signals": "none",
            "healthy": False,
            "fidelity": "interpolated",
        }
        (run,) = plan_runs(make_experiment(entries))
        ready = prepare(run)
        try:
            cycles_of = interpolated(ready.course, ready.shared).cycles()
        except InputError:  # the severity is too large for it
            plants = ready.course.plants(ready.shared.robot)
            cycles_of = simulate(
                ready.shared.robot, ready.shared.control, plants, sample_period=self.period
            )
        measured = ready.course.around.measured_temperature
        expected = self._expected(measured[_EVERY - 1 :: _EVERY])
        white, scores, parts = [], [], []
        judged = self.place.judged
        limits = nominal(self.robot, self.task, self.period).limits
        names = needed(judged.detectors.values())
        for k, cycle in enumerate(cycles_of):
            if k % _EVERY < _EVERY - 1:
                continue
            seen = measure(
                ready.sensors,
                cycle.motor_position,
                cycle.motor_velocity,
                cycle.motor_torque,
                gear_ratio=ready.shared.robot.gear_ratio,
                encoder_counts=ready.shared.robot.encoder_counts,
                mean_torque=ready.shared.mean_torque,
                sample_period=self.period,
                rng=ready.rng_sensors,
            )
            torque = seen.motor_torque - next(expected)
            white.append(_whitened(self.place.filters[REFERENCE], torque))
            scores.append(self._scores(seen))
            terms = judged.monitored.model.friction_terms
            parts.append(features([seen], names, measured[k : k + 1], terms=terms, limits=limits))
        # logged cycles are hours apart, so that the temperatures of a day are not alike
        order = self.rng.permutation(len(white))
        by_name = {name: np.concatenate([part[name] for part in parts])[order] for name in names}
        return _Logged(np.array(white)[order], np.array(scores)[order], by_name)

    def _scores(self, seen: Measured) -> np.ndarray:
        """Reduce a logged cycle as `faultgen judge` does."""
        detector = self.place.trained.detector
        recording = Recording(
            source="a generated cycle",
            robot=detector.robot,
            side="motor",
            sample_period=self.period,
            position=seen.motor_position,
            torque=seen.motor_torque,
        )
        return detector.scores(find_cycles(recording, detector.motion)).astype(np.float32)

    def day_scores(self, healthy: _Logged, worn: _Logged | None) -> np.ndarray:
        """Scores of each day after those of healthy cycles, shape (days, recordings, columns)."""
        count = len(healthy.scores)
        day_cycles = count // 2
        source = healthy.scores[:day_cycles] if worn is None else worn.scores
        rng = np.random.default_rng(self.seed)
        found = []
        for day in range(len(source) // LOGGED):
            before = day_cycles + rng.permutation(count - day_cycles)[:BEFORE]
            today = source[day * LOGGED : (day + 1) * LOGGED]
            found.append(np.concatenate([healthy.scores[before], today]))
        return np.array(found)

    def _expected(self, temperature: np.ndarray) -> Iterator[np.ndarray]:
        """Torque of a healthy cycle at each temperature."""
        surrogate = self.place.judged.monitored.surrogate
        for one in temperature:
            weight = surrogate.cycles(np.array([one]), np.ones(1), np.zeros((1, surrogate.n_axes)))
            yield weight[0, 2]

    def alarms(
        self,
        name: str,
        healthy: _Logged,
        worn: _Logged | None,
        effect: str,
        axis: int,
        severity: float,
    ) -> list[bool]:
        """Whether each day raises an alarm; healthy days if there is no worn run."""
        if name == "train":
            trained = self.place.trained
            tops = trained.tops(self.day_scores(healthy, worn))
            return [bool(top > trained.detector.posterior.limit_) for top in tops]
        count = len(healthy.white)
        day_cycles = count // 2  # the others are what days are compared with
        source = healthy if worn is None else worn
        days = (day_cycles if worn is None else len(worn.white)) // LOGGED
        if name == "ideal":
            ideal = self.place.filters[REFERENCE]
            cycle = self.place.bench.worn(get_effect(effect), axis, severity)
            assert cycle is not None
            weight = ideal.weighed(ideal.whiten(cycle - self.place.healthy))
            distance = ideal.distance(cycle - self.place.healthy)
            own, other = healthy.white @ weight / distance, source.white @ weight / distance
            limit = norm.isf(FALSE_ALARM) * np.sqrt(1 / LOGGED + 1 / BASELINE)
        found = []
        for day in range(days):
            today = np.arange(day * LOGGED, (day + 1) * LOGGED)
            before = day_cycles + self.rng.permutation(count - day_cycles)
            if name == "ideal":
                found.append(bool(other[today].mean() - own[before[:BASELINE]].mean() > limit))
                continue
            judged = self.place.judged
            series = {
                key: np.concatenate([healthy.seen[key][before[:HISTORY]], source.seen[key][today]])
                for key in healthy.seen
            }
            top = float(score(judged.detectors[name], series)[-LOGGED:].max())
            found.append(top > judged.threshold[name])
        return found


def _whitened(ideal: MatchedFilter, torque: np.ndarray) -> np.ndarray:
    """Whiten the torque of a logged cycle, which has the rate of the log."""
    fine = np.zeros((3, len(torque) * ideal.every, torque.shape[1]))
    fine[2, :: ideal.every] = torque
    return ideal.whiten(fine).astype(np.float32)


if __name__ == "__main__":
    main()

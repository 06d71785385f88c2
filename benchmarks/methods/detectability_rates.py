"""Do the limits of the map of detectability hold on data of `faultgen generate`?

    python -m benchmarks.methods.detectability_rates [--robot puma560] [--task pick_and_place]
        [--cells friction_wear:1,backlash:1] [--healthy 1200] [--days 60] [--seed 7]
        [--quick] [--ideal]

For each cell, the smallest severity that the map states is found as the study finds it: for the
ideal detector, and for every detector of the package that sees the effect. Then runs are generated
with the sensors 'realistic', of consecutive cycles at this constant severity. Every second cycle of
them is logged, and they are put into another order, because cycles are logged hours apart. Days of
eight logged cycles are compared with 120 healthy ones, and alarms are counted.

Printed as Markdown: alarms on healthy days (1 in 30 is promised) and on days with the fault (95 %
are promised), each with its 95 % interval (Wilson). Healthy days and those with a fault are the
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
from faultgen.evaluation.shares import wilson
from faultgen.monitoring.sensors import SENSORS, measure
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
from faultgen.studies.detectability.study import (
    FULL,
    QUICK,
    REFERENCE,
    Place,
    Size,
    place_of,
    tried,
)

CELLS = (
    "payload_mass:6,friction_wear:1,backlash:1,gear_stiffness:2,torque_ripple:3,torque_constant:2,"
    "delay:1"
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
    parser.add_argument("--ideal", action="store_true", help="only the ideal detector")
    parser.add_argument("--quick", action="store_true", help="thresholds of the quick study")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, threadpool_limits(1):
        surrogate = surrogate_file(Path(folder), args.robot, args.task)
        size = QUICK if args.quick else FULL
        if args.ideal:
            size = Size(healthy_days=1, days=1)  # no thresholds are needed
        place = place_of(args.robot, args.task, surrogate, SENSORS[SENSORS_NAME], size, 2026)
        trial = _Trial(place, args.robot, args.task, args.seed)
        healthy = trial.logged(None, args.healthy)
        print("| detector | effect, axis | severity | healthy days | days with the fault |")
        print("|" + " --- |" * 5)
        for cell in args.cells.split(","):
            effect, axis = get_effect(cell.split(":")[0]), int(cell.split(":")[1])
            found = find_limit(effect, axis, place.bench, partial(_distance, place))
            if found.severity is None:
                print(f"| ideal | {cell} | not seen | | |")
                continue
            rng = np.random.default_rng([args.seed, axis])
            limits: dict[str, float | None] = {"ideal": found.severity}
            if not args.ideal:
                limits |= tried(place, effect, axis, found.severity, size.days, rng)
            for name, severity in limits.items():
                if severity is None:
                    continue
                worn = trial.logged((effect.name, axis, severity), args.days * LOGGED)
                shares = [
                    trial.alarms(name, healthy, one, effect.name, axis, severity)
                    for one in (None, worn)
                ]
                cells = [
                    f"{sum(one)} of {len(one)} [{low:.2f}, {high:.2f}]"
                    for one in shares
                    for low, high in [wilson(sum(one), len(one))]
                ]
                print(f"| {name} | {cell} | {severity:.3g} | {' | '.join(cells)} |", flush=True)


def _distance(place: Place, cycle: np.ndarray) -> float:
    return of_day(place.filters[REFERENCE].distance(cycle - place.healthy))


class _Logged:
    """Whitened torque and features of logged cycles."""

    def __init__(self, white: np.ndarray, seen: Features) -> None:
        self.white, self.seen = white, seen


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
        white, parts = [], []
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
            terms = judged.monitored.model.friction_terms
            parts.append(features([seen], names, measured[k : k + 1], terms=terms, limits=limits))
        # logged cycles are hours apart, so that the temperatures of a day are not alike
        order = self.rng.permutation(len(white))
        by_name = {name: np.concatenate([part[name] for part in parts])[order] for name in names}
        return _Logged(np.array(white)[order], by_name)

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

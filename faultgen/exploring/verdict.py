"""What the isolators say of a dataset that has the chosen fault.

The dataset is not written. Its cycles are interpolated between simulated ones, the noise is drawn
as `faultgen isolate` draws it, and each isolator learns from ten healthy series.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from faultgen.dataset.wear import severities
from faultgen.errors import InputError, MethodFailed
from faultgen.evaluation.calls import axis_of, create, fit, isolate
from faultgen.evaluation.features import Features, features
from faultgen.evaluation.isolators import ISOLATORS
from faultgen.evaluation.methods import Isolator, Setting, needed
from faultgen.evaluation.wear_model import WearModel, wear_model, wear_points
from faultgen.exploring.choice import Choice
from faultgen.exploring.cycles import Cycles
from faultgen.exploring.signals import measured, sensing
from faultgen.exploring.store import CycleArrays
from faultgen.monitoring.sensors import SENSORS
from faultgen.simulation.nominal import Nominal
from faultgen.simulation.operation import Operation
from faultgen.simulation.surrogate import simulate_at
from faultgen.viewing.playback import SAMPLE_PERIOD

WEAR = "friction_wear"
"""The effect whose directions the isolators know."""

_SERIES = 10  # healthy series from which isolators learn, as in `faultgen isolate`
_SEED = 1000
_KEPT = 4  # operations whose isolators are kept


@dataclass(frozen=True, eq=False)
class _Learned:
    """Isolators that know the healthy robot as it is operated in one way."""

    model: WearModel
    window: np.ndarray
    isolators: dict[str, Isolator]
    left_out: dict[str, str]
    names: set[str]


class Verdicts:
    """The isolators, and what they have learned of a robot and task."""

    def __init__(self, cycles: Cycles) -> None:
        """Learn nothing yet.

        Args:
            cycles: The cycles of the robot and task.
        """
        self.cycles = cycles
        self._lock = threading.Lock()
        self._models: OrderedDict[Operation, WearModel] = OrderedDict()
        self._learned: OrderedDict[tuple[Operation, int], _Learned] = OrderedDict()

    def verdict(self, choice: Choice) -> dict[str, Any]:
        """Ask every isolator about the run with the chosen fault.

        Args:
            choice: What is chosen.

        Returns:
            The noise that was drawn, and a row for each isolator: the axis that it names, 0 for
            none; whether that is right; and the friction wear that it estimates, or the reason why
            it cannot be asked.

        Raises:
            InputError: The robot cannot have the fault, or cannot be operated so.
            SimulationFailed: The simulation diverged.
        """
        self.cycles.exact(replace(choice, severity=0.0))
        self.cycles.exact(choice)
        shared = self.cycles.shared(choice.operation)
        with self._lock:
            learned = self._fitted(choice, shared)
        growth = severities(choice.schedule, choice.severity, choice.cycles)
        rng = np.random.default_rng([_SEED, 0])
        seen = self._series(choice, growth, shared, learned, rng)
        rows = [
            self._row(choice, name, learned, seen)
            for name in ISOLATORS
            if name in learned.isolators or name in learned.left_out
        ]
        return {"noise": "thesis", "series": _SERIES, "cycles": choice.cycles, "rows": rows}

    def _row(self, choice: Choice, name: str, learned: _Learned, seen: Features) -> dict[str, Any]:
        row: dict[str, Any] = {"name": name, "idea": ISOLATORS[name].idea}
        if name in learned.left_out:
            return row | {"why_not": learned.left_out[name]}
        try:
            answer = isolate(learned.isolators[name], seen)
        except (InputError, MethodFailed, ValueError) as error:
            return row | {"why_not": str(error)}
        axis = axis_of(answer) + 1
        row |= {"axis": axis, "right": axis == (choice.axis if choice.severity else 0)}
        if axis and not isinstance(answer, int):  # it estimates the severity too
            low, high = answer.interval[axis - 1].tolist()
            row["severity"] = [float(answer.severity[axis - 1]), low, high]
        return row

    def _fitted(self, choice: Choice, shared: Nominal) -> _Learned:
        key = choice.operation, choice.cycles
        if key not in self._learned:
            self._learned[key] = self._learn(choice, shared)
            if len(self._learned) > _KEPT:
                self._learned.popitem(last=False)
        return self._learned[key]

    def _learn(self, choice: Choice, shared: Nominal) -> _Learned:
        operation = choice.operation
        if operation not in self._models:
            self._models[operation] = self._wear_model(operation, shared)
            if len(self._models) > _KEPT:
                self._models.popitem(last=False)
        model = self._models[operation]
        setting = Setting(
            n_axes=shared.robot.n_axes,
            samples=shared.samples,
            reference_temperature=operation.temperature or shared.robot.friction_temperature,
            directions=model.directions,
            turning=model.turning,
        )
        left_out = {
            name: "it learns from labelled runs, which the page does not have"
            for name, kind in ISOLATORS.items()
            if kind.supervised
        }
        made = {k: create(kind, setting) for k, kind in ISOLATORS.items() if k not in left_out}
        learned = _Learned(model, shared.speed_window(None), made, left_out, needed(made.values()))
        healthy = replace(choice, severity=0.0)
        series = [
            self._series(
                healthy,
                np.zeros(choice.cycles),
                shared,
                learned,
                np.random.default_rng([_SEED, number]),
            )
            for number in range(1, 1 + _SERIES)
        ]
        for name, one in list(made.items()):
            try:
                fit(one, series if one.learns else [])
            except (ValueError, MethodFailed) as error:
                left_out[name] = str(error)
                del made[name]
        return learned

    def _wear_model(self, operation: Operation, shared: Nominal) -> WearModel:
        """How friction wear changes the features, from simulated cycles."""
        subject, robot = self.cycles.subject, shared.robot
        points = wear_points(robot, WEAR, operation.temperature)
        told = subject.name, subject.task, SAMPLE_PERIOD
        simulated = [
            self.cycles.work.do(partial(simulate_at, *told, at, operation=operation), patient=True)
            for at in points
        ]
        return wear_model(robot, np.stack(simulated), shared.speed_window(None))

    def _series(
        self,
        choice: Choice,
        growth: np.ndarray,
        shared: Nominal,
        learned: _Learned,
        rng: np.random.Generator,
    ) -> Features:
        """Features of consecutive cycles with the given severities."""
        logged = []
        for severity in growth.tolist():
            now = replace(choice, severity=severity)
            plant = sensing(shared, list(now.faults))
            clean = measured(SENSORS["thesis"], shared, self._cycle(now), rng)
            logged.append(plant.sense(clean, SAMPLE_PERIOD, rng))
        warm = choice.operation.temperature or shared.robot.friction_temperature
        return features(
            logged,
            learned.names,
            np.full(len(growth), warm),
            terms=learned.model.friction_terms,
            limits=shared.limits,
            window=learned.window,
        )

    def _cycle(self, choice: Choice) -> CycleArrays:
        found = self.cycles.near(choice)
        return (self.cycles.exact(choice) if found is None else found).arrays

"""Healthy cycles as the map of detectability logs them: each after another cycle."""

from dataclasses import replace

import numpy as np
import pytest

from faultgen.dataset.experiment import make_experiment
from faultgen.dataset.planning import plan_runs
from faultgen.dataset.run import prepare
from faultgen.effects import EFFECTS
from faultgen.monitoring.environment import Surroundings, surroundings
from faultgen.monitoring.sensors import SENSORS
from faultgen.simulation.grid import chebyshev
from faultgen.simulation.nominal import nominal
from faultgen.simulation.state import Condition
from faultgen.simulation.stepping import simulate
from faultgen.studies.detectability.disturbed import (
    Before,
    disturbances,
    draw,
    expected_cycles,
    temperature_step,
)
from faultgen.studies.detectability.ideal import View, matched_filter
from faultgen.studies.detectability.limits import Bench

PERIOD = 0.004
REALISTIC = SENSORS["realistic"]


PUMA = ("puma560", "pick_and_place")


def generated(where, bench):
    """Healthy cycles one after another, at the rate of the bench, and their surroundings."""
    entries = {"robot": where[0], "task": where[1], "axis": [1], "cycles": 60, "seed": 12}
    runs = plan_runs(make_experiment({**entries, "sensors": "realistic"}))
    course = prepare(next(run for run in runs if not run.axes)).course
    plants = course.plants(bench.robot)
    cycles = simulate(bench.robot, bench.control, plants, sample_period=bench.step)
    found = [[one.motor_position, one.motor_velocity, one.motor_torque] for one in cycles]
    return course.around, np.array(found)


def scatter(bench, found):
    """Standard deviation of the ideal detector's statistic over the promised one, on axis 1.

    The noise is left out of the generated cycles and its exact variance is added, so that few
    cycles are enough.
    """
    around, cycles = found
    view = View(name="torque", sensors=REALISTIC, sample_period=PERIOD)
    healthy = bench.cycle(Condition(bench.robot.friction_temperature))
    drawn = disturbances(view, draw(bench, REALISTIC, np.random.default_rng(0)))
    mean = nominal(*PUMA, PERIOD).mean_torque
    ideal = matched_filter(view, bench.robot, healthy, drawn, mean, step=bench.step)
    unknown = cycles[1:] - expected_cycles(bench, around.measured_temperature)[1:]
    worn = bench.worn(EFFECTS["friction_wear"], 1, 1e-3) - healthy
    weight = ideal.weighed(ideal.whiten(worn))
    spread = np.std([ideal.whiten(one) @ weight for one in unknown])
    return float(np.hypot(spread, np.sqrt(weight @ weight)) / ideal.distance(worn))


@pytest.mark.slow
def test_generated_cycles_scatter_as_the_ideal_detector_assumes(monkeypatch):
    """So its rates hold. They would not if cycles were drawn after cycles like them.

    The standard deviation of 59 cycles is uncertain by 9 %.
    """
    bench = Bench.of(*PUMA, PERIOD)
    found = generated(PUMA, bench)
    assert scatter(bench, found) < 1.16
    real = Bench.cycle
    monkeypatch.setattr(Bench, "cycle", lambda self, now, before=None: real(self, now))
    assert scatter(bench, found) > 1.25


def test_the_temperature_changes_as_in_a_generated_run():
    """The change from one cycle to the next has the standard deviation of a long run."""
    around = surroundings(REALISTIC, 50_000, 40.0, np.random.default_rng(1))
    change = np.diff(around.temperature)
    assert temperature_step(REALISTIC) == pytest.approx(change.std(), rel=0.02)


def test_logged_cycles_contain_what_the_cycle_before_left(tiny_robot_path, tiny_task_path):
    """Cycles of the surrogate with it are those of pairs that are simulated; without it, not."""
    where = tiny_robot_path, tiny_task_path
    bench, shared = Bench.of(*where, PERIOD), nominal(*where, PERIOD)
    before = Before.of(shared, REALISTIC, np.array(chebyshev(30.0, 50.0, 5)), PERIOD)
    around = Surroundings(np.full(2, 40.0), np.full(2, 40.0), np.array([1.01, 0.99]))
    rng = np.random.default_rng(3)
    steps, loads = np.random.default_rng(3).standard_normal((2, 2))
    told = np.tensordot(before.changes(around, rng), before.nodes, axes=1)
    every = round(PERIOD / bench.step)
    for k, one in enumerate(told):
        now = Condition(40.0, float(around.payload_factor[k]))
        warmer = float(temperature_step(REALISTIC) * steps[k])
        other = Condition(40.0 - warmer, float(1 + REALISTIC.payload_scatter * loads[k]))
        true = (bench.cycle(now, other) - bench.cycle(now))[2, ::every]
        assert np.linalg.norm(one[2] - true) < 0.15 * np.linalg.norm(true)


def test_the_payload_has_its_exact_variance(tiny_robot_path, tiny_task_path):
    """A heavier payload is thus seen as rarely as its scatter says, although few cycles are drawn.

    The change by one standard deviation of the payload has d' = 1 / sqrt(1 + 1 / d'^2 without it).
    """
    bench = Bench.of(tiny_robot_path, tiny_task_path, PERIOD)
    quiet = replace(REALISTIC, temperature_wander=0.0, torque_noise=1e-4)
    view = View(name="torque", sensors=quiet, sample_period=PERIOD)
    reference = Condition(bench.robot.friction_temperature)
    healthy = bench.cycle(reference)
    heavy = bench.cycle(replace(reference, payload_factor=1.01), reference) - healthy
    drawn = disturbances(view, draw(bench, quiet, np.random.default_rng(4)))
    found, bare = (
        matched_filter(view, bench.robot, healthy, rows, np.ones(2), step=bench.step)
        for rows in (drawn, [])
    )
    alone = bare.distance(heavy)
    assert alone > 10  # hardly noise, so that the scatter of the payload decides
    assert found.distance(heavy) == pytest.approx(1 / np.sqrt(1 + alone**-2), rel=0.03)


def test_nothing_is_drawn_if_all_cycles_are_the_same(tiny_robot_path, tiny_task_path):
    bench = Bench.of(tiny_robot_path, tiny_task_path, PERIOD)
    assert draw(bench, SENSORS["thesis"], np.random.default_rng(0)) is None
    assert disturbances(View(name="torque", sensors=SENSORS["thesis"]), None) == []

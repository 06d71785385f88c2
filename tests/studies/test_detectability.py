"""The map of what can be detected: the ideal detector, its limits, and the whole study."""

import csv
import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import faultgen, faultgen_here
from scipy.linalg import toeplitz

from faultgen.effects import EFFECTS
from faultgen.errors import InputError
from faultgen.monitoring.sensors import SENSORS, Sensors
from faultgen.simulation.state import Condition
from faultgen.studies import runner
from faultgen.studies.detectability.figures import FIGURES
from faultgen.studies.detectability.ideal import (
    BASELINE,
    DETECTED,
    FALSE_ALARM,
    LOGGED,
    NEEDED,
    View,
    matched_filter,
    of_day,
)
from faultgen.studies.detectability.judged import smallest
from faultgen.studies.detectability.limits import Bench, find_limit
from faultgen.studies.detectability.place import Size
from faultgen.studies.detectability.study import effects_to_map, run_detectability
from faultgen.studies.detectability.tables import goals, tables
from faultgen.studies.detectability.trained import LONGEST, LearnedDetector
from faultgen.studies.detectability.training import learned_detector
from faultgen.studies.detectability.units import in_plant_units, shown
from faultgen.studies.detectability.views import views
from faultgen.studies.figures import draw
from faultgen.studies.runner import run_study

SAMPLES, STEP = 400, 0.004
NOISE = Sensors(
    description="coloured",
    torque_noise=0.05,
    torque_correlation=0.02,
    temperature_wander=4.0,
    temperature_error=0.5,
    payload_scatter=0.01,
    quantised=True,
)
MEAN = np.array([2.0, 3.0])
ROBOT = SimpleNamespace(
    n_axes=2, encoder_counts=np.array([1000.0, 0.0]), gear_ratio=np.array([50.0, 80.0])
)


def signals(seed):
    return np.random.default_rng(seed).standard_normal((3, SAMPLES, 2))


def test_distance_is_that_of_the_covariance_of_all_samples():
    """A dense matrix of noise and disturbances gives the same d', but for the first sample."""
    warm, heavy, change = signals(1), signals(2), signals(3)
    disturbances = [0.5 * warm, 0.01 * heavy]
    view = View(name="torque", sensors=NOISE, sample_period=STEP)
    found = matched_filter(view, ROBOT, signals(0), disturbances, MEAN, step=STEP)
    blocks = [
        (0.05 * mean) ** 2 * toeplitz(np.exp(-STEP / 0.02) ** np.arange(SAMPLES)) for mean in MEAN
    ]
    covariance = np.zeros((2 * SAMPLES, 2 * SAMPLES))
    for k, block in enumerate(blocks):
        covariance[k * SAMPLES : (k + 1) * SAMPLES, k * SAMPLES : (k + 1) * SAMPLES] = block
    for size, one in ((0.5, warm), (0.01, heavy)):
        column = one[2].T.ravel()
        covariance += size**2 * np.outer(column, column)
    x = change[2].T.ravel()
    dense = np.sqrt(x @ np.linalg.solve(covariance, x))
    assert found.distance(change) == pytest.approx(dense, rel=0.01)
    # without a thermometer the whole wander of 4 K counts, so less is seen
    blind = matched_filter(view, ROBOT, signals(0), [4 * warm, 0.01 * heavy], MEAN, step=STEP)
    assert found.distance(warm) == pytest.approx(1 / 0.5, rel=0.01)  # 1 K over its error
    assert blind.distance(warm) == pytest.approx(1 / 4, rel=0.01)
    # a change that looks like what varies anyway is not seen, however large
    assert found.distance(100 * heavy) < 100 / 0.01
    assert found.distance(10 * heavy) == pytest.approx(found.distance(100 * heavy) / 10)


def test_an_encoder_adds_what_it_sees():
    """Rounded counts are as good as noise of a step over the root of 12; no counts add nothing."""
    change = signals(3)
    plain = View(name="torque", sensors=NOISE, sample_period=STEP)
    both = replace(plain, encoder=True)
    without, with_ = (
        matched_filter(view, ROBOT, signals(0), [], MEAN, step=STEP).distance(change)
        for view in (plain, both)
    )
    step = 2 * np.pi / 1000 / np.sqrt(12)
    assert with_**2 - without**2 == pytest.approx(np.sum((change[0, :, 0] / step) ** 2))


def test_rates_of_the_needed_distance():
    """A day of drawn cycles gives one false alarm a month, and is seen as often as promised."""
    rng = np.random.default_rng(0)
    needed = NEEDED * np.sqrt(1 / LOGGED + 1 / BASELINE)  # of one cycle
    assert of_day(needed) == pytest.approx(NEEDED)
    days = 20000
    noise = rng.standard_normal((days, LOGGED)).mean(axis=1)
    noise -= rng.standard_normal(days) / np.sqrt(BASELINE)
    threshold = np.quantile(noise, 1 - FALSE_ALARM)
    assert np.mean(noise + needed > threshold) == pytest.approx(DETECTED, abs=0.005)


@pytest.mark.parametrize(
    ("law", "limit"),
    [
        (lambda s: 40 * s, NEEDED / 40),
        (lambda s: 5e4 * s**2, np.sqrt(NEEDED / 5e4)),
        (
            lambda s: 900 * max(s - 0.05, 0.0),
            0.05 + NEEDED / 900,
        ),  # like play that has to be passed
        (lambda s: 0.9 * NEEDED * np.tanh(3 * s), None),  # never enough
        (lambda s: 0.0, None),
    ],
)
def test_limits_of_known_laws(law, limit):
    """The severity is found at which d' is the needed one, also if the law is not proportional."""
    effect = EFFECTS["friction_wear"]
    bench = SimpleNamespace(worn=lambda effect, axis, severity: severity)
    found = find_limit(effect, 1, bench, law)
    if limit is None:
        assert found.severity is None and found.distance < NEEDED
    else:
        assert found.severity == pytest.approx(limit, rel=0.1)
        assert found.distance >= 0.96 * NEEDED


def test_impossible_severities_are_avoided():
    """A model that diverges above some severity is tried below it."""
    effect = EFFECTS["friction_wear"]
    bench = SimpleNamespace(worn=lambda effect, axis, s: None if s > 0.08 else s)
    found = find_limit(effect, 1, bench, lambda s: NEEDED * s / 0.06)
    assert found.severity == pytest.approx(0.06, rel=0.05)
    assert find_limit(effect, 1, SimpleNamespace(worn=lambda *_: None), float).severity is None


def test_the_smallest_severity_that_a_detector_sees():
    """It lies between two tried ones; a rate that falls again does not count as seen before."""
    assert smallest([1, 4, 16], [0.2, 0.95, 1.0]) == pytest.approx(4)
    assert smallest([1, 4], [0.9, 1.0]) == pytest.approx(4**0.5)
    assert smallest([1, 4, 16], [1.0, 0.5, 1.0]) > 4
    assert smallest([1, 4], [1.0, 1.0]) == 1
    assert smallest([1, 4], [1.0, 0.9]) is None and smallest([], []) is None


def test_units_of_the_plant():
    assert in_plant_units(np.pi / 10800, "rad") == (pytest.approx(1), "arcmin")
    assert (
        shown(0.123, "1") == "12 %" and shown(0.0021, "s") == "2.1 ms" and shown(None, "1") == "-"
    )


def test_views_depend_on_the_sensors():
    """Noise that was learned at one rate is not used at another."""
    names = [view.name for view in views(SENSORS["realistic"])]
    assert "torque at 1000 Hz" in names and "without thermometer" in names
    learned = Sensors(description="", torque_noise=0.1, torque_colour=[[0.5]], sample_period=0.01)
    (only,) = views(learned)
    assert only.sample_period == 0.01
    silent = View(name="torque", sensors=SENSORS["none"])
    with pytest.raises(InputError, match="no torque noise"):
        matched_filter(silent, ROBOT, signals(0), [], MEAN, step=STEP)


def test_effects_of_sensors_have_no_place():
    names = {effect.name for effect in effects_to_map(quick=False)}
    assert {"friction_wear", "backlash", "delay"} <= names
    assert not names & {"sensor_dropout", "brake_drag", "learned_law"}
    (chosen,) = effects_to_map(quick=True, names=["torque_offset"])
    assert chosen.name == "torque_offset"
    with pytest.raises(InputError, match="maps no effect 'brake_drag'; choose from friction_wear"):
        effects_to_map(quick=False, names=["brake_drag"])


class Odds:
    """A posterior of two causes, whose log odds are sums of the scores."""

    limit_ = 5.0
    effects = SimpleNamespace(
        causes=[SimpleNamespace(label="wear"), SimpleNamespace(label="temperature")]
    )

    def strongest(self, scores):
        """The odds are sums of the scores."""
        odds = np.maximum(scores, 0.0).sum(axis=1)
        return odds.max(axis=1), odds


def scored(pool):
    """The detector of train with these scores of healthy recordings."""
    detector = SimpleNamespace(posterior=Odds())
    return LearnedDetector(detector, np.zeros((3, 4, 1)), 1, np.asarray(pool, float), 5.0)


def test_days_and_delays_of_the_detector_of_train():
    """Alarms come after the recording that reaches the limit; another temperature is none."""
    one = scored(np.zeros((300, 2)))
    numbers = one.recordings(4, 3 + LOGGED, np.random.default_rng(0))
    assert all(len(set(row)) == len(row) for row in numbers.tolist())
    for shift, alarm in (([0.62, 0.0], False), ([0.63, 0.0], True), ([0.63, 0.7], False)):
        assert (one.days(np.array(shift), numbers) == alarm).all()
    months = one.recordings(5, LONGEST, np.random.default_rng(1))
    for every in (1, 2, 7, 13, 100, LONGEST):  # recordings that reach the limit
        assert (one.delays(np.array([5.0001 / every, 0.0]), months) == every).all()
    assert np.isinf(one.delays(np.array([4.999 / LONGEST, 0.0]), months)).all()


def test_the_limit_of_train_is_raised_until_it_keeps_its_promise():
    """One healthy day in thirty exceeds it, whatever the detector states; it is never lowered."""
    rng = np.random.default_rng(2)
    one = scored(rng.exponential(1.0, (4000, 2)) * [1.0, 0.0])
    one.with_limit_of(600, np.random.default_rng(3))
    numbers = one.recordings(2000, 24 + LOGGED, np.random.default_rng(4))
    assert one.detector.posterior.limit_ > 25 and one.stated == 5.0
    assert one.days(0.0, numbers).mean() == pytest.approx(FALSE_ALARM, abs=0.02)
    quiet = scored(np.zeros((300, 2))).with_limit_of(20, rng)
    assert quiet.detector.posterior.limit_ == 5.0


@pytest.mark.slow
def test_train_judges_cycles_as_they_are_found(tiny_robot_path, tiny_task_path):
    """It learns, keeps quiet on what it learned, names wear, and does not see a late recording."""
    bench = Bench.of(tiny_robot_path, tiny_task_path, STEP)
    healthy = bench.cycle(Condition(bench.robot.friction_temperature))
    view = View(name="torque", sensors=SENSORS["thesis"], sample_period=STEP)
    wear = EFFECTS["friction_wear"]
    mean = np.abs(healthy[2]).mean(axis=0)
    rng = np.random.default_rng(5)
    told = (bench, tiny_task_path, view, healthy, None, mean)
    one = learned_detector(*told, [wear, EFFECTS["torque_ripple"]], rng)
    numbers = one.recordings(60, 24 + LOGGED, rng)
    # without differences from day to day, its own limit holds; 7 of 60 is beyond 99.5 %
    assert one.days(0.0, numbers).sum() <= 7
    worn = bench.worn(wear, 2, 0.1)
    scores = one.pool[numbers[:5]]
    scores[:, -LOGGED:] += one.shift(worn)
    assert one.names("friction_wear", 2, scores)["named"] == 1.0
    assert one.names("friction_wear", 1, scores)["axis_named"] == 0.0
    # the whole recording begins some samples later: judge finds the motion, and nothing changed
    late = np.concatenate([np.repeat(healthy[:, :1], 40, axis=1), healthy[:, :-40]], axis=1)
    seen = np.abs(one.shift(late)).max() / np.abs(one.shift(worn)).max()
    assert seen < 0.05
    assert one.shift(np.zeros_like(healthy)) is None


@pytest.mark.slow
def test_the_study_on_a_robot_of_ones_own(tiny_robot_path, tiny_task_path, tmp_path):
    """Map, table and figures are made; a further call goes on where it was, with equal numbers."""
    small = Size(healthy_days=15, days=12, trained_days=20, quick=True)
    told = {"size": small, "robots": [tiny_robot_path], "tasks": [tiny_task_path]}
    result = run_detectability(tmp_path, **told)
    rows = {(row["effect"], row["axis"]): row for row in result["rows"]}
    assert {axis for _, axis in rows} == {1, 2}
    wear = rows["friction_wear", 2]
    assert 1e-5 < wear["ideal"] < 0.2
    assert wear["views"]["torque"] == pytest.approx(wear["ideal"], rel=0.05)
    assert wear["views"]["torque and encoder"] <= wear["views"]["torque"]
    assert wear["views"]["without thermometer"] >= wear["views"]["torque"]
    # nothing that gets less than the whole log does better than the best that is possible
    seen = [x for x in wear["detectors"].values() if x is not None]
    assert seen and min(seen) > 0.7 * wear["ideal"]
    assert 0 < wear["life"]["exponential"] < 1
    told_of_wear = wear["train"]
    assert 0.7 * wear["ideal"] < told_of_wear["severity"] == wear["detectors"]["train"]
    low, middle, high = told_of_wear["delays"]["1 x limit"]
    assert 1 <= low <= middle <= high and middle <= LOGGED
    assert told_of_wear["delays"]["2 x limit"][1] <= middle
    assert told_of_wear["at_default"]["named"] > 0.9
    (seen,) = result["false_alarms"].values()
    assert seen["alarms"] <= seen["stated"] <= seen["days"] == 15
    with (tmp_path / "detectability.csv").open() as file:
        table = list(csv.DictReader(file))
    assert len(table) == len(rows) and float(table[0]["ideal"]) > 0
    page = tables({**result, "goals": goals(result)})
    assert "## What better logs contribute" in page and "backlash" in page
    assert "## The detector of `faultgen train`, by axis" in page
    draw(FIGURES, result, tmp_path / "figures")
    for name in ("ideal", "train"):
        assert (tmp_path / "figures" / f"detectability_{name}.png").is_file()
    (gone,) = (tmp_path / "cells").glob("delay_*")
    gone.unlink()
    assert run_detectability(tmp_path, **told)["rows"] == result["rows"]


@pytest.mark.slow
def test_the_command_gives_the_same_for_any_number_of_workers(
    tiny_robot_path, tiny_task_path, tmp_path
):
    """It writes its files, and prints its results as JSON."""
    command = ["study", "detectability", "--quick", "--robot", tiny_robot_path, "--json"]
    found = []
    for workers in ("1", "2"):
        out = tmp_path / workers
        done = faultgen(*command, "--task", tiny_task_path, "-o", out, "--workers", workers)
        assert done.returncode == 0, done.stderr
        found.append(json.loads(done.stdout)["rows"])
        assert (out / "tables.md").is_file() and (out / "figures").is_dir()
    assert found[0] == found[1]


def test_other_studies_take_no_sensors(tmp_path):
    done = faultgen_here("study", "isolation", "--sensors", "thesis", "-o", tmp_path / "out")
    assert done.returncode == 2 and "takes no --sensors" in done.stderr
    done = faultgen_here("study", "isolation", "--effect", "backlash", "-o", tmp_path / "out")
    assert done.returncode == 2 and "takes no --effect" in done.stderr
    where = ["--task-from", tmp_path / "a.h5", "-o", tmp_path / "out"]
    done = faultgen_here("study", "detectability", *where)
    assert done.returncode == 2 and "--task-from needs" in done.stderr


def test_a_robot_in_a_folder_has_its_own_sensors(tiny_robot_path, tmp_path, monkeypatch):
    """As for `faultgen generate`; several robots share the preset."""
    folder = tmp_path / "twin"
    folder.mkdir()
    (folder / "sensors.toml").write_text(SENSORS["thesis"].to_toml())
    seen = []

    def run(out, *, sensors, **options):
        seen.append(sensors)
        raise InputError("enough")

    parts = (run, None, None, None)
    monkeypatch.setitem(runner.PARTS, "detectability", lambda quick: parts)
    for robots in ([str(folder)], [str(tiny_robot_path)], [str(folder), "puma560"]):
        with pytest.raises(InputError, match="enough"):
            run_study("detectability", tmp_path / "out", robots=robots)
    assert seen == [SENSORS["thesis"], SENSORS["realistic"], SENSORS["realistic"]]

"""Runs whose cycles are interpolated between simulated ones."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

import faultgen.dataset.interpolated as interpolated_module
import faultgen.dataset.nodes as nodes_module
from faultgen.cli import app
from faultgen.dataset.conditions import faults_at
from faultgen.dataset.experiment import make_experiment
from faultgen.dataset.interpolated import interpolated
from faultgen.dataset.manifest import DATA_CARD
from faultgen.dataset.nodes import grid_of, grid_of_changes, nodes_of_changes
from faultgen.dataset.planning import plan_runs
from faultgen.dataset.reader import open_dataset
from faultgen.dataset.run import prepare
from faultgen.dataset.run_file import growth_of
from faultgen.dataset.sweep import generate
from faultgen.errors import InputError
from faultgen.simulation.grid import chebyshev
from faultgen.simulation.state import Condition, plant_at
from faultgen.simulation.stepping import simulate


@pytest.fixture(scope="module")
def told(tiny_robot_path, tiny_task_path):
    """Entries of a small sweep in which temperature, payload and wear change."""
    return {
        "robot": str(tiny_robot_path),
        "task": str(tiny_task_path),
        "axis": [2],
        "cycles": 90,
        "sensors": "realistic",
        "seed": 3,
        "schedule": "linear",
    }


@pytest.fixture(scope="module")
def both(told, tmp_path_factory):
    """The same sweep, stepped and interpolated."""
    found = []
    for fidelity in ("stepped", "interpolated"):
        folder = tmp_path_factory.mktemp(fidelity)
        summary = generate(make_experiment({**told, "fidelity": fidelity}), folder, progress=False)
        assert summary.failed == {}
        found.append(open_dataset(folder))
    return found


def test_the_error_is_within_the_stated_bounds(both):
    """Of all cycles together, of every single one and of every sample; and at most a tenth."""
    for stepped, run in zip(*(dataset.runs for dataset in both), strict=True):
        assert (stepped["fidelity"], run["fidelity"]) == ("stepped", "interpolated")
        error = run.read("truth/motor_torque").astype(float) - stepped.read("truth/motor_torque")
        by_cycle = np.sqrt(np.mean(error**2, axis=1))
        assert np.all(np.sqrt(np.mean(by_cycle**2, axis=0)) < run["interpolation_error"])
        assert np.all(by_cycle.max(axis=0) < run["interpolation_error_cycle"])
        assert np.all(np.abs(error).max(axis=(0, 1)) < run["interpolation_error_sample"])
        assert np.all(run["interpolation_error"] < 0.1 * run["interpolation_noise"])
        friction = run.read("truth/friction_torque").astype(float)
        friction -= stepped.read("truth/friction_torque")
        assert np.all(np.sqrt(np.mean(friction**2, axis=(0, 1))) < 0.1 * run["interpolation_noise"])


def test_runs_without_signals_are_made(told, tmp_path):
    """Also the healthy one, of which it is checked that it follows its task."""
    few = make_experiment({**told, "cycles": 3, "fidelity": "interpolated", "signals": "none"})
    assert generate(few, tmp_path / "out", progress=False).failed == {}


def test_labels_surroundings_and_noise_are_those_of_the_stepped_run(both):
    for stepped, run in zip(*(dataset.runs for dataset in both), strict=True):
        assert stepped["seed"] == run["seed"]
        for name in ("cycle/severity", "cycle/temperature", "truth/payload_mass"):
            np.testing.assert_array_equal(run.read(name), stepped.read(name))
        noise = [
            one.read("signals/motor_torque").astype(float) - one.read("truth/motor_torque")
            for one in (stepped, run)
        ]
        scale = np.asarray(run["interpolation_noise"])
        np.testing.assert_allclose(noise[1] / scale, noise[0] / scale, atol=1e-3)


def course_of(told):
    """What changes from cycle to cycle of the only run of a sweep, and its nominal cycle."""
    (run,) = plan_runs(make_experiment({**told, "fidelity": "interpolated", "healthy": False}))
    ready = prepare(run)
    return ready.course, ready.shared


def stepped_torque(course, shared):
    """Torque of all cycles of a run, one after another, shape (cycles, samples, n_axes)."""
    plants = course.plants(shared.robot)
    cycles = simulate(shared.robot, shared.control, plants, sample_period=course.run.sample_period)
    return np.stack([cycle.motor_torque for cycle in cycles])


def test_the_cycle_before_counts(told):
    """An axis that stands still at first holds a torque that depends on how it stopped.

    Cycles that ignore this are off by more than what is accepted, and those of the run are not.
    """
    course, shared = course_of({**told, "cycles": 40})
    found, true = interpolated(course, shared), stepped_torque(course, shared)
    torque = found.nodes[:, found.channels.index("motor_torque")]
    grid = len(grid_of(conditions(course), 3).nodes)
    assert len(torque) > grid  # the further nodes are the changes
    errors = [
        np.sqrt(np.mean((np.tensordot(weights, nodes, axes=1) - true) ** 2, axis=(0, 1)))
        for weights, nodes in (
            (found.weights, torque),
            (found.weights[:, :grid], torque[:grid]),
        )
    ]
    assert np.all(errors[0] < 0.1 * found.noise)
    assert np.any(errors[1] > 0.1 * found.noise)


def conditions(course):
    """Temperature, payload factor and severity of each cycle of a run, shape (cycles, 3)."""
    around = course.around
    return np.column_stack([around.temperature, around.payload_factor, growth_of(course.run)])


def test_changes_from_the_cycle_before_have_the_right_sign(told):
    """A node is a cycle after a lighter, colder or less worn one, less the same cycle after itself.

    The reverse change has about the opposite influence, so a wrong sign would be far off.
    """
    course, shared = course_of({**told, "cycles": 3})
    run, every = course.run, np.array([[40.0, 1.0, 0.0], [40.0, 1.0, 0.1]])
    changes = np.array([[0.0, 0.0, 0.0], [2.0, 0.02, 0.1]])
    grid = grid_of_changes(chebyshev(30.0, 50.0, 9), changes)
    found = nodes_of_changes(shared, run, grid, every, ("motor_torque",))[:, 0]
    nodes = grid.nodes[len(grid.temperatures) :]
    assert {(node.way, node.payload_factor > 1) for node in nodes} == {
        (None, False),
        (None, True),
        (0, False),
        (1, False),
    }
    worn = {severity: faults_at(run, severity) for severity in (0.0, 0.1)}
    checked = 0
    for node, told_change in zip(nodes, found, strict=True):
        if abs(node.temperature - 40.0) > 1e-9 or node.wear < 0:
            continue
        now = Condition(40.0, 1.0, worn[0.1] if node.way == 1 else ())
        before = {
            None: Condition(40.0, 2 - node.payload_factor),
            0: Condition(40.0 - node.wear),
            1: Condition(40.0, 1.0, worn[0.0]),
        }[node.way]
        first, *_, last = (
            cycle.motor_torque
            for cycle in simulate(
                shared.robot,
                shared.control,
                [plant_at(shared.robot, shared.robot.spec(), one) for one in (now, before, now)],
                sample_period=run.sample_period,
            )
        )
        true = last - first
        assert np.linalg.norm(true) > 1e-4
        assert np.linalg.norm(told_change - true) < 0.05 * np.linalg.norm(true)
        checked += 1
    assert checked >= 6


@pytest.mark.slow
def test_severities_that_jump(told):
    """They are interpolated within the bounds if that is possible, and else refused early."""
    rng = np.random.default_rng(2)
    jumping = {**told, "cycles": 60, "schedule": rng.uniform(0, 0.2, 60).tolist()}
    course, shared = course_of(jumping)
    found, true = interpolated(course, shared), stepped_torque(course, shared)
    error = np.stack([cycle.motor_torque for cycle in found.cycles()]) - true
    by_cycle = np.sqrt(np.mean(error**2, axis=1))
    assert np.all(np.sqrt(np.mean(by_cycle**2, axis=0)) < found.error.run)
    assert np.all(by_cycle.max(axis=0) < found.error.cycle)
    assert np.all(np.abs(error).max(axis=(0, 1)) < found.error.sample)


def test_jumps_that_cannot_be_interpolated_are_refused_early(told, monkeypatch):
    """Before the nodes and the checked cycles are simulated: at most 20 cycles are."""
    rng = np.random.default_rng(2)
    schedule = rng.uniform(0, 2e-2, 60).tolist()
    course, shared = course_of({**told, "cycles": 60, "effect": "backlash", "schedule": schedule})
    count = [0]
    real = nodes_module.simulated

    def counted(shared, period, sequences, channels):
        count[0] += sum(map(len, sequences))
        return real(shared, period, sequences, channels)

    monkeypatch.setattr(nodes_module, "simulated", counted)
    monkeypatch.setattr(interpolated_module, "simulated", counted)
    with pytest.raises(InputError, match="the severity jumps from cycle to cycle"):
        interpolated(course, shared)
    assert 0 < count[0] <= 20


@pytest.mark.slow
def test_same_bytes_for_any_number_of_workers_and_after_a_stop(told, tmp_path):
    entries = {**told, "fidelity": "interpolated", "axis": [1, 2]}
    for name, workers in (("one", 1), ("two", 2)):
        generate(make_experiment(entries), tmp_path / name, workers=workers, progress=False)
    files = sorted((tmp_path / "one" / "runs").glob("*.h5"))
    assert len(files) == 3
    again = files[1].read_bytes()
    for file in files:
        assert file.read_bytes() == (tmp_path / "two" / "runs" / file.name).read_bytes()
    files[1].unlink()
    generate(make_experiment(entries), tmp_path / "one", progress=False)
    assert files[1].read_bytes() == again


def test_runs_with_few_conditions_are_exact(told, tmp_path):
    """A constant robot needs one simulated cycle, and a step of the severity three."""
    entries = {**told, "sensors": "thesis", "schedule": "step", "cycles": 30}
    for fidelity in ("stepped", "interpolated"):
        experiment = make_experiment({**entries, "fidelity": fidelity})
        generate(experiment, tmp_path / fidelity, progress=False)
    stepped, run = (open_dataset(tmp_path / f).runs for f in ("stepped", "interpolated"))
    for one, other in zip(stepped, run, strict=True):
        np.testing.assert_array_equal(other["interpolation_error"], 0)
        torque = one.read("truth/motor_torque").astype(float)
        np.testing.assert_allclose(other.read("truth/motor_torque"), torque, atol=2e-4)


def test_an_effect_that_cannot_be_interpolated_is_refused(told, tmp_path):
    """A moved payload acts together with the payload that varies. No file is written."""
    moved = {"effect": "payload_offset", "severity": 0.4, "cycles": 60}
    entries = {**told, **moved, "fidelity": "interpolated"}
    summary = generate(make_experiment(entries), tmp_path, progress=False)
    ((run_id, reason),) = summary.failed.items()
    assert "of its noise, and at most 0.1 is accepted" in reason
    assert "fidelity 'stepped'" in reason
    assert not list((tmp_path / "runs").glob(f"{run_id}.h5*"))
    assert json.loads((tmp_path / "runs" / f"{run_id}.failed.json").read_text())["reason"]


def test_refused_before_anything_is_simulated(told, tmp_path):
    sensors = tmp_path / "sensors.toml"
    sensors.write_text("torque_noise = 0.01\n[run_to_run]\nfriction_wear = [0.01, 0.01]\n")
    with pytest.raises(InputError, match="differs from cycle to cycle in too many ways"):
        make_experiment({**told, "sensors": str(sensors), "fidelity": "interpolated"})
    with pytest.raises(InputError, match="fidelity: input should be 'stepped' or 'interpolated'"):
        make_experiment({**told, "fidelity": "fast"})


def test_the_id_tells_the_two_apart(told):
    ids = [
        {run.id for run in plan_runs(make_experiment({**told, "fidelity": fidelity}))}
        for fidelity in ("stepped", "interpolated")
    ]
    assert ids[0].isdisjoint(ids[1])
    assert ids[0] == {run.id for run in plan_runs(make_experiment(told))}


def test_tables_card_and_info_state_the_error(both):
    dataset = both[1]
    table = dataset.index
    assert set(table["fidelity"]) == {"interpolated"}
    assert ((table["interpolation_error"] > 0) & (table["interpolation_error"] < 0.1)).all()
    assert "interpolated between simulated ones" in (dataset.path / DATA_CARD).read_text()
    shown = [CliRunner().invoke(app, ["info", str(one.path)]).output for one in both]
    assert "2 runs are interpolated" in shown[1] and "interpolated" not in shown[0]

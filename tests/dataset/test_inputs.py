"""A dataset keeps copies of the user's files from which it was made."""

import shutil

import pytest

from faultgen.dataset.experiment import make_experiment
from faultgen.dataset.reader import open_dataset
from faultgen.dataset.stored_run import StoredRun
from faultgen.dataset.sweep import generate
from faultgen.errors import InputError
from faultgen.evaluation.observed_runs import places
from faultgen.monitoring.sensors import get_sensors


@pytest.fixture
def files(tiny_robot_path, tiny_task_path, tmp_path):
    """Robot, task and sensors of a user, in a folder of their own."""
    folder = tmp_path / "mine"
    folder.mkdir()
    sensors = folder / "log.toml"
    sensors.write_text(get_sensors("thesis").to_toml())
    robot, task = (shutil.copy(path, folder) for path in (tiny_robot_path, tiny_task_path))
    return {"robot": str(robot), "task": str(task), "sensors": str(sensors)}


@pytest.fixture
def folder(files, tmp_path):
    """A dataset of them."""
    generate(make_experiment({**files, "axis": [1], "cycles": 6}), tmp_path / "out", progress=False)
    return tmp_path / "out"


def judged(folder):
    return [(place.robot, place.task, len(place.runs)) for place in places(open_dataset(folder))]


def test_a_dataset_is_judged_where_its_files_are_not(files, folder, tmp_path):
    before = judged(folder)
    shutil.rmtree(tmp_path / "mine")
    moved = folder.rename(tmp_path / "elsewhere")
    assert judged(moved) == before
    shutil.rmtree(moved / "inputs")
    with pytest.raises(InputError, match="no copy of it in inputs/ beside the dataset"):
        judged(moved)


@pytest.mark.parametrize(
    ("what", "more"), [("robot", "<!-- new -->"), ("task", "# new"), ("sensors", "# new")]
)
def test_the_copy_is_used_if_a_file_was_changed(files, folder, what, more):
    with open(files[what], "a", encoding="utf-8") as file:
        file.write(more)
    (run, *_) = open_dataset(folder).runs
    assert open_dataset(folder).input_of(run, what).startswith(str(folder))
    assert judged(folder)


@pytest.mark.parametrize(
    ("what", "old", "new"),
    [("swing", "dwell = 0.1", "dwell = 0.2"), ("log", "torque_noise = 0.01", "torque_noise = 0.1")],
)
def test_a_changed_copy_is_refused(files, folder, what, old, new):
    shutil.rmtree(folder.parent / "mine")
    (copy,) = folder.glob(f"inputs/*/{what}.toml")
    changed = copy.read_text().replace(old, new, 1)
    assert changed != copy.read_text()
    copy.write_text(changed)
    with pytest.raises(InputError, match="changed since the dataset was made"):
        judged(folder)


def test_generating_again_restores_a_copy(files, folder):
    copies = sorted(folder.glob("inputs/*/*"))
    assert len(copies) == 3
    shutil.rmtree(folder / "inputs")
    assert open_dataset(folder).damaged() == {}  # as of an older version
    experiment = make_experiment({**files, "axis": [1], "cycles": 6})
    assert generate(experiment, folder, progress=False).kept == 2
    assert sorted(folder.glob("inputs/*/*")) == copies


@pytest.mark.slow
def test_robots_of_this_package_are_not_copied(tmp_path):
    experiment = make_experiment(
        {"robot": "puma560", "task": "chapter3_task1", "axis": [1], "cycles": 1}
    )
    generate(experiment, tmp_path / "out", progress=False)
    assert not (tmp_path / "out" / "inputs").exists()


def test_a_run_of_a_file_of_all_runs_by_itself_is_found(folder, tmp_path):
    (run, *_) = open_dataset(folder).runs
    lone = tmp_path / "lone"
    lone.mkdir()
    for path in folder.glob("dataset.h5*"):
        shutil.copy(path, lone)
    found = StoredRun.at(lone / "runs" / f"{run.id}.h5")
    assert found.path == lone / "dataset.h5"
    assert found["run_id"] == run.id


def test_damaged_and_lost_copies_are_named(folder):
    (task,), (model,) = folder.glob("inputs/*/swing.toml"), folder.glob("inputs/*/tiny/model.xml")
    task.unlink()
    model.write_text(model.read_text() + "\n")
    found = open_dataset(folder).damaged()
    assert found == {
        str(model.relative_to(folder)): "differs from its checksum",
        str(task.relative_to(folder)): "is missing",
    }

"""Datasets as tables for scikit-learn, pandas, xarray and Parquet."""

import itertools
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest
from conftest import contents, faultgen_here
from sklearn.ensemble import RandomForestClassifier
from sklearn.model_selection import GroupKFold, cross_val_score

from faultgen.dataset.experiment import make_experiment
from faultgen.dataset.labels import features_and_labels
from faultgen.dataset.manifest import Manifest
from faultgen.dataset.reader import open_dataset
from faultgen.dataset.splits import PARTS, make_splits
from faultgen.dataset.sweep import generate, merge_parts
from faultgen.errors import InputError
from faultgen.evaluation.benchmark import RandomForest
from faultgen.evaluation.isolate import isolate


@pytest.fixture(scope="module")
def experiment(tiny_robot_path, tiny_task_path):
    """Two axes wear, each with backlash beside; four repetitions."""
    return make_experiment(
        {
            "robot": tiny_robot_path,
            "task": tiny_task_path,
            "axis": [1, 2],
            "schedule": [0.0, 0.25, 0.5, 0.75, 1.0],
            "cycles": 5,
            "repetitions": 4,
            "sensors": "realistic",
            "beside": [{"effect": "backlash", "severity": 0.001}],
            "signals": ["signals/motor_torque"],
            "seed": 3,
        }
    )


@pytest.fixture(scope="module")
def made(experiment, tmp_path_factory):
    """A finished dataset, not to be changed."""
    folder = tmp_path_factory.mktemp("tables") / "out"
    generate(experiment, folder, progress=False)
    return folder


def test_a_row_holds_the_labels_and_features_of_a_cycle(made):
    """Every value is that of the run file, in the right row and column."""
    dataset = open_dataset(made)
    frame = dataset.to_dataframe()
    assert len(frame) == 5 * len(dataset.runs) == 60
    for run in dataset.runs:
        rows = frame[frame["run"] == run.id]
        assert set(rows["seed"]) == {run["seed"]} and set(rows["axis"]) == {run["axis"]}
        assert set(rows["effect"]) == {run["effect"]} and set(rows["robot"]) == {"tiny"}
        for column, array in {
            "cycle": run.read("cycle/index"),
            "severity": run.read("cycle/severity"),
            "temperature": run.read("cycle/temperature"),
            "mean_abs_torque_2": run.read("monitoring/mean_abs_torque")[:, 1],
            "torque_histogram_2_12": run.read("monitoring/torque_histogram")[:, 1, 11],
        }.items():
            np.testing.assert_array_equal(rows[column], array)
        for axis in (1, 2):
            told = np.zeros(5)
            if run["axis"]:
                told = run.read("cycle/fault_severity/backlash")[:, axis - 1]
            np.testing.assert_array_equal(rows[f"fault_severity_backlash_{axis}"], told)
    units = frame.attrs["units"]
    assert units["mean_abs_torque_1"] == "N m" and units["temperature"] == "degC"
    assert units["fault_severity_backlash_1"] == "rad" and units["severity"] == "1"


def test_features_of_several_robots_stand_in_one_table(made, tiny_task_path, tmp_path):
    """A robot with fewer axes has nan in the columns of the others, also as labels."""
    two = make_experiment(
        {"robot": "puma560", "task": "pick_and_place", "axis": 3, "cycles": 1, "healthy": False}
        | {"signals": "none"}
    )
    generate(two, tmp_path, progress=False)
    tables = [open_dataset(folder).to_dataframe() for folder in (made, tmp_path)]
    assert "fault_severity_friction_wear_3" in tables[1]
    assert "fault_severity_friction_wear_3" not in tables[0]
    assert tables[1].loc[0, "fault_severity_friction_wear_1"] == 0


def test_one_feature_need_not_be_in_a_list(made):
    dataset = open_dataset(made)
    for name in ("mean_abs_torque", "temperature"):
        one, listed = dataset.to_xy(features=name)[0], dataset.to_xy(features=[name])[0]
        assert one.equals(listed) and len(one.columns) in (1, 2)


def test_a_classifier_learns_from_the_training_runs(made):
    """The three lines of the README: it names the axis of other runs far better than chance."""
    dataset = open_dataset(made)
    x, y, groups = dataset.to_xy(["mean_abs_torque"], split="train", label="axis")
    x_test, y_test, groups_test = dataset.to_xy(["mean_abs_torque"], split="test", label="axis")
    x_chosen, y_chosen, groups_chosen = dataset.to_xy(split="validation", label="axis")
    assert not set(groups) & set(groups_test) and not set(groups_chosen) & {*groups, *groups_test}
    assert len(x) + len(x_chosen) + len(x_test) == 60 and set(y_chosen) == {0, 1, 2}
    assert list(x) == ["mean_abs_torque_1", "mean_abs_torque_2"]
    forest = RandomForestClassifier(random_state=0).fit(x, y)
    assert set(y_test) == {0, 1, 2} and forest.score(x_test, y_test) > 0.6
    assert len(cross_val_score(forest, x, y, groups=groups, cv=GroupKFold(3))) == 3


def test_labels_say_what_is_worn_in_each_cycle(made):
    """The schedule begins with severity 0, in which nothing is worn yet."""
    dataset = open_dataset(made)
    told = {name: dataset.to_xy(label=name)[1] for name in ("axis", "effect", "worn", "severity")}
    assert 0 < told["worn"].sum() < 40
    np.testing.assert_array_equal(told["worn"], told["severity"] >= 0.01)
    np.testing.assert_array_equal(told["axis"] > 0, told["worn"])
    np.testing.assert_array_equal(told["effect"] == "healthy", ~told["worn"])
    frame = dataset.to_dataframe()
    beside = dataset.to_xy(label="fault_severity_backlash_2")[1]
    np.testing.assert_array_equal(beside, frame["fault_severity_backlash_2"])


def table(**runs):
    """A table of cycles: severities of each run, its effect and its unit."""
    rows = []
    for name, (effect, units, severity) in runs.items():
        row = {"run": name, "effect": effect, "severity_units": units, "seed": 1, "axis": 2}
        row["axis"] *= effect != "healthy"
        rows += [row | {"cycle": k, "severity": s, "x": s} for k, s in enumerate(severity, start=1)]
    frame = pd.DataFrame(rows)
    frame.attrs |= {"features": ["x"], "units": {"x": "1"}}
    return frame


WORN = ("friction_wear", "1", [0.0, 0.00002, 0.0099, 0.01, 0.2])
PLAY = ("backlash", "rad", [0.0, 0.000019, 0.00002, 0.0001, 0.0004])
HEALTHY = ("healthy", "1", [0.0, 0.0, 0.0])


def labels(frame, label, **severities):
    return features_and_labels(frame, None, label, **severities)[1].tolist()


def test_a_trace_of_wear_does_not_count_as_worn():
    """From 1 % of a nominal value, or 5 % of the run's largest severity if it has a unit."""
    frame = table(a=WORN, b=PLAY, c=HEALTHY)
    worn = [False, False, False, True, True, False, False, True, True, True, False, False, False]
    assert labels(frame, "worn") == worn
    assert labels(frame, "axis") == [2 * one for one in worn]
    effects = np.where(worn, frame["effect"], "healthy").tolist()
    assert labels(frame, "effect") == effects
    assert labels(frame, "severity") == frame["severity"].tolist()


def test_the_smallest_severity_can_be_chosen():
    """As one number, as one for each effect, or 0, with which any severity counts."""
    alone = table(a=WORN, c=HEALTHY)
    assert labels(alone, "worn", smallest_severity=0.1) == [False] * 4 + [True] + [False] * 3
    assert sum(labels(alone, "worn", smallest_severity=0)) == 4
    both = table(a=WORN, b=PLAY, c=HEALTHY)
    chosen = labels(both, "worn", smallest_severity={"backlash": 0.0004})
    assert chosen == [False] * 3 + [True] * 2 + [False] * 4 + [True] + [False] * 3
    with pytest.raises(InputError, match="have the units 1, rad; give a value for each effect"):
        labels(both, "worn", smallest_severity=0.1)


def test_the_remaining_life_counts_the_cycles_until_failure():
    """Until the stated severity or the last cycle; censored where nothing fails."""
    frame = table(a=WORN, b=PLAY, c=HEALTHY)
    assert labels(frame, "remaining_cycles") == [4, 3, 2, 1, 0, 4, 3, 2, 1, 0, 2, 1, 0]
    nan = [np.nan] * 3
    ends = [4, 3, 2, 1, 0, 4, 3, 2, 1, 0, *nan]
    np.testing.assert_array_equal(labels(frame, "remaining_life"), ends)
    at = {"friction_wear": 0.01, "backlash": 0.001}
    chosen = labels(frame, "remaining_life", failure_severity=at)
    np.testing.assert_array_equal(chosen, [3, 2, 1, 0, 0, *[np.nan] * 5, *nan])


def test_the_labels_of_a_dataset_take_the_stated_severities(made):
    """The schedule rises from 0 to 1 in five cycles; healthy runs are censored."""
    dataset = open_dataset(made)
    frame = dataset.to_dataframe()
    chosen = dataset.to_xy(label="worn", smallest_severity=0.6)[1]
    np.testing.assert_array_equal(chosen, frame["severity"] >= 0.6)
    assert 0 < chosen.sum() < dataset.to_xy(label="worn")[1].sum()
    life = dataset.to_xy(label="remaining_life", failure_severity=0.6)[1]
    np.testing.assert_array_equal(np.isnan(life), frame["axis"] == 0)
    fails = frame.loc[frame["severity"] >= 0.6, "cycle"].min()
    faulty = frame["axis"] > 0
    np.testing.assert_array_equal(life[faulty], (fails - frame.loc[faulty, "cycle"]).clip(lower=0))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"features": ["torque"]}, "features: .* has no 'torque': choose angle_histogram"),
        ({"label": "colour"}, "label: there is no 'colour': choose worn, axis, effect"),
        ({"split": "half"}, "split: must be 'train', 'validation' or 'test', not 'half'"),
        ({"smallest_severity": -1}, "smallest_severity: must be a number of at least 0, not -1"),
        (
            {"smallest_severity": {"backlash": 1}},
            "smallest_severity: no run has the effect 'backlash', only friction_wear",
        ),
        (
            {"label": "severity", "smallest_severity": 0.1},
            "smallest_severity: the label 'severity' does not use it, only worn, axis, effect",
        ),
        (
            {"failure_severity": 0.1},
            "failure_severity: the label 'axis' does not use it, only remaining_life",
        ),
        ({"split": "train", "by": "window"}, "no division by 'window': choose run, axis"),
        ({"split": "train", "by": "task"}, "has no division by task, .* it has: run, axis"),
    ],
)
def test_what_is_not_there_is_refused(made, arguments, message):
    with pytest.raises(InputError, match=message):
        open_dataset(made).to_xy(**arguments)


def plan(axes=(1, 2, 3), seeds=4, robots=("a",), tasks=("t",), paired=False):
    """Parameters of runs as runs.json lists them."""
    runs = {}
    for robot in robots:
        for task in tasks:
            for seed in range(seeds):
                for axis in (0, *axes):
                    number = len(runs)
                    runs[f"{number:016x}"] = {
                        "robot": robot,
                        "task": task,
                        "seed": seed if paired else 1000 + number,
                        "effect": "friction_wear" if axis else "healthy",
                        "axes": [axis] if axis else [],
                        "severity": 0.1 if axis else 0.0,
                    }
    return runs


def values(runs, ids, name):
    return {str(runs[i][name]) for i in ids}


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("paired", [False, True])
def test_divisions_hold_apart_what_they_name(seed, paired):
    """No axis, robot or task is on both sides, and never a seed; every kind of run is on both."""
    runs = plan(robots=("a", "b", "c"), tasks=("t", "u"), paired=paired)
    splits = make_splits(runs, seed)
    assert set(splits) == {"run", "axis", "robot", "task"}
    for scheme, parts in splits.items():
        assert sorted(sum(parts.values(), [])) == sorted(runs)
        for one, other in itertools.combinations(("train", "validation", "test"), 2):
            assert not values(runs, parts[one], "seed") & values(runs, parts[other], "seed")
        for part in ("train", "validation"):
            if scheme in ("robot", "task"):
                assert not values(runs, parts[part], scheme) & values(runs, parts["test"], scheme)
        assert bool(parts["unused"]) == (paired and scheme != "run")
    worn = [values(runs, splits["axis"][p], "axes") - {"[]"} for p in ("train", "test")]
    assert worn[0] and worn[1] and not worn[0] & worn[1]
    for name in ("axes", "robot", "task"):
        for part in ("train", "validation", "test"):
            assert values(runs, splits["run"][part], name) == values(runs, runs, name)
    assert 0.2 < len(splits["run"]["test"]) / len(runs) < 0.4
    assert 0.15 < len(splits["run"]["validation"]) / len(runs) < 0.3


@pytest.mark.parametrize("seed", range(5))
def test_validation_runs_come_from_the_training_part(seed):
    """It never has the last training run of a fault, and the test part stays what it was."""
    assert make_splits(plan(seeds=2), seed)["run"]["validation"] == []
    runs = plan(seeds=3)
    parts = make_splits(runs, seed)["run"]
    for part in ("train", "validation", "test"):
        assert sorted(str(runs[i]["axes"]) for i in parts[part]) == ["[1]", "[2]", "[3]", "[]"]
    runs = plan(seeds=40, axes=(1, 2))
    for number, run in enumerate(runs.values()):
        run["severity"] *= 1 + number  # no two runs alike
    parts = make_splits(runs, seed)["run"]
    assert values(runs, parts["validation"], "axes") == values(runs, runs, "axes")
    assert 0.15 < len(parts["validation"]) / len(runs) < 0.3


@pytest.mark.slow
def test_a_stored_division_without_validation_goes_on_working(experiment, made, tmp_path):
    """Datasets of older versions have two parts; a validation part is refused in one line."""
    folder = Path(shutil.copytree(made, tmp_path / "out"))
    manifest = Manifest.read(folder)
    older = {
        by: {"train": parts["train"] + parts["validation"], "test": parts["test"], "unused": []}
        for by, parts in manifest.splits.items()
    }
    Manifest(manifest.runs, manifest.experiment_sha256, older).write(folder)
    generate(experiment, folder, progress=False)
    dataset = open_dataset(folder)
    assert Manifest.read(folder).splits == older and not dataset.damaged()
    assert len(dataset.to_xy(split="train")[0]) + len(dataset.to_xy(split="test")[0]) == 60
    assert set(dataset.part_of("run").values()) == {"train", "test"}
    with pytest.raises(InputError, match="its division by run has no validation runs"):
        dataset.to_xy(split="validation")
    assert isolate(dataset, methods=[RandomForest], progress=False).split == "run"


def test_divisions_come_from_the_seed():
    """The same seed gives the same ones, another seed others."""
    runs = plan(seeds=10)
    assert make_splits(runs, 1) == make_splits(runs, 1)
    assert make_splits(runs, 1)["run"] != make_splits(runs, 2)["run"]


def test_impossible_divisions_are_left_out():
    """One robot, one task, one worn axis; and twins of a single seed cannot be divided."""
    assert set(make_splits(plan(axes=(1,)), 0)) == {"run"}
    assert make_splits(plan(seeds=1, paired=True), 0) == {}
    single = make_splits(plan(seeds=1), 0)["run"]
    assert len(single["test"]) == 1, "the only healthy run is needed to learn from"


def test_divisions_are_stored_and_stay(experiment, made, tmp_path):
    """runs.json holds them under its checksum; resuming keeps those that are stored."""
    folder = Path(shutil.copytree(made, tmp_path / "out"))
    manifest = Manifest.read(folder)
    assert manifest.splits == make_splits(manifest.runs, 3)
    swapped = {
        by: {**parts, "train": parts["test"], "test": parts["train"]}
        for by, parts in manifest.splits.items()
    }
    Manifest(manifest.runs, manifest.experiment_sha256, swapped).write(folder)
    generate(experiment, folder, progress=False)
    assert Manifest.read(folder).splits == swapped
    index = open_dataset(folder / "dataset.h5").index
    assert set(index.loc[index["split_run"] == "test", "run"]) == set(swapped["run"]["test"])
    path = folder / "runs.json"
    path.write_text(path.read_text().replace('"unused"', '"ignored"'))
    with pytest.raises(InputError, match="runs.json: damaged"):
        open_dataset(folder)


def test_reading_needs_no_simulator(made):
    """Whoever only reads data does not wait until MuJoCo and the planning of motions are loaded."""
    code = (
        "import sys, faultgen\n"
        f"dataset = faultgen.open_dataset({str(made)!r})\n"
        "assert not dataset.damaged() and len(dataset.versions()) == 1\n"
        "dataset.index, dataset.to_xy(), dataset.runs[0].to_xarray()\n"
        "assert not {'mujoco', 'faultgen.robot', 'faultgen.dataset.planning'} & set(sys.modules)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_a_file_by_itself_is_a_dataset(made, tmp_path):
    """dataset.h5 with its checksum gives the same tables, runs and list as the folder."""
    for name in ("dataset.h5", "dataset.h5.sha256"):
        shutil.copy(made / name, tmp_path / name)
    alone, whole = open_dataset(tmp_path / "dataset.h5"), open_dataset(made)
    pd.testing.assert_frame_equal(alone.to_dataframe(), whole.to_dataframe())
    pd.testing.assert_frame_equal(alone.index, whole.index)
    assert alone.manifest == whole.manifest and not alone.missing and not alone.damaged()
    told = faultgen_here("info", tmp_path / "dataset.h5")
    assert told.returncode == 0 and "complete and intact" in told.stdout, told.stderr
    content = bytearray((tmp_path / "dataset.h5").read_bytes())
    content[len(content) // 2] ^= 1
    (tmp_path / "dataset.h5").write_bytes(content)
    assert faultgen_here("info", tmp_path / "dataset.h5").returncode == 2


def test_the_table_of_runs_is_in_the_merged_file(made):
    """Any HDF5 reader finds each run by its labels, and the checksum of its file."""
    with h5py.File(made / "dataset.h5") as file:
        columns = {k: v.asstr()[()] for k, v in file["index"].items() if v.dtype == object}
        axes = file["index/axis"][()]
        for number, run in enumerate(open_dataset(made).runs):
            assert columns["run"][number] == run.id and axes[number] == run["axis"]
            stored = Path(f"{run.path}.sha256").read_text().strip()
            assert columns["file_sha256"][number] == stored
        assert file["index/axis"].attrs["units"] == "1"


def test_a_table_is_read_back_from_parquet(made, tmp_path):
    """With the types, the units and a checksum; the command writes the same file."""
    frame = open_dataset(made).to_dataframe()
    open_dataset(made).to_parquet(tmp_path / "a.parquet")
    told = json.loads(
        faultgen_here("export", made, "--parquet", tmp_path / "b.parquet", "--json").stdout
    )
    assert told["rows"] == 60
    for name in ("a", "b"):
        again = pd.read_parquet(tmp_path / f"{name}.parquet")
        pd.testing.assert_frame_equal(again, frame)
        assert again.attrs["units"] == frame.attrs["units"]
        assert (tmp_path / f"{name}.parquet.sha256").is_file()


@pytest.mark.parametrize(("package", "call"), [("pyarrow", "to_parquet"), ("xarray", "to_xarray")])
def test_a_package_that_is_not_installed_is_told_in_one_line(
    made, tmp_path, monkeypatch, package, call
):
    monkeypatch.setitem(sys.modules, package, None)
    dataset = open_dataset(made)
    with pytest.raises(InputError, match=f"{package} is not installed; .*pip install {package}"):
        if call == "to_parquet":
            dataset.to_parquet(tmp_path / "a.parquet")
        else:
            dataset.runs[0].to_xarray()


def test_xarray_gets_coordinates(made):
    """Every array can be taken by axis, cycle, time and bin, and knows its unit."""
    run = open_dataset(made).runs[1]
    data = run.to_xarray()
    torque = data["signals_motor_torque"]
    assert torque.dims == ("cycle", "time", "axis") and torque.attrs["units"] == "N m"
    stored = run.read("signals/motor_torque")
    np.testing.assert_array_equal(torque.sel(axis=2, cycle=5), stored[4, :, 1])
    np.testing.assert_array_equal(torque.sel(time=0.008), stored[:, 2])
    assert data["time"].attrs["units"] == "s"
    histogram = data["monitoring_torque_histogram"].sel(axis=1, bin=12)
    np.testing.assert_array_equal(histogram, run.read("monitoring/torque_histogram")[:, 0, 11])
    assert data.attrs["robot"] == "tiny"


def test_the_data_card_says_what_the_data_are(made):
    """Content, origin, labels with units, divisions, limitations, licence, citation."""
    card = (made / "DATACARD.md").read_text()
    for title in ("Content", "Labels", "Origin", "Divisions", "Limitations", "Licence", "Citation"):
        assert f"\n## {title}\n" in card
    assert "12 runs with 60 work cycles" in card
    assert "CC BY 4.0" in card and "faultgen 1.0.0, MuJoCo 4" in card
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in card.splitlines()]
    assert ["tiny", "swing", "friction_wear", "1, 2", "1 (fraction of nominal)", "8", "40"] in rows
    units = {row[0]: row[1] for row in rows if len(row) == 3}
    assert units["`/cycle/fault_severity/backlash`"] == "rad"
    parts = open_dataset(made).manifest.splits["run"]
    (told,) = (row for row in rows if row[:1] == ["`run`"])
    assert told[2:] == [str(len(parts[part])) for part in PARTS]
    assert "paired" not in card
    with h5py.File(made / "dataset.h5") as file:
        assert file["DATACARD.md"].asstr()[()] == card


def test_a_changed_data_card_is_noticed(experiment, made, tmp_path):
    folder = Path(shutil.copytree(made, tmp_path / "out"))
    card = folder / "DATACARD.md"
    before = card.read_text()
    card.write_text(before.replace("12 runs", "13 runs"))
    assert open_dataset(folder).damaged() == {"DATACARD.md": "differs from its copy in dataset.h5"}
    generate(experiment, folder, progress=False)
    assert card.read_text() == before


def test_the_card_of_paired_data_warns(tiny_robot_path, tiny_task_path, tmp_path):
    given = {"robot": tiny_robot_path, "task": tiny_task_path, "axis": 1, "cycles": 1}
    given |= {"paired": True, "repetitions": 2, "signals": "none"}
    generate(make_experiment(given), tmp_path, progress=False)
    assert "The dataset is paired" in (tmp_path / "DATACARD.md").read_text()
    assert set(contents(tmp_path)) >= {"DATACARD.md", "dataset.h5", "runs.json"}


def test_the_examples_of_the_page_run(experiment, made, monkeypatch):
    """The Python code of docs/datasets.md, as it stands; PyTorch is checked by its arrays."""
    page = (Path(__file__).parents[2] / "docs" / "datasets.md").read_text()
    blocks = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    monkeypatch.chdir(made.parent)
    generate(experiment, "campaign", part=(1, 1), keep="merged", progress=False)
    merge_parts("campaign", progress=False)
    names = {}
    for code in blocks:
        if "import torch" not in code:
            exec(code, names)  # noqa: S102
    rows = [names[part] for part in ("X", "X_validation", "X_test")]
    assert sum(map(len, rows)) == 60 and len(names["cycles"]) == 60
    # what torch.tensor is given: numbers without nan, and whole numbers from 0
    assert names["X"].to_numpy().dtype == np.float64 and names["X"].notna().all(axis=None)
    assert names["y"].dtype.kind == "i" and names["y"].min() == 0

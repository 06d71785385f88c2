"""Datasets in parts that are datasets of their own, with a common table of all runs."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from conftest import contents, faultgen

import faultgen.dataset.making as making
import faultgen.dataset.parts as parts_module
from faultgen import open_parts
from faultgen.dataset.experiment import make_experiment
from faultgen.dataset.planning import plan_runs
from faultgen.dataset.reader import open_dataset
from faultgen.dataset.sweep import generate, merge_parts
from faultgen.errors import InputError

COUNT = 3


@pytest.fixture(scope="module")
def experiment(tiny_robot_path, tiny_task_path):
    return make_experiment(
        {"robot": tiny_robot_path, "task": tiny_task_path, "axis": [1, 2], "cycles": 2}
        | {"repetitions": 7, "signals": "none", "paired": True}
    )


@pytest.fixture(scope="module")
def made(experiment, tmp_path_factory):
    """A dataset in parts, not to be changed."""
    folder = tmp_path_factory.mktemp("made") / "out"
    for number in (2, 1, 3):
        generate(experiment, folder, part=(number, COUNT), keep="merged", progress=False)
    merge_parts(folder, progress=False)
    return folder


@pytest.fixture
def parted(made, tmp_path):
    return Path(shutil.copytree(made, tmp_path / "out"))


def test_together_the_parts_are_the_dataset(experiment, made, tmp_path):
    """The same runs with the same content; no seed is in two parts; one file for each part."""
    generate(experiment, tmp_path / "whole", progress=False)
    whole, parts = open_dataset(tmp_path / "whole"), open_parts(made)
    assert [part.runs for part in parts.parts] == [6, 6, 9]
    assert sorted(parts.index["run"]) == sorted(whole.planned)
    assert parts.index.groupby("seed")["part"].nunique().max() == 1
    for run in whole.runs:
        same = parts.run(run.id)
        assert same.attributes.keys() == run.attributes.keys()
        for name in ("monitoring/mean_abs_torque", "cycle/severity", "model"):
            assert np.array_equal(same.read(name), run.read(name))
    assert not list(made.glob("part-*/runs/*.h5*"))
    table, wanted = parts.index.set_index("run"), whole.index.set_index("run")
    for name in wanted.columns:
        if not name.startswith("split_"):
            told = table.loc[wanted.index, name].to_numpy()
            assert told.tolist() == pytest.approx(wanted[name].tolist(), nan_ok=True), name


def test_divisions_agree(made):
    """The same axis is held out in every part; runs with one seed are on one side."""
    table = open_parts(made).index
    held_out = table[(table["split_axis"] == "test") & (table["axis"] > 0)]
    assert held_out["part"].nunique() > 1 and held_out["axis"].nunique() == 1
    assert set(table["split_run"]) == {"train", "validation", "test"}
    assert (table.groupby("seed")["split_run"].nunique() == 1).all()


def test_the_table_is_the_same_again(made, parted, monkeypatch):
    """Merging again gives the same bytes, and reads only parts that have changed."""
    before = contents(made)
    assert contents(parted) == before
    read = []
    monkeypatch.setattr(parts_module, "verify", lambda path: read.append(path) or "")
    merge_parts(parted, progress=False)
    assert not read and contents(parted)["index.h5"] == before["index.h5"]
    (parted / "index.h5").write_bytes(b"damaged")
    monkeypatch.undo()
    with pytest.raises(InputError, match="damaged"):
        open_parts(parted)
    merge_parts(parted, progress=False)
    assert contents(parted) == before


def test_what_is_missing_or_damaged_is_named(parted):
    file = parted / "part-2-of-3" / "dataset.h5"
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)
    (parted / "index.h5").unlink()
    with pytest.raises(InputError, match="part-2-of-3.*damaged"):
        merge_parts(parted, progress=False)
    file.unlink()
    with pytest.raises(InputError, match=r"1 of 3 parts are missing.*--part 2/3"):
        merge_parts(parted, progress=False)
    with pytest.raises(InputError, match="not merged"):
        open_parts(parted)
    with pytest.raises(InputError, match="is a dataset in parts; give one of them"):
        open_dataset(parted)


def test_a_part_from_another_robot_is_refused(parted):
    """Its list of runs tells; the experiment alone does not, if a file has been changed."""
    path = parted / "part-2-of-3" / "runs.json"
    old = parts_module.open_dataset(parted / "part-2-of-3").manifest
    for run in old.runs.values():
        run["model_sha256"] = "0" * 64
    path.write_text(old.text())
    with pytest.raises(InputError, match="was made from another robot, task or sensors file"):
        merge_parts(parted, progress=False)


@pytest.mark.parametrize(
    ("change", "part", "message"),
    [
        ({}, (1, 2), "holds part-1-of-3, so a part cannot be one of 2"),
        ({"cycles": 3}, (1, 3), "holds parts of another experiment"),
        ({"part": [1, 3]}, (1, 3), "is that of a part already"),
        ({}, None, "holds a dataset in parts"),
    ],
)
def test_another_dataset_is_refused(experiment, parted, change, part, message):
    before = contents(parted)
    other = make_experiment(experiment.model_dump(exclude_none=True) | change)
    with pytest.raises(InputError, match=message):
        keep = "all" if part is None else "merged"
        generate(other, parted, part=part, keep=keep, progress=False)
    assert {k: v for k, v in contents(parted).items() if ".lock" not in k} == {
        k: v for k, v in before.items() if ".lock" not in k
    }


def test_a_dataset_without_parts_gets_none(experiment, tmp_path):
    generate(make_experiment({**_entries(experiment), "repetitions": 1}), tmp_path, progress=False)
    with pytest.raises(InputError, match="holds a dataset that has no parts"):
        generate(experiment, tmp_path, part=(1, 2), keep="merged", progress=False)


def _entries(experiment):
    return experiment.model_dump(exclude_none=True)


def test_many_runs_are_made_in_parts(experiment):
    """More than a dataset can have are refused with the remedy, and can be planned in parts."""
    large = {**_entries(experiment), "repetitions": 1_000_000}
    with pytest.raises(InputError, match="make it in parts with --part"):
        plan_runs(make_experiment(large))
    last = plan_runs(make_experiment({**large, "part": [100_000, 100_000]}))
    assert {run.seed for run in last} == set(range(999_990, 1_000_000))


@pytest.mark.slow
def test_the_commands(experiment, parted, tiny_robot_path, tiny_task_path, tmp_path):
    told = json.loads(faultgen("info", parted, "--json").stdout)
    assert told["complete"] and told["runs"] == 21 and told["parts"] == 3
    assert [row["runs"] for row in told["groups"]] == [7, 7, 7]
    assert "all parts are there" in faultgen("info", parted).stdout
    assert faultgen("info", parted / "part-1-of-3").returncode == 0
    (parted / "part-3-of-3" / "dataset.h5").unlink()
    done = faultgen("info", parted)
    assert done.returncode == 1 and "missing or unfinished: part-3-of-3" in done.stdout
    words = ["--robot", tiny_robot_path, "--task", tiny_task_path, "--cycles", "1", "--axis", "1"]
    words += ["--repetitions", "2", "--keep", "merged", "--part"]
    done = faultgen("generate", *words, "1/2", "--dry-run", "-o", "new", cwd=tmp_path)
    assert "part 1 of 2" in done.stdout and not (tmp_path / "new").exists()
    for part in ("1/2", "2/2"):
        done = faultgen("generate", *words, part, "-o", "new", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    assert faultgen("merge", "new", cwd=tmp_path).stdout.startswith("new: 4 runs")


@pytest.mark.parametrize("broken", [1, 2])
def test_parts_whose_runs_failed(experiment, tmp_path, monkeypatch, broken):
    """A part without a run is merged with the others; without any run, there is no table."""
    monkeypatch.setattr(making, "make_run", lambda run, *others: (run, "broken"))
    for number in (1, 2):
        if number > broken:
            monkeypatch.undo()
        generate(experiment, tmp_path, part=(number, 2), keep="merged", progress=False)
    if broken == 2:
        with pytest.raises(InputError, match="every run failed, such as .*: broken"):
            merge_parts(tmp_path, progress=False)
        return
    for _ in range(2):
        assert len(merge_parts(tmp_path, progress=False).failed) == 9
    assert [part.runs for part in open_parts(tmp_path).parts] == [0, 12]

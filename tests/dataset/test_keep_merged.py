"""dataset.h5 as the only copy of the runs: nothing is lost, and everything still works."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from conftest import contents, faultgen_here

import faultgen.dataset.making as making
from faultgen.dataset.experiment import make_experiment
from faultgen.dataset.merge import merge, remove_run_files
from faultgen.dataset.reader import open_dataset
from faultgen.dataset.sweep import generate
from faultgen.errors import InputError, StorageFailed
from faultgen.recordings.from_runs import recording_of


@pytest.fixture(scope="module")
def experiment(tiny_robot_path, tiny_task_path):
    return make_experiment(
        {"robot": tiny_robot_path, "task": tiny_task_path, "axis": [1, 2], "cycles": 6}
    )


@pytest.fixture(scope="module")
def whole(experiment, tmp_path_factory):
    """A dataset with its run files, not to be changed."""
    folder = tmp_path_factory.mktemp("whole") / "out"
    generate(experiment, folder, progress=False)
    return folder


@pytest.fixture(scope="module")
def kept(experiment, tmp_path_factory):
    """The same dataset with only the file of all runs, not to be changed."""
    folder = tmp_path_factory.mktemp("kept") / "out"
    generate(experiment, folder, keep="merged", progress=False)
    return folder


@pytest.fixture
def dataset(kept, tmp_path):
    return Path(shutil.copytree(kept, tmp_path / "out"))


def same_runs(one, other):
    """Whether two datasets hold the same arrays and attributes."""
    runs = open_dataset(one).runs, open_dataset(other).runs
    assert [run.id for run in runs[0]] == [run.id for run in runs[1]]
    for left, right in zip(*runs, strict=True):
        assert left.attributes.keys() == right.attributes.keys()
        for name in ("model", "signals/motor_torque", "cycle/severity", "truth/gear_torque"):
            assert np.array_equal(left.read(name), right.read(name))
    return True


def test_only_the_merged_file_is_left(kept, whole):
    """It holds every run, and takes half the space; `info` calls the dataset whole."""
    assert not list(kept.glob("runs/*.h5*"))
    assert same_runs(kept, whole)
    size = {
        folder: sum(path.stat().st_size for path in folder.rglob("*")) for folder in (kept, whole)
    }
    assert size[kept] < 0.6 * size[whole]
    told = json.loads(faultgen_here("info", kept, "--json").stdout)
    assert told["complete"] and told["intact"] and told["only_copy"] == 3
    assert "complete and intact" in faultgen_here("info", kept).stdout


def test_the_file_alone_in_a_folder_is_a_dataset(kept, whole, tmp_path):
    """Whoever copies only dataset.h5 and its checksum can name the folder or the file."""
    for name in ("dataset.h5", "dataset.h5.sha256"):
        shutil.copy(kept / name, tmp_path / name)
    assert same_runs(tmp_path, whole)
    assert same_runs(tmp_path / "dataset.h5", whole)


@pytest.mark.slow
def test_methods_and_exports_work_as_before(dataset, whole, tmp_path):
    """Isolation gives the same counts, and a run is found under the path of its former file."""
    whole = Path(shutil.copytree(whole, tmp_path / "whole"))
    results = [
        json.loads(faultgen_here("isolate", f, "--seeds", 1, "--json").stdout)
        for f in (dataset, whole)
    ]
    assert results[0] == results[1]
    run = open_dataset(whole).runs[1].id
    recordings = [recording_of([folder / "runs" / f"{run}.h5"]) for folder in (dataset, whole)]
    assert np.array_equal(recordings[0].torque, recordings[1].torque)


def test_resuming_changes_nothing(experiment, dataset):
    """With the option or without, nothing is made and no byte changes."""
    before = contents(dataset)
    for keep in ("merged", "all"):
        summary = generate(experiment, dataset, keep=keep, progress=False)
        assert (summary.done, summary.kept) == (0, 3)
        assert contents(dataset) == before


def test_a_dataset_can_give_up_its_run_files_later(experiment, whole, kept, tmp_path):
    """The folder is then the same, byte for byte."""
    folder = Path(shutil.copytree(whole, tmp_path / "out"))
    assert generate(experiment, folder, keep="merged", progress=False).done == 0
    assert contents(folder) == contents(kept)


def test_failed_runs_join_the_others_later(experiment, kept, tmp_path, monkeypatch):
    """Only the missing run is made, and the runs that were already merged are kept."""
    real, calls = making.make_run, []

    def fragile(run, folder, on_cycle, stepped, made_by):
        calls.append(run.id)
        return (run, "broken") if run.axes == (1,) else real(run, folder, on_cycle)

    monkeypatch.setattr(making, "make_run", fragile)
    summary = generate(experiment, tmp_path, keep="merged", progress=False)
    assert (summary.done, len(summary.failed), len(calls)) == (2, 1, 3)
    assert not list(tmp_path.glob("runs/*.h5"))
    assert len(open_dataset(tmp_path).missing) == 1
    monkeypatch.setattr(making, "make_run", real)
    assert generate(experiment, tmp_path, keep="merged", progress=False).done == 1
    # runs that were copied twice lie at other places of the file, with the same content
    assert same_runs(tmp_path, kept) and contents(tmp_path).keys() == contents(kept).keys()
    assert (tmp_path / "DATACARD.md").read_bytes() == (kept / "DATACARD.md").read_bytes()
    assert open_dataset(tmp_path).index.equals(open_dataset(kept).index)


def test_a_lost_list_of_runs_is_written_again(experiment, dataset):
    """The merged file shows which dataset it was."""
    before = contents(dataset)
    (dataset / "runs.json").unlink()
    (dataset / "experiment.toml").unlink()
    other = experiment.model_copy(update={"cycles": 7})
    with pytest.raises(InputError, match="holds runs of another dataset"):
        generate(other, dataset, progress=False)
    assert generate(experiment, dataset, progress=False).done == 0
    assert contents(dataset) == before


def test_a_damaged_only_copy_is_noticed_and_made_again(experiment, dataset):
    before = contents(dataset)
    path = dataset / "dataset.h5"
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    told = faultgen_here("info", dataset)
    assert told.returncode == 1 and "damaged: dataset.h5: differs" in told.stdout
    assert len(open_dataset(dataset).missing) == 3
    assert generate(experiment, dataset, keep="merged", progress=False).done == 3
    assert contents(dataset) == before


@pytest.mark.parametrize("harm", ["damaged", "another", "not the only copy"])
def test_run_files_are_kept_if_the_merged_file_is_not_right(whole, tmp_path, harm):
    """Damage, another content, or a file that is not marked as the only copy."""
    folder = Path(shutil.copytree(whole, tmp_path / "out"))
    run = open_dataset(folder).runs[0].path
    if harm == "another":
        run.rename(run.with_suffix(".away"))
    path = merge(open_dataset(folder), only_copy=harm != "not the only copy")
    if harm == "damaged":
        content = bytearray(path.read_bytes())
        content[len(content) // 2] ^= 1
        path.write_bytes(content)
    if harm == "another":
        run.with_suffix(".away").rename(run)
    with pytest.raises(StorageFailed, match="the run files are kept"):
        remove_run_files(open_dataset(folder))
    assert len(list(folder.glob("runs/*.h5"))) == len(list(folder.glob("runs/*.sha256"))) == 3


@pytest.mark.parametrize("call", ["unlink", "fsync", "replace"])
@pytest.mark.slow
def test_no_failing_system_call_loses_a_run(experiment, whole, tmp_path, monkeypatch, call):
    """Whichever call fails while run files give way, every run is still there and intact."""
    import os

    real = getattr(os, call)
    counter = {"left": 0}

    def fail(*arguments, **options):
        counter["left"] -= 1
        if counter["left"] == 0:
            raise OSError(5, "Input/output error")
        return real(*arguments, **options)

    for number in range(1, 40):
        folder = Path(shutil.copytree(whole, tmp_path / str(number)))
        counter["left"] = number
        monkeypatch.setattr(os, call, fail)
        try:
            generate(experiment, folder, keep="merged", progress=False)
            failed = False
        except OSError:
            failed = True
        monkeypatch.setattr(os, call, real)
        summary = generate(experiment, folder, keep="merged", progress=False)
        dataset = open_dataset(folder)
        assert not dataset.missing and not dataset.damaged() and same_runs(folder, whole)
        assert summary.done == 0, "no run is simulated again"
        if not failed and counter["left"] > 0:
            break
    else:
        pytest.fail("the calls never ran out")
    assert number > 1


def test_other_words_are_refused(experiment, tmp_path):
    with pytest.raises(InputError, match="keep: must be all or merged, not 'none'"):
        generate(experiment, tmp_path / "out", keep="none", progress=False)
    assert not (tmp_path / "out").exists()

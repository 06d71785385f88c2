"""Damaged datasets: every reader notices, and generating again repairs them byte for byte."""

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from conftest import contents, faultgen, faultgen_here

import faultgen.dataset.sweep as sweep
import faultgen.system.files as files
from faultgen.dataset.experiment import make_experiment
from faultgen.dataset.manifest import Manifest
from faultgen.dataset.planning import plan_runs
from faultgen.dataset.reader import open_dataset
from faultgen.dataset.storage import RunWriter
from faultgen.dataset.sweep import generate
from faultgen.errors import InputError, StorageFailed
from faultgen.importing.array_file import read_arrays_of
from faultgen.recordings.read import read_recording
from faultgen.system.arrays import read_arrays, write_arrays
from faultgen.system.files import file_sha256, write_text


@pytest.fixture(scope="module")
def experiment(tiny_robot_path, tiny_task_path):
    return make_experiment(
        {"robot": tiny_robot_path, "task": tiny_task_path, "axis": [1], "cycles": 3}
    )


@pytest.fixture(scope="module")
def intact(experiment, tmp_path_factory):
    """A finished dataset, not to be changed."""
    folder = tmp_path_factory.mktemp("intact") / "out"
    generate(experiment, folder, progress=False)
    return folder


@pytest.fixture
def dataset(intact, tmp_path):
    """A copy that may be damaged."""
    return Path(shutil.copytree(intact, tmp_path / "out"))


def flip(path, at, bit=1):
    content = bytearray(path.read_bytes())
    content[at] ^= bit
    path.write_bytes(content)


def read_all(folder):
    """Everything that the readers of the package give of a dataset."""
    dataset = open_dataset(folder)
    for run in dataset.runs:
        assert run.attributes
        for name in ("model", "time", "cycle/severity", "monitoring/mean_abs_torque"):
            run.read(name)
    return dataset


def test_no_flipped_byte_of_a_run_file_is_read(dataset):
    """Wherever a byte is flipped, in arrays, the model, scales or attributes, reading fails."""
    path = open_dataset(dataset).runs[1].path
    content = path.read_bytes()
    places = np.random.default_rng(1).integers(len(content), size=30).tolist()
    for at in places:
        flip(path, at)
        with pytest.raises(InputError, match=f"{path.name}: damaged .differs from its checksum"):
            read_all(dataset)
        path.write_bytes(content)
    read_all(dataset)


def spoil(path, kind, rng):
    """Damage a file in one of four ways."""
    content = path.read_bytes()
    if kind == "flip":
        flip(path, int(rng.integers(len(content))))
    elif kind == "cut":
        path.write_bytes(content[: len(content) // 2])
    elif kind == "not UTF-8":
        path.write_bytes(b"\xff\xfe" + content)
    else:
        path.unlink()


def is_whole(folder):
    try:
        found = open_dataset(folder)
        return not found.damaged() and not found.missing and (folder / "dataset.h5").is_file()
    except InputError as error:
        assert "\n" not in str(error)
        return False


@pytest.mark.parametrize("kind", ["flip", "cut", "not UTF-8", "lost"])
def test_every_damaged_file_is_noticed_and_repaired(experiment, dataset, kind):
    """Any file alone is noticed; generating again mends all of them at once, byte for byte."""
    before = contents(dataset)
    rng = np.random.default_rng(2)
    for name in before:
        path = dataset / name
        content = path.read_bytes()
        spoil(path, kind, rng)
        assert not is_whole(dataset), name
        path.write_bytes(content)
        assert is_whole(dataset), name
    for name in before:
        spoil(dataset / name, kind, rng)
    generate(experiment, dataset, progress=False)
    assert contents(dataset) == before


@pytest.mark.parametrize("reader", ["isolate", "detect", "report", "info"])
def test_commands_refuse_damaged_files(dataset, reader):
    """One line that names the file; exit status 2, or 1 of `info`, which lists it."""
    path = open_dataset(dataset).runs[0].path
    flip(path, path.stat().st_size // 2)
    done = faultgen_here(reader, dataset)
    if reader == "info":
        assert done.returncode == 1
        assert f"damaged: runs/{path.name}: differs from its checksum" in done.stdout
    else:
        assert done.returncode == 2
        assert re.fullmatch(rf"faultgen: .*{path.name}: damaged [^\n]*\n", done.stderr)


def test_an_altered_list_of_runs_is_not_shown_as_truth(dataset):
    """A changed value in runs.json is noticed, even if the file is still JSON."""
    path = dataset / "runs.json"
    path.write_text(path.read_text().replace('"severity": 0.2', '"severity": 0.3'))
    done = faultgen_here("info", dataset)
    assert done.returncode == 2
    assert re.fullmatch(r"faultgen: .*runs.json: damaged [^\n]*checksum[^\n]*\n", done.stderr)


def test_ids_of_runs_never_lead_out_of_the_folder(dataset):
    """A list of runs with a path in place of an id is refused, checksum or not."""
    runs = Manifest.read(dataset).runs
    escaped = {"../../secret": next(iter(runs.values()))}
    Manifest(escaped, "0" * 64).write(dataset)
    with pytest.raises(InputError, match="'../../secret' is not the id of a run"):
        open_dataset(dataset)


def test_an_edited_experiment_is_noticed(experiment, dataset):
    """`info` reports it; generating with the true experiment restores it."""
    path = dataset / "experiment.toml"
    before = path.read_bytes()
    path.write_bytes(before.replace(b"cycles = 3", b"cycles = 4"))
    done = faultgen_here("info", dataset)
    assert done.returncode == 1
    assert "damaged: experiment.toml: is not the experiment that made" in done.stdout
    generate(experiment, dataset, progress=False)
    assert path.read_bytes() == before


def test_a_write_that_the_disk_forgets_is_noticed(tmp_path, monkeypatch):
    """A file whose bytes change before it gets its name is refused, and nothing is left."""
    real = files.os.fsync

    def forget(handle):
        real(handle)
        size = files.os.fstat(handle).st_size
        if size > 2000:
            files.os.pwrite(handle, bytes(size // 2), size // 4)

    def write():
        with RunWriter(tmp_path, "0" * 16, {"seed": 1}, "<mujoco/>") as writer:
            writer.scale("cycle_number", np.arange(1, 101))
            writer.add("cycle/severity", np.linspace(0, 1, 100), ("cycle_number",))

    write()
    (tmp_path / f"{'0' * 16}.h5").unlink()
    (tmp_path / f"{'0' * 16}.h5.sha256").unlink()
    monkeypatch.setattr(files.os, "fsync", forget)
    with pytest.raises(StorageFailed, match="differs from what was written"):
        write()
    with pytest.raises(StorageFailed, match="differs from what was written"):
        write_arrays(tmp_path / "a.h5", {"x": np.arange(500.0)}, {})
    with pytest.raises(StorageFailed, match="differs from what was written"):
        write_text(tmp_path / "a.txt", "text " * 1000)
    assert not list(tmp_path.iterdir())


def test_files_get_their_name_only_when_they_are_whole(tmp_path, monkeypatch):
    """While a file is written, its final name still stands for the old content."""
    path = tmp_path / "a.h5"
    write_arrays(path, {"x": np.zeros(3)}, {})
    seen = []
    real = files.os.replace

    def look(source, target):
        seen.append((Path(target).name, read_arrays(path)[0]["x"][0]))
        real(source, target)

    monkeypatch.setattr(files.os, "replace", look)
    write_arrays(path, {"x": np.ones(3)}, {})
    assert seen == [("a.h5", 0.0)]
    monkeypatch.setattr(files.os, "replace", real)
    monkeypatch.setattr(files.os, "fsync", _fail)
    with pytest.raises(StorageFailed, match="a.h5: cannot be written .Input/output error"):
        write_arrays(path, {"x": np.full(3, 2.0)}, {})
    assert read_arrays(path)[0]["x"].tolist() == [1, 1, 1]


def _fail(*_):
    raise OSError(5, "Input/output error")


def test_no_flipped_byte_of_arrays_is_read(tmp_path):
    """Files of interpolated cycles, series and fleets carry a checksum of their content."""
    path = tmp_path / "a.h5"
    arrays = {"x": np.arange(200.0), "truth/y": np.eye(3, dtype="f4"), "flags": np.array([True])}
    attributes = {"name": "arm", "count": 3, "period": 0.004, "some": np.array([1.5, 2.0])}
    write_arrays(path, arrays, attributes)
    found, told = read_arrays(path)
    assert found.keys() == arrays.keys()
    assert all(np.array_equal(found[name], arrays[name]) for name in arrays)
    assert {**told, "some": list(told["some"])} == {**attributes, "some": [1.5, 2.0]}
    content = path.read_bytes()
    noticed = 0
    for at in range(0, len(content), 53):
        flip(path, at, 4)
        try:
            again, told = read_arrays(path)
            assert all(np.array_equal(again[name], arrays[name]) for name in arrays)
        except InputError:
            noticed += 1  # the others are in free space of the file
        path.write_bytes(content)
    assert noticed > 20


def test_a_damaged_heap_of_texts_does_not_hang(tmp_path):
    """HDF5 itself never returns from such a file, whichever command opens it."""
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file["motor_torque"] = np.zeros((5, 2))
        file.attrs["robot"] = "arm"
    content = path.read_bytes()
    heap = content.index(b"GCOL") + 16
    size = heap + 8  # of its first object
    assert content[size : size + 11] == (3).to_bytes(8, "little") + b"arm"
    # the next object is then looked for in empty space, where its number and its size are 0
    path.write_bytes(content[:size] + (1027).to_bytes(8, "little") + content[size + 8 :])
    for read in (read_arrays, read_recording, read_arrays_of):
        with pytest.raises(InputError, match="a.h5: .*damaged"):
            read(path)
    with pytest.raises(InputError, match="no checksum beside it"):
        open_dataset(path)


@pytest.mark.slow
def test_paths_are_not_part_of_a_run(tiny_robot_path, tiny_task_path, tmp_path, monkeypatch):
    """However a robot or task file is addressed, the runs are the same, and resume."""
    shutil.copy(tiny_robot_path, tmp_path / "tiny.xml")
    shutil.copy(tiny_task_path, tmp_path / "swing.toml")
    monkeypatch.chdir(tmp_path)
    ids = []
    for prefix in ("", "./", "../" + tmp_path.name + "/", str(tmp_path) + "/"):
        given = {"robot": prefix + "tiny.xml", "task": prefix + "swing.toml", "cycles": 2}
        ids.append([run.id for run in plan_runs(make_experiment(given | {"axis": [1]}))])
        summary = generate(make_experiment(given | {"axis": [1]}), "out", progress=False)
        assert summary.done == (2 if prefix == "" else 0)
    assert ids[1:] == ids[:1] * 3
    monkeypatch.chdir("/")
    assert (
        faultgen("isolate", tmp_path / "out").stderr == faultgen("isolate", tmp_path / "out").stderr
    )
    assert "unknown robot" not in faultgen("isolate", tmp_path / "out").stderr


def test_runs_of_another_version_are_refused_or_made_again(experiment, dataset, monkeypatch):
    """A dataset never mixes two versions of the code: resuming says which runs differ."""
    before = contents(dataset)
    now = sweep.run_provenance()
    other = replace(now, code_sha256="f" * 64)
    lost, kept = open_dataset(dataset).runs
    lost.path.unlink()
    monkeypatch.setattr(sweep, "run_provenance", lambda: other)
    monkeypatch.setattr("faultgen.dataset.making.run_provenance", lambda: other)
    with pytest.raises(InputError, match=f"1 of 2 runs, such as {kept.id}, were made by faultgen"):
        generate(experiment, dataset, progress=False)
    assert not lost.path.is_file()
    summary = generate(experiment, dataset, regenerate=True, progress=False)
    assert (summary.done, summary.kept) == (2, 0)
    assert {run.made_by for run in open_dataset(dataset).runs} == {other}
    monkeypatch.undo()
    lost.path.unlink()
    generate(experiment, dataset, regenerate=True, progress=False)
    assert contents(dataset) == before


def test_info_reports_runs_of_two_versions(dataset):
    """Such a dataset is not called whole."""
    path = open_dataset(dataset).runs[1].path
    with h5py.File(path, "r+") as file:
        file.attrs["mujoco_version"] = "3.9.9"
    files.checksum_path(path).write_text(file_sha256(path) + "\n")
    done = faultgen_here("info", dataset)
    assert done.returncode == 1
    assert "made by faultgen" in done.stdout
    assert "MuJoCo 3.9.9, code " in done.stdout
    assert "complete and intact" not in done.stdout
    said = json.loads(faultgen_here("info", dataset, "--json").stdout)
    assert len(said["versions"]) == 2


@pytest.mark.parametrize("end", ["", "\n\n", "\x0b", "0\n"])
def test_every_byte_of_a_checksum_file_counts(experiment, dataset, end):
    """Also its line end: what differs in a byte is noticed, and written again."""
    before = contents(dataset)
    note = next((dataset / "runs").glob("*.sha256"))
    note.write_text(note.read_text()[:-1] + end)
    damaged = open_dataset(dataset).damaged()
    assert list(damaged.values()) == ["its checksum is damaged"]
    generate(experiment, dataset, progress=False)
    assert contents(dataset) == before

"""The parts that store datasets, each by itself: files, lists of runs, merged files."""

import io
import json
import os
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

import faultgen.dataset.merge as merging
import faultgen.dataset.sweep as sweep
import faultgen.system.checked_file as checked_file
import faultgen.system.files as files
from faultgen.dataset.experiment import make_experiment
from faultgen.dataset.manifest import Manifest
from faultgen.dataset.reader import open_dataset
from faultgen.dataset.storage import RunWriter
from faultgen.errors import InputError, StorageFailed
from faultgen.system.arrays import read_arrays, write_arrays
from faultgen.system.checked_file import Sink
from faultgen.system.files import file_sha256, temporary_name, writer_of


def use_blocks_of(monkeypatch, size):
    """Compare files in blocks of so many bytes, of which few are kept in memory."""
    monkeypatch.setattr(checked_file, "BLOCK", size)
    monkeypatch.setattr(checked_file, "RECENT", 2)


@pytest.fixture(scope="module")
def made(tiny_robot_path, tiny_task_path, tmp_path_factory):
    """A dataset of two runs, not to be changed."""
    folder = tmp_path_factory.mktemp("storage") / "out"
    given = {"robot": tiny_robot_path, "task": tiny_task_path, "axis": 1, "cycles": 2}
    sweep.generate(make_experiment(given), folder, progress=False)
    return folder


@pytest.fixture
def dataset(made, tmp_path):
    """A copy that may be changed."""
    return Path(shutil.copytree(made, tmp_path / "out"))


@pytest.mark.parametrize("block", [16, checked_file.BLOCK])
def test_a_sink_is_a_file(tmp_path, monkeypatch, block):
    """Any sequence of calls moves, reads and writes the same bytes as a file in memory."""
    use_blocks_of(monkeypatch, block)
    rng = np.random.default_rng(0)
    sink, file = Sink(tmp_path / "a"), io.BytesIO()
    assert sink.readable() and sink.writable() and sink.seekable()
    for _ in range(300):
        call = rng.choice(["write", "read", "start", "here", "end", "cut", "cut here"])
        number = int(rng.integers(40))
        if call == "write":
            content = rng.bytes(number)
            assert sink.write(content) == file.write(content)
        elif call == "read":
            one, other = bytearray(number), bytearray(number)
            assert sink.readinto(one) == file.readinto(other)
            assert one == other
        elif call == "start":
            assert sink.seek(number) == file.seek(number)
        elif call == "here":
            assert sink.seek(number, os.SEEK_CUR) == file.seek(number, os.SEEK_CUR)
        elif call == "end":
            back = -min(number, len(file.getvalue()))
            assert sink.seek(back, os.SEEK_END) == file.seek(back, os.SEEK_END)
        elif call == "cut":
            size = min(number * 3, len(file.getvalue()))
            assert sink.truncate(size) == file.truncate(size)
        else:
            place = min(sink.tell(), len(file.getvalue()))
            assert sink.seek(place) == file.seek(place)
            assert sink.truncate() == file.truncate()
        assert sink.tell() == file.tell()
    sink.sync()
    assert (tmp_path / "a").read_bytes() == file.getvalue()


@pytest.mark.parametrize("when", ["end", "read", "overwrite", "cut"])
def test_bytes_that_change_while_a_file_is_written_are_noticed(tmp_path, monkeypatch, when):
    """Wherever the byte is, and also if the block is read or changed again before the end."""
    use_blocks_of(monkeypatch, 16)
    path = tmp_path / "a"
    for place in range(0, 200, 7):
        sink = Sink(path, tmp_path / "final")
        sink.write(bytes(range(200)))
        with path.open("r+b") as file:
            file.seek(place)
            file.write(b"\xff")
        sink.seek(place)
        if when == "read":
            sink.readinto(bytearray(1))
        elif when == "overwrite":
            sink.seek(place + 1)
            sink.write(bytes(1))
        elif when == "cut":
            sink.truncate(place + 1)
        with pytest.raises(StorageFailed, match="final: differs from what was written"):
            sink.sync()
        sink.close()


def test_wrong_bytes_of_the_disk_are_not_merged(dataset, monkeypatch):
    """A disk that returns other bytes than those whose checksum was right stops the merging."""
    run = open_dataset(dataset).runs[0]
    real, reads = os.read, []

    def flipped(handle, size):
        content = bytearray(real(handle, size))
        reads.append(len(content))
        if len(content) > 1000:
            content[1000] ^= 1
        return bytes(content)

    with run.open(every_read=True) as file:
        wanted = {name: value[()] for name, value in file["monitoring"].items()}
    with run.open() as file:
        assert all(np.array_equal(file["monitoring"][name], wanted[name]) for name in wanted)
    monkeypatch.setattr(os, "read", flipped)
    (dataset / "dataset.h5").unlink()
    with pytest.raises(StorageFailed, match="h5: cannot be read .the disk returned wrong bytes"):
        merging.merge(open_dataset(dataset))
    assert reads
    assert not [
        path.name for path in dataset.iterdir() if "dataset" in path.name and "tmp" in path.name
    ]
    monkeypatch.setattr(os, "read", real)
    merging.merge(open_dataset(dataset))
    assert not open_dataset(dataset).damaged()


def test_a_sink_is_closed_once(tmp_path):
    """After `sync` its handle is free, and closing again does not close the file of another."""
    sink = Sink(tmp_path / "a")
    sink.write(b"abc")
    before = sorted(os.listdir("/proc/self/fd")) if os.path.isdir("/proc/self/fd") else []
    sink.sync()
    assert sink.closed
    with (tmp_path / "b").open("w") as other:  # gets the handle that is free now
        sink.close()
        other.write("still open")
        other.flush()
        assert not before or str(other.fileno()) in before


def test_what_is_compared_comes_from_the_disk(tmp_path, monkeypatch):
    """The system is asked to forget what it keeps of a file before its checksum is computed."""
    asked = []
    monkeypatch.setattr(files, "forget_cached", lambda handle: asked.append(os.fstat(handle)))
    path = tmp_path / "a"
    path.write_text("text")
    file_sha256(path)
    assert [state.st_ino for state in asked] == [path.stat().st_ino]


def test_a_temporary_name_tells_its_writer():
    """Whatever the file is called; other names tell of none."""
    for name in ("run.h5", "a", ".hidden", "1.2.3.h5"):
        temporary = temporary_name(Path("out") / name)
        assert temporary.parent == Path("out")
        assert writer_of(temporary) == os.getpid()
    for name in ("a.h5", "tmp", ".a.h5.x.tmp"):
        assert writer_of(Path(name)) is None


def test_arrays_are_put_into_new_folders(tmp_path):
    """All folders on the way to a file are made."""
    path = tmp_path / "one" / "two" / "a.h5"
    write_arrays(path, {"x": np.arange(3)}, {})
    assert read_arrays(path)[0]["x"].tolist() == [0, 1, 2]


def _rename(file):
    file.move("x", "z")


def _reshape(file):
    values = file["x"][()]
    del file["x"]
    file["x"] = values.reshape(3, 2)


def _retype(file):
    values = file["x"][()]
    del file["x"]
    file["x"] = values.view("i8")


def _remove(file):
    del file["x"]


def _add(file):
    file["more"] = 1.0


def _change(file):
    file["x"][0, 0] = 7.0


def _change_attribute(file):
    file.attrs["seed"] = 2


def _remove_attribute(file):
    del file.attrs["seed"]


def _add_attribute(file):
    file.attrs["more"] = 1


@pytest.mark.parametrize(
    "edit",
    [
        _rename,
        _reshape,
        _retype,
        _remove,
        _add,
        _change,
        _change_attribute,
        _remove_attribute,
        _add_attribute,
    ],
)
def test_edited_arrays_are_not_read(tmp_path, edit):
    """A change by a program that writes HDF5 correctly is noticed, whatever it concerns."""
    path = tmp_path / "a.h5"
    write_arrays(path, {"x": np.arange(6.0).reshape(2, 3), "y": np.ones(2)}, {"seed": 1})
    with h5py.File(path, "r+") as file:
        edit(file)
    with pytest.raises(InputError, match=r"a.h5: damaged \(its content differs from its checksum"):
        read_arrays(path)


def test_the_order_of_entries_is_no_damage(dataset):
    """A list of runs in which another program sorted and indented the entries is still read."""
    path = dataset / "runs.json"
    before = Manifest.read(dataset)
    path.write_text(json.dumps(json.loads(path.read_text()), indent=3, sort_keys=True))
    assert Manifest.read(dataset) == before


def test_a_failed_write_ends_a_run_at_once(tmp_path, monkeypatch):
    """The next cycle that is put reports it, so that no further cycle is simulated for nothing."""
    put = []

    def full(handle, content):
        raise OSError(28, "No space left on device")

    def write():
        with RunWriter(tmp_path, "0" * 16, {}, "<mujoco/>") as writer:
            writer.scale("cycle_number", np.arange(1, 4))
            writer.create("cycle/severity", (3,), "f8", ("cycle_number",))
            writer.put("cycle/severity", 0, np.ones(()))
            monkeypatch.setattr(os, "write", full)
            writer.file.flush()
            for cycle in (1, 2):
                writer.put("cycle/severity", cycle, np.ones(()))
                put.append(cycle)

    with pytest.raises(StorageFailed, match="No space left on device"):
        write()
    assert not put
    assert not list(tmp_path.iterdir())


def test_cycles_are_written_in_their_order(tmp_path):
    """A cycle that is left out or written twice is an error of the program."""
    with RunWriter(tmp_path, "0" * 16, {}, "<mujoco/>") as writer:
        writer.scale("cycle_number", np.arange(1, 3))
        writer.create("cycle/severity", (2,), "f8", ("cycle_number",))
        writer.put("cycle/severity", 0, np.ones(()))
        for wrong in (0, 2):
            with pytest.raises(ValueError, match="cannot follow 1 cycles"):
                writer.put("cycle/severity", wrong, np.ones(()))
        writer.put("cycle/severity", 1, np.ones(()))


def test_a_lost_list_of_runs_is_written_again(tiny_robot_path, tiny_task_path, dataset):
    """The run files show which dataset it was: they are kept, and those of another are refused."""
    before = (dataset / "runs.json").read_bytes()
    (dataset / "runs.json").unlink()
    given = {"robot": tiny_robot_path, "task": tiny_task_path, "axis": 1, "cycles": 2}
    with pytest.raises(InputError, match="holds runs of another dataset"):
        sweep.generate(make_experiment(given | {"cycles": 3}), dataset, progress=False)
    summary = sweep.generate(make_experiment(given), dataset, progress=False)
    assert (summary.done, summary.kept) == (0, 2)
    assert (dataset / "runs.json").read_bytes() == before


def test_a_run_gives_what_it_holds(made):
    """Whole arrays and parts of them; the name of one that is not there is told."""
    worn = open_dataset(made).runs[1]
    assert worn["axis"] == 1 and "cycle/severity" in worn and "signals/noise" not in worn
    torque = worn.read("signals/motor_torque")
    assert torque.shape[::2] == (2, 2)
    assert np.array_equal(worn.read("signals/motor_torque", np.s_[1, :, 0]), torque[1, :, 0])
    with pytest.raises(InputError, match=f"{worn.id}.h5: holds no 'signals/noise'"):
        worn.read("signals/noise")


def test_scales_carry_their_names(made):
    """Readers of netCDF find the name of a dimension in the attribute NAME of its scale."""
    (run, *_) = open_dataset(made).runs
    with h5py.File(run.path) as file, h5py.File(made / "dataset.h5") as merged:
        for name in ("cycle_number", "time", "axis", "bin"):
            for scale in (file[name], merged[f"runs/{run.id}/{name}"]):
                assert scale.attrs["CLASS"] == b"DIMENSION_SCALE"
                assert scale.attrs["NAME"] == name.encode()


def test_a_merged_file_follows_its_runs(dataset):
    """It is written again when a run comes or goes, and only then."""

    def merged():
        merging.merge(open_dataset(dataset))
        with h5py.File(dataset / "dataset.h5") as file:
            return file.attrs["complete"], len(file["runs"]), os.stat(file.filename).st_ino

    before = os.stat(dataset / "dataset.h5").st_ino
    assert merged() == (True, 2, before)
    path = open_dataset(dataset).runs[1].path
    path.rename(path.with_suffix(".away"))
    assert merged()[:2] == (False, 1)
    path.with_suffix(".away").rename(path)
    assert merged()[:2] == (True, 2)


def test_dimension_scales_of_merged_runs_are_their_own(dataset):
    """As in the file of the run: each dimension has a scale, which is in the same group."""
    with h5py.File(dataset / "dataset.h5") as merged:
        for run in open_dataset(dataset).runs:
            group = merged[f"runs/{run.id}"]
            with run.open() as file:
                names = []
                file.visititems(lambda name, item, into=names: into.append((name, item)))
                arrays = [(n, item) for n, item in names if isinstance(item, h5py.Dataset)]
                for name, item in arrays:
                    wanted = [[group.name + one.name for one in d.values()] for d in item.dims]
                    found = [[one.name for one in d.values()] for d in group[name].dims]
                    assert found == wanted and group[name].is_scale == item.is_scale
                assert any(len(item.dims) and len(item.dims[0]) for _, item in arrays)

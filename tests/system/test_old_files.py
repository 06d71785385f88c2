"""A new attempt that fails does not cost an older good file, whatever wrote it."""

import os
import stat
import time

import h5py
import numpy as np
import pandas as pd
import pytest
from conftest import faultgen_here
from matplotlib.figure import Figure

import faultgen.system.files as files
from faultgen.errors import InputError, StorageFailed
from faultgen.studies.figures import draw
from faultgen.system.arrays import write_arrays
from faultgen.system.files import checksum_path, file_sha256, publish, temporary_name, write_text
from faultgen.system.hdf5 import open_verified
from faultgen.system.tables import write_parquet


@pytest.fixture
def folders_fail(monkeypatch):
    """A disk that renames files, but cannot sync the folder."""
    real = os.fsync

    def fail(handle):
        if stat.S_ISDIR(os.fstat(handle).st_mode):
            raise OSError(5, "Input/output error")
        real(handle)

    monkeypatch.setattr(os, "fsync", fail)


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def published(path, text):
    temporary_name(path).write_text(text)
    checksum = file_sha256(temporary_name(path))
    publish(temporary_name(path), path, checksum)
    return checksum


def test_a_file_is_as_before_if_its_folder_cannot_be_synced(tmp_path, folders_fail):
    """The state of `judge` and an edited drives.toml would be lost otherwise."""
    path = tmp_path / "state.json"
    path.write_text("old")
    with pytest.raises(StorageFailed, match="state.json: cannot be written .Input/output error"):
        write_text(path, "new")
    assert (path.read_text(), names(tmp_path)) == ("old", ["state.json"])
    path.unlink()
    with pytest.raises(StorageFailed):
        write_text(path, "new")
    assert names(tmp_path) == []


def test_a_checksum_belongs_to_its_file_after_a_failure(tmp_path, monkeypatch):
    """Wherever it fails: the old file keeps its old checksum."""
    path = tmp_path / "a.dat"
    checksum = published(path, "old")
    real = os.replace
    for step in (temporary_name(path), temporary_name(checksum_path(path))):

        def fail(source, target, step=step):
            if source == step:
                raise OSError(5, "Input/output error")
            real(source, target)

        monkeypatch.setattr(os, "replace", fail)
        with pytest.raises(StorageFailed):
            published(path, "new")
        monkeypatch.setattr(os, "replace", real)
        assert path.read_text() == "old"
        assert checksum_path(path).read_text() == checksum + "\n"
        assert names(tmp_path) == ["a.dat", "a.dat.sha256"]


def test_without_hard_links_the_new_file_stays(tmp_path, folders_fail, monkeypatch):
    """It is whole; only its name may not be on the disk yet, and the failure is told."""

    def refuse(*_):
        raise OSError(1, "Operation not permitted")

    monkeypatch.setattr(os, "link", refuse)
    path = tmp_path / "state.json"
    path.write_text("old")
    with pytest.raises(StorageFailed):
        write_text(path, "new")
    assert (path.read_text(), names(tmp_path)) == ("new", ["state.json"])


def spoiled(monkeypatch):
    """A disk that changes a bit of everything and says nothing."""
    real = os.write

    def write(handle, content):
        changed = bytearray(content)
        changed[len(changed) // 2] ^= 4
        return real(handle, bytes(changed))

    monkeypatch.setattr(os, "write", write)


@pytest.mark.parametrize("what", ["figure", "parquet"])
@pytest.mark.parametrize("fault", ["a changed bit", "a full disk"])
def test_figures_and_tables_are_compared_with_what_was_drawn(tmp_path, monkeypatch, what, fault):
    """The old one stays, and the message names the file."""

    def make():
        if what == "parquet":
            write_parquet(pd.DataFrame({"x": np.arange(50.0)}), tmp_path / "x.parquet")
        else:
            draw({"x": lambda _: Figure()}, {}, tmp_path)

    make()
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    if fault == "a changed bit":
        spoiled(monkeypatch)
    else:

        def full(handle, content):
            raise OSError(28, "No space left on device")

        monkeypatch.setattr(os, "write", full)
    with pytest.raises(
        StorageFailed, match=r"x.p\w+: (differs from what|cannot be written .No sp)"
    ):
        make()
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_damage_that_appears_while_a_file_is_read_is_one_line(tmp_path):
    """h5py raises a KeyError for metadata with a wrong checksum; other KeyErrors are not hidden."""
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file["x"] = 1.0
    checksum_path(path).write_text(files.file_sha256(path) + "\n")
    with pytest.raises(StorageFailed, match="a.h5: cannot be read .'Unable to"):
        with open_verified(path):
            raise KeyError("Unable to synchronously open object (incorrect metadata checksum)")
    with pytest.raises(KeyError, match="^'name'$"):
        with open_verified(path):
            raise KeyError("name")
    with pytest.raises(InputError):
        with open_verified(path):
            raise InputError("of another file")


def test_a_file_in_the_place_of_a_folder_is_named(tmp_path):
    """Also where a folder above the output is a file."""
    blocked = tmp_path / "blocked"
    blocked.write_text("")
    done = faultgen_here(
        "generate", "--robot", "puma560", "--task", "spot_weld", "-o", blocked / "d"
    )
    assert done.returncode == 2
    assert "blocked" in done.stderr and "Errno" not in done.stderr
    assert done.stderr.count("\n") == 1


def test_the_same_arrays_are_the_same_bytes_at_any_time(tmp_path):
    """No time of creation is stored, also not in groups."""
    arrays = {"x": np.arange(3.0), "truth/y": np.eye(2)}
    write_arrays(tmp_path / "a.h5", arrays, {"seed": 1})
    time.sleep(1.1)  # times in HDF5 are whole seconds
    write_arrays(tmp_path / "b.h5", arrays, {"seed": 1})
    assert (tmp_path / "a.h5").read_bytes() == (tmp_path / "b.h5").read_bytes()

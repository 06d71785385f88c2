"""What the file of all runs tells of the runs, without reading them."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import fields
from pathlib import Path

import h5py
import numpy as np

from faultgen.errors import InputError, StorageFailed
from faultgen.provenance import Provenance
from faultgen.system.hdf5 import open_verified

MERGED = "dataset.h5"
"""Name of the file that holds all runs."""

ONLY_COPY = "only_copy"
"""Attribute of that file: whether runs without a file of their own are to be read from it."""


def only_in(merged: Path, *, whatever_it_says: bool = False) -> set[str]:
    """Find the runs that a file of all runs holds in place of run files.

    Args:
        merged: Path of the file.
        whatever_it_says: Whether it counts as the only copy even if it does not say so.

    Returns:
        Their ids; none if the file is missing or damaged, or if the runs have files of their own.
    """
    if not merged.is_file():
        return set()
    with suppress(InputError, StorageFailed):  # a damaged file is reported by `damaged`
        with open_verified(merged) as file:
            holds = whatever_it_says or file.attrs.get(ONLY_COPY, False)
            return set(file["runs"]) if holds else set()
    return set()


def values_of(stored: h5py.Dataset) -> np.ndarray:
    """Read an array of numbers or texts.

    Args:
        stored: The array.

    Returns:
        Its values, of the same shape; texts as objects of type str.
    """
    is_text = h5py.check_string_dtype(stored.dtype) is not None
    values: np.ndarray = stored.asstr()[()] if is_text else stored[()]
    return values


def index_column(merged: h5py.File, name: str) -> dict[str, str]:
    """Return a column of texts of the table of runs.

    Args:
        merged: The file of all runs.
        name: Name of the column.

    Returns:
        The texts by id of the run; nothing if every run failed, which leaves the table empty.
    """
    if "index/run" not in merged:
        return {}
    ids, texts = (values_of(merged[f"index/{column}"]).tolist() for column in ("run", name))
    return dict(zip(ids, texts, strict=True))


def made_by_of(merged: Path) -> dict[str, tuple[Provenance, str]]:
    """Return what made each run, and the checksum of its file, by id.

    To open each of many run files would take much longer.

    Args:
        merged: Path of the file of all runs.

    Returns:
        Nothing if the file is missing, damaged or of an older version.
    """
    if not merged.is_file():
        return {}
    with suppress(InputError, StorageFailed), open_verified(merged) as file:
        if "index/code_sha256" in file:
            sums = index_column(file, "file_sha256")
            made = [index_column(file, field.name) for field in fields(Provenance)]
            return {i: (Provenance(*(one[i] for one in made)), sums[i]) for i in sums}
    return {}

"""Files of named arrays: MATLAB (.mat, all versions) and NumPy (.npz).

A matrix ``q`` with a row, or a column, for each sample becomes the columns ``q_1``, ``q_2``, …; a
vector becomes one column. Arrays in a struct ``log`` are ``log.q_1`` and so on.
"""

from __future__ import annotations

import zipfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np

from faultgen.errors import InputError
from faultgen.importing.mat5 import order_of, read_mat5
from faultgen.importing.sizes import check_npz, check_size, check_tree
from faultgen.importing.table import Table
from faultgen.system.hdf5 import open_unverified

_HDF5 = b"MATLAB 7.3"


def read_arrays_of(path: Path) -> Table:
    """Read the arrays of a file.

    Args:
        path: MATLAB or NumPy file.

    Returns:
        Its arrays as columns; those of another length than the others are left out.

    Raises:
        InputError: The file cannot be read, or has no arrays of numbers.
    """
    check_size(path, path.stat().st_size)
    try:
        named = dict(_named(path))
    except InputError:
        raise
    except Exception as error:  # a damaged file can make the readers raise anything
        raise InputError(f"{path}: cannot be read ({' '.join(str(error).split())})") from None
    arrays = {name: np.squeeze(values) for name, values in named.items()}
    arrays = {name: values for name, values in arrays.items() if values.ndim in (1, 2)}
    lengths = Counter(max(values.shape) for values in arrays.values())
    if not lengths:
        raise InputError(f"{path}: has no arrays of numbers; save vectors or matrices")
    # the samples are what most columns have as their length
    length = max(lengths, key=lambda one: (one > 1, lengths[one], one))
    columns, left = {}, []
    for name, values in arrays.items():
        if length not in values.shape:
            left.append(name)
        elif values.ndim == 1:
            columns[name] = values
        else:
            rows = values if values.shape[0] == length else values.T
            columns.update({f"{name}_{k + 1}": row for k, row in enumerate(rows.T)})
    notes = [f"{length} samples"]
    if left:
        notes.append(f"arrays of another length were left out: {', '.join(left)}")
    return Table(source=str(path), columns=columns, notes=tuple(notes))


def _named(path: Path) -> Iterator[tuple[str, np.ndarray]]:
    with path.open("rb") as file:  # the readers leave files open that they cannot read
        begin = file.read(128)
        file.seek(0)
        if begin.startswith(b"PK"):
            with zipfile.ZipFile(file) as content:
                for member in check_npz(path, content):
                    with content.open(member) as one:
                        values = np.lib.format.read_array(one, allow_pickle=False)
                    yield from _numeric(member.removesuffix(".npy"), values)
            return
        if not (begin.startswith(_HDF5) or h5py.is_hdf5(path)):
            if order_of(begin) is not None:
                yield from read_mat5(path, file)
                return
            if 0 not in begin[:4]:  # version 4 has a small number there
                raise ValueError("it is no MATLAB file of a known version")
            from scipy.io import loadmat

            for name, values in loadmat(file).items():
                if not name.startswith("__"):
                    yield from _numeric(name, values)
            return
    with open_unverified(path) as tree:
        check_tree(path, tree)
        yield from _of_group("", tree, path)


def _of_group(prefix: str, group: h5py.Group, path: Path) -> Iterator[tuple[str, np.ndarray]]:
    for key in group:
        name = f"{prefix}.{key}" if prefix else key
        link = group.get(key, getlink=True)
        if key.startswith("#") or not isinstance(link, h5py.HardLink):
            continue
        item = group[key]
        if isinstance(item, h5py.Group):
            yield from _of_group(name, item, path)
        elif item.is_virtual or item.external:
            raise InputError(f"{path}: the data of {name} are in other files; copy them into this")
        elif item.dtype.kind in "fiu" and item.size:
            if not item.id.get_storage_size():
                raise InputError(f"{path}: {name} claims shape {item.shape}, which it cannot have")
            yield from _numeric(name, item[()])


def _numeric(name: str, values: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    if values.dtype.kind in "fiu" and values.size:
        yield name, values

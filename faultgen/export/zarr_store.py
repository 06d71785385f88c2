"""Runs as a Zarr store of format 3, which clouds and xarray read in pieces.

    runs/<id>/signals/motor_torque   and all other arrays of a run, in its own groups

Groups, arrays and attributes are those of the run files (docs/datasets.md). Signals have one chunk
for each cycle. Source: https://zarr-specs.readthedocs.io/en/latest/v3/core.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np

from faultgen.errors import InputError
from faultgen.export.cycles import Source
from faultgen.export.places import new_folder
from faultgen.system.arrays import plain_value
from faultgen.system.progress import follow
from faultgen.system.tables import optional

_WHOLE = 1 << 20  # bytes up to which an array is one chunk
_OF_DIMENSIONS = {"CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST"}
"""Attributes by which HDF5 names dimensions; Zarr has names of its own for that."""


def write_zarr(source: Source, out: Path) -> dict[str, Any]:
    """Write runs as a Zarr store.

    Args:
        source: The runs.
        out: Folder of the store, such as ``dataset.zarr``.

    Returns:
        What was written: numbers of runs and arrays.

    Raises:
        InputError: The package zarr is not installed or older than 3, or there is something at this
            place.
        StorageFailed: The store cannot be written.
    """
    zarr = optional("zarr")
    if int(zarr.__version__.partition(".")[0]) < 3:
        raise InputError(
            f"zarr {zarr.__version__} is too old; install it with: pip install 'zarr>=3'"
        )
    arrays = 0
    with new_folder(out) as folder:
        store = zarr.create_group(store=folder, zarr_format=3, attributes={"source": source.name})
        runs = store.create_group("runs")
        for run in follow(source.runs, "writing", len(source.runs), "run"):
            with run.open() as group:
                arrays += _copy(group, runs.create_group(run.id))
        zarr.consolidate_metadata(folder)
    return {"out": str(out), "runs": len(source.runs), "arrays": arrays}


def _copy(group: h5py.Group, target: Any) -> int:
    """Copy a group of a run file with all that is in it; the number of arrays."""
    target.attrs.update(_attributes(group))
    count = 0
    for name, item in group.items():
        if isinstance(item, h5py.Group):
            count += _copy(item, target.create_group(name))
            continue
        values = item[()]
        if isinstance(values, bytes | str):  # a text, such as the model
            target.attrs[name] = _plain(values)
            continue
        values = np.asarray(item.asstr()[()]) if h5py.check_string_dtype(item.dtype) else values
        small = values.nbytes <= _WHOLE or values.ndim < 2
        chunks = values.shape if small else (1, *values.shape[1:])
        array = target.create_array(
            name,
            data=np.asarray(values),
            chunks=tuple(max(n, 1) for n in chunks),
            dimension_names=[
                one[0].name.rpartition("/")[2] if len(one) else None for one in item.dims
            ],
        )
        array.attrs.update(_attributes(item))
        count += 1
    return count


def _attributes(item: h5py.Group | h5py.Dataset) -> dict[str, Any]:
    """Attributes as values of JSON."""
    return {name: _plain(one) for name, one in item.attrs.items() if name not in _OF_DIMENSIONS}


def _plain(value: Any) -> Any:
    """A value of JSON; bytes, nan and infinity become texts."""
    if isinstance(value, np.ndarray):
        return [_plain(one) for one in value.tolist()]
    value = plain_value(value)
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    if isinstance(value, list):
        return [_plain(one) for one in value]
    return str(value) if isinstance(value, float) and not np.isfinite(value) else value

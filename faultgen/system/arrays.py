"""Files of arrays and attributes that contain a checksum of their content.

write_arrays(Path("a.h5"), {"x": np.zeros(3)}, {"seed": 1})
arrays, attributes = read_arrays(Path("a.h5"))
with open_unverified(Path("a.h5")) as file:
    is_as_written(file)  # without reading whole arrays into memory
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from faultgen.errors import InputError, one_line
from faultgen.system.files import named_failures, removed_on_failure, rename, temporary_name
from faultgen.system.hdf5 import new_hdf5, open_unverified

_CONTENT = "content_sha256"
_AT_ONCE = 2**20  # values of an array that are summed up at a time: 8 MiB of memory


def write_arrays(
    path: Path,
    arrays: Mapping[str, np.ndarray],
    attributes: Mapping[str, Any],
    *,
    described: Mapping[str, tuple[str, str]] | None = None,
) -> None:
    """Write arrays and root attributes to an HDF5 file. If that fails, no new file is left.

    The attribute ``content_sha256`` is a checksum of the whole content, which `read_arrays` checks.

    Args:
        path: The file. Its folder is created if it does not exist.
        arrays: Arrays by name. Names may contain groups, as in "truth/damage".
        attributes: Numbers, texts or arrays by name.
        described: SI unit and meaning of arrays by name, which become their attributes ``units``
            and ``long_name``. Names that are not among the arrays are ignored.

    Raises:
        StorageFailed: The file cannot be written. An older file of that name is unchanged.
    """
    temporary = temporary_name(path)
    with named_failures(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    arrays = {name: np.asarray(values) for name, values in arrays.items()}
    with new_hdf5(path) as (file, _):
        for name, values in arrays.items():
            file.create_dataset(name, data=values)
        told = {name: text for name, text in (described or {}).items() if name in arrays}
        for name, (units, long_name) in told.items():
            file[name].attrs.update({"units": units, "long_name": long_name})
        file.attrs.update(attributes)
        file.attrs[_CONTENT] = _sum_up(arrays, attributes, told)
    with removed_on_failure(temporary), named_failures(path):
        rename(temporary, path)


def read_arrays(path: Path) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Read a file that `write_arrays` wrote, and check that it has not changed.

    Args:
        path: The file.

    Returns:
        Arrays by name, with the shapes and units with which they were written, and root attributes
        by name. Scalars of numpy become numbers of Python.

    Raises:
        InputError: The file cannot be read, is damaged, or was not written by `write_arrays`.
    """
    arrays: dict[str, np.ndarray] = {}
    told: dict[str, tuple[str, str]] = {}

    def note(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            arrays[name] = np.asarray(item[()])
            told.update(_told({name: item}))

    try:
        with open_unverified(path) as file:
            file.visititems(note)
            attributes = {name: plain_value(value) for name, value in file.attrs.items()}
    except (OSError, ValueError, RuntimeError) as error:
        line = one_line(error)
        raise InputError(f"{path}: damaged or not an HDF5 file ({line})") from None
    wanted = attributes.pop(_CONTENT, None)
    if wanted != _sum_up(arrays, attributes, told):
        raise InputError(f"{path}: damaged (its content differs from its checksum)")
    return arrays, attributes


def is_as_written(
    file: h5py.File, check: Callable[[str, h5py.Dataset], None] = lambda name, item: None
) -> bool | None:
    """Compare the content of an open file with the checksum that it contains.

    Args:
        file: The file. Links of it are not followed.
        check: Called with the name of each array and the array before it is read. It raises an
            error if the array should not be read.

    Returns:
        Whether they are the same; None if the file has no checksum.
    """
    if _CONTENT not in file.attrs:
        return None
    found: dict[str, h5py.Dataset] = {}

    def note(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            check(name, item)
            found[name] = item

    file.visititems(note)
    attributes = {name: plain_value(value) for name, value in file.attrs.items()}
    wanted = attributes.pop(_CONTENT)
    return bool(wanted == _sum_up(found, attributes, _told(found)))


def _told(arrays: Mapping[str, h5py.Dataset]) -> dict[str, tuple[str, str]]:
    """Unit and meaning of arrays, as `write_arrays` has written them."""
    return {
        name: (str(item.attrs.get("units")), str(item.attrs.get("long_name")))
        for name, item in arrays.items()
        if item.attrs
    }


def plain_value(value: Any) -> Any:
    """Convert a scalar of numpy to a number of Python; return any other value unchanged."""
    return value.item() if isinstance(value, np.generic) else value


def _sum_up(
    arrays: Mapping[str, np.ndarray | h5py.Dataset],
    attributes: Mapping[str, Any],
    described: Mapping[str, tuple[str, str]],
) -> str:
    total = hashlib.sha256()
    for name in sorted(arrays):
        values = arrays[name]
        total.update(f"{name} {values.dtype.str} {values.shape} ".encode())
        for part in _parts(values):
            total.update(np.ascontiguousarray(part).data)
    for name in sorted(attributes):
        value = np.asarray(plain_value(attributes[name]))
        total.update(f"{name} {value.tolist()!r} ".encode())
    for name in sorted(described):
        total.update(f"{name} {described[name]!r} ".encode())
    return total.hexdigest()


def _parts(values: np.ndarray | h5py.Dataset) -> Iterator[np.ndarray]:
    """The values of an array in their order, some rows at a time."""
    if not values.shape or not values.size:
        yield np.asarray(values[()])
        return
    rows = max(1, _AT_ONCE * len(values) // int(values.size))
    for start in range(0, len(values), rows):
        yield np.asarray(values[start : start + rows])

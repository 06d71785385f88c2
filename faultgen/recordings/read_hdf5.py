"""Arrays and attributes of an HDF5 file. Nothing outside the file is opened."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from faultgen.errors import InputError
from faultgen.system.arrays import is_as_written
from faultgen.system.hdf5 import open_unverified

SIDES = ("motor", "joint")

NAMES = (
    *(f"{side}_{what}" for side in SIDES for what in ("position", "velocity", "torque")),
    "motor_current",
    "reference_position",
    "temperature",
)
"""Arrays that a recording may have. Other arrays are ignored."""

TIME = "time"
"""Array that is read if there is no ``sample_period``."""

ATTRIBUTES = ("robot", "sample_period", "segments", "payload_mass", "torque_sensor", "date")
"""Attributes that a recording may have."""

MOST = 100_000_000
"""Largest number of values that an array may claim."""

MOST_TOGETHER = 40_000_000
"""Largest number of values in all arrays together: 320 MB in memory. That is an hour of six axes at
400 Hz with all arrays; checks and resampling take copies of some of them, and stay below 1 GB."""

_MOST_ATTRIBUTE = 1_000_000  # values that an attribute may have
_HOPS = 8  # links within a file that are followed


def read_hdf5(path: Path) -> tuple[dict[str, np.ndarray], dict[str, Any], bool | None]:
    """Read the arrays and attributes of a recording.

    The claimed size of an array is checked before the array is read.

    Args:
        path: The file.

    Returns:
        Arrays by name, shape (samples, n_axes) or (samples,) as the file has them, attributes by
        name, and whether the file is as `export` or `import` has written it: None if it has no
        checksum, as those that others write. Shapes are not checked here.

    Raises:
        InputError: An array is in another file, does not hold numbers, or claims an impossible
            size.
        OSError: The file is not HDF5, or damaged.
    """
    with open_unverified(path) as file:
        attributes = {name: _attribute(path, file, name) for name in ATTRIBUTES}
        named: dict[str, np.ndarray] = {}
        for name in NAMES if attributes["sample_period"] is not None else (*NAMES, TIME):
            place = _place(path, file, name)
            if place is not None:
                used = sum(values.size for values in named.values())
                named[name] = _array(path, name, file[place], MOST_TOGETHER - used)
        intact = None  # a dataset has no such arrays, and another checksum
        if named:
            intact = is_as_written(file, lambda name, item: _check_claims(path, name, item, MOST))
        told = {name: value for name, value in attributes.items() if value is not None}
        return named, told, intact


def _place(path: Path, file: h5py.File, name: str, hops: int = _HOPS) -> str | None:
    """Path of an object in the file after following its links; None if there is no such object.

    Raises:
        InputError: A link leads out of the file, or in a circle.
    """
    if not hops:
        raise InputError(f"{path}: {name} is a link that leads in a circle")
    at = ""
    steps = [step for step in name.split("/") if step]
    for k, step in enumerate(steps, start=1):
        group = file[at or "/"]
        link = group.get(step, getlink=True) if isinstance(group, h5py.Group) else None
        if link is None:
            return None
        if isinstance(link, h5py.ExternalLink):
            raise InputError(
                f"{path}: {step} is a link to another file; copy its data into this one"
            )
        if isinstance(link, h5py.SoftLink):
            start = "" if link.path.startswith("/") else at
            return _place(path, file, "/".join([start, link.path, *steps[k:]]), hops - 1)
        at = f"{at}/{step}"
    return at


def _array(path: Path, name: str, item: Any, left: int) -> np.ndarray:
    _check_claims(path, name, item, left)
    # a damaged type of numbers gives numbers that are not finite, which the checks name
    with np.errstate(invalid="ignore", over="ignore"):
        return np.asarray(item[()], float)


def _check_claims(path: Path, name: str, item: Any, left: int) -> None:
    """Refuse an array that is not in the file, or has more values than are left to be read."""
    if not isinstance(item, h5py.Dataset):
        raise InputError(f"{path}: {name} is not an array")
    if item.is_virtual or item.external:
        raise InputError(f"{path}: the data of {name} are in other files; copy them into this one")
    if item.shape is None:
        raise InputError(f"{path}: {name} is empty")
    if item.dtype.kind not in "fiu":
        raise InputError(f"{path}: {name} must hold numbers, not {item.dtype}")
    for shape in (item.shape, item.chunks or ()):
        if math.prod(shape) > MOST:
            raise InputError(
                f"{path}: {name} claims shape {item.shape}, more than {MOST:,} values; "
                "give a shorter recording"
            )
        if math.prod(shape) > left:
            raise InputError(
                f"{path}: its arrays have more than {MOST_TOGETHER:,} values together, the most "
                "that is read; give a shorter recording, or one without arrays that are not needed"
            )
    if item.size and not item.id.get_storage_size():
        raise InputError(f"{path}: {name} claims shape {item.shape}, but no values were written")


def _attribute(path: Path, file: h5py.File, name: str) -> Any:
    """An attribute, or None if there is none."""
    if name not in file.attrs:
        return None
    one = file.attrs.get_id(name)
    if one.get_space().get_simple_extent_type() == h5py.h5s.NULL:
        raise InputError(f"{path}: attribute {name} is empty")
    if math.prod(one.shape) > _MOST_ATTRIBUTE:
        raise InputError(f"{path}: attribute {name} claims {math.prod(one.shape):,} values")
    return file.attrs[name]

"""Reading of measured files. All claims of a file are checked before its data are used.

An HDF5 file that faultgen has written contains a checksum of its content, which is compared. CSV
files, and HDF5 files that others write, have none.

recording = read_recording("measured.h5")
recording.torque.shape  # (samples, n_axes)
"""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from faultgen.errors import InputError, StorageFailed, one_line
from faultgen.recordings.fields import fields_of
from faultgen.recordings.read_csv import read_csv
from faultgen.recordings.read_hdf5 import read_hdf5
from faultgen.recordings.recording import Recording
from faultgen.system.reading import check_file

_DIFFERS = (
    "differs from its checksum: copy, import or export it again, or delete its attribute "
    "content_sha256 if you have changed it on purpose"
)

# a damaged file can make h5py raise any of these
_UNREADABLE = (OSError, RuntimeError, ValueError, TypeError, KeyError, MemoryError)
_DISK_FAILURES = {errno.EIO, errno.ESTALE, errno.ENXIO, errno.ETIMEDOUT}


def is_complete(path: Path) -> bool:
    """Whether a file is an HDF5 recording that its own checksum shows to be complete.

    Args:
        path: The file, which may be written at this moment.
    """
    try:
        return h5py.is_hdf5(path) and read_hdf5(path)[2] is True
    except _UNREADABLE:  # among them InputError
        return False


def read_recording(path: str | Path) -> Recording:
    """Read a measured file.

    Args:
        path: HDF5 (``.h5``, ``.hdf5``) or CSV file.

    Returns:
        The recording.

    Raises:
        InputError: The file cannot be read, lacks something, differs from its checksum, or an
            array has another shape. The message is one line.
        StorageFailed: The disk failed.
    """
    path = Path(path)
    check_file(path)
    try:
        named, attributes, intact = _content(path)
    except InputError:
        raise
    except _UNREADABLE as error:
        number = getattr(error, "errno", None)
        if number in _DISK_FAILURES:
            raise StorageFailed(f"{path}: cannot be read ({os.strerror(number)})") from None
        raise InputError(f"{path}: cannot be read ({one_line(error)})") from None
    try:
        fields = fields_of(str(path), named, attributes)
    except InputError as error:
        if intact is False:
            raise InputError(f"{error}; its content also {_DIFFERS}") from None
        raise
    if intact is False:
        raise InputError(f"{path}: damaged: its content {_DIFFERS}")
    return Recording(**fields)


def _content(path: Path) -> tuple[dict[str, np.ndarray], dict[str, Any], bool | None]:
    """Arrays and attributes by name, and whether they are as written, as `read_hdf5` returns it."""
    if path.suffix.lower() == ".csv":
        return *read_csv(path), None
    if h5py.is_hdf5(path):
        return read_hdf5(path)
    raise InputError(
        f"{path}: is no recording, because it is neither an HDF5 file nor named .csv; "
        "'faultgen import' makes a recording of a log"
    )

"""Reading of measured files. All claims of a file are checked before its data are used.

recording = read_recording("measured.h5")
recording.torque.shape  # (samples, n_axes)
"""

from __future__ import annotations

from pathlib import Path

import h5py

from faultgen.discovery.fields import fields_of
from faultgen.discovery.read_csv import read_csv
from faultgen.discovery.read_hdf5 import read_hdf5
from faultgen.discovery.recording import Recording
from faultgen.errors import InputError
from faultgen.system.reading import check_file


def read_recording(path: str | Path) -> Recording:
    """Read a measured file.

    Args:
        path: HDF5 (``.h5``, ``.hdf5``) or CSV file.

    Returns:
        The recording.

    Raises:
        InputError: The file cannot be read, lacks something, or an array has another shape. The
            message is one line.
    """
    path = Path(path)
    check_file(path)
    is_csv = path.suffix.lower() == ".csv"
    if not is_csv and not h5py.is_hdf5(path):
        raise InputError(
            f"{path}: is no recording, because it is neither an HDF5 file nor named .csv; "
            "'faultgen import' makes a recording of a log"
        )
    try:
        named, attributes = read_csv(path) if is_csv else read_hdf5(path)
    except InputError:
        raise
    # a damaged file can make h5py raise any of these
    except (OSError, RuntimeError, ValueError, TypeError, KeyError, MemoryError) as error:
        raise InputError(f"{path}: cannot be read ({' '.join(str(error).split())})") from None
    return Recording(**fields_of(str(path), named, attributes))

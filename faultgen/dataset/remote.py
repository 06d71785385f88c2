"""Datasets at an address, such as ``s3://bucket/out`` or ``https://host/out/dataset.h5``.

The file of all runs is copied once into a cache, in a folder that is named after its checksum, so
that a file that has changed there is another one here, and is copied again.

    local_copy("s3://bucket/out")  # Path('…/faultgen/datasets/3b1f…/dataset.h5')
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from faultgen.dataset.merged_file import MERGED
from faultgen.errors import InputError, one_line
from faultgen.system.files import (
    file_sha256,
    named_failures,
    publish,
    removed_on_failure,
    temporary_name,
)
from faultgen.system.tables import optional

CACHE = "FAULTGEN_CACHE"
"""Environment variable with the folder of the cache."""

_DIGITS = 64  # of a checksum
_READ = 1 << 22  # bytes at a time


def is_remote(place: str | Path) -> bool:
    """Tell whether something is an address and not a path.

    Args:
        place: An address with a protocol, or a path.
    """
    return "://" in str(place)


def cache_folder() -> Path:
    """Return the folder in which copies are kept.

    It is that of the environment variable `FAULTGEN_CACHE`, or the usual place of the system.
    """
    usual = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(os.environ.get(CACHE) or Path(usual) / "faultgen") / "datasets"


def local_copy(address: str) -> Path:
    """Copy the file of all runs from an address, if it is not in the cache yet.

    Args:
        address: Of a folder that `faultgen generate` wrote, or of its ``dataset.h5``, in any file
            system of fsspec. The checksum ``dataset.h5.sha256`` has to be beside it.

    Returns:
        Path of the copy.

    Raises:
        InputError: fsspec or a package for this protocol is missing, nothing is there, or what is
            there differs from its checksum.
        StorageFailed: The copy cannot be written.
    """
    optional("fsspec")
    place = address if address.endswith(".h5") else f"{address.rstrip('/')}/{MERGED}"
    told = b"".join(_parts(f"{place}.sha256", address))
    checksum = told.decode("ascii", "replace").split(maxsplit=1)[:1]
    if not checksum or len(checksum[0]) != _DIGITS:
        raise InputError(f"{place}.sha256: holds no checksum; copy the dataset there again")
    path = cache_folder() / checksum[0] / MERGED
    if path.is_file():
        return path
    with named_failures(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    temporary = temporary_name(path)
    with removed_on_failure(temporary):
        with named_failures(path), temporary.open("wb") as copy:
            for part in _parts(place, address):
                copy.write(part)
            copy.flush()
            os.fsync(copy.fileno())
        if file_sha256(temporary) != checksum[0]:
            raise InputError(f"{place}: differs from its checksum {place}.sha256; copy both again")
        publish(temporary, path, checksum[0])
    return path


def _parts(place: str, address: str) -> Iterator[bytes]:
    """Read a file at an address, some MB at a time."""
    import fsspec

    try:
        with fsspec.open(place, "rb") as file:
            while part := file.read(_READ):
                yield part
    except FileNotFoundError:
        raise InputError(
            f"{address}: there is no {place}; give the address of a folder that 'faultgen "
            "generate' wrote, with its dataset.h5 and dataset.h5.sha256"
        ) from None
    except ImportError as error:
        raise InputError(f"{address}: {one_line(error)}") from None
    except Exception as error:  # of any file system and network
        raise InputError(f"{address}: cannot be read: {one_line(error)}") from None

"""HDF5 files that stay open while windows are read from them."""

from __future__ import annotations

import os
from collections import OrderedDict
from pathlib import Path
from typing import Any

import h5py

from faultgen.system.files import verify

_MOST_OPEN = 64  # files of a process


class OpenFiles:
    """The HDF5 files that a process has open. Another process, or a copy, opens them anew."""

    def __init__(self) -> None:
        self._process = 0
        self._open: OrderedDict[Path, h5py.File] = OrderedDict()

    def __getstate__(self) -> dict[str, Any]:
        """Take no open file to another process."""
        return {"_process": 0, "_open": OrderedDict()}

    @property
    def is_open(self) -> bool:
        """Whether this process has a file open."""
        return bool(self._open) and self._process == os.getpid()

    def get(self, path: Path) -> h5py.File:
        """Return an open file, and close the one that was not used for longest if there are many.

        Args:
            path: The file.

        Raises:
            InputError: It is damaged.
        """
        if self._process != os.getpid():
            self._process, self._open = os.getpid(), OrderedDict()
        if path not in self._open:
            verify(path)
            if len(self._open) >= _MOST_OPEN:
                self._open.popitem(last=False)[1].close()
            self._open[path] = h5py.File(path, "r")
        self._open.move_to_end(path)
        return self._open[path]

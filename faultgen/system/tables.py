"""Tables that are written for other programs, and the packages that this needs."""

from __future__ import annotations

import io
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from faultgen.errors import InputError
from faultgen.system.files import named_failures, write_checked

if TYPE_CHECKING:
    import pandas as pd


def optional(module: str, package: str | None = None) -> Any:
    """Import a package that only the exchange of data needs, or one of its modules.

    Args:
        module: Name of the package or module.
        package: Name under which pip installs it. Default: the first part of `module`.

    Returns:
        The package or module.

    Raises:
        InputError: It is not installed. The message says how to install it.
    """
    package = package or module.partition(".")[0]
    try:
        return import_module(module)
    except ImportError:
        raise InputError(
            f"{package} is not installed; install it with: pip install {package}"
        ) from None


def write_parquet(frame: pd.DataFrame, path: Path) -> None:
    """Write a table to a Parquet file, with a checksum beside it.

    The metadata of the file hold ``frame.attrs``. pandas reads both back.

    Args:
        frame: The table.
        path: The file. Its folder is created if it does not exist.

    Raises:
        InputError: pyarrow is not installed.
        StorageFailed: The file cannot be written, or does not hold what was written.
    """
    optional("pyarrow")
    content = io.BytesIO()
    frame.to_parquet(content, engine="pyarrow", index=False)
    with named_failures(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    write_checked(path, content.getvalue())

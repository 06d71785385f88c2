"""Folders and files that are either written completely or not at all.

    with new_folder(Path("out")) as folder:
        (folder / "README.md").write_text("text")

A folder is filled under a temporary name and renamed when it is complete.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from faultgen.dataset.manifest import refuse_data
from faultgen.errors import InputError
from faultgen.system.files import named_failures, removed_on_failure, rename, temporary_name


def check_new(path: Path) -> None:
    """Refuse to write where something is already.

    Args:
        path: The folder or file that is to be written.

    Raises:
        InputError: It exists, and is not an empty folder.
    """
    refuse_data(path)
    if path.is_dir() and any(path.iterdir()):
        raise InputError(f"{path}: is not empty; give another folder, or remove this one")
    if path.is_file():
        raise InputError(f"{path}: exists; give another name, or remove it")


@contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """Fill a folder that does not exist yet, or is empty.

    Args:
        path: The folder.

    Yields:
        The folder under its temporary name.

    Raises:
        InputError: The folder exists and is not empty.
        StorageFailed: It cannot be written. Nothing is left of it then.
    """
    check_new(path)
    temporary = temporary_name(path.absolute())
    try:
        with named_failures(path):
            shutil.rmtree(temporary, ignore_errors=True)
            temporary.mkdir(parents=True)
            yield temporary
            if path.is_dir():
                path.rmdir()
            temporary.rename(path)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


@contextmanager
def new_file(path: Path) -> Iterator[Path]:
    """Write a file that does not exist yet.

    Args:
        path: The file.

    Yields:
        The file under its temporary name.

    Raises:
        InputError: The file exists.
        StorageFailed: It cannot be written. Nothing is left of it then.
    """
    check_new(path)
    temporary = temporary_name(path.absolute())
    with removed_on_failure(temporary), named_failures(path):
        path.absolute().parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        rename(temporary, path.absolute())

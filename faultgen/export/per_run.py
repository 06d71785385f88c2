"""Formats that play a recording back: one file for each run, or one file for several runs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from faultgen.errors import InputError
from faultgen.export.cycles import Source
from faultgen.export.places import new_file, new_folder


@contextmanager
def places(source: Source, out: Path, ending: str) -> Iterator[dict[str, tuple[Path, str]]]:
    """Choose the file of each run, and the prefix of its names in this file.

    Args:
        source: The runs.
        out: A file, if it ends so; otherwise a folder that gets one file for each run.
        ending: Ending of the files, such as ".mcap".

    Yields:
        Temporary path and prefix by id of the run. The prefix is empty if the file has no other
        run, and otherwise "/" and the id.

    Raises:
        InputError: There is something already at this place.
        StorageFailed: It cannot be written. Nothing is left of it then.
    """
    ids = [run.id for run in source.runs]
    if len(set(ids)) < len(ids):
        raise InputError(f"{source.name}: gives a run twice")
    if out.suffix == ending:
        with new_file(out) as path:
            yield {i: (path, f"/{i}" if len(ids) > 1 else "") for i in ids}
    else:
        with new_folder(out) as folder:
            yield {i: (folder / f"{i}{ending}", "") for i in ids}

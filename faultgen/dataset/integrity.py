"""Which files of a dataset are damaged, which runs failed, and what made the others."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from faultgen.dataset.inputs import damaged_inputs
from faultgen.dataset.manifest import DATA_CARD, EXPERIMENT
from faultgen.dataset.merged_file import MERGED, made_by_of
from faultgen.dataset.stored_run import StoredRun
from faultgen.errors import InputError
from faultgen.provenance import Provenance
from faultgen.system.files import damages, file_sha256, verify
from faultgen.system.hdf5 import open_verified


def damaged_files(
    folder: Path, file: Path | None, runs: Sequence[StoredRun], experiment_sha256: str
) -> dict[str, str]:
    """Find damaged files. All files of the dataset are read completely.

    Args:
        folder: Folder of the dataset.
        file: The file of all runs, if nothing else of the folder is to be read.
        runs: The runs that exist.
        experiment_sha256: Hash of the experiment, from the list of runs.

    Returns:
        Reasons by file name, relative to the folder; empty if no file is damaged.
    """
    merged = folder / MERGED if file is None else file
    files = [merged] if merged.is_file() else []  # the largest one first
    files += [run.path for run in runs if run.own_file]
    reasons: dict[str, str | None] = {
        str(path.relative_to(folder)): reason for path, reason in damages(files).items()
    }
    if file is None:
        reasons[EXPERIMENT] = _experiment_damage(folder, experiment_sha256)
        reasons |= damaged_inputs(folder)
        if merged.is_file() and MERGED not in reasons:
            reasons[DATA_CARD] = _card_damage(folder)
    return {name: reason for name, reason in reasons.items() if reason is not None}


def _card_damage(folder: Path) -> str | None:
    """Compare the data card with its copy in the file of all runs."""
    with open_verified(folder / MERGED) as merged:
        wanted = merged[DATA_CARD][()] if DATA_CARD in merged else None
    try:
        found = (folder / DATA_CARD).read_bytes()
    except OSError as error:
        found, reason = b"", f"cannot be read ({error.strerror})"
    else:
        reason = f"differs from its copy in {MERGED}"
    return reason if wanted is not None and found != wanted else None


def _experiment_damage(folder: Path, wanted: str) -> str | None:
    """Compare the experiment with the checksum in the list of runs."""
    try:
        found = file_sha256(folder / EXPERIMENT)
    except OSError as error:
        return f"cannot be read ({error.strerror})"
    if found != wanted:
        return "is not the experiment that made this dataset"
    return None


def versions_of(runs: Sequence[StoredRun], merged: Path) -> dict[Provenance, list[str]]:
    """Group intact runs by the versions and code that made them.

    Args:
        runs: The runs that exist.
        merged: The file of all runs, which need not exist.

    Returns:
        Their ids.
    """
    found: dict[Provenance, list[str]] = {}
    told = made_by_of(merged)
    for run in runs:
        with suppress(InputError):  # a damaged file is reported by `damaged_files`
            made_by, checksum = told.get(run.id, (None, ""))
            if made_by is None or (run.own_file and verify(run.path) != checksum):
                made_by = run.made_by
            found.setdefault(made_by, []).append(run.id)
    return found


def failures(folder: Path, missing: Sequence[str]) -> dict[str, str]:
    """Find the reasons why runs failed, from the notes in place of their files.

    Args:
        folder: Folder of the run files.
        missing: Ids of the runs that do not exist.

    Returns:
        Reasons by id.
    """
    notes = {i: folder / f"{i}.failed.json" for i in missing}
    return {i: _reason(note) for i, note in notes.items() if note.is_file()}


def _reason(note: Path) -> str:
    """Why a run failed, from the note beside it."""
    try:
        return str(json.loads(note.read_bytes())["reason"])
    except (OSError, ValueError, KeyError, TypeError):
        return "unknown: the note about it cannot be read"

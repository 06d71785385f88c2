"""The list of runs that a dataset should hold: the file ``runs.json``.

The list also says how the runs are divided into a training part and a test part. It carries its own
checksum and that of ``experiment.toml``, so that a change of either file is noticed. Both files can
be restored from the experiment.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from faultgen.dataset.splits import RunParts
from faultgen.errors import InputError
from faultgen.system.files import write_text
from faultgen.system.sealed_json import damage, sealed, unsealed

SCHEMA_VERSION = 2
"""Version of the layout of run files."""

FILE = "runs.json"
FLEET = "fleet.json"
"""Name of the file with the plan of a fleet, which shows that a folder holds no dataset."""
EXPERIMENT = "experiment.toml"
DATA_CARD = "DATACARD.md"

_PART = re.compile(r"part-0*([1-9]\d*)-of-([1-9]\d*)")
_RUN_ID = re.compile(r"[0-9a-f]{16}")
_NEEDED = ("robot", "task", "seed", "effect", "axes", "severity", "cycles", "sensors")


class OtherLayout(InputError):
    """A dataset has a layout that this version of faultgen does not read."""


def check_layout(version: Any, path: Path) -> None:
    """Refuse data whose layout is not the one that this version reads.

    Args:
        version: Attribute ``schema_version`` of the data.
        path: The file that states it, for the message.

    Raises:
        OtherLayout: The version is another one.
    """
    if version != SCHEMA_VERSION:
        newer = isinstance(version, int | float) and version > SCHEMA_VERSION
        raise OtherLayout(
            f"{path}: has the layout (schema_version) {version}, and this version of faultgen "
            f"reads {SCHEMA_VERSION}; "
            + ("install a newer version" if newer else "make the dataset again, in another folder")
        )


def is_fleet(folder: str | Path) -> bool:
    """Whether a folder is that of a fleet."""
    return (Path(folder) / FLEET).is_file()


def part_names(folder: Path) -> list[str]:
    """Names of the folders in which the parts of a dataset are, in their order.

    Args:
        folder: The folder of the dataset, which need not exist.
    """
    return sorted(one.name for one in folder.glob("part-*-of-*") if _PART.fullmatch(one.name))


def is_in_parts(folder: Path) -> bool:
    """Whether a folder is that of a dataset in parts.

    Args:
        folder: The folder, which need not exist.
    """
    return not (folder / FILE).exists() and bool(part_names(folder))


def check_exists(path: Path) -> None:
    """Refuse the path of a dataset that does not exist.

    Args:
        path: Its folder or file.

    Raises:
        InputError: There is nothing.
    """
    if not path.exists():
        raise InputError(f"{path}: no such file or folder; make a dataset with 'faultgen generate'")


def refuse_data(folder: Path) -> None:
    """Refuse a folder for results that holds a dataset or a fleet.

    Args:
        folder: The folder, which need not exist.

    Raises:
        InputError: It holds a dataset or a fleet.
    """
    for name, what in ((FILE, "a dataset"), (FLEET, "a fleet")):
        if (folder / name).is_file():
            raise InputError(f"{folder}: holds {what}; give another folder for the results")
    if part_names(folder):
        raise InputError(f"{folder}: holds a dataset in parts; give another folder for the results")


@dataclass(frozen=True)
class Manifest:
    """What a dataset should hold."""

    runs: dict[str, dict[str, Any]]
    """Parameters of every run, by id."""
    experiment_sha256: str
    """Hash of ``experiment.toml``."""
    splits: RunParts = field(default_factory=dict)
    """Ids of the runs of each part, by division; empty in datasets of older versions."""

    def text(self) -> str:
        """Return the content of the file, which begins with its checksum."""
        content = {
            "experiment_sha256": self.experiment_sha256,
            "runs": self.runs,
            "splits": self.splits,
        }
        return sealed(content)

    def write(self, folder: Path) -> None:
        """Write the list into the folder of a dataset.

        Args:
            folder: The folder.

        Raises:
            StorageFailed: The file cannot be written.
        """
        write_text(folder / FILE, self.text())

    @classmethod
    def read(cls, folder: Path) -> Manifest:
        """Read the list of a dataset.

        Args:
            folder: The folder of the dataset.

        Returns:
            The list.

        Raises:
            InputError: The list is missing, damaged, or was not written by `write`.
        """
        path = folder / FILE
        try:
            return cls.parse(path.read_bytes(), path)
        except FileNotFoundError:
            if (folder / FLEET).is_file():
                raise InputError(f"{folder}: is a fleet, and not a dataset") from None
            raise InputError(
                f"{folder}: is not a dataset (it has no {FILE}); make one with 'faultgen generate'"
            ) from None
        except OSError as error:
            raise InputError(f"{path}: cannot be read ({error.strerror})") from None

    @classmethod
    def parse(cls, text: bytes, path: Path) -> Manifest:
        """Read the list from the content of its file.

        Args:
            text: The content.
            path: The file that holds it, for messages.

        Returns:
            The list.

        Raises:
            InputError: The list is damaged, was not written by `write`, or its runs have another
                layout.
        """
        try:
            content = unsealed(text)
            for run_id, parameters in content["runs"].items():
                if not _RUN_ID.fullmatch(run_id):
                    raise ValueError(f"'{run_id}' is not the id of a run")
                if missing := [name for name in _NEEDED if name not in parameters]:
                    raise ValueError(f"run {run_id} has no {missing[0]}")
            found = cls(content["runs"], content["experiment_sha256"], content.get("splits", {}))
        except (KeyError, ValueError, TypeError, AttributeError) as error:
            raise _damaged(path, damage(error)) from None
        for parameters in found.runs.values():
            check_layout(parameters.get("schema_version"), path)
        return found


def _damaged(path: Path, reason: str) -> InputError:
    return InputError(f"{path}: damaged ({reason}); run the generate command again to restore it")

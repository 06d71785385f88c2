"""The list of runs that a dataset should hold: the file ``runs.json``.

The list carries its own checksum and that of ``experiment.toml``, so that a change of either file
is noticed. Both files can be restored from the experiment.
"""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from faultgen.errors import InputError
from faultgen.system.files import write_text

FILE = "runs.json"
EXPERIMENT = "experiment.toml"

_RUN_ID = re.compile(r"[0-9a-f]{16}")
_NEEDED = ("robot", "task", "seed", "effect", "axes", "severity", "cycles", "sensors")


@dataclass(frozen=True)
class Manifest:
    """What a dataset should hold."""

    runs: dict[str, dict[str, Any]]
    """Parameters of every run, by id."""
    experiment_sha256: str
    """Hash of ``experiment.toml``."""

    def write(self, folder: Path) -> None:
        """Write the list into the folder of a dataset.

        Args:
            folder: The folder.

        Raises:
            StorageFailed: The file cannot be written.
        """
        content = {"experiment_sha256": self.experiment_sha256, "runs": self.runs}
        text = json.dumps({"sha256": _sha256(content), **content}, indent=1)
        write_text(folder / FILE, text + "\n")

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
            content = json.loads(path.read_bytes())
            if content.pop("sha256") != _sha256(content):
                raise ValueError("it differs from its checksum")
            for run_id, parameters in content["runs"].items():
                if not _RUN_ID.fullmatch(run_id):
                    raise ValueError(f"'{run_id}' is not the id of a run")
                if missing := [name for name in _NEEDED if name not in parameters]:
                    raise ValueError(f"run {run_id} has no {missing[0]}")
            return cls(content["runs"], content["experiment_sha256"])
        except FileNotFoundError:
            raise InputError(
                f"{folder}: is not a dataset (it has no {FILE}); make one with 'faultgen generate'"
            ) from None
        except OSError as error:
            raise InputError(f"{path}: cannot be read ({error.strerror})") from None
        except KeyError as error:
            raise _damaged(path, f"it has no {error}") from None
        except (ValueError, TypeError, AttributeError, RecursionError) as error:
            raise _damaged(path, " ".join(str(error).split())) from None


def _damaged(path: Path, reason: str) -> InputError:
    return InputError(f"{path}: damaged ({reason}); run the generate command again to restore it")


def _sha256(content: Any) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

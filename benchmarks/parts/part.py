"""A part of the results: the commands that measure it, and the table that shows it.

Commands run in a folder of their own, in which `python` and `faultgen` are those of this
environment and `$INPUTS` is the folder of what was prepared. The last command writes NAME.json.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from tabulate import tabulate

from faultgen.provenance import Provenance, provenance
from faultgen.system.machine import gpu

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "benchmarks" / "results"
DOCS = ROOT / "docs"

GPU = "an NVIDIA GPU"
"""One of the things that a part may need."""


@dataclass(frozen=True, kw_only=True)
class Inputs:
    """What is made once for several parts."""

    name: str
    """Of the folder."""
    commands: tuple[str, ...]
    """Run one after another in the folder."""
    code: tuple[str, ...]
    """Modules on which the inputs depend, with all that these import."""
    minutes: float
    """How long the commands take on 2 cores."""

    @property
    def made_by(self) -> Provenance:
        """The present code."""
        return provenance(self.code[0], more=self.code[1:])


@dataclass(frozen=True, kw_only=True)
class Part:
    """Numbers that are measured together and shown in one table."""

    name: str
    """Of the JSON file, and in the comment of the page before the table."""
    commands: tuple[str, ...]
    """Run one after another in a folder; one that was done there is not run again."""
    code: tuple[str, ...]
    """Modules on which the numbers depend, with all that these import."""
    page: str
    """Page below docs/ that has the table between `<!-- NAME.json -->` and `<!-- end -->`."""
    table: Callable[[dict[str, Any]], str]
    """Makes Markdown of the numbers."""
    minutes: float
    """How long the commands take on 2 cores, without the inputs."""
    files: tuple[str, ...] = ()
    """Files of the repository on which the numbers depend, besides code."""
    inputs: Inputs | None = None
    """What is made before."""
    needs: tuple[str, ...] = ()
    """Modules that must be installed, or `GPU`."""

    @property
    def path(self) -> Path:
        """The file of the numbers."""
        return RESULTS / f"{self.name}.json"

    @property
    def made_by(self) -> Provenance:
        """The present code, and the present files."""
        others = self.inputs.code if self.inputs else ()
        code = provenance(self.code[0], more=(*self.code[1:], *others))
        total = hashlib.sha256(code.code_sha256.encode())
        for name in self.files:
            total.update((ROOT / name).read_bytes())
        return replace(code, code_sha256=total.hexdigest()) if self.files else code

    def missing(self) -> list[str]:
        """What it needs and this machine lacks."""
        return [need for need in self.needs if not (gpu() if need == GPU else find_spec(need))]


def table(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """Return a Markdown table without spaces for alignment.

    Args:
        head: Names of the columns.
        rows: Cells of each row.
    """
    lines = tabulate(rows, head, tablefmt="github", disable_numparse=True).splitlines()
    lines[1] = "|" + " --- |" * len(head)
    return "\n".join(re.sub(" {2,}", " ", line) for line in lines)

"""Whole studies, one a chapter of the thesis: from simulation to tables and figures."""

from __future__ import annotations

import json
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

from faultgen.errors import InputError
from faultgen.storage import write_text

STUDIES = {
    "isolation": "chapter 6: which axis is worn, by transfer entropy, cross-correlation and ours",
}
"""Name and content of every study."""

REPORT_SEED = 2026
"""Root seed of the figures in docs/. Methods were developed on others."""


def run_study(
    name: str, out: Path, *, quick: bool = False, seed: int = REPORT_SEED, workers: int = 1
) -> dict[str, Any]:
    """Run a study and write ``results.json``, ``tables.md`` and ``figures/``.

    Args:
        name: Name of the study.
        out: Folder for the results; what is there already is used again.
        quick: Fewer seeds.
        seed: Root of all draws.
        workers: Processes; no effect on the results.

    Returns:
        The results.

    Raises:
        InputError: There is no such study.
    """
    if name not in STUDIES:
        raise InputError(f"unknown study '{name}': choose {', '.join(STUDIES)}")
    started = time.monotonic()
    out.mkdir(parents=True, exist_ok=True)
    from faultgen.studies.isolation_figures import draw
    from faultgen.studies.isolation_study import FULL, QUICK, run_isolation
    from faultgen.studies.isolation_tables import goals, tables

    result = run_isolation(out, size=QUICK if quick else FULL, seed=seed, workers=workers)
    result = {
        "study": name,
        "faultgen_version": version("faultgen"),
        "quick": quick,
        "goals": goals(result),
        **result,
    }
    write_text(out / "tables.md", tables(result))
    draw(result, out / "figures")
    result["seconds"] = round(time.monotonic() - started, 1)
    write_text(out / "results.json", json.dumps(result, indent=1, allow_nan=False) + "\n")
    return result

"""Entries of folders that other commands made: laboratories.noise_cases, blind_discovery, own_wear.

entries(Path("trial"))
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from laboratories.files import read_truth
from scoring.batches import case_words, sealed_entry
from sealed.cases import read_truth as read_sealed

_MODES = {"twin": "with baseline", "alone": "alone"}


def entries(trial: Path) -> list[dict[str, Any]]:
    """Entries of all cases of a folder.

    Args:
        trial: The folder, with truth.json or truth/*.json, or sealed/truth.json.

    Returns:
        An entry for each answer. Pairs of effects, and cases whose effect the catalogue has to
        leave out, are not among them: the public command cannot be asked for them.
    """
    found = []
    if (trial / "sealed").is_dir():
        for case in read_sealed(trial / "sealed").values():
            if case["kind"] != "pair" and not case["exclude"]:
                found.append(sealed_entry(case))
    else:
        for case in read_truth(trial).values():
            words = case_words(trial, case.get("folder", case["name"]), case["robot"], case["mode"])
            found.append(case | {"discover": words})
    return [entry | {"group": _MODES[entry.pop("mode")]} for entry in found]

"""The command `info` for a dataset in parts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer

from faultgen.cli.app import MOST_ROWS, print_json, print_table
from faultgen.system.terminal import say

_SAME = ("robot", "task", "effect", "axes", "severity", "cycles", "sensors")


def parts_info(folder: Path, as_json: bool) -> None:
    """Show what a dataset in parts holds, and which parts are missing or have changed.

    Args:
        folder: Its folder.
        as_json: Whether to print JSON.
    """
    from faultgen.dataset.parted import PARTS_INDEX, open_parts
    from faultgen.dataset.parts import planned_parts

    planned = planned_parts(folder)
    lacking = [name for name, is_there in planned.items() if not is_there]
    told: dict[str, Any] = {"folder": str(folder), "parts": len(planned), "missing": lacking}
    rows: list[dict[str, Any]] = []
    if (folder / PARTS_INDEX).is_file():
        parts = open_parts(folder)
        groups = parts.index.groupby(list(_SAME), observed=True, sort=False)
        rows = [
            {**dict(zip(_SAME, key, strict=True)), "runs": len(of)} for key, of in groups["part"]
        ]
        told |= {
            "runs": sum(one.runs for one in parts.parts),
            "cycles": sum(one.cycles for one in parts.parts),
            "bytes": sum(one.bytes for one in parts.parts),
            "failed": sum(one.failed for one in parts.parts),
            "changed": {k: v for k, v in parts.changed().items() if k not in lacking},
        }
    whole = bool(rows) and not lacking and not told["changed"] and not told["failed"]
    if as_json:
        print_json({**told, "complete": whole, "groups": rows})
    else:
        _show(told, rows, whole)
    if not whole:
        raise typer.Exit(1)


def _show(told: dict[str, Any], rows: list[dict[str, Any]], whole: bool) -> None:
    """Print the state of the parts as text."""
    if rows:
        print_table(rows[:MOST_ROWS])
        if len(rows) > MOST_ROWS:
            say(f"and {len(rows) - MOST_ROWS} more rows; --json lists them")
        say(
            f"{told['runs']} runs with {told['cycles']} cycles in {told['parts']} parts, "
            f"{told['bytes'] / 1e9:.3g} GB; {told['failed']} runs failed"
        )
    there = told["parts"] - len(told["missing"])
    say(f"{there} of {told['parts']} parts have their file of all runs")
    for name in told["missing"][:MOST_ROWS]:
        say(f"missing or unfinished: {name}")
    for name, reason in told.get("changed", {}).items():
        say(f"changed: {name}: {reason}")
    if not rows:
        say("the parts are not merged; run 'faultgen merge' when all of them are complete")
    elif whole:
        say("all parts are there; 'faultgen info' on the folder of a part checks all its bytes")
    else:
        say("the dataset is not in order; make what is missing again, then run 'faultgen merge'")

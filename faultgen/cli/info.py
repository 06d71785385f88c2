"""The command `info`: what a dataset or fleet holds, and whether it is whole."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import typer

from faultgen.cli.app import MOST_ROWS, Folder, Json, app, print_json, print_table
from faultgen.system.terminal import say


@app.command()
def info(folder: Folder, as_json: Json = False) -> None:
    """List the runs of a dataset, or the robots of a fleet, and check all of its files.

    Of a dataset in parts, only the table of all runs is read completely; give the folder of a part
    to have all of its files checked.

    Of more than 60 runs, those with the same fault are one row. The command reports whether the
    dataset is complete and intact. The exit status is 1 if runs are missing or damaged, or were
    made by different versions of faultgen.
    """
    from faultgen.dataset.interpolation_error import interpolation_error
    from faultgen.dataset.manifest import is_fleet, is_in_parts
    from faultgen.dataset.merged_file import MERGED
    from faultgen.dataset.reader import open_dataset
    from faultgen.simulation.operation import Operation

    if is_fleet(folder):
        _fleet_info(folder, as_json)
        return
    if is_in_parts(folder):
        from faultgen.cli.info_parts import parts_info

        parts_info(folder, as_json)
        return
    dataset = open_dataset(folder)
    damaged = dataset.damaged()
    broken = {Path(name).stem for name in damaged}
    versions = dataset.versions()
    missing, failed = set(dataset.missing), dataset.failed
    rows = []
    for run_id, parameters in dataset.planned.items():
        state = "missing" if run_id in missing else "ok"
        state = "failed" if run_id in failed else state
        state = "damaged" if run_id in broken else state
        rows.append(
            {
                "run": run_id,
                "robot": Path(parameters["robot"]).stem,
                "task": Path(parameters["task"]).stem,
                "effect": parameters["effect"],
                "axes": "+".join(map(str, parameters["axes"])) or "-",
                "severity": parameters["severity"],
                "cycles": parameters["cycles"],
                "sensors": parameters["sensors"],
                **Operation.of(parameters).given,
                "seed": parameters["seed"],
                "state": state,
            }
        )
    merged = dataset.path / MERGED
    complete = not dataset.missing and merged.is_file()
    whole = complete and not damaged and len(versions) < 2
    interpolated = {
        run.id: interpolation_error(run.attributes)
        for run in dataset.runs
        if run.id not in broken and dataset.planned[run.id].get("interpolated")
    }
    result: dict[str, Any] = {
        "folder": str(folder),
        "complete": complete,
        "intact": not damaged,
        "runs": rows,
        "splits": {
            by: {part: len(ids) for part, ids in parts.items()}
            for by, parts in dataset.manifest.splits.items()
        },
        "only_copy": sum(not run.own_file for run in dataset.runs),
        "interpolation_error": interpolated,
        "missing": dataset.missing,
        "failed": failed,
        "damaged": damaged,
        "versions": {str(version): ids for version, ids in versions.items()},
    }
    if as_json:
        print_json(result)
    else:
        if len(rows) <= MOST_ROWS:
            print_table(rows)
        else:
            print_table(_groups(rows))
            say("--json lists every run")
            print_table([row for row in rows if row["state"] != "ok"])
        say(f"{len(rows)} runs planned, {len(dataset.missing)} missing, {len(damaged)} damaged")
        for by, counts in result["splits"].items():
            say(f"split by {by}: " + ", ".join(f"{n} {part}" for part, n in counts.items()))
        if result["only_copy"]:
            say(f"{result['only_copy']} runs have no file of their own; {MERGED} holds them")
        if interpolated:
            say(
                f"{len(interpolated)} runs are interpolated: the RMS error of the torque of a "
                f"whole run is stated to be at most {max(interpolated.values()):.1%} of its noise"
            )
        for run_id, reason in failed.items():
            say(f"failed: {run_id}: {reason}")
        for name, reason in damaged.items():
            say(f"damaged: {name}: {reason}")
        if not merged.is_file():
            say("dataset.h5 is missing")
        if len(versions) > 1:
            for version, ids in versions.items():
                say(f"made by {version}: {', '.join(ids)}")
            say(
                "the runs were made by different versions; run the generate command again with "
                "--regenerate to make all of them with this version"
            )
        say(
            "the dataset is complete and intact"
            if whole
            else "the dataset is not in order; run the generate command again to complete it"
        )
    if not whole:
        raise typer.Exit(1)


def _groups(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """One row for all runs that differ in their seeds only, with the number of runs by state."""
    states: dict[tuple[tuple[str, Any], ...], Counter[str]] = {}
    for row in rows:
        same = tuple((k, v) for k, v in row.items() if k not in ("run", "seed", "state"))
        states.setdefault(same, Counter())[row["state"]] += 1
    return [
        dict(same)
        | {"runs": sum(counts.values()), "state": ", ".join(f"{n} {s}" for s, n in counts.items())}
        for same, counts in states.items()
    ]


def _fleet_info(folder: Path, as_json: bool) -> None:
    """Carry out `info` on a fleet."""
    from faultgen.fleet.data import fleet_state

    rows = fleet_state(folder)
    whole = all(row["state"] == "ok" for row in rows)
    if as_json:
        print_json({"folder": str(folder), "complete": whole, "intact": whole, "robots": rows})
    else:
        print_table(rows)
        say(
            "the fleet is complete and intact"
            if whole
            else "the fleet is not in order; run the fleet command again to complete it"
        )
    if not whole:
        raise typer.Exit(1)

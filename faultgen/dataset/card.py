"""The data card of a dataset: what it holds, where it comes from, and how far to trust it.

The card is a page in Markdown that is computed from the data alone. It does not contain names of
folders or dates, so that the same experiment gives the same card.
"""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import h5py
import pandas as pd
from tabulate import tabulate

from faultgen.dataset.manifest import Manifest
from faultgen.dataset.splits import PARTS, SCHEMES, TRAIN
from faultgen.dataset.tables import OpenRun
from faultgen.provenance import Provenance
from faultgen.system.terminal import visible

LICENCE = "https://creativecommons.org/licenses/by/4.0/"

LIMITATIONS = (
    "Everything is simulated. Real robots differ from their models, in friction above all, so "
    "methods usually do worse on them than on these data.",
    "The parameters of the robots are partly measured, partly derived and partly assumed. The "
    "README of puma560 and irb6700 states the source of every number. Most drive data of a robot "
    "that `faultgen robot build` made are assumed; its drives.toml marks them.",
    "All runs of a robot have the same parameters, unless the experiment names several robots that "
    "differ. Scores on these data do not show how well a method transfers to other robots.",
    "A fault grows along a schedule that was chosen. How fast real faults grow is not modelled.",
    "The cycles of a run are not independent: they share the robot, the fault, and a temperature "
    "and payload that drift. Keep all cycles of a run in the same part of a division.",
)


def data_card(runs: Sequence[OpenRun], table: pd.DataFrame, manifest: Manifest) -> str:
    """Write the data card of a dataset.

    Args:
        runs: The runs that exist.
        table: Their table, from `faultgen.dataset.tables.runs_table`.
        manifest: The list of all runs, with their divisions.

    Returns:
        The card as Markdown.
    """
    name = manifest.experiment_sha256[:8]
    missing = len(manifest.runs) - len(table)
    cycles = int(table["cycles"].sum()) if len(table) else 0
    paired = table["seed"].duplicated().any() if len(table) else False
    made_by = table[_VERSIONS].drop_duplicates() if len(table) else table
    versions = sorted(_shown(Provenance.of(row)) for row in made_by.to_dict("records"))
    parts = [
        f"# Data card: faultgen dataset {name}",
        "Simulated condition-monitoring data of industrial robots with known faults, to train and "
        "test methods that detect a fault or name its axis.",
        "## Content",
        f"{len(table)} runs with {cycles} work cycles in all. A run is a series of cycles of one "
        "robot in one task, either healthy or with a fault that grows from cycle to cycle."
        + (f" {missing} planned runs are missing." if missing else ""),
    ]
    if len(table):
        parts += [_content(table), *_operations(table), *_files(), *_arrays(runs, table)]
    parts += [
        "## Origin",
        f"Made by {'; '.join(versions) or 'no run'}. The experiment is in `experiment.toml` "
        f"(SHA-256 {manifest.experiment_sha256}), which `faultgen generate experiment.toml -o DIR` "
        "repeats bit for bit with the same versions.",
        _randomness(table),
        "## Divisions",
        *_divisions(manifest, bool(paired)),
        "## Limitations",
        "\n".join(f"- {line}" for line in [*_interpolation(table), *LIMITATIONS]),
        "## Licence",
        f"The data are under the licence Creative Commons Attribution 4.0 International "
        f"(CC BY 4.0, {LICENCE}). The software faultgen is under the MIT licence.",
        "## Citation",
        f"> The faultgen authors: faultgen dataset {name}, {len(table)} simulated runs of "
        f"{_listed(table, 'robot')}. Made by {'; '.join(versions) or 'no run'}. CC BY 4.0.",
    ]
    return "\n\n".join(parts) + "\n"


def _table(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    # a bar, as in |torque|, would end the cell
    cells = [[_shown(cell).replace("|", "\\|") for cell in row] for row in rows]
    return tabulate(cells, head, tablefmt="github", disable_numparse=True)


def _shown(name: object) -> str:
    """A name in one line, and with nothing in it that a browser would take for HTML."""
    return html.escape(visible(name), quote=False)


def _operations(table: pd.DataFrame) -> list[str]:
    """Speeds, payloads and temperatures, if there are several."""
    kinds = {"speed": "speed overrides", "payload_mass": "payloads [kg]"}
    kinds["mean_temperature"] = "temperatures of the gearboxes [°C]"
    told = [
        f"{words} {', '.join(f'{one:g}' for one in sorted(set(table[name])))}"
        for name, words in kinds.items()
        if table[name].nunique() > 1
    ]
    return [f"Every combination of these was made: {'; '.join(told)}."] if told else []


def _interpolation(table: pd.DataFrame) -> list[str]:
    """What is to be said about interpolated cycles."""
    if not len(table):
        return []
    own = table[table["fidelity"] == "interpolated"]
    if own.empty:
        return []
    return [
        f"The cycles of {len(own)} runs are interpolated between simulated ones. The stated bound "
        "of the error of their torque, over the standard deviation of its noise, is "
        f"{own['interpolation_error'].max():.3f} for the RMS over a whole run, "
        f"{own['interpolation_error_cycle'].max():.3f} for that over a single cycle, and "
        f"{own['interpolation_error_sample'].max():.3f} for a single sample."
    ]


def _listed(table: pd.DataFrame, column: str) -> str:
    return ", ".join(map(_shown, dict.fromkeys(table[column]))) if len(table) else "no robot"


def _content(table: pd.DataFrame) -> str:
    rows = []
    for (robot, task, effect), here in table.groupby(["robot", "task", "effect"], sort=False):
        unit = here["severity_units"].iloc[0]
        severities = ", ".join(f"{one:g}" for one in sorted(set(here["severity"])))
        worn = here["axis"].iloc[0] > 0
        rows.append(
            [
                robot,
                task,
                effect,
                ", ".join(dict.fromkeys(here["axes"])) or "-",
                f"{severities} {'(fraction of nominal)' if unit == '1' else unit}" if worn else "-",
                len(here),
                int(here["cycles"].sum()),
            ]
        )
    return _table(["robot", "task", "effect", "axes", "final severity", "runs", "cycles"], rows)


def _files() -> list[str]:
    return [
        "`dataset.h5` holds all runs (`/runs/<id>`), a table of the runs (`/index`), this card, "
        "the experiment and the list of runs. Beside each HDF5 file stands its SHA-256 checksum."
    ]


_KIND = ["robot", "task", "effect", "axes", "beside"]
_VERSIONS = [field.name for field in fields(Provenance)]


def _arrays(runs: Sequence[OpenRun], table: pd.DataFrame) -> list[str]:
    """Labels and features, each with its unit, as they are in the runs."""
    found: dict[str, tuple[str, str]] = {}

    def note(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and not item.is_scale and item.shape:
            units, text = str(item.attrs["units"]), str(item.attrs["long_name"])
            before = found.setdefault(name, (units, text))
            if units not in before[0].split(" or "):
                found[name] = (f"{before[0]} or {units}", text)

    # runs of one robot, task and kind of fault have the same arrays
    for number in table.drop_duplicates(_KIND).index:
        with runs[number].open() as group:
            group.visititems(note)
    labels = {name: told for name, told in found.items() if name.startswith(("cycle/", "truth/"))}
    features = {name: told for name, told in found.items() if name not in labels}
    head = ["array", "unit", "content"]
    return [
        "## Labels",
        "Every run has the attributes `robot`, `task`, `effect`, `axis` (from 1; 0 for a healthy "
        "run), `severity` (in its last cycle, in `severity_units`) and `seed`. Every cycle has "
        "these true values; the unit 1 means a fraction of the nominal value, or no unit:",
        _table(head, [[f"`/{name}`", *told] for name, told in sorted(labels.items())]),
        "## Features",
        _table(head, [[f"`/{name}`", *told] for name, told in sorted(features.items())]),
    ]


def _randomness(table: pd.DataFrame) -> str:
    if not len(table):
        return "No run exists yet."
    periods = ", ".join(f"{one:g} s" for one in dict.fromkeys(table["sample_period"]))
    return (
        f"Sensors: {_listed(table, 'sensors')}. Wear schedule: {_listed(table, 'schedule')}. "
        f"Sample period: {periods}. All random numbers of a run come from its attribute `seed`; "
        f"that of the first run is {table['seed'].iloc[0]}."
    )


_IN_WORDS = {TRAIN: "training"}


def _divisions(manifest: Manifest, paired: bool) -> list[str]:
    rows = [
        [f"`{scheme}`", SCHEMES[scheme], *(len(parts.get(part, [])) for part in PARTS)]
        for scheme, parts in manifest.splits.items()
    ]
    said = [
        "These divisions into a training, a validation and a test part are fixed, so that results "
        "can be compared. They are stored in `runs.json` and in `/index`.",
        _table(
            ["division", "holds apart", *(f"{_IN_WORDS.get(part, part)} runs" for part in PARTS)],
            rows,
        )
        if rows
        else "The dataset has too few runs for a division.",
    ]
    if paired:
        said.append(
            "The dataset is paired: all runs with the same seed share their noise to the last "
            "digit. Split it by seed. The divisions do so, and leave out runs that would stand on "
            "the other side of their twin."
        )
    return said

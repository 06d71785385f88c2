"""The data card of an exported folder: ``README.md`` with the front matter that the Hub reads.

Source: https://huggingface.co/docs/hub/datasets-cards.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tabulate import tabulate

from faultgen.dataset.card import LICENCE, LIMITATIONS
from faultgen.dataset.labels import SMALLEST_FRACTION, SMALLEST_SHARE
from faultgen.dataset.splits import SCHEMES
from faultgen.export.cycles import LABELS, Source
from faultgen.export.hub_tables import CONFIGS, Tables
from faultgen.system.tables import optional

_SIZES = {10**3: "n<1K", 10**4: "1K<n<10K", 10**5: "10K<n<100K", 10**6: "100K<n<1M"}


def title(source: Source) -> str:
    """The name of the exported data, such as "faultgen puma560 spot_weld"."""
    frame = source.frame
    robots, tasks = dict.fromkeys(frame["robot"]), dict.fromkeys(frame["task"])
    return f"faultgen {' '.join(robots)} {' '.join(tasks)}"


def description(source: Source) -> str:
    """One sentence that says what the data are."""
    frame = source.frame
    effects = [name for name in dict.fromkeys(frame["effect"]) if name != "healthy"]
    return (
        f"Simulated condition-monitoring data of industrial robots with known faults: {len(frame)} "
        f"work cycles of {len(source.runs)} runs of {', '.join(dict.fromkeys(frame['robot']))}, "
        f"healthy or with {', '.join(effects) or 'no fault'}."
    )


def write_card(folder: Path, tables: Tables, source: Source, by: str) -> None:
    """Write ``README.md``.

    Args:
        folder: The folder.
        tables: What has been written to it.
        source: The runs.
        by: Name of the division whose parts are the splits.
    """
    version = source.runs[0].attributes["faultgen_version"]
    default = next(iter(tables.files))
    text = [
        f"# {title(source)}",
        description(source) + f" Made by faultgen {version}.",
        "```python\nfrom datasets import load_dataset\n\n"
        f'data = load_dataset("FOLDER", "{default}")["train"].with_format("numpy")\n```',
        "## Configurations",
        "\n".join(f"- `{name}`: {CONFIGS[name]}" for name in tables.files),
        _divided(tables, source, by),
        "## Labels",
        "Wear grows from almost nothing. Something is worn if the severity is at least "
        f"{SMALLEST_FRACTION:g} where it is a fraction of the nominal value, and otherwise at "
        f"least {100 * SMALLEST_SHARE:g} % of the largest severity of the run. Every run with a "
        f"fault fails in its last cycle.\n\n{_labels()}",
        *_columns(tables),
        "## Limitations",
        "\n".join(f"- {line}" for line in LIMITATIONS),
        "## Licence",
        f"Creative Commons Attribution 4.0 International (CC BY 4.0, {LICENCE}).",
    ]
    front = "\n".join(["---", *_front_matter(tables, source), "---"])
    (folder / "README.md").write_text(front + "\n\n" + "\n\n".join(text) + "\n")


def _divided(tables: Tables, source: Source, by: str) -> str:
    splits = list(dict.fromkeys(name for rows in tables.rows.values() for name in rows))
    counts = [[name, *(rows.get(name, 0) for rows in tables.rows.values())] for name in splits]
    head = ["split", *(f"rows of `{name}`" for name in tables.rows)]
    listed = tabulate(counts, head, tablefmt="github")
    if not source.splits:
        return f"Single runs were exported, which are not divided.\n\n{listed}"
    return (
        f"The splits are the fixed division of the dataset by `{by}`, which holds apart "
        f"{SCHEMES[by]}. No run is in two splits.\n\n{listed}"
    )


def _labels() -> str:
    rows = [[f"`{name}`", units, text] for name, (units, text) in LABELS.items()]
    return tabulate(rows, ["column", "unit", "content"], tablefmt="github", disable_numparse=True)


def _columns(tables: Tables) -> list[str]:
    """Names and units of the other columns, by configuration."""
    parts = []
    for config, schema in tables.schemas.items():
        rows: dict[str, list[str]] = {}
        for name in schema.names:
            if name not in LABELS and name in tables.units:
                stem = name.rstrip("_0123456789")
                rows.setdefault(stem, [tables.units[name]]).append(name)
        listed = [
            [f"`{names[0]}`" + (f" … `{names[-1]}`" if len(names) > 1 else ""), units]
            for units, *names in rows.values()
        ]
        table = tabulate(listed, ["columns", "unit"], tablefmt="github", disable_numparse=True)
        parts += [
            f"## Columns of `{config}`",
            "Axes are numbered from 1. Signals and features with the prefix `motor_` are on the "
            f"motor side of the gearboxes; `reference_position` is the joint side.\n\n{table}",
        ]
    return parts


def _front_matter(tables: Tables, source: Source) -> list[str]:
    """The lines of the YAML header."""
    largest = max(sum(rows.values()) for rows in tables.rows.values())
    size = next((name for limit, name in _SIZES.items() if largest < limit), "n>1M")
    lines = [
        f"pretty_name: {title(source)}",
        "license: cc-by-4.0",
        "language: [en]",
        "task_categories: [tabular-classification, tabular-regression, robotics]",
        "tags: [condition-monitoring, predictive-maintenance, industrial-robots, simulation]",
        f"size_categories: ['{size}']",
        "configs:",
    ]
    for number, (config, files) in enumerate(tables.files.items()):
        lines += [f"- config_name: {config}"] + ["  default: true"] * (number == 0)
        lines += ["  data_files:"]
        for split in files:
            lines += [f"  - split: {split}", f"    path: {config}/{split}-*.parquet"]
    lines.append("dataset_info:")
    for config, rows in tables.rows.items():
        lines += [f"- config_name: {config}", "  features:"]
        for field in tables.schemas[config]:
            lines += [f"  - name: {field.name}", *_feature(field.type)]
        lines.append("  splits:")
        for split, count in rows.items():
            lines += [
                f"  - name: {split}",
                f"    num_bytes: {tables.bytes[config][split]}",
                f"    num_examples: {count}",
            ]
        sizes = _file_sizes(tables, config)
        lines += [
            f"  download_size: {sum(sizes.values())}",
            f"  dataset_size: {sum(tables.bytes[config].values())}",
        ]
    return lines


def _feature(kind: Any) -> list[str]:
    """The lines that state the type of a column."""
    types = optional("pyarrow").types
    if types.is_nested(kind):
        length = getattr(kind, "list_size", -1)
        inner = [f"    list: {_plain(kind.value_type)}"]
        return inner + ([f"    length: {length}"] if length != -1 else [])
    return [f"    dtype: {_plain(kind)}"]


def _plain(kind: Any) -> str:
    names: Mapping[str, str] = {
        "double": "float64",
        "float": "float32",
        "large_string": "string",
    }
    return names.get(str(kind), str(kind))


def _file_sizes(tables: Tables, config: str) -> dict[Path, int]:
    files = [path for paths in tables.files[config].values() for path in paths]
    return {path: (tables.folder / path).stat().st_size for path in files}

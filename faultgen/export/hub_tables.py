"""The Parquet files of a folder for the Hugging Face Hub: their content and their names."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from faultgen.dataset.splits import PARTS, UNUSED
from faultgen.export.shards import Shards

CONFIGS = {
    "signals": "one row for each cycle: labels, and the logged signals of each axis as lists",
    "features": "one row for each cycle: labels, and features that monitoring computes",
}
"""What the configurations hold, by name."""


class Tables:
    """The Parquet files of a folder, by configuration and split."""

    def __init__(self, folder: Path) -> None:
        """Prepare to write.

        Args:
            folder: The folder.
        """
        self.folder = folder
        self.files: dict[str, dict[str, list[Path]]] = {}
        """Files relative to the folder, by configuration and split."""
        self.rows: dict[str, dict[str, int]] = {}
        """Number of rows, likewise."""
        self.bytes: dict[str, dict[str, int]] = {}
        """Size of the arrays in memory [bytes], likewise."""
        self.schemas: dict[str, Any] = {}
        """The `pyarrow.Schema` of each configuration."""
        self.units: dict[str, str] = {}
        """SI unit of the columns that have one."""
        self._open: dict[tuple[str, str], Shards] = {}

    def write(self, config: str, part: str, table: Any) -> None:
        """Write a table as a row group.

        Args:
            config: Name of the configuration.
            part: Name of the split; rows of unused runs are left out.
            table: A `pyarrow.Table`.
        """
        if part == UNUSED:
            return
        self.schemas.setdefault(config, table.schema)
        shards = self._open.setdefault(
            (config, part), Shards(lambda k: self.folder / config / f"{part}-{k:05d}.parquet")
        )
        shards.write(table)
        sizes = self.bytes.setdefault(config, {})
        sizes[part] = sizes.get(part, 0) + table.nbytes

    def close(self) -> None:
        """Close all files, and give them names that state how many there are."""
        for (config, part), shards in sorted(
            self._open.items(),
            key=lambda one: (list(CONFIGS).index(one[0][0]), PARTS.index(one[0][1])),
        ):
            shards.__exit__(None, None, None)
            count, final = len(shards.paths), []
            for number, path in enumerate(shards.paths):
                named = path.with_name(f"{part}-{number:05d}-of-{count:05d}.parquet")
                path.rename(named)
                final.append(named.relative_to(self.folder))
            self.files.setdefault(config, {})[part] = final
            self.rows.setdefault(config, {})[part] = shards.rows
        self._open = {}

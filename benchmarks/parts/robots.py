"""Numbers of real robots: docs/robots.md."""

from __future__ import annotations

from typing import Any

from parts.part import Part, table


def known_drives(told: dict[str, Any]) -> str:
    """Assumed over known numbers of each arm, by the laws and by the class of its payload."""
    laws, classes = (table(told[name]["head"], told[name]["rows"]) for name in ("laws", "classes"))
    return (
        f'{laws}\n\nNumbers of `--like "… kg"` over known numbers, with classes that were made of '
        "the other arms with six axes. The last row is what a build assumes without `--like` for a "
        f"model that states masses, but no limits:\n\n{classes}"
    )


PARTS = (
    Part(
        name="known_drives",
        commands=("python -m benchmarks.real_robots.known_drives --save known_drives.json",),
        code=("real_robots.known_drives",),
        files=("faultgen/building/known_drives.toml",),
        page="robots.md",
        table=known_drives,
        minutes=0.1,
    ),
)

"""Numbers of real robots: docs/robots.md."""

from __future__ import annotations

from typing import Any

from parts.part import Part, table


def known_drives(told: dict[str, Any]) -> str:
    """Assumed over known numbers of each arm, from masses and from the payload alone."""
    classes = told["classes"]
    return (
        table(told["head"], told["rows"])
        + '\n\nNumbers of `--like "… kg"` over known numbers, with classes that were made of the '
        "other arms with six axes. The last row is what a build assumes without `--like` for a "
        "model that states masses, but no limits:\n\n" + table(classes["head"], classes["rows"])
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

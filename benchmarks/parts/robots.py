"""Numbers of real robots: docs/robots.md."""

from __future__ import annotations

from typing import Any

from parts.part import Part, table


def known_drives(told: dict[str, Any]) -> str:
    """Factors between assumed and known numbers, from masses and from the payload alone."""
    classes = told["classes"]

    def factors(rows: list[list[str]]) -> list[list[str]]:
        return [row for row in rows if row[0].startswith(("typical", "largest"))]

    return (
        table(["factor", *told["head"][1:]], factors(told["rows"]))
        + '\n\nTypical factors of `--like "… kg"`, with classes that were made of the other arms '
        "with six axes. The last row is what a build assumes without `--like` for a model that "
        "states masses, but no limits:\n\n"
        + table(["factor", *classes["head"][1:]], factors(classes["rows"]))
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

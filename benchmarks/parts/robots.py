"""Numbers of real robots: docs/robots.md."""

from __future__ import annotations

from typing import Any

from parts.part import Part, table


def known_drives(told: dict[str, Any]) -> str:
    """Assumed over known numbers of each arm."""
    return table(told["head"], told["rows"])


PARTS = (
    Part(
        name="known_drives",
        commands=("python -m benchmarks.real_robots.known_drives --save known_drives.json",),
        code=("real_robots.known_drives",),
        files=("benchmarks/real_robots/known_drives.toml",),
        page="robots.md",
        table=known_drives,
        minutes=0.1,
    ),
)

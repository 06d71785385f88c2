"""What the tests of a recording find.

print(Finding(WARN, 2, "torque is 3 samples (12 ms) late"))
"""

from __future__ import annotations

from dataclasses import dataclass

REFUSE, LEFT_OUT, CORRECTED, WARN = "refuse", "left out", "corrected", "warn"

TRUST = "--trust-log takes the file as it is"
"""End of each line about something that is not taken as it was logged."""


@dataclass(frozen=True)
class Finding:
    """One thing in a recording that is wrong or doubtful."""

    level: str
    """'refuse' if the data cannot be used, 'corrected' if they were, 'left out' if the axis is not
    used, otherwise 'warn'."""
    axis: int
    """Axis, from 1, or 0 if it concerns all axes."""
    message: str
    """What is wrong, where, and what would be right."""

    def __str__(self) -> str:
        where = f"axis {self.axis}: " if self.axis else ""
        return f"{self.level}: {where}{self.message}"


def sorted_findings(findings: list[Finding]) -> list[Finding]:
    """Sort findings: by how much they change what is used, and then by axis.

    Args:
        findings: The findings.
    """
    order = (REFUSE, LEFT_OUT, CORRECTED, WARN)
    return sorted(findings, key=lambda one: (order.index(one.level), one.axis))

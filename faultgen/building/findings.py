"""What is wrong with a model: each finding names the place, the fact and the remedy."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from faultgen.errors import InputError


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong with a model."""

    where: str
    """The element, such as "link 'elbow'"."""
    what: str
    """What is wrong with it."""
    remedy: str
    """What would be right, or what to do."""
    fatal: bool = True
    """Whether no robot can be built as long as it is so."""

    def __str__(self) -> str:
        return f"{self.where}: {self.what}; {self.remedy}"


def refuse(name: str, findings: Iterable[Finding]) -> None:
    """Refuse a model that has fatal findings.

    Args:
        name: Name of the robot or file, for the message.
        findings: What was found.

    Raises:
        InputError: At least one finding is fatal. The message has all fatal ones, in one line.
    """
    fatal = [str(finding) for finding in findings if finding.fatal]
    if fatal:
        raise InputError(f"{name}: {'. '.join(fatal)}")

"""What is wrong with a model: each finding names the place, the fact and the remedy."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from faultgen.errors import InputError, one_line


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


@contextmanager
def computable(name: str) -> Iterator[None]:
    """Refuse a model whose numbers differ so much that matrices become singular or overflow.

    Args:
        name: Name of the robot or file, for the message.

    Raises:
        InputError: Computing within the context failed. The message is one line.
    """
    try:
        yield
    except InputError:
        raise
    # of linear algebra, and of huge numbers
    except (ValueError, ArithmeticError, MemoryError) as error:
        raise InputError(
            f"{name}: its masses, lengths and inertias are too different to compute with "
            f"({one_line(error)}); they are in kg, m and kg m^2"
        ) from None

"""What `EffectPosterior` knows of effects and of healthy days, and what it answers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Form:
    """Columns that describe a cause about one severity."""

    columns: tuple[int, ...]
    """Numbers of the columns. The value of the first is the severity; others state how its
    signature may be wrong, or are the form of an effect that is not known."""
    sizes: tuple[float, ...]
    """Prior standard deviation of the value of each."""
    mean: float = 0.0
    """Prior mean of the severity. That of all others is 0."""


@dataclass(frozen=True)
class Cause:
    """One effect that may be there."""

    label: str
    """Name, which answers show."""
    family: str
    """Causes of one family, such as one effect on all axes, share a prior probability."""
    forms: tuple[Form, ...]
    """Its forms, such as a small and a large severity, which are equally probable."""
    positive: bool = False
    """Whether the severity cannot be negative."""


@dataclass(frozen=True, eq=False)
class Effects:
    """Effects that may be there."""

    columns: Floats
    """Change of the features per unit of each column, shape (columns, features)."""
    causes: tuple[Cause, ...]
    """The effects."""


@dataclass(frozen=True, eq=False)
class Days:
    """How a healthy robot differs from day to day."""

    columns: Floats
    """Change of the features per unit of each number, shape (numbers, features)."""
    stds: Floats
    """Usual standard deviation of each, shape (numbers,)."""
    groups: NDArray[np.int_]
    """Group of each, from 0, shape (numbers,). All numbers of a group have one scale."""
    spreads: Floats
    """Factor by which the scale of each group may differ from 1: one standard deviation of its
    logarithm; shape (groups,)."""
    unlike: float = 1.0
    """Factor by which the standard deviation of one number may differ from that of its group: one
    standard deviation of its logarithm. It makes the limit of alarms higher."""


@dataclass(frozen=True, eq=False)
class Judgement:
    """What a sequence of recordings tells of the robot now."""

    alarm: bool
    """Whether the statistic exceeds its limit."""
    statistic: float
    """Largest logarithm of the odds that an effect is there, over all times since which it may
    be."""
    since: int
    """Number of the recording, from 0, in which it was first there, if it is."""
    healthy: float
    """Probability that the robot is healthy."""
    log_odds: Floats
    """Logarithm of the odds of each cause against a healthy robot, shape (causes,)."""
    probabilities: Floats
    """Probability of each cause, shape (causes,)."""
    severities: Floats
    """Median of the severity of each cause if it is the one, shape (causes,)."""
    intervals: Floats
    """Its 95 % interval, shape (causes, 2)."""

    @property
    def best(self) -> int:
        """Number of the most probable cause, from 0."""
        return int(np.argmax(self.probabilities))

"""What may be there: an effect at one place, and an effect as a distribution over all of these."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from faultgen.inference.limits import CREDIBLE


@dataclass(frozen=True)
class Hypothesis:
    """One effect at one place."""

    key: tuple
    """What it is, such as effect, axis and order."""
    family: str
    """Hypotheses of one family, such as one effect on all axes, share a prior probability."""
    forms: tuple[tuple[int, ...], ...]
    """Columns of each form, from 0. They share the hypothesis' prior probability."""
    place: int = 0
    """Where it acts, such as an axis."""
    unknown: bool = False
    """Whether it is an effect of no known form."""
    kin: str = ""
    """Hypotheses of one kin at one place change the same law: together they can imitate each other,
    as different laws of friction can; empty for others."""
    same: tuple[int, ...] = ()
    """Numbers of the same law at the same place, counted without those of unknown form."""


@dataclass(frozen=True, eq=False)
class SingleEffect:
    """One effect, as a distribution over the hypotheses."""

    odds: float
    """Logarithm of the posterior odds that it is there."""
    keys: tuple[tuple, ...]
    """Keys of the hypotheses that are not far behind, the best one first."""
    probabilities: np.ndarray
    """Their posterior probabilities, given that the effect is there; shape (keys,)."""
    forms: tuple[tuple[int, ...], ...]
    """The best form of each."""

    @property
    def credible(self) -> int:
        """Count the first hypotheses that together have 95 % probability."""
        return int(np.searchsorted(np.cumsum(self.probabilities), CREDIBLE) + 1)

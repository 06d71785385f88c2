"""Whole numbers that hold a sign: words of a bus that a logger wrote as if they had none.

65535 is -1 in a word of 16 bits (two's complement). In sign and magnitude with sign bit 10,
1024 + n is -n.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

_FEWEST_BITS = 8
_MOST_BITS = 32
_CROSSINGS = 2  # changes of sign from which a word is decoded without being told: assumed
_DIFFERENT = 3  # numbers that each sign must have: a switch has only one
_LARGER = 4.0  # steps at changes of sign, over all other steps: assumed


@dataclass(frozen=True)
class Word:
    """How a word holds its sign."""

    bits: int
    """Number of bits with the sign."""
    magnitude: bool = False
    """Whether the highest bit is a sign before a magnitude. Otherwise it is two's complement."""

    def signed(self, values: np.ndarray) -> np.ndarray:
        """Return the numbers that words mean.

        Args:
            values: The words, NaN where they are missing, shape (rows,).

        Returns:
            Shape (rows,).
        """
        half = 2.0 ** (self.bits - 1)
        negative = half - values if self.magnitude else values - 2 * half
        return np.where(values >= half, negative, values)

    def __str__(self) -> str:
        if self.magnitude:
            return f"sign bit {self.bits - 1}: {2 ** (self.bits - 1)} + n is -n"
        return f"words of {self.bits} bits: {2**self.bits - 1} is -1"


def words_of(columns: Sequence[np.ndarray]) -> list[Word | None]:
    """Find out which columns of a quantity hold words with a sign.

    Where the quantity changes its sign, such a column jumps by about 2 to the power of its bits (or
    of its sign bit), and by no more than elsewhere once it is decoded. A column that is always
    negative does not show it; it is decoded as another column of the same quantity.

    Args:
        columns: Numbers of each column, NaN where they are missing, shape (rows,) each.

    Returns:
        The word of each column; None if its numbers are what they are.
    """
    found = [_shown(values) for values in columns]
    of_others = next((word for word in found if word is not None), None)
    if of_others is None:
        return found
    half = 2.0 ** (of_others.bits - 1)
    return [
        word or (of_others if half <= np.nanmax(values, initial=0.0) < 2 * half else None)
        for word, values in zip(found, columns, strict=True)
    ]


def _shown(values: np.ndarray) -> Word | None:
    known = values[np.isfinite(values)]
    if not len(known) or known.min() < 0 or (known != np.floor(known)).any():
        return None
    return next((word for word in _possible(known) if _shows(known, word)), None)


def _possible(known: np.ndarray) -> Iterator[Word]:
    bits = int(known.max()).bit_length()
    if _FEWEST_BITS <= bits <= _MOST_BITS:
        yield Word(bits)
        yield Word(bits, magnitude=True)


def _shows(known: np.ndarray, word: Word) -> bool:
    """Whether numbers are smooth as signed words only."""
    upper = known >= 2.0 ** (word.bits - 1)
    if min(len(np.unique(known[upper])), len(np.unique(known[~upper]))) < _DIFFERENT:
        # few negative numbers close to zero are enough for two's complement: 65535 alone is -1
        if word.magnitude or known[upper].min() < 2.0**word.bits - _DIFFERENT:
            return False
    crossing = upper[1:] != upper[:-1]
    if crossing.sum() < _CROSSINGS:
        return False
    raw, step = np.abs(np.diff(known)), np.abs(np.diff(word.signed(known)))
    usual = float(step[~crossing].max(initial=0.0)) + 1.0  # one count
    return bool(step[crossing].max() <= 2 * usual and raw[crossing].min() >= _LARGER * usual)

"""Batches of windows, as NumPy arrays.

for x, y in Batches(windows, 32, rng=np.random.default_rng(0)):
x.shape                             # (32, window, channels)
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from faultgen.dataset.windows import Windows
from faultgen.errors import InputError


@dataclass(frozen=True, eq=False)
class Batches:
    """Batches of windows. Every pass goes through all windows once."""

    windows: Windows
    """The windows."""
    size: int
    """Number of windows of a batch."""
    rng: np.random.Generator | None = None
    """Draws the order anew for every pass; None for the order of time."""
    drop_last: bool = False
    """Whether to leave out the last batch if it has fewer windows."""

    def __post_init__(self) -> None:
        if not (isinstance(self.size, int | np.integer) and self.size >= 1):
            raise InputError(f"size: must be a whole number of at least 1, not {self.size!r}")

    @property
    def classes(self) -> tuple[str, ...]:
        """As `Windows.classes`."""
        return self.windows.classes

    @property
    def channels(self) -> tuple[str, ...]:
        """As `Windows.channels`."""
        return self.windows.channels

    def __len__(self) -> int:
        """Number of batches of a pass."""
        whole, rest = divmod(len(self.windows), self.size)
        return whole + (rest > 0 and not self.drop_last)

    def __iter__(self) -> Iterator[Any]:
        """Read one batch after another: windows, and labels if they were asked for."""
        count = len(self.windows)
        order = np.arange(count) if self.rng is None else self.rng.permutation(count)
        for number in range(len(self)):
            places = order[number * self.size : (number + 1) * self.size].tolist()
            items = [self.windows[place] for place in places]
            if self.windows.labels is None:
                yield np.stack(items)
            else:
                yield np.stack([x for x, _ in items]), np.array([y for _, y in items])

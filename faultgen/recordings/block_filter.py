"""Filters without feedback as products of matrices, which are fast for many signals at once.

blocks = blocks_of([slice(0, 5000)])
innovations = block_filter(x, blocks, taps)
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import as_strided

_LONGEST = 64  # samples of a block: some times the order, and small enough for the cache
_ROWS = 64  # signals at a time, which limits the memory


class Blocks(NamedTuple):
    """Successive samples that are filtered together, shape (blocks,) each."""

    start: np.ndarray
    """First sample."""
    stop: np.ndarray
    """Sample after the last one."""
    first: np.ndarray
    """First sample of the recording; before it, signals are taken as 0."""


def blocks_of(parts: Sequence[slice], frame: np.ndarray | None = None) -> Blocks:
    """Cut recordings into blocks.

    Args:
        parts: Samples of each separate recording.
        frame: Number of each sample, shape (samples,); those of a block have the same. None: all
            have the same.
    """
    starts = [np.array([part.start]) for part in parts]
    if frame is not None:
        changes = 1 + np.flatnonzero(np.diff(frame))
        starts = [
            np.append(part.start, changes[(changes > part.start) & (changes < part.stop)])
            for part in parts
        ]
    start = np.concatenate(starts)
    stops = [np.append(own[1:], part.stop) for own, part in zip(starts, parts, strict=True)]
    stop = np.concatenate(stops)
    first = np.repeat([part.start for part in parts], [len(own) for own in starts])
    count = -(-(stop - start) // _LONGEST)
    within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    start, stop, first = (np.repeat(one, count) for one in (start, stop, first))
    start = start + _LONGEST * within
    return Blocks(start, np.minimum(start + _LONGEST, stop), first)


def block_filter(x: np.ndarray, blocks: Blocks, taps: np.ndarray) -> np.ndarray:
    """Compute y_t = sum of taps_k x_(t-k).

    Args:
        x: Shape (..., samples).
        blocks: The samples.
        taps: Those of each block, shape (blocks, order + 1), or of all, (1, order + 1).

    Returns:
        Same shape and type as x; 0 outside of the blocks.
    """
    flat = x.reshape(-1, x.shape[-1])
    out = np.zeros(flat.shape, x.dtype)
    order, length = taps.shape[1] - 1, blocks.stop - blocks.start
    for own in np.unique(length):
        which = np.flatnonzero(length == own)
        wanted = blocks.start[which, None] + np.arange(own)
        needed = blocks.start[which, None] + np.arange(-order, own)
        known = needed >= blocks.first[which, None]
        needed = np.maximum(needed, 0)
        matrices = _bands(taps[which if len(taps) > 1 else [0]], int(own)).astype(x.dtype)
        for row in range(0, len(flat), _ROWS):
            some = slice(row, row + _ROWS)
            before = np.take(flat[some], needed, axis=1)
            before *= known
            made = np.matmul(before.swapaxes(0, 1), matrices).swapaxes(0, 1)
            out[some, wanted.ravel()] = made.reshape(len(before), -1)
    return out.reshape(x.shape)


def _bands(taps: np.ndarray, length: int) -> np.ndarray:
    """Matrices of which column j has the taps from row j on, the earliest sample first.

    Returns:
        Shape (blocks, order + length, length).
    """
    count, order = len(taps), taps.shape[1] - 1
    padded = np.zeros((count, order + 2 * length - 1))
    padded[:, length - 1 : length + order] = taps[:, ::-1]
    row, step = padded.strides
    shape = (count, order + length, length)
    return as_strided(padded[:, length - 1 :], shape, (row, step, -step))

"""Resampled recordings of one program, cut to common lengths.

recording, healthy = in_step([recording, healthy])
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from faultgen.recordings.recording import Recording

_CUT = 0.01  # share of a recording by which two of the same program may differ in length


def in_step(recordings: Sequence[Recording]) -> list[Recording]:
    """Cut recordings of the same program to common lengths, if any of them was resampled.

    Args:
        recordings: The recordings.

    Returns:
        The recordings, each separate one as long as the shortest of its kind. They are unchanged if
        their number of separate recordings differs, or a length differs by more than 1 %.
    """
    counts = {len(one.segments) for one in recordings}
    if len(counts) != 1 or not any(one.notes for one in recordings):
        return list(recordings)
    lengths = np.array([[part.stop - part.start for part in one.parts] for one in recordings])
    least = lengths.min(axis=0)
    if np.any(lengths.max(axis=0) - least > np.maximum(_CUT * least, 1)):
        return list(recordings)
    return [_cut(one, least.tolist()) for one in recordings]


def _cut(recording: Recording, lengths: Sequence[int]) -> Recording:
    rows = np.concatenate(
        [
            np.arange(part.start, part.start + length)
            for part, length in zip(recording.parts, lengths, strict=True)
        ]
    )

    def of(values: np.ndarray | None) -> np.ndarray | None:
        return None if values is None else values[rows]

    return replace(
        recording,
        position=recording.position[rows],
        torque=recording.torque[rows],
        velocity=of(recording.velocity),
        reference_position=of(recording.reference_position),
        temperature=of(recording.temperature),
        lost=of(recording.lost),
        segments=tuple(np.cumsum([0, *lengths[:-1]]).tolist()),
    )

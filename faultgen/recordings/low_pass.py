"""Low-pass filter of recordings whose measured positions are noisy.

Use it for recordings without a reference, in which the measured position is followed.

    recording = low_passed(read_recording("measured.h5"), 20.0)  # cut-off frequency [Hz]
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from faultgen.errors import InputError
from faultgen.recordings.recording import Recording

_PADDING = 15  # samples that the filter needs beyond each end


def low_passed(recording: Recording, cut_off: float) -> Recording:
    """Low-pass filter a recording, and keep 2.5 samples per period of the cut-off frequency.

    Position and torque get the same filter (Butterworth, 4th order, forward and backward), so that
    they stay synchronous. Use it for recordings without a reference, in which the measured position
    is followed.

    Args:
        recording: The recording to filter.
        cut_off: Cut-off frequency [Hz]. From 0.4 times the sample rate on, nothing is changed;
            above 0.5 times, it is refused.

    Returns:
        The filtered recording, with fewer samples.

    Raises:
        InputError: The cut-off frequency is above half of the sample rate, or a separate recording
            is too short to be filtered.
    """
    from scipy.signal import butter, filtfilt

    highest = 0.5 / recording.sample_period
    if cut_off > highest:
        raise InputError(
            f"low-pass: must be at most {highest:g} Hz, half of the sample rate of "
            f"{recording.source}, not {cut_off:g} Hz"
        )
    every = int(1 / (2.5 * cut_off * recording.sample_period) + 1e-9)
    if 2.5 * cut_off * recording.sample_period >= 1:
        return recording
    shortest = min(part.stop - part.start for part in recording.parts)
    if shortest <= _PADDING:
        raise InputError(
            f"{recording.source}: a separate recording of {shortest} samples is too short for the "
            f"low-pass filter; it needs more than {_PADDING}"
        )
    b, a = butter(4, 2 * cut_off * recording.sample_period)

    def filtered(values: np.ndarray | None) -> np.ndarray | None:
        if values is None:
            return None
        parts = [filtfilt(b, a, values[part], axis=0)[::every] for part in recording.parts]
        return np.concatenate(parts)

    position, torque = filtered(recording.position), filtered(recording.torque)
    assert position is not None and torque is not None
    lengths = [len(range(part.start, part.stop, every)) for part in recording.parts]
    lost = recording.lost
    if lost is not None:
        lost = np.concatenate([lost[part][::every] for part in recording.parts])
    return replace(
        recording,
        sample_period=every * recording.sample_period,
        position=position,
        torque=torque,
        velocity=filtered(recording.velocity),
        temperature=filtered(recording.temperature),
        lost=lost,
        segments=tuple(int(start) for start in np.cumsum([0, *lengths[:-1]])),
    )

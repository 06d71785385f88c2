"""What a recording with few samples a second can be used for.

slow(0.1)  # a line for the user; None for usual sample periods
"""

from __future__ import annotations

SLOW = 0.045
"""Sample period above which a recording is slow [s]: from 20 Hz downwards."""

TOO_SLOW = 0.11
"""Sample period above which also monitoring is unreliable [s]: below 9 Hz. Tried on an arm with two
axes that moves slowly (25 s a cycle): no false alarm at 10 and 20 Hz, one at 4 Hz."""

SAME_RATE = 1.5
"""Longest sample period of a recording that is judged, over that of the detector: assumed. At twice
the period, healthy recordings raised alarms."""


def slow(period: float) -> str | None:
    """Say what a slow recording can be used for.

    Args:
        period: Time between two samples [s].

    Returns:
        One line; None if the recording is not slow.
    """
    if period > TOO_SLOW:
        return (
            f"{1 / period:.3g} Hz is too slow: 'discover' and 'calibrate' may give wrong answers, "
            "and a detector of this rate false alarms; record at 10 Hz or faster for monitoring, "
            "and faster than 20 Hz for 'discover'"
        )
    if period > SLOW:
        return (
            f"{1 / period:.3g} Hz is slow: 'discover' and 'calibrate' may miss effects, because "
            "they cannot see what happens between two samples; monitoring ('twin', 'train', "
            "'judge') works on slow motions if all recordings have this rate"
        )
    return None

"""Recordings whose samples are not evenly spaced in time.

Times that scatter by little because they were rounded are taken as even. Otherwise everything is
interpolated at even times, and long gaps begin a new segment:

    even = evened("measured.h5", time, arrays, segments=(0,))
    even.arrays["torque"], even.period, even.notes
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from faultgen.errors import InputError
from faultgen.importing.clocks import GAP

FEWEST = 5
"""Fewest samples that a separate recording may have."""

_UNEVEN = 0.05  # share of the sample period by which times may be off even ones
_EXACT = 1e-3  # the same share up to which it does not matter why: 4 us at 250 Hz
_MOST_DIGITS = 9  # decimal places of times that may have been rounded
_ROUNDING = 1e-6  # share of the sample period below which jitter is that of the numbers
_CLOSE = 0.2  # share of the sample period below which a sample adds nothing to the one before
_DIGITS = 3  # of the period of resampled recordings, so that two of one program have the same
_SMOOTH = ("position", "reference_position")  # motion has no steps; torque may have


@dataclass(frozen=True, eq=False)
class Even:
    """Arrays at even times."""

    arrays: dict[str, np.ndarray | None]
    """Arrays by name, as given; their first axis is the sample."""
    period: float
    """Time between two samples [s]."""
    segments: tuple[int, ...]
    """First sample of each separate recording."""
    notes: tuple[str, ...]
    """One line if anything was changed."""


def evened(
    source: str,
    time: np.ndarray,
    arrays: Mapping[str, np.ndarray | None],
    segments: Sequence[int],
) -> Even:
    """Bring arrays to even times.

    Args:
        source: Name of the file, for messages.
        time: Time of each sample [s], shape (samples,). It may restart with each segment.
        arrays: Arrays by name of `Recording`, whose first axis is the sample.
        segments: First sample of each separate recording, ascending from 0.

    Returns:
        The arrays, unchanged if the times are even to within 0.1 % of the period, or to within 5 %
        where rounding to their last decimal place explains the rest.

    Raises:
        InputError: The times do not ascend, or too few samples are left.
    """
    ends = [*segments[1:], len(time)]
    parts = [slice(a, b) for a, b in zip(segments, ends, strict=True)]
    for part in parts:
        wrong = np.flatnonzero(np.diff(time[part]) <= 0)
        if len(wrong):
            at = part.start + int(wrong[0])
            raise InputError(
                f"{source}: times must ascend within a segment; sample {at + 1} is at "
                f"{time[at + 1]:.10g} s, and the sample before it at {time[at]:.10g} s"
            )
    steps = np.concatenate([np.diff(time[part]) for part in parts])
    if not len(steps):
        raise InputError(f"{source}: one sample is not a recording")
    median = float(np.median(steps))
    longer = _over_longer(time, parts, median)
    for period in (median, longer):
        off = _off_even(time, parts, period)
        if off <= _EXACT or off <= _UNEVEN and _scatter(time, parts) <= _last_place(time):
            return Even(dict(arrays), period, tuple(segments), ())
    period = float(f"{longer:.{_DIGITS - 1}e}")
    pieces = [piece for part in parts for piece in _pieces(time, part, period)]
    kept = [piece for piece in pieces if time[piece[-1]] - time[piece[0]] >= (FEWEST - 1) * period]
    if not kept:
        raise InputError(
            f"{source}: no {FEWEST} samples without a gap of more than {GAP * period:.3g} s"
        )
    grids = [_grid(time[piece], period) for piece in kept]
    lengths = [len(grid) for grid in grids]
    found = {
        name: None if values is None else _interpolated(name, values, time, kept, grids)
        for name, values in arrays.items()
    }
    jitter, gaps, missing = irregular(time, segments, period)
    lost = len(time) - sum(len(piece) for piece in kept)
    told = (
        f"its {len(time)} samples are not evenly spaced: they were interpolated at {sum(lengths)} "
        f"times {period:.6g} s apart; the largest jitter is {jitter:.3g} s"
    )
    if missing:
        told += f"; {missing} that are missing between others were interpolated, too"
    if len(gaps):
        told += f"; new segments begin after gaps ({len(gaps)}, of up to {gaps.max():.3g} s)"
    if lost:
        told += f"; samples between gaps, or too close to others, were left out ({lost})"
    return Even(found, period, tuple(np.cumsum([0, *lengths[:-1]]).tolist()), (told,))


def irregular(
    time: np.ndarray, segments: Sequence[int], period: float
) -> tuple[float, np.ndarray, int]:
    """Measure how far times are from even ones.

    Args:
        time: Time of each sample [s], shape (samples,), ascending within each segment.
        segments: First sample of each separate recording, ascending from 0.
        period: Time between two samples [s].

    Returns:
        The largest difference between a step and a whole number of periods [s]; the steps that are
        gaps [s], shape (gaps,); and the number of samples that are missing in the other steps.
    """
    steps = np.delete(np.diff(time), np.array(segments[1:], int) - 1)
    is_gap = steps > GAP * period
    short = steps[~is_gap]
    # one step may be twice as long by jitter alone; the sum of all steps tells how many are missing
    missing = left = max(int(np.round(short.sum() / period)) - len(short), 0)
    periods = np.ones(len(short))
    for longest in np.argsort(-short, kind="stable").tolist():
        further = min(int(np.round(short[longest] / period)) - 1, left)
        if further <= 0:
            break
        periods[longest] += further
        left -= further
    jitter = float(np.abs(short - periods * period).max(initial=0.0))
    return 0.0 if jitter < _ROUNDING * period else jitter, steps[is_gap], missing


def _over_longer(time: np.ndarray, parts: Sequence[slice], period: float) -> float:
    """The median period over longer and longer spans, in which scatter and rounding average out."""
    apart = 2
    while apart <= max(part.stop - part.start for part in parts) // 2:
        spans = np.concatenate([time[part][apart:] - time[part][:-apart] for part in parts])
        period = float(np.median(spans / np.maximum(np.round(spans / period), 1)))
        apart *= 2
    return period


def _off_even(time: np.ndarray, parts: Sequence[slice], period: float) -> float:
    """Largest distance of a time from even ones, in periods."""
    return (
        max(
            float(np.abs(time[part] - time[part.start] - period * np.arange(len(time[part]))).max())
            for part in parts
        )
        / period
    )


def _scatter(time: np.ndarray, parts: Sequence[slice]) -> float:
    """Largest distance of a time from a straight line [s]."""
    found = 0.0
    for part in parts:
        number = np.arange(part.stop - part.start)
        own = time[part] - time[part.start]
        found = max(
            found, float(np.abs(own - np.polyval(np.polyfit(number, own, 1), number)).max())
        )
    return found


def _last_place(time: np.ndarray) -> float:
    """Size of the last decimal place of the times [s]; 0 if they have too many."""
    precision = 4 * np.spacing(np.abs(time).max())
    for digits in range(_MOST_DIGITS + 1):
        if np.abs(time - np.round(time, digits)).max() <= precision:
            return float(10.0**-digits)
    return 0.0


def _pieces(time: np.ndarray, part: slice, period: float) -> list[np.ndarray]:
    """Samples between gaps, without those that are too close to the sample before."""
    samples = np.arange(part.start, part.stop)
    breaks = np.flatnonzero(np.diff(time[part]) > GAP * period) + 1
    pieces = []
    for piece in np.split(samples, breaks):
        keep, last = [], -np.inf
        for sample in piece.tolist():
            if time[sample] - last >= _CLOSE * period:
                keep.append(sample)
                last = time[sample]
        pieces.append(np.array(keep))
    return pieces


def _grid(time: np.ndarray, period: float) -> np.ndarray:
    count = int((time[-1] - time[0]) / period + 1e-6) + 1
    return np.minimum(time[0] + period * np.arange(count), time[-1])


def _interpolated(
    name: str,
    values: np.ndarray,
    time: np.ndarray,
    pieces: Sequence[np.ndarray],
    grids: Sequence[np.ndarray],
) -> np.ndarray:
    """Values at even times: positions by cubic splines, everything else linearly."""
    from scipy.interpolate import CubicSpline

    out = []
    for piece, grid in zip(pieces, grids, strict=True):
        start = time[piece[0]]  # clocks may count from 1970; differences are exact
        known, wanted = time[piece] - start, grid - start
        told = np.empty((len(wanted), *values.shape[1:]))
        # one column after the other, because a spline takes much more memory than its values
        for column, place in zip(
            values[piece].reshape(len(piece), -1).T, told.reshape(len(wanted), -1).T, strict=True
        ):
            if name in _SMOOTH:
                place[:] = CubicSpline(known, column)(wanted)
            else:
                place[:] = np.interp(wanted, known, column)
        out.append(told)
    return np.concatenate(out) if len(out) > 1 else out[0]

"""Faults of the log itself: samples that repeat the one before, and an encoder with coarse steps.

They are seen in the log alone, without a simulation. Lost samples are replaced by interpolated
ones, so that they do not hide what else is wrong:

    recording = repaired(recording)
    recording.faults

A log repeats a sample if position, torque and velocity of an axis are all exactly what they were
before. It was lost if the position then jumps by more than the axis moves between two samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.ndimage import uniform_filter1d
from scipy.stats import binomtest

from faultgen.recordings.recording import LogFault, Recording
from faultgen.robot import Robot

DROPOUT, STUCK, COARSE = "sensor_dropout", "sensor_stuck", "encoder_quantisation"

_NEAR = 10  # samples on either side from which the usual step of the position comes
_JUMP = 1.5  # jump after one repeated sample, over the usual step; it would be 2 if it was lost
_LONG = 3  # repeated samples from which a jump has to be this many usual steps
_FEWEST = 3  # lost samples from which a log is said to lose some
_USUAL = 1e-3  # share of lost samples up to which a log is in order: assumed
_OFTEN = 0.4  # median share of repeated samples in motion from which a log is written too often
_SLOW = 0.2  # of the largest speed, from which an axis counts as moving
_CHANCE = 1e-6  # that losses one by one make a stretch as long as one that is called stuck
_WHOLE = 1e-2  # by which positions may differ from whole steps of an encoder, in steps
_AFTER = 10  # samples after a stretch that are not used: the noise before them is not known
_COARSER = 1.5  # step over that of the healthy recording from which an encoder is coarser


def repaired(recording: Recording) -> Recording:
    """Find lost samples, and replace them by interpolated ones.

    A log in which the samples of several axes repeat is written more often than it is measured,
    which is no fault.

    Args:
        recording: The recording.

    Returns:
        The recording with `lost` samples and `faults`; the given one if it has none.
    """
    if _written_too_often(recording):
        return recording
    lost = np.zeros(recording.position.shape, bool)
    runs: list[list[tuple[int, int, int]]] = []  # of each axis: part, first lost sample, length
    for axis in range(recording.n_axes):
        found = []
        for number, part in enumerate(recording.parts):
            for first, length in _lost(recording, part, axis):
                lost[first : first + length, axis] = True
                found.append((number, first, length))
        runs.append(found)
    for axis in np.flatnonzero(lost.sum(axis=0) < _FEWEST).tolist():
        lost[:, axis], runs[axis] = False, []
    if not lost.any():
        return recording
    good = {
        name: _interpolated(recording, getattr(recording, name), lost)
        for name in ("position", "torque", "velocity")
        if getattr(recording, name) is not None
    }
    whole = replace(recording, **good)  # type: ignore[arg-type]
    faults = [one for axis, found in enumerate(runs) for one in _told(whole, axis, lost, found)]
    for axis, found in enumerate(runs):
        for number, first, length in found:
            if length > _LONG:
                stop = min(first + length + _AFTER, recording.parts[number].stop)
                lost[first:stop, axis] = True
    return replace(whole, lost=lost, faults=tuple(faults))


def _same(recording: Recording, part: slice, axis: int) -> np.ndarray:
    """Whether each sample of a part but the first repeats the one before in all channels."""
    channels = [recording.position, recording.torque, recording.velocity]
    return np.all([np.diff(one[part, axis]) == 0 for one in channels if one is not None], axis=0)


def _written_too_often(recording: Recording) -> bool:
    """Whether the samples of most axes repeat in motion, as if they were measured more rarely."""
    shares = []
    for axis in range(recording.n_axes):
        same, speed = [], []
        for part in recording.parts:
            same.append(_same(recording, part, axis))
            speed.append(np.abs(np.diff(uniform_filter1d(recording.position[part, axis], _NEAR))))
        fast = np.concatenate(speed)
        moving = fast > _SLOW * fast.max()
        if moving.any():
            shares.append(float(np.concatenate(same)[moving].mean()))
    return bool(shares) and float(np.median(shares)) > _OFTEN


def _lost(recording: Recording, part: slice, axis: int) -> list[tuple[int, int]]:
    """First sample and length of each stretch of lost samples of an axis."""
    same = _same(recording, part, axis)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], same, [False]]).astype(int)))
    stretches = edges.reshape(-1, 2).tolist()  # sample start + 1 repeats sample start
    size = np.abs(np.diff(recording.position[part, axis]))
    step = size.copy()  # as if nothing was lost
    for start, stop in stretches:
        step[stop : stop + 1] /= stop - start + 1
    found = []
    for start, stop in stretches:
        if stop >= len(size):
            continue  # the part ends before the position can jump
        around = [slice(max(start - _NEAR, 0), start), slice(stop + 1, stop + 1 + _NEAR)]
        moved = np.concatenate([size[near] for near in around])
        usual = np.concatenate([step[near] for near in around])[moved > 0]
        if not len(usual):
            continue
        length, smallest = stop - start, moved[moved > 0].min()  # one count, if counts are coarse
        needed = (1 + (_JUMP - 1) * min(length, _LONG)) * np.median(usual)
        if size[stop] > max(needed, _JUMP * smallest):
            found.append((part.start + start + 1, length))
    return found


def _told(
    whole: Recording, axis: int, lost: np.ndarray, found: Sequence[tuple[int, int, int]]
) -> list[LogFault]:
    """The faults of one axis: losses one by one, and stretches that are too long for them.

    Args:
        whole: The recording with interpolated samples.
        axis: From 0.
        lost: Lost samples, shape (samples, n_axes).
        found: Part, first sample and length of each stretch of lost samples.
    """
    if not found:
        return []
    moving = _moving(whole, axis)
    lengths = np.array([length for _, _, length in found])
    is_short = lengths <= _LONG
    rate = max(lengths[is_short].sum(), 1) / max(moving.sum(), 1)
    stuck = ~is_short & (moving.sum() * rate ** lengths.astype(float) < _CHANCE)
    single = np.zeros(len(moving), bool)
    shares = []
    for (number, first, length), is_stuck in zip(found, stuck.tolist(), strict=True):
        if is_stuck:  # with the sample that it repeats
            part = whole.parts[number]
            shares.append((length + 1) / (part.stop - part.start))
        else:
            single[first : first + length] = lost[first : first + length, axis]
    faults = []
    count = int((single & moving).sum())
    if count >= _FEWEST:
        told = binomtest(count, int(moving.sum())).proportion_ci(0.95, "wilson")
        share = count / int(moving.sum())
        faults.append(LogFault(DROPOUT, axis + 1, share, (float(told.low), float(told.high))))
    if shares:
        share, one = float(np.mean(shares)), 1 / min(p.stop - p.start for p in whole.parts)
        faults.append(LogFault(STUCK, axis + 1, share, (share - one, share + one)))
    return faults


def _moving(recording: Recording, axis: int) -> np.ndarray:
    """Samples in which an axis moves; elsewhere, a lost sample cannot be told from rest."""
    parts = [recording.position[part, axis] for part in recording.parts]
    speed = np.concatenate([np.abs(np.gradient(position)) for position in parts])
    return np.asarray(speed > _SLOW * speed.max())


def _interpolated(recording: Recording, values: np.ndarray, lost: np.ndarray) -> np.ndarray:
    """The values with a smooth curve through the good samples instead of the lost ones."""
    values = values.copy()
    for part in recording.parts:
        for axis in np.flatnonzero(lost[part].any(axis=0)):
            bad = lost[part, axis]
            time = np.arange(len(bad))
            curve = make_interp_spline(time[~bad], values[part, axis][~bad], k=1)
            values[part, axis] = np.where(bad, curve(time), values[part, axis])
    return values


def new_faults(
    recording: Recording, healthy: Sequence[Recording], robot: Robot
) -> tuple[LogFault, ...]:
    """Select the faults of a log that healthy recordings do not have to the same extent.

    Args:
        recording: The recording. If it consists of several files, the largest severity counts.
        healthy: Recordings from before the change, or none.
        robot: The model.

    Returns:
        The faults, and those of encoders that were finer in the healthy recordings.
    """
    largest: dict[tuple[str, int], LogFault] = {}
    for fault in sorted(recording.faults, key=lambda one: one.severity):
        usual = max((_up_to(run, fault) for run in healthy), default=0.0)
        if fault.interval[0] > max(usual, _USUAL if fault.effect == DROPOUT else 0.0):
            largest[fault.effect, fault.axis] = fault
    return (*largest.values(), *_coarse_encoders(recording, healthy, robot))


def _up_to(healthy: Recording, fault: LogFault) -> float:
    """Largest severity that the fault may have in a healthy recording."""
    same = [one for one in healthy.faults if (one.effect, one.axis) == (fault.effect, fault.axis)]
    if same or fault.effect != DROPOUT:
        return max((one.interval[1] for one in same), default=0.0)
    count = int(_moving(healthy, fault.axis - 1).sum())  # it may have lost a few samples
    few = binomtest(min(_FEWEST - 1, count), max(count, 1))
    return float(few.proportion_ci(0.95, "wilson").high)


def _coarse_encoders(
    recording: Recording, healthy: Sequence[Recording], robot: Robot
) -> list[LogFault]:
    """Find axes whose position has coarser steps than in the healthy recordings.

    Positions are stored with few digits, so that fine steps are not always seen. A step is coarser
    only if the healthy recording has a smaller one, or if its positions come nearer to each other.

    Args:
        recording: The recording.
        healthy: Recordings from before the change; none: nothing is found.
        robot: The model.

    Returns:
        The faults.
    """
    if not healthy:
        return []
    faults = []
    for axis in range(recording.n_axes):
        apart, rounding = _apart(recording, robot, axis)
        usual, _ = _apart(healthy[0], robot, axis)
        if min(len(apart), len(usual)) < _NEAR:
            continue
        step = _shortest(apart)
        is_whole = np.abs(apart / step - np.round(apart / step)) < _WHOLE + rounding / step
        if is_whole.all() and step > _COARSER * _shortest(usual):
            faults.append(LogFault(COARSE, axis + 1, step, (step, step)))
    return faults


def _apart(recording: Recording, robot: Robot, axis: int) -> tuple[np.ndarray, float]:
    """Distances between neighbouring positions of an axis, and how far rounding may change them.

    Args:
        recording: The recording.
        robot: The model.
        axis: From 0.

    Returns:
        Distances, motor side, shape (distances,); and the rounding.
    """
    position = recording.motor_position(robot)[:, axis]
    values = np.unique(position if recording.lost is None else position[~recording.lost[:, axis]])
    if not len(values):  # the axis is left out
        return values, 0.0
    rounding = 1e-6 * max(float(np.abs(values).max()), 1e-12)
    apart = np.diff(values)
    return apart[apart > rounding], rounding


def _shortest(apart: np.ndarray) -> float:
    """The shortest of some distances, as the median of those that are about as short."""
    return float(np.median(apart[apart < 1.5 * apart.min()]))

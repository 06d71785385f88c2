"""Cycles of a known motion in a recording: where they are, and their torque at the same places.

    cycles = find_cycles(recording, motion)
    cycles[0].shape  # (samples, n_axes), nan where the motion was not recorded

The measured positions are compared with those of the motion, so that it does not matter when a
recording begins, how often it is sampled, or how many cycles it holds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from faultgen.errors import InputError
from faultgen.recordings.recording import Recording
from faultgen.simulation.motion import Motion

CLOSE = 0.05
"""RMS distance of a recorded motion from the known one, over its reach, up to which they are the
same: assumed."""

_SLACK = 0.5  # by which a recording may begin late or end early [s]
_APART = 0.8  # of the length of a motion, between the starts of two cycles
_TAPS = 8  # samples on each side from which a value between two samples is found
_STILL = 1e-9


@dataclass(frozen=True, eq=False)
class KnownMotion:
    """A motion with the places at which torques are compared."""

    path: np.ndarray
    """Joint positions that a healthy robot reaches, shape (samples, n_axes), in [rad] or [m]."""
    stretches: tuple[tuple[int, int], ...]
    """First sample and end of each part that recordings contain. The robot's way between two parts,
    or back to the start, is in none."""
    sample_period: float
    """Time between samples [s]."""
    gear_ratio: np.ndarray
    """Rotor turns per joint turn, shape (n_axes,)."""

    @property
    def compared(self) -> np.ndarray:
        """Numbers of all samples that are compared, shape (places,)."""
        return np.concatenate([np.arange(start, end) for start, end in self.stretches])


def stretches_of(motion: Motion, samples: int, sample_period: float) -> tuple[tuple[int, int], ...]:
    """Find the parts of a task's cycle that were recorded.

    Args:
        motion: The planned task.
        samples: Number of samples in a cycle.
        sample_period: Time between them [s].

    Returns:
        First sample and end of each sampled path of the task; the whole cycle if it has none.
    """
    spans = [(start, start + duration) for start, duration in motion.sampled]
    return tuple(
        (int(np.ceil(a / sample_period - 1e-6)), min(samples, int(b / sample_period + 1e-6) + 1))
        for a, b in spans
    ) or ((0, samples),)


def find_cycles(recording: Recording, motion: KnownMotion) -> list[np.ndarray]:
    """Find the cycles of a motion in a recording.

    Args:
        recording: The recording, with the torque of the motors.
        motion: The motion.

    Returns:
        Torque of the motors in each cycle, in the order of time, shape (samples, n_axes), in
        [N m]; nan between the stretches.

    Raises:
        InputError: The recording has another number of axes, or lacks a stretch of the motion.
    """
    n_axes = len(motion.gear_ratio)
    if recording.n_axes != n_axes:
        raise InputError(
            f"{recording.source}: has {recording.n_axes} axes, but the motion has {n_axes}"
        )
    position, torque = recording.position, recording.torque
    if recording.side == "motor":
        position = position / motion.gear_ratio
    else:
        torque = torque / motion.gear_ratio
    by_stretch = []
    for number, (start, end) in enumerate(motion.stretches, start=1):
        found, nearest = [], np.inf
        for part in recording.parts:
            more, distance = _matches(
                position[part], torque[part], recording.sample_period, motion, start, end
            )
            found += more
            nearest = min(nearest, distance)
        if not found:
            which = f" part {number} of" if len(motion.stretches) > 1 else ""
            told = f"{nearest:.1%} of its reach" if np.isfinite(nearest) else "too short"
            raise InputError(
                f"{recording.source}: does not contain{which} the motion of the task (the nearest "
                f"piece of it: {told}; the same motion is within {CLOSE:.0%}); record the program "
                "of the healthy recordings"
            )
        by_stretch.append(found)
    cycles = []
    for number in range(min(len(found) for found in by_stretch)):
        whole = np.full(motion.path.shape, np.nan)
        for (start, end), found in zip(motion.stretches, by_stretch, strict=True):
            whole[start:end] = found[number]
        cycles.append(whole)
    return cycles


def _matches(
    position: np.ndarray,
    torque: np.ndarray,
    own_period: float,
    motion: KnownMotion,
    start: int,
    end: int,
) -> tuple[list[np.ndarray], float]:
    """Torque of each occurrence of a stretch in a separate recording, and the least distance."""
    period = motion.sample_period
    path = motion.path[start:end]
    slack = round(_SLACK / period)
    seconds = (len(position) - 1) * own_period
    if seconds < (len(path) - 1) * period - 2 * _SLACK:
        return [], np.inf
    times = np.arange(-slack, int(seconds / period + 1e-6) + slack + 1) * period
    known = np.arange(len(position)) * own_period
    seen = _at(times, known, position)
    if len(seen) < len(path):
        return [], np.inf
    reach = np.ptp(path, axis=0)
    weight = np.where(reach > 1e-3 * reach.max(), 1 / np.maximum(reach, _STILL), 0.0)
    distance = _distances(seen * weight, path * weight, int((weight > 0).sum()))
    chosen: list[int] = []
    order = np.argsort(distance)
    for shift in order[distance[order] <= CLOSE].tolist():
        if all(abs(shift - other) >= _APART * len(path) for other in chosen):
            chosen.append(shift)
    found = []
    slope = np.gradient(path, period, axis=0) * weight
    for shift in sorted(chosen):
        begin = times[shift]
        for _ in range(2):  # between two samples: the delay that explains the difference best
            at = begin + np.arange(len(path)) * period
            apart = (_at(at, known, position) - path) * weight
            begin -= float(np.clip((slope * apart).sum() / (slope**2).sum(), -period, period))
        if abs(own_period - period) < 1e-9:
            found.append(_shifted(torque, begin / period, len(path)))
        else:
            found.append(_at(begin + np.arange(len(path)) * period, known, torque))
    return found, float(distance.min())


def _at(times: np.ndarray, known: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values at other times, linear in between, shape (times, n_axes)."""
    return np.stack([np.interp(times, known, column) for column in values.T], axis=1)


def _shifted(values: np.ndarray, begin: float, count: int) -> np.ndarray:
    """Values from a sample on that need not be whole, shape (count, n_axes).

    A windowed sinc keeps the level and colour of the noise, which linear interpolation would not.
    """
    whole = int(np.floor(begin))
    taps = np.arange(-_TAPS + 1, _TAPS + 1)
    distance = taps - (begin - whole)
    weights = np.sinc(distance) * np.cos(np.pi * distance / (2 * _TAPS + 1)) ** 2
    rows = whole + np.arange(count)[:, None] + taps
    chosen = values[np.clip(rows, 0, len(values) - 1)]
    return np.asarray(np.tensordot(chosen, weights / weights.sum(), axes=([1], [0])))


def _distances(seen: np.ndarray, path: np.ndarray, moving: int) -> np.ndarray:
    """RMS distance of a path from what was seen, by shift in samples, shape (shifts,)."""
    middle = path.mean(axis=0)
    seen, path = seen - middle, path - middle
    squares = np.cumsum(np.concatenate([[0.0], (seen**2).sum(axis=1)]))
    energy = squares[len(path) :] - squares[: -len(path)]
    # by fast Fourier transforms; NumPy's, because importing scipy.signal takes a second
    size = 1 << (len(seen) - 1).bit_length()
    spectrum = np.fft.rfft(seen, size, axis=0) * np.fft.rfft(path, size, axis=0).conj()
    product = np.fft.irfft(spectrum.sum(axis=1), size)[: len(energy)]
    total = energy - 2 * product + (path**2).sum()
    return np.asarray(np.sqrt(np.maximum(total, 0.0) / (len(path) * max(moving, 1))))


def mean_cycle(cycles: Sequence[np.ndarray]) -> np.ndarray:
    """Average cycles of one recording.

    Args:
        cycles: Torque of the motors in each cycle, shape (samples, n_axes), in [N m].

    Returns:
        The mean, same shape.
    """
    return np.asarray(np.mean(np.stack(cycles), axis=0))

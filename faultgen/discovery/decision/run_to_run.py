"""How much an unchanged robot differs from run to run, measured from recordings of its motions.

Several healthy recordings, or several repetitions of a motion in one of them, show how far the
numbers of a healthy robot usually differ between two runs:

    groups = learned(posed, differences(healthy))

A single healthy recording shows nothing of this, but the axes of the robot do: a fault changes one
axis or two, a warmer day all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from faultgen.discovery.decision.arrays import Posed
from faultgen.discovery.decision.difference import difference_of
from faultgen.discovery.replay.sensitivities import FOLLOWS, LEAST_RANGE
from faultgen.discovery.terms.candidates import Term
from faultgen.effects.temperature import friction_ratios
from faultgen.inference.model import Group
from faultgen.recordings.recording import Recording
from faultgen.robot import Robot

_EQUAL = 1e-6  # difference of equal reference positions, over their range


@dataclass(frozen=True, eq=False)
class RunDifference:
    """A difference between runs of one motion.

    Its noise, and its variance from run to run, are those of a healthy recording minus its
    baseline.
    """

    torque: np.ndarray
    """Shape (samples, n_axes), in the unit of the torque of the recordings."""
    part: slice
    """Samples that it has. The others are 0."""


def differences(healthy: Sequence[Recording]) -> list[RunDifference]:
    """Form independent differences between runs of the same motions.

    Args:
        healthy: Recordings of the same motions of an unchanged robot. If there is only one, its
            separate recordings with equal reference positions are compared.

    Returns:
        One difference less than there are runs of each motion. It is empty if no motion was
        recorded twice.
    """
    first = healthy[0]
    if len(healthy) > 1:
        runs = np.stack([one.torque for one in healthy])
        whole = slice(0, len(first.torque))
        return [RunDifference(torque, whole) for torque in _contrasts(runs, 1 + 1 / len(runs))]
    found = []
    for parts in repetitions(first):
        for torque in _contrasts(np.stack([first.torque[part] for part in parts]), 2.0):
            whole_torque = np.zeros_like(first.torque)
            whole_torque[parts[0]] = torque
            found.append(RunDifference(whole_torque, parts[0]))
    return found


def repetitions(recording: Recording) -> list[list[slice]]:
    """Find separate recordings of the same motion: those with equal reference positions.

    Args:
        recording: The recording.

    Returns:
        The parts of each motion that was recorded at least twice.
    """
    reference = recording.reference_position
    if reference is None:
        return []
    slack = _EQUAL * np.ptp(reference, axis=0)
    groups: list[list[slice]] = []
    for part in recording.parts:
        for group in groups:
            known = reference[group[0]]
            if len(known) == part.stop - part.start and np.all(
                np.abs(reference[part] - known) <= slack
            ):
                group.append(part)
                break
        else:
            groups.append([part])
    return [group for group in groups if len(group) > 1]


def _contrasts(runs: np.ndarray, variance: float) -> np.ndarray:
    """Independent differences of runs, shape (runs - 1, ...), with a multiple of their variance."""
    count = len(runs)
    weights = np.zeros((count - 1, count))
    for k in range(1, count):  # Helmert: each run minus the mean of those before it
        weights[k - 1, :k], weights[k - 1, k] = -1 / k, 1
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    return np.sqrt(variance) * np.tensordot(weights, runs, axes=1)


@dataclass(frozen=True, eq=False)
class Learned:
    """What differences between runs show."""

    groups: tuple[Group, ...]
    """Groups of numbers with the scales that the differences show."""
    torque: np.ndarray
    """RMS torque by which the robot differs from run to run beyond noise, shape (n_axes,)."""


def learned(posed: Posed, found: Sequence[RunDifference]) -> Learned | None:
    """Learn from differences between runs how far the numbers of a robot usually differ.

    Args:
        posed: The difference of a recording and its baseline.
        found: Differences between runs of the unchanged robot.

    Returns:
        What they show, one after the other; None if there are no differences.
    """
    groups = None
    squares = []
    for one in found:
        used = np.zeros(len(one.torque), bool)
        used[one.part] = True
        own = replace(posed, residual=one.torque, used=posed.used & used, groups=groups)
        difference = difference_of(own, only_numbers=True)
        groups = difference.model.learned()
        values = difference.model.healthy.values.astype(np.float32)
        torque = np.tensordot(values, np.array(difference.numbers.columns), axes=1)
        count = np.maximum(difference.inside.sum(axis=0), 1)
        squares.append((torque**2 * difference.inside).sum(axis=0) / count)
    return None if groups is None else Learned(groups, np.sqrt(np.mean(squares, axis=0)))


def by_temperature(
    recording: Recording, baseline: Recording, robot: Robot, terms: Sequence[Term], raw: np.ndarray
) -> np.ndarray | None:
    """Compute the change of the torque that another temperature makes, by Bittencourt's law.

    This is for recordings at one temperature each. Where the temperature changes within a
    recording, the data show whether friction follows it.

    Args:
        recording: The recording.
        baseline: The baseline.
        robot: The model.
        terms: All terms.
        raw: Their columns, shape (terms, samples, n_axes).

    Returns:
        Shape (samples, n_axes); None if a temperature was not measured, changes within a recording,
        or is the same.
    """
    now, before = recording.axis_temperature, baseline.axis_temperature
    if now is None or before is None:
        return None
    if max(np.ptp(now, axis=0).max(), np.ptp(before, axis=0).max()) >= LEAST_RANGE:
        return None
    means = zip(now.mean(axis=0), before.mean(axis=0), strict=True)
    change: dict[tuple[str, int], float] = {}
    for axis, both in enumerate(means, start=1):
        warm, cold = (
            np.array(friction_ratios(float(one), robot.friction_temperature)) for one in both
        )
        change |= {(name, axis): size for name, size in zip(FOLLOWS, warm / cold - 1, strict=True)}
    first = {term.key: k for k, term in reversed(list(enumerate(terms)))}
    column = sum(size * raw[first[key]] for key, size in change.items() if key in first)
    return column if np.any(column) else None

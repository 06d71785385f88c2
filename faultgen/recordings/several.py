"""Several recordings of one robot as one, and the healthy runs that belong to each of them.

recording = joined([first, second])
recording, runs = with_healthy([first, second], [first_healthy, second_healthy])
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from faultgen.errors import InputError
from faultgen.recordings.in_step import in_step
from faultgen.recordings.noise import is_same_noise
from faultgen.recordings.recording import Recording

_SAME_PERIOD = 1e-3  # relative difference of sample periods that clocks may have: assumed


def joined(recordings: Sequence[Recording]) -> Recording:
    """Put recordings of one robot into one, each as separate recordings of it.

    Args:
        recordings: At least one.

    Returns:
        The recording. It has the optional arrays that all recordings have.

    Raises:
        InputError: They differ in what cannot be brought together: the number of axes, the side,
            the sample period, the kind of torque, or the payload.
    """
    first = recordings[0]
    if len(recordings) == 1:
        return first
    for other in recordings[1:]:
        for what, one, another in zip(_WHAT, _kind(first), _kind(other), strict=True):
            if one != another:
                raise InputError(
                    f"{first.source} and {other.source}: cannot be used together: {what} is "
                    f"{one} in the first and {another} in the second"
                )
        if abs(other.sample_period / first.sample_period - 1) > _SAME_PERIOD:
            raise InputError(
                f"{first.source} and {other.source}: cannot be used together: their samples are "
                f"{first.sample_period:g} s and {other.sample_period:g} s apart; record both with "
                "the same period"
            )
    starts = np.cumsum([0, *(len(one.position) for one in recordings[:-1])])
    return replace(
        first,
        source=", ".join(one.source for one in recordings),
        position=np.concatenate([one.position for one in recordings]),
        torque=np.concatenate([one.torque for one in recordings]),
        velocity=_all([one.velocity for one in recordings]),
        reference_position=_all([one.reference_position for one in recordings]),
        temperature=_all([one.axis_temperature for one in recordings]),
        segments=tuple(
            int(start + own)
            for start, one in zip(starts, recordings, strict=True)
            for own in one.segments
        ),
        notes=tuple(note for one in recordings for note in one.notes),
        lost=_all_lost(recordings),
        faults=tuple(fault for one in recordings for fault in one.faults),
        left_out=tuple(sorted(set.intersection(*(set(one.left_out) for one in recordings)))),
    )


_WHAT = ("the number of axes", "the side", "the torque", "the payload [kg]")


def _kind(recording: Recording) -> tuple[object, ...]:
    """What two recordings must have in common, in the order of `_WHAT`."""
    torque = "motor current" if recording.current else "torque"
    if recording.link:
        torque = "torque behind the gearbox"
    return recording.n_axes, recording.side, torque, recording.payload_mass


def _all_lost(recordings: Sequence[Recording]) -> np.ndarray | None:
    if all(one.lost is None for one in recordings):
        return None
    return np.concatenate(
        [np.zeros(one.position.shape, bool) if one.lost is None else one.lost for one in recordings]
    )


def _all(arrays: Sequence[np.ndarray | None]) -> np.ndarray | None:
    known = [one for one in arrays if one is not None]
    return np.concatenate(known) if len(known) == len(arrays) else None


def is_same_motion(worn: Recording, baseline: Recording) -> bool:
    """Whether two recordings contain the same motions, sample by sample.

    Args:
        worn: Recording of the robot.
        baseline: Recording of the same robot before the change.
    """
    if not (
        worn.position.shape == baseline.position.shape
        and worn.side == baseline.side
        and worn.segments == baseline.segments
        and abs(worn.sample_period - baseline.sample_period) < 1e-9
    ):
        return False
    moved = np.ptp(baseline.position, axis=0)
    apart = np.abs(worn.position - baseline.position).max(axis=0)
    return bool(np.all(apart <= 0.05 * moved + 1e-3 * moved.max()))


def with_healthy(
    measured: Sequence[Recording], healthy: Sequence[Recording]
) -> tuple[Recording, list[Recording]]:
    """Join recordings, and the healthy runs of the same motions in the same order.

    Args:
        measured: Recordings of the robot, at least one.
        healthy: Recordings from before the change, in any order: none, or for each measured
            recording equally many with the same motions.

    Returns:
        The measured recordings as one, and the healthy ones as runs of it. Whether they contain
        the same motions is not checked if only one recording was measured.

    Raises:
        InputError: The recordings cannot be joined, or a healthy one has no measured one with the
            same motions, or they are not equally many for each.
    """
    if len(measured) == 1:
        recording, *runs = in_step([measured[0], *healthy])
        return recording, runs
    if not healthy:
        return joined(measured), []
    groups: list[list[Recording]] = [[one] for one in measured]
    for run in healthy:
        same = [group for group in groups if is_same_motion(*in_step([group[0], run]))]
        if not same:
            raise InputError(
                f"{run.source}: none of the measured recordings contains the same motions, sample "
                "by sample; give healthy recordings of the same programs from the same start"
            )
        min(same, key=len).append(run)
    fewest = min(groups, key=len)
    if len({len(group) for group in groups}) > 1:
        most = max(groups, key=len)
        raise InputError(
            f"{fewest[0].source} has {len(fewest) - 1} healthy recordings of the same motions, and "
            f"{most[0].source} has {len(most) - 1}; give equally many for each"
        )
    groups = [in_step(group) for group in groups]
    recording, *runs = (joined([group[k] for group in groups]) for k in range(len(fewest)))
    return recording, runs


def check_same_motion(worn: Recording, baseline: Recording) -> None:
    """Refuse two recordings that cannot be subtracted from each other.

    Args:
        worn: Recording of the robot.
        baseline: Recording of the same motions before the change.

    Raises:
        InputError: They do not contain the same motions, sample by sample.
    """
    if (worn.constants is None) != (baseline.constants is None):
        raise InputError(
            f"{worn.source} and {baseline.source}: only one of them has motor_current; give both "
            "as currents, or both as torques"
        )
    if worn.link != baseline.link:
        raise InputError(
            f"{worn.source} and {baseline.source}: not both have the torque sensor behind the "
            "gearbox; give both with the same torque_sensor"
        )
    if not is_same_motion(worn, baseline):
        raise InputError(
            f"{worn.source} and {baseline.source}: not the same motions, sample by sample; record "
            "the same program from the same start, with the same sample period"
        )


def check_distinct(recordings: Sequence[Recording]) -> None:
    """Refuse recordings that are given twice: they would count as twice the evidence.

    Args:
        recordings: Recordings of one robot.

    Raises:
        InputError: Two of them have the same torque.
    """
    for one, other in combinations(recordings, 2):
        if np.array_equal(one.torque, other.torque):
            raise InputError(f"{one.source} and {other.source}: the same run; give each run once")


def check_own_noise(healthy: Sequence[Recording]) -> None:
    """Refuse healthy recordings that do not show how much runs differ.

    Args:
        healthy: Recordings of the same motions.

    Raises:
        InputError: Two of them are the same, or have the same noise, or are too short to tell.
    """
    check_distinct(healthy)
    for one, other in combinations(healthy, 2):
        try:
            same = is_same_noise(one.torque, other.torque, one.parts)
        except ValueError as error:
            raise InputError(f"{one.source}: {error}") from None
        if same.any():
            raise InputError(
                f"{one.source} and {other.source}: have the same noise, as runs of one dataset "
                "with paired = true do; give healthy runs with their own noise"
            )

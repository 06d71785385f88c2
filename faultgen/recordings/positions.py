"""Positions that continue: their unit, whole turns, and gaps.

recording, findings = with_unit(recording, robot)
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from faultgen.recordings.finding import CORRECTED, TRUST, WARN, Finding
from faultgen.recordings.recording import ARRAYS, Recording
from faultgen.robot import Robot

_TURN = 2 * np.pi  # [rad]
_NEAR = 5  # steps before and after a jump that tell how far an axis usually moves
_MISSING = 2.5  # usual steps that a jump may take more: two missing samples
_MANY_GAPS = 20  # from which jumps are not gaps, but the speed that the model allows is wrong
_SHORTEST = 50  # samples of a segment between gaps that is worth keeping: assumed
_ROOM = 0.05  # share of a joint's range by which positions may be outside of it


def with_unit(recording: Recording, robot: Robot) -> tuple[Recording, list[Finding]]:
    """Bring positions to radians of their side, counted from the turn that the model has.

    Args:
        recording: The measured data.
        robot: The model, for the ranges of its joints.

    Returns:
        The recording and what was found.
    """
    findings: list[Finding] = []
    low, high = robot.joint_range.T
    slack = _ROOM * (high - low)
    joint = recording.joint_position(robot)
    position = recording.position.copy()
    reference = recording.reference_position
    reference = None if reference is None else reference.copy()

    def fits(axis: int, values: np.ndarray) -> bool:
        """Whether positions are in the range of a joint, or nearly."""
        inside = (values >= low[axis] - slack[axis]) & (values <= high[axis] + slack[axis])
        return bool(inside.all())

    for axis in range(robot.n_axes):
        own, ratio = joint[:, axis], robot.gear_ratio[axis]
        if fits(axis, own):
            continue
        told = (
            f"joint angles from {own.min():.3g} to {own.max():.3g} rad are outside of the range "
            f"{low[axis]:.3g} to {high[axis]:.3g} rad"
        )
        turns = round((low[axis] + high[axis] - own.min() - own.max()) / 2 / _TURN)
        motor = 1 / (abs(ratio) if recording.side == "motor" else ratio)
        is_hinge = not robot.slides[axis]
        asked = None if reference is None else reference[:, axis]
        per_joint = ratio if recording.side == "motor" else 1.0
        if turns and is_hinge and fits(axis, own + turns * _TURN):
            position[:, axis] += turns * _TURN * per_joint
            if reference is not None and not fits(axis, reference[:, axis]):
                reference[:, axis] += turns * _TURN
            told += f": {turns:+d} turn is added, with which they are inside; {TRUST}"
        elif units := [
            (factor, unit)
            for factor, unit in _possible_units(own, asked, is_hinge, motor)
            if fits(axis, own * factor)
        ]:
            factor, unit = units[0]
            if recording.side == "motor" and "motor" in unit:
                unit = "those of the motor, multiplied by the gear ratio"
            position[:, axis] *= factor
            if reference is not None and not fits(axis, reference[:, axis]):
                reference[:, axis] *= factor
            told += f": they are {unit}, and multiplied by {factor:.4g}; {TRUST}"
        else:
            told += "; the range is widened"
            findings.append(Finding(WARN, axis + 1, told))
            continue
        findings.append(Finding(CORRECTED, axis + 1, told))
    if not findings:
        return recording, []
    return replace(recording, position=position, reference_position=reference), findings


def _possible_units(
    joint: np.ndarray, asked: np.ndarray | None, is_hinge: bool, motor: float
) -> list[tuple[float, str]]:
    """What positions may be in, with the factor to the joint's radians; the likeliest first.

    Args:
        joint: Positions on the joint side, shape (samples,).
        asked: Commanded positions of the joint, same shape, or None.
        is_hinge: Whether the joint turns.
        motor: Factor of positions of the motor.
    """
    units = [(np.pi / 180, "in degrees")] * is_hinge
    units += [(motor, "of the motor, not of the joint")]
    if asked is not None and asked.std() > 0:
        moved = joint.std() / asked.std()
        units.sort(key=lambda one: abs(np.log(abs(one[0]) * moved)))
    return units


def _is_gap(steps: np.ndarray, k: int) -> bool:
    """Whether more than two samples are missing before step `k` of an axis.

    A sample that was logged late is followed by a step that catches up. The steps around it then
    add up to the usual ones.
    """
    near = steps[max(k - _NEAR, 0) : k + _NEAR + 1]
    usual = float(np.median(near))
    return bool(abs(np.sum(near - usual)) > _MISSING * abs(usual) + 1e-6)


def continued(recording: Recording, robot: Robot) -> tuple[Recording, list[Finding]]:
    """Continue angles that start again after a whole turn.

    Args:
        recording: The measured data.
        robot: The model, for the largest speeds.

    Returns:
        The recording and what was found.
    """
    if robot.gearing.coupled.any():
        return recording, []
    findings: list[Finding] = []
    position = recording.position.copy()
    fastest = robot.joint_velocity_limit
    per_joint = robot.gear_ratio if recording.side == "motor" else np.ones(robot.n_axes)
    for axis in np.flatnonzero(~robot.slides).tolist():
        turn = _TURN * abs(per_joint[axis])
        most = 2 * fastest[axis] * abs(per_joint[axis]) * recording.sample_period
        for part in recording.parts:
            steps = np.diff(position[part, axis])
            whole = np.flatnonzero((np.abs(np.abs(steps) - turn) <= most) & (most < turn / 4))
            if not len(whole):
                continue
            back = np.zeros(len(steps) + 1)
            back[whole + 1] = -np.sign(steps[whole]) * turn
            position[part, axis] += np.cumsum(back)
            text = (
                f"jumps by {steps[whole[0]]:.4g} rad at sample {part.start + whole[0] + 1}: the "
                f"angle starts again after a whole turn, and is continued; {TRUST}"
            )
            findings.append(Finding(CORRECTED, axis + 1, text))
    return (replace(recording, position=position) if findings else recording), findings


def without_gaps(recording: Recording, robot: Robot) -> tuple[Recording, list[Finding]]:
    """Begin a new segment after each gap, where an axis jumps.

    Args:
        recording: The measured data.
        robot: The model, for the largest speeds.

    Returns:
        The recording and what was found.
    """
    findings: list[Finding] = []
    period = recording.sample_period
    fastest = robot.joint_velocity_limit
    starts: set[int] = set()
    for axis in range(robot.n_axes):
        gaps: list[int] = []
        late = 0
        first = (0.0, 0)
        for part in recording.parts:
            steps = np.diff(recording.joint_position(robot)[part, axis])
            for k in np.flatnonzero(np.abs(steps) > 1.5 * fastest[axis] * period + 1e-6).tolist():
                if not len(gaps) + late:
                    first = (float(steps[k]), part.start + k + 1)
                if _is_gap(steps, k):
                    gaps.append(part.start + k + 1)
                else:
                    late += 1
        if not len(gaps) + late:
            continue
        text = (
            f"jumps by {first[0]:.3g} rad at sample {first[1]}, more than {fastest[axis]:.3g} "
            "rad/s allow"
        )
        if len(gaps) > _MANY_GAPS:
            more = f" ({len(gaps)} such jumps): the model allows too little, or samples are missing"
            findings.append(Finding(WARN, axis + 1, text + more))
        elif gaps:
            starts.update(gaps)
            more = f": a gap, after which a new segment begins ({len(gaps)} in all); {TRUST}"
            findings.append(Finding(CORRECTED, axis + 1, text + more))
        else:
            more = (
                f" ({late} such jumps in all): samples were logged late, or one or two are missing"
            )
            findings.append(Finding(WARN, axis + 1, text + more))
    if not any(one.level == CORRECTED for one in findings):
        return recording, findings
    return _cut_at(recording, sorted(starts)), findings


def _cut_at(recording: Recording, starts: list[int]) -> Recording:
    """Begin segments at some samples, and leave out those that are too short to use."""
    edges = sorted({*recording.segments, *starts, len(recording.position)})
    new = set(starts)
    pieces = [
        slice(start, stop)
        for start, stop in pairwise(edges)
        if stop - start >= _SHORTEST or not ({start, stop} & new)
    ]
    if not pieces or len(pieces) == len(recording.segments):
        return recording
    rows = np.concatenate([np.arange(piece.start, piece.stop) for piece in pieces])
    ends = np.cumsum([piece.stop - piece.start for piece in pieces])
    arrays = {
        name: None if getattr(recording, name) is None else getattr(recording, name)[rows]
        for name in (*ARRAYS, "lost")
    }
    segments = (0, *(int(end) for end in ends[:-1]))
    return replace(recording, **arrays, segments=segments)  # type: ignore[arg-type]

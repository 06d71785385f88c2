"""The unit of each logged torque, corrected where the recordings show it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from faultgen.discovery.rigid.torque_log import (
    LOG_CERTAIN,
    Evidence,
    Factor,
    common_factor,
    doubtful_gain,
    known_factors,
    own_factor,
    own_gain,
)
from faultgen.recordings.finding import CORRECTED, TRUST, WARN, Finding
from faultgen.recordings.recording import Recording, TorqueConstants
from faultgen.robot import Robot

Found: TypeAlias = "list[list[Evidence | None]]"
"""Evidence of each recording by axis."""


def with_scale(
    recordings: list[Recording],
    robot: Robot,
    evidence: Found,
    known: Recording | None,
    findings: list[list[Finding]],
) -> list[Recording]:
    """Bring torques to the unit and the side that is stated.

    Args:
        recordings: Recordings of the same sensors.
        robot: The model.
        evidence: The evidence of each by axis.
        known: A recording of these sensors that was accepted before, or None.
        findings: What was found in each. What is corrected here is added.

    Returns:
        The recordings; the given ones where nothing was changed.
    """
    out = []
    chosen = [_factors(one, robot, axes) for one, axes in zip(recordings, evidence, strict=True)]
    for k, recording in enumerate(recordings):
        factors = known_factors(robot, recording.side)
        scale, gains = np.ones(robot.n_axes), np.ones(robot.n_axes)
        for axis in range(robot.n_axes):
            one = evidence[k][axis]
            number, other = chosen[k][axis] or (None, None)
            if number is None and one is not None:
                theirs = [told[0] for told in (one[axis] for one in chosen) if told is not None]
                number = next((n for n in theirs if _together(evidence, axis, n)), None)
            gain = _gain(evidence, axis) if recording.constants is None else None
            if number is not None:
                value = factors[number].values[axis]
                text = f"the torque {factors[number].unit}: it is divided by {value:.6g}"
                if other is None or recording.link:
                    scale[axis] = value
                else:
                    gains[axis] = value
                    text += f" (or {factors[other].unit}), and its gain counts as unknown"
                findings[k].append(Finding(CORRECTED, axis + 1, f"{text}; {TRUST}"))
            elif gain is not None and not recording.link:
                gains[axis] = gain
                text = (
                    f"the torque is {gain:.3g} times what the model needs, and no usual unit "
                    "explains it: it is divided by that, and its gain counts as unknown; check "
                    f"its unit, the gear ratio and the torque constant; {TRUST}"
                )
                findings[k].append(Finding(CORRECTED, axis + 1, text))
            elif one is not None and recording.constants is None:
                seems = doubtful_gain(one)
                if seems is not None:
                    text = (
                        f"the torque seems to be {seems:.2g} times what the model needs, which is "
                        "not certain: it is used as it was logged; check its unit, the gear ratio, "
                        "and the masses of the model"
                    )
                    findings[k].append(Finding(WARN, axis + 1, text))
        if known is not None and known.torque_factor:
            silent = np.array([one is None or not one.is_shown for one in evidence[k]])
            scale = np.where(silent & (scale == 1), 1 / np.abs(known.torque_factor), scale)
        total = scale * gains
        if np.any(total != 1):
            recording = replace(
                recording,
                torque=recording.torque / total,
                torque_factor=tuple((1 / total).tolist()),
            )
        if np.any(gains != 1):
            zero = np.zeros(robot.n_axes)
            constants = TorqueConstants(1 / gains, zero, recording.source)
            recording = replace(recording, constants=constants)
        out.append(recording)
    return out


def _factors(
    recording: Recording, robot: Robot, axes: Sequence[Evidence | None]
) -> list[tuple[int, int | None] | None]:
    """Known factor of each axis of a recording, and another one that explains it as well."""
    if recording.constants is not None:  # they were found from it
        return [None] * robot.n_axes
    factors: list[Factor] = known_factors(robot, recording.side)
    common = common_factor(axes, factors)
    if common is not None:
        return [(common, None)] * robot.n_axes
    return [None if one is None else own_factor(one, factors) for one in axes]


def _together(evidence: Found, axis: int, number: int) -> bool:
    """Whether all recordings together show a factor of an axis."""
    of_axis = [axes[axis] for axes in evidence]
    return sum(one.factors[number] for one in of_axis if one is not None) >= LOG_CERTAIN


def _gain(evidence: Found, axis: int) -> float | None:
    """The gain of an axis that no unit explains, as the recordings tell it together."""
    able = [axes[axis] for axes in evidence]
    told = [own_gain(one) for one in able if one is not None]
    gains = [one for one in told if one is not None]
    if not gains or 2 * len(gains) <= len(told):
        return None
    return float(np.exp(np.mean(np.log(gains))))

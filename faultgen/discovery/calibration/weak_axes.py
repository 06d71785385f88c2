"""Axes on which a calibrated model is worse than classical identification or the given model.

The links belong to all axes, but friction, rotor inertia and offset act on their own axis only, and
on rotors whose motion is prescribed their torque is a formula. On an axis that has become worse
they are therefore fitted once more to the torque that the rest of the model leaves, or they stay as
they were given, whichever predicts other motions better.

    weak = weak_axes(held_out, torque, given_torque)
    torque, choices = repaired(held_out, torque, model, given, weak)
    robot = with_choices(held_out, robot, given, choices)
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from faultgen.discovery.calibration.held_out import HeldOut
from faultgen.discovery.fit.bounded import bounded_minimum
from faultgen.discovery.replay.samples import samples_of
from faultgen.discovery.rigid.drives import Drives, built
from faultgen.discovery.rigid.regression import DRIVE
from faultgen.effects.spreads import SPREADS
from faultgen.robot import Robot

AGAIN, GIVEN = "again", "given"
"""Numbers that are fitted once more to the torque of one axis, and those of the given model."""

_NOTHING = 1e-4  # smallest Coulomb friction, as a share of the RMS torque: bristles need some
_RIDGE = 1e-9  # of the diagonal: columns may be the same on an axis that hardly moves


def weak_axes(held_out: HeldOut, torque: np.ndarray, given: np.ndarray) -> np.ndarray:
    """Find the axes on which a model predicts worse than classical identification or as given.

    Args:
        held_out: The recording.
        torque: Torque of the model, in the unit of the recording, shape (samples, n_axes).
        given: The same of the given model.

    Returns:
        Mask of shape (n_axes,): worse beyond the interval.
    """
    worse = held_out.against_classical(torque).worse
    if np.isfinite(given).all():
        worse = worse | held_out.against(torque, given).worse
    return worse


def repaired(
    held_out: HeldOut, torque: np.ndarray, model: Robot, given: Robot, weak: np.ndarray
) -> tuple[np.ndarray, dict[int, str]]:
    """Choose other numbers of the drives for weak axes.

    Args:
        held_out: The recording.
        torque: Torque of the model, in the unit of the recording, shape (samples, n_axes).
        model: The model.
        given: The model before calibration.
        weak: Axes that are looked at, mask of shape (n_axes,).

    Returns:
        The torque with the chosen numbers, shape (samples, n_axes), and the choice for each axis
        (from 0) on which one predicts better: `AGAIN` or `GIVEN`.
    """
    torque, choices = torque.copy(), {}
    rows = samples_of([held_out.regression.parts[k] for k in held_out.fitting], len(torque))
    for axis in np.flatnonzero(weak).tolist():
        judged = held_out.judged[:, axis]
        measured = held_out.recording.torque[:, axis]
        least = np.sum((measured - torque[:, axis])[judged] ** 2)
        use = held_out.regression.inside[:, axis] & rows
        for choice in (AGAIN, GIVEN):
            change = _change(held_out, torque, model, given, axis, use, choice)
            new = torque[:, axis] + _columns(held_out, model, axis) @ change
            square = np.sum((measured - new)[judged] ** 2)
            if square < least:
                least, best = square, new
                choices[axis] = choice
        if axis in choices:
            torque[:, axis] = best
    return torque, choices


def with_choices(
    held_out: HeldOut, model: Robot, given: Robot, choices: Mapping[int, str]
) -> Robot:
    """Put chosen numbers of the drives into a model that was fitted to the whole recording.

    Args:
        held_out: The recording.
        model: The model.
        given: The model before calibration.
        choices: Choice by axis, from 0.

    Returns:
        The model with other drives; the same one if there is no choice.

    Raises:
        SimulationFailed: MuJoCo cannot compile it.
    """
    if not choices:
        return model
    torque = held_out.torque_of(model)
    drives = Drives.of(model)
    values = {name: value.copy() for name, value in drives.named().items()}
    rise = drives.rise.copy()
    for axis, choice in choices.items():
        use = held_out.regression.inside[:, axis]
        change = _change(held_out, torque, model, given, axis, use, choice)
        for name, by in zip(DRIVE, change.tolist(), strict=True):
            values[name][axis] += by
        if choice == GIVEN:
            rise[axis] = Drives.of(given).rise[axis]
        elif held_out.regression.scaled[axis]:
            rise[axis] *= values["Coulomb"][axis] / drives.coulomb[axis]
    inertia, coulomb, viscous, offset = values.values()
    return built(model, Drives(inertia, coulomb, viscous, offset, rise))


def _columns(held_out: HeldOut, model: Robot, axis: int) -> np.ndarray:
    """Logged torque for each unit of `DRIVE` on one axis, shape (samples, DRIVE)."""
    to_log = 1 / model.torque_gain[axis]
    if held_out.recording.side == "joint":
        to_log *= model.gearing.matrix[axis, axis]
    return to_log * held_out.regression.drive_torque()[:, :, axis].T


def _change(
    held_out: HeldOut,
    torque: np.ndarray,
    model: Robot,
    given: Robot,
    axis: int,
    use: np.ndarray,
    choice: str,
) -> np.ndarray:
    """Change of the drive's numbers on one axis, in the order of `DRIVE`."""
    now = np.array([value[axis] for value in Drives.of(model).named().values()])
    if choice == GIVEN:
        return np.array([value[axis] for value in Drives.of(given).named().values()]) - now
    columns = _columns(held_out, model, axis)[use]
    left = (held_out.recording.torque - torque)[use, axis]
    if not len(left) or not np.isfinite(left).all():
        return np.zeros(len(DRIVE))
    size = np.sqrt(np.mean(columns**2, axis=0))
    size = np.where(size > 0, size, 1.0)
    gram = columns.T @ columns / np.outer(size, size) / len(left)
    gram[np.diag_indices_from(gram)] += _RIDGE + _RIDGE * np.trace(gram)
    rms = np.sqrt(np.mean(held_out.recording.torque[:, axis] ** 2))
    friction = _NOTHING * rms / max(float(size[1]), 1e-300)
    factor = SPREADS["rotor_inertia"].factor  # a gearbox with much less inertia diverges
    low = np.array([now[0] / factor, friction, 0.0, -np.inf]) - now
    high = np.array([now[0] * factor, np.inf, np.inf, np.inf]) - now
    low = np.minimum(low, 0.0)
    right = columns.T @ left / size / len(left)
    return bounded_minimum(gram, right, low * size, high * size) / size

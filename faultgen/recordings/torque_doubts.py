"""Torques that are none: a position under another name, samples that were held, no weight.

for axis, text, is_torque in torque_doubts(recording):
    print(axis, text)
share, error = weight_share(torque, gravity, [inertia, friction], offset=0.01)
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from faultgen.recordings.recording import Recording

_IMAGE = 1e-4
"""Share of a torque that a line in a position leaves, below which it is that position: noise and
friction of real torques leave a hundred times as much."""
_CHANGES = 20  # changes of a torque from which its steps are judged: assumed
_ALIKE = 0.9  # share of the steps that are equally long if a torque was held: assumed
_BLOCKS = 12  # parts of a recording that are left out in turn for a standard error
_NO_WEIGHT = 0.1  # share of the weight, up to which it is none: assumed; a balancer leaves more
_CERTAIN = 5.0  # standard errors between all weight and none, from which the two are told apart
_SINGULAR = 1e10  # condition from which gravity cannot be told from the rest: rounding


def torque_doubts(recording: Recording) -> list[tuple[int, str, bool]]:
    """Find torques that look like something else, without a model.

    Args:
        recording: The recording.

    Returns:
        Axis, from 1, what is wrong with its torque, and whether it is a torque nevertheless.
    """
    what = "current" if recording.current else "torque"
    return [
        *((axis, f"the {what} {text}", False) for axis, text in _images(recording)),
        *((axis, f"the {what} {text}", True) for axis, text in _held(recording)),
    ]


def constant_torques(recording: Recording) -> list[int]:
    """Find the axes that move although their torque never changes.

    Args:
        recording: The recording.

    Returns:
        Axes, from 1.
    """
    still = np.ptp(recording.torque, axis=0) == 0
    return (np.flatnonzero(still & (np.ptp(recording.position, axis=0) > 0)) + 1).tolist()


def _images(recording: Recording) -> list[tuple[int, str]]:
    """Torques that are a line in a position."""
    positions = {"position": recording.position, "reference position": recording.reference_position}
    columns = [
        (f"{name} of axis {axis}", column)
        for name, values in positions.items()
        if values is not None
        for axis, column in enumerate(values.T, start=1)
    ]
    found = []
    for axis, torque in enumerate(recording.torque.T, start=1):
        factors = ((what, _factor(torque, column)) for what, column in columns)
        image = next((one for one in factors if one[1] is not None), None)
        if image is not None:
            what, factor = image
            text = f"is the {what} times {factor:.4g}: name the column of the torque"
            found.append((axis, text))
    return found


def _factor(torque: np.ndarray, column: np.ndarray) -> float | None:
    """How many times a column a torque is, but for an offset; None if it is something else."""
    own, line = torque - torque.mean(), column - column.mean()
    if not own.any() or not line.any():
        return None
    factor = float(own @ line / (line @ line))
    return factor if np.std(own - factor * line) < _IMAGE * np.std(own) else None


def _held(recording: Recording) -> list[tuple[int, str]]:
    """Torques that change with every second, third, … sample only, while the axis moves."""
    found = []
    for axis in range(recording.n_axes):
        lengths: list[int] = []
        moved = []
        for part in recording.parts:
            torque, position = recording.torque[part, axis], recording.position[part, axis]
            changes = np.flatnonzero(np.diff(torque) != 0)
            lengths += np.diff(changes).tolist()
            moved.append((np.diff(position) != 0)[np.diff(torque) == 0])
        if len(lengths) < _CHANGES:
            continue
        usual = int(np.median(lengths))
        near = np.isin(lengths, [usual, usual + 1])
        held = usual >= 2 and near.mean() >= _ALIKE
        if held and np.concatenate(moved).mean() >= _ALIKE:
            mean = float(np.mean(np.array(lengths)[near]))
            period = mean * recording.sample_period
            found.append(
                (
                    axis + 1,
                    f"is held for {mean:.3g} samples, as if it was measured every {period:.4g} s "
                    f"only: log every {usual}th sample, or the torque at the rate of the position",
                )
            )
    return found


def weight_share(
    torque: np.ndarray, gravity: np.ndarray, others: Sequence[np.ndarray], offset: float
) -> tuple[float, float]:
    """Estimate which share of the model's gravity torque is in a measured torque.

    torque = share · gravity + the sum of the others, each times a number; by least squares. The
    standard error is that of a jackknife over blocks in time, because errors of a model are not
    independent from sample to sample, and that which an unknown offset of the torque adds.

    Args:
        torque: Measured torque of an axis, shape (samples,).
        gravity: Torque that holds the model's arm at each pose, with the springs that the model
            has, shape (samples,).
        others: Torques that explain the rest: inertia, friction; shape (samples,) each.
        offset: Standard deviation of the offset, in the unit of the torque.

    Returns:
        The share, 1 if all weight is in the torque, and its standard error; infinite if the motion
        does not show it.
    """
    columns = np.column_stack([gravity, *others])
    size = np.abs(columns).max(axis=0)
    columns = columns[:, size > 0] / size[size > 0]
    if not size[0] or len(torque) < 2 * _BLOCKS * columns.shape[1]:
        return 0.0, np.inf
    blocks = np.array_split(np.arange(len(torque)), _BLOCKS)
    products = [columns[rows].T @ columns[rows] for rows in blocks]
    # of the measured torque, and of an offset of 1
    sides = [columns[rows].T @ np.stack([torque[rows], 0 * rows + 1.0], axis=1) for rows in blocks]
    whole, side = np.sum(products, axis=0), np.sum(sides, axis=0)
    if np.linalg.cond(whole) > _SINGULAR:
        return 0.0, np.inf

    def solved(left: np.ndarray, right: np.ndarray) -> np.ndarray:
        return np.asarray(np.linalg.lstsq(left, right, rcond=None)[0][0] / size[0])

    share, by_offset = solved(whole, side)
    each = np.array(
        [solved(whole - one, side - two)[0] for one, two in zip(products, sides, strict=True)]
    )
    scatter = np.sqrt((_BLOCKS - 1) / _BLOCKS * np.sum((each - each.mean()) ** 2))
    return float(share), float(np.hypot(scatter, by_offset * offset))


def without_weight(
    torque: np.ndarray,
    gravity: np.ndarray,
    rest: np.ndarray,
    speed: np.ndarray,
    offsets: np.ndarray,
) -> tuple[list[tuple[int, float, float]], bool]:
    """Find axes whose measured torque lacks the weight that the model carries there.

    Vertical and balanced axes have no gravity torque in the model, and show nothing.

    Args:
        torque: Measured torque, shape (samples, n_axes).
        gravity: Gravity torque of the model, same shape and unit.
        rest: Torque of the model without it, same shape.
        speed: Speed of the axes, same shape.
        offsets: Standard deviations of the offsets, shape (n_axes,), in the unit of the torque.

    Returns:
        Axis, from 1, share of the weight and its standard error, of each axis without weight; and
        whether at least two axes show the weight or its absence, and none of them has it.
    """
    shares = [
        weight_share(
            torque[:, axis],
            gravity[:, axis],
            [rest[:, axis], np.sign(speed[:, axis]), speed[:, axis]],
            offsets[axis],
        )
        for axis in range(torque.shape[1])
    ]
    known = [k for k, (_, error) in enumerate(shares) if _CERTAIN * error < 1]
    lacking = [k for k in known if abs(shares[k][0]) < max(_NO_WEIGHT, 2 * shares[k][1])]
    if not lacking:
        return [], False
    also = [
        k
        for k, (share, error) in enumerate(shares)
        if k not in known and abs(share) < 2 * error < 1 - share
    ]
    found = [(k + 1, *shares[k]) for k in sorted(lacking + also)]
    return found, len(known) >= 2 and lacking == known

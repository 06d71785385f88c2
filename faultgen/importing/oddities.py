"""What loggers do to numbers: marks of missing values, rows of zeros, angles that start again."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from faultgen.importing.table import Table

_MARKS = (999.0, 9999.0, 99999.0, 999999.0, 9999999.0, 32768.0, 65535.0, 2147483647.0, 2147483648.0)
_FAR = 10.0  # of a mark from zero, over that of all other numbers
_MOST = 0.2  # share of the numbers that can be marks, and of the rows that can be zeros
_TURN = 2 * np.pi
_STEP = 0.25  # largest other step of an angle that starts again, in turns
_OFTEN = 5  # runs of zeros that another program writes: assumed
_JUMP = 20.0  # of a dropout, over the largest of usual steps


def without_missing(
    table: Table, name: str, values: np.ndarray, marks: Sequence[float] | None, notes: list[str]
) -> np.ndarray:
    """Return the numbers of a column, with NaN in place of numbers that stand for a missing value.

    Args:
        table: The log.
        name: Name of the column.
        values: Its numbers, shape (rows,).
        marks: Such numbers. None: usual ones, such as -9999, if they are far from all others.
        notes: Gets a line if there are any.

    Returns:
        The numbers in the unit of the log, shape (rows,).
    """
    usual = [sign * one for one in _MARKS for sign in (1, -1)] if marks is None else marks
    for mark in usual:
        at = values == mark
        if not at.any():
            continue
        others = np.abs(values[~at & np.isfinite(values)])
        if marks is None and (
            at.mean() > _MOST or not len(others) or abs(mark) < _FAR * others.max()
        ):
            continue
        values = np.where(at, np.nan, values)
        notes.append(
            f"column '{name}': {at.sum()} cells with {mark:g} count as missing, the first is "
            f"{table.place(int(np.argmax(at)))}"
            + ("; if they are numbers, state file.missing = []" if marks is None else "")
        )
    return values


def unwrapped(table: Table, name: str, angle: np.ndarray, notes: list[str]) -> np.ndarray:
    """Continue an angle that a logger keeps within one turn.

    Args:
        table: The log.
        name: Name of the column.
        angle: The angle of a joint [rad], NaN where it is missing, shape (rows,).
        notes: Gets a line if the angle was continued.

    Returns:
        The angle without jumps of a whole turn, by whole turns as close to zero as it can be;
        unchanged if it has no such jumps, or also others. Shape (rows,), in [rad].
    """
    rows = np.flatnonzero(np.isfinite(angle))
    step = np.diff(angle[rows])
    jumps = np.abs(step) > _TURN / 2
    if not jumps.any():
        return angle
    usual = float(np.abs(step[~jumps]).max(initial=0.0))
    away = np.abs(np.abs(step[jumps]) - _TURN)
    if usual > _STEP * _TURN or (away > 2 * usual + 1e-3 * _TURN).any():
        return angle
    continued = angle.copy()
    continued[rows] = np.unwrap(angle[rows])
    middle = (continued[rows].min() + continued[rows].max()) / 2
    continued -= _TURN * np.round(middle / _TURN)
    first = int(rows[1:][jumps][0])
    notes.append(
        f"column '{name}': the angle jumps by a whole turn {jumps.sum()} times, the first time in "
        f"{table.place(first)}; it was continued"
    )
    return continued


def dropouts(quantities: Sequence[np.ndarray]) -> np.ndarray:
    """Find rows in which a logger wrote zeros for everything, although the robot was not there.

    They are lost samples, or messages of another program that publishes zeros for the same joints.

    Args:
        quantities: Positions first, then other quantities; shape (rows, columns) each.

    Returns:
        Shape (rows,). A row of zeros is none if the positions lead there.
    """
    zero = np.logical_and.reduce([(values == 0).all(axis=1) for values in quantities])
    found = np.zeros(len(zero), bool)
    if not zero.any() or zero.all():
        return found
    # how far the positions usually move from one row to the next, without the rows of zeros
    position = quantities[0]
    usual = np.nanmax(np.abs(np.diff(position[~zero], axis=0)), axis=0, initial=0.0)
    step = np.abs(np.diff(position, axis=0))
    jumps = np.asarray((step > _JUMP * usual + 1e-9).any(axis=1))
    starts = np.flatnonzero(np.diff(zero.astype(int), prepend=0) == 1)
    ends = np.flatnonzero(np.diff(zero.astype(int), append=0) == -1)
    before = np.array([start > 0 and jumps[start - 1] for start in starts])
    after = np.array([end < len(jumps) and jumps[end] for end in ends])
    there_and_back = before & after
    if there_and_back.sum() >= _OFTEN and there_and_back.mean() > 0.5:
        return zero  # another program: also where the robot happens to be near zero
    if zero.mean() > _MOST:
        return found
    # a run of zero rows is a dropout if the position jumps at one of its ends
    for start, end, jumped in zip(starts, ends, before | after, strict=True):
        if jumped:
            found[start : end + 1] = True
    return found

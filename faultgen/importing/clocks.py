"""Logs in which channels have times of their own."""

from __future__ import annotations

import re
from collections.abc import Iterable

import numpy as np

from faultgen.errors import InputError
from faultgen.importing.table import Table, as_numbers, listed

GAP = 3.5
"""Steps between two samples from which nothing is known in between: up to two missing samples are
interpolated."""

_TIME = re.compile(r"(^|[\W_])(t|time|zeit|stamp|timestamp|clock|uhrzeit)(?=$|[\W_\d])", re.I)
_SAME = 1e-6  # share of the duration by which two columns of one clock may differ: rounding


def at_times(time: np.ndarray, own: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Interpolate a channel at the times of another one.

    Args:
        time: Times at which the channel is needed, NaN where they are missing, shape (rows,).
        own: Times of the channel itself, NaN where they are missing, shape (rows,), in the same
            unit.
        values: The channel, shape (rows,).

    Returns:
        Shape (rows,). NaN before its first sample, after its last one, and in gaps.
    """
    known = np.isfinite(own) & np.isfinite(values)
    own, values = own[known], values[known]
    order = np.argsort(own, kind="stable")
    own, values = own[order], values[order]
    out = np.full(len(time), np.nan)
    if len(own) < 2:
        return out
    wanted = np.isfinite(time) & (time >= own[0]) & (time <= own[-1])
    out[wanted] = np.interp(time[wanted], own, values)
    after = np.searchsorted(own, time[wanted]).clip(1, len(own) - 1)
    exact = np.isin(time[wanted], own)
    step = np.diff(own)
    gap = (step[after - 1] > GAP * np.median(step)) & ~exact
    out[np.flatnonzero(wanted)[gap]] = np.nan
    return out


def check_one_clock(table: Table, name: str, used: Iterable[str]) -> None:
    """Refuse a log that has other columns of times, which differ from the one that is used.

    Args:
        table: The log.
        name: Column of times in the map.
        used: Columns that the map names.

    Raises:
        InputError: There is such a column.
    """
    others = [one for one in table.columns if _TIME.search(one) and one not in {name, *used}]
    if not others:
        return
    first = as_numbers(table.columns[name]).astype(float)
    differ = [
        one
        for one in others
        if _is_other_clock(first, as_numbers(table.columns[one]).astype(float))
    ]
    if differ:
        raise InputError(
            f"{table.source}: has the times '{name}' and {listed(differ)}, which differ, as if "
            f"each channel had a clock of its own; state time.columns in the map, such as "
            f'{{ torque = "{differ[0]}" }}, or time.columns = {{}} if all quantities belong to '
            f"'{name}'"
        )


def _is_other_clock(first: np.ndarray, second: np.ndarray) -> bool:
    """Whether a column has times of the same range that are not those of the first."""
    own = second[np.isfinite(second)]
    both = np.isfinite(first) & np.isfinite(second)
    if len(own) < 3 or both.sum() < 3 or (np.diff(own) <= 0).any():
        return False
    first, second = first[both], second[both]
    duration = np.ptp(first)
    if not duration or np.abs(first - second).max() <= _SAME * duration:
        return False
    slope = np.ptp(second) / duration
    power = np.log10(slope)
    line = second[0] + slope * (first - first[0])
    linear = np.abs(second - line).max() <= 1e-3 * np.ptp(second)
    if linear and abs(power) > 0.5 and abs(power - round(power)) < 1e-3:
        return False  # the same times in another unit
    # the same clock may count from elsewhere, such as from 1970
    return bool(min(first.max(), own.max()) > max(first.min(), own.min()))

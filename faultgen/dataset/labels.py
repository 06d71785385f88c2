"""What a method should predict of each cycle: labels of the rows of a table of cycles."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping

import numpy as np
import pandas as pd

from faultgen.dataset.splits import TEST, TRAIN
from faultgen.errors import InputError

SeverityLimit = float | Mapping[str, float] | None
"""A severity in the unit of the effect, one for each effect by its name, or None: the default."""

SMALLEST_FRACTION = 0.01
"""From here on a cycle counts as worn, if the severity is a fraction. Assumed: it is the smallest
severity at which the thesis judges isolators, and about what the best detectors of
docs/detectability.md see (0.3 to 1.4 % more friction, depending on the axis)."""

SMALLEST_SHARE = 0.05
"""The same for severities with a unit, as a share of the largest severity of the run. Assumed: 1 %
is the same share of 20 %, the default severity of effects that are fractions."""

GROUPS = {"seed": "seed", "robot": "robot_instance"}
"""Column of the table of cycles by name of the groups."""

_FRACTION = "1"

_REMAINING_LIFE, _REMAINING_CYCLES = "remaining_life", "remaining_cycles"
_WORN = ("worn", "axis", "effect")
_USED_BY = {"smallest_severity": _WORN, "failure_severity": (_REMAINING_LIFE,)}


def features_and_labels(
    frame: pd.DataFrame,
    part: tuple[str, str] | None,
    label: str,
    smallest_severity: SeverityLimit = None,
    failure_severity: SeverityLimit = None,
    groups: str = "seed",
) -> tuple[pd.DataFrame, np.ndarray, np.ndarray]:
    """Take features, labels and groups out of a table of cycles.

    Args:
        frame: Table from `faultgen.dataset.tables.cycles_table`.
        part: Division and its part, such as ("run", "train"); None for all cycles.
        label: What is to be predicted; see `Dataset.to_xy`.
        smallest_severity: See `Dataset.to_xy`.
        failure_severity: See `Dataset.to_xy`.
        groups: A name of `GROUPS`.

    Returns:
        Features, shape (cycles, columns); labels, shape (cycles,); and groups, shape (cycles,).

    Raises:
        InputError: There is no such label, or a severity makes no sense.
    """
    y = cycle_labels(frame, label, smallest_severity, failure_severity)
    rows = np.ones(len(frame), bool)
    if part is not None:
        parts = frame[f"split_{part[0]}"].to_numpy()
        rows = parts == part[1]
        if part[0] == "run" and label in ("axis", "effect"):
            unseen = sorted(set(y[parts == TEST].tolist()) - set(y[parts == TRAIN].tolist()))
            if unseen:
                warnings.warn(
                    f"{label} {', '.join(map(str, unseen))}: only in the test part, because there "
                    "is one run of each fault; generate the dataset with --repetitions 3",
                    stacklevel=3,
                )
    features = [name for name in frame.attrs["features"] if frame[name].notna().any()]
    x = frame.loc[rows, features].reset_index(drop=True)
    x.attrs = {"units": {name: frame.attrs["units"][name] for name in features}}
    return x, y[rows], row_groups(frame, groups)[rows]


def row_groups(frame: pd.DataFrame, groups: str) -> np.ndarray:
    """Return the group of each row of a table of cycles, which cross-validation must not divide.

    Args:
        frame: Table from `faultgen.dataset.tables.cycles_table`.
        groups: A name of `GROUPS`.

    Returns:
        The groups, shape (cycles,).

    Raises:
        InputError: There are no such groups.
    """
    if groups not in GROUPS:
        raise InputError(f"groups: must be {' or '.join(GROUPS)}, not '{groups}'")
    found: np.ndarray = frame[GROUPS[groups]].to_numpy()
    return found


def cycle_labels(
    frame: pd.DataFrame,
    label: str,
    smallest_severity: SeverityLimit = None,
    failure_severity: SeverityLimit = None,
) -> np.ndarray:
    """Return the label of each row of a table of cycles.

    Args:
        frame: Table from `faultgen.dataset.tables.cycles_table`.
        label: What is to be predicted; see `Dataset.to_xy`.
        smallest_severity: See `Dataset.to_xy`.
        failure_severity: See `Dataset.to_xy`.

    Returns:
        The labels, shape (cycles,).

    Raises:
        InputError: There is no such label, or a severity makes no sense.
    """
    for name, given in (
        ("smallest_severity", smallest_severity),
        ("failure_severity", failure_severity),
    ):
        if given is not None and label not in _USED_BY[name]:
            raise InputError(
                f"{name}: the label '{label}' does not use it, only {', '.join(_USED_BY[name])}"
            )
    computed: dict[str, Callable[[], np.ndarray]] = {
        "worn": lambda: _worn(frame, smallest_severity),
        "axis": lambda: np.where(_worn(frame, smallest_severity), frame["axis"], 0),
        "effect": lambda: np.where(_worn(frame, smallest_severity), frame["effect"], "healthy"),
        _REMAINING_LIFE: lambda: _remaining_life(frame, failure_severity),
        _REMAINING_CYCLES: lambda: _last_cycle(frame) - frame["cycle"].to_numpy(),
    }
    if label not in computed and label not in frame:
        columns = (name for name in frame if name not in (*computed, *frame.attrs["features"]))
        raise InputError(f"label: there is no '{label}': choose {', '.join([*computed, *columns])}")
    return computed[label]() if label in computed else frame[label].to_numpy()


def _worn(frame: pd.DataFrame, smallest: SeverityLimit) -> np.ndarray:
    """Whether something is worn, at least by the smallest severity that counts."""
    severity = frame["severity"].to_numpy()
    largest = frame.groupby("run")["severity"].transform("max").to_numpy()
    is_fraction = (frame["severity_units"] == _FRACTION).to_numpy()
    default = np.where(is_fraction, SMALLEST_FRACTION, SMALLEST_SHARE * largest)
    worn: np.ndarray = (severity > 0) & (
        severity >= _limit(frame, "smallest_severity", smallest, default)
    )
    return worn


def _remaining_life(frame: pd.DataFrame, failure: SeverityLimit) -> np.ndarray:
    """Cycles until a run fails; nan if it does not fail within its record."""
    cycle, last = frame["cycle"].to_numpy(), _last_cycle(frame)
    is_faulty = (frame["effect"] != "healthy").to_numpy()
    ends = _limit(frame, "failure_severity", failure, np.full(len(frame), np.nan))
    has_failed = pd.Series(np.where(frame["severity"].to_numpy() >= ends, cycle, np.nan))
    first = has_failed.groupby(frame["run"].to_numpy()).transform("min").to_numpy()
    failed_in = np.where(np.isnan(ends), last, first)
    return np.where(is_faulty, np.maximum(failed_in - cycle, 0.0), np.nan)


def _last_cycle(frame: pd.DataFrame) -> np.ndarray:
    """Number of the last cycle of each row's run."""
    last: np.ndarray = frame.groupby("run")["cycle"].transform("max").to_numpy()
    return last


def _limit(frame: pd.DataFrame, name: str, given: SeverityLimit, default: np.ndarray) -> np.ndarray:
    """The limit of the severity in each row, in the unit of the row's effect."""
    if given is None:
        return default
    faulty = frame[frame["effect"] != "healthy"]
    effects = sorted(set(faulty["effect"]))
    if not isinstance(given, Mapping):
        units = sorted(set(faulty["severity_units"]))
        if len(units) > 1:
            raise InputError(
                f"{name}: the severities have the units {', '.join(units)}; give a value for each "
                f"effect, such as {name}={{'{effects[0]}': {given}}}"
            )
        given = dict.fromkeys(effects, given)
    for effect, value in given.items():
        if effect not in effects:
            raise InputError(
                f"{name}: no run has the effect '{effect}', only {', '.join(effects) or 'none'}"
            )
        if not (isinstance(value, (int, float, np.number)) and 0 <= value < np.inf):
            raise InputError(f"{name}: must be a number of at least 0, not {value!r}")
    found = frame["effect"].map(lambda effect: given.get(effect, np.nan)).to_numpy(float)
    return np.where(np.isnan(found), default, found)

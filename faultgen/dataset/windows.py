"""Windows of the logged signals with labels, read from the files when they are asked for.

    windows = Windows.of(dataset.runs, dataset.manifest.splits, window=256, label="effect")
    x, y = windows[0]                       # (256, channels) and the number of a class

Nothing is kept in memory but the labels. Every process opens the files for itself, so that windows
can be handed to worker processes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from faultgen.dataset.labels import SeverityLimit, cycle_labels, row_groups
from faultgen.dataset.open_files import OpenFiles
from faultgen.dataset.splits import RunParts
from faultgen.dataset.stored_run import StoredRun
from faultgen.dataset.tables import cycles_table
from faultgen.errors import InputError

SIGNALS = ("motor_position", "motor_velocity", "motor_torque")
"""Signals that are read by default, as far as all runs have them."""

_COMMANDS = {"reference_position": "command/reference_position"}


@dataclass(frozen=True, eq=False)
class Windows:
    """Windows of the cycles of some runs, in the order of the runs and of time."""

    runs: Sequence[StoredRun]
    """The runs."""
    run_numbers: np.ndarray
    """Which run each cycle belongs to, from 0, shape (cycles,)."""
    cycle_numbers: np.ndarray
    """Place of each cycle in its run, from 0, shape (cycles,)."""
    ends: np.ndarray
    """How many windows there are up to each cycle, including its own, shape (cycles,)."""
    labels: np.ndarray | None
    """Label of each cycle, shape (cycles,); None if no label was asked for."""
    cycle_groups: np.ndarray
    """Group of each cycle, shape (cycles,)."""
    classes: tuple[str, ...]
    """What the labels stand for, if they are texts: label k is ``classes[k]``. Otherwise empty."""
    paths: tuple[str, ...]
    """Arrays of a run that are read."""
    channels: tuple[str, ...]
    """Names of the columns of a window, such as "motor_torque_2"."""
    window: int | None
    """Number of samples of a window; None for whole cycles."""
    stride: int
    """Number of samples from one window to the next."""
    files: OpenFiles = field(default_factory=OpenFiles)
    """Files that this process has open."""

    @classmethod
    def of(
        cls,
        runs: Sequence[StoredRun],
        splits: RunParts,
        *,
        where: str = "dataset",
        window: int | None = None,
        stride: int | None = None,
        signals: str | Sequence[str] | None = None,
        label: str | None = "axis",
        part: tuple[str, str] | None = None,
        smallest_severity: SeverityLimit = None,
        failure_severity: SeverityLimit = None,
        groups: str = "seed",
    ) -> Windows:
        """Divide the cycles of a dataset into windows; see `Dataset.to_torch`.

        Args:
            runs: The runs.
            splits: Ids of the runs of each part, by division.
            where: Place of the dataset, for messages.
            window: Number of samples of a window; None for whole cycles.
            stride: Number of samples from one window to the next; None for windows side by side.
            signals: Names of signals; None for `SIGNALS`.
            label: What is to be predicted; None for nothing.
            part: Division and its part, such as ("run", "train"); None for all cycles.
            smallest_severity: See `Dataset.to_xy`.
            failure_severity: See `Dataset.to_xy`.
            groups: "seed" or "robot".

        Returns:
            The windows.

        Raises:
            InputError: Something is not there, or does not fit together.
        """
        for name, value in (("window", window), ("stride", stride)):
            if value is not None and not (isinstance(value, int | np.integer) and value >= 1):
                raise InputError(f"{name}: must be a whole number of at least 1, not {value!r}")
        frame = cycles_table(runs, splits, [], where)
        counts = [int(run["cycles"]) for run in runs]
        kept = np.ones(len(frame), bool)
        if part is not None:
            kept &= (frame[f"split_{part[0]}"] == part[1]).to_numpy()
        values: np.ndarray | None = None
        classes: tuple[str, ...] = ()
        if label is not None:
            limits = smallest_severity, failure_severity
            values, classes = _numbered(cycle_labels(frame, label, *limits))
            kept &= ~np.isnan(values)
        if not kept.any():
            of = f" in the part '{part[1]}' of the division by {part[0]}" if part else ""
            raise InputError(f"{where}: no cycle has a '{label}'{of}")
        paths = _paths(signals, runs)
        run_numbers = np.repeat(np.arange(len(runs)), counts)[kept]
        lengths, n_axes = _shapes([runs[k] for k in dict.fromkeys(run_numbers.tolist())], paths)
        step = stride or window or 1
        if window is None and len(set(lengths.values())) > 1:
            raise InputError(
                "window: give a number of samples, because the cycles have "
                f"{' and '.join(map(str, sorted(set(lengths.values()))))}"
            )
        if window is not None and window > min(lengths.values()):
            raise InputError(
                f"window: must be at most {min(lengths.values())}, the number of samples of a "
                f"cycle, not {window}"
            )
        windows = [
            1 if window is None else (lengths[runs[k].id] - window) // step + 1 for k in run_numbers
        ]
        return cls(
            runs=runs,
            run_numbers=run_numbers,
            cycle_numbers=np.concatenate([np.arange(count) for count in counts])[kept],
            ends=np.cumsum(windows),
            labels=None if values is None else values[kept],
            cycle_groups=row_groups(frame, groups)[kept],
            classes=classes,
            paths=paths,
            channels=tuple(
                f"{path.rpartition('/')[2]}_{axis + 1}" for path in paths for axis in range(n_axes)
            ),
            window=window,
            stride=step,
        )

    def __len__(self) -> int:
        """Number of windows."""
        return int(self.ends[-1])

    def _cycle_of(self, index: int | np.ndarray) -> Any:
        return np.searchsorted(self.ends, index, side="right")

    @property
    def y(self) -> np.ndarray:
        """Label of each window, shape (windows,).

        Raises:
            InputError: No label was asked for.
        """
        if self.labels is None:
            raise InputError("label: none was asked for")
        found: np.ndarray = self.labels[self._cycle_of(np.arange(len(self)))]
        return found

    @property
    def groups(self) -> np.ndarray:
        """Group of each window, which cross-validation must not divide, shape (windows,)."""
        found: np.ndarray = self.cycle_groups[self._cycle_of(np.arange(len(self)))]
        return found

    def __getitem__(self, index: int) -> Any:
        """Read a window.

        Args:
            index: Its number; negative ones count from the end.

        Returns:
            Its values, shape (window, channels), float32, SI units; and its label, if one was asked
            for.
        """
        count = len(self)
        if not -count <= index < count:
            raise IndexError(f"there are {count} windows, and no number {index}")
        place = int(index) % count
        cycle = int(self._cycle_of(place))
        number = place - (int(self.ends[cycle - 1]) if cycle else 0)
        run = self.runs[self.run_numbers[cycle]]
        start = number * self.stride
        part = slice(None) if self.window is None else slice(start, start + self.window)
        group = self.files.get(run.path)[run.group]
        arrays = []
        for path in self.paths:
            stored = group[path]
            one = stored[part] if stored.ndim == 2 else stored[self.cycle_numbers[cycle], part]
            arrays.append(one)
        values = np.concatenate(arrays, axis=1, dtype=np.float32)
        return values if self.labels is None else (values, self.labels[cycle])


def _numbered(values: np.ndarray) -> tuple[np.ndarray, tuple[str, ...]]:
    """Labels as numbers, and what they stand for; "healthy" is 0."""
    if values.dtype.kind in "biu":
        return values.astype(np.int64), ()
    if values.dtype.kind == "f":
        return values.astype(np.float32), ()
    texts = [str(value) for value in values.tolist()]
    classes = sorted(set(texts), key=lambda text: (text != "healthy", text))
    number = {text: k for k, text in enumerate(classes)}
    return np.array([number[text] for text in texts], np.int64), tuple(classes)


def _paths(signals: str | Sequence[str] | None, runs: Sequence[StoredRun]) -> tuple[str, ...]:
    """Paths of the signals in a run; those by default as far as all runs have them."""
    names = [signals] if isinstance(signals, str) else list(SIGNALS if signals is None else signals)
    known = [name if "/" in name else _COMMANDS.get(name, f"signals/{name}") for name in names]
    paths = tuple(path for path in known if all(path in run for run in runs))
    lacking = [] if signals is None else [path for path in known if path not in paths]
    if lacking or not paths:
        wanted = ", ".join(lacking) or "sampled signals"
        raise InputError(
            f"signals: some runs hold no {wanted}; generate the dataset with --signals all, or "
            "give others"
        )
    return paths


def _shapes(runs: Sequence[StoredRun], paths: Sequence[str]) -> tuple[dict[str, int], int]:
    """Number of samples of a cycle by id of the run, and the number of axes of all."""
    lengths, axes = {}, set()
    for run in runs:
        with run.open() as group:
            for path in paths:
                shape = group[path].shape
                if len(shape) not in (2, 3) or (len(shape) == 2 and path.startswith("cycle/")):
                    raise InputError(f"signals: '{path}' has no samples")
                lengths[run.id] = shape[-2]
                axes.add(shape[-1])
    if len(axes) > 1:
        counts = " and ".join(map(str, sorted(axes)))
        raise InputError(
            f"signals: the robots have {counts} axes; choose the runs of one kind of robot, such "
            "as dataset[:3]"
        )
    return lengths, axes.pop()

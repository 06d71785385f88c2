"""The logged cycles of a dataset, one after another, for modules that write them elsewhere.

    source = Source.of([Path("out")])
    for cycle in source.cycles():
        cycle.torque.shape, cycle.labels["effect"]

Runs are read cycle by cycle, so that a dataset of any size fits into memory.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from faultgen.dataset.labels import cycle_labels
from faultgen.dataset.manifest import check_exists
from faultgen.dataset.reader import open_dataset
from faultgen.dataset.splits import TRAIN, RunParts, robot_instance
from faultgen.dataset.stored_run import StoredRun
from faultgen.errors import InputError
from faultgen.export.gearing import Gearing
from faultgen.system.progress import follow
from faultgen.system.terminal import note

if TYPE_CHECKING:
    import pandas as pd

SIGNALS = {"position": "rad", "velocity": "rad/s", "torque": "N m"}
"""SI unit of the signals of a motor, by name."""

REFERENCE = "reference_position"

_PATHS = {name: f"signals/motor_{name}" for name in SIGNALS} | {REFERENCE: f"command/{REFERENCE}"}

LABELS = {
    "effect": ("", "effect that is worn, or 'healthy' while nothing is worn"),
    "axis": ("1", "first worn axis, from 1; 0 while nothing is worn"),
    "severity": ("as in severity_units", "true severity of the fault"),
    "severity_units": ("", "unit of the severity; 1: fraction of the nominal value"),
    "healthy": ("1", "whether nothing is worn"),
    "remaining_life": ("1", "cycles until the run fails; nan if it does not fail"),
    "remaining_cycles": ("1", "recorded cycles of the run after this one"),
    "temperature": ("degC", "gearbox temperature that the sensor shows"),
}
"""Unit and meaning of the labels of a cycle. Texts have no unit."""


@dataclass(frozen=True, eq=False)
class Cycle:
    """One cycle of one run: what was logged, and what is true of it."""

    run: str
    """Id of the run."""
    number: int
    """Number of the cycle in its run, from 1."""
    place: int
    """Number of the cycle among all cycles of the source, from 0."""
    robot: str
    """Name of the robot."""
    robot_instance: str
    """Name of the robot with the beginning of the hash of its model, which tells instances of one
    model apart that differ in their parameters."""
    task: str
    """Name of the task."""
    part: str
    """Part of the division to which the run belongs."""
    labels: Mapping[str, Any]
    """Values of `LABELS`."""
    sample_period: float
    """Time between the stored samples [s]."""
    signals: Mapping[str, np.ndarray]
    """Logged signals by name, shape (samples, n_axes): those of `SIGNALS` on the motor side, and
    the commanded joint positions ``reference_position`` [rad]."""
    gearing: Gearing
    """Gearing of the robot."""

    @property
    def n_samples(self) -> int:
        """Number of samples."""
        return len(next(iter(self.signals.values())))

    @property
    def condition(self) -> str:
        """The label as a text, such as "friction wear on axis 2, severity 0.05 of nominal"."""
        labels = self.labels
        if labels["healthy"]:
            return "healthy"
        unit = "of nominal" if labels["severity_units"] == "1" else labels["severity_units"]
        where = f"{labels['effect'].replace('_', ' ')} on axis {labels['axis']}"
        return f"{where}, severity {labels['severity']:.2g} {unit}"

    def on_side(self, side: str) -> dict[str, np.ndarray]:
        """Return all signals on one side of the gearboxes.

        Args:
            side: "motor" or "joint". The conversion takes the gearboxes for rigid.

        Returns:
            The signals by name, shape (samples, n_axes), [rad], [rad/s] and [N m].
        """
        found = dict(self.signals)
        if side == "motor":
            if REFERENCE in found:
                found[REFERENCE] = self.gearing.motor_positions(found[REFERENCE])
            return found
        for name in ("position", "velocity"):
            if name in found:
                found[name] = self.gearing.joint_positions(found[name])
        if "torque" in found:
            found["torque"] = self.gearing.joint_torques(found["torque"])
        return found


@dataclass(frozen=True)
class Source:
    """The runs that are to be exported."""

    name: str
    """Where they come from, for messages."""
    runs: Sequence[StoredRun]
    """The runs."""
    splits: RunParts
    """Ids of the runs of each part, by division; empty if single run files were given."""

    @classmethod
    def of(cls, sources: Sequence[Path]) -> Source:
        """Open a dataset, or some of its run files.

        Args:
            sources: The folder or the ``dataset.h5`` of one dataset, or any number of run files.

        Returns:
            The runs.

        Raises:
            InputError: There is nothing, or no run.
        """
        for path in sources:
            if not path.exists() and StoredRun.at(path).own_file:
                check_exists(path)
        if len(sources) == 1 and not _is_run(sources[0]):
            dataset = open_dataset(sources[0])
            if dataset.missing:
                lacking = f"{len(dataset.missing)} of {len(dataset.planned)}"
                note(f"{sources[0]}: {lacking} runs are missing; the others are exported")
            runs, splits = dataset.runs, dataset.manifest.splits
        else:
            runs, splits = [StoredRun.at(path) for path in sources], {}
            for run in runs:
                if "schema_version" not in run.attributes:
                    raise InputError(
                        f"{run.path}: is not a run; give one dataset, or any number of its "
                        "files runs/ID.h5"
                    )
        found = cls(", ".join(map(str, sources)), runs, splits)
        if not found.runs:
            raise InputError(f"{found.name}: no runs in it; finish it with faultgen generate")
        return found

    @cached_property
    def frame(self) -> pd.DataFrame:
        """A table with one row for each cycle, as from `Dataset.to_dataframe`, without features."""
        from faultgen.dataset.tables import cycles_table

        return cycles_table(self.runs, self.splits, [], where=self.name)

    @property
    def features(self) -> pd.DataFrame:
        """The table of `Dataset.to_dataframe`, with features."""
        from faultgen.dataset.tables import cycles_table

        return cycles_table(self.runs, self.splits, None, where=self.name)

    @cached_property
    def labels(self) -> dict[str, list[Any]]:
        """Values of `LABELS` for each cycle."""
        frame = self.frame
        found = {name: frame[name].tolist() for name in LABELS if name in frame}
        for name in ("effect", "axis", "remaining_life", "remaining_cycles"):
            found[name] = cycle_labels(frame, name).tolist()
        found["healthy"] = (~cycle_labels(frame, "worn")).tolist()
        return {name: found[name] for name in LABELS}

    @cached_property
    def has_signals(self) -> bool:
        """Whether the runs have a sampled signal in common."""
        return bool(set(self._common) & SIGNALS.keys())

    @cached_property
    def _common(self) -> list[str]:
        """Names of the signals that all runs have."""
        here = [[name for name, path in _PATHS.items() if path in run] for run in self.runs]
        common = [name for name in _PATHS if all(name in names for names in here)]
        others = sorted({name for names in here for name in names} - set(common))
        if others:
            note(f"{self.name}: some runs lack {', '.join(others)}, which is left out")
        return common

    @property
    def signals(self) -> list[str]:
        """Names of the signals that all runs have.

        Raises:
            InputError: There is none.
        """
        if not self.has_signals:
            raise InputError(
                f"{self.name}: its runs have no sampled signal in common; generate the dataset "
                "with --signals all, or export the features of its cycles with --format parquet"
            )
        return self._common

    def all(self, what: str) -> list[Any]:
        """Return the different values that an attribute has in the runs.

        Args:
            what: "robot", "n_axes", "n_samples" or "sample_period" (of the stored samples, [s]).

        Returns:
            Its values, in the order of the runs.
        """
        signal = next(name for name in self.signals if name in SIGNALS)
        return list(dict.fromkeys(_value(run, what, signal) for run in self.runs))

    def only(self, what: str, advice: str) -> Any:
        """Return an attribute that all runs must have in common.

        Args:
            what: As in `all`.
            advice: What to do if they differ, for the message.

        Returns:
            Its value.

        Raises:
            InputError: It differs.
        """
        values = self.all(what)
        if len(values) > 1:
            raise InputError(
                f"{self.name}: runs have different {what} ({', '.join(map(str, values))}); {advice}"
            )
        return values[0]

    def check_division(self, by: str) -> None:
        """Refuse a division that the dataset does not have. Run files have none, and need none."""
        if self.splits and by not in self.splits:
            raise InputError(f"{self.name}: has no division by {by}, only {', '.join(self.splits)}")

    def cycles(self, by: str = "run") -> Iterator[Cycle]:
        """Read all cycles, run by run, and show the progress.

        Args:
            by: Division whose parts the cycles name. Without divisions, all belong to "train".

        Yields:
            The cycles.

        Raises:
            InputError: A file is damaged.
        """
        return follow(self._cycles(by), "exporting", len(self.frame), "cycle")

    def _cycles(self, by: str) -> Iterator[Cycle]:
        part_of = {i: part for part, ids in self.splits.get(by, {}).items() for i in ids}
        place = 0
        for run in self.runs:
            told = run.attributes
            with run.open() as group:
                gearing = Gearing.of(group["model"][()].decode())
                stored = {name: group[_PATHS[name]] for name in self.signals}
                reference = stored.pop(REFERENCE, None)
                command = {} if reference is None else {REFERENCE: reference[()]}
                for number in range(int(told["cycles"])):
                    yield Cycle(
                        run=run.id,
                        number=number + 1,
                        place=place,
                        robot=told["robot"],
                        robot_instance=robot_instance(told),
                        task=told["task"],
                        part=part_of.get(run.id, TRAIN),
                        labels={name: values[place] for name, values in self.labels.items()},
                        sample_period=_value(run, "sample_period", ""),
                        signals={name: array[number] for name, array in stored.items()} | command,
                        gearing=gearing,
                    )
                    place += 1


def _is_run(path: Path) -> bool:
    """Whether a path is that of a single run, and not of a dataset."""
    if path.is_dir():
        return False
    run = StoredRun.at(path)
    return not run.own_file or "schema_version" in run.attributes


def _value(run: StoredRun, what: str, signal: str) -> Any:
    if what == "sample_period":
        return float(run["sample_period"]) * int(run["thin"])
    if what in ("n_axes", "n_samples"):
        with run.open() as group:
            shape = group[_PATHS[signal]].shape
        return shape[-1] if what == "n_axes" else shape[-2]
    return run[what]

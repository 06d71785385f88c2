"""Functions that load the small datasets of the package."""

from __future__ import annotations

from pathlib import Path

from faultgen.datasets.bunch import FOLDER, SmallDataset, description


def load_wear() -> SmallDataset:
    """Load runs of a robot in which the friction of one axis grows, to tell which axis wears.

    The target is the worn axis, from 1; 0 while nothing is worn. There are 120 cycles of 12 runs:
    axes 1 to 3 and the healthy robot, three times each. Friction grows by 20 % within 10 cycles.

    Returns:
        The dataset.

    Raises:
        InputError: A file of the package is damaged.
    """
    return _dataset("wear", "axis")


def load_faults() -> SmallDataset:
    """Load runs of a robot with five kinds of faults on one axis, to tell which fault it is.

    The target is the name of the effect; "healthy" while nothing is worn. There are 108 cycles of
    18 runs: five effects and the healthy robot, three times each.

    Returns:
        The dataset.

    Raises:
        InputError: A file of the package is damaged.
    """
    return _dataset("faults", "effect")


def load_run_to_failure() -> SmallDataset:
    """Load runs in which the friction of one axis doubles, to estimate the remaining life.

    The target is the number of cycles until the last one, in which the robot fails. There are 360
    cycles of 9 runs: axes 1 to 3, three times each. No healthy robot is among them.

    Returns:
        The dataset.

    Raises:
        InputError: A file of the package is damaged.
    """
    return _dataset("run_to_failure", "remaining_life")


def load_fleet() -> SmallDataset:
    """Load a fleet of eight robots in production, four of which fail at the end of the record.

    The target is whether the robot fails. There is one row for each day and robot.

    Returns:
        The dataset. Its path is for `faultgen.open_fleet`.

    Raises:
        InputError: A file of the package is damaged.
    """
    from faultgen.fleet.data import open_fleet

    path = FOLDER / "fleet"
    fleet = open_fleet(path)
    frame = fleet.to_dataframe()
    x, y, groups = fleet.to_xy(label="failed")
    text, version = description("fleet")
    return SmallDataset(
        data=x.to_numpy(float),
        target=y,
        feature_names=list(x.columns),
        target_name="failed",
        groups=groups,
        split=frame["split"].to_numpy(),
        frame=frame,
        DESCR=text,
        path=path,
        version=version,
    )


def _dataset(name: str, label: str) -> SmallDataset:
    """Load a dataset of runs."""
    from faultgen.dataset.labels import features_and_labels
    from faultgen.dataset.reader import open_dataset

    path: Path = FOLDER / name
    frame = open_dataset(path).to_dataframe()
    x, y, groups = features_and_labels(frame, None, label)
    text, version = description(name)
    return SmallDataset(
        data=x.to_numpy(float),
        target=y,
        feature_names=list(x.columns),
        target_name=label,
        groups=groups,
        split=frame["split_run"].to_numpy(),
        frame=frame,
        DESCR=text,
        path=path,
        version=version,
    )

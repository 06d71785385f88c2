"""What the functions of `faultgen.datasets` return."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import pandas as pd

LICENCE = "CC BY 4.0"
"""Licence of all datasets that are part of the package."""

FOLDER = Path(__file__).parent / "data"


@dataclass(frozen=True, eq=False)
class SmallDataset:
    """A small dataset that is part of the package, as arrays for scikit-learn.

    The rows of `data`, `target`, `groups`, `split` and `frame` belong together.
    """

    data: np.ndarray
    """Features, shape (samples, features); their units are in ``frame.attrs["units"]``."""
    target: np.ndarray
    """What is to be predicted, shape (samples,)."""
    feature_names: list[str]
    """Names of the columns of `data`."""
    target_name: str
    """What the target is."""
    groups: np.ndarray
    """Run or robot of each row, which cross-validation must not divide, shape (samples,)."""
    split: np.ndarray
    """Fixed part of each row, "train", "validation" or "test", shape (samples,)."""
    frame: pd.DataFrame
    """Everything that the dataset holds of each row: labels and features."""
    DESCR: str
    """Description of the dataset, with its licence and version."""
    path: Path
    """Folder of the dataset, for `faultgen.open_dataset` or, for a fleet, `faultgen.open_fleet`."""
    version: str
    """Version of the data."""
    licence: str = LICENCE
    """Licence of the data."""

    def __repr__(self) -> str:
        """One line; the arrays would fill the screen."""
        rows, columns = self.data.shape
        return f"<{self.path.name}: {rows} rows, {columns} features, target {self.target_name}>"


def description(name: str) -> tuple[str, str]:
    """Read the description of a dataset.

    Args:
        name: Name of its folder.

    Returns:
        The description, and the version that it states.
    """
    text = (FOLDER / name / "README.md").read_text(encoding="utf-8")
    (line,) = (one for one in text.splitlines() if one.startswith("Version: "))
    return text, line.removeprefix("Version: ")

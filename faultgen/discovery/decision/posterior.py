"""What recordings of a healthy robot tell of the numbers of its model.

posterior = posterior_beside("calibrated")
numbers, torque = posterior.given_to(numbers)

Calibration fits a model to recordings. How exactly they fix its numbers, and which of them they do
not tell apart, helps to judge another recording: a payload is then not taken for heavier links.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from faultgen.discovery.decision.numbers import KINDS, Numbers
from faultgen.errors import InputError
from faultgen.system.sums import check_listed

FILE = "calibration.json"
"""Name of the file that holds it, beside the model of a robot folder."""
KEY = "posterior"
"""Its entry there."""


@dataclass(frozen=True, eq=False)
class Posterior:
    """Means and covariance of numbers that every model has."""

    which: tuple[tuple, ...]
    """Name, axis and parameters of each number."""
    mean: np.ndarray
    """Of each, relative to the calibrated model, shape (numbers,)."""
    covariance: np.ndarray
    """Shape (numbers, numbers)."""

    def contract(self) -> dict[str, Any]:
        """Return it ready for JSON; of the covariance, rows up to the diagonal."""
        return {
            "numbers": [[name, axis, dict(parameters)] for name, axis, parameters in self.which],
            "mean": [float(f"{x:.6g}") for x in self.mean],
            "covariance": [
                [float(f"{x:.6g}") for x in row[: k + 1]] for k, row in enumerate(self.covariance)
            ],
        }

    def given_to(self, numbers: Numbers) -> tuple[Numbers, np.ndarray]:
        """State numbers as these recordings leave them.

        Their prior covariance is that of the posterior and that of days. A factor of it makes
        columns of independent numbers, each of the group of the number that it adds.

        Args:
            numbers: The numbers of a comparison with the model.

        Returns:
            The numbers, and what their means change in the torque, shape (samples, n_axes).
        """
        places = [k for k, one in enumerate(numbers.which) if one in self.which]
        if not places:
            return numbers, np.zeros(())
        mine = [self.which.index(numbers.which[k] or ()) for k in places]
        columns = np.array([numbers.columns[k] for k in places])
        usual = np.array([numbers.std[k] * KINDS[numbers.kinds[k]].days for k in places])
        scaled = self.covariance[np.ix_(mine, mine)] / np.outer(usual, usual)
        factor = np.linalg.cholesky(scaled + np.eye(len(mine)))
        size = np.linalg.norm(factor, axis=1)
        mixed = np.tensordot((factor * usual[:, None] / (usual * size)).T, columns, axes=1)
        out = replace(numbers, columns=list(numbers.columns), std=list(numbers.std))
        for k, place in enumerate(places):
            out.columns[place] = mixed[k].astype(np.float32)
            out.std[place] = float(usual[k] * size[k])
        return out, np.tensordot(self.mean[mine], columns, axes=1)


def posterior_beside(robot: str | Path) -> Posterior | None:
    """Read what was found in the calibration of a robot.

    Args:
        robot: Name of a robot, or path of its MJCF file or folder.

    Returns:
        It; None if the robot was not calibrated.

    Raises:
        InputError: The file is damaged.
    """
    path = Path(robot)
    path = (path if path.is_dir() else path.parent) / FILE
    if not Path(robot).exists() or not path.is_file():
        return None
    content = path.read_bytes()
    check_listed(path, content)
    try:
        told = json.loads(content).get(KEY)
        if told is None:
            return None
        which = tuple(
            (str(name), int(axis), tuple(parameters.items()))
            for name, axis, parameters in told["numbers"]
        )
        lower = np.zeros((len(which), len(which)))
        for k, row in enumerate(told["covariance"]):
            lower[k, : k + 1] = row
        mean = np.array(told["mean"], float)
        if mean.shape != (len(which),):
            raise ValueError("another number of means")
    except (AttributeError, KeyError, TypeError, ValueError):
        raise InputError(
            f"{path}: its entry '{KEY}' is damaged; run calibrate again, or remove the file"
        ) from None
    return Posterior(which, mean, lower + np.tril(lower, -1).T)

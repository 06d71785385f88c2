"""What others would say of a blind case with a twin: sparse and Gaussian-process regression.

python benchmarks/blind_baselines.py sparse DIR
python benchmarks/score_discovery.py --trial DIR --answers sparse

Both see the difference of the two torque recordings and the measured motion, axis by axis, on the
parts that discovery fits to; neither simulates.
"""

from __future__ import annotations

import argparse
import json
import warnings
from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pysindy
from scoring.answering import version
from scoring.trials import entries
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, WhiteKernel

from faultgen.discovery.replay.replay import settled
from faultgen.discovery.replay.samples import cut, samples_of
from faultgen.discovery.replay.torque_error import relative_error, relative_errors
from faultgen.discovery.result import NAMED, NONE, UNKNOWN
from faultgen.recordings.read import read_recording
from faultgen.recordings.recording import Recording
from faultgen.robot import STRIBECK_VELOCITY, Robot, load_robot
from faultgen.system.files import write_text

SHARE = 0.5
"""Size that a term needs, over the noise: chosen on development cases, where no healthy robot gets
an effect."""

_ORDERS = (1, 2, 4, 6)
_POINTS = 300  # of an axis that a Gaussian process is fitted to
_CLOSED = 0.1  # share of the squared gap that it has to predict for the gap to be one: assumed


@dataclass(frozen=True, eq=False)
class _Case:
    """A gap to a twin and the motion. Arrays have shape (samples, n_axes)."""

    recording: Recording
    robot: Robot
    gap: np.ndarray
    fitting: np.ndarray
    """Samples that may be fitted to."""
    scoring: np.ndarray
    """Samples of the motions that are left for scoring."""
    motion: np.ndarray
    """Position, velocity, acceleration, motor side, shape (3, samples, n_axes)."""
    rng: np.random.Generator


Predict = Callable[[_Case, int, Collection[str]], tuple[np.ndarray, list[tuple[float, str]]]]
"""Of a case, an axis from 0 and names to leave out: the predicted gap, and sizes and names."""


def _tried(
    predict: Predict,
    measured: Path,
    robot: str,
    healthy: Path,
    exclude: Collection[str] = (),
    cache: Path | None = None,
) -> dict[str, Any]:
    """What a regression says of a case, in the form of `faultgen.discover`.

    Args:
        predict: The regression, axis by axis.
        measured: The recording.
        robot: Name of the robot.
        healthy: The twin.
        exclude: Effects that are not considered.
        cache: Not used.
    """
    case = _read(measured, healthy, load_robot(robot))
    found, after = [], case.gap.copy()
    for axis in range(case.robot.n_axes):
        predicted, sizes = predict(case, axis, exclude)
        after[:, axis] -= predicted
        found += [(size, name, axis + 1) for size, name in sizes]
    names = list(dict.fromkeys((name, axis) for _, name, axis in sorted(found, reverse=True)))[:3]
    before = relative_errors(case.gap**2, case.recording, case.scoring)
    left = relative_errors(after**2, case.recording, case.scoring)
    closed = 1 - (left / np.maximum(before, 1e-12)) ** 2
    return {
        "verdict": NAMED if names else UNKNOWN if closed.max() > _CLOSED else NONE,
        "effects": [{"effect": name, "axis": axis, "parameters": {}} for name, axis in names],
        "alternatives": [],
        "gap": _gap(case, after),
    }


def _read(measured: Path, healthy: Path, robot: Robot) -> _Case:
    recording = read_recording(measured)
    gap = recording.torque - read_recording(healthy).torque
    inside = settled(recording, robot)
    parts, scoring = cut(recording, robot, inside)
    scored = samples_of([parts[p] for p in scoring], len(gap))[:, None]
    motion = recording.derivatives(recording.motor_position(robot))
    return _Case(
        recording, robot, gap, inside & ~scored, inside & scored, motion, np.random.default_rng(0)
    )


def _sparse(
    case: _Case, axis: int, exclude: Collection[str]
) -> tuple[np.ndarray, list[tuple[float, str]]]:
    """PySINDy's sequentially thresholded least squares over the shapes of the effects."""
    shapes = [(name, x) for name, x in _shapes(case, axis) if name not in exclude]
    rows = case.fitting[:, axis]
    columns = np.stack([x for _, x in shapes], axis=1)
    columns /= np.maximum(columns[rows].std(axis=0), 1e-12)
    noise = float(np.std(np.diff(case.gap[rows, axis]))) / np.sqrt(2)
    regression = pysindy.STLSQ(threshold=SHARE, alpha=1e-3)
    regression.fit(columns[rows], case.gap[rows, axis] / noise)
    sizes = regression.coef_[0]
    named = [
        (abs(float(size)), name) for (name, _), size in zip(shapes, sizes, strict=True) if size
    ]
    return noise * columns @ sizes, named


def _gaussian_process(
    case: _Case, axis: int, exclude: Collection[str]
) -> tuple[np.ndarray, list[tuple[float, str]]]:
    """A Gaussian process of position, velocity and acceleration; it cannot name anything."""
    rows = np.flatnonzero(case.fitting[:, axis])
    features = (case.motion[:, :, axis] / case.motion[:, rows, axis].std(axis=1)[:, None]).T
    some = case.rng.choice(rows, min(_POINTS, len(rows)), replace=False)
    size = case.gap[rows, axis].std()
    kernel = RBF(np.ones(3), (0.05, 20)) + WhiteKernel(0.5, (1e-3, 2))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # a scale at its bound does no harm
        process = GaussianProcessRegressor(kernel).fit(features[some], case.gap[some, axis] / size)
    return size * process.predict(features), []


METHODS = {
    "sparse": partial(_tried, _sparse),
    "gaussian_process": partial(_tried, _gaussian_process),
}
"""Regressions by name."""


def _shapes(case: _Case, axis: int) -> list[tuple[str, np.ndarray]]:
    """Names of effects, and their torque along the motion up to a factor."""
    angle, speed, push = case.motion[:, :, axis]
    friction = case.robot.ids("actuator", "friction")[axis]
    slow = case.robot.model.actuator_biasprm[friction, STRIBECK_VELOCITY]
    sign = np.tanh(speed / (0.1 * slow))
    torque = case.recording.torque[:, axis]
    shapes = [
        ("coulomb_friction", sign),
        ("viscous_friction", speed),
        ("quadratic_viscous_friction", speed * np.abs(speed)),
        ("static_friction", sign * np.exp(-((speed / slow) ** 2))),
        ("friction_asymmetry", np.maximum(sign, 0)),
        ("load_friction", np.abs(torque) * sign),
        ("torque_offset", np.ones_like(speed)),
        ("torque_constant", torque),
        ("rotor_inertia", push),
        ("gravity_spring", angle),
        ("delay", np.gradient(torque)),
    ]
    if case.recording.temperature is not None:
        warm = case.recording.temperature - case.recording.temperature.mean()
        shapes.append(("temperature_friction", warm * sign))
    for order in _ORDERS:
        shapes += [("torque_ripple", wave(order * angle)) for wave in (np.sin, np.cos)]
    return shapes


def _gap(case: _Case, after: np.ndarray) -> dict[str, float]:
    noise = np.std(np.diff(case.gap, axis=0), axis=0) / np.sqrt(2)
    squares = {
        "before": case.gap**2,
        "after": after**2,
        "floor": np.broadcast_to(noise**2, after.shape),
    }
    return {k: relative_error(x, case.recording, case.scoring) for k, x in squares.items()}


def main() -> None:
    """Answer the cases of a trial that have a twin."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("method", choices=METHODS)
    parser.add_argument("trial", type=Path)
    told = parser.parse_args()
    answers = told.trial / told.method
    answers.mkdir(exist_ok=True)
    write_text(answers / "version.txt", version() + "\n")
    for entry in entries(told.trial):
        measured, _, robot, *rest = entry["discover"]
        if rest:
            files = [told.trial / name for name in (measured, rest[1])]
            result = METHODS[told.method](files[0], robot, files[1])
            write_text(answers / f"{entry['name']}.json", json.dumps(result, default=float) + "\n")


if __name__ == "__main__":
    main()

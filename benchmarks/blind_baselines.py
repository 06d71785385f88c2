"""What others would say of a blind case with a twin: sparse and Gaussian-process regression.

python benchmarks/blind_discovery.py run DIR --function blind_baselines:sparse --results sparse
python benchmarks/blind_discovery.py score DIR --results sparse

Both see the difference of the two torque recordings and the measured motion, axis by axis, on the
parts that discovery fits to; neither simulates.
"""

from __future__ import annotations

import warnings
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
import pysindy
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, WhiteKernel

from faultgen.discovery.problem import blocks
from faultgen.discovery.recording import Recording, read_recording
from faultgen.discovery.replay import relative_error, relative_errors, settled
from faultgen.robot import STRIBECK_VELOCITY, Robot, load_robot

SHARE = 0.5
"""Size that a term needs, over the noise: chosen on development cases, where no healthy robot gets
an effect."""

_ORDERS = (1, 2, 4, 6)
_POINTS = 300  # of an axis that a Gaussian process is fitted to
_CLOSED = 0.1  # share of the squared gap that it has to predict for the gap to be one: assumed


def sparse(
    measured: Path,
    robot: str,
    healthy: Path,
    exclude: Collection[str] = (),
    cache: Path | None = None,
) -> dict[str, Any]:
    """PySINDy's sequentially thresholded least squares over the shapes of the effects.

    Args:
        measured: The recording.
        robot: Name of the robot.
        healthy: The twin.
        exclude: Effects that are not considered.
        cache: Not used.
    """
    model = load_robot(robot)
    recording, gap, inside, fitting = _difference(measured, healthy, model)
    found, after = [], gap.copy()
    for axis in range(model.n_axes):
        shapes = {k: v for k, v in _shapes(recording, model, axis).items() if k[0] not in exclude}
        rows = inside[:, axis] & fitting
        columns = np.stack(list(shapes.values()), axis=1)
        scale = np.maximum(columns[rows].std(axis=0), 1e-12)
        noise = float(np.std(np.diff(gap[rows, axis]))) / np.sqrt(2)
        regression = pysindy.STLSQ(threshold=SHARE, alpha=1e-3)
        regression.fit((columns / scale)[rows], gap[rows, axis] / noise)
        size = np.abs(regression.coef_[0])
        after[:, axis] -= noise * (columns / scale) @ regression.coef_[0]
        found += [(float(size[k]), key[0], axis + 1) for k, key in enumerate(shapes) if size[k]]
    names = list(dict.fromkeys((name, axis) for _, name, axis in sorted(found, reverse=True)))[:3]
    return {
        "verdict": "named" if names else "no missing effect",
        "effects": [{"effect": name, "axis": axis, "parameters": {}} for name, axis in names],
        "alternatives": [],
        "gap": _gap(recording, gap, after, inside & ~fitting[:, None]),
    }


def gaussian_process(
    measured: Path,
    robot: str,
    healthy: Path,
    exclude: Collection[str] = (),
    cache: Path | None = None,
) -> dict[str, Any]:
    """A Gaussian process of position, velocity and acceleration; it cannot name anything.

    Args:
        measured: The recording.
        robot: Name of the robot.
        healthy: The twin.
        exclude: Not used.
        cache: Not used.
    """
    model = load_robot(robot)
    recording, gap, inside, fitting = _difference(measured, healthy, model)
    motion = recording.derivatives(recording.motor_position(model.gear_ratio))
    rng = np.random.default_rng(0)
    after = gap.copy()
    for axis in range(model.n_axes):
        rows = np.flatnonzero(inside[:, axis] & fitting)
        features = (motion[:, :, axis] / motion[:, rows, axis].std(axis=1)[:, None]).T
        some = rng.choice(rows, min(_POINTS, len(rows)), replace=False)
        size = gap[rows, axis].std()
        kernel = RBF(np.ones(3), (0.05, 20)) + WhiteKernel(0.5, (1e-3, 2))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)  # a scale at its bound does no harm
            process = GaussianProcessRegressor(kernel).fit(features[some], gap[some, axis] / size)
        after[:, axis] -= size * process.predict(features)
    told = inside & ~fitting[:, None]
    before = relative_errors(gap**2, recording, told)
    closed = 1 - (relative_errors(after**2, recording, told) / np.maximum(before, 1e-12)) ** 2
    return {
        "verdict": "unknown effect" if closed.max() > _CLOSED else "no missing effect",
        "effects": [],
        "alternatives": [],
        "gap": _gap(recording, gap, after, told),
    }


def _difference(
    measured: Path, healthy: Path, robot: Robot
) -> tuple[Recording, np.ndarray, np.ndarray, np.ndarray]:
    """Recording, gap to its twin, samples that count, and whether they are for fitting."""
    recording = read_recording(measured)
    gap = recording.torque - read_recording(healthy).torque
    parts = blocks(recording)
    fitting = np.zeros(len(gap), bool)
    for part in parts[: len(parts) - max(1, len(parts) // 5)]:
        fitting[part] = True
    return recording, gap, settled(recording, robot), fitting


def _shapes(recording: Recording, robot: Robot, axis: int) -> dict[tuple[str, int], np.ndarray]:
    """Torque of effects along the motion, up to a factor, by name and number."""
    motion = recording.derivatives(recording.motor_position(robot.gear_ratio))
    angle, speed, push = motion[:, :, axis]
    slow = robot.model.actuator_biasprm[robot.ids("actuator", "friction")[axis], STRIBECK_VELOCITY]
    sign = np.tanh(speed / (0.1 * slow))
    torque = recording.torque[:, axis]
    shapes = {
        ("coulomb_friction", 0): sign,
        ("viscous_friction", 0): speed,
        ("quadratic_viscous_friction", 0): speed * np.abs(speed),
        ("static_friction", 0): sign * np.exp(-((speed / slow) ** 2)),
        ("friction_asymmetry", 0): np.maximum(sign, 0),
        ("load_friction", 0): np.abs(torque) * sign,
        ("torque_offset", 0): np.ones_like(speed),
        ("torque_constant", 0): torque,
        ("rotor_inertia", 0): push,
        ("gravity_spring", 0): angle,
        ("delay", 0): np.gradient(torque),
    }
    if recording.temperature is not None:
        warm = recording.temperature - recording.temperature.mean()
        shapes["temperature_friction", 0] = warm * sign
    for order in _ORDERS:
        shapes["torque_ripple", 2 * order] = np.sin(order * angle)
        shapes["torque_ripple", 2 * order + 1] = np.cos(order * angle)
    return shapes


def _gap(
    recording: Recording, before: np.ndarray, after: np.ndarray, told: np.ndarray
) -> dict[str, float]:
    noise = np.std(np.diff(before, axis=0), axis=0) / np.sqrt(2)
    return {
        "before": relative_error(before**2, recording, told),
        "after": relative_error(after**2, recording, told),
        "floor": relative_error(np.broadcast_to(noise**2, before.shape), recording, told),
    }

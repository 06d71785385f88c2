"""The measurement noise of the runs of a dataset: as stored, or drawn anew.

A dataset that was generated without noise is judged with noise that is drawn when its runs are
read. Each seed gives other noise, so that one run stands for many recordings.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from faultgen.dataset.inputs import existing_input
from faultgen.dataset.reader import Dataset
from faultgen.dataset.stored_run import StoredRun
from faultgen.errors import InputError
from faultgen.monitoring.reductions import SPEED_WINDOW, mean_abs_torque
from faultgen.monitoring.sensors import Measured, Sensors, get_sensors, measure


def noise_of(dataset: Dataset, sensors: str | None) -> tuple[str, bool]:
    """Determine which noise is used, and whether it is drawn anew.

    Args:
        dataset: The dataset.
        sensors: Preset of the noise. None: 'thesis' for a dataset without noise, otherwise the
            noise of the dataset.

    Returns:
        Name of the noise, and whether it is drawn anew.

    Raises:
        InputError: The dataset has no runs, or another motion would be needed.
    """
    if not dataset.runs:
        raise InputError(f"{dataset.path}: no runs in it; finish it with faultgen generate")
    stored = sensors_of(dataset, dataset.runs)
    redraw = sensors is not None or set(stored) == {"none"}
    chosen = "thesis" if set(stored) == {"none"} else "/".join(sorted(stored))
    if sensors is not None:
        chosen = sensors
    moving = [name for name, one in stored.items() if one.changes_motion]
    if sensors is not None and moving:
        raise InputError(
            f"sensors '{sensors}': the dataset's '{moving[0]}' runs differ in their motion, which "
            "new noise does not undo; leave --sensors out"
        )
    if redraw and get_sensors(chosen).changes_motion:
        raise InputError(
            f"sensors '{chosen}' change the motion: generate a dataset with them instead, "
            "with several repetitions"
        )
    return chosen, redraw


def sensors_of(dataset: Dataset, runs: Iterable[StoredRun]) -> dict[str, Sensors]:
    """Read the sensors with which runs were made.

    Args:
        dataset: The dataset.
        runs: Some of its runs.

    Returns:
        The sensors by name or path.

    Raises:
        InputError: A file of sensors is gone or has changed.
    """
    found = {}
    for name, run in {run["sensors"]: run for run in reversed(list(runs))}.items():
        path = existing_input(dataset.input_of(run, "sensors"), "sensors")
        found[name] = get_sensors(path)
        if dataset.planned[run.id].get("sensors_sha256", "") not in ("", found[name].sha256):
            raise InputError(f"{path}: the sensors have changed since the dataset was made")
    return found


def measured_cycles(
    run: StoredRun, sensors: Sensors, number: int, *, position: bool = False
) -> list[Measured]:
    """Measure every cycle of a run with new noise.

    Args:
        run: The run. It needs signals without noise.
        sensors: The noise.
        number: Seed. Each run has random numbers of its own for each seed.
        position: Whether the position is needed; else it is 0.

    Returns:
        The measured signals of each cycle.

    Raises:
        InputError: The file lacks the signals that new noise needs.
    """
    clean = "signals" if run["sensors"] == "none" else "truth"
    names = [f"{clean}/motor_velocity", f"{clean}/motor_torque"]
    names += [f"{clean}/motor_position"] if position else []
    if run["thin"] != 1 or any(name not in run for name in names):
        raise InputError(
            f"{run.path}: new noise needs {' and '.join(names)}, not thinned; generate with "
            f"signals = {names}".replace("'", '"')
        )
    velocity, torque, *more = (run.read(name).astype(float) for name in names)
    angle = more[0] if more else np.zeros_like(velocity)
    # a stream of its own for each run and seed, so that answers are independent
    rng = np.random.default_rng([number, int(run.id, 16)])
    return [
        measure(
            sensors,
            angle[k],
            velocity[k],
            torque[k],
            gear_ratio=run["gear_ratio"],
            encoder_counts=run["encoder_counts"],
            mean_torque=run["nominal_mean_torque"],
            sample_period=run["sample_period"],
            rng=rng,
        )
        for k in range(len(torque))
    ]


def one_series(run: StoredRun) -> np.ndarray:
    """Return the mean |torque| of each cycle, with a draw of the thesis' noise if it has none.

    Returns:
        Shape (cycles, n_axes), in [N m].
    """
    if run["sensors"] != "none":
        return run.read("monitoring/mean_abs_torque")
    measured = measured_cycles(run, get_sensors("thesis"), 1000)
    window = speed_window_of(run)
    return np.array([mean_abs_torque(m.motor_velocity, m.motor_torque, window) for m in measured])


def speed_window_of(run: StoredRun) -> ArrayLike:
    """Return the speed window in which the run's own mean torque was computed.

    Returns:
        Lowest and highest |motor speed|, shape (2,) or (n_axes, 2), in [rad/s].
    """
    return run.attributes.get("speed_window", SPEED_WINDOW)

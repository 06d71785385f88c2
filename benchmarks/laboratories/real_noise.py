"""Noise of real machines: what a smooth curve leaves of their measured torques.

series = draw_series(n_axes=6, sample_period=0.004, rng=rng)     # unit variance each
share, memory = colour(series[0])

The recordings are in the folder shared beside the project; where they are absent, so is this kind.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import butter, sosfiltfilt

DATA = Path(__file__).parents[3] / "shared" / "data" / "measured"
MACHINES = ("tx40", "gen3", "emps", "ur10e")
_CUT_OFF = 12.0
"""Below this frequency [Hz] a torque counts as signal: assumed, as the motions have up to 5 Hz and
servos up to 12 Hz. What is left also has ripple and reversals of friction, as in reality."""
_ENDS = 0.3  # [s] at both ends, where the filter does not know the torque
_LEAST = 1500  # samples of a series that is worth drawing blocks from


def available() -> bool:
    """Whether the recordings of the real machines are here."""
    return all((DATA / name).is_dir() for name in MACHINES)


def _torques(machine: str) -> list[tuple[float, np.ndarray]]:
    """Sample period and measured torques, shape (samples, axes), of each recording used."""
    folder = DATA / machine
    if machine == "tx40":
        table = np.loadtxt(folder / "curr_data.csv.gz", delimiter=",", skiprows=1)
        # 5 kHz are more than any laboratory has
        return [(1e-3, table[: len(table) // 5 * 5].reshape(-1, 5, 6).mean(axis=1))]
    if machine == "emps":
        table = np.loadtxt(folder / "emps_identification.csv", delimiter=",", skiprows=1)
        return [(1e-3, table[:, 4:5])]
    if machine == "ur10e":
        with np.load(folder / "test_50s_feb12.npz") as raw:
            time, current = np.asarray(raw["t"]), np.asarray(raw["i"])
        period = float(np.median(np.diff(time)))
        even = np.arange(time[0], time[-1], period)
        return [(period, np.stack([np.interp(even, time, x) for x in current.T], axis=1))]
    out = []
    for name in ("opti_traj_testing1", "opti_traj_testing2"):
        path = folder / f"{name}.csv.gz"
        named: Any = np.genfromtxt(path, delimiter=",", names=True)
        out.append((1e-3, np.stack([named[f"TorqueCur{k}"] for k in range(1, 8)], axis=1)))
    return out


@lru_cache
def residuals(machine: str) -> tuple[tuple[float, np.ndarray], ...]:
    """What is left of the torques of a machine above `_CUT_OFF`.

    Args:
        machine: Of `MACHINES`.

    Returns:
        Sample period [s] and residual with unit variance, shape (samples,), for each axis.

    Raises:
        FileNotFoundError: The recordings are not here.
    """
    if not available():
        raise FileNotFoundError(f"real noise needs the recordings in {DATA}")
    found = []
    for period, torque in _torques(machine):
        high = butter(4, 2 * _CUT_OFF * period, "high", output="sos")
        left = sosfiltfilt(high, torque, axis=0)
        cut = round(_ENDS / period)
        for series in left[cut:-cut].T:
            if series.std() > 0:
                found.append((period, (series - series.mean()) / series.std()))
    return tuple(found)


def draw_series(
    n_axes: int, sample_period: float, rng: np.random.Generator
) -> tuple[np.ndarray, ...]:
    """Draw residuals of one machine, one for each axis.

    A series that was sampled faster is thinned by interpolation. One that was sampled more slowly
    is taken sample by sample, so that its colour belongs to samples and not to time (assumed).

    Args:
        n_axes: Number of series.
        sample_period: Of the recording that gets the noise [s].
        rng: Source of randomness.

    Returns:
        Series with unit variance.

    Raises:
        FileNotFoundError: The recordings are not here.
    """
    every = residuals(MACHINES[int(rng.integers(len(MACHINES)))])
    out = []
    for k in rng.permutation(max(n_axes, len(every)))[:n_axes] % len(every):
        period, series = every[k]
        thinner = max(sample_period / period, 1.0)
        # a short series keeps its samples
        thinner = min(thinner, max(len(series) / _LEAST, 1.0))
        at = np.arange(0, len(series) - 1, thinner)
        thin = np.interp(at, np.arange(len(series)), series)
        out.append((thin - thin.mean()) / thin.std())
    return tuple(out)


def colour(series: np.ndarray) -> tuple[float, float]:
    """Share and memory of the autoregressive part with the first two autocorrelations of a series.

    White noise and a first-order process have the autocorrelation share x memory^lag.

    Args:
        series: With unit variance, shape (samples,).

    Returns:
        Share of the variance from 0 to 0.98; correlation from sample to sample from 0 to 0.98.
    """
    one, two = (float(np.mean(series[lag:] * series[:-lag])) for lag in (1, 2))
    if one <= 0.02:
        return 0.0, 0.0
    memory = float(np.clip(two / one, 0.05, 0.98))
    return float(np.clip(one / memory, 0.0, 0.98)), memory

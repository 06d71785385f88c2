"""Missed detections on the Tennessee Eastman process: published, PCA and dynamic PCA.

    pip install 'faultgen[dev]'
    python -m benchmarks.methods.tennessee_eastman

Prints Markdown. Each threshold is the 10th highest value of the healthy test series, so that all
methods have the same share of false alarms on it, 9 of 960. The data come with the package bibmon,
which is not imported.
"""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import numpy as np
from faultgen.analysis import PCAMonitor

from faultgen.evaluation.markdown import table

FAULT_START = 160  # row of 960 in each test series
# Number of components: 11 is that of the published table, 25 and 29 come from parallel analysis,
# `parallel_analysis`. PCA with 29 tells what more components do without lags.
MONITORS = {
    "PCA": PCAMonitor(n_components=11),
    "PCA, 29 components": PCAMonitor(n_components=29),
    "1 lag, 25 components": PCAMonitor(n_components=25, lags=1),
    "2 lags, 29 components": PCAMonitor(n_components=29, lags=2),
}


def read(name: str) -> np.ndarray:
    """A series of 52 variables, shape (samples, 52)."""
    spec = importlib.util.find_spec("bibmon")
    if spec is None or spec.origin is None:
        sys.exit("the data are missing: pip install 'faultgen[dev]'")
    series = np.loadtxt(Path(spec.origin).parent / "tennessee_eastman" / f"{name}.dat")
    return series if series.shape[1] == 52 else series.T  # d00 is stored the other way round


def missed(monitor: PCAMonitor, healthy: np.ndarray, faulty: list[np.ndarray]) -> np.ndarray:
    """Compute the share of rows after the start of each fault that T2 and Q miss.

    Args:
        monitor: A fitted monitor.
        healthy: Healthy rows, shape (rows, variables).
        faulty: Rows of each fault, shape (rows, variables) each.

    Returns:
        Shares, shape (faults, 2), without unit.
    """
    shares = []
    for statistic in (monitor.t2, monitor.q):
        threshold = np.sort(statistic(healthy)[monitor.lags :])[-10]
        shares.append([np.mean(statistic(x)[FAULT_START:] <= threshold) for x in faulty])
    return np.transpose(shares)


def parallel_analysis(x: np.ndarray, lags: int, draws: int = 20) -> int:
    """Count the leading variances above the mean of those of white noise of the same shape.

    Args:
        x: Rows, shape (rows, variables).
        lags: Number of predecessors of each row.
        draws: Number of draws of white noise.

    Returns:
        The number of components.
    """
    rng = np.random.default_rng(0)
    ours = PCAMonitor(lags=lags).fit(x).eigenvalues_
    shape = (len(x) - lags, len(ours))
    noise = [PCAMonitor().fit(rng.normal(size=shape)).eigenvalues_ for _ in range(draws)]
    return int(np.argmin(ours > np.mean(noise, axis=0)))


def main() -> None:
    """Print the tables."""
    train, healthy = read("d00"), read("d00_te")
    faulty = [read(f"d{fault:02d}_te") for fault in range(1, 22)]
    published = np.loadtxt(Path(__file__).parent / "tep_published.csv", delimiter=",")[:, 1:]
    tables = [published] + [missed(m.fit(train), healthy, faulty) for m in MONITORS.values()]
    names = ["published", *MONITORS]
    shares = np.hstack(tables)
    print(
        table(
            ["fault", *(f"{name}: {chart}" for name in names for chart in ("T2", "Q"))],
            [
                [label, *(f"{share:.3f}" for share in row)]
                for label, row in [*enumerate(shares, 1), ("mean", shares.mean(axis=0))]
            ],
        )
    )
    off = np.abs(tables[1] - published)
    print(f"\nPCA off the published table: mean {off.mean(axis=0)}, largest {off.max(axis=0)}")
    print("Parallel analysis:", {lags: parallel_analysis(train, lags) for lags in (0, 1, 2)})


if __name__ == "__main__":
    main()

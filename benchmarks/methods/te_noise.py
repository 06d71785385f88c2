"""What transfer entropy measures on wear: experiments on a noise-free dataset.

    python -m benchmarks.methods.te_noise DATASET [--robot irb6700]

Prints Markdown: the share of runs of which the worn axis is named at 10 % wear, over noise, and
three controls in which nothing can flow from axis to axis, or time is meaningless.
"""

from __future__ import annotations

import argparse

import numpy as np
from faultgen.analysis import net_transfer_entropy, quantile_symbols

from faultgen.dataset.reader import open_dataset
from faultgen.dataset.stored_run import StoredRun
from faultgen.dataset.wear import severities
from faultgen.evaluation.calls import axis_of, isolate
from faultgen.evaluation.isolators import ISOLATORS
from faultgen.evaluation.markdown import table
from faultgen.evaluation.methods import Setting

SEEDS = range(2000, 2040)
NOISE = (0.0, 1e-6, 1e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2)
LEVEL = 0.10
METHODS = [
    name
    for name, method in ISOLATORS.items()
    if not method.learns and method.features == ("mean_abs_torque",)
]
"""Isolators that learn nothing."""


def series(run: StoredRun) -> np.ndarray:
    """Mean |torque| up to the cycle in which wear reaches the level, shape (cycles, n_axes)."""
    severity = run.read("cycle/severity")
    return run.read("monitoring/mean_abs_torque")[: int(np.argmax(severity >= LEVEL)) + 1]


def noisy(x: np.ndarray, share: float, seed: list[int]) -> np.ndarray:
    """Add white noise to a series.

    Args:
        x: Series of all axes. Shape (cycles, n_axes).
        share: Standard deviation of the noise over the mean of each axis.
        seed: Seed of the noise.

    Returns:
        Same shape and unit.
    """
    rng = np.random.default_rng(seed)
    return x + share * x.mean(axis=0) * rng.standard_normal(x.shape)


def shuffled(x: np.ndarray, seed: int) -> np.ndarray:
    """Return the cycles in another order, the same for all axes.

    Args:
        x: Series of all axes. Shape (cycles, n_axes).
        seed: Seed of the order.

    Returns:
        Same shape and unit.
    """
    return x[np.random.default_rng(seed).permutation(len(x))]


def uncoupled(x: np.ndarray, worn: int) -> np.ndarray:
    """Keep the worn axis, and hold the others at their means, so that nothing affects them.

    Args:
        x: Series of all axes. Shape (cycles, n_axes).
        worn: The worn axis, from 0.

    Returns:
        Same shape and unit.
    """
    alone = np.broadcast_to(x.mean(axis=0), x.shape).copy()
    alone[:, worn] = x[:, worn]
    return alone


def entropy_rate(x: np.ndarray, bins: int) -> float:
    """Compute the plug-in entropy of the next symbol given the last one.

    Args:
        x: Series of all axes. Shape (cycles, n_axes).
        bins: Number of bins.

    Returns:
        The entropy [bit].
    """
    s = quantile_symbols(x, bins)
    pairs = np.bincount(s[:-1] * bins + s[1:], minlength=bins * bins).astype(float)
    pairs /= pairs.sum()
    singles = pairs.reshape(bins, bins).sum(axis=1)

    def entropy(p: np.ndarray) -> float:
        return float(-(p[p > 0] * np.log2(p[p > 0])).sum())

    return entropy(pairs) - entropy(singles)


def row(label: str, cases: list[tuple[np.ndarray, int]]) -> list[str]:
    """Return a row of the table: how often each method names the right axis.

    Args:
        label: First cell.
        cases: Each series with its worn axis.

    Returns:
        The cells of the row.
    """
    shares = []
    for name in METHODS:
        named = [
            axis_of(isolate(ISOLATORS[name](Setting(n_axes=x.shape[1])), {"mean_abs_torque": x}))
            for x, _ in cases
        ]
        right = [axis == worn for axis, (_, worn) in zip(named, cases, strict=True)]
        shares.append(100 * np.mean(right))
    return [label, *(f"{share:.0f}" for share in shares)]


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("dataset")
    parser.add_argument("--robot", default="irb6700")
    options = parser.parse_args()
    runs = [
        run
        for run in open_dataset(options.dataset).runs
        if run["robot"] == options.robot and run["axis"] > 0 and run["severity"] >= LEVEL
    ]
    clean = [(series(run), int(run["axis"]) - 1, number) for number, run in enumerate(runs)]
    print(f"{options.robot}, {len(runs)} worn runs, {100 * LEVEL:g} % wear, {len(SEEDS)} draws\n")
    rows = []
    for share in NOISE:
        cases = [
            (noisy(x, share, [seed, number]), worn)
            for x, worn, number in clean
            for seed in (SEEDS if share else SEEDS[:1])
        ]
        rows.append(row(f"{100 * share:g} %", cases))
    print(table(["noise on each cycle's mean", *METHODS], rows))
    draws = [(x, worn, number, seed) for x, worn, number in clean for seed in SEEDS]
    share = 3e-4
    controls = {
        "as simulated": [(noisy(x, share, [s, k]), w) for x, w, k, s in draws],
        "cycles shuffled": [(shuffled(noisy(x, share, [s, k]), s), w) for x, w, k, s in draws],
        "time reversed": [(noisy(x, share, [s, k])[::-1], w) for x, w, k, s in draws],
        "worn axis alone, no coupling": [
            (noisy(uncoupled(x, w), share, [s, k]), w) for x, w, k, s in draws
        ],
    }
    trend = severities("exponential", 0.2, 100)[: len(clean[0][0])]
    made = []
    for seed in SEEDS:
        for worn in range(6):
            x = 1 + 0.01 * np.random.default_rng([seed, worn, 9]).standard_normal((len(trend), 6))
            x[:, worn] += trend
            made.append((x, worn))
    controls["white noise, 10 % trend on one axis"] = made
    rows = [row(label, cases) for label, cases in controls.items()]
    print("\n" + table(["control, noise 0.03 %", *METHODS], rows))
    correlations = []
    for x, _, k, s in draws:
        seen = noisy(x, share, [s, k])
        rates = [entropy_rate(seen[:, axis], 10) for axis in range(seen.shape[1])]
        correlations.append(np.corrcoef(net_transfer_entropy(seen, 10).sum(axis=1), rates)[0, 1])
    print(
        "\nCorrelation over the axes between the sum of net TE and the entropy of the next symbol "
        f"given the last: median {np.median(correlations):.3f}, "
        f"95 % of runs below {np.quantile(correlations, 0.95):.3f}."
    )


if __name__ == "__main__":
    main()

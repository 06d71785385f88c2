"""Time transfer entropy on random series and print the medians of five as JSON.

Effective transfer entropy of all pairs is timed beside a plain loop that counts each shuffle with
np.bincount; the answers of both must agree.

python -m benchmarks.speed.transfer_entropy
"""

import json
import platform
import time
from collections.abc import Callable
from functools import partial
from statistics import median

import numpy as np
from faultgen.analysis import (
    effective_net_transfer_entropy,
    effective_transfer_entropy,
    net_transfer_entropy,
    quantile_symbols,
    transfer_entropy,
)
from numpy.random import Generator
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def milliseconds(call: Callable[[], object], calls: int) -> float:
    """Median of five timings of a call.

    Args:
        call: What to time.
        calls: Number of calls in a timing.

    Returns:
        Time of one call, in [ms].
    """
    timings = []
    for _ in range(6):
        start = time.perf_counter()
        for _ in range(calls):
            call()
        timings.append((time.perf_counter() - start) / calls * 1e3)
    # The first timing is the warm-up.
    return round(median(timings[1:]), 4)


def plain_loop(x: Floats, bins: int, shuffles: int, rng: Generator) -> Floats:
    """Net effective transfer entropy of all pairs, one shuffle at a time.

    Args:
        x: Series. Shape (samples, axes).
        bins: Number of bins.
        shuffles: Number of permutations a pair.
        rng: Parent of the pairs' streams.

    Returns:
        Net effective transfer entropies. Shape (axes, axes), in [bit].
    """

    def entropy_left(source: NDArray, y_code: NDArray) -> float:
        joint = np.bincount(source * bins * bins + y_code, minlength=bins**3)
        past = joint.reshape(-1, bins).sum(axis=1)
        return float(c_log_c[past].sum() - c_log_c[joint].sum()) / len(y_code)

    counts = np.arange(len(x) + 1.0)
    c_log_c = counts * np.log2(np.maximum(counts, 1))
    symbols = np.stack([quantile_symbols(column, bins) for column in x.T])
    value = np.zeros((len(symbols), len(symbols)))
    for (i, j), stream in zip(np.ndindex(value.shape), rng.spawn(value.size), strict=True):
        if i != j:
            # What the target's own past tells is the same in each shuffle and cancels.
            y_code = symbols[j, :-1] * bins + symbols[j, 1:]
            by_chance = [
                entropy_left(stream.permuted(symbols[i])[:-1], y_code) for _ in range(shuffles)
            ]
            value[i, j] = np.mean(by_chance) - entropy_left(symbols[i, :-1], y_code)
    return value - value.T


def main() -> None:
    """Print the timings and the machine they were taken on."""
    rng = np.random.default_rng(0)
    result: dict[str, object] = {
        "machine": platform.processor() or platform.machine(),
        "python": platform.python_version(),
        "numpy": np.__version__,
    }
    for n in (100, 1000):
        x = rng.normal(size=(n, 6))
        batch = rng.normal(size=(100, n, 6))
        a, b = x[:, 0], x[:, 1]
        result[f"te_n{n}_ms"] = milliseconds(partial(transfer_entropy, a, b), 100)
        result[f"net_n{n}_ms"] = milliseconds(partial(net_transfer_entropy, x), 50)
        in_batch = milliseconds(partial(net_transfer_entropy, batch), 1)
        result[f"net_in_batch_n{n}_ms"] = round(in_batch / len(batch), 4)
    result["ete_100_shuffles_n1000_ms"] = milliseconds(
        partial(effective_transfer_entropy, a, b, rng=rng), 5
    )
    # The two take turns, so that a busy machine slows both.
    ours, plain = [], []
    for seed in range(5):
        start = time.perf_counter()
        net = effective_net_transfer_entropy(x, rng=np.random.default_rng(seed)).net
        between = time.perf_counter()
        expected = plain_loop(x, 10, 100, np.random.default_rng(seed))
        ours.append((between - start) * 1e3)
        plain.append((time.perf_counter() - between) * 1e3)
        np.testing.assert_allclose(net, expected, atol=1e-12)
    result["ete_30_pairs_n1000_ms"] = round(median(ours), 1)
    result["ete_30_pairs_n1000_plain_loop_ms"] = round(median(plain), 1)
    result["plain_loop_over_ours"] = round(median(plain) / median(ours), 2)
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()

"""Time transfer entropy on random series and print the medians of five as JSON.

python benchmarks/bench_transfer_entropy.py
"""

import json
import platform
import time
from collections.abc import Callable
from functools import partial
from statistics import median

import numpy as np

from analysis import effective_transfer_entropy, net_transfer_entropy, transfer_entropy


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
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()

"""How fast the server of `faultgen explore` answers; prints the table of docs/exploring.md.

    python -m benchmarks.speed.explore_speed

A slider is moved in 60 steps after the cycles in advance have been simulated. The time runs from
the request to the parsed answer, without what the browser needs to draw it.
"""

from __future__ import annotations

import json
import threading
import time
from typing import Any
from urllib.parse import urlencode
from urllib.request import urlopen

import numpy as np
import typer

from faultgen.evaluation.markdown import table
from faultgen.exploring.choice import read_choice
from faultgen.exploring.server import ExploreServer

CASES = (("puma560", "pick_and_place"), ("irb6700", "spot_weld"))
EFFECTS = (("friction_wear", 0.8), ("backlash", 0.0012))
AXIS, STEPS, SIMULATED = 2, 60, 8


def asked(server: ExploreServer, **told: Any) -> float:
    """Ask for signals, and return the time until they are there [ms]."""
    started = time.perf_counter()
    with urlopen(f"{server.url}signals?{urlencode(told)}") as reply:
        if not json.load(reply)["ready"]:
            raise RuntimeError(f"not ready: {told}")
    return 1e3 * (time.perf_counter() - started)


def measured(server: ExploreServer, effect: str, top: float) -> list[str]:
    """Move the sliders of one effect, and describe the times in words."""
    told = {"effect": effect, "axis": AXIS}
    choice = {**told, "severity": 0.3 * top}
    asked(server, **choice, exact=1)
    server.cycles.near(read_choice({name: str(value) for name, value in choice.items()}))
    while not server.cycles.is_settled():
        time.sleep(0.1)
    shares = np.linspace(0.05, 0.95, STEPS).tolist()
    severity = [asked(server, **told, severity=share * top) for share in shares]
    warm = np.linspace(41, 69, STEPS).tolist()
    temperature = [asked(server, **choice, temperature=one) for one in warm]
    places = np.linspace(0.11, 0.91, SIMULATED).tolist()
    exact = [asked(server, **told, severity=share * top, exact=1) for share in places]
    cells = [
        "{:.0f}, {:.0f}, {:.0f} ms".format(*np.percentile(times, [50, 95, 100]))
        for times in (severity, temperature)
    ]
    return [f"`{effect}`", *cells, f"{np.median(exact):.0f} ms"]


def main() -> None:
    """Measure all cases and print the table."""
    rows = []
    for robot, task in CASES:
        with ExploreServer(robot, task) as server:
            thread = threading.Thread(target=server.serve_forever)
            thread.start()
            try:
                for effect, top in EFFECTS:
                    rows.append([f"{robot}, {task}", *measured(server, effect, top)])
            finally:
                server.shutdown()
                thread.join()
    header = [
        "robot, task",
        "effect",
        "severity: median, 95 %, largest",
        "temperature: median, 95 %, largest",
        "simulated cycle: median",
    ]
    print(table(header, rows))


if __name__ == "__main__":
    typer.run(main)

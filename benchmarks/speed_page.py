"""Write the tables of docs/speed.md from the measured results in benchmarks/results.

python benchmarks/speed_page.py
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tabulate import tabulate

HERE = Path(__file__).parent
PAGE = HERE.parent / "docs" / "speed.md"

_PROGRAMS = {
    "faultgen": "faultgen: all physics in MuJoCo's model, stepped by `mujoco.batch`",
    "mujoco.rollout": "`mujoco.rollout` of the same model",
    "Python loop": "Python loop over `mj_step`, servo and friction in numpy",
    "compiled loop": "`mj_step` of the rigid arm and the drivetrain in one loop compiled by numba",
    "Pinocchio": "Pinocchio's articulated-body algorithm, the drivetrain in numpy",
}


def speed(told: dict[str, Any]) -> str:
    """Table of the cost of a step, of run files and of workers."""
    one, workers, memory = told["stepping"], told["workers"], told["peak_memory_mib"]
    each = ", ".join(f"{ratio:.2f}" for ratio in workers["all"])
    rows = [
        [
            "bare rollout: time of a step, and speed",
            "–",
            f"{one['bare_us_per_step']:.2f} µs a step, {one['bare_simulated_s_per_s']:.0f} "
            "simulated seconds per second on one core",
        ],
        [
            "time of stepping by `faultgen.simulation.stepping`, divided by bare rollout of the "
            "same steps",
            "≤ 1.05",
            _goal(one["api_over_bare"], 1.05),
        ],
        [
            "time of a complete run file (stepping, noise, reductions, all signals compressed, "
            "checksum), divided by bare rollout",
            "≤ 1.20",
            _goal(one["run_file_all_signals_over_bare"], 1.20),
        ],
        [
            "the same for a run file that stores no sampled signals, only the reductions",
            "≤ 1.20",
            _goal(one["run_file_reductions_over_bare"], 1.20),
        ],
        [
            "speed with two workers, divided by the speed with one; sweep of "
            f"{workers['runs']} runs of 60 cycles ({workers['one_worker_s']:.0f} s with one)",
            "≥ 1.90",
            f"{_goal(-workers['two_over_one'], -1.90)} ({each})",
        ],
        [
            "peak memory of a sweep of 1 run of 5 cycles; 1 run of 60 cycles; 12 runs of 5 cycles",
            "does not grow with the sweep",
            "; ".join(f"{mib:.0f}" for mib in memory.values()) + " MiB",
        ],
    ]
    return _table(["quantity", "goal", "measured"], rows)


def _table(head: list[str], rows: list[list[Any]]) -> str:
    lines = tabulate(rows, head, tablefmt="github", disable_numparse=True).splitlines()
    lines[1] = "|" + " --- |" * len(head)
    return "\n".join(re.sub(" {2,}", " ", line) for line in lines)


def _goal(value: float, most: float) -> str:
    """A number, in bold letters if it misses its goal."""
    text = f"{abs(value):.2f}"
    return text if round(value, 2) <= most else f"**{text}**"


def peers(told: dict[str, Any]) -> str:
    """Table of programs that one would write instead."""
    rows = []
    for name, text in _PROGRAMS.items():
        one = told["programs"][name]
        rows.append(
            [
                text,
                f"{one['step'] * 1e3:g} ms",
                f"{one['error']:.3%}".replace("%", " %"),
                f"{one['milliseconds_per_second']:.1f} ms",
                f"{one['over_faultgen']:.1f}",
            ]
        )
    head = ["program", "step", "torque error", "cost of a simulated second", "over faultgen"]
    return _table(head, rows)


def growth(told: dict[str, Any]) -> str:
    """Table of time and memory by number of runs, cycles and axes."""
    head = ["axes", "runs", "cycles of each run", "`generate` [s]", "memory [MiB]", "`info` [s]"]
    rows = [
        [
            row["axes"],
            row["runs"],
            row["cycles"],
            f"{row['generate_processor_seconds']:.1f}",
            f"{row['generate_peak_memory_mib']:.0f}",
            f"{row['info_processor_seconds']:.1f}",
        ]
        for row in told["rows"]
    ]
    return _table(head, rows)


def signatures(told: dict[str, Any]) -> str:
    """Table of the signatures of discovery by robot and length of the recording."""
    head = ["robot", "recording", "goal", "all signatures", "over one simulation", "second one"]
    rows = []
    for row in told["rows"]:
        cells = [row["robot"], f"{row['seconds']:g} s", f"{row['goal']:g} s"]
        cells += [f"{row['signatures_s']:.1f} s", f"{row['signatures_over_simulation']:.1f}"]
        cells += [f"{row['second_s']:.1f} s"]
        rows.append(cells)
    return _table(head, rows)


TABLES: dict[str, Callable[[dict[str, Any]], str]] = {
    "speed": speed,
    "peers": peers,
    "growth": growth,
    "signature_speed": signatures,
}


def written(page: str) -> str:
    """Put the tables into the text of the page.

    Args:
        page: The text, in which the comments "<!-- NAME.json -->" and "<!-- end -->" enclose each
            table.

    Returns:
        The text with the tables of the present results.
    """
    for name, table in TABLES.items():
        told = json.loads((HERE / "results" / f"{name}.json").read_text(encoding="utf-8"))
        begin, end = f"<!-- {name}.json -->\n", "\n<!-- end -->"
        before, found, rest = page.partition(begin)
        if not found or end not in rest:
            raise SystemExit(f"{PAGE}: has no place for the table of {name}.json")
        page = before + begin + table(told) + rest[rest.index(end) :]
    return page


if __name__ == "__main__":
    PAGE.write_text(written(PAGE.read_text(encoding="utf-8")), encoding="utf-8")

"""Time and memory: docs/speed.md."""

from __future__ import annotations

from typing import Any

from parts.part import GPU, Part, table

_PAGE = "speed.md"

_PROGRAMS = {
    "faultgen": "faultgen",
    "mujoco.rollout": "`mujoco.rollout` of the same model",
    "Python loop": "Python loop over `mj_step`, servo and friction in numpy",
    "compiled loop": "loop of arm and drivetrain, compiled by numba",
    "Pinocchio": "Pinocchio, the drivetrain in numpy",
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
            "stepping by `faultgen.simulation.stepping` over bare rollout",
            "≤ 1.05",
            _goal(one["api_over_bare"], 1.05),
        ],
        [
            "complete run file, with all signals, over bare rollout",
            "≤ 1.20",
            _goal(one["run_file_all_signals_over_bare"], 1.20),
        ],
        [
            "run file with the reductions only over bare rollout",
            "≤ 1.20",
            _goal(one["run_file_reductions_over_bare"], 1.20),
        ],
        [
            f"speed of two workers over one; sweep of {workers['runs']} runs of 60 cycles",
            "≥ 1.90",
            f"{_goal(-workers['two_over_one'], -1.90)} ({each})",
        ],
        [
            "peak memory of a sweep of 1 run of 5 cycles; 1 run of 60 cycles; 12 runs of 5 cycles",
            "does not grow with the sweep",
            "; ".join(f"{mib:.0f}" for mib in memory.values()) + " MiB",
        ],
    ]
    return table(["quantity", "goal", "measured"], rows)


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
    return table(head, rows)


def growth(told: dict[str, Any]) -> str:
    """Time and memory at the ends of the series by runs, cycles and axes, as sentences."""
    rows = {(row["axes"], row["runs"], row["cycles"]): row for row in told["rows"]}

    def ends(*keys: tuple[int, int, int]) -> str:
        seconds = " to ".join(f"{rows[key]['generate_processor_seconds']:.1f}" for key in keys)
        memory = " to ".join(f"{rows[key]['generate_peak_memory_mib']:.0f}" for key in keys)
        return f"{seconds} s and {memory} MiB"

    return (
        f"- From 10 to 1000 runs of one cycle (two axes): {ends((2, 10, 1), (2, 1000, 1))}.\n"
        f"- From 10 to 1000 cycles in two runs (two axes): {ends((2, 2, 10), (2, 2, 1000))}.\n"
        f"- From 1 to 14 axes, in two runs of 50 cycles: {ends((1, 2, 50), (14, 2, 50))}."
    )


def signatures(told: dict[str, Any]) -> str:
    """Table of the signatures of discovery by robot and length of the recording."""
    head = ["robot", "recording", "goal", "all signatures", "second one"]
    rows = []
    for row in told["rows"]:
        cells = [row["robot"], f"{row['seconds']:g} s", f"{row['goal']:g} s"]
        cells += [f"{row['signatures_s']:.1f} s", f"{row['second_s']:.1f} s"]
        rows.append(cells)
    return table(head, rows)


def device(told: dict[str, Any]) -> str:
    """Speed of a graphics card by number of robots, over cores of the processor."""
    one, every = (told["processors"][name] for name in ("one_core", "all_cores"))
    cores = told["processors"]["cores"]
    rows = []
    for row in told["speed"]:
        rate = row["steps_per_second_without_host"]
        cells = [row["worlds"], f"{rate / 1e6:.3g} million"]
        cells += [f"{rate / base:.{0 if rate > 10 * base else 1}f}" for base in (one, every)]
        rows.append([*cells, f"{row['memory_bytes'] / 2**30:.2f} GiB"])
    head = ["robots at once", "steps a second", "over one core", f"over {cores} cores", "memory"]
    card = told["device"].partition(": ")[2]
    return (
        f"{card}. One core steps {one / 1e6:.2f} million times a second, {cores} cores "
        f"{every / 1e6:.2f} million times.\n\n{table(head, rows)}"
    )


PARTS = (
    Part(
        name="speed",
        commands=("python -m benchmarks.speed.speed --save speed.json",),
        code=("speed.speed", "faultgen.dataset.sweep"),
        page=_PAGE,
        table=speed,
        minutes=15,
    ),
    Part(
        name="peers",
        commands=("python -m benchmarks.speed.peers --save peers.json",),
        code=("speed.peers", "independent"),
        page=_PAGE,
        table=peers,
        minutes=5,
        needs=("numba", "pinocchio"),
    ),
    Part(
        name="growth",
        commands=("python -m benchmarks.speed.growth --save growth.json",),
        code=("speed.growth", "faultgen.building.build", "faultgen.dataset.sweep"),
        page=_PAGE,
        table=growth,
        minutes=4,
    ),
    Part(
        name="signature_speed",
        commands=("python -m benchmarks.speed.signature_speed --save signature_speed.json",),
        code=("speed.signature_speed",),
        page=_PAGE,
        table=signatures,
        minutes=4,
    ),
    Part(
        name="device",
        commands=("python -m benchmarks.speed.device --device cuda --save device.json",),
        code=("speed.device",),
        page=_PAGE,
        table=device,
        minutes=10,
        needs=(GPU, "mujoco_warp"),
    ),
)

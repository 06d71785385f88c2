"""The standard comparison of isolators and detectors: fixed data, fixed divisions, one table.

The data are made from fixed experiments, so that everybody measures on the same bits. There are two
kinds of data. In the standard data each robot behaves exactly like its model, and one axis wears.
In the harder data robots of one model differ, several effects occur, and methods that learn from
labels are tested on other robots than those from which they have learned.

    result = run_benchmark("out", quick=True, workers=2)
    print(benchmark_page(result))
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from hashlib import sha256
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from sklearn.ensemble import RandomForestClassifier

from faultgen.dataset.experiment import Experiment, make_experiment
from faultgen.dataset.reader import open_dataset
from faultgen.dataset.sweep import generate
from faultgen.effects import Applied, get_effect
from faultgen.errors import InputError, SimulationFailed
from faultgen.evaluation.classifier import Classifier
from faultgen.evaluation.detect import detect
from faultgen.evaluation.isolate import isolate
from faultgen.evaluation.markdown import percent, table
from faultgen.evaluation.methods import Detector, Isolator
from faultgen.evaluation.outcomes import shown_level
from faultgen.evaluation.shares import share
from faultgen.robot import load_robot
from faultgen.system.files import write_text

ROBOTS = ("puma560", "irb6700")
TASKS = ("pick_and_place", "spot_weld", "arc_weld")
SEED = 2026
"""Seed of the data. Results of other seeds are not comparable with the leader board."""

LEVELS = (0.05, 0.10, 0.15)
"""Severities at which methods are asked about effects in fractions of nominal. About other effects
they are asked at the end of the run."""

_SCATTER = {"coulomb_friction": 0.15, "viscous_friction": 0.2, "rotor_inertia": 0.03}
"""Standard deviation of parameters among robots of one model: assumed, as for fleets."""


class RandomForest(Classifier):
    """A classifier that learns from labels, as a yardstick for others."""

    name = "random forest"
    idea = "500 trees on mean |torque|, torque histograms and temperature; learns from labels"
    features = ("mean_abs_torque", "torque_histogram", "temperature")

    def model(self) -> RandomForestClassifier:
        """Make the forest, not yet fitted."""
        return RandomForestClassifier(n_estimators=500, random_state=0)


@dataclass(frozen=True, kw_only=True)
class Size:
    """How much data the benchmark has."""

    axes: tuple[int, ...]
    """Axes that wear."""
    cycles: int
    """Cycles of each run."""
    repetitions: int
    """Repetitions of the standard data."""
    instances: int
    """Robots of each model in the harder data."""
    hard_robots: tuple[str, ...]
    """Models of the harder data."""
    hard_repetitions: int
    """Repetitions of the harder data."""
    effects: dict[str, list[float]] = field(default_factory=dict)
    """Effects of the harder data with their final severities, each in its unit."""


FULL = Size(
    axes=(1, 2, 3, 4, 5, 6),
    cycles=40,
    repetitions=10,
    instances=6,
    hard_robots=ROBOTS,
    hard_repetitions=4,
    effects={
        "friction_wear": [0.2],
        "viscous_friction": [0.5],
        "backlash": [0.002],
        "torque_ripple": [0.02],
    },
)
QUICK = Size(
    axes=(2, 5),
    cycles=16,
    repetitions=4,
    instances=3,
    hard_robots=("puma560",),
    hard_repetitions=4,
    effects={"friction_wear": [0.2], "backlash": [0.002]},
)


def run_benchmark(
    out: str | Path,
    *,
    quick: bool = False,
    methods: Sequence[type[Isolator] | type[Detector]] = (),
    workers: int = 1,
    progress: bool = True,
) -> dict[str, Any]:
    """Make the standard data, run all methods on them, and write the leader board.

    Data that are there are used again.

    Args:
        out: Folder for the data, ``benchmark.json`` and ``benchmark.md``.
        quick: Whether to use less data, for a first look.
        methods: Further isolators and detectors that take part.
        workers: Number of processes that simulate. The result does not depend on it.
        progress: Whether to show progress bars on stderr.

    Returns:
        The counted answers, as in ``benchmark.json``.

    Raises:
        InputError: The folder holds other data, or a method is none.
        SimulationFailed: A run failed.
    """
    out, size = Path(out), QUICK if quick else FULL
    isolators: list[Any] = [RandomForest, *(one for one in methods if _is(one, Isolator))]
    detectors: list[Any] = [one for one in methods if _is(one, Detector)]
    for one in methods:
        if one not in isolators and one not in detectors:
            raise InputError(
                f"method {getattr(one, '__qualname__', repr(one))}: must be a subclass of "
                "faultgen.evaluation.Isolator or Detector"
            )
    sets = []
    for kind, name, split, experiment in _experiments(out, size):
        folder = out / name
        made = generate(experiment, folder, workers=workers, keep="merged", progress=progress)
        if made.failed:
            raise SimulationFailed("; ".join(made.failed.values()))
        dataset = open_dataset(folder)
        shared: dict[str, Any] = {"levels": LEVELS, "split": split, "progress": progress}
        found = isolate(dataset, methods=isolators, **shared)
        alarms = detect(dataset, methods=detectors, **shared)
        sets.append(
            {
                "kind": kind,
                "name": name,
                "split": split,
                # ids of runs do not depend on folders, as the experiment file of the robots does
                "runs_sha256": sha256(" ".join(sorted(dataset.planned)).encode()).hexdigest(),
                "runs": len(dataset.runs),
                "cycles": sum(int(run["cycles"]) for run in dataset.runs),
                "tested": sum(part == "test" for part in dataset.part_of(split).values()),
                "isolation": [
                    {
                        "robot": one.robot,
                        "task": one.task,
                        "effect": one.effect,
                        "level": one.level,
                        "method": one.method,
                        "right": one.right,
                        "total": one.total,
                    }
                    for one in found.outcomes
                ],
                "detection": [
                    {
                        **row,
                        "right": row["total"] - row["alarms"]
                        if not row["level"]
                        else row["alarms"],
                    }
                    for row in alarms.results
                ],
                "left_out": {"isolators": found.left_out, "detectors": alarms.left_out},
                "made_by": [found.made_by, alarms.made_by],
            }
        )
    result = {"quick": quick, "seed": SEED, "sets": sets}
    result["leaders"] = {kind: leaders(result, kind) for kind in ("isolation", "detection")}
    write_text(out / "benchmark.json", json.dumps(result, indent=1) + "\n")
    write_text(out / "benchmark.md", benchmark_page(result))
    return result


def _is(method: object, kind: type) -> bool:
    return isinstance(method, type) and issubclass(method, kind)


def _experiments(out: Path, size: Size) -> Iterable[tuple[str, str, str, Experiment]]:
    """Kind, name, division and experiment of each dataset."""
    common: dict[str, Any] = {
        "axis": list(size.axes),
        "cycles": size.cycles,
        "schedule": "linear",
        "sensors": "realistic",
        "signals": ["signals/motor_torque"],
        "seed": SEED,
    }
    standard = {
        "robot": list(ROBOTS),
        "task": list(TASKS),
        "severity": 0.2,
        "repetitions": size.repetitions,
    }
    yield "standard", "standard", "run", make_experiment({**common, **standard})
    for model in size.hard_robots:
        hard = {
            "robot": [str(path) for path in _instances(out / "robots", model, size.instances)],
            "task": [str(_task_file(model, "spot_weld"))],
            "effect": list(size.effects),
            "severity": size.effects,
            "repetitions": size.hard_repetitions,
        }
        yield "harder", f"harder_{model}", "robot", make_experiment({**common, **hard})


def _task_file(robot: str, task: str) -> Path:
    return Path(str(resources.files("faultgen.robots").joinpath(robot, "tasks", f"{task}.toml")))


def _instances(folder: Path, model: str, count: int) -> list[Path]:
    """Write robots of one model that differ in their friction and inertia."""
    robot = load_robot(model)
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for number in range(count):
        rng = np.random.default_rng([SEED, number, *model.encode()])
        deviations = [
            Applied(name, axis, float(np.clip(spread * rng.standard_normal(), -0.6, 2.0)))
            for name, spread in _SCATTER.items()
            for axis in range(1, robot.n_axes + 1)
        ]
        path = folder / f"{model}_{number + 1}.xml"
        write_text(path, deviating(model, deviations))
        paths.append(path)
    return paths


def deviating(model: str, deviations: Sequence[Applied]) -> str:
    """Return the MJCF text of a robot whose parameters deviate from those of its model.

    Args:
        model: Name of the model.
        deviations: Effects that change only the model file.
    """
    robot = load_robot(model)
    spec = robot.spec()
    for one in deviations:
        get_effect(one.effect).apply(spec, one.axis, one.severity)
    return robot.edited(spec).xml


def leaders(result: dict[str, Any], what: str) -> list[dict[str, Any]]:
    """Rank methods by the mean of their scores.

    The score of a method on one kind of data is the mean of two shares: of right answers about worn
    robots, and of right answers about healthy ones. A method that always names an axis, or raises
    an alarm, therefore has at most 0.5.

    Args:
        result: Result of `run_benchmark`.
        what: "isolation" or "detection".

    Returns:
        One row for each method, the best first: its name, score, and shares with 95 % Wilson
        intervals for each kind of data, or None where it was left out.
    """
    kinds = list(dict.fromkeys(one["kind"] for one in result["sets"]))
    counts: dict[str, dict[str, list[int]]] = {}
    for one in result["sets"]:
        for row in one[what]:
            state = "worn" if row["level"] else "healthy"
            cell = counts.setdefault(row["method"], {}).setdefault(f"{one['kind']} {state}", [0, 0])
            cell[0] += row["right"]
            cell[1] += row["total"]
    rows = []
    for method, cells in counts.items():
        shares = {
            f"{kind} {state}": share(*cells[f"{kind} {state}"])
            if f"{kind} {state}" in cells
            else None
            for kind in kinds
            for state in ("worn", "healthy")
        }
        # what a method cannot answer counts as wrong
        told = [one["share"] if one else 0.0 for one in shares.values()]
        rows.append({"method": method, "score": float(np.mean(told)), **shares})
    return sorted(rows, key=lambda row: (-row["score"], row["method"]))


def benchmark_board(result: dict[str, Any], what: str) -> str:
    """Return the leader board as a Markdown table.

    Args:
        result: Result of `run_benchmark`.
        what: "isolation" or "detection".
    """
    rows = result["leaders"][what]
    columns = [name for name in rows[0] if name not in ("method", "score")]
    body = [
        [
            number,
            row["method"],
            f"{100 * row['score']:.1f}",
            *(percent(row[name]) if row[name] else "left out" for name in columns),
        ]
        for number, row in enumerate(rows, start=1)
    ]
    return table(["", "method", "score", *columns], body)


def _details(one: dict[str, Any]) -> str:
    """Right answers on one dataset by robot, task, effect and severity."""
    cells: dict[tuple[Any, ...], tuple[int, int]] = {}
    for row in one["isolation"]:
        key = (row["robot"], row["task"], row["effect"], row["level"])
        cells[*key, row["method"]] = (row["right"], row["total"])
    names = list(dict.fromkeys(key[-1] for key in cells))
    lines = sorted({key[:4] for key in cells}, key=lambda k: (k[0], k[1], k[3] == 0, k[2], k[3]))
    body = [
        [
            *key[:3],
            shown_level(key[2], key[3]),
            max(cells[*key, name][1] for name in names if (*key, name) in cells),
            *(
                f"{100 * cells[*key, name][0] / cells[*key, name][1]:.0f}"
                if (*key, name) in cells
                else "-"
                for name in names
            ),
        ]
        for key in lines
    ]
    return table(["robot", "task", "effect", "severity", "answers", *names], body)


def benchmark_page(result: dict[str, Any]) -> str:
    """Write the page that shows the leader board.

    Args:
        result: Result of `run_benchmark`.

    Returns:
        The page as Markdown.
    """
    command = "faultgen benchmark" + (" --quick" if result["quick"] else "") + " -o DIR"
    boards = result["leaders"]
    best = boards["isolation"][0]
    levels = ", ".join(f"{100 * level:g} %" for level in LEVELS)
    lines = [
        "# Benchmark",
        "**Which method names the worn axis best, and how do you enter one of your own?** "
        f"Of the isolators below, '{best['method']}' has the highest score: "
        f"{100 * best['score']:.1f} of 100.",
        f"This page was written by `{command}`. "
        + (
            "It shows the quick version with little data, whose intervals are wide. The full "
            "version, without `--quick`, has all axes, more effects and more robots. "
            if result["quick"]
            else ""
        )
        + "The data come from fixed experiments and seeds, and their divisions into training and "
        "test runs are stored with them, so everybody measures on the same runs.",
        "To enter a method, write one class ([how](extending.md)) and run "
        f"`{command} --method ./my_file.py:MyClass`. It then appears in every table of `DIR/"
        "benchmark.md`.",
        "## Leader board: which axis is worn?",
        "Right answers in percent, with 95 % Wilson intervals. An answer about a worn robot is "
        f"right if it names the worn axis, at a severity of {levels} for effects that are "
        "fractions of nominal, otherwise in the last cycle. Severities that a run reaches in "
        "fewer than 5 cycles do not count. An answer about a healthy "
        "robot is right if it names no axis. The score is the mean of the columns. "
        "What a method could not answer counts as wrong.",
        benchmark_board(result, "isolation"),
        "## Leader board: is anything worn?",
        "Right answers of the detectors in the same form: an alarm up to that severity, and no "
        "alarm in any cycle of a healthy run.",
        benchmark_board(result, "detection"),
        "## The data",
        "The standard data have two robots and three tasks, with friction wear of one axis and "
        "`realistic` noise. Each robot behaves exactly like its model, and methods are tested on "
        "other runs of the same robots. In the harder data, robots of one model differ: Coulomb "
        "friction by 15 %, viscous friction by 20 % and rotor inertia by 3 % (standard "
        "deviations; assumed). Several effects occur, and methods that learn from labels are "
        "tested on other robots. In both, temperature and payload drift.",
        table(
            ["dataset", "division", "runs", "test runs", "cycles", "runs (SHA-256 of their ids)"],
            [
                [s["name"], s["split"], s["runs"], s["tested"], s["cycles"], s["runs_sha256"]]
                for s in result["sets"]
            ],
        ),
    ]
    for one in result["sets"]:
        lines += [f"## Isolators on `{one['name']}`", "Right answers in percent.", _details(one)]
        for kind, reasons in one["left_out"].items():
            lines += [f"{kind}, {place}: {reason}" for place, reason in reasons.items()]
    lines += [
        "## What falls short",
        "- The answers at several severities of one run are not independent, and neither are runs "
        "of one robot. The intervals are therefore too narrow.\n"
        "- The isolators that use directions of wear get them from the true parameters of each "
        "robot, also in the harder data. They look only for friction wear.\n"
        "- The training and test parts hold the same effects. No method is tested on an effect "
        "that it has never seen.",
        f"Made by {result['sets'][0]['made_by'][0]}; seed {result['seed']}.",
    ]
    return "\n\n".join(lines) + "\n"

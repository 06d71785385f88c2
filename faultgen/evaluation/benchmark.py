"""The standard comparison of isolators and detectors: fixed data, fixed divisions, one table.

The data are made from fixed experiments, so that everybody measures on the same runs. There are two
kinds of data. In the standard data each robot behaves exactly like its model, and one axis wears.
In the harder data robots of one model differ, several effects occur, and methods that learn from
labels are tested on other robots than those from which they have learned.

    result = run_benchmark("out", quick=True, workers=2)
    print(benchmark_page(result))
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import astuple, dataclass, field, replace
from hashlib import sha256
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from sklearn.ensemble import RandomForestClassifier

from faultgen.dataset.estimate import Estimate, estimate
from faultgen.dataset.experiment import Experiment, make_experiment
from faultgen.dataset.manifest import refuse_data
from faultgen.dataset.reader import open_dataset
from faultgen.dataset.sweep import generate
from faultgen.effects import Applied, get_effect
from faultgen.errors import InputError, SimulationFailed
from faultgen.evaluation.baselines import DETECTION_BASELINES, ISOLATION_BASELINES
from faultgen.evaluation.classifier import Classifier
from faultgen.evaluation.detect import detect
from faultgen.evaluation.isolate import isolate
from faultgen.evaluation.leader_board import LEVELS, benchmark_page, leaders
from faultgen.evaluation.methods import Detector, Isolator
from faultgen.evaluation.places import ROBOTS, TASKS
from faultgen.robot import load_robot
from faultgen.system.files import write_text

SEED = 2026
"""Seed of the data. Results of other seeds are not comparable with the leader board."""

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
    refuse_data(out)
    isolators: list[Any] = [
        *(RandomForest, *ISOLATION_BASELINES),
        *(one for one in methods if _is(one, Isolator)),
    ]
    detectors: list[Any] = [
        *DETECTION_BASELINES,
        *(one for one in methods if _is(one, Detector)),
    ]
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
                "healthy_cycles": alarms.healthy_cycles,
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
                        "right_by_axis": {str(k): n for k, n in one.right_by_axis.items()},
                        "total_by_axis": {str(k): n for k, n in one.total_by_axis.items()},
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


def estimate_benchmark(*, quick: bool = False, workers: int = 1, progress: bool = True) -> Estimate:
    """Estimate what the data of the benchmark take. Nothing is left on the disk.

    Args:
        quick: As for `run_benchmark`.
        workers: Number of processes that would simulate.
        progress: Whether to show on stderr how far the measurement is.

    Returns:
        The estimate. The isolators and detectors take further time.
    """
    size = QUICK if quick else FULL
    parts = []
    with tempfile.TemporaryDirectory() as folder:
        # robots of one model take the same time, so that one of them is measured
        for kind, _, _, experiment in _experiments(Path(folder), replace(size, instances=1)):
            one = estimate(experiment, workers=workers, progress=progress)
            count = size.instances if kind == "harder" else 1
            parts.append([count * value for value in astuple(one)])
    return Estimate(*map(sum, zip(*parts, strict=True)))


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

"""What is a twin worth? Detectors trained on simulated faults, judged on robots of their own.

python -m benchmarks.monitoring.twin_detectors run --seeds report --instances 8 -o DIR
python -m benchmarks.monitoring.twin_detectors run --seeds report --recordings 1 -o ANOTHER
python -m benchmarks.monitoring.twin_detectors table DIR

The robots are SCARAs of the simulator in `laboratories`, which shares no code with faultgen. Every
instance has its own parameters, servo, program and noise. docs/twin.md describes the comparison.
"""

from __future__ import annotations

import argparse
import json
import shutil
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from laboratories.draw import BASE, Laboratory
from laboratories.effects import ORDERS, WAVES, Effect, apply, unit
from laboratories.make import Setup, draw_session, record, set_up
from laboratories.robots import robot_file
from laboratories.servo import SERVOS
from threadpoolctl import threadpool_limits

from faultgen.dataset.experiment import make_experiment
from faultgen.dataset.reader import open_dataset
from faultgen.dataset.sweep import generate
from faultgen.discovery.calibration.calibrate import calibrate
from faultgen.discovery.discover import Discovery
from faultgen.errors import InputError, SimulationFailed
from faultgen.evaluation.shares import wilson
from faultgen.recordings.recording import Recording, mean_of
from faultgen.robot import Robot, load_robot
from faultgen.system.files import write_text
from faultgen.twin.alignment import find_cycles, mean_cycle
from faultgen.twin.columns import Generated
from faultgen.twin.detector import Detector
from faultgen.twin.folder import RESULT, TASK
from faultgen.twin.make import furnish
from faultgen.twin.train import learn, train

SEEDS = {"development": 0, "first": 600, "second": 1200, "report": 1800}
"""Number of the first laboratory of each set. Nothing was chosen on the set "report"; "first" and
"second" had that name until the detector was changed for what they had shown."""
AXES = (1, 2)
"""Axes that wear. The robot has four."""
SEVERITIES = {"friction_wear": (0.05, 0.1, 0.2), "backlash": (0.25e-3, 0.5e-3, 1e-3)}
"""Severities of the recordings that are judged."""
LARGEST = {"friction_wear": 0.25, "backlash": 1.25e-3}
"""Final severity of the training data."""
JUDGED = 10
"""Further healthy recordings, which are judged."""
CYCLES, REPETITIONS = 8, 2
"""Of the training data, for each fault."""
RATE = 0.01
"""Rate of false alarms for which the limits are set, per recording."""
ARMS = {
    "nominal": "(a) nominal model",
    "calibrated": "(b) calibrated twin",
    "discovered": "(c) twin with discovered effects",
    "own": "(d) faults of that very robot",
}
LACKING = (
    "transmission_error",
    "torque_ripple",
    "load_friction",
    "quadratic_viscous_friction",
    "friction_asymmetry",
    "gravity_spring",
    "gear_stiffness",
)
"""Effects that a healthy robot may have and its model lacks."""
_SECONDS = 4.0
_MOTIONS = ("task", "ladder", "multisine")


@dataclass(frozen=True)
class Conditions:
    """What differs between comparisons. The same instance is the same robot in each of them."""

    recordings: int = 5
    """Healthy recordings that everything is learned from."""
    model_error: float = 0.05
    """Error of each parameter of the nominal model, over its value."""
    lacking: bool = False
    """Whether each robot has an effect that its model lacks."""


def laboratory(seeds: str, number: int, model_error: float) -> Laboratory:
    """Draw a laboratory: servo, noise and program are random, the rest is fixed."""
    rng = np.random.default_rng([77, SEEDS[seeds] + number])
    factors = {
        **BASE,
        "robot": "scara4",
        "servo": SERVOS[int(rng.integers(len(SERVOS)))],
        "seconds": _SECONDS,
        "segments": 1,
        "motion": _MOTIONS[int(rng.integers(len(_MOTIONS)))],
        "noise": ("constant", "by_speed", "by_load", "coloured")[int(rng.integers(4))],
        "level": float((0.005, 0.01, 0.02)[int(rng.integers(3))]),
        "repeat": 0.01,
        "model_error": model_error,
    }
    return Laboratory(seeds, SEEDS[seeds] + number, factors, ())


def lacking_effect(lab: Laboratory) -> Effect:
    """Draw the effect that a healthy robot has and its model lacks."""
    rng = np.random.default_rng([lab.seed, 9])
    name, axis = LACKING[int(rng.integers(len(LACKING)))], AXES[int(rng.integers(len(AXES)))]
    details = {}
    if name in WAVES:
        details = {
            "order": float(ORDERS[int(rng.integers(len(ORDERS)))]),
            "phase": float(rng.uniform(0, 2 * np.pi)),
        }
    return Effect(name, axis, unit(name, axis, lab.machine), details)


def measured(setup: Setup, effects: Sequence[Effect], rng: np.random.Generator) -> Recording:
    """Record the program once, on a day of its own."""
    arrays, _ = record(setup, effects, draw_session(setup, rng), range(1), rng)
    return Recording(
        source="laboratory",
        robot="scara4",
        side="motor",
        sample_period=setup.period,
        position=arrays["motor_position"],
        torque=arrays["motor_torque"],
        velocity=arrays["motor_velocity"],
        reference_position=arrays["reference_position"],
    )


def discovered(recording: Recording, robot: Robot) -> tuple[Robot, list[str]]:
    """The model with what discovery names or learns on a healthy recording."""
    found = Discovery(robot).fit(recording)
    told = found.answer_
    names = [f"{one['effect']} on axis {one['axis']}" for one in told.contract()["effects"]]
    names += [one.sentence for one in found.laws_]
    return told.robot if names else robot, names


def trained(
    robot: Robot,
    recordings: Sequence[Recording],
    folder: Path,
    largest: Mapping[str, float] = LARGEST,
) -> Detector:
    """Furnish a model with what the recordings show, generate faults, and train."""
    furnish(robot, recordings, folder / "robot", compare=False)
    told = {"recordings": [one.source for one in recordings], "torque_constants": None}
    write_text(folder / "robot" / RESULT, json.dumps(told))
    experiment = make_experiment(
        {
            "robot": str(folder / "robot"),
            "task": TASK,
            "axis": [list(AXES)[k : k + 1] for k in range(len(AXES))],
            "effect": list(largest),
            "severity": dict(largest),
            "schedule": "linear",
            "cycles": CYCLES,
            "repetitions": REPETITIONS,
            "signals": ["signals/motor_torque", "signals/motor_position"],
        }
    )
    summary = generate(experiment, folder / "data", progress=False)
    if summary.failed:
        raise SimulationFailed("; ".join(summary.failed.values()))
    return train(open_dataset(folder / "data"), false_alarms=30 * RATE)


def own_faults(setup: Setup, like: Detector, robot: Robot, rng: np.random.Generator) -> Detector:
    """A detector that has seen the faults of this robot, which nobody has in practice."""

    def seen(effects: Sequence[Effect]) -> np.ndarray:
        cycles = find_cycles(measured(setup, effects, rng), like.motion)
        return mean_cycle(cycles)[like.motion.compared]

    healthy = np.stack([seen([]) for _ in range(CYCLES * REPETITIONS)])
    shares = np.tile(np.arange(1, CYCLES + 1) / CYCLES, REPETITIONS)
    generated = []
    for fault in like.faults:
        if fault.effect in LARGEST:
            worn = [
                seen([Effect(fault.effect, fault.axes[0], fault.largest * share)])
                for share in shares
            ]
            generated.append(
                Generated(
                    fault=fault,
                    change=np.stack(worn) - healthy.mean(axis=0),
                    severity=shares,
                    measured=True,
                )
            )
    found = learn(robot, like.motion, healthy, generated, RATE, 0)
    return replace(
        like,
        program=found.program,
        faults=found.faults,
        posterior=found.posterior,
        healthy=found.healthy,
        made={},
    )


def score(
    detector: Detector, cases: Sequence[tuple[Effect | None, Recording]]
) -> list[dict[str, Any]]:
    """Judge each recording alone."""
    rows = []
    for truth, recording in cases:
        cycles = find_cycles(recording, detector.motion)
        answer = detector.judge(detector.scores(cycles)[None])
        named = answer["verdict"] == "fault"
        right = (
            truth is not None
            and named
            and answer["effect"] == truth.name
            and answer["axes"] == [truth.axis]
        )
        rows.append(
            {
                "effect": truth.name if truth else "healthy",
                "axis": truth.axis if truth else 0,
                "severity": truth.severity if truth else 0.0,
                "verdict": answer["verdict"],
                "alarm": answer["alarm"],
                "right": right,
                "named": [answer["effect"], answer["axes"]] if named else None,
                "estimate": answer["severity"],
                "inside": bool(
                    right and answer["interval"][0] <= truth.severity <= answer["interval"][1]
                )
                if truth
                else None,
            }
        )
    return rows


def run_instance(seeds: str, number: int, given: Conditions, out: Path) -> None:
    """Carry out the comparison on one robot, and write its result. A result is not made again."""
    path = out / f"{seeds}_{number:03d}.json"
    if path.is_file():
        return
    started = time.monotonic()
    lab = laboratory(seeds, number, given.model_error)
    setup = set_up(lab)
    told: dict[str, Any] = {"conditions": asdict(given), "factors": lab.factors, "seed": lab.seed}
    told |= {"arms": {}, "seconds": {}}
    if given.lacking:
        effect = lacking_effect(lab)
        told["lacking"] = asdict(effect)
        setup = replace(setup, robot=apply(effect, setup.robot, lab.machine))
    rng = np.random.default_rng([lab.seed, 8])
    healthy = [measured(setup, [], rng) for _ in range(given.recordings)]
    healthy = [replace(one, source=f"healthy{k}") for k, one in enumerate(healthy, start=1)]
    cases: list[tuple[Effect | None, Recording]] = [
        (None, measured(setup, [], rng)) for _ in range(JUDGED)
    ]
    for name, sizes in SEVERITIES.items():
        for axis in AXES:
            for size in sizes:
                effect = Effect(name, axis, size)
                cases.append((effect, measured(setup, [effect], rng)))
    nominal = load_robot(robot_file("scara4"))
    mean = mean_of(healthy)
    work = out / f"work_{seeds}_{number:03d}"
    with threadpool_limits(limits=1):
        try:
            calibrated = calibrate(mean, nominal)
        except (InputError, SimulationFailed) as error:
            told["arms"]["calibrated"] = {"failed": str(error)}
            write_text(path, json.dumps(told, indent=1) + "\n")
            return
        told["errors"] = {k: v for k, v in calibrated.errors.items() if np.isfinite(v)}
        told["seconds"]["calibrate"] = time.monotonic() - started
        improved, told["discovered"] = discovered(mean, calibrated.robot)
        told["seconds"]["discover"] = time.monotonic() - started
        models = {"nominal": nominal, "calibrated": calibrated.robot}
        if told["discovered"]:
            models["discovered"] = improved
        like = None
        for arm, model in models.items():
            try:
                detector = trained(model, healthy, work / arm)
            except (SimulationFailed, InputError) as error:
                told["arms"][arm] = {"failed": str(error)}
                continue
            like = like or detector
            told["arms"][arm] = {"answers": score(detector, cases)}
            told["seconds"][arm] = time.monotonic() - started
        assert like is not None
        if not told["discovered"]:
            told["arms"]["discovered"] = told["arms"]["calibrated"]
        detector = own_faults(setup, like, calibrated.robot, rng)
        told["arms"]["own"] = {"answers": score(detector, cases)}
    told["seconds"]["all"] = time.monotonic() - started
    write_text(path, json.dumps(told, indent=1) + "\n")
    shutil.rmtree(work)


def _share(rows: Sequence[bool]) -> str:
    low, high = wilson(sum(rows), len(rows))
    return f"{100 * np.mean(rows):.0f} [{100 * low:.0f}, {100 * high:.0f}]"


def _differences(results: Sequence[dict[str, Any]]) -> list[str]:
    """Differences between detectors on the same robots, with intervals by bootstrap over robots."""
    told, names = [], list(ARMS)
    for first, second in zip(names, names[1:], strict=False):
        pairs = [
            [
                np.mean([r["right"] for r in one["arms"][arm]["answers"] if r["severity"] > 0])
                for arm in (first, second)
            ]
            for one in results
            if all("answers" in one["arms"].get(arm, {}) for arm in (first, second))
        ]
        if len(pairs) < 2:
            continue
        change = 100 * np.diff(np.array(pairs), axis=1)[:, 0]
        drawn = np.random.default_rng(0).choice(change, (10000, len(change))).mean(axis=1)
        low, high = np.quantile(drawn, (0.025, 0.975))
        told.append(
            f"{ARMS[second]} minus {ARMS[first]}: {change.mean():+.0f} [{low:+.0f}, {high:+.0f}] "
            f"on {len(pairs)} robots"
        )
    return told


def table(out: Path) -> str:
    """Make the table of all instances in a folder."""
    files = sorted(out.glob("*.json"))
    results = [json.loads(path.read_text()) for path in files]
    conditions = {json.dumps(one["conditions"]) for one in results}
    if len(conditions) != 1:
        raise SystemExit(f"{out}: holds results of {len(conditions)} different conditions, not one")
    given = Conditions(**results[0]["conditions"])
    lines = [
        f"{len(results)} robots, {given.recordings} healthy recordings of each, parameters of the"
        f" model {100 * given.model_error:g} % off"
        + (", one effect that the model lacks" if given.lacking else "")
        + ". In percent, with 95 % Wilson intervals over recordings.",
        "",
        "| trained on | right effect and axis | detected | false alarms "
        "| severity error, median | true severity within the interval |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for arm, name in ARMS.items():
        rows = [r for one in results for r in one["arms"].get(arm, {}).get("answers", [])]
        if not rows:
            continue
        faulty = [r for r in rows if r["effect"] != "healthy"]
        fine = [r for r in rows if r["effect"] == "healthy"]
        right = [r for r in faulty if r["right"]]
        error = [abs(r["estimate"] / r["severity"] - 1) for r in right]
        within = _share([r["inside"] for r in right]) if right else "-"
        lines.append(
            f"| {name} | {_share([r['right'] for r in faulty])} "
            f"| {_share([r['alarm'] for r in faulty])} | {_share([r['alarm'] for r in fine])} "
            f"| {100 * np.median(error) if error else float('nan'):.0f} | {within} |"
        )
    lines += [
        "",
        "Differences of the share of right answers, in percentage points:",
        "",
    ]
    lines += [f"- {one}" for one in _differences(results)]
    lines += ["", "Right effect and axis by severity:", ""]
    sizes = [(name, size) for name, all_ in SEVERITIES.items() for size in all_]
    lines.append("| trained on | " + " | ".join(f"{n} {s:g}" for n, s in sizes) + " |")
    lines.append("| --- |" + " --- |" * len(sizes))
    for arm, name in ARMS.items():
        rows = [r for one in results for r in one["arms"].get(arm, {}).get("answers", [])]
        cells = []
        for effect, size in sizes:
            own = [r["right"] for r in rows if (r["effect"], r["severity"]) == (effect, size)]
            cells.append(f"{100 * np.mean(own):.0f} %" if own else "-")
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    failed = [
        f"{path.stem}: {arm}: {told['failed']}"
        for path, one in zip(files, results, strict=True)
        for arm, told in one["arms"].items()
        if "failed" in told
    ]
    return "\n".join([*lines, *([""] if failed else []), *failed])


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parts = parser.add_subparsers(dest="what", required=True)
    run = parts.add_parser("run")
    run.add_argument("--seeds", choices=SEEDS, default="development")
    run.add_argument("--instances", type=int, default=8)
    run.add_argument("--first", type=int, default=0)
    run.add_argument("--recordings", type=int, default=5, help="healthy ones")
    run.add_argument("--model-error", type=float, default=0.05, help="of each parameter, relative")
    run.add_argument(
        "--lacking", action="store_true", help="give each robot an effect that its model lacks"
    )
    run.add_argument("-o", "--out", type=Path, required=True)
    parts.add_parser("table").add_argument("out", type=Path)
    given = parser.parse_args()
    if given.what == "table":
        print(table(given.out))
        return
    given.out.mkdir(parents=True, exist_ok=True)
    conditions = Conditions(given.recordings, given.model_error, given.lacking)
    for number in range(given.first, given.first + given.instances):
        run_instance(given.seeds, number, conditions, given.out)


if __name__ == "__main__":
    main()

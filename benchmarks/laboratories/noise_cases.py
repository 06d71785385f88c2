"""24 short cases for work on noise: PUMA 560, simulator of `sealed`, three kinds of noise.

Motions of 3 x 3.5 s at 250 Hz, with and without a twin, and three other motions to score on.

    python -m laboratories.noise_cases DIR       # in the folder benchmarks
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Parallel, delayed
from laboratories.files import write_case, write_truth
from laboratories.noise import TorqueNoise, draw_noise
from sealed.effects import Context, Effect, context
from sealed.limits import torque_of
from sealed.motions import protocol
from sealed.physics import SAMPLE_PERIOD
from sealed.recording import draw_temperatures
from sealed.robots import random_robot

ROBOT = "puma560"
STEP = 2e-4
QUADRATURE = 4
COUNTS = np.array([1000, 800, 1000, 1000, 1000, 500])
"""Encoder lines a motor turn."""
NOISES = (("constant",), ("by_motion",), ("by_speed", "by_load"))
LEVELS = (0.005, 0.01, 0.02)
SEED = 1

# effect, axis, severity in the unit of the catalogue (ripple: share of Coulomb friction), details;
# None: that many times the limit of a matched filter with a twin
SINGLES: dict[str, tuple[tuple[str, int, float | None, float], ...]] = {
    "twin": (
        ("friction_wear", 2, 0.10, 0.0),
        ("backlash", 3, None, 5.0),
        ("viscous_friction", 1, None, 5.0),
        ("payload_mass", 6, 0.10, 0.0),
        ("torque_ripple", 4, 0.10, 0.0),
        ("gear_stiffness", 2, None, 5.0),
    ),
    "alone": (
        ("friction_wear", 1, 0.40, 0.0),
        ("payload_mass", 6, 0.50, 0.0),
        ("coulomb_friction", 4, 0.40, 0.0),
        ("backlash", 2, 1e-3, 0.0),
        ("delay", 3, 4e-3, 0.0),
        ("torque_offset", 5, None, 40.0),
    ),
}
UNLISTED = {
    "twin": (("acceleration_friction", 2), ("periodic_friction", 3), ("servo_gain", 1)),
    "alone": (("torque_lowpass", 2), ("servo_gain", 3), ("acceleration_friction", 1)),
}
UNLISTED_SEVERITY = {"servo_gain": 0.5, "torque_lowpass": 0.02}
DETECTED = 4.0
"""d' of the limit."""


@lru_cache
def _first() -> Context:
    """The nominal robot on the first three motions."""
    where = context(ROBOT)
    return replace(where, points=where.points[:3], runs=where.runs[:3])


def _record(
    effects: list[Effect], physics: Any, noise: TorqueNoise, where: Context, seed: int
) -> list[dict[str, np.ndarray]]:
    """Simulate motions and measure them.

    Args:
        effects: What is in the robot.
        physics: The robot.
        noise: Of the torque.
        where: The motions.
        seed: Of temperature, noise and bursts.

    Returns:
        A recording of each three motions.
    """
    rng = np.random.default_rng(seed)
    temperatures = draw_temperatures([len(run) for run in where.runs], rng)
    runs, torque = torque_of(effects, physics, where, temperatures, step=STEP, seed=seed)
    recordings = []
    for start in range(0, len(runs), 3):
        motions = range(start, start + 3)
        recordings.append(_measure(runs, torque, temperatures, noise, motions, rng))
    return recordings


def _measure(
    runs: list[np.ndarray],
    torque: list[np.ndarray],
    temperatures: list[np.ndarray],
    noise: TorqueNoise,
    motions: range,
    rng: np.random.Generator,
) -> dict[str, np.ndarray]:
    """Measure some motions, by the names of docs/measured.md."""
    count = 2 * np.pi / (QUADRATURE * COUNTS)
    arrays: dict[str, list[np.ndarray]] = {}
    for motion in motions:
        run = runs[motion]
        position = np.round(run[:, :, 0] / count) * count
        scale = noise.scale(torque[motion], run[:, :, 1], motion)
        parts = {
            "motor_position": position,
            "motor_velocity": np.gradient(position, SAMPLE_PERIOD, axis=0),
            "motor_torque": noise.logged(torque[motion] + noise.sample(scale, rng)),
            "reference_position": protocol(ROBOT)[motion].sampled,
            "temperature": temperatures[motion],
        }
        for name, values in parts.items():
            arrays.setdefault(name, []).append(values)
    starts = np.cumsum([0, *[len(part) for part in arrays["temperature"][:-1]]])
    return {name: np.concatenate(parts) for name, parts in arrays.items()} | {"segments": starts}


def _still() -> list[np.ndarray]:
    return [np.full(len(run), 40.0) for run in _first().runs]


@lru_cache
def _nominal() -> list[np.ndarray]:
    where = _first()
    return torque_of([], where.nominal, where, _still(), step=STEP)[0]


def _unit_d_prime(effect: Effect, noise: TorqueNoise) -> float:
    """Compute d' of an effect on the first three motions of the nominal robot, with a twin."""
    where, base = _first(), _nominal()
    _, seen = torque_of([effect], where.nominal, where, _still(), step=STEP)
    total = 0.0
    for motion in range(3):
        scale = noise.scale(base[motion][:, :, 2], base[motion][:, :, 1], motion)
        change = seen[motion] - base[motion][:, :, 2]
        total += float(np.sum(noise.whitened(change, scale) ** 2)) / 2
    return float(np.sqrt(total))


def plan() -> list[dict[str, Any]]:
    """Draw the 24 cases, without what depends on the simulation."""
    cases: list[dict[str, Any]] = []
    for mode in ("twin", "alone"):
        for number, kinds in enumerate(NOISES):
            singles = SINGLES[mode][2 * number : 2 * number + 2]
            parts: list[tuple[str, Any]] = [("healthy", None)]
            parts += [("single", single) for single in singles]
            parts.append(("unlisted", UNLISTED[mode][number]))
            for k, (kind, what) in enumerate(parts):
                factors = {
                    "noise": kinds[k % len(kinds)],
                    "level": LEVELS[(k + number) % 3],
                    "simulator": "sealed",
                    "robot": ROBOT,
                }
                cases.append({"mode": mode, "kind": kind, "what": what, "factors": factors})
    order = np.random.default_rng(SEED).permutation(len(cases))
    return [
        cases[k] | {"name": f"case_{n + 1:02d}", "seed": SEED * 1000 + n}
        for n, k in enumerate(order)
    ]


def make(case: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Simulate a case, write its files and return its truth."""
    where, rng = context(ROBOT), np.random.default_rng(case["seed"])
    physics = random_robot(where.nominal, rng)
    runs = np.concatenate(where.runs)
    noise = draw_noise(
        case["factors"]["noise"],
        case["factors"]["level"],
        runs[:, :, 2],
        runs[:, :, 1],
        n_motions=len(where.runs),
        sample_period=SAMPLE_PERIOD,
        limit=where.nominal.column("LIMIT"),
        rng=rng,
    )
    effects: list[Effect] = []
    multiple = None
    if case["kind"] != "healthy":
        name, axis = case["what"][:2]
        details = {"order": 4.0, "phase": 1.0} if name == "torque_ripple" else {}
        details |= {"at": 0.4, "seed": 3.0} if case["kind"] == "unlisted" else {}
        friction = float(where.nominal.column("FC")[axis - 1])
        if case["kind"] == "unlisted":
            severity = UNLISTED_SEVERITY.get(name, 0.3 * friction)
        elif case["what"][2] is not None:
            severity = case["what"][2] * (friction if name == "torque_ripple" else 1.0)
        else:
            severity = {"backlash": 5e-5, "torque_offset": 0.02 * friction}.get(name, 0.05)
            for _ in range(2):
                found = _unit_d_prime(Effect(name, axis, severity, details), noise)
                severity *= case["what"][3] * DETECTED / found
        effects = [Effect(name, axis, float(severity), details)]
        multiple = _unit_d_prime(effects[0], noise) / DETECTED
    seeds = [int(seed) for seed in rng.integers(2**31, size=2)]
    measured, validate = _record(effects, physics, noise, where, seeds[0])
    files = {"measured": measured, "validate": validate}
    if case["mode"] == "twin":
        (files["healthy"],) = _record([], physics, noise, _first(), seeds[1])
    write_case(folder / case["name"], ROBOT, SAMPLE_PERIOD, files, case["mode"])
    return {
        "name": case["name"],
        "mode": case["mode"],
        "kind": case["kind"],
        "robot": ROBOT,
        "effects": [vars(effect) for effect in effects],
        "multiple_of_twin_limit": multiple,
        "factors": case["factors"] | {"by_motion": noise.by_motion[:3].round(3).tolist()},
    }


def main() -> None:
    """Write all cases."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("cases", nargs="*", help="names such as case_03; default: all")
    given = parser.parse_args()
    folder = given.folder
    from laboratories.noise_cases import make as imported  # processes cannot read __main__

    made = Parallel(n_jobs=2, return_as="generator")(
        delayed(imported)(case, folder / "cases")
        for case in plan()
        if not given.cases or case["name"] in given.cases
    )
    truth = []
    for case in made:
        print(case["name"], case["mode"], case["effects"], flush=True)
        truth.append(case)
        write_truth(truth, folder / "truth.json")


if __name__ == "__main__":
    main()

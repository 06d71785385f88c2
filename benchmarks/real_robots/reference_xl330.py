"""Which friction the XL330 pendulum needs: closed-loop simulation, independent of MuJoCo.

    python -m benchmarks.real_robots.reference_xl330 --data ../shared/data/measured
        [--models M1 M3 ...]

The firmware's law drives a pendulum; parameters are fitted to the position of the runs with gains
100, 200 and 800 by an evolution strategy (CMA-ES) on the mean absolute error over whole runs, and
scored once on gain 400. Choice: the same with one of the three training gains held out. Friction
models by the names of BAM; needs numba.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numba
import numpy as np
from real_robots.measured_data import XL330_COUNTS, xl330_runs

STEP = 5e-4
"""Step of the simulation [s]."""
MASS, LENGTH, GRAVITY = 0.49, 0.1, 9.81
TEST_GAIN = 400

RANGES = {
    "kt": (0.15, 0.6),  # N m/A
    "resistance": (1.0, 9.0),  # ohm
    "armature": (1e-4, 0.01),  # kg m^2
    "offset": (-0.1, 0.1),  # of the angle [rad]
    "delay": (0.0, 0.05),  # of the goal [s]
    "arm": (0.0, 0.06),  # mass of the arm [kg]
    "coulomb": (0.0, 0.1),  # N m
    "viscous": (0.0, 0.05),  # N m s/rad
    "stribeck": (0.0, 0.1),  # N m
    "stribeck_velocity": (0.02, 2.0),  # rad/s
    "exponent": (0.5, 4.0),
    "load": (0.0, 0.5),  # share of the load; of the motor's torque if directional
    "load_stribeck": (0.0, 1.0),
    "external": (0.0, 0.5),
    "external_stribeck": (0.0, 1.0),
    "motor_quadratic": (0.0, 0.5),  # 1/(N m)
    "external_quadratic": (0.0, 0.5),
}
"""Range of each parameter, joint side."""
NAMES = tuple(RANGES)
START = {"kt": 0.3867, "resistance": 4.017, "armature": 0.00181, "coulomb": 0.0128}
START |= {"viscous": 0.00366, "stribeck_velocity": 0.13, "exponent": 2.0}
"""Published M1, and a usual Stribeck curve; the rest is 0."""

PLAIN = ("kt", "resistance", "armature", "offset", "delay", "arm", "coulomb", "viscous")
CURVE = ("stribeck_velocity", "exponent")
MODELS: dict[str, tuple[str, ...]] = {
    "M1": PLAIN,
    "M2": (*PLAIN, "stribeck", *CURVE),
    "M3": (*PLAIN, "load"),
    "M4": (*PLAIN, "stribeck", *CURVE, "load", "load_stribeck"),
    "M4, exponent 2, load only": (*PLAIN, "stribeck_velocity", "load", "load_stribeck"),
    "M6": (*PLAIN, "stribeck", *CURVE, *NAMES[11:]),
}


@dataclass(frozen=True)
class Log:
    """One run on the grid of the simulation."""

    gain: float
    goal: np.ndarray
    volts: np.ndarray
    enabled: np.ndarray
    position: np.ndarray
    sample: np.ndarray
    """Step of each measured sample."""


def read_logs(folder: Path) -> list[Log]:
    """All runs of the XL330."""
    logs = []
    for name, row in xl330_runs(folder).items():
        table = np.loadtxt(folder / f"{name}.csv", delimiter=",", skiprows=1)
        measured = table[:, 0] - table[0, 0]
        grid = np.arange(0, measured[-1], STEP)
        held = np.clip(np.searchsorted(measured, grid, side="right") - 1, 0, None)
        goal, volts = (np.interp(grid, measured, table[:, column]) for column in (1, 5))
        sample = np.minimum(np.round(measured / STEP).astype(int), len(grid) - 1)
        logs.append(Log(float(row["kp"]), goal, volts, table[held, 7], table[:, 2], sample))
    return logs


@numba.njit(fastmath=True)
def simulate(p, directional, gain, goal, volts, enabled, start, out):  # type: ignore # noqa: D103
    kt, resistance, armature, offset, delay, arm = p[:6]
    coulomb, viscous, stribeck, slow, exponent = p[6:11]
    load, load_s, external, external_s, motor_q, external_q = p[11:]
    inertia = MASS * LENGTH**2 + armature + arm * LENGTH**2 / 3
    weight = (MASS + arm / 2) * GRAVITY * LENGTH
    late = int(delay / STEP)
    part = delay / STEP - late
    q, v = start, 0.0
    for k in range(len(goal)):
        out[k] = q
        now, before = max(k - late, 0), max(k - late - 1, 0)
        duty = gain * (goal[now] * (1 - part) + goal[before] * part - q)
        duty = min(max(duty, -1.0), 1.0)
        motor = kt / resistance * (duty * volts[k] - kt * v) if enabled[k] > 0.5 else 0.0
        pull = -weight * np.sin(q + offset)
        share = np.exp(-((abs(v) / slow) ** exponent))
        friction = coulomb + share * stribeck + viscous * abs(v)
        if directional:
            friction += abs(pull * external - motor * load)
            friction += share * abs(pull * external_s - motor * load_s)
            if pull * motor < 0 and abs(pull) < abs(motor):
                friction += share * external_q * pull * pull
            elif pull * motor < 0:
                friction += share * motor_q * motor * motor
        else:
            friction += (load + share * load_s) * abs(pull - motor)
        v += STEP * (motor + pull) / inertia
        most = STEP * friction / inertia
        v = v - most if v > most else v + most if v < -most else 0.0
        q += STEP * v


def position_error(values: dict[str, float], directional: bool, logs: Sequence[Log]) -> float:
    """Compute the mean absolute position error over the runs.

    Args:
        values: Parameters by name.
        directional: Whether load friction depends on the direction.
        logs: The runs.

    Returns:
        The error [rad].
    """
    vector = np.array([values[name] for name in NAMES])
    errors = []
    for log in logs:
        out = np.empty(len(log.goal))
        gain = log.gain * XL330_COUNTS
        start = log.position[0]
        simulate(vector, directional, gain, log.goal, log.volts, log.enabled, start, out)
        errors.append(np.abs(out[log.sample] - log.position).mean())
    return float(np.mean(errors))


def evolve(
    cost: Callable[[np.ndarray], float], start: np.ndarray, seconds: float, seed: int
) -> np.ndarray:
    """Minimise by CMA-ES (Hansen) in the unit cube, with reflection at its faces.

    Args:
        cost: Function that is minimised.
        start: First point in the unit cube, shape (parameters,).
        seconds: Time limit [s].
        seed: Seed of the search.

    Returns:
        The best point, shape (parameters,), without unit.
    """
    rng = np.random.default_rng(seed)
    n = len(start)
    many = 4 + int(3 * np.log(n))
    weight = np.log(many // 2 + 0.5) - np.log(np.arange(1, many // 2 + 1))
    weight /= weight.sum()
    mass = 1 / (weight**2).sum()
    cs = (mass + 2) / (n + mass + 5)
    cc = (4 + mass / n) / (n + 4 + 2 * mass / n)
    c1 = 2 / ((n + 1.3) ** 2 + mass)
    cm = min(1 - c1, 2 * (mass - 2 + 1 / mass) / ((n + 2) ** 2 + mass))
    damping = 1 + 2 * max(0.0, np.sqrt((mass - 1) / (n + 1)) - 1) + cs
    usual = np.sqrt(n) * (1 - 1 / (4 * n) + 1 / (21 * n * n))
    mean, size, covariance = start.copy(), 0.15, np.eye(n)
    step_path, path = np.zeros(n), np.zeros(n)
    best, best_cost = start.copy(), cost(start)
    end = time.monotonic() + seconds
    while time.monotonic() < end and size > 1e-4:
        scale, turn = np.linalg.eigh(covariance)
        root = np.sqrt(np.maximum(scale, 1e-20))
        trial = mean + size * rng.normal(size=(many, n)) @ (turn * root).T
        trial = np.abs(trial) % 2
        trial = np.where(trial > 1, 2 - trial, trial)
        costs = np.array([cost(x) for x in trial])
        order = np.argsort(costs)[: many // 2]
        if costs[order[0]] < best_cost:
            best, best_cost = trial[order[0]].copy(), costs[order[0]]
        steps = (trial[order] - mean) / size
        move = weight @ steps
        mean = mean + size * move
        whitened = turn @ ((turn.T @ move) / root)
        step_path = (1 - cs) * step_path + np.sqrt(cs * (2 - cs) * mass) * whitened
        path = (1 - cc) * path + np.sqrt(cc * (2 - cc) * mass) * move
        covariance = (1 - c1 - cm) * covariance + c1 * np.outer(path, path)
        covariance += cm * (steps.T * weight) @ steps
        size = min(size * np.exp(cs / damping * (np.linalg.norm(step_path) / usual - 1)), 0.5)
    return best


def fit(model: str, logs: Sequence[Log], seconds: float, seed: int) -> dict[str, float]:
    """Fit the parameters of a friction model to some runs.

    Args:
        model: Name of the friction model.
        logs: The runs.
        seconds: Time limit [s].
        seed: Seed of the search.

    Returns:
        The parameters by name.
    """
    free = MODELS[model]
    fixed = dict.fromkeys(NAMES, 0.0) | START
    low, high = np.array([RANGES[name] for name in free]).T
    start = np.clip((np.array([fixed[name] for name in free]) - low) / (high - low), 0.03, 0.97)

    def values(x: np.ndarray) -> dict[str, float]:
        return fixed | dict(zip(free, (low + x * (high - low)).tolist(), strict=True))

    def cost(x: np.ndarray) -> float:
        return position_error(values(x), model == "M6", logs)

    return values(evolve(cost, start, seconds, seed))


def main() -> None:
    """Print the table of models."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--models", nargs="*", default=list(MODELS))
    parser.add_argument("--seconds", type=float, default=10.0, help="of each fit")
    parser.add_argument("--seeds", type=int, default=3)
    args = parser.parse_args()
    logs = read_logs(args.data / "bam_xl330")
    train = [log for log in logs if log.gain != TEST_GAIN]
    test = [log for log in logs if log.gain == TEST_GAIN]
    print("| model | parameters | gain held out | train | test, each start | parameters |")
    print("| --- | --- | --- | --- | --- | --- |")
    for model in args.models:
        directional = model == "M6"
        held = []
        for gain in (100, 200, 800):
            rest = [log for log in train if log.gain != gain]
            values = fit(model, rest, args.seconds, 0)
            left = [log for log in train if log.gain == gain]
            held.append(position_error(values, directional, left))
        found = [fit(model, train, args.seconds, seed) for seed in range(args.seeds)]
        found.sort(key=lambda values: position_error(values, directional, train))
        scores = ", ".join(f"{position_error(v, directional, test):.4f}" for v in found)
        trained = position_error(found[0], directional, train)
        shown = ", ".join(f"{name} {found[0][name]:.3g}" for name in MODELS[model])
        row = f"{model} | {len(MODELS[model])} | {np.mean(held):.4f} | {trained:.4f} | {scores}"
        print(f"| {row} | {shown} |", flush=True)


if __name__ == "__main__":
    main()

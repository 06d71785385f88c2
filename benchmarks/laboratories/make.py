"""Making cases: a laboratory is set up once, then each of its cases is simulated and written.

for entry in make_laboratory(lab, folder):
    print(entry["name"], entry["effects"])
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from laboratories.draw import Laboratory, Plan, draw_cases
from laboratories.effects import Effect, apply, axes_of, logged_torque, temperature_factors
from laboratories.files import write_case
from laboratories.oracle import DETECTED, Oracle
from laboratories.plant import GRID
from laboratories.robots import (
    OWN,
    STILL,
    robot_file,
    sample_times,
    sampled,
    simulate,
    with_worn_forward,
)
from laboratories.setup import Setup, beside, set_up

_TEMPERATURES = (30.0, 55.0)
_QUADRATURE = 4
COMMON_SHARE, OWN_SHARE = 0.8, 0.6  # of differences between runs: of all axes together, of each


@dataclass(frozen=True)
class Session:
    """What is particular to the recordings of one day."""

    friction: np.ndarray
    """Factor of friction, shape (n_axes,)."""
    temperatures: np.ndarray
    """Of each motion [deg C]."""
    drift: np.ndarray
    """Of a torque offset, factor of each motion."""


def draw_session(setup: Setup, rng: np.random.Generator) -> Session:
    """Draw what is particular to a day: friction, temperatures."""
    n, count = setup.lab.machine.n_axes, len(setup.motions)
    spread = setup.lab.factors["repeat"]
    change = spread * (COMMON_SHARE * rng.standard_normal() + OWN_SHARE * rng.standard_normal(n))
    low, high = _TEMPERATURES
    place = (np.arange(count) + rng.uniform(0, 1, count)) / count
    temperatures = low + (high - low) * rng.permutation(place)
    if not setup.lab.factors["temperature"]:
        temperatures = np.full(count, 40.0)
    return Session(np.maximum(1 + change, 0.3), temperatures, rng.uniform(0.9, 1.1, count))


def slow_rows(session: Session, motion: int, effects: Sequence[Effect] = ()) -> np.ndarray:
    """Row of each axis that is fixed for a motion, see `plant.integrate`."""
    slow = np.tile(STILL, (len(session.friction), 1))
    slow[:, :3] *= session.friction[:, None]
    slow[:, 4] = session.drift[motion]
    for effect in effects:
        if effect.name == "temperature_friction":
            factors = temperature_factors(float(session.temperatures[motion]), effect.severity)
            slow[effect.axis - 1, :4] *= factors
    return slow


def record(
    setup: Setup,
    effects: Sequence[Effect],
    session: Session,
    motions: range,
    rng: np.random.Generator,
) -> tuple[dict[str, np.ndarray], float]:
    """Simulate motions with effects and measure them.

    Args:
        setup: The laboratory.
        effects: What is in the robot.
        session: The day.
        motions: Numbers of the motions.
        rng: Source of randomness, of the noise.

    Returns:
        The arrays of docs/measured.md with `segments` and the true `time`, and the gap that noise
        alone would leave.
    """
    factors, period = setup.lab.factors, setup.period
    plant = setup.robot
    for effect in effects:
        plant = apply(effect, plant, setup.lab.machine)
    count = 2 * np.pi / (_QUADRATURE * setup.lab.machine.counts)
    arrays: dict[str, list[np.ndarray]] = {}
    errors, torques = [], []
    for motion in motions:
        slow, points = slow_rows(session, motion, effects), setup.points[motion]
        if factors["feed_forward"] == "worn":
            points = with_worn_forward(points, setup.lab.machine, plant, slow)
        run = simulate(plant, points, slow)
        times = sample_times(len(setup.points[motion]), period)
        samples = len(times)
        if factors["jitter"]:
            late = factors["jitter"] * period * rng.standard_normal(samples)
            times = np.maximum.accumulate(np.maximum(times + late, 0))
        seen = sampled(run, times)
        position = np.round(seen[:, :, 0] / count) * count
        clean = logged_torque(effects, seen[:, :, 2], period)
        scale = setup.noise.scale(clean, seen[:, :, 1], motion)
        noisy = setup.noise.logged(clean + setup.noise.sample(scale, rng))
        errors.append(setup.gain * (noisy - clean))
        torques.append(setup.gain * noisy + setup.zero)
        reference = setup.motions[motion].q
        x = np.clip(times / GRID, 0, len(reference) - 1.000001)
        k = x.astype(int)
        f = (x - k)[:, None]
        parts = {
            "time": times,
            "motor_position": position,
            "motor_velocity": np.gradient(position, period, axis=0),
            "motor_torque": torques[-1],
        }
        if factors["reference"]:
            parts["reference_position"] = reference[k] * (1 - f) + reference[k + 1] * f
        if factors["temperature"]:
            warm = session.temperatures[motion] + 0.05 * rng.standard_normal(samples)
            parts["temperature"] = warm
        for name, values in parts.items():
            arrays.setdefault(name, []).append(values)
    starts = np.cumsum([0, *[len(part) for part in arrays["motor_torque"][:-1]]])
    merged = {name: np.concatenate(parts) for name, parts in arrays.items()}
    error, torque = np.concatenate(errors), np.concatenate(torques)
    floor = float(np.sqrt(np.mean((error**2).mean(axis=0) / (torque**2).mean(axis=0))))
    return merged | {"segments": starts}, floor


def without_friction(text: str) -> str:
    """The text of an MJCF whose friction is a hundredth of what it was."""

    def less(match: re.Match[str]) -> str:
        element = match.group(0)
        s0, s1, coulomb, _, speed = re.search(r'lugre="([^"]*)"', element).group(1).split()  # type: ignore[union-attr]
        values = (float(s0), float(s1), float(coulomb), float(coulomb))
        lugre = " ".join(f"{0.01 * value:.6g}" for value in values)
        element = re.sub(r'lugre="[^"]*"', f'lugre="{lugre} {speed}"', element)
        damping = float(re.search(r'damping="([^"]*)"', element).group(1))  # type: ignore[union-attr]
        return re.sub(r'damping="[^"]*"', f'damping="{0.01 * damping:.6g}"', element)

    return re.sub(r'<dcmotor name="friction\d+"[^>]*>', less, text)


def model_for(lab: Laboratory, folder: Path) -> str:
    """What discovery is told as the robot: a name, or a file that is written to the folder."""
    name = lab.factors["robot"]
    missing = lab.factors["model_friction"] == "missing"
    if not missing and not (OWN / f"{name}.xml").is_file():
        return str(name)
    text = robot_file(name).read_text()
    own = folder / "robots" / ("without_friction" if missing else "as_built")
    own.mkdir(parents=True, exist_ok=True)
    (own / f"{name}.xml").write_text(without_friction(text) if missing else text)
    return f"../../robots/{own.name}/{name}.xml"


def found_effect(plan: Plan, oracle: Oracle) -> Effect:
    """The effect of a case, with the severity that it should have.

    An effect whose multiple of the limit is beyond what is sensible moves to another axis, and
    becomes another one, `position_friction` or `viscous_friction`, if that axis is no better.

    Args:
        plan: The case.
        oracle: Of the laboratory.
    """
    details = {"order": float(plan.order), "phase": plan.phase} if plan.order else {}
    if plan.severity is not None:
        return Effect(plan.effect, plan.axis, plan.severity, details)
    assert plan.multiple is not None
    n = oracle.lab.machine.n_axes
    others = [axis for axis in axes_of(plan.effect, n) if axis != plan.axis]
    tries = [(plan.effect, axis) for axis in (plan.axis, *others[:1])]
    last = "position_friction" if plan.kind == "unlisted" else "viscous_friction"
    for name, axis in (*tries, (last, plan.axis)):
        effect = oracle.at_multiple(Effect(name, axis, 1.0, details), plan.multiple, plan.limit_of)
        if oracle.d_prime(effect, plan.limit_of) > 0.5 * plan.multiple * DETECTED:
            break
    return effect


def record_case(
    setup: Setup, effects: Sequence[Effect], robot: str, folder: Path, rng: np.random.Generator
) -> float:
    """Record a case and its twin on two days, and write the files.

    Args:
        setup: The laboratory.
        effects: What is in the robot.
        robot: From `model_for`.
        folder: Folder of the case.
        rng: Source of randomness.

    Returns:
        The gap that noise alone would leave on the motions for the score.
    """
    inside = range(setup.n_measured)
    beyond = range(setup.n_measured, len(setup.motions))
    after, before = draw_session(setup, rng), draw_session(setup, rng)
    measured, _ = record(setup, effects, after, inside, rng)
    validate, floor = record(setup, effects, after, beyond, rng)
    healthy, _ = record(setup, [], before, inside, rng)
    files = {"measured": measured, "validate": validate, "healthy": healthy}
    known = setup.lab.factors["times"] == "known"
    write_case(folder, robot, None if known else setup.period, files, "both")
    return floor


def make_laboratory(lab: Laboratory, folder: Path) -> list[dict[str, Any]]:
    """Simulate a laboratory and write its cases.

    Args:
        lab: The laboratory.
        folder: Where cases/ goes.

    Returns:
        The truth: two entries for each case, with and without a twin.
    """
    setup = set_up(lab)
    points = setup.points[: setup.n_measured]
    oracle = Oracle(setup.ideal, setup.robot, points, setup.noise, setup.period, lab)
    robot = model_for(lab, folder)
    entries: list[dict[str, Any]] = []
    for number, plan in enumerate(draw_cases(lab)):
        rng = np.random.default_rng([lab.seed, 6, number])
        effects = [] if plan.kind == "healthy" else [found_effect(plan, oracle)]
        floor = record_case(setup, effects, robot, folder / "cases" / plan.name, rng)
        for mode in ("twin", "alone"):
            if mode == "alone" and lab.factors["model_friction"] == "missing":
                continue  # friction of all axes is missing then, beside the effect
            found = oracle.d_prime(effects[0], mode) if effects else None
            apart = oracle.separation(effects[0], mode) if plan.kind == "single" else None
            entries.append(
                {
                    "name": f"{plan.name}_{mode}",
                    "folder": plan.name,
                    "mode": mode,
                    "kind": plan.kind,
                    "robot": lab.factors["robot"],
                    "effects": [vars(effect) for effect in effects],
                    "d_prime": found,
                    "separation": apart,
                    "floor": floor,
                    "beside": beside(lab, mode),
                    "stressed": list(lab.stressed),
                    "factors": lab.factors | {"possible_bandwidth": round(setup.bandwidth, 2)},
                }
            )
    return entries

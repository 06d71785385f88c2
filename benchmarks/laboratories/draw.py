"""Which laboratories and cases there are: factors, effects, severities.

lab = draw_laboratory("development", number=3)
cases = draw_cases(lab)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from laboratories.effects import CATALOGUE, ORDERS, UNLISTED, WAVES, axes_of
from laboratories.mjcf import Machine
from laboratories.motions import MOTIONS
from laboratories.noise import KINDS, REAL
from laboratories.robots import ROBOTS, machine_of
from laboratories.servo import SERVOS

SEEDS = {
    "development": 1,
    "report": 500_000,
    "development2": 1_000_000,
    "report2": 2_000_000,
    "report3": 3_000_000,
    "report4": 4_000_000,
    "report5": 5_000_000,
    "report6": 6_000_000,
    "report7": 7_000_000,
    "report8": 8_000_000,
}
"""First seed of each set. What is tuned is tuned on development seeds; each report laboratory is
for one frozen run."""
FIRST_SETS = ("development", "report")
"""Sets that are drawn without what was added later: `ADDED`, real noise, loads on other links."""
LEVELS: dict[str, tuple[Any, ...]] = {
    "robot": ROBOTS,
    "servo": SERVOS,
    "bandwidth": (4.0, 7.0, 12.0, 20.0),
    "servo_period": (0.25e-3, 0.5e-3, 1e-3, 2e-3, 4e-3),
    "rate": (100, 200, 250, 500, 1000),
    "jitter": (0.0, 0.02, 0.1),
    "motion": (*MOTIONS, "mixed"),
    "seconds": (5.0, 10.0, 25.0, 60.0),
    "segments": (1, 2, 4, 8),
    "noise": (*KINDS, REAL),
    "level": (0.002, 0.005, 0.01, 0.03),
    "reference": (True, False),
    "torque": ("torque", "current"),
    "temperature": (True, False),
    "model_error": (0.005, 0.02, 0.05, 0.1),
    "repeat": (0.001, 0.01, 0.05, 0.15),
    "model_friction": ("given", "missing"),
    "log_gain": ("right", "robot", "axes"),
    "times": ("unknown", "known"),
    "feed_forward": ("model", "worn"),
}
"""Factors and their levels."""
BASE: dict[str, Any] = {
    "servo": "model",
    "bandwidth": 12.0,
    "servo_period": 0.5e-3,
    "rate": 250,
    "jitter": 0.0,
    "motion": "mixed",
    "seconds": 10.0,
    "segments": 2,
    "noise": "constant",
    "level": 0.005,
    "reference": True,
    "torque": "torque",
    "temperature": False,
    "model_error": 0.02,
    "repeat": 0.001,
    "model_friction": "given",
    "log_gain": "right",
    "times": "unknown",
    "feed_forward": "model",
}
"""An easy laboratory: two of three have one or two factors at another level, one is all random."""
ADDED = ("log_gain", "times", "feed_forward")
"""Factors that the first sets do not have."""
_SHARE_RANDOM = 1 / 3
_ROBOTS = ("puma560", "scara4", "irb6700", "puma560", "arm7", "lift1")  # in turn
CASES = 4
"""Cases of a laboratory: healthy, two effects of the catalogue, and one more or an unlisted one."""
PLANT_UNITS: dict[str, tuple[float, ...]] = {
    "friction_wear": (0.05, 0.1, 0.2, 0.4),
    "coulomb_friction": (0.05, 0.1, 0.2, 0.4),
    "viscous_friction": (0.1, 0.2, 0.4),
    "backlash": (0.05e-3, 0.2e-3, 1e-3),
    "gear_stiffness": (0.1, 0.2, 0.4),
    "torque_ripple": (0.02, 0.05, 0.1),  # share of the axis' Coulomb friction
    "payload_mass": (0.02, 0.1, 0.5),
    "delay": (1e-3, 4e-3),
}
"""Severities that an engineer would state."""
MULTIPLES = (2.0, 5.0)
"""Severities over the limit of a matched filter, with a twin or without one by chance."""
UNLISTED_MULTIPLE = 5.0
"""Of the limit without a twin."""


@dataclass(frozen=True)
class Laboratory:
    """One laboratory: a robot, its servo, motions, sensors, and what its model knows."""

    seeds: str
    number: int
    factors: dict[str, Any]
    stressed: tuple[str, ...]
    """Factors that are not at their base level; 'all' where all were drawn."""

    @property
    def name(self) -> str:
        """Name, which tells nothing."""
        return f"lab{self.number:03d}"

    @property
    def seed(self) -> int:
        """Seed of everything in it."""
        return SEEDS[self.seeds] + self.number

    @property
    def machine(self) -> Machine:
        """The nominal robot."""
        return machine_of(self.factors["robot"])

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


@dataclass(frozen=True)
class Plan:
    """One case before it is simulated. The severity may still have to be found."""

    name: str
    kind: str
    """'healthy', 'single' or 'unlisted'."""
    effect: str = ""
    axis: int = 0
    order: int = 0
    phase: float = 0.0
    severity: float | None = None
    """In the unit of the catalogue; None: `multiple` times the limit."""
    multiple: float | None = None
    limit_of: str = "twin"
    """Mode of this limit."""


def draw_laboratory(
    seeds: str, number: int, forced: Mapping[str, Any] | None = None, quick: bool = True
) -> Laboratory:
    """Draw a laboratory.

    Args:
        seeds: Of `SEEDS`.
        number: Number of the laboratory, from 0.
        forced: Levels of factors that it must have.
        quick: Without recordings of 60 s, on which discovery takes many minutes.

    Returns:
        The laboratory.
    """
    rng = np.random.default_rng([SEEDS[seeds] + number, 1])
    factors = {"robot": _ROBOTS[number % len(_ROBOTS)], **BASE}
    first = seeds in FIRST_SETS
    free = [n for n in BASE if n not in (forced or {}) and not (first and n in ADDED)]
    levels = LEVELS | ({"noise": KINDS} if first else {})
    if (number + 1) % round(1 / _SHARE_RANDOM) == 0:
        stressed = ["all"]
        for name in free:
            factors[name] = _pick(name, levels[name], rng, quick)
    else:
        # each factor in turn, so that a few laboratories already cover them
        turn = np.random.default_rng([SEEDS[seeds], 2]).permutation(len(free))
        stressed = [free[turn[number % len(free)]]]
        if not first:
            # what was added comes first, then real noise
            order = [name for name in (*ADDED, "noise") if name in free]
            order += [free[k] for k in turn if free[k] not in order]
            place = number - (number + 1) // round(1 / _SHARE_RANDOM)
            stressed = [order[place % len(order)]]
            if stressed == ["noise"]:
                levels["noise"] = (REAL,)
        if rng.uniform() < 0.3:
            stressed.append(free[int(rng.integers(len(free)))])
        for name in dict.fromkeys(stressed):
            others = tuple(level for level in levels[name] if level != BASE[name])
            factors[name] = _pick(name, others, rng, quick)
    factors |= dict(forced or {})
    if "bandwidth" in stressed and factors["servo"] == "model":
        factors["servo"] = "cascade_ff"  # the model's own gains have no bandwidth to choose
    if "feed_forward" in stressed and factors["servo"] in ("pd", "cascade"):
        factors["servo"] += "_ff"
    if "times" in stressed and not factors["jitter"]:
        factors["jitter"] = 0.1  # without jitter there is nothing to know
    # at least 2.5 s a segment
    factors["segments"] = min(factors["segments"], max(1, int(factors["seconds"] / 2.5)))
    return Laboratory(seeds, number, factors, tuple(dict.fromkeys(stressed)))


def _pick(name: str, levels: tuple[Any, ...], rng: np.random.Generator, quick: bool) -> Any:
    if name == "seconds" and quick:
        levels = tuple(level for level in levels if level <= 25)
    if name == "model_friction" and rng.uniform() < 0.5:
        return levels[0]  # the other level leaves only the cases with a twin
    return levels[int(rng.integers(len(levels)))]


def draw_cases(lab: Laboratory) -> list[Plan]:
    """Draw the cases of a laboratory.

    Args:
        lab: The laboratory.

    Returns:
        The cases, in random order.
    """
    rng = np.random.default_rng([lab.seed, 3])
    n = lab.machine.n_axes
    kinds = ["healthy", "single", "single", "unlisted" if lab.number % 2 else "single"]
    plans = []
    # effects in turn over the laboratories, in an order of the seeds
    order = np.random.default_rng([SEEDS[lab.seeds], 4]).permutation(len(CATALOGUE))
    start = sum(3 - k % 2 for k in range(lab.number))
    for place, kind in zip(rng.permutation(CASES), kinds, strict=True):
        name = f"{lab.name}_{place + 1}"
        if kind == "healthy":
            plans.append(Plan(name, kind))
            continue
        if kind == "unlisted":
            effect = UNLISTED[(lab.number // 2) % len(UNLISTED)]
            plans.append(_plan(name, kind, effect, UNLISTED_MULTIPLE, lab, rng))
            continue
        for _ in range(len(CATALOGUE)):
            effect = CATALOGUE[order[start % len(CATALOGUE)]]
            start += 1
            if axes_of(effect, n) and effect != "temperature_friction":
                break
        if len(plans) == 1 and lab.factors["temperature"] and lab.factors["segments"] > 1:
            effect = "temperature_friction"  # only these laboratories can have it
        many: float | None = MULTIPLES[int(rng.integers(len(MULTIPLES)))]
        if effect in PLANT_UNITS and rng.uniform() < 0.75:
            many = None
        plans.append(_plan(name, kind, effect, many, lab, rng))
    return sorted(plans, key=lambda plan: plan.name)


def effect_axes(lab: Laboratory, name: str) -> tuple[int, ...]:
    """Axes on which an effect may be in a laboratory; loads of the first sets are at the end."""
    n = lab.machine.n_axes
    if name.startswith("payload") and lab.seeds in FIRST_SETS:
        return (n,)
    return axes_of(name, n)


def _plan(
    name: str,
    kind: str,
    effect: str,
    multiple: float | None,
    lab: Laboratory,
    rng: np.random.Generator,
) -> Plan:
    axes = effect_axes(lab, effect)
    axis = axes[int(rng.integers(len(axes)))]
    severity = None
    if multiple is None:
        units = PLANT_UNITS[effect]
        severity = units[int(rng.integers(len(units)))]
        if effect == "torque_ripple":
            severity *= float(lab.machine.coulomb[axis - 1])
        if effect == "payload_mass" and axis < lab.machine.n_axes:
            severity *= float(lab.machine.payload[0])  # [kg] on another link
        if effect == "backlash" and lab.machine.kind[axis - 1] == 1:
            severity *= 0.1  # [m] of a slide
    order = ORDERS[int(rng.integers(len(ORDERS)))] if effect in WAVES else 0
    phase = float(rng.uniform(0, 2 * np.pi)) if effect in WAVES else 0.0
    missing = lab.factors["model_friction"] == "missing"
    alone = (kind == "unlisted" or rng.uniform() < 0.5) and not missing
    limit_of = "alone" if alone else "twin"
    return Plan(name, kind, effect, axis, order, phase, severity, multiple, limit_of)

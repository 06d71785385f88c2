"""Which cases there are: kinds, effects, axes, severities and noise, balanced by design.

plan = plan_cases("development", "twin", limits)  # 560 of them
few = sample(40, "development", "twin", limits)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from sealed.effects import CATALOGUE, Effect, axes_of
from sealed.limits import MODES, ORDERS, WAVES, Limits, combos
from sealed.recording import LEVELS
from sealed.unlisted import UNLISTED, catalogue_name

ROBOTS = ("puma560", "irb6700")
SEEDS = {
    "development": 71_000,
    "report": 94_000,
    "report2": 117_000,
    "report3": 140_000,
    "report4": 163_000,
    "report5": 186_000,
    "report6": 209_000,
    "report7": 232_000,
    "report8": 255_000,
    "report9": 278_000,
    "report10": 301_000,
    "report11": 331_000,
    "report12": 361_000,
    "report13": 391_000,
}
"""Sets of seeds: what is tuned is tuned on the first, and each of the others is run once."""
COUNTS = {"single": 240, "clean": 200, "unknown": 60, "pair": 60}
"""Cases of each kind, for each mode."""
MULTIPLES = (0.5, 1.0, 2.0, 5.0)
"""Severities of single effects over the limit of detectability."""
UNKNOWN_MULTIPLES = (5.0, 10.0)
_PAIR_MULTIPLES = (2.0, 5.0)  # drawn in between
_AXES = 6

MIMICS = {
    "coulomb_friction": ("brake_drag", "friction_wear", "friction_asymmetry"),
    "friction_wear": ("coulomb_friction", "brake_drag"),
    "static_friction": ("friction_wear",),
    "friction_asymmetry": ("torque_offset",),
    "torque_offset": ("friction_asymmetry",),
}
"""What else is left out with an effect, as it would make the effect up, alone or with others."""


@dataclass(frozen=True)
class Case:
    """One case: what is in it, and from which seed it is made."""

    name: str
    """Random; it tells nothing."""
    mode: str
    """'twin' or 'alone'."""
    robot: str
    kind: str
    """'single', 'clean', 'unknown' or 'pair'."""
    level: float
    """Torque noise over RMS torque."""
    seed: int
    effects: tuple[Effect, ...] = ()
    multiples: tuple[float, ...] = ()
    """Severities over the limit."""
    exclude: tuple[str, ...] = ()
    """Names to leave out of the catalogue."""

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


@dataclass
class _Cycle:
    """Goes through choices in random order, again and again."""

    choices: tuple[Any, ...]
    rng: np.random.Generator
    left: list[Any] = field(default_factory=list)

    def next(self) -> Any:
        if not self.left:
            self.left = [self.choices[k] for k in self.rng.permutation(len(self.choices))]
        return self.left.pop()


class _Draw:
    """Draws effects that the limits allow."""

    def __init__(self, mode: str, limits: Mapping[str, Limits], rng: np.random.Generator) -> None:
        self.mode, self.limits, self.rng = mode, limits, rng
        self.axes = {
            (robot, name): _Cycle(axes_of(name, _AXES), rng)
            for robot in ROBOTS
            for name in (*CATALOGUE, *UNLISTED)
        }
        self.orders = _Cycle(ORDERS, rng)

    def effect(self, name: str, robot: str, level: float, multiple: float) -> Effect | None:
        """The effect on the next axis that can carry it at this multiple; None if there is none."""
        cycle = self.axes[robot, name]
        for _ in range(2 * len(cycle.choices)):
            axis = cycle.next()
            order = self.orders.next() if name in WAVES else 0
            limits = self.limits[robot]
            limit = limits.limit(name, axis, level=level, mode=self.mode, order=order)
            if max(multiple, MULTIPLES[-1]) * limit > limits.largest(name, axis):
                continue
            details = {"phase": float(self.rng.uniform(0, 2 * np.pi))}
            if order:
                details["order"] = float(order)
            if name in UNLISTED:
                details = {"at": float(self.rng.uniform()), "seed": float(self.rng.integers(10**6))}
            elif name not in WAVES:
                details = {}
            return Effect(name, axis, multiple * limit, details)
        return None


def plan_cases(
    seeds: str,
    mode: str,
    limits: Mapping[str, Limits],
    counts: Mapping[str, int] = COUNTS,
    multiples: tuple[float, ...] = MULTIPLES,
) -> list[Case]:
    """All cases of a set of seeds and a mode, in random order.

    Args:
        seeds: Of `SEEDS`.
        mode: Of `limits.MODES`.
        limits: By robot.
        counts: Cases of each kind.
        multiples: Severities of single effects over the limit.

    Returns:
        The cases.
    """
    base = SEEDS[seeds] + 1000 * MODES.index(mode)
    rng = np.random.default_rng(base)
    draw = _Draw(mode, limits, rng)
    robots, levels = _Cycle(ROBOTS, rng), _Cycle(LEVELS, rng)
    names, severities = _Cycle(CATALOGUE, rng), _Cycle(multiples, rng)
    listed, unlisted = _Cycle(CATALOGUE, rng), _Cycle(UNLISTED, rng)
    strong = _Cycle(UNKNOWN_MULTIPLES, rng)
    cases: list[Case] = []

    def add(kind: str, effects: tuple[Effect, ...], many: tuple[float, ...], **rest: Any) -> None:
        token = rng.bytes(6).hex()
        seed = base * 1000 + len(cases)
        cases.append(Case(f"case_{token}", mode, robot, kind, level, seed, effects, many, **rest))

    for kind, count in counts.items():
        number = 0
        while number < count:
            robot, level = robots.next(), levels.next()
            if kind == "clean":
                add(kind, (), ())
            elif kind == "single":
                multiple = severities.next()
                effect = draw.effect(names.next(), robot, level, multiple)
                if effect is None:
                    continue
                add(kind, (effect,), (multiple,))
            elif kind == "unknown":
                multiple = strong.next()
                name = (listed if number % 2 == 0 else unlisted).next()
                effect = draw.effect(name, robot, level, multiple)
                if effect is None:
                    continue
                add(
                    kind,
                    (effect,),
                    (multiple,),
                    exclude=(catalogue_name(name), *MIMICS.get(name, ())),
                )
            else:
                first, second = names.next(), names.next()
                many = (rng.uniform(*_PAIR_MULTIPLES), rng.uniform(*_PAIR_MULTIPLES))
                one = draw.effect(first, robot, level, float(many[0]))
                two = draw.effect(second, robot, level, float(many[1]))
                if one is None or two is None or first == second:
                    continue
                add(kind, (one, two), (float(many[0]), float(many[1])))
            number += 1
    return [cases[k] for k in rng.permutation(len(cases))]


def sample(
    count: int,
    seeds: str,
    mode: str,
    limits: Mapping[str, Limits],
    multiples: tuple[float, ...] = MULTIPLES,
) -> list[Case]:
    """A balanced few, for which only some sensitivities have to be computed.

    Args:
        count: How many; at least 4. Two of five are single effects.
        seeds: Of `SEEDS`.
        mode: Of `limits.MODES`.
        limits: By robot.
        multiples: Severities of single effects over the limit.

    Returns:
        The cases; other ones than `plan_cases` draws for all.
    """
    least = max(1, count // 5)
    counts = {"single": count - 3 * least, "clean": least, "unknown": least, "pair": least}
    return plan_cases(seeds, mode, limits, counts, multiples)


def left_out(limits: Limits, mode: str) -> list[tuple[str, int, int, float]]:
    """List effects, axes and orders that no case has at any noise.

    For these, 5 x limit is larger than what is physically sensible.

    Args:
        limits: Limits of all effects.
        mode: 'twin' or 'alone'.

    Returns:
        Name, axis, order and the limit at the lowest noise.
    """
    found = []
    for name, axis, order in combos(_AXES):
        least = limits.limit(name, axis, level=LEVELS[0], mode=mode, order=order)
        if MULTIPLES[-1] * least > limits.largest(name, axis):
            found.append((name, axis, order, least))
    return found

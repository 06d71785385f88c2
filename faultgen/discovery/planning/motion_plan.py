"""Which motions should be recorded, so that discovery can name as many effects as possible?

A plan is a list of motions within the limits of the robot, chosen before anything is recorded. It
matters most without a healthy recording, when wrong numbers of the model and other forms of
friction look like effects.

    made = make_plan(load_robot("puma560"), workers=2, rng=np.random.default_rng(0))
    made.motions[0].task, made.mean("plan"), made.mean("reference")
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from faultgen.discovery.planning.expected_rates import (
    Candidates,
    Clarity,
    Fault,
    Rate,
    clarity,
    draw_rates,
    severity,
)
from faultgen.discovery.planning.information import Information, information
from faultgen.discovery.planning.motion_library import library
from faultgen.discovery.replay.samples import for_scoring
from faultgen.discovery.replay.sensitivities import TEMPERATURE
from faultgen.discovery.terms.candidates import Term, effect_terms, names_by_use, periodic_terms
from faultgen.robot import Robot
from faultgen.simulation.motion import Motion, plan
from faultgen.tasks import load_task, task_names

DURATION = 60.0
"""Longest total time of a plan [s]."""

REFERENCE = "pick_and_place"
"""Task with which a plan is compared."""

ORDERS = (1.0, 4.0)
"""Waves a motor turn that are looked at. Fewer than in a discovery, to save time."""

_STAND_IN = "fast_1"  # motion with which a plan is compared if the robot has no such task
_BLOCKS = 6  # into which discovery divides a recording of one or two motions


@dataclass(frozen=True, eq=False)
class MotionPlan:
    """Motions that are worth recording, and what to expect of them."""

    robot: Robot
    """The model."""
    reference: Motion
    """The motion with which the plan is compared: it is repeated for as long as the plan lasts."""
    motions: list[Motion]
    """In the order in which they should be recorded. Discovery keeps the last one for scoring."""
    faults: list[Fault]
    """The faults whose rates were computed."""
    rates: dict[str, list[Rate]]
    """Rates of each fault, with the "plan" and with the "reference"."""
    clear: dict[str, Clarity]
    """How clearly each fault shows, with either."""
    false_alarms: dict[str, float]
    """Share of healthy robots in which an effect is named, with either."""

    @property
    def reference_name(self) -> str:
        """Name of the reference, or what it does if it is not `REFERENCE`."""
        task = self.reference.task
        return task.name if task.name == REFERENCE else task.description

    @property
    def duration(self) -> float:
        """Total time of the motions [s]."""
        return float(sum(motion.period for motion in self.motions))

    @property
    def smaller(self) -> float:
        """Smallest severity that is named with the reference, over that with the plan.

        It is the geometric mean over the faults that are named from some severity on with both.
        """
        both = np.array([self.clear[which].smallest for which in ("reference", "plan")])
        reference, planned = np.log(both[:, np.isfinite(both).all(axis=0)])
        return float(np.exp(np.mean(reference - planned))) if len(planned) else 1.0

    def mean(self, which: str) -> float:
        """Compute the mean rate of right answers of all faults.

        Args:
            which: "plan" or "reference".
        """
        return float(np.mean([rate.right for rate in self.rates[which]]))


def make_plan(
    robot: Robot,
    *,
    include: Collection[str] = (),
    workers: int = 1,
    cache: Path | None = None,
    rng: np.random.Generator,
) -> MotionPlan:
    """Choose motions that separate the effects of the catalogue on all axes.

    From a library of motions, the one is added that raises the expected share of right answers most
    for its time, until none fits into `DURATION`. For a single pair of effects this is the design
    of Hunter and Reiner (1965): the share depends on the distance of the true effect from the
    nearest wrong one, which is fitted again.

    Args:
        robot: The model.
        include: Effects with the use "on request" that are considered.
        workers: Number of processes. It has no effect on the result.
        cache: Folder in which simulations are kept.
        rng: Source of the library, and of the robots with which the rates are found.

    Returns:
        The plan.

    Raises:
        InputError: The robot can do none of the motions.
        SimulationFailed: The model diverges on one of them.
    """
    motions = library(robot, rng)
    if REFERENCE in task_names(robot.name, robot.tasks):
        motions.insert(0, plan(load_task(robot.name, REFERENCE, robot.tasks), robot))
    else:
        names = [motion.task.name for motion in motions]
        motions.insert(0, motions.pop(names.index(_STAND_IN) if _STAND_IN in names else 0))
    told = information(
        robot, motions, terms_of(robot, include), reference=0, workers=workers, cache=cache
    )
    candidates = Candidates.of(told.terms)
    faults = candidates.faults(robot)
    chosen = choose_motions(told, candidates, faults, range(1, len(motions)))
    repeats = float(told.duration[chosen].sum() / told.duration[0]) * (1 - 1 / _BLOCKS)
    fitted = {"plan": _fitted(told, chosen), "reference": repeats * told.gram[0]}
    seed = int(rng.integers(2**32))
    drawn = {
        which: draw_rates(candidates, faults, gram, np.random.default_rng(seed))
        for which, gram in fitted.items()
    }
    return MotionPlan(
        robot=robot,
        reference=motions[0],
        motions=[motions[k] for k in chosen],
        faults=faults,
        rates={which: rates for which, (rates, _) in drawn.items()},
        clear={which: clarity(candidates, faults, gram) for which, gram in fitted.items()},
        false_alarms={which: alarms for which, (_, alarms) in drawn.items()},
    )


def terms_of(robot: Robot, include: Collection[str] = ()) -> list[Term]:
    """List the terms of the effects that motions can separate.

    An effect that discovery probes at several severities has one term here, with the one that is
    nearest to the `severity` whose rate is asked for. Friction that depends on the temperature is
    left out: it takes a recording of a robot that warms up.

    Args:
        robot: The robot.
        include: Effects with the use "on request" that are considered.
    """
    nearest: dict[tuple, Term] = {}

    def distance(term: Term) -> float:
        return abs(float(np.log(term.step / severity(robot, term))))

    for term in effect_terms(robot, (TEMPERATURE,), include):
        key = (*term.key, term.parameters)
        if key not in nearest or distance(term) < distance(nearest[key]):
            nearest[key] = term
    waves = [
        term
        for name in names_by_use("periodic")
        for order in ORDERS
        for axis in range(1, robot.n_axes + 1)
        for term in periodic_terms(robot, name, axis, order)
    ]
    return [*nearest.values(), *waves]


def choose_motions(
    told: Information, candidates: Candidates, faults: Sequence[Fault], pool: Sequence[int]
) -> list[int]:
    """Choose motions that fit into `DURATION`.

    Args:
        told: What each motion tells.
        candidates: The candidates.
        faults: The faults that should be named.
        pool: Numbers of the motions from which to choose.

    Returns:
        Numbers of the chosen motions, the most useful for its time first.
    """
    chosen: list[int] = []
    gram = np.zeros_like(told.gram[0])
    share = 0.0
    while True:
        left = DURATION - told.duration[chosen].sum()
        fitting = [k for k in pool if k not in chosen and told.duration[k] <= left]
        if not fitting:
            return chosen
        shares = [
            float(clarity(candidates, faults, gram + told.gram[k]).share.mean()) for k in fitting
        ]
        gained = (np.array(shares) - share) / told.duration[fitting]
        best = int(np.argmax(gained))
        chosen.append(fitting[best])
        gram, share = gram + told.gram[fitting[best]], shares[best]


def _fitted(told: Information, chosen: Sequence[int]) -> np.ndarray:
    """Information of the motions that discovery uses for fitting, shape (terms, terms)."""
    if len(chosen) <= 2:
        return told.gram[list(chosen)].sum(axis=0) * (1 - 1 / _BLOCKS)
    parts = [slice(k, k + 1) for k in range(len(chosen))]
    held = for_scoring(parts)
    return told.gram[[k for place, k in enumerate(chosen) if place not in held]].sum(axis=0)

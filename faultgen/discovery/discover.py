"""From a recording to a named effect and a model that contains it.

given = read_together(["measured.h5"], robot)
found = investigate(given.recording, robot)
found.answer.verdict
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from faultgen.discovery.decision.arrays import Posed
from faultgen.discovery.decision.choice import Choice, choose
from faultgen.discovery.decision.difference import Difference, difference_of
from faultgen.discovery.decision.numbers import GENERIC, fixed_groups, kind_of
from faultgen.discovery.decision.placed import with_places
from faultgen.discovery.decision.run_to_run import Learned as RunToRun
from faultgen.discovery.decision.run_to_run import by_temperature, differences, learned
from faultgen.discovery.decision.verdict import answer
from faultgen.discovery.fit.regression import Problem, pose, posed_again, with_priors
from faultgen.discovery.laws.learned_law import Learned
from faultgen.discovery.laws.order_analysis import find_orders
from faultgen.discovery.planning.next_experiment import Experiment, next_experiment
from faultgen.discovery.replay.sensitivities import sensitivities
from faultgen.discovery.result import AMBIGUOUS, Answer
from faultgen.discovery.signatures import Signatures, signatures
from faultgen.discovery.terms.candidates import (
    Term,
    between_runs,
    names_by_use,
    periodic_terms,
    with_free_gains,
)
from faultgen.errors import InputError, SimulationFailed
from faultgen.recordings.recording import Recording, mean_of
from faultgen.robot import Robot
from faultgen.system.progress import Progress

_LOWEST = 0.9  # cycles per motor turn without a baseline: errors of gravity look like slower waves


@dataclass(frozen=True, eq=False)
class Discovery:
    """All results of a discovery, for reports and further questions."""

    problem: Problem
    """The residual and the terms."""
    choice: Choice
    """The chosen set of effects and its rivals."""
    answer: Answer
    """The answer."""
    experiment: Experiment | None
    """A motion that distinguishes what this recording cannot distinguish."""
    prior_scales: Mapping[str, float] = field(default_factory=dict)
    """Factors by which groups of numbers are known worse than usual, or better, as learned from the
    recording."""
    runs: RunToRun | None = None
    """How the unchanged robot differs from run to run; None if there was one run of each motion."""
    laws: tuple[Learned, ...] = ()
    """Laws that were learned from what effects leave unexplained."""
    notes: tuple[str, ...] = ()
    """One line for each candidate that dropped out, and each stage that could not be done."""


def investigate(
    recording: Recording,
    robot: Robot,
    healthy: Recording | Sequence[Recording] | None = None,
    *,
    workers: int = 1,
    exclude: Collection[str] = (),
    include: Collection[str] = (),
    prior_scale: float | None = None,
    white_noise: bool = False,
    cache: Path | None = None,
) -> Discovery:
    """Run all stages on recordings that were already checked.

    Args:
        recording: The measured data.
        robot: The model.
        healthy: Recordings of the same motions before the change: one, several, or None. The
            baseline is their mean. Several show how much the robot differs from run to run, and so
            does one that repeats a motion; see `run_to_run`.
        workers: Number of processes. It has no effect on the result.
        exclude: Effects that are not considered.
        include: Optional effects that are considered, with the use "on request".
        prior_scale: How uncertain the model's parameters (`candidates.NUMBERS`) are, as a multiple
            of the default. None: it is learned from the recording, group by group.
        white_noise: Whether long-lasting errors get full weight, see `Noise.plain`. Otherwise a
            part of them is treated as drifting noise. Use it for recordings that were filtered.
        cache: Folder in which sensitivities are kept.

    Returns:
        All results.

    Raises:
        InputError: Too little of the recording can be used.
        SimulationFailed: The model diverges on the recorded motion.
    """
    runs = [healthy] if isinstance(healthy, Recording) else list(healthy or ())
    baseline = mean_of(runs) if runs else None
    of_model = signatures(
        recording,
        robot,
        baseline=baseline,
        exclude=exclude,
        include=include,
        workers=workers,
        cache=cache,
    )
    given, replay, terms = of_model.given, of_model.replay, of_model.terms
    notes = list(of_model.notes)
    if before := of_model.before:  # less what the model lacked of the robot before
        lacked = before.recording.torque - before.torque()
        residual = recording.torque - of_model.base - lacked
        terms = between_runs(terms)
    else:
        residual = recording.torque - of_model.given_torque
        if recording.constants is not None:
            terms = with_free_gains(terms)
    terms = [*terms, *of_model.scanned]
    try:
        problem = pose(
            replay,
            terms,
            of_model.base,
            of_model.raw,
            residual,
            baseline=baseline is not None,
            given=given,
        )
    except ValueError as error:
        raise InputError(f"{recording.source}: {error}") from None
    problem = _with_orders(problem, workers, exclude)
    problem = with_places(problem, workers=workers, exclude=exclude)
    apart = differences(runs) if runs else []
    runs_differ: RunToRun | None = None
    posed = _posed(problem, of_model, prior_scale, white_noise)
    if baseline is not None:
        warmer = by_temperature(recording, baseline, robot, posed.terms, posed.raw)
        posed = replace(posed, warmer=warmer)
        runs_differ = learned(posed, apart)
        if runs_differ is not None:
            posed = replace(posed, groups=runs_differ.groups)
    with Progress("choosing effects", None):
        difference = difference_of(posed)
        choice = choose(problem, difference)
    scales = _scales(difference, choice)
    if baseline is None:
        problem = _with_scales(problem, scales)
        choice = replace(choice, problem=problem)
    with Progress("checking the choice", None):
        told = answer(problem, choice)
    experiment = None
    if told.verdict == AMBIGUOUS:
        with Progress("planning the next experiment", None):
            try:
                experiment = next_experiment(problem, choice)
            except (InputError, SimulationFailed) as error:  # the answer is not lost
                notes.append(f"no next experiment was planned: {error}")
    return Discovery(problem, choice, told, experiment, scales, runs_differ, notes=tuple(notes))


def _with_orders(problem: Problem, workers: int, exclude: Collection[str]) -> Problem:
    """The problem with additional periodic effects, at the orders that the residual shows."""
    solution, _, _ = problem.evidence().solve()
    error = problem.whiten(problem.residual) - np.tensordot(solution, problem.white, axes=1)
    known = {(t.axis, dict(t.parameters).get("order")) for t in problem.terms}
    new: list[Term] = []
    for found in find_orders(problem, error):
        if (found.axis, round(found.order, 2)) in known:
            continue
        if not problem.baseline and found.order < _LOWEST:
            continue
        for name in names_by_use("periodic"):
            if name not in exclude:
                new += periodic_terms(problem.robot, name, found.axis, found.order)
    if not new:
        return problem
    _, raw = sensitivities(problem.replay, new, problem.base, workers=workers)
    if problem.baseline:
        new = between_runs(new)
    return posed_again(problem, new, raw)


def _posed(
    problem: Problem, of_model: Signatures, prior_scale: float | None, white_noise: bool
) -> Posed:
    """The difference for the inference, with the priors of a comparison with a model."""
    usual = {
        (term.key, term.step, term.parameters): term.prior_std
        for term in (*of_model.terms, *of_model.scanned)
    }
    terms = [
        replace(t, prior_std=usual.get((t.key, t.step, t.parameters), t.prior_std))
        for t in problem.terms
    ]
    residual = problem.residual
    if not problem.baseline:
        residual = problem.recording.torque - problem.base
        terms = problem.terms
    return Posed(
        problem.replay,
        terms,
        problem.raw,
        problem.base,
        residual,
        problem.samples(problem.fitting),
        problem.baseline,
        {} if problem.baseline else of_model.moved,
        groups=None if prior_scale is None or problem.baseline else fixed_groups(prior_scale),
        own_noise=problem.noise if problem.shared.any() else None,
        shared=problem.shared,
        white=white_noise,
    )


def _scales(difference: Difference, choice: Choice) -> dict[str, float]:
    """Learned factors of the standard deviations by group; only of groups with numbers."""
    return {
        group.name: float(np.exp(scale))
        for group, scale in zip(
            difference.model.groups, choice.found.fitted.log_scales, strict=True
        )
        if group.name in difference.numbers.kinds and group.name not in GENERIC
    }


def _with_scales(problem: Problem, scales: Mapping[str, float]) -> Problem:
    """The problem with the learned scales of its numbers."""
    terms = [
        replace(term, prior_std=term.prior_std * scales.get(kind_of(term) or "", 1.0))
        for term in problem.terms
    ]
    return with_priors(problem, terms)


def dump(result: dict[str, Any]) -> str:
    """Return the content of ``discovery.json`` as text."""
    return json.dumps(result, indent=1, allow_nan=False) + "\n"

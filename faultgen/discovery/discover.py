"""From a recording to a named effect and a model that contains it.

given = read_together(["measured.h5"], robot)
found = investigate(given.recording, robot)
found.answer.verdict
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from faultgen.discovery.calibration.own_numbers import with_own_links
from faultgen.discovery.decision.healthy_spread import at_bound, learned_scales, with_scales
from faultgen.discovery.decision.placed import with_places
from faultgen.discovery.decision.run_to_run import (
    between_axes,
    between_temperatures,
    differences,
    widened,
)
from faultgen.discovery.decision.selection import Choice, choose
from faultgen.discovery.decision.verdict import answer
from faultgen.discovery.fit.regression import Problem, plain, pose, posed_again
from faultgen.discovery.laws.friction_discrepancy import (
    discrepancy_sensitivities,
    discrepancy_terms,
)
from faultgen.discovery.laws.learned_law import Learned
from faultgen.discovery.laws.order_analysis import find_orders
from faultgen.discovery.planning.next_experiment import Experiment, next_experiment
from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.replay.sensitivities import (
    are_alone,
    impossible,
    own_sensitivities,
    sensitivities,
)
from faultgen.discovery.replay.suited import suited_replay
from faultgen.discovery.result import AMBIGUOUS, Answer
from faultgen.discovery.terms.candidates import (
    HIDDEN_BEHIND_GEARS,
    ORDERS,
    Term,
    between_runs,
    effect_terms,
    names_by_use,
    periodic_terms,
    scanned_terms,
    with_free_gains,
    with_model_scale,
)
from faultgen.discovery.terms.inertia import inertia_terms
from faultgen.effects import get_effect
from faultgen.errors import InputError, SimulationFailed
from faultgen.recordings.recording import Recording, mean_of
from faultgen.robot import Robot
from faultgen.system.progress import Progress

_LOWEST = 0.9  # cycles per motor turn without a baseline: errors of gravity look like slower waves
_PAYLOAD = "payload_"  # effects of a payload, which loads the axes before its own as well
_LESS = 0.8  # noise, over that before effects were known, from which it is estimated again


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
    """Learned factors of the prior standard deviations by kind of number; empty with a baseline, or
    if they were given."""
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
            of the default. None: it is learned from the recording, see `healthy_spread`.
        white_noise: Whether long-lasting errors get full weight, see `regression.plain`. Otherwise
            a part of them is treated as drifting noise. Use it for recordings that were filtered.
        cache: Folder in which sensitivities are kept.

    Returns:
        All results.

    Raises:
        InputError: Too little of the recording can be used.
        SimulationFailed: The model diverges on the recorded motion.
    """
    runs = [healthy] if isinstance(healthy, Recording) else list(healthy or ())
    baseline = mean_of(runs) if runs else None
    if recording.link:
        exclude = {*exclude, *HIDDEN_BEHIND_GEARS}
    given = suited_replay(recording, robot)
    replay = given
    if baseline is None:
        replay = given.on(with_own_links(recording, robot, given if given.measured else None))
    terms = effect_terms(robot, exclude, include) + inertia_terms(robot) + _waves(robot, exclude)
    terms = _on_used_axes(terms, recording)
    alone = are_alone(replay, terms)
    own = [term for term, is_alone in zip(terms, alone, strict=True) if is_alone]
    scanned = _on_used_axes(scanned_terms(robot, exclude), recording)
    others = [term for term, is_alone in zip(terms, alone, strict=True) if not is_alone]
    # what is nearly proportional is the same on the given model, and is kept for other recordings
    plays = [term for term in others if _is_play(term)]
    terms = [term for term in others if not _is_play(term)]
    given_torque, raw = sensitivities(given, terms, workers=workers, cache=cache)
    base = given_torque if replay is given else None
    if replay.measured:  # one formula for all plays
        base, raws = sensitivities(replay, [*plays, *scanned], base, workers=workers, cache=cache)
        of_plays, of_scanned = raws[: len(plays)], raws[len(plays) :]
    else:
        base, of_plays = sensitivities(replay, plays, base, workers=workers, cache=cache)
        of_scanned = own_sensitivities(replay, scanned, base, workers=workers, cache=cache)
    notes = impossible(given, terms, raw) + impossible(replay, plays, of_plays)
    discrepancy = discrepancy_terms(robot)
    raw = np.concatenate(
        [
            raw,
            of_plays,
            discrepancy_sensitivities(
                given, discrepancy, given_torque, workers=workers, cache=cache
            ),
            own_sensitivities(given, own, given_torque, workers=workers, cache=cache),
            of_scanned,
        ]
    )
    terms += plays + discrepancy + own
    residual = recording.torque - given_torque
    if baseline is not None:  # what the model lacked of the robot before
        before = Replay(baseline, robot, measured=given.measured)
        residual -= baseline.torque - before.torque()
    if baseline is not None:
        terms = between_runs(terms)
    elif prior_scale is not None:
        terms = with_model_scale(terms, prior_scale)
    if baseline is None and recording.constants is not None:
        terms = with_free_gains(terms)
    terms += scanned
    try:
        problem = pose(
            replay, terms, base, raw, residual, baseline=baseline is not None, given=given
        )
    except ValueError as error:
        raise InputError(f"{recording.source}: {error}") from None
    problem = _with_orders(problem, workers, exclude)
    problem = with_places(problem, workers=workers, exclude=exclude)
    scales: dict[str, float] = {}
    if baseline is None and prior_scale is None:
        scales = learned_scales(problem)
        problem = with_scales(problem, scales)
        notes += at_bound(scales)
    if baseline is not None:
        problem = between_temperatures(problem, baseline)
    apart = differences(runs) if runs else []
    problem = widened(problem, apart) if apart else between_axes(problem)
    with Progress("choosing effects", None):
        choice = choose(plain(problem) if white_noise else problem)
        again = _with_noise_beside(problem, choice)
        if again is not problem:
            problem = again
            choice = choose(plain(problem) if white_noise else problem)
    with Progress("checking the choice", None):
        told = answer(problem, choice)
    experiment = None
    if told.verdict == AMBIGUOUS:
        with Progress("planning the next experiment", None):
            try:
                experiment = next_experiment(problem, choice)
            except (InputError, SimulationFailed) as error:  # the answer is not lost
                notes.append(f"no next experiment was planned: {error}")
    return Discovery(problem, choice, told, experiment, scales, notes=tuple(notes))


def _waves(robot: Robot, exclude: Collection[str]) -> list[Term]:
    """Terms of the periodic effects at the orders that are always probed."""
    return [
        term
        for name in names_by_use("periodic")
        if name not in exclude
        for order in ORDERS
        for axis in range(1, robot.n_axes + 1)
        for term in periodic_terms(robot, name, axis, order)
    ]


def _on_used_axes(terms: Sequence[Term], recording: Recording) -> list[Term]:
    """The terms without effects of axes that are left out; a payload loads other axes, too."""
    return [
        term
        for term in terms
        if term.axis not in recording.left_out
        or not term.is_effect
        or term.name.startswith(_PAYLOAD)
    ]


def _is_play(term: Term) -> bool:
    """Whether a term is an effect that acts at moments which depend on the whole model."""
    return term.is_effect and get_effect(term.name).prior.play


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


def _with_noise_beside(problem: Problem, choice: Choice) -> Problem:
    """The problem with the noise that chosen effects leave, if it is clearly smaller.

    What an effect far from linear does, such as the strokes of a play, is not explained by any sum
    of columns. It counts as noise until the effect is known.
    """
    if problem.baseline or not choice.best.groups:
        return problem
    again = posed_again(problem, explained=choice.best.change)
    before, after = problem.noise.deviation, again.noise.deviation
    return again if np.any(after < _LESS * before) else problem


def dump(result: dict[str, Any]) -> str:
    """Return the content of ``discovery.json`` as text."""
    return json.dumps(result, indent=1, allow_nan=False) + "\n"

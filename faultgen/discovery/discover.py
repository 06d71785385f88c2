"""From a recording to a named effect and a model that contains it.

given = read_together(["measured.h5"], robot)
found = Discovery(robot).fit(given.recording)
found.answer_.verdict
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from faultgen.discovery.decision.arrays import Posed
from faultgen.discovery.decision.choice import Choice, choose
from faultgen.discovery.decision.difference import Difference, difference_of
from faultgen.discovery.decision.kicks import kicks
from faultgen.discovery.decision.numbers import GENERIC, fixed_groups
from faultgen.discovery.decision.placed import places
from faultgen.discovery.decision.posterior import Posterior
from faultgen.discovery.decision.run_to_run import Learned as RunToRun
from faultgen.discovery.decision.run_to_run import by_temperature, differences, learned
from faultgen.discovery.decision.shared import with_own_noise
from faultgen.discovery.decision.verdict import answer
from faultgen.discovery.decision.with_laws import with_laws
from faultgen.discovery.fit.problem import Division, Problem, division_of
from faultgen.discovery.laws.learned_law import Learned
from faultgen.discovery.laws.order_analysis import find_orders
from faultgen.discovery.planning.next_experiment import Experiment, next_experiment
from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.replay.sensitivities import sensitivities
from faultgen.discovery.result import AMBIGUOUS, Answer
from faultgen.discovery.signatures import Signatures, signatures
from faultgen.discovery.terms.candidates import (
    Term,
    names_by_use,
    periodic_terms,
    with_free_gains,
)
from faultgen.errors import InputError, SimulationFailed
from faultgen.recordings.recording import Recording, mean_of
from faultgen.robot import Robot
from faultgen.system.progress import Progress

_LOWEST = 0.9  # cycles per motor turn without a baseline: errors of gravity look like slower waves


class Discovery:
    """Finds the effect that a robot has and its model lacks, as an estimator of scikit-learn does.

    Attributes that end in ``_`` exist after `fit`.
    """

    problem_: Problem
    """The residual and the terms."""
    choice_: Choice
    """The chosen set of effects and its rivals."""
    answer_: Answer
    """The answer, with the laws that were learned."""
    laws_: tuple[Learned, ...]
    """Laws that were learned from what effects leave unexplained."""
    experiment_: Experiment | None
    """A motion that distinguishes what this recording cannot distinguish."""
    prior_scales_: dict[str, float]
    """Factors by which groups of numbers are known worse than usual, or better, as learned from the
    recording."""
    runs_: RunToRun | None
    """How the unchanged robot differs from run to run; None if there was one run of each motion."""
    notes_: tuple[str, ...]
    """One line for each candidate that dropped out, and each stage that could not be done."""

    def __init__(
        self,
        robot: Robot,
        *,
        posterior: Posterior | None = None,
        exclude: Collection[str] = (),
        include: Collection[str] = (),
        prior_scale: float | None = None,
        white_noise: bool = False,
        laws: bool = True,
        workers: int = 1,
        cache: Path | None = None,
    ) -> None:
        """State the model and what may differ.

        Args:
            robot: The model.
            posterior: What recordings of the healthy robot told of its numbers when the model was
                calibrated with them. With a baseline, it is not used.
            exclude: Effects that are not considered.
            include: Optional effects that are considered, with the use "on request".
            prior_scale: How uncertain the model's parameters (`candidates.NUMBERS`) are, as a
                multiple of the default. None: it is learned from the recording, group by group.
            white_noise: Whether long-lasting errors get full weight, see `Noise.plain`. Otherwise a
                part of them is treated as drifting noise. Use it for recordings that were filtered.
            laws: Whether laws are learned from what effects leave unexplained.
            workers: Number of processes. It has no effect on the result.
            cache: Folder in which sensitivities are kept.
        """
        self.robot = robot
        self.posterior = posterior
        self.exclude = exclude
        self.include = include
        self.prior_scale = prior_scale
        self.white_noise = white_noise
        self.laws = laws
        self.workers = workers
        self.cache = cache

    def fit(
        self, recording: Recording, baseline: Recording | Sequence[Recording] | None = None
    ) -> Discovery:
        """Run all stages on recordings that were already checked.

        Args:
            recording: The measured data.
            baseline: Recordings of the same motions before the change: one, several, or None. Their
                mean is compared. Several show how much the robot differs from run to run, and so
                does one that repeats a motion; see `run_to_run`.

        Returns:
            Itself.

        Raises:
            InputError: Too little of the recording can be used.
            SimulationFailed: The model diverges on the recorded motion.
        """
        runs = [baseline] if isinstance(baseline, Recording) else list(baseline or ())
        before = mean_of(runs) if runs else None
        of_model = signatures(
            recording,
            self.robot,
            baseline=before,
            exclude=self.exclude,
            include=self.include,
            workers=self.workers,
            cache=self.cache,
        )
        division = division_of(of_model.replay, baseline=before is not None)
        posed = self._posed(recording, of_model, division)
        self.runs_ = None
        if before is not None:
            warmer = by_temperature(recording, before, self.robot, posed.terms, posed.raw)
            posed = replace(posed, warmer=warmer)
            self.runs_ = learned(posed, differences(runs))
            if self.runs_ is not None:
                posed = replace(posed, groups=self.runs_.groups)
        with Progress("choosing effects", None):
            posed, difference = self._with_more(posed, of_model.commanded)
            problem = _problem(posed, difference, of_model, division)
            choice = choose(problem, difference)
        self.prior_scales_ = _scales(difference, choice)
        self.problem_ = _with_scales(problem, difference, choice)
        self.choice_ = replace(choice, problem=self.problem_)
        with Progress("checking the choice", None):
            self.answer_ = answer(self.problem_, self.choice_)
        self.experiment_, self.laws_, self.notes_ = None, (), tuple(of_model.notes)
        if self.answer_.verdict == AMBIGUOUS:
            with Progress("planning the next experiment", None):
                self._stage("no next experiment was planned", self._plan)
        if self.laws and not recording.link:  # laws act on the rotors
            with Progress("learning laws", None):
                self._stage("no laws were learned", self._learn)
        return self

    def _posed(self, recording: Recording, of_model: Signatures, division: Division) -> Posed:
        """The recording and what may differ."""
        terms = of_model.terms
        residual = recording.torque - of_model.base
        if before := of_model.before:  # less what the model lacked of the robot before
            residual -= before.recording.torque - before.torque()
        elif recording.constants is not None:
            terms = with_free_gains(terms)
        scale = None if before else self.prior_scale
        return Posed(
            of_model.replay,
            [*terms, *of_model.scanned],
            of_model.raw,
            of_model.base,
            residual,
            division.samples(division.fitting),
            before is not None,
            of_model.moved if before is None else {},
            groups=None if scale is None else fixed_groups(scale),
            white=self.white_noise,
            posterior=self.posterior if before is None and scale is None else None,
        )

    def _with_more(self, posed: Posed, commanded: Replay | None) -> tuple[Posed, Difference]:
        """Add effects to which the difference itself leads: waves, kicks and places."""
        difference = difference_of(posed)
        shared = with_own_noise(posed, difference.noise) if posed.baseline else posed
        if shared is not posed:
            posed, difference = shared, difference_of(shared)
        asked: dict[str, Any] = {
            "workers": self.workers,
            "exclude": self.exclude,
            "cache": self.cache,
        }
        waves = _waves(posed, difference, self.exclude)
        _, raw = sensitivities(posed.replay, waves, posed.base, workers=self.workers)
        kicked, more = kicks(posed, difference, commanded, **asked)
        if waves or kicked:
            posed = _and(posed, [*waves, *kicked], np.concatenate([raw, more]))
            difference = difference_of(posed)
        terms, columns = places(posed, difference, **asked)
        if terms:
            posed = _and(posed, terms, np.array(columns))
            difference = difference_of(posed)
        return posed, difference

    def _plan(self) -> None:
        """Plan a motion that distinguishes what the recording cannot distinguish."""
        self.experiment_ = next_experiment(self.problem_, self.choice_)

    def _learn(self) -> None:
        """Learn laws from what effects leave unexplained."""
        self.answer_, laws = with_laws(self.problem_, self.choice_, self.answer_)
        self.laws_ = tuple(laws)

    def _stage(self, without: str, stage: Callable[[], None]) -> None:
        """Run a stage without which there is an answer."""
        try:
            stage()
        except (InputError, SimulationFailed) as error:
            self.notes_ = (*self.notes_, f"{without}: {error}")


def _and(posed: Posed, terms: Sequence[Term], raw: np.ndarray) -> Posed:
    """The same with further terms."""
    return replace(posed, terms=[*posed.terms, *terms], raw=np.concatenate([posed.raw, raw]))


def _waves(posed: Posed, difference: Difference, exclude: Collection[str]) -> list[Term]:
    """Periodic effects at the orders that a difference shows, besides those that are there."""
    robot = posed.replay.robot
    known = {(t.axis, dict(t.parameters).get("order")) for t in posed.terms}
    return [
        term
        for found in find_orders(posed.replay.recording, robot, difference.rest, difference.inside)
        if (found.axis, round(found.order, 2)) not in known
        and (posed.baseline or found.order >= _LOWEST)
        for name in names_by_use("periodic")
        if name not in exclude
        for term in periodic_terms(robot, name, found.axis, found.order)
    ]


def _problem(
    posed: Posed, difference: Difference, of_model: Signatures, division: Division
) -> Problem:
    """The residual and the terms, for all that comes after the inference."""
    recording = posed.replay.recording
    residual = posed.residual if posed.baseline else recording.torque - of_model.given_torque
    shared = np.zeros(residual.shape[1], bool) if posed.shared is None else posed.shared
    return Problem(
        **vars(division),
        replay=posed.replay,
        commanded=of_model.commanded,
        given=of_model.given,
        terms=list(posed.terms),
        base=posed.base,
        residual=residual,
        raw=posed.raw,
        noise=difference.noise,
        baseline=posed.baseline,
        shared=shared,
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


def _with_scales(problem: Problem, difference: Difference, choice: Choice) -> Problem:
    """The problem with the standard deviations of numbers that were learned."""
    numbers, scales = difference.numbers, np.exp(choice.found.fitted.log_scales)
    std = {
        which: numbers.std[k] * scales[numbers.group[k]] for k, which in enumerate(numbers.which)
    }
    terms = [
        replace(term, prior_std=std.get((*term.key, term.parameters), term.prior_std))
        for term in problem.terms
    ]
    return replace(problem, terms=terms)


def dump(result: dict[str, Any]) -> str:
    """Return the content of ``discovery.json`` as text."""
    return json.dumps(result, indent=1, allow_nan=False) + "\n"

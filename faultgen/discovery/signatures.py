"""What each number that may differ between a robot and its model would change on a recorded motion.

of_model = signatures(recording, robot)
of_model.raw[0]  # change of the torque per unit of of_model.terms[0]
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from faultgen.discovery.decision.near import moved_by, near_model
from faultgen.discovery.decision.numbers import is_number
from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.replay.samples import counted, cut, samples_of
from faultgen.discovery.replay.sensitivities import impossible, sensitivities
from faultgen.discovery.replay.suited import suited_replays
from faultgen.discovery.terms.candidates import (
    HIDDEN_BEHIND_GEARS,
    MASSES,
    ORDERS,
    Term,
    effect_terms,
    names_by_use,
    periodic_terms,
    scanned_terms,
)
from faultgen.discovery.terms.inertia import inertia_terms
from faultgen.recordings.recording import Recording
from faultgen.robot import Robot


@dataclass(frozen=True, eq=False)
class Signatures:
    """The model on a recorded motion, and its change with each term."""

    given: Replay
    """The recording and the model as it was given."""
    replay: Replay
    """The recording and the model at which columns are taken: the given one, or one with links and
    stiffness that are nearer to the recording; see `near_model`."""
    commanded: Replay | None
    """The same robot, whose servo follows the commands; None if it does so badly, or if `replay`
    follows them itself."""
    before: Replay | None
    """The baseline and the model of `replay`; None without a baseline."""
    base: np.ndarray
    """Torque of the model of `replay`, shape (samples, n_axes), on the recording's side."""
    terms: list[Term]
    """What is looked for, with the prior standard deviations of a comparison with a model."""
    scanned: list[Term]
    """Further severities of some effects."""
    raw: np.ndarray
    """Change of the torque per unit of each of `terms`, then of `scanned`; shape (terms, samples,
    n_axes)."""
    moved: dict[tuple, float]
    """By how much links and stiffness of the model of `replay` differ from the given one, by name,
    axis and parameters."""
    notes: list[str]
    """One line for each candidate that the model cannot have."""

    @cached_property
    def given_torque(self) -> np.ndarray:
        """Torque of the given model, shape (samples, n_axes), on the recording's side."""
        return self.base if self.replay is self.given else self.given.torque()


def signatures(
    recording: Recording,
    robot: Robot,
    *,
    baseline: Recording | None = None,
    exclude: Collection[str] = (),
    include: Collection[str] = (),
    workers: int = 1,
    cache: Path | None = None,
) -> Signatures:
    """Compute how every term changes the torque on a recorded motion.

    Args:
        recording: The measured data.
        robot: The model.
        baseline: The robot before a change, on the same motions. The model is fitted to it, and
            not to the recording.
        exclude: Effects that are not considered.
        include: Optional effects that are considered, with the use "on request".
        workers: Number of processes. It has no effect on the result.
        cache: Folder in which simulated sensitivities are kept.

    Returns:
        The signatures.

    Raises:
        InputError: Too little of the recording can be used.
        SimulationFailed: The model diverges on the recorded motion.
    """
    given, commanded = suited_replays(recording, robot, baseline)
    before = None if baseline is None else Replay(baseline, robot, measured=given.measured)
    moved: dict[tuple, float] = {}
    if given.measured and before is None:
        moved = near_model(given, for_fitting(recording, robot))
    elif given.measured and before is not None:
        moved = near_model(before, np.ones(len(before.recording.torque), bool))
    replay = moved_by(given, moved)
    before = before and moved_by(before, moved)
    terms = _with_numbers(robot, exclude, include) + inertia_terms(robot) + _waves(robot, exclude)
    if recording.link:
        terms = [term for term in terms if term.name not in HIDDEN_BEHIND_GEARS]
    terms = _on_used_axes(terms, recording)
    scanned = _on_used_axes(scanned_terms(robot, exclude), recording)
    base, raw = sensitivities(replay, [*terms, *scanned], workers=workers, cache=cache)
    notes = impossible(replay, terms, raw[: len(terms)])
    commanded = commanded and moved_by(commanded, moved)
    return Signatures(given, replay, commanded, before, base, terms, scanned, raw, moved, notes)


def for_fitting(recording: Recording, robot: Robot) -> np.ndarray:
    """Find the samples that are not kept for scoring.

    Args:
        recording: The measured data.
        robot: The model.

    Returns:
        Mask of shape (samples,).
    """
    parts, scoring = cut(recording, robot, counted(recording, robot, baseline=False))
    return ~samples_of([parts[p] for p in scoring], len(recording.torque))


def _with_numbers(robot: Robot, exclude: Collection[str], include: Collection[str]) -> list[Term]:
    """Terms of effects. Numbers of the model that are excluded are allowed for, but not named."""
    return [
        replace(term, nuisance=term.name in exclude)
        for term in effect_terms(robot, (), include)
        if term.name not in exclude or is_number(term)
    ]


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
        if term.axis not in recording.left_out or not term.is_effect or term.name in MASSES
    ]

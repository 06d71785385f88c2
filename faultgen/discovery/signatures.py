"""What each number that may differ between a robot and its model would change on a recorded motion.

of_model = signatures(recording, robot)
of_model.raw[0]  # change of the torque per unit of of_model.terms[0]
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from faultgen.discovery.calibration.own_numbers import with_own_links
from faultgen.discovery.laws.friction_discrepancy import (
    discrepancy_sensitivities,
    discrepancy_terms,
)
from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.replay.sensitivities import (
    are_alone,
    impossible,
    own_sensitivities,
    sensitivities,
)
from faultgen.discovery.replay.suited import suited_replay
from faultgen.discovery.terms.candidates import (
    MASSES,
    ORDERS,
    Term,
    effect_terms,
    names_by_use,
    periodic_terms,
    scanned_terms,
)
from faultgen.discovery.terms.inertia import inertia_terms
from faultgen.effects import get_effect
from faultgen.recordings.recording import Recording
from faultgen.robot import Robot


@dataclass(frozen=True, eq=False)
class Signatures:
    """The model on a recorded motion, and its change with each term."""

    given: Replay
    """The recording and the model as it was given."""
    replay: Replay
    """The recording and the model on which effects act that depend on the whole model: the given
    one, or with links of its own; see `own_numbers`."""
    given_torque: np.ndarray
    """Torque of the given model, shape (samples, n_axes), on the recording's side."""
    base: np.ndarray
    """The same for the model of `replay`."""
    terms: list[Term]
    """What is looked for, with the prior standard deviations of a comparison with a model."""
    scanned: list[Term]
    """Further severities of some effects."""
    raw: np.ndarray
    """Change of the torque per unit of each of `terms`, then of `scanned`; shape (terms, samples,
    n_axes)."""
    notes: list[str]
    """One line for each candidate that the model cannot have."""


def signatures(
    recording: Recording,
    robot: Robot,
    *,
    own_links: bool = True,
    exclude: Collection[str] = (),
    include: Collection[str] = (),
    workers: int = 1,
    cache: Path | None = None,
) -> Signatures:
    """Compute how every term changes the torque on a recorded motion.

    Args:
        recording: The measured data.
        robot: The model.
        own_links: Whether links of the model may be fitted to the recording first.
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
    given = suited_replay(recording, robot)
    replay = given
    if own_links:
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
    return Signatures(given, replay, given_torque, base, terms, scanned, raw, notes)


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


def _is_play(term: Term) -> bool:
    """Whether a term is an effect that acts at moments which depend on the whole model."""
    return term.is_effect and get_effect(term.name).prior.play

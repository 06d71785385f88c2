"""A model that is near to a recording, at which columns are taken.

Rings of the arm, and moments at which plays are crossed, are not linear in masses and stiffness.
What effects have to explain is nevertheless the error of the given model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from faultgen.discovery.decision.arrays import Posed
from faultgen.discovery.decision.difference import Difference, difference_of
from faultgen.discovery.decision.hypotheses import number_terms
from faultgen.discovery.replay.elastic import STIFFNESS
from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.replay.sensitivities import sensitivities
from faultgen.discovery.terms.candidates import INERTIA, Term, effect_terms
from faultgen.discovery.terms.inertia import Moved, apply_inertia, inertia_terms
from faultgen.effects import get_effect
from faultgen.errors import SimulationFailed
from faultgen.mjcf.edit import mjcf_text

FARTHEST = 0.3
"""Largest change of links and stiffness from a given model, in which torques are nearly straight:
assumed. A mass changes by 1 - 0.7^2 = 51 % then."""


def near_model(replay: Replay, used: np.ndarray) -> dict[tuple, float]:
    """Find links and stiffness of a model that is near to a recording, to first order.

    A second step from there does not make the recording more probable, and errors of differentiated
    positions let stiffness drift.

    Args:
        replay: The recording and the given model, with rotors on their measured positions.
        used: Samples that may be used, shape (samples,).

    Returns:
        Their differences from the given model, by name, axis and parameters. They are empty if the
        near model cannot be simulated.
    """
    try:
        difference = fitted_numbers(replay, used)
        moved = _of_model(difference.numbers.which, difference.model.healthy.values)
        moved_by(replay, moved).torque()
    except SimulationFailed:
        return {}
    return moved


def fitted_numbers(replay: Replay, used: np.ndarray) -> Difference:
    """Compare a recording with the numbers of its model only.

    Args:
        replay: The recording and the model, with rotors on their measured positions.
        used: Samples that may be used, shape (samples,).

    Returns:
        The difference.

    Raises:
        SimulationFailed: The model diverges on the recorded motion.
    """
    every = effect_terms(replay.robot) + inertia_terms(replay.robot)
    terms = [every[k] for k in number_terms(every)]
    base, raw = sensitivities(replay, terms)
    posed = Posed(replay, terms, raw, base, replay.recording.torque - base, used)
    return difference_of(posed, only_numbers=True)


def _of_model(which: Sequence[tuple | None], values: np.ndarray) -> dict[tuple, float]:
    """Values of links and stiffness by what they are."""
    return {
        one: float(np.clip(value, -FARTHEST, FARTHEST))
        for one, value in zip(which, values, strict=True)
        if one is not None and one[0] in (INERTIA, STIFFNESS)
    }


def moved_by(replay: Replay, moved: Mapping[tuple, float]) -> Replay:
    """The same motion of a robot with other links and stiffness.

    Args:
        replay: The recording and the model.
        moved: As from `near_model`.
    """
    if not moved:
        return replay
    robot = replay.robot
    spec = robot.spec()
    links = []
    for (name, axis, parameters), value in moved.items():
        if name == STIFFNESS:
            get_effect(STIFFNESS).apply(spec, axis, value)
        else:
            links.append((Term(name, axis, 0.0, 0.0, parameters), value))
    apply_inertia(spec, robot, links)
    spec.compile()
    return replay.with_links(replace(robot, xml=mjcf_text(spec)), Moved(robot, links))

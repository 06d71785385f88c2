"""Effects that kick a rotor faster than smoothed positions show, simulated with the servo.

A play is crossed within some hundredths of a second. The rotor jerks, and the motor answers as its
servo does. On a smoothed motion, all of the kick would be torque of the motor. Several plays in one
simulation shake the arm, and move the strokes of each other. So the axes on which such an effect is
most probable are simulated once more, one effect at a time, in closed loop.

terms, columns = kicks(posed, difference, commanded)
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import numpy as np

from faultgen.discovery.decision.arrays import Posed
from faultgen.discovery.decision.difference import Difference
from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.replay.sensitivities import sensitivities
from faultgen.discovery.terms.candidates import Term

PLAYS = ("backlash",)
NAMES = (*PLAYS, "stiffness_hardening")
"""Effects that kick."""

_MOST = 2  # axes of one effect that are simulated once more


def kicks(
    posed: Posed,
    difference: Difference,
    commanded: Replay | None,
    *,
    workers: int = 1,
    exclude: Collection[str] = (),
    cache: Path | None = None,
) -> tuple[list[Term], np.ndarray]:
    """Simulate effects that kick, on the axes on which each is most probable.

    Args:
        posed: The recording and what may differ.
        difference: The same, as the inference sees it.
        commanded: The model whose servo follows the commands; None if it does so badly.
        workers: Number of processes. It has no effect on the result.
        exclude: Effects that are not considered.
        cache: Folder in which simulations are kept.

    Returns:
        Further terms, and the change of the torque per unit of each, shape (terms, samples,
        n_axes). There are none without commands.
    """
    replay = commanded if posed.replay.measured else posed.replay
    terms: list[Term] = []
    if replay is None:
        return terms, np.zeros((0, *posed.base.shape))
    exact = difference.exact
    for name in NAMES:
        own = [one for one in difference.hypotheses if one.family == name and name not in exclude]
        odds = {
            one.place: exact.bayes_factors(exact.healthy.log_scales, one.forms).max() for one in own
        }
        likely = sorted(odds, key=lambda axis: -odds[axis])[:_MOST]
        terms += [
            replace(term, commanded=posed.replay.measured)
            for term in posed.terms
            if term.name == name and term.axis in likely and odds[term.axis] > 0
        ]
    if not terms:
        return terms, np.zeros((0, *posed.base.shape))
    return terms, sensitivities(replay, terms, workers=workers, cache=cache)[1]

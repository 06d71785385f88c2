"""Effects that kick a rotor faster than smoothed positions show, with the answer of the servo.

A play is crossed within some hundredths of a second. The rotor jerks, and the motor answers as its
servo does. On a smoothed motion, all of the kick would be torque of the motor. So on the axes on
which such an effect is most probable, its change of the torque is computed once more with a servo.

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

NAMES = ("backlash", "stiffness_hardening")
"""Effects that kick."""

# axes of one effect on which it is computed once more: the right one need not be the first on
# smoothed positions, and each costs time; assumed
_MOST = 2


def kicks(
    posed: Posed,
    difference: Difference,
    commanded: Replay | None,
    *,
    workers: int = 1,
    exclude: Collection[str] = (),
    cache: Path | None = None,
) -> tuple[list[Term], np.ndarray]:
    """Compute effects that kick with the servo, on the axes on which each is most probable.

    Args:
        posed: The recording and what may differ.
        difference: The same, as the inference sees it.
        commanded: The model whose servo follows the commands; None if it does so badly, or if all
            signatures are already taken with it.
        workers: Number of processes. It has no effect on the result.
        exclude: Effects that are not considered.
        cache: Folder in which simulations are kept.

    Returns:
        Further terms, and the change of the torque per unit of each, shape (terms, samples,
        n_axes). There are none without commands, nor where all signatures have the servo in them.
    """
    terms: list[Term] = []
    if commanded is None:
        return terms, np.zeros((0, *posed.base.shape))
    exact = difference.exact
    for name in NAMES:
        own = [one for one in difference.hypotheses if one.family == name and name not in exclude]
        odds = {
            one.place: exact.bayes_factors(exact.healthy.log_scales, one.forms).max() for one in own
        }
        likely = sorted(odds, key=lambda axis: -odds[axis])[:_MOST]
        terms += [
            replace(term, commanded=True)
            for term in posed.terms
            if term.name == name and term.axis in likely and odds[term.axis] > 0
        ]
    if not terms:
        return terms, np.zeros((0, *posed.base.shape))
    return terms, sensitivities(commanded, terms, workers=workers, cache=cache)[1]

"""Samples whose torque depends on friction at rest, on which no two models agree.

An axis with more friction stays at rest longer before it turns round, and the servo recovers from
that for some tenths of a second. At these samples the torque is not proportional to the friction,
and its course depends on how the robot's friction behaves at rest. A simulation shows which samples
these are, so that they need not be compared.

    replay = replay.without(unsettled(replay, terms, base, raw))
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import binary_dilation

from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.replay.samples import counted
from faultgen.discovery.terms.candidates import Term
from faultgen.errors import SimulationFailed
from faultgen.recordings.noise import ORDER

_MORE = 0.3  # Coulomb friction that is added to all axes at once, over that of the model: assumed
_BENT = 0.05  # departure from proportion, over the RMS change of the axis: assumed
_MOST = 0.2  # share of the samples of an axis that are left out at most
_NAME = "coulomb_friction"


def unsettled(
    replay: Replay, terms: Sequence[Term], base: np.ndarray, raw: np.ndarray
) -> np.ndarray:
    """Find the samples at which the torque is not proportional to the friction, by a simulation.

    Args:
        replay: The recording and the model.
        terms: All terms.
        base: Torque of the unchanged model, shape (samples, n_axes).
        raw: Change of the torque per unit of each term, shape (terms, samples, n_axes).

    Returns:
        Mask of shape (samples, n_axes), with no sample of an axis whose Coulomb friction is not
        among the terms. At most a fifth of the samples that would be compared, and those beside
        them, are in it.
    """
    inside = counted(replay.recording, replay.robot, baseline=False)
    mask = np.zeros(base.shape, bool)
    own = [k for k, term in enumerate(terms) if term.name == _NAME]
    if not own:
        return mask
    try:
        change = replay.torque([(terms[k], _MORE) for k in own]) - base
    except SimulationFailed:
        return mask
    bend = np.abs(change - _MORE * raw[own].sum(axis=0))
    for axis in {terms[k].axis - 1 for k in own}:
        rows = inside[:, axis]
        if rows.any():
            size = float(np.sqrt(np.mean(change[rows, axis] ** 2)))
            least = max(_BENT * size, float(np.quantile(bend[rows, axis], 1 - _MOST)))
            mask[:, axis] = bend[:, axis] > least
    # whitening needs the samples before, and the departure may pass through zero
    return binary_dilation(mask, np.ones((2 * ORDER + 1, 1), bool))

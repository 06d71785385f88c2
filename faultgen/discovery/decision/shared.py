"""Noise that a recording and its baseline share, as two runs of one dataset do.

It cancels in their difference, which then looks much surer than it is.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from faultgen.discovery.decision.arrays import Posed, arrays_of
from faultgen.discovery.decision.whitening import whitened
from faultgen.recordings.noise import SHARED, Autoregression, autoregression, shared_noise
from faultgen.recordings.noise_level import Noise


def with_own_noise(posed: Posed, noise: Noise) -> Posed:
    """Give axes on which two recordings share their noise the noise of one of them, twice.

    Args:
        posed: The difference of two recordings.
        noise: Noise of this difference.

    Returns:
        The difference with `own_noise`; the given one if no axis shares its noise.
    """
    recording = posed.replay.recording
    healthy = recording.torque - posed.residual
    shared = shared_noise(recording.torque, healthy, recording.parts)
    if not shared.any():
        return posed
    alone = replace(posed, residual=healthy - posed.base, baseline=False, groups=None)
    alone = replace(alone, warmer=None, steady=True)
    own = whitened(arrays_of(alone, only_numbers=True)).noise
    # what neither the model nor the samples before foretell of the healthy one
    plainly = autoregression(healthy, np.ones(healthy.shape, bool), recording.parts)
    white = Autoregression(0 * own.colour.coefficients, plainly.innovation)
    colour = own.colour.replaced(white, white.innovation < own.colour.innovation)
    own = own.with_colour(colour.times(np.sqrt(2)))
    shared &= noise.colour.innovation < SHARED * own.colour.innovation
    return replace(posed, own_noise=own, shared=shared) if shared.any() else posed

"""The noise of a difference, and the difference divided by it.

white = whitened(arrays)
white.noise, white.products

Numbers and effects of known form and usual sizes are fitted, and what they leave is noise. So many
of them also take up slow noise; how much they took is drawn from the posterior of their values and
put back. The level of noise may grow with speed, load and jumps of friction, and after reversals,
where the friction of a real robot and the smoothed motion are not exact.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from faultgen.discovery.decision.arrays import Arrays, jumps
from faultgen.discovery.decision.processes import since_reversal
from faultgen.discovery.replay.bristles import FRICTION
from faultgen.discovery.replay.samples import enough
from faultgen.inference.products import Products
from faultgen.recordings.noise import Autoregression
from faultgen.recordings.noise_level import Noise, levelled
from faultgen.recordings.varying_noise import VaryingNoise

_MEMORY = 0.08  # of the noise [s]: a period of the slowest arm that rings behind its gearboxes
_ORDERS = (8, 40)  # least and largest order of the autoregression
_DECAYS = (0.03, 0.1)  # of the error of friction after a reversal [s]
_ROUNDS = 3
_DRAWS, _SEED = 4, 0  # of what the fit took of the noise; the mean of more changes it little
_TAILS = 5.0  # degrees of freedom of the noise (Student)
_LONG_AGO = 10**6  # samples since a reversal before the recording: it is forgotten
_EXACT = 1e-5  # noise over torque that simulations and columns are not exact enough to go below


@dataclass(frozen=True, eq=False)
class Whitened:
    """What whitening leaves."""

    noise: Noise
    """The noise."""
    weight: np.ndarray
    """Weight of each sample, shape (samples, n_axes)."""
    left: np.ndarray
    """What torques of known form leave, whitened and weighted, same shape."""
    products: Products
    """Inner products of the whitened columns and the whitened residual."""
    held_out: Products
    """The same on motions that must not be used."""


def whitened(arrays: Arrays) -> Whitened:
    """Find the noise of a difference, and whiten it.

    Args:
        arrays: Columns of numbers and effects beside a residual.
    """
    used = np.maximum(arrays.inside.sum(axis=0), 1)
    size = np.sqrt((arrays.residual**2 * arrays.inside).sum(axis=0) / used)
    size = np.where(size > 0, size, 1.0)
    white = Autoregression(np.zeros((len(size), 0)), np.ones(len(size)))
    noise = Noise(white, np.broadcast_to(size, arrays.residual.shape))
    before = arrays.of_positions(_order(arrays))
    rng = np.random.default_rng(_SEED)
    for _ in range(_ROUNDS):
        left, draws = _unexplained(arrays, noise, rng)
        noise = noise_of(arrays, draws, before)
    return weighed(resolved(arrays, noise), noise, left)


def resolved(arrays: Arrays, noise: Noise) -> Arrays:
    """Judge laws of friction only where the motion is resolved.

    Where an axis turns back, smoothing of its position takes more torque than the noise, and what
    it takes looks like friction at low speed. There a change of a law explains nothing. In the
    difference of two recordings of one motion it cancels.

    Args:
        arrays: Columns of numbers and effects beside a residual.
        noise: The noise.

    Returns:
        The same with columns of these effects that are zero there.
    """
    if arrays.posed.baseline:
        return arrays
    inside = arrays.smoothing < noise.of_samples()
    effects = copy(arrays.effects)
    effects.columns = list(effects.columns)
    for hypothesis in effects.hypotheses:
        if hypothesis.key[0] not in FRICTION:
            continue
        for form in hypothesis.forms:
            for k in form:
                effects.columns[k] = effects.columns[k] * inside
    return replace(arrays, effects=effects)


def _unexplained(
    arrays: Arrays, noise: Noise, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """What torques of known form leave of the residual.

    Their mean leaves less than the noise, since it took part of it. A draw of their values from
    the posterior leaves as much as the noise (the expectation of an EM step).

    Returns:
        With their mean, shape (samples, n_axes); with draws, (draws, samples, n_axes).
    """
    known = np.flatnonzero(arrays.of_known_form)
    std = arrays.std[known]
    products = _products(arrays, noise, arrays.inside, known).scaled(std)
    mean, draws = products.posterior(rng.standard_normal((_DRAWS, len(known))))
    values = (np.concatenate([mean[None], draws]) * std).astype(np.float32)
    left = arrays.residual - np.tensordot(values, arrays.columns[known], axes=1)
    return left[0], left[1:]


def _products(
    arrays: Arrays, noise: Noise, weight: np.ndarray, which: np.ndarray | None = None
) -> Products:
    """Inner products of whitened columns and residual, axis by axis: most columns act on one."""
    which = np.arange(len(arrays.columns)) if which is None else which
    gram, right, energy = np.zeros((len(which), len(which))), np.zeros(len(which)), 0.0
    for axis in range(arrays.residual.shape[1]):
        rows = np.flatnonzero(weight[:, axis])
        own = np.flatnonzero(arrays.acts[which, axis])
        times = weight[rows, axis].astype(float)
        columns = arrays.columns[which[own], :, axis]
        white = noise.whiten_axis(columns, axis + 1, arrays.parts)[:, rows] * times
        target = noise.whiten_axis(arrays.residual[:, axis], axis + 1, arrays.parts)[rows] * times
        gram[np.ix_(own, own)] += white @ white.T
        right[own] += white @ target
        energy += float(target @ target)
    return Products(gram, right, energy, int(np.count_nonzero(weight)))


def _order(arrays: Arrays) -> int:
    """Order of the autoregressions."""
    period = arrays.posed.replay.recording.sample_period
    return int(np.clip(round(_MEMORY / period), *_ORDERS))


def noise_of(arrays: Arrays, left: np.ndarray, before: VaryingNoise | None) -> Noise:
    """Estimate the noise from what a fit leaves.

    Args:
        arrays: Columns of numbers and effects beside a residual.
        left: What each draw of a fit leaves, shape (draws, samples, n_axes).
        before: The noise that positions bring in.
    """
    posed, recording = arrays.posed, arrays.posed.replay.recording
    period = recording.sample_period
    drivers = [np.abs(arrays.speed), np.abs(recording.torque)]
    if arrays.bristles is not None:
        drivers.append(jumps(arrays.bristles, arrays.parts))
    late = np.concatenate([since_reversal(arrays.speed[p], _LONG_AGO) for p in arrays.parts])
    drivers += [np.exp(-late * period / decay) for decay in _DECAYS]
    drivers.append(arrays.smoothing)
    drivers.append(arrays.resting.astype(float))
    order = _order(arrays)
    # an axis without samples has some noise
    seen = np.where(arrays.inside.any(axis=0), arrays.inside, True)
    least = _EXACT * np.sqrt(np.mean(recording.torque**2, axis=0)) + 1e-12
    moving = enough(seen & ~arrays.resting, arrays.parts)  # slow errors at rest are not its colour
    moving = np.where(moving.any(axis=0), moving, seen)
    noise = levelled(left, seen, arrays.parts, drivers, order, before, moving).at_least(least)
    if posed.own_noise is not None and posed.shared is not None:
        noise = noise.replaced(posed.own_noise.of_order(order), posed.shared)
    return noise.plain() if posed.white else noise


def weighed(arrays: Arrays, noise: Noise, left: np.ndarray) -> Whitened:
    """Whiten columns and residual, with less weight for samples that are far off.

    Args:
        arrays: Columns of numbers and effects beside a residual.
        noise: The noise.
        left: What a fit leaves, shape (samples, n_axes).
    """
    left, inside = noise.whiten(left, arrays.parts), arrays.inside
    weight = np.sqrt((_TAILS + 1) / (_TAILS + left**2)) * inside
    others = arrays.comparable & ~arrays.posed.used[:, None]
    return Whitened(
        noise,
        weight,
        left * weight,
        _products(arrays, noise, weight),
        _products(arrays, noise, others),
    )

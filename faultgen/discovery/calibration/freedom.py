"""How much freedom the physical model of a calibration gets.

told = spreads(regression, held_out.fitting, prior_scales, known, exclude)
spread, robot, torque = physical_model(held_out, told)
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from joblib import delayed

from faultgen.discovery.calibration.held_out import HeldOut
from faultgen.discovery.rigid.drives import GAIN
from faultgen.discovery.rigid.physical import Spread, fit
from faultgen.discovery.rigid.regression import Regression
from faultgen.discovery.terms.candidates import INERTIA
from faultgen.robot import Robot
from faultgen.system.parallel import in_parallel


def physical_model(held_out: HeldOut, told: Sequence[Spread]) -> tuple[Spread, Robot, np.ndarray]:
    """Fit the physical model with the least spread with which no axis is worse than classical.

    Otherwise the one with the fewest such axes, and the smallest error, is taken. Numbers of the
    drives leave the range of other units of their type only if fewer axes are worse then, or if
    some axis predicts better beyond its interval and none predicts worse.

    Args:
        held_out: The recording.
        told: Spreads, the least first.

    Returns:
        The spread, the model, and its torque in the unit of the recording, shape (samples, n_axes).
    """
    near = _least(held_out, told)
    far = _least(held_out, [replace(spread, far=True) for spread in told])
    gained = held_out.against(near[-1], far[-1]).worse.any()
    lost = held_out.against(far[-1], near[-1]).worse.any()
    better = far[0][0] < near[0][0] or (gained and not lost)
    return (far if better else near)[1:]


def _least(
    held_out: HeldOut, told: Sequence[Spread]
) -> tuple[tuple[int, float], Spread, Robot, np.ndarray]:
    """The first spread with which no axis is worse, or the best: rank, spread, model, torque."""
    best: tuple[tuple[int, float], Spread, Robot, np.ndarray] | None = None
    for spread in told:
        made = fit(held_out.regression, held_out.products, spread).robot
        torque = held_out.torque_of(made)
        own = rank(held_out, torque)
        if best is None or own < best[0]:
            best = own, spread, made, torque
        if own[0] == 0:
            break
    assert best is not None
    return best


def rank(held_out: HeldOut, torque: np.ndarray) -> tuple[int, float]:
    """Rank a predicted torque: the smaller, the better.

    Args:
        held_out: The recording.
        torque: In the unit of the recording, shape (samples, n_axes).

    Returns:
        Number of axes on which it is worse than by classical identification, and its error.
    """
    return int(held_out.against_classical(torque).worse.sum()), held_out.error(torque)


def spreads(
    regression: Regression,
    fitting: Sequence[int],
    prior_scales: Sequence[float],
    known: Collection[str],
    exclude: Collection[str],
    workers: int = 1,
) -> list[Spread]:
    """Choose how far the physical model may be from the given one, by blocks that were not fitted.

    The first is the least change that predicts as well as any, to within a standard error (Breiman
    et al. 1984): torque constants stay if they can, and the prior scale is the smallest. Where the
    links are known and the torque constants are not, the links stay if they can, and the torque
    constants are as free as may be: otherwise links that are a little wrong would take their place.

    Args:
        regression: The regression.
        fitting: Blocks that may be used.
        prior_scales: Scales to choose from.
        known: Numbers that keep their default prior standard deviations.
        exclude: Numbers that are not changed.
        workers: Number of processes. It has no effect on the result.

    Returns:
        The chosen spread, and then wider ones in ascending order.
    """
    told = [Spread(scale, known, {*exclude, GAIN}) for scale in sorted(prior_scales)]
    if GAIN not in exclude:
        told += [Spread(scale, known, exclude) for scale in sorted(prior_scales)]
        if INERTIA in known and GAIN not in known:
            told = [Spread(max(prior_scales), known, {*exclude, INERTIA}), *told]
    if len(fitting) < 2:
        return told

    calls = [delayed(_errors)(regression, fitting, spread) for spread in told]
    by_block = np.array(list(in_parallel(calls, workers)))
    best = by_block[np.argmin(by_block.sum(axis=1))]
    limit = best.sum() + np.sqrt(len(fitting)) * best.std(ddof=1)
    return told[int(np.argmax(by_block.sum(axis=1) <= limit)) :]


def _errors(regression: Regression, fitting: Sequence[int], spread: Spread) -> np.ndarray:
    """Squared relative error of each block by a fit to the others, shape (blocks,)."""
    every, used = regression.products, regression.products.only(fitting)
    total = np.maximum(used.torque.sum(axis=0), 1e-300)
    start = fit(regression, used, spread)
    squares = []
    for left_out in fitting:
        others = every.only([k for k in fitting if k != left_out])
        made = fit(regression, others, spread, start)
        squares.append(np.mean(made.squares(every.only([left_out]))[0] / total))
    return np.array(squares)

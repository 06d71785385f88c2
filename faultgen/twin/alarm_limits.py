"""Limits of a detector: what healthy robots exceed at most at a given rate.

limits = find_limits(classes, 5, 0.01, healthy_gain, healthy_rest, np.random.default_rng(0))
limits["single"], limits["running"], limits["rest"]
"""

from __future__ import annotations

import numpy as np
from scipy.stats import f as f_distribution

from faultgen.twin.classes import Classes, gains
from faultgen.twin.detector import baseline_variance, memory_variance, newest_weight

_SEQUENCES, _LENGTH = 1000, 30  # simulated series of healthy recordings, and their lengths
_FLOOR = 1e-6  # of limits
_DIRECTIONS, _BEFORE = 2, 2
"""Healthy recordings differ mostly in a few directions, such as the friction of all axes; and their
spread is not unknown before. Directions, and recordings that this knowledge stands for: assumed."""
_MANY = 1e6  # degrees of freedom of a scale that is known


def find_limits(
    classes: Classes,
    baselines: int,
    false_alarms: float,
    healthy_gain: np.ndarray,
    healthy_rest: np.ndarray,
    rng: np.random.Generator,
) -> dict[str, float]:
    """Find limits that healthy robots exceed at most at a given rate.

    Series of healthy recordings are drawn from the model. The baseline of each series is wrong by
    as much as that number of recordings leaves it. Each of the three limits gets a third of the
    rate, and none is below what healthy validation cycles reached.

    Args:
        classes: The model.
        baselines: Number of healthy recordings from which the mean was learned; 0 if none.
        false_alarms: Rate per recording.
        healthy_gain: Gain of healthy cycles that were not used for the fit, shape (cycles,).
        healthy_rest: Their squared distance from the space of the faults, shape (cycles,).
        rng: Source of randomness.

    Returns:
        The limits "single", "running" and "rest".
    """
    dimensions = len(classes.basis)
    offset = np.zeros((_SEQUENCES, dimensions))
    scale = np.ones((_SEQUENCES, 1))
    if baselines:
        offset = rng.standard_normal(offset.shape) / np.sqrt(baselines)
    if baselines > 1 and dimensions:  # the spread of few recordings is uncertain itself
        freedom = _DIRECTIONS * (baselines - 1 + _BEFORE)
        scale = np.sqrt(freedom / rng.chisquare(freedom, scale.shape))
    share = false_alarms / 3
    running = np.zeros_like(offset)
    single, long = [], []
    extra = baseline_variance(baselines)
    for count in range(1, _LENGTH + 1):
        place = scale * (offset + rng.standard_normal(offset.shape))
        weight = newest_weight(count)
        running += weight * (place - running)
        long.append(gains(classes, running, memory_variance(count) + extra))
        if count <= 5:  # all are alike
            single.append(gains(classes, place, 1 + extra))
    return {
        "single": _limit(np.concatenate(single), share, healthy_gain),
        "running": _limit(np.concatenate(long), share, np.zeros(0)),
        "rest": max(
            _limit_of_rest(classes, baselines, share), float(healthy_rest.max(initial=_FLOOR))
        ),
    }


def _limit_of_rest(classes: Classes, baselines: int, share: float) -> float:
    """Squared distance from the space of the faults that healthy recordings exceed at a rate."""
    mean, variance = classes.rest
    if mean < _FLOOR:  # the faults span all features
        return _FLOOR
    freedom = 2 * mean**2 / variance  # of a scaled chi-squared distribution (Satterthwaite 1946)
    # a scale that comes from few recordings is uncertain itself; one alone shows none
    known = freedom * (baselines - 1) if baselines else np.inf
    if baselines == 1:
        known = _DIRECTIONS * _BEFORE
    ratio = f_distribution.ppf(1 - share, freedom, min(known, _MANY))
    return float(mean * (1 + baseline_variance(baselines)) * ratio)


def _limit(drawn: np.ndarray, share: float, seen: np.ndarray) -> float:
    return max(float(np.quantile(drawn, 1 - share)), float(seen.max(initial=0.0)), _FLOOR)

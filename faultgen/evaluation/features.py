"""Features: the arrays that isolators and detectors are given, one row for each cycle.

They are what a monitoring system stores, the signals themselves, and the friction terms in the
torque. Study `detection` looks at hours instead of cycles; a row then stands for an hour.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from faultgen.analysis.friction_features import FrictionFeatures
from faultgen.monitoring.reductions import REDUCTIONS, SPEED_WINDOW, Limits
from faultgen.monitoring.sensors import Measured

FEATURES = {
    "mean_abs_torque": "mean |torque| in the speed window, shape (cycles, n_axes), in [N m]; nan "
    "if an axis is never in the window. Of an hour: over all of its samples",
    "torque_histogram": "share of the samples by torque, shape (cycles, n_axes, 12)",
    "speed_histogram": "share of the samples by motor speed, shape (cycles, n_axes, 12)",
    "angle_histogram": "share of the samples by joint angle, shape (cycles, n_axes, 12)",
    "torque_indicator": "mean torque weighted by speed, shape (cycles, n_axes), in [N m]",
    "speed_indicator": "mean |motor speed|, shape (cycles, n_axes), in [rad/s]",
    "friction_terms": "coefficients of friction terms in the torque, shape (cycles, terms)",
    "temperature": "measured gearbox temperature, shape (cycles,), in [deg C]",
    "motor_position": "shape (cycles, samples, n_axes), in [rad]",
    "motor_velocity": "shape (cycles, samples, n_axes), in [rad/s]",
    "motor_torque": "shape (cycles, samples, n_axes), in [N m]",
}
"""Every feature of a cycle by its name."""

HOURLY_FEATURES = {
    "torque_by_place": "mean torque at each place of the cycle at which it is sampled, shape "
    "(hours, places * n_axes), in [N m]",
    "kl_divergence": "divergence of the torque histogram from that of the training hours, shape "
    "(hours, n_axes), in [bit]",
}
"""Every feature that only hours have. Hours also have mean_abs_torque, motor_torque and
temperature."""

SIGNALS = ("motor_position", "motor_velocity", "motor_torque")
"""Features that are signals."""

Features = Mapping[str, np.ndarray]
"""Features of consecutive cycles of one robot, by name."""


def features(
    measured: Sequence[Measured],
    names: Collection[str],
    temperature: np.ndarray,
    *,
    terms: FrictionFeatures,
    limits: Limits,
    window: ArrayLike = SPEED_WINDOW,
) -> dict[str, np.ndarray]:
    """Compute features of measured cycles.

    Args:
        measured: The cycles.
        names: Names of the features.
        temperature: Measured gearbox temperature of each cycle, shape (cycles,), in [deg C].
        terms: Friction terms of the nominal cycle.
        limits: Design values of the robot, which set the ranges of the histograms.
        window: Speed window of the mean |torque|, shape (2,) or (n_axes, 2), in [rad/s].

    Returns:
        The features by name, with shapes and units as in `FEATURES`.
    """
    found: dict[str, np.ndarray] = {}
    for name in names:
        if name == "temperature":
            found[name] = temperature
        elif name in SIGNALS:
            found[name] = np.stack([getattr(one, name) for one in measured])
        elif name == "friction_terms":
            # one by one: sums over many cycles at once would differ in their last digits
            each = [terms.transform(one.motor_torque[None])[0] for one in measured]
            found[name] = np.array(each)
        else:
            reduce = REDUCTIONS[name]
            found[name] = np.array(
                [
                    reduce(one.motor_position, one.motor_velocity, one.motor_torque, limits, window)
                    for one in measured
                ]
            )
    return found

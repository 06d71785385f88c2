"""Effects of the sensors of an axis. They change only the log, after noise; the control is exact.

MuJoCo's servo gets exact angles. The loops of a real drive use a finer angle than the logged one.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from faultgen.effects.base import Effect
from faultgen.effects.hooks import Place
from faultgen.effects.prior import Prior

if TYPE_CHECKING:
    from faultgen.monitoring.sensors import Measured

IN_THE_LOG = "it is seen in the log itself, which is searched for it without a simulation"
"""Why effects of the log are no candidates among those that are simulated."""


def scale_torque(
    measured: Measured, place: Place, sample_period: float, rng: np.random.Generator
) -> Measured:
    """Multiply the measured torque by 1 + severity.

    Args:
        measured: The channels as measured so far.
        place: Where the effect acts, and its severity.
        sample_period: Time between samples [s].
        rng: Source of randomness.

    Returns:
        The changed channels.
    """
    torque = measured.motor_torque.copy()
    torque[:, place.axis - 1] *= 1 + place.severity
    return replace(measured, motor_torque=torque)


def coarsen_encoder(
    measured: Measured, place: Place, sample_period: float, rng: np.random.Generator
) -> Measured:
    """Round the position to multiples of severity [rad]. The speed follows from its differences.

    Args:
        measured: The channels as measured so far.
        place: Where the effect acts, and its severity.
        sample_period: Time between samples [s].
        rng: Source of randomness.

    Returns:
        The changed channels.
    """
    axis, step = place.axis - 1, place.severity
    position, velocity = measured.motor_position.copy(), measured.motor_velocity.copy()
    # the sample before the first one is where the motor came from at its speed then
    before = position[:1, axis] - velocity[:1, axis] * sample_period
    exact = np.concatenate([before, position[:, axis]])
    counted = np.round(exact / step) * step
    position[:, axis] = counted[1:]
    velocity[:, axis] += np.diff(counted - exact) / sample_period
    return replace(measured, motor_position=position, motor_velocity=velocity)


def lose_samples(
    measured: Measured, place: Place, sample_period: float, rng: np.random.Generator
) -> Measured:
    """Replace lost samples by the sample before. Severity is the probability of a loss.

    The first sample is never lost.

    Args:
        measured: The channels as measured so far.
        place: Where the effect acts, and its severity.
        sample_period: Time between samples [s].
        rng: Source of randomness.

    Returns:
        The changed channels.
    """
    count = len(measured.motor_torque)
    lost = rng.random(count) < place.severity
    # a lost sample shows the last one before it that is not lost, and the first sample itself
    return _show(measured, place, np.maximum.accumulate(np.where(lost, 0, np.arange(count))))


def stick(
    measured: Measured, place: Place, sample_period: float, rng: np.random.Generator
) -> Measured:
    """Freeze the measurement for a share of the cycle that is the severity. Its start is random.

    Args:
        measured: The channels as measured so far.
        place: Where the effect acts, and its severity.
        sample_period: Time between samples [s].
        rng: Source of randomness.

    Returns:
        The changed channels.
    """
    shown = np.arange(len(measured.motor_torque))
    count = round(place.severity * len(shown))
    first = int(rng.integers(len(shown) - count + 1))
    shown[first : first + count] = first
    return _show(measured, place, shown)


def _show(measured: Measured, place: Place, samples: np.ndarray) -> Measured:
    """Replace the samples of an axis by the samples with the given indices, shape (samples,)."""

    def shown(values: np.ndarray) -> np.ndarray:
        values = values.copy()
        values[:, place.axis - 1] = values[samples, place.axis - 1]
        return values

    return type(measured)(
        shown(measured.motor_position),
        shown(measured.motor_velocity),
        shown(measured.motor_torque),
    )


EFFECTS = (
    Effect(
        name="torque_sensor_gain",
        description="the current sensor shows more torque than there is",
        unit="fraction of the true torque that is shown too much",
        signature="every torque of the axis is larger in the log, by the same factor",
        element="log of torque",
        prior=Prior(use="never", reason="torque_constant changes the log in the same way"),
        source="logged torque = (1 + severity) times the true one; the control is unaffected",
        largest=1.0,
        smallest=-0.9,
        step=0.05,
        sense=scale_torque,
    ),
    Effect(
        name="encoder_quantisation",
        description="the encoder of the motor tells whole steps only, beyond those of the sensors",
        unit="rad, motor side, the step",
        units="rad",
        signature="none in torque; logged position in steps, logged speed in steps over the "
        "sample period",
        element="log of position and speed",
        prior=Prior(use="never", reason=IN_THE_LOG),
        source="logged position = severity round(q_m / severity); speed as its difference",
        largest=7.0,
        step=0.01,
        sense=coarsen_encoder,
    ),
    Effect(
        name="sensor_dropout",
        description="samples of the axis are lost on the way; the log holds the last one",
        unit="fraction of samples that are lost",
        signature="single samples that repeat the one before, in position, speed and torque",
        element="log of all channels",
        prior=Prior(use="never", reason=IN_THE_LOG),
        source="losses independent of one another, drawn by the seed; the first is never lost",
        largest=0.95,
        step=0.05,
        sense=lose_samples,
    ),
    Effect(
        name="sensor_stuck",
        description="the log of the axis stands still for a part of each cycle",
        unit="fraction of the cycle's time",
        signature="position, speed and torque that stay at one value, once a cycle",
        element="log of all channels",
        prior=Prior(use="never", reason=IN_THE_LOG),
        source="one stretch a cycle; when it begins is drawn by the seed, each time as likely",
        largest=1.0,
        step=0.05,
        sense=stick,
    ),
)
"""Effects of this family."""

"""How the torque of a program follows the measured temperature of the gearboxes.

    warming = learn_warming(columns, program, torque, temperature)
    cycle - warming.change(now)     # torque at the mean temperature of the healthy recordings

The form is Bittencourt's law of friction (`faultgen.effects.temperature`). By how much an axis
follows it is learned from healthy recordings, with differences from day to day beside it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from faultgen.analysis import Days
from faultgen.effects.temperature import TEMPERATURE_RANGE, friction_ratios
from faultgen.recordings.recording import Recording
from faultgen.twin.program import Program

BEYOND = 3.0
"""Distance from the temperatures of the healthy recordings up to which the law is trusted [K]:
assumed. A simulated robot was called changed from 5 K on. What is farther away is corrected up to
there, and the rest shows as friction at another temperature."""

_FOLLOWS = 0.5  # deviation of the share by which friction follows the law, about 1: assumed
_LEAST = 0.05  # ratio of friction at the ends of a straight line


@dataclass(frozen=True, eq=False)
class Warming:
    """Torque that follows the temperature."""

    reference: float
    """Temperature at which the friction of the model holds [deg C]."""
    mean: np.ndarray
    """Mean temperature of each gearbox in the healthy recordings, shape (n_axes,), in [deg C]."""
    friction: np.ndarray
    """Stribeck height [N m], Stribeck velocity [rad/s] and viscous friction [N m s/rad] of each
    motor at that mean, shape (3, n_axes)."""
    speed: np.ndarray
    """Of the motors, shape (places, n_axes), in [rad/s]."""
    direction: np.ndarray
    """Coulomb friction over that of sliding: its sign, and less than 1 where an axis begins to move
    or rests; same shape."""
    range: np.ndarray
    """Lowest and highest of these temperatures, shape (2, n_axes)."""
    share: np.ndarray
    """Share by which each of these follows the law, shape (3, n_axes)."""

    def parts(self, temperature: np.ndarray) -> np.ndarray:
        """Compute how friction that follows the law differs from that of the healthy recordings.

        Args:
            temperature: Of each gearbox, shape (n_axes,), in [deg C].

        Returns:
            Change of the torque of each motor by the Stribeck height, the Stribeck velocity and
            viscous friction, shape (3, places, n_axes), in [N m]. Their sum is that of the law.
        """
        low, high = self.range
        near = np.clip(temperature, low - BEYOND, high + BEYOND)
        now, usual = (
            np.array([_ratios(float(t), self.reference) for t in of_axes]).T
            for of_axes in (near, self.mean)
        )
        height, velocity, viscous = self.friction
        higher, faster, thicker = now / usual
        width = np.where(velocity > 0, velocity, 1.0)
        before, after = (np.exp(-((self.speed / (width * by)) ** 2)) for by in (1.0, faster))
        static = height * self.direction
        return np.stack(
            [
                static * (higher - 1) * after,
                static * (after - before),
                viscous * (thicker - 1) * self.speed,
            ]
        )

    def change(self, temperature: np.ndarray) -> np.ndarray:
        """Compute how the torque differs from that of the healthy recordings.

        Args:
            temperature: Of each gearbox, shape (n_axes,), in [deg C].

        Returns:
            Shape (places, n_axes), in [N m].
        """
        return np.asarray(np.sum(self.share[:, None] * self.parts(temperature), axis=0))

    def doubt(self, temperature: np.ndarray | None) -> str | None:
        """Say why a recording is compared with less certainty; None if it is not.

        Args:
            temperature: Of each gearbox, shape (n_axes,), in [deg C]; None if it was not measured.
        """
        if temperature is None:
            return (
                "has no temperature, which the healthy recordings have: friction at another "
                "temperature may look like a fault"
            )
        beyond = np.maximum(self.range[0] - temperature, temperature - self.range[1])
        axis = int(np.argmax(beyond))
        if beyond[axis] <= BEYOND:
            return None
        low, high = self.range[:, axis]
        return (
            f"axis {axis + 1} is at {temperature[axis]:.0f} deg C, and the healthy recordings are "
            f"from {low:.0f} to {high:.0f}: less is detected there; make the twin from healthy "
            "recordings at such temperatures, too"
        )


def learn_warming(
    law: Warming, days: Days, program: Program, healthy: np.ndarray, temperature: np.ndarray
) -> Warming:
    """Learn by which share axes follow the law.

    Args:
        law: With shares of 1.
        days: Differences from day to day.
        program: The program.
        healthy: Torque of healthy recordings, shape (recordings, places, n_axes), in [N m].
        temperature: Of their gearboxes, shape (recordings, n_axes), in [deg C].

    Returns:
        The same with the shares of the posterior: least squares with a normal prior, where days
        and noise are what is left.
    """
    change = np.array([law.parts(one) for one in temperature])
    of_axes = change[:, :, None] * np.eye(change.shape[3])[:, None]  # one for each part and axis
    of_axes = of_axes.reshape(len(change), -1, *change.shape[2:])
    white = program.whiten(of_axes - of_axes.mean(axis=0))  # (recordings, numbers, features)
    seen = program.whiten(healthy - healthy.mean(axis=0))
    scaled = days.columns * days.stds[:, None]
    inner = scaled @ scaled.T + np.eye(len(scaled))

    def weighed(x: np.ndarray) -> np.ndarray:
        """Product with the inverse of the covariance of days and noise."""
        return np.asarray(x - (scaled.T @ np.linalg.solve(inner, scaled @ x.T)).T)

    count = law.share.size
    known = np.eye(count) / _FOLLOWS**2
    right = np.full(count, 1 / _FOLLOWS**2)
    for own, target in zip(white, seen, strict=True):
        heavy = weighed(own)
        known = known + heavy @ own.T
        right = right + heavy @ target
    share = np.linalg.solve(known, right).reshape(law.share.shape)
    return replace(law, share=share)


def temperature_of(recording: Recording) -> np.ndarray | None:
    """Return the mean temperature of each gearbox in a recording, if all were measured.

    Args:
        recording: The recording.

    Returns:
        Shape (n_axes,), in [deg C]; None if any is missing.
    """
    told = recording.axis_temperature
    return None if told is None or not np.isfinite(told).all() else told.mean(axis=0)


def _ratios(temperature: float, reference: float) -> np.ndarray:
    """Those of `friction_ratios`, continued as straight lines where the law was not measured."""
    low, high = TEMPERATURE_RANGE
    inside = min(max(temperature, low), high)
    at = np.array(friction_ratios(inside, reference))
    if inside == temperature:
        return np.asarray(at)
    inwards = inside + (1.0 if inside == low else -1.0)
    slope = (np.array(friction_ratios(inwards, reference)) - at) / (inwards - inside)
    return np.maximum(at + slope * (temperature - inside), _LEAST)

"""Life of a gearbox: friction, backlash and torque ripple grow together until it fails.

Damage D is 0 in a healthy gearbox and 1 at failure. It grows by

    D(t) = (exp(c u) - 1) / (exp(c) - 1),   u = 1 - (t_failure - t) / life,   0 before u = 0

It grows slowly at first and steeply towards the end, as wear does that is accelerated by its own
debris. The shape is that of the schedule of the thesis (eq. 6.6); life and c are drawn at random
from assumed ranges. At damage D the gearbox has

    friction  (1 + f D) times nominal,   backlash b D,   torque ripple r D

where f, b and r are drawn for each gearbox from assumed ranges. The damage that is visible on a day
is D exp(k x - k^2 / 2), where x is an autoregressive series with a memory of about one day. It
varies because debris and lubricant film are never the same on two days, and it varies more the
worse the gearbox is (k is assumed).

In each robot that does not fail, one gearbox ages slowly by the same law. Its life is 40 000 hours
of operation, the expected life of gearboxes in the product manuals of ABB's large robots (IRB 6640,
6710, 6720). The share of that life that is over when the record ends is drawn for each robot,
uniformly up to 80 %. This assumes that gearboxes have any age and are replaced before the end of
their life.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from faultgen.effects import Applied
from faultgen.robot import Robot

RIPPLE_ORDER = 2.0
"""Periods of the torque ripple per motor turn, as from the wave generator of a strain wave gear."""

_MEMORY = 0.5  # correlation of what shows on one day and the next


@dataclass(frozen=True)
class GearboxLife:
    """The life of one gearbox."""

    axis: int
    """Axis of the gearbox, from 1."""
    failure: float
    """Time of the failure [d]; later than the end of the record if the robot does not fail."""
    life: float
    """Time from the first damage to the failure [d]."""
    shape: float
    """Constant c of the law of growth."""
    friction: float
    """Increase of friction at failure as a fraction of its nominal value: f."""
    backlash: float
    """Backlash at failure, measured at the joint [rad]: b."""
    ripple: float
    """Torque ripple at failure, measured at the motor [N m]: r."""
    unsteadiness: float
    """How much the visible damage varies from day to day: k."""

    def damage(self, time: np.ndarray) -> np.ndarray:
        """Compute the damage at given times.

        Args:
            time: Times, any shape, in [d].

        Returns:
            Damage, same shape, without unit; 1 at failure.
        """
        u = np.clip(1 - (self.failure - np.asarray(time, float)) / self.life, 0.0, None)
        return np.expm1(self.shape * u) / np.expm1(self.shape)

    def ageing(self, end: float, days: float, age: float) -> GearboxLife:
        """Return the same gearbox with a longer life, so that it does not fail in the record.

        Args:
            end: End of the record [d].
            days: New life of the gearbox [d].
            age: Share of that life that is over at the end of the record, below 1.

        Returns:
            The gearbox.
        """
        return replace(self, failure=end + (1 - age) * days, life=days)

    def shown(self, days: int, rng: np.random.Generator) -> np.ndarray:
        """Draw the factors between the visible and the true damage on each day.

        Args:
            days: Number of days.
            rng: Random number generator.

        Returns:
            Factors, shape (days,), without unit; their mean is 1.
        """
        x = np.empty(days)
        before = rng.standard_normal()
        for day in range(days):
            before = _MEMORY * before + np.sqrt(1 - _MEMORY**2) * rng.standard_normal()
            x[day] = before
        return np.exp(self.unsteadiness * x - self.unsteadiness**2 / 2)

    def effects(self, damage: float) -> list[Applied]:
        """List the effects of the gearbox at some damage.

        Args:
            damage: The damage; 1 at failure.
        """
        return [
            Applied("friction_wear", self.axis, self.friction * damage),
            Applied("backlash", self.axis, self.backlash * damage),
            Applied("torque_ripple", self.axis, self.ripple * damage, {"order": RIPPLE_ORDER}),
        ]


def draw_life(
    robot: Robot,
    failure: float,
    ranges: Mapping[str, tuple[float, float]],
    unsteadiness: float,
    rng: np.random.Generator,
) -> GearboxLife:
    """Draw which gearbox fails, and how.

    Args:
        robot: The model.
        failure: Time of the failure [d].
        ranges: Lower and upper limits of life [d], shape, friction, backlash [rad] and ripple, by
            name. The ripple is a fraction of the largest motor torque.
        unsteadiness: How much the visible damage varies from day to day.
        rng: Random number generator.

    Returns:
        The life of the gearbox.
    """
    axis = int(rng.integers(1, robot.n_axes + 1))
    drawn = {name: float(rng.uniform(*ranges[name])) for name in sorted(ranges)}
    drawn["ripple"] *= float(robot.motor_torque_limit[axis - 1])
    return GearboxLife(axis=axis, failure=failure, unsteadiness=unsteadiness, **drawn)

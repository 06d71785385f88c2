"""Gearbox run to failure: friction, backlash and ripple grow together to a threshold.

Damage D is 0 in a sound gearbox and 1 at failure. It grows by

    D(t) = (exp(c u) - 1) / (exp(c) - 1),   u = 1 - (t_failure - t) / life,   0 before u = 0

slow at first and steep towards the end, as wear does that feeds on its own debris (shape as the
thesis' schedules, eq. 6.6; life and c random: assumed). At damage D the gearbox has

    friction  (1 + f D) times nominal,   backlash b D,   torque ripple r D

with f, b, r drawn for each gearbox (assumed). What shows of the damage from day to day is
D exp(k x - k^2 / 2), x an autoregression of one day: debris and lubricant film are never twice the
same, and the worse the gearbox, the more it matters (k assumed).

One gearbox of each robot that does not fail ages by the same law, but slowly: its life is 40 000
hours of operation, which is the expected life of gearboxes in the product manuals of ABB's large
robots (IRB 6640, 6710, 6720). How much of that life is over when the record ends is drawn for each
robot, evenly up to 80 % (assumed: gearboxes of any age, exchanged before the end of their life).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from faultgen.effects import Applied
from faultgen.robot import Robot

RIPPLE_ORDER = 2.0
"""Waves of the ripple a motor turn, as of the wave generator of a strain wave gear."""

_MEMORY = 0.5  # correlation of what shows on one day and the next


@dataclass(frozen=True)
class GearboxLife:
    """The life of one gearbox."""

    axis: int
    """From 1."""
    failure: float
    """When it fails [d]; after the record for a robot that does not fail in it."""
    life: float
    """From the first damage to failure [d]."""
    shape: float
    """c of the law."""
    friction: float
    """Gain at failure, over nominal."""
    backlash: float
    """At failure, joint side [rad]."""
    ripple: float
    """At failure, motor side [N m]."""
    unsteadiness: float
    """k of the law."""

    def damage(self, time: np.ndarray) -> np.ndarray:
        """Damage at given times [d]; 1 at failure."""
        u = np.clip(1 - (self.failure - np.asarray(time, float)) / self.life, 0.0, None)
        return np.expm1(self.shape * u) / np.expm1(self.shape)

    def ageing(self, end: float, days: float, age: float) -> GearboxLife:
        """The same gearbox where it lives longer and does not fail yet.

        Args:
            end: When the record ends [d].
            days: Life of the gearbox [d].
            age: Share of that life that is over when the record ends, below 1.
        """
        return replace(self, failure=end + (1 - age) * days, life=days)

    def shown(self, days: int, rng: np.random.Generator) -> np.ndarray:
        """Factor by which damage shows on each day, mean 1; shape (days,)."""
        x = np.empty(days)
        before = rng.standard_normal()
        for day in range(days):
            before = _MEMORY * before + np.sqrt(1 - _MEMORY**2) * rng.standard_normal()
            x[day] = before
        return np.exp(self.unsteadiness * x - self.unsteadiness**2 / 2)

    def effects(self, damage: float) -> list[Applied]:
        """The gearbox at some damage."""
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
    """Draw the gearbox that fails, and how.

    Args:
        robot: The model.
        failure: When it fails [d].
        ranges: Of life, shape, friction, backlash and ripple; the last over the largest torque.
        unsteadiness: k of the law.
        rng: Source of randomness.
    """
    axis = int(rng.integers(1, robot.n_axes + 1))
    drawn = {name: float(rng.uniform(*ranges[name])) for name in sorted(ranges)}
    drawn["ripple"] *= float(robot.motor_torque_limit[axis - 1])
    return GearboxLife(axis=axis, failure=failure, unsteadiness=unsteadiness, **drawn)

"""Effects of what measures an axis: they act on the log alone, after noise; the control is exact.

MuJoCo's servo sees exact angles; the loops of a real drive see a finer angle than is logged.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from faultgen.effects.base import Effect, Place

if TYPE_CHECKING:
    from faultgen.sensors import Measured


def scale_torque(
    measured: Measured, place: Place, sample_period: float, rng: np.random.Generator
) -> Measured:
    """Torque times 1 + severity."""
    torque = measured.motor_torque.copy()
    torque[:, place.axis - 1] *= 1 + place.severity
    return replace(measured, motor_torque=torque)


EFFECTS = (
    Effect(
        name="torque_sensor_gain",
        description="the current sensor shows more torque than there is",
        unit="fraction of the true torque that is shown too much",
        signature="every torque of the axis is larger in the log, by the same factor",
        element="log of torque",
        source="logged torque = (1 + severity) times the true one; the control is unaffected",
        largest=1.0,
        smallest=-0.9,
        step=0.05,
        sense=scale_torque,
    ),
)
"""Effects of this family."""

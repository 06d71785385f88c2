"""Edits of a robot's gearboxes.

Gearbox i carries torque = stiffness x + damping x', where x is the twist q_motor / n - q_joint
beyond the dead band; in [N m] and [rad], joint side. Axes count from 1.
"""

from __future__ import annotations

import mujoco
import numpy as np

from faultgen.effects.base import Effect
from faultgen.effects.prior import Prior
from faultgen.effects.spreads import SPREADS

REFERENCE_TWIST = 1e-3
"""Twist at which hardening is measured [rad, joint side]: assumed, some 3 arc minutes."""


def add_backlash(spec: mujoco.MjSpec, axis: int, severity: float) -> None:
    """Widen the dead band of the gearbox, half of it on each side.

    Args:
        spec: The robot, edited in place.
        axis: Axis, from 1.
        severity: Width that is added [rad, joint side].
    """
    gearbox = spec.tendon(f"gearbox{axis}")
    low, high = gearbox.springlength
    if low < 0 and low == high:  # not set: MuJoCo takes the length at qpos0, which is 0
        low = high = 0.0
    gearbox.springlength = np.array([low - severity / 2, high + severity / 2])


def lose_stiffness(spec: mujoco.MjSpec, axis: int, severity: float) -> None:
    """Multiply the stiffness of the gearbox by 1 - severity.

    Args:
        spec: The robot, edited in place.
        axis: Axis, from 1.
        severity: Fraction of the nominal value that is lost.
    """
    spec.tendon(f"gearbox{axis}").stiffness *= 1 - severity


def harden(spec: mujoco.MjSpec, axis: int, severity: float) -> None:
    """Add a cubic term to the stiffness of the gearbox.

    Args:
        spec: The robot, edited in place.
        axis: Axis, from 1.
        severity: Fraction by which the torque increases at `REFERENCE_TWIST`.
    """
    gearbox = spec.tendon(f"gearbox{axis}")
    gearbox.stiffness[2] += severity * gearbox.stiffness[0] / REFERENCE_TWIST**2


EFFECTS = (
    Effect(
        name="backlash",
        description="teeth have play: the gearbox turns freely over an angle",
        unit="rad, joint side, whole play",
        units="rad",
        slide_units="m",
        signature="a jump and ringing where the torque of the gearbox changes sign",
        element="gearbox{i}, tendon springlength (dead band)",
        prior=Prior(
            std=SPREADS["backlash"].std,
            steps=(2e-5, 3e-4, 2e-3),
            play=True,
            # a play that differs by a fifth meets its gears at clearly other moments
            scan=tuple(np.geomspace(4e-5, 4e-3, 21).tolist()),
        ),
        source="definition; the play of worn gears stays below some 0.05 rad",
        largest=0.05,
        step=3e-4,
        edit=add_backlash,
    ),
    Effect(
        name="gear_stiffness",
        description="the gearbox loses stiffness",
        unit="fraction of nominal that is lost, below 1",
        signature="lower resonance; more twist, which the motor's encoder hardly sees",
        element="gearbox{i}, tendon stiffness",
        prior=Prior(std=SPREADS["gear_stiffness"].std, steps=(0.02, 0.2)),
        source="thesis eq. 6.2a",
        largest=0.95,
        smallest=-4.0,
        step=0.2,
        edit=lose_stiffness,
    ),
    Effect(
        name="stiffness_hardening",
        description="the gearbox gets stiffer with load",
        unit=f"fraction of the torque, at a twist of {REFERENCE_TWIST:g} rad",
        signature="resonance rises with load",
        element="gearbox{i}, tendon stiffness, cubic coefficient",
        prior=Prior(std=SPREADS["stiffness_hardening"].std, steps=(0.3,)),
        source="cubic gear stiffness as in Moberg et al.; the reference twist is assumed",
        step=0.3,
        edit=harden,
    ),
)
"""Effects of this family."""

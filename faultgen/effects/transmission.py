"""Edits of a robot's gearboxes and rotors.

Gearbox i carries torque = stiffness x + damping x', where x is the twist q_motor / n - q_joint
beyond the dead band; in [N m] and [rad], joint side. Axes count from 1.
"""

from __future__ import annotations

import mujoco
import numpy as np

REFERENCE_TWIST = 1e-3
"""Twist at which hardening is measured [rad, joint side]: assumed, some 3 arc minutes."""


def add_backlash(spec: mujoco.MjSpec, axis: int, severity: float) -> None:
    """Widen the dead band by severity [rad, joint side], half of it on each side."""
    gearbox = spec.tendon(f"gearbox{axis}")
    low, high = gearbox.springlength
    if low < 0 and low == high:  # not set: MuJoCo takes the length at qpos0, which is 0
        low = high = 0.0
    gearbox.springlength = np.array([low - severity / 2, high + severity / 2])


def lose_stiffness(spec: mujoco.MjSpec, axis: int, severity: float) -> None:
    """Stiffness times 1 - severity."""
    spec.tendon(f"gearbox{axis}").stiffness *= 1 - severity


def harden(spec: mujoco.MjSpec, axis: int, severity: float) -> None:
    """Add a cubic term that raises the torque by the fraction severity at `REFERENCE_TWIST`."""
    gearbox = spec.tendon(f"gearbox{axis}")
    gearbox.stiffness[2] += severity * gearbox.stiffness[0] / REFERENCE_TWIST**2


def scale_rotor_inertia(spec: mujoco.MjSpec, axis: int, severity: float) -> None:
    """Inertia of the rotor times 1 + severity."""
    rotor = spec.joint(f"motor{axis}").parent
    rotor.inertia *= 1 + severity

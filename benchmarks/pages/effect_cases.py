"""How each effect of the catalogue is shown: its equation, a motion, a severity and the quantity.

Severities are larger than in a robot that starts to wear, so that they can be seen.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

JointMoves = tuple[tuple[Mapping[int, float], float, float], ...]

_AXIS_2: JointMoves = (
    # angle by axis [deg], fraction of the limits, pause [s]
    ({2: 45}, 1.0, 0.3),
    ({2: -35}, 0.6, 0.2),
    ({2: 20}, 0.25, 0.2),
    ({2: 5}, 0.05, 0.1),
    ({2: 15}, 0.1, 0.1),
    ({2: -35}, 1.0, 0.3),
)
_AXIS_1: JointMoves = (({1: 60}, 1.0, 0.4), ({1: 0}, 0.6, 0.4), ({1: -30}, 1.0, 0.4))
_WRIST: JointMoves = (
    ({5: 70, 6: 120}, 1.0, 0.1),
    ({5: -70, 6: 160}, 0.7, 0.1),
    ({5: 60, 6: -120}, 0.8, 0.1),
    ({5: 0, 6: -100}, 0.5, 0.1),
    ({5: -80, 6: 0}, 1.0, 0.1),
)
_SLOW: JointMoves = (({2: 9}, 0.02, 0.2), ({2: 0}, 0.5, 0.2))
MOTIONS: dict[str, tuple[tuple[float, ...], JointMoves]] = {
    "axis 2": ((0, -35, -20, 0, 30, 0), _AXIS_2),
    "axis 2, slow": ((0, 0, -20, 0, 30, 0), _SLOW),
    "axis 1": ((-30, 0, 0, 0, 30, 0), _AXIS_1),
    "wrist": ((0, 0, 0, 0, -80, 0), _WRIST),
}
"""Start [deg] and moves of the IRB 6700, each back to its start at the end."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """One effect, ready to be drawn."""

    equation: str
    """In Markdown, s the severity."""
    severity: float
    """In the unit of the effect."""
    over: str = "speed"
    """Quantity of the right picture: a name of `effect_signatures.QUANTITIES`."""
    gap: str = "gap"
    """What is drawn over it: 'gap', 'against' the motion, or a channel of the log."""
    motion: str = "axis 2"
    """A name of `MOTIONS`."""
    axis: int = 2
    """Where the effect acts, from 1."""
    seen: int = 0
    """Axis that is drawn; 0: that of the effect."""
    window: tuple[float, float] = (0.0, 4.0)
    """Time of the left picture, and of the right one where it is over time [s]."""
    forward: bool = False
    """Draw over the quantity only what is within the window and at a steady speed forward."""
    near: float | None = None
    """Largest |quantity| of the right picture; None: all."""
    parameters: Mapping[str, Any] = field(default_factory=dict)
    """Of the effect, beside its defaults."""


_TURNING: dict[str, Any] = {
    "motion": "axis 2, slow",
    "over": "motor angle",
    "window": (0.5, 2.5),
    "forward": True,
}

CASES: dict[str, Case] = {
    "friction_wear": Case(equation="F_c, F_s times 1 + s", severity=0.5),
    "coulomb_friction": Case(equation="F_c (1 + s), F_s − F_c as it was", severity=0.5),
    "static_friction": Case(equation="(F_s − F_c) (1 + s)", severity=0.5, near=60),
    "viscous_friction": Case(equation="f_v (1 + s)", severity=0.5),
    "stribeck_velocity": Case(equation="v_s (1 + s)", severity=0.5, near=60),
    "quadratic_viscous_friction": Case(equation="+ s F_c w abs(w) / 100²", severity=0.5),
    "friction_asymmetry": Case(equation="F_c (1 + s) where w > 0", severity=0.5),
    "viscous_asymmetry": Case(equation="f_v (1 + s) where w > 0", severity=0.5),
    "low_speed_friction": Case(equation="+ s F_c exp(−(w / v_s)²)", severity=0.5, near=60),
    "torque_offset": Case(equation="+ s on the rotor", severity=1.0),
    "brake_drag": Case(equation="F_c + s, F_s + s", severity=1.0),
    "load_friction": Case(
        equation="+ s abs(τ_a / n) of Coulomb friction", severity=0.1, over="load", gap="against"
    ),
    "temperature_friction": Case(
        equation="friction times (ratios at T over those at the model's)^s; here T = 65 °C",
        severity=1.0,
    ),
    "wrist_coupling_friction": Case(
        equation="v = w_i / n_i + r w_(i−1) / n_(i−1): −s sign(v) / n_i, "
        "−s r sign(v) / n_(i−1) on the two rotors",
        severity=40.0,
        motion="wrist",
        axis=6,
        over="both speeds",
    ),
    "backlash": Case(
        equation="dead band of the twist, ± s / 2",
        severity=2e-3,
        motion="axis 1",
        axis=1,
        over="time",
    ),
    "gear_stiffness": Case(equation="K (1 − s)", severity=0.5, over="time"),
    "stiffness_hardening": Case(
        equation="+ s K x³ / 10⁻⁶ at a twist of x [rad]",
        severity=1.0,
        over="time",
    ),
    "torque_ripple": Case(equation="+ s sin(k q_m + φ) on the rotor", severity=0.5, **_TURNING),
    "transmission_error": Case(
        equation="twist + e in place of the twist, e = s sin(k q_m + φ)", severity=1e-4
    ),
    "rotor_inertia": Case(equation="J_m (1 + s)", severity=0.5, over="acceleration"),
    "torque_constant": Case(
        equation="torque on the rotor = (1 − s) of the logged one", severity=0.1, over="torque"
    ),
    "payload_mass": Case(
        equation="mass and inertia times 1 + s; without a payload: + s kg",
        severity=0.15,
        axis=6,
        seen=2,
        over="angle",
    ),
    "payload_offset": Case(
        equation="centre of mass + s",
        severity=0.1,
        motion="wrist",
        axis=6,
        seen=5,
        over="angle",
    ),
    "gravity_spring": Case(equation="− s q on the joint", severity=1000.0, over="angle"),
    "encoder_offset": Case(equation="true angle = logged angle + s", severity=0.05, over="angle"),
    "delay": Case(
        equation="set points and feed-forward of time t − s", severity=0.02, over="torque rate"
    ),
    "seizing_spot": Case(
        equation="+ s F_c (1 + cos(2π (q − angle) / width)) / 2 within the width",
        severity=1.0,
        over="angle",
        gap="against",
    ),
    "tooth_damage": Case(
        equation="twist + e in place of the twist, e = s cos((θ − φ) / 2)^(2m), θ of the shaft",
        severity=1e-4,
        **_TURNING,
    ),
    "winding_fault": Case(
        equation="torque on the rotor = (1 − s (1 + cos(2 p q_m + φ)) / 3) of the logged one",
        severity=0.3,
        **_TURNING,
    ),
    "loose_tool": Case(
        equation="m (2π 60 Hz)² (abs(x) − s / 2) beyond a play of ± s / 2",
        severity=5e-3,
        axis=6,
        seen=2,
        over="time",
    ),
    "torque_sensor_gain": Case(
        equation="logged torque = (1 + s) of the true one", severity=0.1, over="torque"
    ),
    "encoder_quantisation": Case(
        equation="logged position = s round(q_m / s)",
        severity=0.05,
        over="time",
        gap="velocity",
        window=(4.0, 4.5),
    ),
    "sensor_dropout": Case(
        equation="a share s of the samples shows the one before",
        severity=0.3,
        over="time",
        gap="velocity",
        window=(0.05, 0.35),
    ),
    "sensor_stuck": Case(
        equation="a share s of the cycle shows its first sample",
        severity=0.2,
        over="time",
        window=(0.0, 15.0),
    ),
    "learned_law": Case(
        equation="-s times a sum of curves f(x), each over one variable x of the commanded motion",
        severity=10.0,
        gap="against",
    ),
}
"""Every effect of the catalogue, in its order."""

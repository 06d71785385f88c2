"""The numbers of a drive, and what is assumed for those that nobody states.

The defaults come from the laws of `faultgen.building.usual` and from published data of gearboxes;
every one says why it was chosen. docs/robots.md lists them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from faultgen.building.seen import Seen
from faultgen.building.usual import (
    COULOMB,
    MOTOR_SPEED,
    VISCOUS,
    WIND_UP,
    run_up_time,
    usual_torque,
)

RATIOS, SLIDE_RATIOS = (30.0, 220.0), (60.0, 2000.0)
"""Range of assumed gear ratios of hinges, as in the known arms, and of slides [rad/m]."""
JOINT_SPEED, SLIDE_SPEED = np.pi, 1.0
"""Speed limit of hinges [rad/s] and slides [m/s]."""
RISE = 0.25
"""Time in which a joint reaches its speed limit [s]."""
MOVING = 0.65
"""Share of the torque limit that holds and accelerates the arm. Friction takes up to 20 %."""
WORST = 0.2
"""Smallest share of the torque limit that accelerates the arm: in the worst pose, motions take
longer, so that their torque keeps the limit."""
SLIDE_RUN_UP = 0.03
"""Time in which the motor of a slide reaches its speed limit without load [s]: as for hinges."""
MOST_FRICTION = 0.5
"""Largest friction over the torque limit that is believed if a model states it. Larger values keep
the model steady in another simulator, or are those of a model without limits."""
STATIC = 1.25
"""Static over Coulomb friction. An ABB axis has 1.17 (Wernholt and Gunnarsson 2006), the wrist of
the Manutec r3 1.22, 1.32 and 1.54."""
STRIBECK = 0.015
"""Stribeck velocity over the motor's speed limit."""
PRESLIDING = 0.01
"""Turn of the motor in which friction at rest grows to Coulomb friction [rad]."""
SLIDE_WIND_UP = 1e-4
"""Compression of a screw drive at its force limit [m]."""
SLOWEST, FASTEST = 10.0, 120.0
"""Range of assumed resonances: rotor locked and largest inertia; rotor free and smallest
inertia [Hz]."""
GEAR_DAMPING = 0.05
"""Damping ratio of a gearbox with its rotor locked."""
SERVO, SERVO_DAMPING = 8.0, 0.8
"""Bandwidth [Hz] and damping ratio of the servo on the rigid axis."""
SERVO_SHARE = 0.4
"""Largest bandwidth of the servo over the resonance with the rotor locked."""
COUNTS = 4096.0
"""Encoder counts per motor turn."""


Values = Mapping[str, float]
Assumed = tuple[float, str]


@dataclass(frozen=True)
class Quantity:
    """One number of a drive."""

    name: str
    """Key in drives.toml."""
    unit: str
    """Unit; that of slides after a semicolon."""
    assume: Callable[[Values, Seen], Assumed]
    """From the numbers before it, and what the drive sees: the number, and why."""
    stated: Callable[[Values, Seen], Assumed | None] = lambda values, seen: None
    """What the plain model states, and where; None if it states nothing."""
    zero: bool = False
    """Whether 0 is right."""


def _limit(name: str, where: str) -> Callable[[Values, Seen], Assumed | None]:
    def stated(values: Values, seen: Seen) -> Assumed | None:
        value = seen.stated.get(name)
        return None if value is None else (value, f"the {where} of the joint")

    return stated


def _speed(values: Values, seen: Seen) -> Assumed:
    return (SLIDE_SPEED, "1 m/s") if seen.slide else (JOINT_SPEED, "180 deg/s")


def _ratio(values: Values, seen: Seen) -> Assumed:
    low, high = SLIDE_RATIOS if seen.slide else RATIOS
    ratio = float(np.clip(MOTOR_SPEED / values["speed_limit"], low, high))
    return ratio, f"motor at {MOTOR_SPEED:g} rad/s at the speed limit; {low:g} to {high:g}"


def _torque(values: Values, seen: Seen) -> Assumed:
    if seen.slide or seen.arm_weight <= 0:
        needed = seen.gravity + seen.most * values["speed_limit"] / RISE
        return 2 * needed, f"twice the torque against gravity and to reach full speed in {RISE} s"
    why = "what drives of arms of this weight have"
    if seen.disbelief:
        effort = seen.stated["torque_limit"]
        why += f"; the limit of the model, {effort:g}, is not used, because {seen.disbelief}"
    return usual_torque(seen.weight, seen.arm_weight, seen.gravity), why


def _stated_torque(values: Values, seen: Seen) -> Assumed | None:
    return None if seen.disbelief else _limit("torque_limit", "effort limit")(values, seen)


def _acceleration(values: Values, seen: Seen) -> Assumed:
    full = values["speed_limit"] / RISE
    inertia = seen.most + values["rotor_inertia"] * values["gear_ratio"] ** 2
    limit = values["torque_limit"]
    left = max(MOVING * limit - seen.gravity, WORST * limit) / inertia
    if left < full:
        return left, (
            f"what {MOVING:.0%} of the torque limit leave beside gravity, at least {WORST:.0%}"
        )
    return full, f"full speed in {RISE} s"


def _rotor(values: Values, seen: Seen) -> Assumed:
    limit = values["torque_limit"]
    time = SLIDE_RUN_UP if seen.slide else run_up_time(limit)
    reflected = time * limit / values["speed_limit"]
    return reflected / values["gear_ratio"] ** 2, (
        f"the motor alone reaches full speed in {1000 * time:.2g} ms; at the joint "
        f"{100 * reflected / seen.most:.0f} % of the largest inertia of the arm"
    )


def _stated_rotor(values: Values, seen: Seen) -> Assumed | None:
    armature = seen.stated.get("armature")
    if not armature:
        return None
    return armature / values["gear_ratio"] ** 2, f"the armature of the joint, {armature:g}"


def disbelieved_friction(name: str, values: Values, seen: Seen) -> str:
    """Tell why a friction that the model states is not used.

    Args:
        name: "frictionloss" or "damping".
        values: Numbers of the drive that were determined before.
        seen: What the drive sees.

    Returns:
        The reason; empty if the friction is used, or not stated.
    """
    stated = seen.stated.get(name, 0.0)
    torque = stated * (values["speed_limit"] if name == "damping" else 1.0)
    if torque <= MOST_FRICTION * values["torque_limit"]:
        return ""
    where = " at full speed" if name == "damping" else ""
    return (
        f"the {name} of the joint, {stated:g}, is not used, because it would take "
        f"{torque / values['torque_limit']:.0%} of the torque limit{where}"
    )


def _with(why: str, reason: str) -> str:
    return f"{why}; {reason}" if reason else why


def _coulomb(values: Values, seen: Seen) -> Assumed:
    limit = values["torque_limit"] / values["gear_ratio"]
    why = f"{100 * COULOMB:g} % of the torque limit"
    return COULOMB * limit, _with(why, disbelieved_friction("frictionloss", values, seen))


def _stated_coulomb(values: Values, seen: Seen) -> Assumed | None:
    loss = seen.stated.get("frictionloss")
    if not loss or disbelieved_friction("frictionloss", values, seen):
        return None
    return loss / values["gear_ratio"], f"the frictionloss of the joint, {loss:g}"


def _static(values: Values, seen: Seen) -> Assumed:
    return STATIC * values["coulomb_friction"], f"{STATIC:g} of Coulomb friction"


def _stribeck(values: Values, seen: Seen) -> Assumed:
    top = values["speed_limit"] * values["gear_ratio"]
    return STRIBECK * top, f"{100 * STRIBECK:g} % of the motor's speed limit"


def _viscous(values: Values, seen: Seen) -> Assumed:
    top = values["speed_limit"] * values["gear_ratio"]
    why = f"at full speed {VISCOUS:g} of Coulomb friction"
    reason = disbelieved_friction("damping", values, seen)
    return VISCOUS * values["coulomb_friction"] / top, _with(why, reason)


def _stated_viscous(values: Values, seen: Seen) -> Assumed | None:
    damping = seen.stated.get("damping")
    if not damping or disbelieved_friction("damping", values, seen):
        return None
    return damping / values["gear_ratio"] ** 2, f"the damping of the joint, {damping:g}"


def _bristle(values: Values, seen: Seen) -> Assumed:
    coulomb = max(values["coulomb_friction"], 1e-9)
    return coulomb / PRESLIDING, f"Coulomb friction within {PRESLIDING:g} rad"


def _bristle_damping(values: Values, seen: Seen) -> Assumed:
    critical = 2 * np.sqrt(values["bristle_stiffness"] * values["rotor_inertia"])
    return 0.5 * float(critical), "half of critical damping with the rotor"


def _stiffness(values: Values, seen: Seen) -> Assumed:
    reflected = values["rotor_inertia"] * values["gear_ratio"] ** 2
    both = 1 / (1 / seen.least + 1 / reflected)
    wind_up = SLIDE_WIND_UP if seen.slide else WIND_UP
    by_torque = values["torque_limit"] / wind_up
    lowest = seen.most * (2 * np.pi * SLOWEST) ** 2
    highest = both * (2 * np.pi * FASTEST) ** 2
    unit = "m" if seen.slide else "rad"
    if highest < max(by_torque, lowest):
        return highest, f"resonance of {FASTEST:g} Hz with the smallest inertia and a free rotor"
    if by_torque < lowest:
        return lowest, f"resonance of {SLOWEST:g} Hz with the largest inertia and the rotor locked"
    return by_torque, f"wind-up of {wind_up:g} {unit} at the torque limit"


def _gear_damping(values: Values, seen: Seen) -> Assumed:
    reflected = values["rotor_inertia"] * values["gear_ratio"] ** 2
    inertia = min(seen.most, 4 * (1 / (1 / seen.least + 1 / reflected)))
    damping = 2 * GEAR_DAMPING * np.sqrt(values["gear_stiffness"] * inertia)
    return float(damping), f"damping ratio of {GEAR_DAMPING:g}"


def _servo(values: Values, seen: Seen) -> tuple[float, float]:
    """Inertia that the servo moves, at the motor [kg m^2], and its bandwidth [rad/s]."""
    inertia = values["rotor_inertia"] + seen.most / values["gear_ratio"] ** 2
    locked = np.sqrt(values["gear_stiffness"] / seen.most)
    return inertia, min(2 * np.pi * SERVO, SERVO_SHARE * float(locked))


def _position_gain(values: Values, seen: Seen) -> Assumed:
    inertia, rate = _servo(values, seen)
    return inertia * rate**2, f"bandwidth of {rate / (2 * np.pi):.3g} Hz"


def _velocity_gain(values: Values, seen: Seen) -> Assumed:
    inertia, rate = _servo(values, seen)
    return 2 * SERVO_DAMPING * inertia * rate, f"damping ratio of {SERVO_DAMPING:g}"


QUANTITIES = (
    Quantity("speed_limit", "rad/s; m/s, joint", _speed, _limit("speed_limit", "velocity limit")),
    Quantity(
        "gear_ratio",
        "motor turns per joint turn; rad/m",
        _ratio,
        _limit("gear_ratio", "transmission"),
    ),
    Quantity("torque_limit", "N m; N, joint", _torque, _stated_torque),
    Quantity("rotor_inertia", "kg m^2, motor", _rotor, _stated_rotor),
    Quantity("acceleration_limit", "rad/s^2; m/s^2, joint", _acceleration),
    Quantity("coulomb_friction", "N m, motor", _coulomb, _stated_coulomb, zero=True),
    Quantity("static_friction", "N m, motor", _static, zero=True),
    Quantity("stribeck_velocity", "rad/s, motor", _stribeck),
    Quantity("viscous_friction", "N m s/rad, motor", _viscous, _stated_viscous, zero=True),
    Quantity("bristle_stiffness", "N m/rad, motor", _bristle),
    Quantity("bristle_damping", "N m s/rad, motor", _bristle_damping),
    Quantity("gear_stiffness", "N m/rad; N/m, joint", _stiffness),
    Quantity("gear_damping", "N m s/rad; N s/m, joint", _gear_damping, zero=True),
    Quantity("position_gain", "N m/rad, motor", _position_gain),
    Quantity("velocity_gain", "N m s/rad, motor", _velocity_gain),
    Quantity("encoder_counts", "per motor turn", lambda v, s: (COUNTS, "12 bits"), zero=True),
)
"""All numbers of a drive, in the order in which they are determined."""

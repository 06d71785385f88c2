"""Effects in forms of this simulator's own, and effects that no catalogue has.

worn = apply(Effect("backlash", 3, 1e-3), plant)

Severity is in the unit of faultgen's catalogue, for the nominal robot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from laboratories.mjcf import Machine, merged
from laboratories.robots import Plant
from scipy.signal import lfilter

WAVES = ("transmission_error", "torque_ripple")
ORDERS = (1, 2, 4, 6)
"""Waves a motor turn."""
CATALOGUE = (
    "friction_wear",
    "coulomb_friction",
    "static_friction",
    "stribeck_velocity",
    "viscous_friction",
    "quadratic_viscous_friction",
    "friction_asymmetry",
    "load_friction",
    "temperature_friction",
    "wrist_coupling_friction",
    "backlash",
    "gear_stiffness",
    "stiffness_hardening",
    "transmission_error",
    "torque_ripple",
    "torque_offset",
    "torque_constant",
    "rotor_inertia",
    "delay",
    "payload_mass",
    "payload_offset",
    "gravity_spring",
    "encoder_offset",
)
"""Names of the catalogue that have a form here. `brake_drag` is `coulomb_friction` in [N m]."""
UNLISTED = (
    "acceleration_friction",
    "dress_pack",
    "warming_friction",
    "position_friction",
    "servo_gain",
    "speed_clipping",
    "torque_lowpass",
)
"""Effects that are in no catalogue, or that discovery does not consider."""


@dataclass(frozen=True)
class Effect:
    """An effect on an axis, counted from 1, with what was drawn beside its severity."""

    name: str
    axis: int
    severity: float
    details: dict[str, float] = field(default_factory=dict)


def axes_of(name: str, n_axes: int) -> tuple[int, ...]:
    """Axes on which an effect can act, from 1; none for some effects of small robots."""
    if name == "wrist_coupling_friction":
        return (n_axes - 1, n_axes) if n_axes >= 6 else ()
    return tuple(range(1, n_axes + 1))


def unit(name: str, axis: int, machine: Machine) -> float:
    """A severity that is neither tiny nor huge, to begin a search with."""
    k = axis - 1
    friction, ratio = float(machine.coulomb[k]), abs(float(machine.ratio[k]))
    twist = 0.2 * float(machine.limit[k]) * ratio / float(machine.stiffness[k])
    table = {
        "load_friction": 0.02,
        "temperature_friction": 0.3,
        "wrist_coupling_friction": 0.2 * friction * ratio,
        "backlash": twist,
        "gear_stiffness": 0.2,
        "stiffness_hardening": min(0.2 * (1e-3 / twist) ** 2, 10.0),
        "transmission_error": 0.05 * twist,
        "torque_ripple": 0.1 * friction,
        "torque_offset": 0.2 * friction,
        "torque_constant": 0.05,
        "delay": 2e-3,
        "payload_mass": 0.2 if axis == machine.n_axes else 0.2 * float(machine.payload[0]),
        "payload_offset": 0.02,
        "gravity_spring": 0.05 * float(machine.limit[k]) * ratio,
        "encoder_offset": 0.01,
        "acceleration_friction": 0.4 * friction,
        "dress_pack": friction * ratio,
        "warming_friction": 0.5 * friction,
        "position_friction": 0.5 * friction,
        "servo_gain": 0.5,
        "speed_clipping": 0.5,
        "torque_lowpass": 0.01,
    }
    return table.get(name, 0.2)


def largest(name: str, axis: int, machine: Machine) -> float:
    """The largest severity that is sensible, as a multiple of nothing: in the effect's unit."""
    bounds = {
        "gear_stiffness": 0.6,
        "torque_constant": 0.3,
        "servo_gain": 0.7,
        "temperature_friction": 1.0,
        "load_friction": 0.3,
        "delay": 0.01,
        "encoder_offset": 0.05,
        "payload_offset": 0.1,
        "torque_lowpass": 0.05,
        "speed_clipping": 0.8,
        "stiffness_hardening": 10.0,
    }
    return bounds.get(name, 10 * unit(name, axis, machine))


_COLUMN = {
    "stribeck_velocity": "X_STRIBECK",
    "viscous_friction": "X_VISCOUS",
    "load_friction": "X_LOAD",
    "backlash": "X_PLAY",
    "gear_stiffness": "X_SOFT",
    "stiffness_hardening": "X_HARD",
    "torque_constant": "X_CONSTANT",
    "torque_offset": "X_TORQUE",
    "gravity_spring": "X_SPRING",
    "wrist_coupling_friction": "X_WRIST",
    "delay": "X_DELAY",
    "encoder_offset": "X_ENCODER",
    "acceleration_friction": "U_LAG",
    "warming_friction": "U_WARM",
    "position_friction": "U_PLACE",
    "servo_gain": "U_GAIN",
}
"""Effects whose severity is a column of the table."""


def apply(effect: Effect, plant: Plant, model: Machine) -> Plant:
    """Put an effect into a robot; those of temperature and of the torque's log act elsewhere.

    Args:
        effect: The effect.
        plant: The robot, perhaps off.
        model: The nominal robot, in whose units severity is.

    Returns:
        The changed robot.
    """
    name, axis, s = effect.name, effect.axis, effect.severity
    k = axis - 1
    coulomb, rise = float(model.coulomb[k]), float(model.static[k] - model.coulomb[k])
    if name in _COLUMN:
        return plant.changed(axis, **{_COLUMN[name]: s})
    if name == "friction_wear":
        return plant.changed(axis, X_COULOMB=s * coulomb, X_STATIC=s * rise)
    if name == "coulomb_friction":
        return plant.changed(axis, X_COULOMB=s * coulomb)
    if name == "static_friction":
        return plant.changed(axis, X_STATIC=s * rise)
    if name == "quadratic_viscous_friction":
        speed = float(plant.column("X_REF")[k])
        return plant.changed(axis, X_QUADRATIC=s * coulomb * (speed / 100) ** 2)
    if name == "friction_asymmetry":
        return plant.changed(axis, X_ONE_WAY=s * coulomb)
    if name in WAVES:
        size = {"transmission_error": "X_WAVE", "torque_ripple": "X_RIPPLE"}[name]
        order, phase = effect.details.get("order", 2.0), effect.details.get("phase", 0.5)
        return plant.changed(axis, **{size: s}, X_ORDER=order, X_PHASE=phase)
    if name == "rotor_inertia":
        rotor = float(plant.column("ROTOR")[k]) + s * float(model.rotor[k])
        return plant.changed(axis, ROTOR=rotor)
    if name.startswith("payload") and axis < model.n_axes:
        return replace(plant, machine=_loaded_link(plant.machine, name, k, s))
    if name == "payload_mass":
        payload = plant.machine.payload.copy()
        more = 1 + s * model.payload[0] / payload[0]
        payload[0] *= more
        payload[4:] *= more**1.3
        return replace(plant, machine=plant.machine.changed(payload=payload))
    if name == "payload_offset":
        payload = plant.machine.payload.copy()
        turn = plant.machine.payload_turn
        payload[1:4] += s * (turn[:, 0] + 0.08 * turn[:, 1])
        return replace(plant, machine=plant.machine.changed(payload=payload))
    if name == "dress_pack":
        width = 0.1 * float(model.high[k] - model.low[k])
        return plant.changed(axis, U_HOSE=s, U_HOSE_WIDTH=width)
    if name == "speed_clipping":
        return plant.changed(axis, U_CLIP=1 - s)
    if name in ("temperature_friction", "torque_lowpass"):
        return plant
    raise ValueError(f"no form of effect '{name}'")


def _loaded_link(machine: Machine, name: str, k: int, severity: float) -> Machine:
    """A robot with a mass [kg] near the far end of a link, or with a moved centre of mass [m]."""
    mass, com, inertia = machine.mass.copy(), machine.com.copy(), machine.inertia.copy()
    if name == "payload_offset":
        com[k] += severity * np.array([1.0, 0.08, 0.0])
    else:
        # a compact body beside the next joint, with a radius of gyration of 3 cm
        place = machine.place[k + 1] + np.array([0.01, -0.01, 0.015])
        added = (severity, place, severity * 0.03**2 * np.eye(3))
        mass[k], com[k], inertia[k] = merged([(mass[k], com[k], inertia[k]), added])
    return machine.changed(mass=mass, com=com, inertia=inertia)


def temperature_factors(temperature: float, share: float) -> np.ndarray:
    """Factors of viscous friction, Coulomb friction, rise and its speed; shape (4,).

    Powers of the temperature over 40 deg C, close to the law of Bittencourt et al. (2010) between
    30 and 55 deg C, of which the severity is a share in the exponent.
    """
    ratio = temperature / 40.0
    return np.array([ratio**-1.13, 1.0, ratio**1.6, ratio**2.3]) ** share


def logged_torque(
    effects: Sequence[Effect], torque: np.ndarray, sample_period: float
) -> np.ndarray:
    """What a log with an effect shows of one motion.

    Args:
        effects: All effects of the robot.
        torque: [N m], shape (samples, n_axes).
        sample_period: [s].

    Returns:
        Same shape.
    """
    seen = torque.copy()
    for effect in effects:
        if effect.name == "torque_lowpass":
            k = effect.axis - 1
            keep = np.exp(-sample_period / effect.severity)
            start = torque[0, k]
            seen[:, k] = start + lfilter([1 - keep], [1, -keep], torque[:, k] - start)
    return seen

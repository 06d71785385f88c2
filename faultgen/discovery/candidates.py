"""What may differ between a robot and its model: effects, and parameters with a wrong value.

Each term is one number that is zero in the model. Its tolerance is the standard deviation of this
number among healthy robots. An effect is missing if its term is further from zero than that.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from faultgen.effects import EFFECTS, Applied, Effect
from faultgen.effects.friction import no_static_friction
from faultgen.effects.structure import MASSLESS
from faultgen.errors import InputError
from faultgen.robot import COULOMB, OFFSET, STRIBECK_VELOCITY, Robot

INERTIA = "inertia"
"""Name of the terms of a link's mass, centre of mass and inertia."""

FORM = "friction_form"
"""Name of the terms for friction near zero speed that differs from the model's law. These terms are
not simulated as changes of the model."""

FRICTION = (
    "coulomb_friction",
    "friction_wear",
    "static_friction",
    "stribeck_velocity",
    "viscous_friction",
    "quadratic_viscous_friction",
)
"""Kinds of friction that depend on speed."""

PERIODIC = ("torque_ripple", "transmission_error")
"""Effects that are probed at the orders that are found in a recording."""

ORDERS = (1.0, 2.0, 4.0, 6.0)
"""Orders at which periodic effects are always probed, in cycles per motor turn. They are typical of
rotors, pole pairs and wave generators. Other orders are probed if they are found in a recording."""

OPTIONAL = ("viscous_asymmetry", "low_speed_friction")
"""Effects that are candidates only if the user asks for them."""

NO_COLUMN = (
    "seizing_spot",
    "tooth_damage",
    "winding_fault",
    "loose_tool",
    "torque_sensor_gain",
    "encoder_quantisation",
    "sensor_dropout",
    "sensor_stuck",
)
"""Effects that are not candidates because there is no column for them yet. For some of them an
angle, a phase or random values would have to be searched for. Others act on sensors, which a replay
does not simulate."""

NUMBERS = (
    "coulomb_friction",
    "viscous_friction",
    "torque_offset",
    "rotor_inertia",
    "torque_constant",
    INERTIA,
)
"""Parameters that every model has. In a model that is only roughly known, their errors are
larger."""

PAYLOAD = "payload_mass"
"""Effect that consists of four terms, the masses of four points, if the model's payload has no
mass."""

SAME_MOTIONS = 0.01
"""Tolerance between two recordings of one robot, as a share of the tolerance between a robot and
its model: assumed."""


LINK_TOLERANCE = 0.03
"""How far the mass, size and place of links may be off, as a fraction: assumed."""


@dataclass(frozen=True)
class Term:
    """One number that may differ between the robot and the model."""

    name: str
    """An effect of the catalogue, `INERTIA` or `FORM`."""
    axis: int
    """Axis, from 1. For inertias it is the number of the link, and the payload is the last one."""
    step: float
    """Severity with which the effect is probed."""
    tolerance: float
    """Standard deviation of the severity among healthy robots: assumed."""
    parameters: tuple[tuple[str, float], ...] = ()
    """Further parameters of the effect."""

    @property
    def key(self) -> tuple[str, int]:
        """Effect and axis, as they appear in an answer."""
        return self.name, self.axis

    @property
    def is_effect(self) -> bool:
        """Whether the term can be part of an answer."""
        return self.name not in (INERTIA, FORM)


# Standard deviation of healthy robots about their model, as severities of the catalogue: assumed.
# Numbers of a data sheet are off by some per cent; what a model lacks is small in a new robot.
_FRACTIONS = {
    "coulomb_friction": 0.035,
    "friction_wear": 0.002,  # coulomb and static have their own
    "static_friction": 0.15,
    "stribeck_velocity": 0.15,
    "viscous_friction": 0.05,
    "quadratic_viscous_friction": 0.003,
    "friction_asymmetry": 0.003,
    "temperature_friction": 0.005,
    "gear_stiffness": 0.1,
    "stiffness_hardening": 1.0,
    "rotor_inertia": 0.035,
    "torque_constant": 0.002,
    "load_friction": 0.0003,
    "payload_mass": 0.035,
    "payload_offset": 2e-3,
    "backlash": 2e-6,
    "delay": 6e-4,
    "viscous_asymmetry": 0.01,
    "low_speed_friction": 0.01,
}
# Coupled wrists rub on the sum or on the difference of two speeds, by how they are built.
_VARIANTS: dict[str, tuple[tuple[tuple[str, float], ...], ...]] = {
    "wrist_coupling_friction": ((("ratio", 1.0),), (("ratio", -1.0),)),
}
_WIDTHS = (0.3, 1.0, 3.0, 10.0, 30.0)  # of low-speed friction, in Stribeck velocities
_POINTS = 0.02  # mass of a payload that the model says is none [kg]: assumed
_ARM = 0.1  # distance of the points [m]
_MASTERING = 2e-4  # of an encoder's zero [rad]
_ACROSS = 3e-4  # of a centre of mass, as seen on healthy development robots [m]
_TURNED = 0.1  # angle of the payload about the last axis, one with its encoder's zero [rad]
BENT = {
    "backlash": (2e-5, 3e-4, 2e-3),
    "gear_stiffness": (0.02, 0.2),
    "stribeck_velocity": (0.3, 2.0),
}
"""Severities with which strongly nonlinear effects are probed."""

_PROBE = 100  # tolerances that effects which are a torque are probed with
# Of the motor torque limit, for effects that are a torque; transmission error by its torque.
_OF_TORQUE = {
    "torque_offset": 2e-4,
    "torque_ripple": 2e-5,
    "transmission_error": 2e-5,
    "gravity_spring": 4e-5,
    "wrist_coupling_friction": 1e-4,
}


def check_names(what: str, given: Collection[str], known: Collection[str]) -> None:
    """Refuse unknown names.

    Args:
        what: Name of the option, for the message.
        given: Names to check.
        known: Names that are allowed.

    Raises:
        InputError: A name is not known.
    """
    for name in given:
        if name not in known:
            raise InputError(f"{what}: unknown name '{name}'; choose {', '.join(sorted(known))}")


def tolerance(name: str, robot: Robot, axis: int) -> float:
    """Return the standard deviation of an effect's severity among healthy robots: assumed.

    Args:
        name: Effect.
        robot: The robot.
        axis: Axis, from 1.

    Returns:
        Standard deviation, in the unit of the effect.
    """
    if name == "encoder_offset":
        return _TURNED if axis == robot.n_axes else _zero(robot, axis)
    if name in _FRACTIONS:
        return _FRACTIONS[name]
    limit = min(float(robot.motor_torque_limit[axis - 1]), _largest_friction(robot, axis))
    small = _OF_TORQUE.get(name, 4e-4) * limit
    ratio = abs(float(robot.gear_ratio[axis - 1]))
    if name == "transmission_error":
        gearbox = robot.ids("tendon", "gearbox")[axis - 1]
        return small * ratio / float(robot.model.tendon_stiffness[gearbox])
    if name == "torque_offset":
        friction = robot.model.actuator_biasprm[robot.ids("actuator", "friction")[axis - 1]]
        own = friction[OFFSET] * np.sin(friction[OFFSET + 2])
        return float(np.hypot(small, LINK_TOLERANCE * own))
    joint_side = name in ("gravity_spring", "wrist_coupling_friction")
    return small * ratio if joint_side else small


def _zero(robot: Robot, axis: int) -> float:
    """Tolerance of an encoder's zero [rad].

    It covers errors of mastering, and errors of the centre of mass. A centre of mass that is
    shifted across the arm looks like another zero, and more so if it is near the axis.
    """
    model = robot.model
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    joint = model.joint(f"joint{axis}").id
    lever = data.subtree_com[model.jnt_bodyid[joint]] - data.xanchor[joint]
    return float(np.hypot(_MASTERING, _ACROSS / max(float(np.linalg.norm(lever)), _ACROSS)))


def _largest_friction(robot: Robot, axis: int) -> float:
    """Torque limit that is assumed for a motor without a limit [N m]."""
    friction = robot.ids("actuator", "friction")[axis - 1]
    return 20 * float(robot.model.actuator_biasprm[friction, COULOMB])


def effect_terms(
    robot: Robot, exclude: Collection[str] = (), include: Collection[str] = ()
) -> list[Term]:
    """List the terms of every effect of the catalogue, for every axis on which it can act.

    Args:
        robot: The robot.
        exclude: Effects that are not considered.
        include: Effects of `OPTIONAL` that are considered.

    Returns:
        The terms, with their tolerances.
    """
    payload = robot.spec().body("payload") is not None
    terms = []
    for effect in EFFECTS.values():
        name = effect.name
        if name in (*exclude, *PERIODIC, *NO_COLUMN) or effect.same_as:
            continue
        if name in OPTIONAL and name not in include:
            continue
        if name.startswith("payload") and not payload:
            continue
        if name.startswith("payload") and _massless(robot):
            terms += payload_terms(robot) if name == PAYLOAD else []
            continue
        for axis in effect.axes(robot.n_axes):
            size = tolerance(name, robot, axis)
            terms += [
                Term(name, axis, step, size, parameters)
                for step in _steps(effect, size)
                for parameters in _kinds(robot, name, axis)
            ]
    return terms


def _kinds(robot: Robot, name: str, axis: int) -> list[tuple[tuple[str, float], ...]]:
    """Further parameters with which an effect is probed."""
    if name in _VARIANTS:
        return list(_VARIANTS[name])
    bias = robot.model.actuator_biasprm[robot.ids("actuator", "friction")[axis - 1]]
    if name != "low_speed_friction" or not no_static_friction(bias):
        return [()]
    return [(("width", float(width * bias[STRIBECK_VELOCITY])),) for width in _WIDTHS]


def _massless(robot: Robot) -> bool:
    body = mujoco.mj_name2id(robot.model, mujoco.mjtObj.mjOBJ_BODY, "payload")
    return body >= 0 and bool(robot.model.body_mass[body] < MASSLESS)


def payload_terms(robot: Robot) -> list[Term]:
    """Terms for a payload of unknown mass and place: four point masses that make one candidate.

    Weight and first moment are linear in the four masses. One of the masses may be negative,
    because only their sum and their common centre are used: together they are again one point mass.
    """
    places = np.vstack([np.zeros(3), _ARM * np.eye(3)])
    return [
        Term(PAYLOAD, robot.n_axes, 0.1, _POINTS, tuple(zip("xyz", place.tolist(), strict=True)))
        for place in places
    ]


def payload_of(
    masses: Sequence[float] | np.ndarray, places: np.ndarray
) -> tuple[float, np.ndarray]:
    """Combine point masses into one payload.

    Args:
        masses: Mass of each point [kg]. Shape (points,).
        places: Position of each point [m]. Shape (points, 3).

    Returns:
        Mass [kg], and position of the centre of mass [m], shape (3,), limited to 1 m in each
        direction. Both are 0 if there is practically no mass.
    """
    mass = float(np.sum(masses))
    if mass < MASSLESS:
        return 0.0, np.zeros(3)
    return mass, np.clip(np.asarray(masses) @ places / mass, -1.0, 1.0)


def applied(changes: Sequence[tuple[Term, float]]) -> list[Applied]:
    """List the effects among changes, ready for simulation. Payload points become one effect."""
    effects = [change for change in changes if change[0].is_effect]
    points = [(t, v) for t, v in effects if t.name == PAYLOAD and t.parameters]
    made = [
        Applied(t.name, t.axis, v, dict(t.parameters)) for t, v in effects if (t, v) not in points
    ]
    if points:
        places = np.array([[value for _, value in t.parameters] for t, _ in points])
        mass, place = payload_of([v for _, v in points], places)
        at = dict(zip("xyz", place.tolist(), strict=True))
        made.append(Applied(PAYLOAD, points[0][0].axis, mass, at))
    return made


def _steps(effect: Effect, size: float) -> tuple[float, ...]:
    """Severities that are large enough to be seen. Strongly nonlinear effects have several."""
    if effect.name in BENT:
        return BENT[effect.name]
    return (effect.step,) if effect.name in _FRACTIONS else (_PROBE * size,)


def periodic_terms(robot: Robot, name: str, axis: int, order: float) -> tuple[Term, Term]:
    """Return the sine and the cosine term of a periodic effect at one order.

    Args:
        robot: The robot.
        name: Effect, one of `PERIODIC`.
        axis: Axis, from 1.
        order: Cycles per motor turn.

    Returns:
        Two terms whose phases differ by a quarter of a cycle.
    """
    size = tolerance(name, robot, axis)

    def one(phase: float) -> Term:
        return Term(name, axis, 10 * _PROBE * size, size, (("order", order), ("phase", phase)))

    return one(0.0), one(np.pi / 2)


def with_tolerance(terms: Sequence[Term], factor: float) -> list[Term]:
    """Return the same terms with all tolerances multiplied by a factor.

    Args:
        terms: The terms.
        factor: Factor of the tolerances.

    Returns:
        New terms in the same order.
    """
    return [replace(term, tolerance=factor * term.tolerance) for term in terms]


def widened(terms: Sequence[Term], factor: float, known: Collection[str] = ()) -> list[Term]:
    """Return the same terms with the tolerances of the model's own numbers multiplied by a factor.

    Args:
        terms: All terms.
        factor: Factor of the tolerances of `NUMBERS`.
        known: Numbers that keep their tolerances.

    Returns:
        New terms in the same order.
    """
    names = set(NUMBERS) - set(known)
    return [
        replace(term, tolerance=factor * term.tolerance) if term.name in names else term
        for term in terms
    ]

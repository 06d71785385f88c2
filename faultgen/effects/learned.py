"""A torque on a rotor that follows a law learned from data, for what no other effect describes.

The law is a sum of terms. Each term is a curve over one variable of the commanded motion, given by
values at knots with straight lines between them. It may be multiplied by the direction of motion or
by the load. Beyond the first and the last knot a curve keeps its last value. The sum opposes the
motor, which has to deliver so much more torque.

    term = {"over": "abs_speed", "times": "direction", "knots": [0.0, 10.0], "values": [0.02, 0.0]}
    Applied("learned_law", 3, 1.0, {"law": [term]})

The variables belong to the commanded motion and to the nominal robot on it. They are known before
the simulation, so that a law costs no time in its steps. The torque is the control of an actuator
``learned_law{i}`` on the rotor, which the drive does not know of.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from faultgen.effects.base import Effect
from faultgen.effects.hooks import Place, Temperature
from faultgen.effects.law_course import FACTORS, UNITS, Course
from faultgen.effects.prior import Prior
from faultgen.errors import InputError

NAME = "learned_law"
"""Name of the effect."""


def law_torque(law: Sequence[Mapping[str, Any]], axis: int, course: Course) -> np.ndarray:
    """Compute the torque by which a law opposes the motor of an axis.

    Args:
        law: The terms.
        axis: Axis on which the law acts, from 1.
        course: The commanded motion.

    Returns:
        Shape (steps,), in [N m].
    """
    total = np.zeros(len(course.motor))
    for term in law:
        x = course.variable(term["over"], term.get("of", axis), term.get("scale", 1.0))
        curve = np.interp(x, term["knots"], term["values"])
        total += curve * course.factor(term.get("times", ""), term.get("of", axis))
    return total


_KEYS = ("over", "of", "scale", "times", "knots", "values")


def check_law(law: Any, n_axes: int) -> None:
    """Refuse what is no law.

    Args:
        law: The parameter as it was read from a file.
        n_axes: Number of axes of the robot.

    Raises:
        InputError: A term is wrong. The message is one line.
    """
    if not isinstance(law, Sequence) or isinstance(law, str):
        raise InputError(f"{NAME}: law must be a list of terms")
    for number, term in enumerate(law, start=1):
        where = f"{NAME}: term {number}"
        if not isinstance(term, Mapping) or not {"over", "knots", "values"} <= set(term):
            raise InputError(f"{where}: must be an object with over, knots and values")
        for key in term:
            if key not in _KEYS:
                raise InputError(f"{where}: unknown '{key}'; choose {', '.join(_KEYS)}")
        if term["over"] not in UNITS:
            raise InputError(f"{where}: over '{term['over']}'; choose {', '.join(UNITS)}")
        if term.get("times", "") not in FACTORS:
            raise InputError(f"{where}: times '{term['times']}'; choose {', '.join(FACTORS[1:])}")
        of, scale = term.get("of", 1), term.get("scale", 1.0)
        if of not in range(1, n_axes + 1):
            raise InputError(f"{where}: of {of}; the robot has axes 1 to {n_axes}")
        if not (_is_number(scale) and scale > 0):
            raise InputError(f"{where}: scale must be a positive number, not {scale}")
        for key in ("knots", "values"):
            if not isinstance(term[key], Sequence) or not all(map(_is_number, term[key])):
                raise InputError(f"{where}: {key} must be a list of numbers")
        knots, values = term["knots"], term["values"]
        if not knots or len(knots) != len(values) or np.any(np.diff(knots) <= 0):
            raise InputError(f"{where}: knots must ascend, and there must be a value for each")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and math.isfinite(value)


def add_actuator(
    spec: mujoco.MjSpec, axis: int, severity: float, *, law: Any, temperature: Temperature
) -> None:
    """Add the actuator ``learned_law{axis}``, whose control is a torque on the rotor.

    Args:
        spec: The robot, edited in place.
        axis: Axis, from 1.
        severity: Not used here.
        law: The terms.
        temperature: Not used here.

    Raises:
        InputError: The law is wrong.
    """
    n_axes = sum(actuator.name.startswith("drive") for actuator in spec.actuators)
    check_law(law, n_axes)
    name = f"{NAME}{axis}"
    if spec.actuator(name) is None:  # laws of one axis add up
        joint = mujoco.mjtTrn.mjTRN_JOINT
        spec.add_actuator(name=name, trntype=joint, target=f"motor{axis}")


def drive_law(control: np.ndarray, place: Place, repeats: bool) -> np.ndarray:
    """Put severity times the torque of the law into the control of its actuator.

    Args:
        control: Control signal in the units of the drives, shape (steps, n_controls).
        place: Where the effect acts, and its severity.
        repeats: Whether the control repeats.

    Returns:
        A new array with a column for every control of the model, shape (steps, nu).
    """
    model, robot = place.model, place.robot
    at = model.actuator_ctrladr[robot.ids("actuator", "drive", model)]
    motor = control[:, at]
    course = Course(
        robot=robot,
        motor=np.concatenate([motor, motor]) if repeats else motor,
        step=float(model.opt.timestep),
        temperature=place.parameters["temperature"],
        loads=place.loads,
        cycles=2 if repeats else 1,
    )
    torque = law_torque(place.parameters["law"], place.axis, course)[-len(motor) :]
    whole = np.zeros((len(control), model.nu))
    whole[:, : control.shape[1]] = control
    column = model.actuator_ctrladr[model.actuator(f"{NAME}{place.axis}").id]
    whole[:, column] -= place.severity * torque
    return whole


_EXAMPLE = [
    {"over": "abs_speed", "times": "direction", "knots": [0.0, 20.0], "values": [0.02, 0.0]}
]

EFFECTS = (
    Effect(
        name=NAME,
        description="a torque that follows a law which was learned from data (parameter law)",
        unit="share of the law (1 = as learned)",
        signature="whatever the law says; the default is 0.02 N m of friction below 20 rad/s",
        element="learned_law{i}, actuator on motor{i}, which the drive does not know of",
        prior=Prior(use="never", reason="a law is learned if no other effect explains the data"),
        source="additive regression on curves, see docs/discovery.md",
        largest=10.0,
        smallest=-10.0,
        step=1.0,
        parameters={"law": _EXAMPLE, "temperature": None},
        edit=add_actuator,
        command=drive_law,
    ),
)
"""Effects of this family."""

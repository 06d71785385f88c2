"""Effects of the motor and its drive."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from faultgen.effects.base import FRACTION, Effect
from faultgen.effects.hooks import Place
from faultgen.effects.prior import Prior
from faultgen.effects.spreads import SPREADS
from faultgen.errors import InputError

if TYPE_CHECKING:
    from faultgen.simulation.cycle import Cycle

_GAINS = slice(4, 7)  # kp, ki, kd of a dcmotor in mjModel.actuator_gainprm
_FEED_FORWARD = 2  # column of a drive's control


def scale_rotor_inertia(spec: mujoco.MjSpec, axis: int, severity: float) -> None:
    """Multiply the inertia of the rotor by 1 + severity.

    Args:
        spec: The robot, edited in place.
        axis: Axis, from 1.
        severity: Fraction of the nominal value.
    """
    joint = spec.joint(f"motor{axis}")
    joint.parent.inertia *= 1 + severity
    joint.armature *= 1 + severity


def lose_torque(spec: mujoco.MjSpec, axis: int, severity: float) -> None:
    """Multiply the gains and the torque limit of the drive by 1 - severity.

    Args:
        spec: The robot, edited in place.
        axis: Axis, from 1.
        severity: Fraction of the nominal torque constant that is lost.


    Raises:
        InputError: The severity is 1 or more.
    """
    if severity >= 1:
        raise InputError(f"torque_constant: severity must be below 1, not {severity:g}")
    drive = spec.actuator(f"drive{axis}")
    drive.gainprm[_GAINS] *= 1 - severity
    drive.forcerange = np.array(drive.forcerange) * (1 - severity)


def lose_feed_forward(control: np.ndarray, place: Place, repeats: bool) -> np.ndarray:
    """Multiply the feed-forward torque by 1 - severity.

    Args:
        control: Control signal in the units of the drives, shape (steps, n_controls).
        place: Where the effect acts, and its severity.
        repeats: Whether the control repeats.

    Returns:
        A new array of the same shape and units.
    """
    control = control.copy()
    at = place.model.actuator_ctrladr[place.element("actuator", "drive")]
    control[:, at + _FEED_FORWARD] *= 1 - place.severity
    return control


def log_believed_torque(truth: Cycle, logged: Cycle, place: Place) -> Cycle:
    """Compute the torque that the drive assumes: that of the motor divided by 1 - severity.

    Args:
        truth: The cycle as it was simulated.
        logged: The cycle as it is logged so far.
        place: Where the effect acts, and its severity.

    Returns:
        The cycle with the changed channel.
    """
    torque = logged.motor_torque.copy()
    torque[:, place.axis - 1] /= 1 - place.severity
    return replace(logged, motor_torque=torque)


EFFECTS = (
    Effect(
        name="rotor_inertia",
        description="the rotor is heavier than the model says",
        unit=FRACTION,
        signature="more torque in proportion to acceleration",
        element="body of motor{i}, inertia",
        prior=Prior(
            std=SPREADS["rotor_inertia"].std,
            steps=(0.1,),
            in_every_model=True,
            own_axis_only=True,
            at_motor=True,
        ),
        source="definition",
        smallest=-0.9,
        edit=scale_rotor_inertia,
    ),
    Effect(
        name="torque_constant",
        description="the motor gives less torque than its drive believes, as with weaker magnets",
        unit="fraction of nominal that is lost, below 1",
        signature="every torque of the axis is larger in the log, by the same factor",
        element="drive{i}, gains and limit; control and log",
        prior=Prior(
            std=SPREADS["torque_constant"].std,
            steps=(0.05,),
            in_every_model=True,
            own_axis_only=True,
            at_motor=True,
        ),
        source="torque = (1 - severity) of the logged one; magnets lose 0.1 to 0.2 % a kelvin",
        largest=0.9,
        smallest=-1.0,
        step=0.05,
        edit=lose_torque,
        command=lose_feed_forward,
        log=log_believed_torque,
    ),
)
"""Effects of this family."""

"""Effects that repeat with the angle of the motor: torque ripple and errors of the gearbox."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from faultgen.effects.base import Effect
from faultgen.effects.elements import add_cogging, add_tendon, gear_ratio
from faultgen.effects.hooks import Place
from faultgen.effects.prior import Prior, of_gearbox_angle, of_motor_torque
from faultgen.effects.spreads import SPREADS
from faultgen.errors import InputError

if TYPE_CHECKING:
    from faultgen.simulation.cycle import Cycle

_WAVE = {"order": 2.0, "phase": 0.0, "per": "motor"}


def motor_order(order: float, per: str, ratio: float) -> float:
    """Return the number of periods per turn of the motor.

    Args:
        order: Periods per turn of the motor or of the joint; any positive number.
        per: 'motor' or 'joint': whose turn is meant.
        ratio: Gear ratio, signed.

    Returns:
        Periods per turn of the motor.

    Raises:
        InputError: `per` is another word, or the order is not positive.
    """
    if per not in ("motor", "joint"):
        raise InputError(f"per: choose motor or joint, not '{per}'")
    if not (np.isfinite(order) and order > 0):
        raise InputError(f"order: must be positive, not {order}")
    return order if per == "motor" else order / ratio


def add_ripple(
    spec: mujoco.MjSpec, axis: int, severity: float, *, order: float, phase: float, per: str
) -> None:
    """Add the torque severity sin(order angle + phase) on the rotor.

    Args:
        spec: The robot, edited in place.
        axis: Axis, from 1.
        severity: Amplitude [N m].
        order: Periods per turn of the motor or of the joint.
        phase: Phase [rad].
        per: 'motor' or 'joint': whose turn and angle are meant.

    Raises:
        InputError: As `motor_order`.
    """
    poles = motor_order(order, per, gear_ratio(spec, axis))
    add_cogging(spec, f"torque_ripple{axis}", f"motor{axis}", severity, poles, phase)


def add_transmission_error(
    spec: mujoco.MjSpec, axis: int, severity: float, *, order: float, phase: float, per: str
) -> None:
    """Add an error e to the twist of the gearbox, e = severity sin(order q_m + phase).

    The elastic energy k (twist + e)^2 / 2 gives, in addition to that of the healthy gearbox,

        on the joint   k e
        on the rotor   -k e / n  -  k twist de/dq_m  -  k e de/dq_m

    Two cogging motors on tendons of length q_m + b q and q_m - b q carry k e / b each, in opposite
    directions. Their remaining torque on the rotor is the middle term. Two cogging motors on the
    rotor carry the other terms. Damping stays that of the twist alone.

    Args:
        spec: The robot, edited in place.
        axis: Axis, from 1.
        severity: Amplitude of e [rad, joint side].
        order: Periods per turn of the motor or of the joint.
        phase: Phase [rad].
        per: 'motor' or 'joint': whose turn and angle are meant.

    Raises:
        InputError: As `motor_order`.
    """
    ratio = gear_ratio(spec, axis)
    poles = motor_order(order, per, ratio)
    stiffness = float(spec.tendon(f"gearbox{axis}").stiffness[0])
    name, rotor = f"transmission_error{axis}", f"motor{axis}"
    # small, so that the phase on the tendon is that of the motor up to order b twist
    b = 1.0 / max(1.0, abs(poles))
    for side in (b, -b):
        tendon = add_tendon(spec, name, {rotor: 1.0, f"joint{axis}": side})
        force = stiffness * severity / (2 * side)
        add_cogging(spec, name, tendon, force, poles / (1 + side / ratio), phase)
    add_cogging(spec, name, rotor, -stiffness * severity / ratio, poles, phase)
    double = stiffness * severity**2 * poles / 2
    add_cogging(spec, name, rotor, -double, 2 * poles, 2 * phase)


def log_transmission_error(truth: Cycle, logged: Cycle, place: Place) -> Cycle:
    """Add the torque of the error to the logged torque of the gearbox.

    Args:
        truth: The cycle as it was simulated.
        logged: The cycle as it is logged so far.
        place: Where the effect acts, and its severity.

    Returns:
        The cycle with the changed channel.
    """
    given, i = place.parameters, place.axis - 1
    poles = motor_order(given["order"], given["per"], place.robot.gear_ratio[i])
    error = place.severity * np.sin(poles * truth.motor_position[:, i] + given["phase"])
    return with_error(logged, place, error)


def with_error(logged: Cycle, place: Place, error: np.ndarray) -> Cycle:
    """Add the torque of a gearbox error to the logged torque of the gearbox.

    Args:
        logged: The cycle as it is logged so far.
        place: Where the effect acts.
        error: Error of the teeth [rad, joint side], shape (samples,).

    Returns:
        The cycle with the changed channel.
    """
    torque = logged.gear_torque.copy()
    stiffness = place.model.tendon_stiffness[place.element("tendon", "gearbox")]
    torque[:, place.axis - 1] += stiffness * error
    return replace(logged, gear_torque=torque)


EFFECTS = (
    Effect(
        name="torque_ripple",
        description="torque of the motor ripples with its angle: cogging, uneven currents",
        unit="N m, motor side, amplitude",
        units="N m",
        motor_torque=True,
        signature="a sine over the motor's angle, at all speeds, also at rest",
        element="torque_ripple{i}, passive dcmotor with cogging",
        prior=Prior(
            use="periodic",
            std=of_motor_torque(SPREADS["torque_ripple"].std),
            steps_in_std=1000,
            own_axis_only=True,
            at_motor=True,
        ),
        source="amplitude sin(order q_m + phase); 0.5 to 2 % of the rated torque are usual",
        step=0.01,
        parameters=_WAVE,
        edit=add_ripple,
    ),
    Effect(
        name="transmission_error",
        description="teeth are not where they should be: the gearbox leads and lags by the angle",
        unit="rad, joint side, amplitude",
        units="rad",
        slide_units="m",
        signature="a sine over the motor's angle, strongest where it meets a resonance",
        element="transmission_error{i}, four passive dcmotors with cogging",
        prior=Prior(
            use="periodic",
            std=of_gearbox_angle(SPREADS["transmission_error"].std),
            steps_in_std=1000,
        ),
        source="kinematic error of harmonic drives, 0.3 to 1 arc minute, twice a motor turn",
        largest=0.01,
        step=3e-5,
        parameters=_WAVE,
        edit=add_transmission_error,
        last=True,
        log=log_transmission_error,
    ),
)
"""Effects of this family."""

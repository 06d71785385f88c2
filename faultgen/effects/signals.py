"""Effects of the controller's signals: the zero of its encoder, and its clock."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from faultgen.effects.base import Effect
from faultgen.effects.hooks import Place
from faultgen.effects.prior import Prior, encoder_zero_std
from faultgen.effects.spreads import SPREADS

if TYPE_CHECKING:
    from faultgen.simulation.cycle import Cycle


def shift_position(control: np.ndarray, place: Place, repeats: bool) -> np.ndarray:
    """Shift the set point of the position by the error of the encoder.

    Args:
        control: Control signal in the units of the drives, shape (steps, n_controls).
        place: Where the effect acts, and its severity.
        repeats: Whether the control repeats.

    Returns:
        A new array of the same shape and units.
    """
    control = control.copy()
    at = place.model.actuator_ctrladr[place.element("actuator", "drive")]
    control[:, at] += place.severity * place.robot.gear_ratio[place.axis - 1]
    return control


def log_encoder(truth: Cycle, logged: Cycle, place: Place) -> Cycle:
    """Compute the motor's position as its encoder measures it.

    Args:
        truth: The cycle as it was simulated.
        logged: The cycle as it is logged so far.
        place: Where the effect acts, and its severity.

    Returns:
        The cycle with the changed channel.
    """
    position = logged.motor_position.copy()
    position[:, place.axis - 1] -= place.severity * place.robot.gear_ratio[place.axis - 1]
    return replace(logged, motor_position=position)


def delay_control(control: np.ndarray, place: Place, repeats: bool) -> np.ndarray:
    """Delay set points and feed-forward of the axis by severity [s], linearly between steps.

    A control that repeats continues periodically before its start. Otherwise the first row is used
    there.

    Args:
        control: Control signal in the units of the drives, shape (steps, n_controls).
        place: Where the effect acts, and its severity.
        repeats: Whether the control repeats.

    Returns:
        A new array of the same shape and units.
    """
    control = control.copy()
    drive = place.element("actuator", "drive")
    columns = place.model.actuator_ctrladr[drive] + np.arange(place.model.actuator_ctrlnum[drive])
    steps = len(control)
    at = np.arange(steps) - place.severity / place.model.opt.timestep
    whole = np.floor(at)
    share = (at - whole)[:, None]
    rows = np.stack([whole, whole + 1]).astype(np.int64)
    rows = rows % steps if repeats else np.clip(rows, 0, steps - 1)
    source = control[:, columns]
    control[:, columns] = (1 - share) * source[rows[0]] + share * source[rows[1]]
    return control


EFFECTS = (
    Effect(
        name="encoder_offset",
        description="the zero of the motor's encoder is off: true angle = logged angle + severity",
        unit="rad, joint side",
        units="rad",
        slide_units="m",
        signature="gravity of another pose, on this axis and those before it",
        element="control and log of position",
        prior=Prior(std=encoder_zero_std, steps=(0.05,)),
        source="definition",
        largest=0.5,
        smallest=-0.5,
        step=0.01,
        command=shift_position,
        log=log_encoder,
    ),
    Effect(
        name="delay",
        description="set points and feed-forward reach the drive late, or the log's clock is off",
        unit="s, positive where the drive is late",
        units="s",
        signature="torque shifts in time: a gap in proportion to the change of torque",
        element="control of drive{i}",
        prior=Prior(std=SPREADS["delay"].std, steps=(2e-3,)),
        source="definition",
        largest=0.1,
        smallest=-0.1,
        step=2e-3,
        command=delay_control,
    ),
)
"""Effects of this family."""

"""A phase of the motor that gives less torque than its current should.

MuJoCo has no element whose torque is multiplied by a function of the angle. The sine of the angle
is part of an element. Its amplitude, the torque of the drive, is set between steps.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from faultgen.effects.base import Effect
from faultgen.effects.elements import add_cogging, numbered
from faultgen.effects.hooks import Moment, Place, Update
from faultgen.effects.prior import Prior, Search, Seen
from faultgen.errors import InputError
from faultgen.robot import OFFSET

_RIPPLE, _LOSS = "winding_ripple", "winding_loss"
_SHARE = 1 / 3  # of a phase in the mean torque
_NOTHING = 1e-12  # until they are told [N m]


def add_winding(
    spec: mujoco.MjSpec, axis: int, severity: float, *, pole_pairs: int, phase: float
) -> None:
    """Add a ripple of twice the electrical frequency and a loss. Both have no torque yet.

    Args:
        spec: The robot, edited in place.
        axis: Axis, from 1.
        severity: Not used here.
        pole_pairs: Number of pole pairs of the motor.
        phase: Phase of the ripple [rad].

    Raises:
        InputError: The number of pole pairs is not a positive whole number.
    """
    if pole_pairs < 1 or pole_pairs != int(pole_pairs):
        raise InputError(f"pole_pairs: must be 1, 2, 3 or more, not {pole_pairs}")
    quarter = math.pi / 2
    rotor = f"motor{axis}"
    add_cogging(spec, f"{_RIPPLE}{axis}", rotor, _NOTHING, 2.0 * pole_pairs, phase + quarter)
    add_cogging(spec, f"{_LOSS}{axis}", rotor, _NOTHING, 0.0, quarter)


def follow_torque(places: Sequence[Place]) -> Update:
    """Subtract severity / 3 (1 + cos(2 p q_m + phase)) of the drive's torque.

    Three phases with currents I cos(x - k 120 deg) in a flux of the same form give torque I cos^2
    each, together 3 I / 2. If one of them gives 1 - severity of its own, 1 - severity (1 + cos 2x)
    / 3 of the whole remains. The drive's torque is predicted for the middle of the steps until the
    next update, from its set points then and the present speed.
    """
    robot, model = places[0].robot, places[0].model
    axes = [place.axis for place in places]
    elements = [
        [
            model.actuator(numbered(f"{name}{axis}", axes[: k + 1].count(axis))).id
            for name in (_RIPPLE, _LOSS)
        ]
        for k, axis in enumerate(axes)
    ]
    at = np.array(axes) - 1
    motors = robot.addresses(model)[0][at]
    drive = robot.ids("actuator", "drive", model)[at]
    columns = model.actuator_ctrladr[drive]
    stiffness, damping = model.actuator_gainprm[drive][:, [4, 6]].T
    limited = model.actuator_forcelimited[drive].astype(bool)[:, None]
    low, high = np.where(limited, model.actuator_forcerange[drive], [-np.inf, np.inf]).T
    share = _SHARE * np.array([place.severity for place in places])

    def update(moment: Moment) -> None:
        speed = moment.qvel[:, motors]
        middle = (moment.interval - model.opt.timestep) / 2
        behind = moment.control[:, columns] - moment.qpos[:, motors] - speed * middle
        torque = stiffness * behind + damping * (moment.control[:, columns + 1] - speed)
        torque = np.clip(torque + moment.control[:, columns + 2], low, high)
        moment.biasprm[:, elements, OFFSET] = -(share * torque)[..., None]

    return update


def _missing(seen: Seen, parameters: Mapping[str, Any]) -> np.ndarray:
    """Torque that is missing on the rotor if one phase gives nothing."""
    angle = 2 * parameters["pole_pairs"] * seen.motor + parameters["phase"]
    return -_SHARE * seen.torque * (1 + np.cos(angle))


EFFECTS = (
    Effect(
        name="winding_fault",
        description="turns of one phase are shorted or open: that phase gives less torque",
        unit="fraction of one phase's torque that is lost",
        signature="a sine over the motor's angle, twice an electrical turn, and a loss, both in "
        "proportion to torque",
        element="winding_ripple{i}, winding_loss{i}, passive dcmotors with cogging, told the "
        "torque of drive{i} between steps",
        prior=Prior(
            use="searched",
            search=tuple(
                Search(
                    parameter="phase",
                    spacing=0.2,
                    others={"pole_pairs": pairs},
                    cause=_missing,
                )
                for pairs in (2, 3, 4, 5)
            ),
            at_motor=True,
        ),
        source="torque = (1 - severity (1 + cos(2 p q_m + phase)) / 3) of the logged one: three "
        "phases with sinusoidal flux and current; 4 pole pairs are assumed",
        largest=1.0,
        step=0.1,
        parameters={"pole_pairs": 4, "phase": 0.0},
        edit=add_winding,
        between=follow_torque,
        interval=1e-3,
    ),
)
"""Effects of this family."""

"""Friction that grows with the load of the gearbox, which no element of MuJoCo has.

A separate friction element represents it. Its friction torque is set between steps.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from faultgen.effects.base import Effect
from faultgen.effects.elements import ToldFriction, add_told_friction
from faultgen.effects.hooks import Moment, Place, Update
from faultgen.effects.prior import Prior
from faultgen.effects.spreads import SPREADS
from faultgen.mjcf.gearbox import Gearbox


def add_element(spec: mujoco.MjSpec, axis: int, severity: float) -> None:
    """Add the element ``load_friction{axis}``. It has no friction until it is set between steps.

    Args:
        spec: The robot, edited in place.
        axis: Axis, from 1.
        severity: Not used here.
    """
    name = f"load_friction{axis}"
    if spec.actuator(name) is None:
        add_told_friction(spec, name, axis)


def follow_load(places: Sequence[Place]) -> Update:
    """Make Coulomb friction equal to severity |gear torque / n|.

    The torque is predicted for the middle of the time until the next update, from the present rate
    of the twist. Friction that is constant over this time is then right to second order in it.
    """
    robot, model = places[0].robot, places[0].model
    shares = np.zeros(robot.n_axes)
    for place in places:
        shares[place.axis - 1] += place.severity
    axes = np.flatnonzero(shares)
    share, ratio = shares[axes], robot.gear_ratio[axes]
    motors, joints = robot.addresses(model)
    gearbox = Gearbox(model, robot.ids("tendon", "gearbox", model)[axes])
    numbers = (axes + 1).tolist()
    friction = ToldFriction(robot, model, [f"load_friction{axis}" for axis in numbers], numbers)

    def update(moment: Moment) -> None:
        twist, rate = (
            (state[:, motors] / robot.gear_ratio - robot.gearing.outputs(state[:, joints]))[:, axes]
            for state in (moment.qpos, moment.qvel)
        )
        load = np.abs(gearbox.torque(twist + rate * (moment.interval / 2), rate) / ratio)
        friction.tell(moment, share * load)

    return update


EFFECTS = (
    Effect(
        name="load_friction",
        description="Coulomb friction of the motor side grows with the torque of the gearbox",
        unit="fraction of the gearbox's torque, motor side (N m a N m)",
        signature="more torque against the motion where the gearbox carries more",
        element="load_friction{i}, passive dcmotor lugre, told the load between steps",
        prior=Prior(
            std=SPREADS["load_friction"].std,
            steps=(0.03,),
            own_axis_only=True,
            at_motor=True,
        ),
        source="load term of Bittencourt et al. 2010, F_c + 0.023 |load|",
        largest=1.0,
        step=0.03,
        edit=add_element,
        between=follow_load,
    ),
)
"""Effects of this family."""

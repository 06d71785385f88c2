"""Friction that grows with the load of the gearbox. No element of MuJoCo has it."""

from __future__ import annotations

import numpy as np

from faultgen.effects.base import Effect, Moment, Place, Update
from faultgen.gearbox import gearbox_torque
from faultgen.robot import COULOMB, STICTION


def add_load_friction(place: Place) -> Update:
    """Coulomb friction grows by severity |gear torque / n|, at the torque of the last update."""
    i = place.axis - 1
    model, ratio = place.model, place.robot.gear_ratio[i]
    motor, joint = place.robot.motors[i], place.robot.joints[i]
    friction = place.element("actuator", "friction")
    gearbox = np.array([place.element("tendon", "gearbox")])

    def update(moment: Moment) -> None:
        twist = moment.qpos[:, [motor]] / ratio - moment.qpos[:, [joint]]
        rate = moment.qvel[:, [motor]] / ratio - moment.qvel[:, [joint]]
        load = np.abs(gearbox_torque(model, gearbox, twist, rate)[:, 0] / ratio)
        moment.biasprm[:, friction, COULOMB] += place.severity * load
        moment.biasprm[:, friction, STICTION] += place.severity * load

    return update


EFFECTS = (
    Effect(
        name="load_friction",
        description="Coulomb friction of the motor side grows with the torque of the gearbox",
        unit="N m of friction a N m of load, motor side",
        signature="more torque against the motion where the gearbox carries more",
        element="friction{i}, dcmotor lugre: coulomb and static, between steps",
        source="load term of Bittencourt et al. 2010, F_c + 0.023 |load|",
        largest=1.0,
        step=0.03,
        between=add_load_friction,
    ),
)
"""Effects of this family."""

"""Friction that grows with the load of the gearbox. No element of MuJoCo has it.

An element of its own carries it, whose bristles get stiffer with the load as friction grows: their
deflection in sliding is the same at every load, so that a changing load does not excite them.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from faultgen.effects.base import Effect, Moment, Place, Update
from faultgen.effects.elements import add_lugre
from faultgen.gearbox import Gearbox
from faultgen.robot import BRISTLE_DAMPING, BRISTLE_STIFFNESS, COULOMB, STICTION, STRIBECK_VELOCITY

_SLIDING = slice(COULOMB, STICTION + 1)
_BRISTLES = slice(BRISTLE_STIFFNESS, BRISTLE_DAMPING + 1)
_NOTHING = 1e-12  # MuJoCo divides by friction [N m]


def add_element(spec: mujoco.MjSpec, axis: int, severity: float) -> None:
    """Add the element ``load_friction{axis}``, which holds nothing until it is told the load."""
    name = f"load_friction{axis}"
    if spec.actuator(name) is None:
        width = spec.actuator(f"friction{axis}").biasprm[STRIBECK_VELOCITY]
        lugre = [_NOTHING, _NOTHING, _NOTHING, _NOTHING, width]
        add_lugre(spec, name, f"motor{axis}", lugre)


def follow_load(places: Sequence[Place]) -> Update:
    """Coulomb friction is severity |gear torque / n|.

    The torque is that in the middle of the time until the next update, as the rate of the twist
    tells it now: held constant, friction is then right to second order in that time.
    """
    robot, model = places[0].robot, places[0].model
    shares = np.zeros(robot.n_axes)
    for place in places:
        shares[place.axis - 1] += place.severity
    axes = np.flatnonzero(shares)
    share, ratio = shares[axes], robot.gear_ratio[axes]
    motors, joints = np.array(robot.motors)[axes], np.array(robot.joints)[axes]
    gearbox = Gearbox(model, robot.ids("tendon", "gearbox", model)[axes])
    element = np.array([model.actuator(f"load_friction{axis + 1}").id for axis in axes])
    friction = robot.ids("actuator", "friction", model)[axes]
    # bristles as those of the axis' own friction, for each N m that they hold
    bristles = model.actuator_dynprm[friction, _BRISTLES]
    bristles = bristles / model.actuator_biasprm[friction, COULOMB][:, None]

    def update(moment: Moment) -> None:
        twist = moment.qpos[:, motors] / ratio - moment.qpos[:, joints]
        rate = moment.qvel[:, motors] / ratio - moment.qvel[:, joints]
        load = np.abs(gearbox.torque(twist + rate * (moment.interval / 2), rate) / ratio)
        held = (share * load + _NOTHING)[..., None]
        moment.biasprm[:, element, _SLIDING] = held
        moment.dynprm[:, element, _BRISTLES] = held * bristles

    return update


EFFECTS = (
    Effect(
        name="load_friction",
        description="Coulomb friction of the motor side grows with the torque of the gearbox",
        unit="fraction of the gearbox's torque, motor side (N m a N m)",
        signature="more torque against the motion where the gearbox carries more",
        element="load_friction{i}, passive dcmotor lugre, told the load between steps",
        source="load term of Bittencourt et al. 2010, F_c + 0.023 |load|",
        largest=1.0,
        step=0.03,
        edit=add_element,
        between=follow_load,
    ),
)
"""Effects of this family."""

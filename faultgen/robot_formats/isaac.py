"""The numbers of the joints as Isaac Lab and Isaac Sim name them.

The names of the fields are those of ``ActuatorBaseCfg`` in Isaac Lab 2.3. In Isaac Sim 5.0 and
later, `friction` and `dynamic_friction` are efforts in [N m] (before, `friction` was a number
without unit), and `viscous_friction` is in [N m s/rad]. The attributes of a USD file are those of
``PhysxJointAxisAPI`` and ``PhysicsDriveAPI``. There, angles are in degrees.

Source: comments of isaaclab.actuators.ActuatorBaseCfg (Isaac Lab 2.3 and 3.0); PhysX 5.6,
PxJointFrictionParams; ovphysx 0.7, page PhysxJointAxisAPI, for the degrees.
"""

from __future__ import annotations

import math
from typing import Any

from faultgen.robot_formats.joints import JointNumbers

VERSION = "Isaac Lab 2.3, Isaac Sim 5.0 or later (PhysX 5.6)"
"""The programs whose names and units are used."""

_PER_DEGREE = math.pi / 180
_FIELDS = {
    "stiffness": "kp",
    "damping": "kd",
    "effort_limit_sim": "effort_limit",
    "velocity_limit_sim": "velocity_limit",
    "armature": "armature",
    "friction": "static_friction",
    "dynamic_friction": "frictionloss",
    "viscous_friction": "damping",
}
"""Fields of ActuatorBaseCfg, and the numbers that they get."""


def isaac_numbers(rows: list[JointNumbers]) -> dict[str, Any]:
    """Return the numbers of the joints in the form that Isaac Lab and Isaac Sim take.

    Args:
        rows: The numbers of each axis.

    Returns:
        ``implicit_actuator``: arguments of ``ImplicitActuatorCfg``, each by joint, in [rad] and
        [N m], or [m] and [N]. ``usd``: attributes of the joints in a USD file, by joint, in [deg]
        and [N m], or [m] and [N]. Limits that the robot does not have are left out.
    """
    lab: dict[str, Any] = {"joint_names_expr": [row.joint for row in rows]}
    for field, number in _FIELDS.items():
        values = {row.joint: getattr(row, number) for row in rows}
        lab[field] = {joint: value for joint, value in values.items() if math.isfinite(value)}
    return {
        "version": VERSION,
        "units": {
            "implicit_actuator": "rad, N m, kg m^2 (slides: m, N, kg), s",
            "usd": "deg, N m, kg m^2 (slides: m, N, kg), s",
        },
        "implicit_actuator": lab,
        "usd": {row.joint: _usd(row) for row in rows},
    }


def _usd(row: JointNumbers) -> dict[str, float]:
    """Attributes of one joint in a USD file whose units are metres and kilograms."""
    which, degree = ("linear", 1.0) if row.kind == "slide" else ("angular", _PER_DEGREE)
    found = {
        f"physxJointAxis:{which}:armature": row.armature,
        f"physxJointAxis:{which}:staticFrictionEffort": row.static_friction,
        f"physxJointAxis:{which}:dynamicFrictionEffort": row.frictionloss,
        f"physxJointAxis:{which}:viscousFrictionCoefficient": row.damping * degree,
        f"physxJointAxis:{which}:maxJointVelocity": row.velocity_limit / degree,
        f"drive:{which}:physics:stiffness": row.kp * degree,
        f"drive:{which}:physics:damping": row.kd * degree,
        f"drive:{which}:physics:maxForce": row.effort_limit,
        "physics:lowerLimit": row.lower / degree,
        "physics:upperLimit": row.upper / degree,
    }
    return {name: value for name, value in found.items() if math.isfinite(value)}

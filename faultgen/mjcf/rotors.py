"""Rotors: nesting those whose inertia is coupled, and taking drives out of a model."""

from __future__ import annotations

import mujoco
import numpy as np

COUPLING = "wrist_coupling"
"""Name of the elements with friction and inertia that two neighbouring axes share."""

_BODY = 1e-3  # share of the inertia that belongs to the body of a nested rotor: assumed


def nest_rotor(spec: mujoco.MjSpec, axis: int) -> None:
    """Put the rotor of an axis into the same kinematic tree as the rotor of the axis before.

    MuJoCo ignores the inertia of a tendon between two trees except for its effect on each of them
    alone, and says nothing. Within one tree it is right. The rotor becomes a child of the other
    one, with a perpendicular axis. Nearly all of its inertia is armature of its joint, so that it
    turns as before: the other rotor gains a thousandth of this inertia, and its own is reduced by
    as much.

    Args:
        spec: The robot, edited in place.
        axis: Number of the axis, from 2.
    """
    joint, other = spec.joint(f"motor{axis}"), spec.joint(f"motor{axis - 1}")
    rotor, parent = joint.parent, other.parent
    if rotor.parent.name == parent.name:
        return
    name, inertia = rotor.name, float(rotor.inertia[2]) + float(joint.armature)
    rotor.name, joint.name = f"{name} before", f"{joint.name} before"
    nested = parent.add_body(name=name, mass=rotor.mass, explicitinertial=True)
    nested.inertia, nested.ipos, nested.iquat = [_BODY * inertia] * 3, [0, 0, 0], [1, 0, 0, 0]
    own = nested.add_joint(
        name=f"motor{axis}",
        axis=_perpendicular(np.array(other.axis)),
        armature=(1 - _BODY) * inertia,
        range=joint.range,
        limited=joint.limited,
    )
    own.damping, own.frictionloss = joint.damping, joint.frictionloss
    parent.inertia -= _BODY * inertia
    spec.delete(rotor)


def delete_drives(spec: mujoco.MjSpec, n_axes: int) -> None:
    """Take rotors, gearboxes, actuators and the play of a loose tool out of a robot, in place.

    Args:
        spec: The robot, which becomes its rigid arm.
        n_axes: Number of axes.
    """
    for actuator in list(spec.actuators):
        spec.delete(actuator)
    rotors = [spec.joint(f"motor{i + 1}").parent for i in range(n_axes)]
    for tendon in list(spec.tendons):
        if tendon.name.startswith(("gearbox", COUPLING)):
            spec.delete(tendon)
    names = {rotor.name for rotor in rotors}
    for rotor in [one for one in rotors if one.parent.name not in names]:  # with nested ones
        spec.delete(rotor)
    held = spec.body("payload")
    for play in list(held.joints) if held is not None else []:  # of a loose tool
        spec.delete(spec.tendon(play.name))
        spec.delete(play)


def _perpendicular(axis: np.ndarray) -> np.ndarray:
    """A unit vector perpendicular to an axis."""
    axis = axis / np.linalg.norm(axis)
    furthest = np.eye(3)[np.argmin(np.abs(axis))]
    across = furthest - (furthest @ axis) * axis
    return np.asarray(across / np.linalg.norm(across))

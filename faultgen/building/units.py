"""Numbers in the wrong unit: angles in degrees, lengths in millimetres, masses in grams."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from faultgen.building.findings import Finding

_WIDEST = 8 * np.pi  # range of a hinge [rad]
_NARROW = np.radians(15.0)  # if all ranges are below it, they were probably radians
_LONGEST = 20.0  # arm [m]
_BULKY = 10.0  # extent of a shape over the length of the arm
_DENSE, _THIN = 5000.0, 0.2  # mass of an arm over the square of its length [kg/m^2]
_FARTHEST, _HEAVIEST = 1e3, 1e6  # [m], [kg]; beyond them it is no link of an arm, in any unit
_SPREAD = 30.0  # radius of gyration over the length of the arm, beyond which no arm is built
_GRAVITY = 9.0, 10.5  # [m/s^2]; on earth 9.78 to 9.83, and 10 in simple models
_FAR = 1.5  # radius of gyration over the length of the arm


def unit_findings(model: mujoco.MjModel, joints: Sequence[str], payload: bool) -> list[Finding]:
    """List what looks like a wrong unit. None of these findings is fatal.

    Args:
        model: The compiled plain arm.
        joints: Names of the axes, which are the first joints of the model.
        payload: Whether the model has a body ``payload``, whose mass is not judged.
    """
    found = []
    hinge = model.jnt_type == int(mujoco.mjtJoint.mjJNT_HINGE)
    width = np.where(model.jnt_limited, np.ptp(model.jnt_range, axis=1), 0.0)
    for k, name in enumerate(joints):
        if hinge[k] and width[k] > _WIDEST:
            found.append(
                Finding(
                    f"joint '{name}'",
                    f"turns by {width[k]:.0f} rad, which is {width[k] / (2 * np.pi):.0f} turns",
                    "its range was probably meant in degrees: a URDF has radians; MJCF with "
                    '<compiler angle="radian"/> has them too',
                    fatal=False,
                )
            )
    narrow = hinge & (width > 0)
    if narrow.any() and width[narrow].max() < _NARROW:
        found.append(
            Finding(
                "joints",
                f"none turns by more than {np.degrees(width[narrow].max()):.1f} deg",
                'their ranges were probably meant in radians: add <compiler angle="radian"/>',
                fatal=False,
            )
        )
    length = length_of(model)
    if length > _LONGEST:
        remedy = "lengths are in metres; were millimetres meant?"
        found.append(Finding("arm", f"is {length:.3g} m long", remedy, fatal=False))
    for k in range(model.ngeom):
        mesh = model.geom_type[k] == int(mujoco.mjtGeom.mjGEOM_MESH)
        extent = 2 * float(model.geom_aabb[k, 3:].max())
        if mesh and extent > _BULKY * max(length, 0.1):
            name = model.mesh(model.geom_dataid[k]).name
            found.append(
                Finding(
                    f"mesh '{name}'",
                    f"is {extent:.3g} m large, but the arm is {length:.3g} m long",
                    'it is probably in millimetres: give it scale="0.001 0.001 0.001"',
                    fatal=False,
                )
            )
    mass = model.body_mass.copy()
    if payload:
        mass[model.body("payload").id] = 0.0
    moving = np.arange(model.nbody) >= model.jnt_bodyid.min()
    total, area = float(mass[moving].sum()), max(length, 0.05) ** 2
    if not _THIN * area <= total <= _DENSE * area:
        remedy = "masses are in kg and lengths in m"
        what = f"weighs {total:.3g} kg and is {length:.3g} m long"
        found.append(Finding("arm", what, remedy, fatal=False))
    for k in np.flatnonzero(moving & (mass > 0)).tolist():
        radius = np.sqrt(model.body_inertia[k].max() / mass[k])
        if radius > _FAR * max(length, 0.1):
            found.append(
                Finding(
                    f"link '{model.body(k).name}'",
                    f"its inertia is that of its mass at a distance of {radius:.3g} m",
                    "inertias are in kg m^2, about the centre of mass",
                    fatal=False,
                )
            )
    return found


def impossible_links(model: mujoco.MjModel, names: Sequence[str]) -> list[Finding]:
    """List the links and joints that are too large or heavy to be computed with.

    Args:
        model: The compiled plain arm, whose axes are ``joint1``, ``joint2``, ...
        names: Names of the axes in the file.

    Returns:
        Findings; all of them are fatal.
    """
    found = []
    length = max(length_of(model), 0.1)
    for k in range(1, model.nbody):
        where, mass = f"link '{model.body(k).name}'", float(model.body_mass[k])
        away = float(max(np.abs(model.body_pos[k]).max(), np.abs(model.body_ipos[k]).max()))
        radius = np.sqrt(float(model.body_inertia[k].max()) / mass) if mass > 0 else 0.0
        if away > _FARTHEST:
            what = f"it or its centre of mass is {away:.3g} m away from the joint before it"
            found.append(Finding(where, what, "lengths are in metres"))
        elif mass > _HEAVIEST:
            found.append(Finding(where, f"has the mass {mass:.3g} kg", "masses are in kg"))
        elif radius > _SPREAD * length:
            what = f"its inertia is that of its mass at a distance of {radius:.3g} m"
            found.append(Finding(where, what, "inertias are in kg m^2"))
    for axis, name in enumerate(names, start=1):
        k = model.joint(f"joint{axis}").id
        where, away = f"joint '{name}'", float(np.abs(model.jnt_pos[k]).max())
        slides = model.jnt_type[k] == int(mujoco.mjtJoint.mjJNT_SLIDE)
        reach = float(np.abs(model.jnt_range[k]).max()) if slides and model.jnt_limited[k] else 0.0
        if max(away, reach) > _FARTHEST:
            what = "its range" if reach > away else "its axis"
            what += f" is up to {max(away, reach):.3g} m away from its link"
            found.append(Finding(where, what, "lengths are in metres"))
    return found


def gravity_warnings(model: mujoco.MjModel) -> list[str]:
    """Write in one line what is unusual about the gravity of a model.

    Args:
        model: The compiled model.
    """
    off = bool(model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_GRAVITY))
    size = 0.0 if off else float(np.linalg.norm(model.opt.gravity))
    if size == 0:
        where = '<flag gravity="disable"/>' if off else '<option gravity="0 0 0"/>'
        return [
            f"gravity is 0 ({where}): the motors carry nothing, and the payload has no weight; "
            "remove it if the arm is not planar"
        ]
    if not _GRAVITY[0] <= size <= _GRAVITY[1]:
        return [f"gravity is {size:.3g} m/s^2, but 9.81 m/s^2 on earth; correct <option gravity>"]
    compensated = [model.body(k).name for k in np.flatnonzero(model.body_gravcomp)]
    if compensated:
        return [f"gravcomp takes the weight of {', '.join(compensated)} off the motors; remove it"]
    return []


def length_of(model: mujoco.MjModel) -> float:
    """Sum of the distances from each axis to the next, and to the payload [m]."""
    last = model.jnt_bodyid.max()
    first = model.jnt_bodyid.min()
    path = 0.0
    for k in range(first + 1, model.nbody):
        if k <= last or model.body_rootid[k] == model.body_rootid[first]:
            path += float(np.linalg.norm(model.body_pos[k]))
    slides = model.jnt_type == int(mujoco.mjtJoint.mjJNT_SLIDE)
    limited = model.jnt_limited.astype(bool)
    return path + float(np.ptp(model.jnt_range, axis=1)[slides & limited].sum())

"""Rotors, friction and torque limits that do not fit to the arm that they move.

What the known arms have (known_drives.toml) says what is doubtful. What is several times
further away from it cannot be true.
"""

from __future__ import annotations

import mujoco
import numpy as np

from faultgen.building.elements import PAYLOAD_DENSITY, PAYLOAD_SHARE
from faultgen.building.findings import Finding
from faultgen.building.limits import MOST_TORQUE
from faultgen.building.plain import STATED_UNITS
from faultgen.building.resonance import sampled_poses
from faultgen.building.seen import Loads, loads, mass_from
from faultgen.building.units import length_of
from faultgen.building.usual import usual_torque
from faultgen.robot import COULOMB, STICTION, Robot
from faultgen.simulation.arm import Arm

_ALIKE = 4  # moving links whose masses are a placeholder if all are the same
_POSES = 128  # at which the arm is looked at

_ROTOR, _NO_ROTOR = 13.0, 44.0
"""Rotor inertia at the joint over the geometric mean of the inertia about its axis and the largest
inertia about any axis: doubtful, impossible. The known arms have 0.05 to 4.4."""
_OWN, _NO_OWN = 100.0, 300.0
"""Rotor inertia at the joint over the inertia about its axis: doubtful, impossible. The known arms
have up to 60, if the payload is as light as an assumed one."""
_NO_TORQUE = 30.0
"""Torque limit over the usual one: impossible. The known arms have up to 3.4."""
_FRICTION = 0.35
"""Coulomb friction over the torque limit: doubtful. The known arms have 0.03 to 0.22."""
_WEIGHT = 1.0
"""Coulomb friction over the weight torque of the whole arm: doubtful. The known arms have up to
0.33."""
_SPINNING = 0.9
"""Friction at full speed over the torque limit: doubtful. The known arms have 0.1 to 0.6."""
_DENSEST, _HEAVIEST = 400.0, 2000.0
"""Mass of the moving links over the square of the length of the arm [kg/m^2], and that mass [kg]:
doubtful. The known arms have 6 to 125 kg/m^2; a KUKA KR 500, for 500 kg of payload, has 1495 kg in
its links and about 160 kg/m^2 (link masses of a public model of robot milling)."""


def weight_warnings(model: mujoco.MjModel) -> list[str]:
    """Write in one line if the masses of an arm are not those of arms of its size.

    Args:
        model: The compiled arm.

    Returns:
        One line, or none.
    """
    same = _same_masses(model)
    if same:
        return [
            f"{same[1]} moving links all weigh {same[0]:g} kg, which looks like a placeholder; "
            "correct the masses in the model, because torques, drives and tasks follow from them"
        ]
    mass, length = moving_mass(model), length_of(model)
    dense = mass / max(length, 0.05) ** 2
    if mass <= _HEAVIEST and dense <= _DENSEST:
        return []
    return [
        f"the moving links weigh {mass:.4g} kg at a length of {length:.3g} m; arms for 500 kg of "
        "payload have 1500 kg at 3 m; check the masses, or state mass and torque_limit in "
        "drives.toml"
    ]


def _same_masses(model: mujoco.MjModel) -> tuple[float, int] | None:
    """The mass that four or more moving links and no other ones have, and how many have it."""
    links = np.unique(model.jnt_bodyid)
    names = [model.body(int(link)).name for link in links]
    masses = [
        float(model.body_mass[link])
        for link, name in zip(links, names, strict=True)
        if not name.startswith("rotor")
    ]
    alike = len(masses) >= _ALIKE and max(masses) - min(masses) <= 1e-9 * max(masses)
    return (masses[0], len(masses)) if alike else None


def moving_mass(model: mujoco.MjModel) -> float:
    """Return the mass of the moving links of an arm, without the body ``payload`` [kg].

    Args:
        model: The compiled arm.
    """
    return mass_from(model, int(model.jnt_bodyid.min()))


def drive_doubts(robot: Robot) -> tuple[list[Finding], list[str]]:
    """Compare the rotors, friction and torque limits of a robot with its arm.

    Args:
        robot: The robot.

    Returns:
        What cannot be true, as findings; and what is doubtful, as warnings.
    """
    model = Arm(robot).model
    poses = sampled_poses(robot.joint_range, robot.slides, _POSES)
    seen = loads(model, poses, np.linalg.inv(robot.gearing.outputs(np.eye(robot.n_axes)).T))
    limit, usual = _limits(robot, seen)
    found: list[Finding] = []
    warnings = weight_warnings(model)
    for told, impossible, where, remedy in (
        *_rotors(robot, model, seen),
        *_torques(robot, limit, usual),
        *_friction(robot, seen, np.where(np.isfinite(limit), limit, usual)),
    ):
        if impossible:
            found.append(Finding(where, told, remedy))
        else:
            warnings.append(f"{where} {told}; {remedy}")
    return found, warnings


Doubt = tuple[str, bool, str, str]
"""What is wrong, whether it cannot be true, where, and what to do."""


def _rotors(robot: Robot, model: mujoco.MjModel, seen: Loads) -> list[Doubt]:
    reflected = robot.model.dof_M0[list(robot.motors)] * robot.gear_ratio**2
    most = seen.inertia.max(axis=0)
    # an axis is made for more than the arm carries at the moment: a cube, held at its edge
    mass = PAYLOAD_SHARE * moving_mass(model)
    carried = 2 / 3 * mass * np.cbrt(mass / PAYLOAD_DENSITY) ** 2
    own = np.where(robot.slides, most, np.maximum(most, carried))
    largest = np.where(robot.slides, own, own[~robot.slides].max(initial=0.0))
    mixed, alone = reflected / np.sqrt(own * largest), reflected / own
    return [
        (
            f"has a rotor with {alone[k]:.3g} times the inertia of all that the axis carries",
            bool(mixed[k] > _NO_ROTOR or alone[k] > _NO_OWN),
            robot.label("axis ", k + 1),
            "make rotor_inertia or gear_ratio smaller",
        )
        for k in np.flatnonzero((mixed > _ROTOR) | (alone > _OWN)).tolist()
    ]


def _limits(robot: Robot, seen: Loads) -> tuple[np.ndarray, np.ndarray]:
    """Torque limits of a robot and usual ones at the joints, infinite where there is none."""
    largest = float(seen.weight.max(initial=0.0))
    gravity = np.abs(seen.gravity).max(axis=0)
    usual = np.array(
        [
            usual_torque(float(w), largest, float(g)) if w > 0 else np.inf
            for w, g in zip(seen.weight, gravity, strict=True)
        ]
    )
    return robot.motor_torque_limit * np.abs(robot.gear_ratio), usual


def _torques(robot: Robot, limit: np.ndarray, usual: np.ndarray) -> list[Doubt]:
    times = np.where(np.isfinite(limit), limit / usual, 0.0)
    return [
        (
            f"has a torque limit of {limit[k]:.4g} N m, {times[k]:.2g} times what drives of such "
            "an arm have",
            bool(times[k] > _NO_TORQUE),
            robot.label("axis ", k + 1),
            "make torque_limit smaller, or check the masses of the links",
        )
        for k in np.flatnonzero(times > MOST_TORQUE).tolist()
    ]


def _friction(robot: Robot, seen: Loads, limit: np.ndarray) -> list[Doubt]:
    ratio = np.abs(robot.gear_ratio)
    elements = robot.ids("actuator", "friction")
    law = robot.model.actuator_biasprm[elements]
    coulomb, static = law[:, COULOMB] * ratio, law[:, STICTION] * ratio
    speed = np.where(np.isfinite(robot.motor_velocity_limit), robot.motor_velocity_limit, 0.0)
    viscous = robot.model.actuator_damping[elements] * speed * ratio
    weight = seen.weight.max(initial=0.0)
    found: list[Doubt] = []
    for k in range(robot.n_axes):
        unit = STATED_UNITS["torque_limit"][int(robot.slides[k])]
        most = max(coulomb[k], static[k])
        if most >= limit[k]:
            what = f"its friction at rest, {most:.3g} {unit}, is not below its torque limit"
        elif coulomb[k] > _FRICTION * limit[k]:
            what = f"its Coulomb friction is {coulomb[k] / limit[k]:.0%} of its torque limit"
        elif coulomb[k] + viscous[k] > _SPINNING * limit[k]:
            share = (coulomb[k] + viscous[k]) / limit[k]
            what = f"its friction at full speed is {share:.0%} of its torque limit"
        elif not robot.slides[k] and weight > 0 and coulomb[k] > _WEIGHT * weight:
            what = (
                f"its Coulomb friction, {coulomb[k]:.3g} N m, is more than the weight of the whole "
                f"arm asks for, {weight:.3g} N m"
            )
        else:
            continue
        where = robot.label("axis ", k + 1)
        remedy = "make coulomb_friction, static_friction or viscous_friction smaller"
        found.append((what, bool(most >= limit[k]), where, remedy))
    return found

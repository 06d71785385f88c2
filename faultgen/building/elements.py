"""Adding to a plain arm what makes it a robot: payload, rotors, gearboxes, drives and friction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from faultgen.building.drive_numbers import Value
from faultgen.building.drives import Coupling, Payload
from faultgen.building.flange import Flange
from faultgen.mjcf.compiling import compiled

PAYLOAD_SHARE = 0.1
"""Mass of an assumed payload over the mass of the links that move."""
PAYLOAD_DENSITY = 2700.0
"""Density of an assumed payload, a cube [kg/m^3]: aluminium."""

_PRESENT, _SERVO = 16, 7  # control of a passive dcmotor; of one with position, velocity and torque


def add_payload(
    spec: mujoco.MjSpec, flange: Flange, given: Payload | None
) -> dict[str, tuple[list[float], Value]]:
    """Attach a payload to a plain arm, with the site ``tool`` at its far end, in place.

    Args:
        spec: The plain arm.
        flange: Where the payload is attached.
        given: What the user states about the payload.

    Returns:
        Values and source of its mass, position and inertia.
    """
    used: dict[str, tuple[list[float], Value]] = {}
    stated = {} if given is None else given.model_dump(exclude_none=True)

    def choose(key: str, assumed: list[float], why: str) -> list[float]:
        source = Value(0.0, "given") if key in stated else Value(0.0, "assumed", why)
        found = stated.get(key, assumed)
        used[key] = (found if isinstance(found, list) else [found], source)
        return used[key][0]

    body = next((one for one in spec.bodies if one.name == "payload"), None)
    sites = [site.name for site in spec.sites]
    if body is None:
        model = compiled(spec.copy(), "arm with its payload")
        mass = PAYLOAD_SHARE * float(model.body_subtreemass[_first_moving(model)])
        (mass,) = choose("mass", [_four(mass)], f"{100 * PAYLOAD_SHARE:g} % of the moving links")
        side = float(np.cbrt(mass / PAYLOAD_DENSITY))
        body = spec.body(flange.body).add_body(
            name="payload", pos=list(flange.pos), quat=list(flange.quat)
        )
        if mass > 0:
            body.add_geom(
                type=mujoco.mjtGeom.mjGEOM_BOX,
                size=[side / 2] * 3,
                pos=[_four(side / 2), 0, _four(side / 2)],
                rgba=[0.85, 0.45, 0.12, 1],
                density=0.0,
            )
        whys = (
            "an aluminium cube that is held at its edge, so that it loads the last axis",
            "that of this cube",
        )
        if mass == 0:
            whys = ("the flange, where nothing is carried", "nothing is carried")
        position = choose("position", [_four(side / 2), 0.0, _four(side / 2)], whys[0])
        inertia = choose("inertia", [_four(mass * side**2 / 6)] * 3, whys[1])
        _set_inertia(body, mass, position, inertia)
        if "tool" not in sites:
            body.add_site(name="tool", pos=[position[0], position[1], 2 * position[2]])
        return used
    model = compiled(spec.copy(), "arm with its payload")
    own = model.body("payload")
    why = "the body 'payload'"
    for key, value in (("mass", own.mass), ("position", own.ipos), ("inertia", own.inertia)):
        source = Value(0.0, "given") if key in stated else Value(0.0, "model", why)
        found = stated.get(key, value.tolist())
        used[key] = (found if isinstance(found, list) else [found], source)
    if stated:
        if "inertia" not in stated and own.mass[0] > 0:
            used["inertia"] = ((own.inertia * used["mass"][0][0] / own.mass[0]).tolist(), source)
        if "inertia" in stated:
            body.iquat = [1, 0, 0, 0]
        _set_inertia(body, used["mass"][0][0], used["position"][0], used["inertia"][0])
    if "tool" not in sites:
        body.add_site(name="tool", pos=used["position"][0])
    return used


def _set_inertia(
    body: mujoco.MjsBody, mass: float, position: Sequence[float], inertia: Sequence[float]
) -> None:
    body.explicitinertial, body.mass = True, mass
    body.ipos, body.inertia = list(position), list(inertia)
    body.fullinertia = np.append(np.nan, np.zeros(5))


def _first_moving(model: mujoco.MjModel) -> int:
    return int(model.jnt_bodyid.min())


def _four(value: float) -> float:
    return float(f"{value:.4g}")


def add_drives(
    spec: mujoco.MjSpec,
    joints: Sequence[str],
    values: Sequence[Mapping[str, Value]],
    couplings: Sequence[Coupling],
) -> None:
    """Give every axis of a plain arm its rotor, gearbox, drive and friction, in place.

    Args:
        spec: The plain arm, whose axes are joint1, joint2, ...
        joints: Names of the axes in the user's file.
        values: Numbers of the drive of each axis, by name.
        couplings: Gearboxes that also turn with another joint.
    """
    for body in spec.bodies:
        if body.name.startswith("rotor"):
            body.name = f"link_{body.name}"
    for k, name in enumerate(joints, start=1):
        if name != f"joint{k}":
            spec.add_text(name=f"joint{k}", data=name)
    plain = [{name: one.value for name, one in numbers.items()} for numbers in values]
    for k, number in enumerate(plain, start=1):
        _add_rotor(spec, k, number["rotor_inertia"])
        others = [one for one in couplings if one.gearbox == joints[k - 1]]
        gearbox = spec.add_tendon(name=f"gearbox{k}")
        gearbox.wrap_joint(f"motor{k}", 1 / number["gear_ratio"])
        gearbox.wrap_joint(f"joint{k}", -1.0)
        for one in others:
            gearbox.wrap_joint(f"joint{joints.index(one.joint) + 1}", -one.factor)
        gearbox.stiffness[0], gearbox.damping[0] = number["gear_stiffness"], number["gear_damping"]
    for k, number in enumerate(plain, start=1):
        drive = _add_actuator(spec, f"drive{k}", k)
        drive.set_to_dcmotor(
            motorconst=[1.0, 1.0],
            resistance=1.0,
            ctrlspec=_SERVO,
            controller=[number["position_gain"], 0, number["velocity_gain"], 0, 0, 0],
            saturation=[number["torque_limit"] / abs(number["gear_ratio"]), 0, 0],
        )
    for k, number in enumerate(plain, start=1):
        friction = _add_actuator(spec, f"friction{k}", k)
        friction.set_to_dcmotor(
            motorconst=[0.0, 0.0],
            resistance=1.0,
            ctrlspec=_PRESENT,
            lugre=[
                number["bristle_stiffness"],
                number["bristle_damping"],
                number["coulomb_friction"],
                number["static_friction"],
                number["stribeck_velocity"],
            ],
        )
        friction.damping[0] = number["viscous_friction"]
    numerics = {
        "motor_velocity_limit": [one["speed_limit"] * abs(one["gear_ratio"]) for one in plain],
        "joint_acceleration_limit": [one["acceleration_limit"] for one in plain],
        "encoder_counts": [one["encoder_counts"] for one in plain],
        "friction_temperature": [40.0],
    }
    for name, data in numerics.items():
        spec.add_numeric(name=name, data=data, size=len(data))
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT


def _add_rotor(spec: mujoco.MjSpec, axis: int, inertia: float) -> None:
    rotor = spec.worldbody.add_body(name=f"rotor{axis}", pos=[-0.5, -0.2 - 0.1 * axis, 0.05])
    _set_inertia(rotor, 1.0, [0, 0, 0], [inertia] * 3)
    rotor.add_joint(name=f"motor{axis}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1])
    rotor.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=[0.03, 0.03, 0],
        contype=0,
        conaffinity=0,
        group=4,
        rgba=[0.3, 0.3, 0.35, 1],
    )


def _add_actuator(spec: mujoco.MjSpec, name: str, axis: int) -> mujoco.MjsActuator:
    return spec.add_actuator(name=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=f"motor{axis}")

"""Editing and writing MJCF: inertias in one form, and text that keeps every digit.

MJCF can state the inertia of a body in several forms: diagonal, full, with the orientation of its
frame as angles, or computed from the shapes of the body. Edits need one form. MuJoCo writes numbers
with six digits, so that the written model differs from the original and may even be unreadable.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import mujoco
import numpy as np

from faultgen.mjcf.rotations import matrix_of
from faultgen.mjcf.warnings import mujoco_warnings
from faultgen.system.files import write_bytes, write_text

_DIGITS = 17
"""Number of decimal digits with which every double is read back exactly."""


def resolve_inertias(spec: mujoco.MjSpec) -> None:
    """Give every body that moves a mass, a centre of mass and a diagonal inertia, in place.

    Bodies that already have them are not changed. The others get the values that MuJoCo computes
    when it compiles the model.

    Args:
        spec: The model, which is changed in place.

    Raises:
        ValueError: MuJoCo cannot compile the model.
    """
    compiler = spec.compiler
    from_geoms = compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    rescaled = from_geoms or compiler.settotalmass > 0
    bodies = list(spec.bodies)
    asked = [k for k, body in enumerate(bodies) if k and (rescaled or not _is_plain(body))]
    if not asked:
        return
    copy = spec.copy()
    with mujoco_warnings():
        model = copy.compile()
    compiled = [body.id for body in copy.bodies]
    for k in asked:
        body, at = bodies[k], compiled[k]
        if at < 0 or model.body_mass[at] <= 0:
            continue
        body.explicitinertial = True
        body.mass = float(model.body_mass[at])
        body.ipos, body.inertia = model.body_ipos[at], model.body_inertia[at]
        body.ialt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
        body.iquat = model.body_iquat[at]
        body.fullinertia = np.append(np.nan, np.zeros(5))
    if rescaled:
        compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
        compiler.settotalmass = -1.0


def _is_plain(body: mujoco.MjsBody) -> bool:
    """Whether a body does not move, or has a diagonal inertia in a frame given by a quaternion."""
    if not len(body.joints) and body.name != "payload":
        return True
    quaternion = body.ialt.type == mujoco.mjtOrientation.mjORIENTATION_QUAT
    return bool(body.explicitinertial and quaternion and np.isnan(body.fullinertia[0]))


def add_point(body: mujoco.MjsBody, mass: float, place: np.ndarray, gyration: float = 0.0) -> None:
    """Fix a small ball to a body, in place: one mass, centre and inertia for both together.

    Args:
        body: The body. If it has a mass, its inertia is diagonal, as after `resolve_inertias`.
        mass: Mass of the ball [kg], positive.
        place: Position of the ball in the frame of the body [m], shape (3,).
        gyration: Radius of gyration of the ball [m].
    """
    place = np.asarray(place, float)
    own = float(body.mass) if body.explicitinertial else 0.0
    body.explicitinertial = True
    body.fullinertia = np.append(np.nan, np.zeros(5))
    if not own > 0:  # the orientation does not matter
        body.mass, body.ipos, body.inertia = mass, place, np.full(3, mass * gyration**2)
        return
    axes, before = matrix_of(body.iquat), np.array(body.ipos)
    centre = (own * before + mass * place) / (own + mass)
    inertia = axes @ np.diag(body.inertia) @ axes.T + mass * gyration**2 * np.eye(3)
    inertia += own * _about(before - centre) + mass * _about(place - centre)
    moments, axes = np.linalg.eigh(inertia)
    axes[:, 0] *= np.sign(np.linalg.det(axes))  # right-handed
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, axes.ravel())
    body.mass, body.ipos, body.inertia, body.iquat = own + mass, centre, moments, quaternion


def _about(place: np.ndarray) -> np.ndarray:
    """Inertia of a unit mass at a place about the origin (parallel axes), shape (3, 3)."""
    return float(place @ place) * np.eye(3) - np.outer(place, place)


def forget_defaults(spec: mujoco.MjSpec) -> None:
    """Let joints, tendons and actuators that are added later have the defaults of MuJoCo, in place.

    A model can state defaults for its own elements, such as the damping or the range of a joint.
    Added elements would get them too: a rotor would get the range of a link. The elements that the
    model has already keep their values.

    Args:
        spec: The model, which is changed in place.
    """
    empty = mujoco.MjSpec()  # its defaults live as long as it does
    for kind, names in _FIELDS.items():
        here, there = getattr(spec.default, kind), getattr(empty.default, kind)
        for name in names.split():
            setattr(here, name, getattr(there, name))
    for body in spec.bodies:
        body.childclass = empty.default.name


# attributes that a default can have; those that it cannot have must not even be read from it
_LIMIT = (
    "solref_limit solimp_limit solref_friction solimp_friction margin range limited frictionloss"
)
_FIELDS = {
    "joint": f"{_LIMIT} type pos axis align ref springref springdamper stiffness damping armature "
    "actfrcrange actfrclimited actgravcomp group",
    "tendon": f"{_LIMIT} springlength stiffness damping armature actfrcrange actfrclimited width "
    "rgba group material",
    "actuator": "gaintype gainprm biastype biasprm dyntype dynprm actdim actearly actlimited "
    "actrange ctrllimited ctrlrange forcelimited forcerange gear lengthrange cranklength damping "
    "armature group delay nsample interp inheritrange",
}


def set_numeric(spec: mujoco.MjSpec, name: str, values: Sequence[float]) -> None:
    """Give a model a ``numeric`` element, or another value of the one that it has.

    Args:
        spec: The model, edited in place.
        name: Name of the element.
        values: Its numbers.
    """
    numeric = spec.numeric(name) or spec.add_numeric(name=name)
    numeric.size, numeric.data = len(values), list(values)


def mjcf_text(spec: mujoco.MjSpec) -> str:
    """Return the MJCF text of a model, with all digits.

    Args:
        spec: The compiled model.
    """
    with mujoco_warnings(), _all_digits():
        return spec.to_xml()


def write_model(path: Path, xml: str, assets: Mapping[str, bytes]) -> dict[str, bytes]:
    """Write a model and the files that it refers to into one folder.

    Files whose paths lead out of the folder of the model are not written.

    Args:
        path: The MJCF file to write.
        xml: Text of the model.
        assets: Content of the files by path, relative to the model.

    Returns:
        Content of all files by path relative to the folder, for `faultgen.system.sums`.
    """
    written = {}
    for name, content in assets.items():
        file = Path(os.path.normpath(name))
        if file.is_absolute() or ".." in file.parts:
            continue
        target = path.parent / file
        if not target.is_file() or target.read_bytes() != content:
            target.parent.mkdir(parents=True, exist_ok=True)
            write_bytes(target, content)
        written[file.as_posix()] = content
    write_text(path, xml)
    return {**written, path.name: xml.encode()}


@contextmanager
def _all_digits() -> Iterator[None]:
    """Let MuJoCo write all digits. A version of MuJoCo that cannot do this writes six digits."""
    library = _library()
    try:
        read, write = (
            getattr(library, f"_mjPRIVATE__{verb}_xml_precision") for verb in ("get", "set")
        )
    except AttributeError:
        yield
        return
    usual = read()
    write(_DIGITS)
    try:
        yield
    finally:
        write(usual)


def _library() -> ctypes.CDLL | None:
    """MuJoCo's shared library, which is already loaded."""
    folder = Path(mujoco.__file__).parent
    for pattern in ("libmujoco*.so*", "libmujoco*.dylib", "mujoco.dll"):
        for file in sorted(folder.glob(pattern)):
            return ctypes.CDLL(str(file))
    return None

"""What may differ between the links of a robot and those of its model: mass, place and inertia."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from faultgen.discovery.terms.candidates import INERTIA, Term
from faultgen.discovery.terms.regressor import PER_LINK
from faultgen.effects import get_effect
from faultgen.effects.prior import LINK_STD
from faultgen.effects.structure import MASSLESS
from faultgen.errors import InputError
from faultgen.robot import Robot

_COMPONENTS = 10


def inertia_terms(robot: Robot) -> list[Term]:
    """List ten terms for each link that moves, and for the payload.

    Source: pseudo-inertia of Wensing, Kim and Slotine (2018). Its upper triangular factor is
    perturbed as in Rucker and Wensing (2022), so that every value describes a body that can exist.
    """
    spec = robot.spec()
    terms = []
    for link, body in enumerate(inertial_bodies(spec, robot), start=1):
        if body.mass < MASSLESS:
            continue  # nothing that could be scaled; a payload is points then
        size = size_of(body.mass, body.inertia, body.ipos)
        for k in range(_COMPONENTS):
            prior_std = 0.5 * LINK_STD if k in _DIAGONAL else LINK_STD
            prior_std = 2 * LINK_STD * size if k in _SHIFT else prior_std
            terms.append(Term(INERTIA, link, 2 * prior_std, prior_std, (("component", float(k)),)))
    return terms


PAIRS = ((0, 0), (1, 1), (2, 2), (3, 3), (0, 1), (0, 2), (1, 2), (0, 3), (1, 3), (2, 3))
"""Row and column of each component in the factor F."""

_DIAGONAL = (0, 1, 2, 3)
_SHIFT = (7, 8, 9)


def inertial_bodies(spec: mujoco.MjSpec, robot: Robot) -> list[mujoco.MjsBody]:
    """List the links by the number of their joint, and then the payload if there is one.

    Args:
        spec: The robot's specification.
        robot: The robot.
    """
    bodies = [spec.joint(f"joint{axis}").parent for axis in range(1, robot.n_axes + 1)]
    payload = spec.body("payload")
    return bodies if payload is None else [*bodies, payload]


def size_of(mass: float, inertia: np.ndarray, centre: np.ndarray) -> float:
    """Compute the size of a link: errors of its centre of mass are stated as a share of it.

    Args:
        mass: Mass [kg].
        inertia: Main moments of inertia about the centre of mass, shape (3,), in [kg m^2].
        centre: Centre of mass in the frame of the link, shape (3,), in [m].

    Returns:
        The larger of radius of gyration and distance of the centre of mass from the joint [m].
    """
    gyration = float(np.sqrt(np.sum(inertia) / 2 / max(mass, 1e-9)))
    return max(gyration, float(np.linalg.norm(centre)))


def apply_inertia(spec: mujoco.MjSpec, robot: Robot, changes: Sequence[tuple[Term, float]]) -> None:
    """Change the inertias of links in place.

    Args:
        spec: The robot's specification, which is changed.
        robot: The unchanged robot, from which the links are identified.
        changes: Inertia terms and their values.
    """
    bodies = inertial_bodies(spec, robot)
    for link, body in enumerate(bodies, start=1):
        factor = _factor(link, changes)
        if np.any(factor != np.eye(4)):
            _transform(body, factor)


def _factor(link: int, changes: Sequence[tuple[Term, float]]) -> np.ndarray:
    """The factor F of a link, numbered from 1, shape (4, 4)."""
    factor = np.eye(4)
    for term, value in changes:
        if term.axis == link:
            factor[PAIRS[int(dict(term.parameters)["component"])]] += value
    return factor


@dataclass(frozen=True, eq=False)
class Moved:
    """Links of a robot that were moved from those of a given one.

    Terms keep their meaning, which is about the main axes of the given links: those of a moved link
    may be others, for example if two moments of inertia are equal.
    """

    given: Robot
    """The given robot."""
    changes: Sequence[tuple[Term, float]]
    """Inertia terms and their values."""


_SLIGHT = 1e-4  # of a component, for the slope of the parameters


def slopes_of(robot: Robot, terms: Sequence[Term], moved: Moved | None = None) -> np.ndarray:
    """Compute how the parameters of the torque's regressor change with terms of masses.

    Args:
        robot: The unchanged robot.
        terms: Terms of `inertia_terms`, or of effects that change masses; see `candidates.MASSES`.
        moved: How the robot's links came from those of the robot of the terms; None if they are
            the same.

    Returns:
        Change of `regressor.link_parameters` per unit of each term, shape (parameters, terms). A
        payload that has no mass in the model counts as a part of the last link. 0 for effects that
        the model cannot have.
    """
    spec = robot.spec()
    bodies = inertial_bodies(spec, robot)
    own = [_parameters(body) for body in bodies]
    slots = len(bodies) - (len(bodies) > robot.n_axes and bodies[-1].mass < MASSLESS)
    slopes = np.zeros((slots, PER_LINK, len(terms)))
    on_link = _place_of_payload(robot) if slots < len(bodies) else np.eye(4)
    changes = () if moved is None else moved.changes
    given = bodies if moved is None else inertial_bodies(moved.given.spec(), moved.given)
    for k, term in enumerate(terms):
        if term.name == INERTIA:
            slopes[term.axis - 1, :, k] = _slope(
                given[term.axis - 1], term, _factor(term.axis, changes)
            )
            continue
        changed = robot.spec()
        effect = get_effect(term.name)
        try:
            effect.apply(changed, term.axis, term.step, **effect.complete(dict(term.parameters)))
        except InputError:  # the model cannot have it
            continue
        for link, body in enumerate(inertial_bodies(changed, robot)):
            slot = min(link, slots - 1)
            frame = on_link if link != slot else np.eye(4)
            before = own[link] if link == slot else 0.0
            slopes[slot, :, k] += (_parameters(body, frame) - before) / term.step
    return slopes.reshape(slots * PER_LINK, len(terms))


def _place_of_payload(robot: Robot) -> np.ndarray:
    """Frame of the body ``payload`` in that of the last link, a transformation of shape (4, 4)."""
    data = mujoco.MjData(robot.model)
    mujoco.mj_kinematics(robot.model, data)
    frames = []
    for body in (robot.model.joint(f"joint{robot.n_axes}").bodyid[0], "payload"):
        frame = np.eye(4)
        frame[:3, :3], frame[:3, 3] = data.body(body).xmat.reshape(3, 3), data.body(body).xpos
        frames.append(frame)
    return np.asarray(np.linalg.solve(*frames))


def _parameters(body: mujoco.MjsBody, frame: np.ndarray | None = None) -> np.ndarray:
    """Parameters of the regressor of a body, in its own frame or in that of another one."""
    if body.mass <= 0:
        return np.zeros(PER_LINK)
    placed = main_frame(body) if frame is None else frame @ main_frame(body)
    return parameters_of(placed @ pseudo_inertia(body) @ placed.T)


def _slope(body: mujoco.MjsBody, term: Term, factor: np.ndarray) -> np.ndarray:
    """Change of the parameters of a link per unit of one of `inertia_terms`, about a factor F."""
    frame, pseudo = main_frame(body), pseudo_inertia(body)
    change = np.zeros((4, 4))
    change[PAIRS[int(dict(term.parameters)["component"])]] = 1.0
    more, less = (factor + side * _SLIGHT * change for side in (1, -1))
    changes = [parameters_of(frame @ (f @ pseudo @ f.T) @ frame.T) for f in (more, less)]
    return np.asarray((changes[0] - changes[1]) / (2 * _SLIGHT))


_THIN = 1e-9
"""Smallest allowed second moment of a body as a share of the sum of all, and smallest allowed share
of its mass."""


def pseudo_inertia(body: mujoco.MjsBody) -> np.ndarray:
    """Compute the pseudo-inertia of a body in the frame of its centre of mass and main axes.

    Args:
        body: The body, with a diagonal inertia.

    Returns:
        Second moments of the mass, first moments and mass, shape (4, 4).
    """
    inertia = np.array(body.inertia)
    return np.diag(np.append(inertia.sum() / 2 - inertia, body.mass))


def main_frame(body: mujoco.MjsBody) -> np.ndarray:
    """Return the frame of a body's centre of mass and main axes in the body's own frame.

    Args:
        body: The body.

    Returns:
        Homogeneous transformation, shape (4, 4).
    """
    w, x, y, z = body.iquat
    frame = np.eye(4)
    frame[:3, :3] = Rotation.from_quat([x, y, z, w]).as_matrix()
    frame[:3, 3] = body.ipos
    return frame


def parameters_of(pseudo: np.ndarray) -> np.ndarray:
    """Read the ten parameters of the torque's regressor (see `regressor`) from pseudo-inertias.

    Args:
        pseudo: In the frame of the body, shape (..., 4, 4).

    Returns:
        Shape (..., 10).
    """
    xx, yy, zz = (pseudo[..., k, k] for k in range(3))
    return np.stack(
        [
            pseudo[..., 3, 3],
            *(pseudo[..., k, 3] for k in range(3)),
            yy + zz,
            xx + zz,
            xx + yy,
            *(-pseudo[..., i, j] for i, j in ((0, 1), (0, 2), (1, 2))),
        ],
        axis=-1,
    )


def _transform(body: mujoco.MjsBody, factor: np.ndarray) -> None:
    """Change the pseudo-inertia P about the centre of mass to F P F', that of a possible body."""
    inertia = np.array(body.inertia)
    second = factor @ pseudo_inertia(body) @ factor.T
    mass = max(second[3, 3], _THIN * body.mass)
    shift = second[:3, 3] / mass
    about = second[:3, :3] - mass * np.outer(shift, shift)
    # second moments are positive: then moments of inertia are, and none exceeds the sum of others
    moments, axes = np.linalg.eigh(about)
    moments = np.maximum(moments, _THIN * max(moments.sum(), inertia.sum()))
    if np.linalg.det(axes) < 0:
        axes[:, 0] *= -1
    w, x, y, z = body.iquat
    frame = Rotation.from_quat([x, y, z, w])
    turned = (frame * Rotation.from_matrix(axes)).as_quat()
    body.ipos = np.array(body.ipos) + frame.apply(shift)
    body.iquat = turned[[3, 0, 1, 2]]
    body.mass, body.inertia = float(mass), moments.sum() - moments

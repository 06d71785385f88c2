"""Masses and inertias of links: which no body can have, and the nearest that one can have."""

from __future__ import annotations

from collections.abc import Collection

import mujoco
import numpy as np

from faultgen.building.findings import Finding
from faultgen.building.shapes import Filled, has_shape

DENSITY = 2700.0
"""Density of the solid sphere that a link without inertia becomes [kg/m^3]: aluminium."""

HEAVIEST, LIGHTEST = 5000.0, 1e-3
"""Mass of a link that is believed [kg]."""

_STATE_IT = "state its mass and inertia in the file, or its mass in [mass] of drives.toml"
_SLACK = 1e-9  # relative; rounding in a file is no error
_TINY = 1e-3  # a principal inertia below this share of the largest is raised to it


def tensor_of(body: mujoco.MjsBody) -> np.ndarray:
    """Return the inertia tensor that a body states, about its centre of mass.

    Args:
        body: A body with an explicit inertia.

    Returns:
        Shape (3, 3), in [kg m^2], in the frame of the inertia.
    """
    if np.isnan(body.fullinertia[0]):
        return np.diag(body.inertia)
    a, b, c, ab, ac, bc = body.fullinertia
    return np.array([[a, ab, ac], [ab, b, bc], [ac, bc, c]])


def is_possible(tensor: np.ndarray) -> bool:
    """Tell whether a body of positive density can have an inertia.

    Args:
        tensor: Shape (3, 3), in [kg m^2].

    Returns:
        Whether its principal values are positive and none exceeds the sum of the other two.
    """
    least, middle, most = np.linalg.eigvalsh(tensor)
    return bool(least > 0 and most <= (least + middle) * (1 + _SLACK))


def nearest_possible(tensor: np.ndarray, mass: float) -> np.ndarray:
    """Return an inertia that a body can have and that is close to one that it cannot.

    Args:
        tensor: Shape (3, 3), in [kg m^2].
        mass: Mass of the body [kg].

    Returns:
        Shape (3, 3). The principal directions are kept; principal values that are too small are
        raised. A body without any inertia becomes an aluminium sphere of its mass.
    """
    values, directions = np.linalg.eigh(tensor)
    if values[-1] <= 0:
        radius = np.cbrt(3 * mass / (4 * np.pi * DENSITY))
        return np.eye(3) * 0.4 * mass * radius**2
    values = np.maximum(values, _TINY * values[-1])
    lacking = values[2] - values[0] - values[1]
    if lacking > 0:
        values[:2] += lacking / 2 * (1 + 1e-6)
    return np.asarray(directions * values @ directions.T)


def inertia_findings(
    spec: mujoco.MjSpec, moving: list[str], given: Collection[str] = ()
) -> list[Finding]:
    """List the masses and inertias that no link can have.

    Args:
        spec: The model.
        moving: Names of the bodies that move.
        given: Names of the links whose mass the user gives.

    Returns:
        Findings. Those about inertias are not fatal: `repair_inertias` removes them.
    """
    found = []
    for body in spec.bodies[1:]:
        where = f"link '{body.name}'"
        if not body.explicitinertial:
            if body.name in moving and not _has_mass(body, moving, given):
                found.append(Finding(where, "has no mass and no shape", _STATE_IT))
            continue
        mass, tensor = float(body.mass), tensor_of(body)
        if not np.isfinite(mass) or not np.isfinite(tensor).all() or mass < 0:
            found.append(Finding(where, f"has the mass {mass:g} kg", "state a positive mass"))
        elif mass == 0:
            if body.name in moving and not _has_mass(body, moving, given):
                found.append(Finding(where, "has the mass 0 kg and no shape", _STATE_IT))
        elif body.name in moving and not (mass < LIGHTEST and has_shape(body)):
            if not LIGHTEST <= mass <= HEAVIEST:
                remedy = "masses are in kg, lengths in m"
                found.append(Finding(where, f"has the mass {mass:g} kg", remedy, fatal=False))
            if not is_possible(tensor):
                values = " ".join(f"{value:.3g}" for value in np.linalg.eigvalsh(tensor))
                found.append(
                    Finding(
                        where,
                        f"no body has its principal inertias ({values} kg m^2): each must be "
                        "positive and at most the sum of the other two",
                        "correct them in the file; 'faultgen robot build' raises those that are "
                        "too small",
                        fatal=False,
                    )
                )
    return found


def repair_inertias(spec: mujoco.MjSpec) -> list[str]:
    """Give links whose inertia no body can have the nearest that one can have, in place.

    Args:
        spec: The model.

    Returns:
        One line for each link that was changed.
    """
    notes = []
    for body in spec.bodies[1:]:
        if not body.explicitinertial or body.mass <= 0:
            continue
        tensor = tensor_of(body)
        if is_possible(tensor):
            continue
        new = nearest_possible(tensor, float(body.mass))
        full = [*np.diag(new), new[0, 1], new[0, 2], new[1, 2]]
        if np.isnan(body.fullinertia[0]):  # the frame of the inertia stays
            body.inertia = np.diag(new)
        else:
            body.fullinertia = full
        old, now = (" ".join(f"{v:.3g}" for v in np.linalg.eigvalsh(t)) for t in (tensor, new))
        notes.append(
            f"link '{body.name}': its principal inertias {old} are impossible; assumed {now} kg m^2"
        )
    return notes


def set_mass(body: mujoco.MjsBody, mass: float, shape: Filled | None, stated: bool) -> None:
    """Give a link a mass, in place, with the inertia of its shapes or, if it states one, its own.

    Args:
        body: The link.
        mass: The mass [kg].
        shape: What its shapes fill, in its frame; None if they fill nothing.
        stated: Whether the link states a mass, so that its inertia only grows with the mass.
    """
    if stated and body.explicitinertial and body.mass > 0:
        scale = mass / body.mass
        body.mass, body.inertia = mass, np.array(body.inertia) * scale
        body.fullinertia = np.array(body.fullinertia) * scale
        return
    own = body.explicitinertial and mass > 0 and np.trace(tensor_of(body)) > 0
    place = np.array(body.ipos) if body.explicitinertial else np.zeros(3)
    tensor = nearest_possible(np.zeros((3, 3)), mass) if mass else np.zeros((3, 3))
    if shape is not None:
        place, tensor = shape.centre, shape.inertia * mass / shape.volume
    elif own:
        tensor = tensor_of(body)
    body.explicitinertial, body.mass, body.ipos = True, mass, place
    body.ialt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    if shape is not None or not own:
        body.iquat = [1, 0, 0, 0]
    if mass == 0:
        body.inertia = np.zeros(3)
        body.fullinertia = np.append(np.nan, np.zeros(5))
        return
    body.fullinertia = [*np.diag(tensor), tensor[0, 1], tensor[0, 2], tensor[1, 2]]


def _has_mass(body: mujoco.MjsBody, moving: list[str], given: Collection[str]) -> bool:
    """Whether a link, or something that is fixed to it, has a mass or a shape that gives one."""
    if (body.explicitinertial and body.mass > 0) or has_shape(body) or body.name in given:
        return True
    return any(_has_mass(child, moving, given) for child in body.bodies if child.name not in moving)

"""Masses of links that state none: given in drives.toml, or assumed from their shapes.

MuJoCo gives such links 1000 kg/m^3, adds up shapes that overlap, and says nothing. Here they are
named, and shapes that overlap count once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import mujoco
import numpy as np

from faultgen.building.drive_numbers import Value
from faultgen.building.inertias import LIGHTEST, set_mass
from faultgen.building.seen import mass_from
from faultgen.building.shapes import Filled, fill, has_shape
from faultgen.errors import InputError
from faultgen.mjcf.compiling import compiled_anyway
from faultgen.mjcf.edit import resolve_inertias

DENSITY = 1100.0
"""Mass of a link over the volume of the convex hulls of its shapes [kg/m^3]. Assumed from the mass
in the data sheets of 16 arms from 4 to 1267 kg, quoted from memory, over the volume of the convex
hulls of their collision meshes in public URDFs: 811 (ABB IRB 120) to 1728 kg/m^3 (ABB IRB 2600),
geometric mean 1090."""

_PAYLOAD = "payload"  # counts as a link of its own, which is not part of the mass of the arm
_PLAIN = (0.0, 1000.0)  # densities of shapes that state none: of visual ones in URDF, and the rest

Given = float | Mapping[str, float] | None
"""What a user states: the mass of the whole arm, or of single links by name [kg]."""


@dataclass(frozen=True)
class Masses:
    """What was used for links that state no mass."""

    values: Mapping[str, Value] = field(default_factory=dict)
    """Mass of each link that was given or assumed [kg], by name."""
    total: float | None = None
    """Mass of the whole arm that was given [kg]."""
    notes: tuple[str, ...] = ()
    """What was taken as massless, and how a given mass was shared."""
    warnings: tuple[str, ...] = ()
    """Which masses were assumed, in one line."""


def settle_masses(spec: mujoco.MjSpec, axes: Sequence[str], given: Given) -> Masses:
    """Give a mass to the links of an arm that state none, in place.

    Args:
        spec: The arm, whose only joints are its axes.
        axes: Names of the axes.
        given: What the user states.

    Returns:
        What was used.

    Raises:
        InputError: A link that is given does not exist, or the given mass of the arm is not above
            that of the links that state one.
    """
    groups = _groups(spec, axes)
    table = dict(given) if isinstance(given, Mapping) else {}
    total = given if isinstance(given, float | int) else None
    known = {body.name for bodies in groups.values() for body in bodies}
    unknown = [name for name in table if name not in known]
    if unknown:
        names = ", ".join(sorted(known))
        raise InputError(f"drives: mass: no link '{unknown[0]}'; the arm has {names}")
    if spec.compiler.settotalmass > 0 and given is None:
        return Masses()  # the model states the mass of all together
    lacking, massless = _lacking(groups, table)
    if total is not None and not lacking.keys() - {_PAYLOAD}:
        raise InputError(
            "drives: mass: every link of the model states one; remove it, or give the mass of "
            "single links in [mass]"
        )
    if not lacking and not table and not massless:
        return Masses()
    rescaled = spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    filled = _volumes(spec, lacking, [name for name in table if name not in lacking])
    if rescaled or spec.compiler.settotalmass > 0:
        resolve_inertias(spec)
    empty = [*massless, *_sharing(lacking)]
    density = DENSITY if total is None else _density(spec, lacking, filled, total, empty)
    values: dict[str, Value] = {}
    for name in [*lacking, *(name for name in table if name not in lacking)]:
        body, shape = spec.body(name), filled[name]
        if name in table:
            set_mass(body, float(table[name]), shape, stated=name not in lacking)
            values[name] = Value(float(table[name]), "given")
        elif shape is None:
            if name != _base(groups):
                raise InputError(
                    f"link '{name}' states no mass and its shapes have no volume; state its mass "
                    "and inertia in the file, or its mass in [mass] of drives.toml"
                )
        else:
            mass = (DENSITY if name == _PAYLOAD else density) * shape.volume
            set_mass(body, mass, shape, stated=False)
            why = "its share of the given mass" if total else f"{DENSITY:g} kg/m^3 of its shapes"
            values[name] = Value(float(f"{mass:.4g}"), "assumed", why)
    for name in empty:
        set_mass(spec.body(name), 0.0, None, stated=False)
    told = _assumed_line(values, total, groups)
    notes = (*_massless_notes(massless), *(told if total else ()))
    return Masses(values, total, notes, () if total else told)


def unstated_warnings(spec: mujoco.MjSpec, axes: Sequence[str]) -> list[str]:
    """Write in one line which moving links of a complete robot state no mass.

    Args:
        spec: The model.
        axes: Names of the axes.
    """
    if spec.compiler.settotalmass > 0:
        return []
    groups = _groups(spec, axes)
    names = [name for name in _lacking(groups, {})[0] if name != _base(groups)]
    if not names:
        return []
    return [
        f"{_listed(names)} no mass; MuJoCo takes 1000 kg/m^3 of all shapes, also where they "
        "overlap; write their inertia into the file"
    ]


def _groups(spec: mujoco.MjSpec, axes: Sequence[str]) -> dict[str, list[mujoco.MjsBody]]:
    """Links of the arm that are fixed to each other, by the name of the one that carries them."""
    moving = {spec.joint(name).parent.name for name in axes}
    root = spec.joint(axes[0]).parent
    while root.parent is not None and root.parent.name != "world":
        root = root.parent
    groups: dict[str, list[mujoco.MjsBody]] = {}
    stack = [(root, root.name)]
    while stack:
        body, carrier = stack.pop()
        carrier = body.name if body.name in moving or body.name == _PAYLOAD else carrier
        groups.setdefault(carrier, []).append(body)
        stack += [(child, carrier) for child in reversed(list(body.bodies))]
    return groups


def _base(groups: Mapping[str, list[mujoco.MjsBody]]) -> str:
    """Name of the link that stands still, or of the first one if it moves."""
    first = next(iter(groups))
    return "" if any(len(body.joints) for body in groups[first]) else first


def states_mass(body: mujoco.MjsBody) -> bool:
    """Tell whether a model states the mass of a link: itself, or that of its shapes.

    Args:
        body: The link.
    """
    if body.explicitinertial:
        return bool(body.mass >= LIGHTEST or body.name == _PAYLOAD)  # a payload may weigh nothing
    return any(
        geom.mass > 0 or (np.isnan(geom.mass) and geom.density not in _PLAIN) for geom in body.geoms
    )


def _lacking(
    groups: Mapping[str, list[mujoco.MjsBody]], table: Mapping[str, float]
) -> tuple[dict[str, list[str]], list[str]]:
    """Links without mass, each with the links whose shapes it gets; and links without any mass."""
    lacking, massless = {}, []
    for carrier, bodies in groups.items():
        own = [body for body in bodies if body.name not in table]
        shaped = [body.name for body in own if has_shape(body) and not states_mass(body)]
        if any(states_mass(body) for body in bodies):
            weighing = [name for name in shaped if _would_weigh(groups[carrier], name)]
            massless += [] if carrier == _base(groups) else weighing
        elif carrier in table:
            lacking[carrier] = [carrier]
            massless += shaped
        elif shaped:
            lacking[carrier] = shaped
    return lacking, massless


def _sharing(lacking: Mapping[str, Sequence[str]]) -> list[str]:
    """Links whose shapes count for the link that carries them."""
    return [link for name, links in lacking.items() for link in links if link != name]


def _would_weigh(bodies: Sequence[mujoco.MjsBody], name: str) -> bool:
    """Whether MuJoCo would give a link a mass."""
    body = next(one for one in bodies if one.name == name)
    if body.explicitinertial:
        return False
    return any(np.isnan(geom.mass) and geom.density > 0 for geom in body.geoms)


def _volumes(
    spec: mujoco.MjSpec, lacking: Mapping[str, list[str]], others: Sequence[str]
) -> dict[str, Filled | None]:
    """What the shapes of links fill, in the frame of the link that gets the mass."""
    model = compiled_anyway(spec, "arm")
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    found: dict[str, Filled | None] = {}
    for name, links in {**lacking, **{other: [other] for other in others}}.items():
        ids = [model.body(link).id for link in links]
        geoms = np.flatnonzero(np.isin(model.geom_bodyid, ids))
        solid = (model.geom_contype[geoms] != 0) | (model.geom_conaffinity[geoms] != 0)
        # visual shapes repeat those that collide
        filled = fill(model, data, (geoms[solid] if solid.any() else geoms).tolist())
        if filled is None and name in lacking and solid.any():
            filled = fill(model, data, geoms.tolist())
        at = model.body(name).id
        turn, place = data.xmat[at].reshape(3, 3), data.xpos[at]
        found[name] = filled and Filled(
            filled.volume, (filled.centre - place) @ turn, turn.T @ filled.inertia @ turn
        )
    return found


def _density(
    spec: mujoco.MjSpec,
    lacking: Mapping[str, list[str]],
    filled: Mapping[str, Filled | None],
    total: float,
    empty: Sequence[str],
) -> float:
    """Density with which the links without mass bring the arm to its given mass."""
    shapes = [filled[name] for name in lacking if name != _PAYLOAD]
    volume = sum(one.volume for one in shapes if one is not None)
    if volume <= 0:
        raise InputError(
            f"drives: mass: {', '.join(lacking)} have no shapes that could share it; give the mass "
            "of each link in [mass]"
        )
    copy = spec.copy()
    for name in [*lacking, *empty]:
        set_mass(copy.body(name), 0.0, None, stated=False)
    model = compiled_anyway(copy, "arm")
    stated = mass_from(model, int(model.body_rootid[model.jnt_bodyid[0]]))
    if total <= stated:
        raise InputError(
            f"drives: mass: the links that state one weigh {stated:.4g} kg, so that the arm cannot "
            f"weigh {total:g} kg"
        )
    return (total - stated) / volume


def _massless_notes(names: Sequence[str]) -> tuple[str, ...]:
    if not names:
        return ()
    return (
        f"{_listed(names)} no mass and {'are' if len(names) > 1 else 'is'} fixed to one that does; "
        "taken as massless, state it in [mass] of drives.toml if it matters",
    )


def _assumed_line(
    values: Mapping[str, Value], total: float | None, groups: Mapping[str, list[mujoco.MjsBody]]
) -> tuple[str, ...]:
    assumed = {name: one.value for name, one in values.items() if one.source == "assumed"}
    assumed.pop(_base(groups), None)  # it does not move, so that its mass has no effect
    if not assumed:
        return ()
    how = f"from their shapes at {DENSITY:g} kg/m^3"
    ask = "state mass = TOTAL or the mass of each link in [mass] of drives.toml"
    if total is not None:
        how, ask = f"as shares of the given {total:g} kg by the volume of their shapes", ""
    line = f"{_listed(list(assumed))} no mass; assumed {sum(assumed.values()):.3g} kg {how}"
    return (f"{line}; {ask}" if ask else line,)


def _listed(names: Sequence[str]) -> str:
    many = len(names) > 1
    listed = ", ".join(f"'{name}'" for name in names)
    return f"link{'s' if many else ''} {listed} state{'' if many else 's'}"

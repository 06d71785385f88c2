"""Arms whose drives are known, and what the drives of a similar arm have.

    like = find_like("UR10e", ["pan", "lift", "elbow", "w1", "w2", "w3"])
    like = find_like("5 kg", ["pan", "lift", "elbow", "w1", "w2", "w3"])
    like.axes[0]["torque_limit"]

The arms, with the source of each number, stand in known_drives.toml. A payload stands for a class
of arms: each number is a power of the payload, with one exponent and a factor for each axis, fitted
to the known arms with as many axes.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from typing import Any

import numpy as np

from faultgen.errors import InputError

NUMBERS = (
    "speed_limit",
    "gear_ratio",
    "torque_limit",
    "reflected_inertia",
    "coulomb",
    "viscous",
    "stiffness",
)
"""Numbers of an axis that an arm can lend, all at the joint."""
LEAST, MOST = 0.5, 500.0
"""Payloads of a class [kg]."""

_FEWEST = 3  # arms with a known number, of which a class is made
_KG = re.compile(r"\s*([0-9]+(?:\.[0-9]*)?|\.[0-9]+)\s*kg\s*", re.IGNORECASE)


@dataclass(frozen=True)
class Like:
    """What the drives of an arm, or of a class of arms, have."""

    name: str
    """Name of the arm, or the class, such as "5 kg"."""
    axes: tuple[Mapping[str, float], ...]
    """Known numbers of each axis, at the joint: some of `NUMBERS`."""
    source: Mapping[str, str]
    """Where each of these numbers comes from."""
    remark: str = ""
    """What the user has to know; empty if nothing."""


@lru_cache(maxsize=1)
def _stored() -> str:
    return resources.files("faultgen.building").joinpath("known_drives.toml").read_text()


def read_arms() -> list[dict[str, Any]]:
    """Return the arms whose drives are known.

    Returns:
        The entries of known_drives.toml; numbers of axes are arrays of shape (n_axes,).
    """
    arms: list[dict[str, Any]] = tomllib.loads(_stored())["arm"]
    for arm in arms:
        for key, value in arm.items():
            if key != "sources" and isinstance(value, list):
                arm[key] = np.array(value, dtype=float)
        arm["largest"] = np.full(len(arm["torque_limit"]), np.max(arm["weight_torque"]))
    return arms


def find_like(text: str, joints: Sequence[str]) -> Like:
    """Find the arm, or make the class of arms, that a user names.

    Args:
        text: Name of a known arm, or a part of it, or a payload such as "5 kg".
        joints: Names of the axes of the user's arm.

    Returns:
        What its drives have.

    Raises:
        InputError: There is no such arm, it has another number of axes, or the payload is outside
            of the range.
    """
    arms = read_arms()
    payload = _KG.fullmatch(text)
    if payload:
        return payload_class(float(payload.group(1)), len(joints), arms)
    wanted = _plain(text)
    found = [arm for arm in arms if wanted and wanted in _plain(arm["name"])]
    found = [arm for arm in found if _plain(arm["name"]) == wanted] or found
    fitting = [arm["name"] for arm in arms if _n_axes(arm) == len(joints)]
    listed = f"with {len(joints)} axes: {', '.join(fitting)}" if fitting else "of no known arm"
    if len(found) != 1:
        what = "fits to several arms" if found else "is no known arm and no payload"
        raise InputError(f"--like: '{text}' {what}; give one {listed}, or a payload such as '5 kg'")
    arm = found[0]
    if _n_axes(arm) != len(joints):
        raise InputError(
            f"--like: {arm['name']} has {_n_axes(arm)} axes, but the arm has {len(joints)}; give "
            f"one {listed}, or a payload such as '5 kg'"
        )
    axes = [
        {key: float(arm[key][k]) for key in NUMBERS if np.isfinite(arm[key][k])}
        for k in range(len(joints))
    ]
    why = f"like {arm['name']}: {'; '.join(arm['sources'])}"
    return Like(arm["name"], tuple(axes), dict.fromkeys(NUMBERS, why))


def payload_class(payload: float, n_axes: int, arms: Sequence[Mapping[str, Any]]) -> Like:
    """Derive the numbers of a class of arms from its payload.

    Args:
        payload: Rated payload [kg].
        n_axes: Number of axes.
        arms: Arms whose drives are known.

    Returns:
        What drives of such arms have. Numbers that fewer than three arms with as many axes state
        are left out.

    Raises:
        InputError: The payload is outside of the range, or no number can be derived.
    """
    if not LEAST <= payload <= MOST:
        raise InputError(f"--like: a payload must be {LEAST:g} to {MOST:g} kg, not {payload:g}")
    alike = [arm for arm in arms if _n_axes(arm) == n_axes]
    axes: list[dict[str, float]] = [{} for _ in range(n_axes)]
    source = {}
    for key in NUMBERS:
        known = [arm for arm in alike if np.isfinite(arm[key]).any()]
        if len(known) < _FEWEST:
            continue
        factors, exponent = _power_law(key, known)
        names = ", ".join(arm["name"] for arm in known)
        source[key] = (
            f"class of {payload:g} kg: derived, payload to the power of {exponent:.2g}, fitted to "
            f"{names}"
        )
        for axis, factor in enumerate(factors):
            if np.isfinite(factor):
                axes[axis][key] = float(np.exp(factor + exponent * np.log(payload)))
    if not source:
        counts = sorted({_n_axes(arm) for arm in arms if _n_axes(arm) > 1})
        raise InputError(
            f"--like: too few arms with {n_axes} axes are known for a class of payloads; the known "
            f"ones have {' or '.join(map(str, counts))} axes"
        )
    loads = [float(arm["payload"]) for arm in alike]
    outside = not min(loads) <= payload <= max(loads)
    remark = (
        "--like with a payload is rougher than what is assumed from the masses of the model: on "
        "known arms, torque limits were off by a factor of 2.2 instead of 1.65 and friction by 2.8 "
        "instead of 1.9 (docs/robots.md); use it if these masses are doubtful"
    )
    if outside:
        remark += (
            f"; {payload:g} kg is an extrapolation, because the known arms with {n_axes} axes "
            f"carry {min(loads):g} to {max(loads):g} kg"
        )
    return Like(f"{payload:g} kg", tuple(axes), source, remark)


def _power_law(key: str, arms: Sequence[Mapping[str, Any]]) -> tuple[np.ndarray, float]:
    """Fit log number = factor of the axis + exponent times log payload; every arm the same.

    Args:
        key: One of `NUMBERS`.
        arms: Arms that know the number.

    Returns:
        Logarithms of the factors, shape (n_axes,), NaN where no arm knows one; and the exponent.
    """
    n_axes = _n_axes(arms[0])
    rows, values, weights = [], [], []
    for arm in arms:
        there = np.flatnonzero(np.isfinite(arm[key]))
        for axis in there:
            rows.append(np.append(np.eye(n_axes)[axis], np.log(arm["payload"])))
            values.append(np.log(arm[key][axis]))
            weights.append(1 / np.sqrt(len(there)))
    weight = np.array(weights)
    data = np.array(rows) * weight[:, None]
    found = np.linalg.lstsq(data, np.array(values) * weight, rcond=None)[0]
    unknown = ~np.any(data[:, :n_axes], axis=0)
    return np.where(unknown, np.nan, found[:n_axes]), float(found[n_axes])


def _n_axes(arm: Mapping[str, Any]) -> int:
    return len(arm["torque_limit"])


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())

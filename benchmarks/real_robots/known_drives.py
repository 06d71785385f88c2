"""How far the assumed drives are off on arms whose drives are known.

    python -m benchmarks.real_robots.known_drives [--save FILE]

fits the laws of faultgen/building/usual.py to the arms of faultgen/building/known_drives.toml,
prints their numbers, and prints two tables: the ratio of the assumed to the known number on each
arm, with laws that were fitted to all other arms, and with the class of its payload (--like) that
was made of all other arms. A torque limit and a speed limit that the model of a real arm states
would be used; here, the first table uses the speed limit only, and the second neither.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from faultgen.building import usual
from faultgen.building.alike import NUMBERS, payload_class, read_arms
from faultgen.building.drive_numbers import drive_of
from faultgen.building.seen import Seen
from faultgen.evaluation.markdown import table
from faultgen.system.files import write_text

TORQUE, STIFFNESS = "torque limit", "gearbox stiffness"

Columns = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Law:
    """A number of a drive as a product of powers of what it depends on."""

    name: str
    """As in the table."""
    known: Callable[[Columns], np.ndarray]
    """Logarithm of the known number, divided by what it is proportional to."""
    powers: Callable[[Columns], Sequence[np.ndarray]]
    """Logarithms of what has an exponent."""
    now: Callable[[], tuple[float, ...]]
    """Logarithm of the factor, and the exponents, that the package has."""


def _none(c: Columns) -> Sequence[np.ndarray]:
    return ()


LAWS = (
    Law(
        TORQUE,
        lambda c: np.log(c["torque_limit"] / c["largest"]),
        lambda c: (
            np.log(c["largest"] / usual.TORQUE_AT),
            np.log(c["weight_torque"] / c["largest"]),
        ),
        lambda: (np.log(usual.TORQUE), usual.TORQUE_SIZE, usual.TORQUE_SHARE),
    ),
    Law(
        "motor speed",
        lambda c: np.log(c["gear_ratio"] * c["speed_limit"]),
        _none,
        lambda: (np.log(usual.MOTOR_SPEED),),
    ),
    Law(
        "rotor inertia",
        lambda c: np.log(c["reflected_inertia"] * c["speed_limit"] / c["torque_limit"]),
        lambda c: (np.log(c["torque_limit"] / usual.RUN_UP_AT),),
        lambda: (np.log(usual.RUN_UP), usual.RUN_UP_SIZE),
    ),
    Law(
        "Coulomb friction",
        lambda c: np.log(c["coulomb"] / c["torque_limit"]),
        _none,
        lambda: (np.log(usual.COULOMB),),
    ),
    Law(
        "viscous friction",
        lambda c: np.log(c["viscous"] * c["speed_limit"] / c["coulomb"]),
        _none,
        lambda: (np.log(usual.VISCOUS),),
    ),
    Law(
        STIFFNESS,
        lambda c: np.log(c["torque_limit"] / c["stiffness"]),
        _none,
        lambda: (np.log(usual.WIND_UP),),
    ),
)
"""Each is fitted given the numbers before it, as a build uses them."""


def _columns(law: Law, arm: Columns) -> tuple[np.ndarray, np.ndarray]:
    """Known numbers of an arm, shape (n_axes,), and what they depend on, (n_axes, n_numbers)."""
    with np.errstate(invalid="ignore"):
        known = law.known(arm)
        terms = np.column_stack([np.ones(len(known)), *law.powers(arm)])
    return known, terms


def fit(law: Law, arms: Sequence[Columns]) -> np.ndarray:
    """Fit a law by least squares of logarithms; every arm counts the same.

    Args:
        law: The law.
        arms: The arms.

    Returns:
        Logarithm of the factor, then the exponents.
    """
    rows, weights = [], []
    for arm in arms:
        row = np.column_stack(_columns(law, arm))
        row = row[np.isfinite(row).all(axis=1)]
        rows.append(row)
        weights.append(np.full(len(row), 1 / np.sqrt(max(len(row), 1))))
    data, weight = np.vstack(rows), np.concatenate(weights)[:, None]
    return np.linalg.lstsq(data[:, 1:] * weight, data[:, 0] * weight[:, 0], rcond=None)[0]


def ratios(law: Law, arm: Columns, numbers: Sequence[float] | np.ndarray) -> np.ndarray:
    """Return assumed over known numbers of one arm, shape (n_axes,), NaN where none is known.

    Args:
        law: The law.
        arm: The arm.
        numbers: Logarithm of the factor, then the exponents.
    """
    known, terms = _columns(law, arm)
    off = np.exp(terms @ np.asarray(numbers) - known)
    if law.name == TORQUE:
        off = np.maximum(off, usual.HOLD * arm["gravity"] / arm["torque_limit"])
    return 1 / off if law.name == STIFFNESS else off  # the law is that of the wind-up


def class_ratios(arm: Columns, arms: Sequence[Columns]) -> dict[str, np.ndarray]:
    """Return the numbers of the class of an arm's payload over its known numbers.

    Args:
        arm: The arm.
        arms: The other arms, of which the class is made.

    Returns:
        Shape (n_axes,) by number, NaN where one of both is not known.
    """
    like = payload_class(float(arm["payload"]), len(arm["torque_limit"]), arms)
    return {
        key: np.array([axis.get(key, np.nan) for axis in like.axes]) / arm[key] for key in NUMBERS
    }


def assumed_ratios(arm: Columns) -> dict[str, np.ndarray]:
    """Return what a build without --like assumes over the known numbers of an arm.

    Args:
        arm: The arm. Its model states masses, but no limits.

    Returns:
        Shape (n_axes,) by number, NaN where none is known.
    """
    rows = []
    for axis, inertia in enumerate(arm["arm_inertia"]):
        seen = Seen(
            slide=False,
            most=inertia,
            least=inertia / 2,
            gravity=arm["gravity"][axis],
            weight=arm["weight_torque"][axis],
            arm_weight=arm["largest"][axis],
        )
        found = {name: one.value for name, one in drive_of({}, seen).items()}
        ratio = found["gear_ratio"]
        found["reflected_inertia"] = found["rotor_inertia"] * ratio**2
        found["coulomb"] = found["coulomb_friction"] * ratio
        found["viscous"] = found["viscous_friction"] * ratio**2
        rows.append({**found, "stiffness": found["gear_stiffness"]})
    return {key: np.array([row[key] for row in rows]) / arm[key] for key in NUMBERS}


def _class_table(arms: Sequence[Columns]) -> dict[str, Any]:
    six = [arm for arm in arms if len(arm["torque_limit"]) == 6]
    found = [class_ratios(arm, [one for one in six if one is not arm]) for arm in six]
    rows = [
        [f"{arm['name']}, {arm['payload']:g} kg", *(_cell(one[key]) for key in NUMBERS)]
        for arm, one in zip(six, found, strict=True)
    ]
    columns = [[one[key] for one in found] for key in NUMBERS]
    rows.append(["typical factor", *(_typical_cell(one) for one in columns)])
    plain = [assumed_ratios(arm) for arm in six]
    cells = [_typical_cell([one[key] for one in plain]) for key in NUMBERS]
    rows.append(["typical factor without --like", *cells])
    head = ["arm, rated payload", *(key.replace("_", " ") for key in NUMBERS)]
    return {"head": head, "rows": rows}


def _typical_cell(errors: Sequence[np.ndarray]) -> str:
    is_there = any(np.isfinite(one).any() for one in errors)
    return f"{typical(errors):.2f}" if is_there else ""


def typical(errors: Sequence[np.ndarray]) -> float:
    """Return the typical factor by which a law is off: RMS of logarithms, every arm the same."""
    squares = [np.nanmean(np.log(one) ** 2) for one in errors if np.isfinite(one).any()]
    return float(np.exp(np.sqrt(np.mean(squares))))


def told() -> dict[str, Any]:
    """Return the tables of docs/robots.md: laws and classes fitted without the arm of the row."""
    arms = read_arms()
    names = [*(law.name for law in LAWS), ALL]
    errors: dict[str, list[np.ndarray]] = {name: [] for name in names}
    for arm in arms:
        others = [one for one in arms if one is not arm]
        for law in LAWS:
            errors[law.name].append(ratios(law, arm, fit(law, others)))
        errors[ALL].append(errors[TORQUE][-1] * errors["Coulomb friction"][-1])
    rows = [
        [f"{arm['name']}, {arm['payload']:g} kg", *(_cell(errors[name][k]) for name in names)]
        for k, arm in enumerate(arms)
    ]
    most = [np.exp(np.nanmax(np.abs(np.log(np.concatenate(errors[n]))))) for n in names]
    rows.append(["typical factor", *(f"{typical(errors[n]):.2f}" for n in names)])
    rows.append(["largest factor", *(f"{one:.2g}" for one in most)])
    return {"head": ["arm, rated payload", *names], "rows": rows, "classes": _class_table(arms)}


ALL = "Coulomb friction, torque limit assumed too"
"""Column of what the user gets who states neither."""


def _cell(found: np.ndarray) -> str:
    """Geometric mean over the axes for which it is known."""
    found = found[np.isfinite(found)]
    return f"{np.exp(np.mean(np.log(found))):.2g}" if len(found) else ""


def main() -> None:
    """Print the fit and the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--save", type=Path, help="also write the tables there, as JSON")
    arguments = parser.parse_args()
    arms = read_arms()
    for law in LAWS:
        found = fit(law, arms)
        print(f"{law.name}: factor {np.exp(found[0]):.4g}, exponents {np.round(found[1:], 3)}")
    result = told()
    for one in (result, result["classes"]):
        print(table(one["head"], one["rows"]))
    if arguments.save:
        write_text(arguments.save, json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()

"""Cases of laboratories whose effects are stated, not drawn, and for which no oracle is computed.

`plant_cases` and `servo_cases` say which.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Parallel, delayed

from laboratories.draw import Laboratory
from laboratories.effects import ORDERS, UNLISTED, WAVES, Effect, axes_of, unit
from laboratories.files import write_truth
from laboratories.make import model_for, record_case, set_up

Stated = tuple[str, float | None]
"""Name and severity of an effect; a ripple as a share of Coulomb friction. None: that of
`effects.unit`, and twice that for an unlisted effect."""

_MAIN = 4  # axes that carry an effect


def make_cases(
    lab: Laboratory, folder: Path, stated: Mapping[int, Stated | None], prefix: str
) -> list[dict[str, Any]]:
    """Simulate the cases of one laboratory and write them.

    Args:
        lab: The laboratory, of which the servo is the point.
        folder: Where cases/ goes.
        stated: The effect by number of the case, from which the seed comes; None: healthy.
        prefix: Of the names of the cases, before their numbers.

    Returns:
        The truth: two entries for each case, with and without a twin.
    """
    setup, robot = set_up(lab), model_for(lab, folder)
    entries = []
    for number, what in stated.items():
        rng = np.random.default_rng([lab.seed, 6, number])
        effects = [] if what is None else [_effect(lab, what, rng)]
        name = f"{prefix}{number}"
        floor = record_case(setup, effects, robot, folder / "cases" / name, rng)
        kind = "healthy" if what is None else "unlisted" if what[0] in UNLISTED else "single"
        told = {
            "kind": kind,
            "robot": lab.factors["robot"],
            "effects": [vars(effect) for effect in effects],
            "d_prime": None,
            "separation": None,
            "floor": floor,
            "stressed": ["servo"],
            "factors": lab.factors,
        }
        entries += [
            {"name": f"{name}_{mode}", "folder": name, "mode": mode, **told}
            for mode in ("twin", "alone")
        ]
    return entries


def _effect(lab: Laboratory, what: Stated, rng: np.random.Generator) -> Effect:
    """An effect on a random one of its first axes."""
    name, severity = what
    axes = axes_of(name, lab.machine.n_axes)
    axis = axes[int(rng.integers(min(len(axes), _MAIN)))]
    if severity is None:
        severity = unit(name, axis, lab.machine) * (2 if name in UNLISTED else 1)
    if name not in WAVES:
        return Effect(name, axis, severity, {})
    details = {"order": float(rng.choice(ORDERS)), "phase": float(rng.uniform(0, 6))}
    if name == "torque_ripple":
        severity *= float(lab.machine.coulomb[axis - 1])
    return Effect(name, axis, severity, details)


def write_cases(
    title: str, make: Callable[[Path, int, int], list[dict[str, Any]]], count: int, first: int
) -> None:
    """Write all cases to the folder that the command line names.

    Args:
        title: What `--help` says.
        make: Function of the folder, the number of a laboratory, and the number of the first one,
            from which all seeds come. It returns what `make_cases` does.
        count: Number of laboratories.
        first: Number of the first one, unless the command line gives another.
    """
    parser = argparse.ArgumentParser(description=title)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--first", type=int, default=first, help="Number of the first laboratory.")
    parser.add_argument("--workers", type=int, default=2)
    told = parser.parse_args()
    made = Parallel(n_jobs=told.workers)(
        delayed(make)(told.folder, number, told.first) for number in range(count)
    )
    write_truth([entry for entries in made for entry in entries], told.folder / "truth.json")

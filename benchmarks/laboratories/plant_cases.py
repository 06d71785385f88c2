"""40 cases of four laboratories, with effects of a size that matters in a plant.

Each laboratory has a healthy robot and nine effects on axes 1 to 4 (payload: 6), and four motions
of 6.25 s. Their servos are that of the model and another one. No oracle is computed.

    python -m laboratories.plant_cases DIR [--first 1000]       # in the folder benchmarks
    python laboratories_score.py --trial DIR --results NAME --mode alone
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Parallel, delayed

from laboratories.draw import BASE, Laboratory
from laboratories.effects import ORDERS, WAVES, Effect, axes_of
from laboratories.files import without_oracle, write_truth
from laboratories.make import model_for, record_case, set_up

SETTINGS: tuple[dict[str, Any], ...] = (
    {"robot": "puma560"},
    {"robot": "puma560", "servo": "cascade_ff", "bandwidth": 7.0},
    {"robot": "irb6700"},
    {"robot": "irb6700", "servo": "pd_ff", "bandwidth": 7.0, "reference": False},
)
"""What each laboratory has; the other factors are those of an easy one, with longer motions."""

LONGER = {"seconds": 25.0, "segments": 4, "servo_period": 1e-3}

PLANT: tuple[tuple[str, float], ...] = (
    ("friction_wear", 0.4),
    ("coulomb_friction", 0.4),
    ("viscous_friction", 0.4),
    ("backlash", 1e-3),
    ("gear_stiffness", 0.2),
    ("gear_stiffness", 0.4),
    ("payload_mass", 0.5),
    ("delay", 4e-3),
    ("torque_ripple", 0.1),
)
"""Effects and severities in the unit of the catalogue; a ripple as a share of Coulomb friction."""

_MAIN = 4  # axes that carry an effect


def make(folder: Path, number: int, first: int) -> list[dict[str, Any]]:
    """Simulate the cases of one laboratory and write them.

    Args:
        folder: Where cases/ goes.
        number: Of `SETTINGS`.
        first: Number of the first laboratory, from which all seeds come.

    Returns:
        The truth: two entries for each case, with and without a twin.
    """
    lab = Laboratory("development", number + first, BASE | LONGER | SETTINGS[number], ())
    setup = set_up(lab)
    robot = model_for(lab, folder)
    entries: list[dict[str, Any]] = []
    for k, what in enumerate((None, *PLANT)):
        rng = np.random.default_rng([lab.seed, 6, k])
        effects = [] if what is None else [_effect(lab, *what, rng)]
        name = f"lab{number}_{k}"
        floor = record_case(setup, effects, robot, folder / "cases" / name, rng)
        entries += without_oracle(name, "single" if effects else "healthy", lab, effects, floor)
    return entries


def _effect(lab: Laboratory, name: str, severity: float, rng: np.random.Generator) -> Effect:
    """An effect on a random one of its first axes."""
    axes = axes_of(name, lab.machine.n_axes)
    axis = axes[int(rng.integers(min(len(axes), _MAIN)))]
    if name not in WAVES:
        return Effect(name, axis, severity, {})
    details = {"order": float(rng.choice(ORDERS)), "phase": float(rng.uniform(0, 6))}
    return Effect(name, axis, severity * float(lab.machine.coulomb[axis - 1]), details)


def main() -> None:
    """Write all cases to a folder."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--first", type=int, default=1000, help="Number of the first laboratory.")
    parser.add_argument("--workers", type=int, default=2)
    told = parser.parse_args()
    made = Parallel(n_jobs=told.workers)(
        delayed(make)(told.folder, number, told.first) for number in range(len(SETTINGS))
    )
    write_truth([entry for entries in made for entry in entries], told.folder / "truth.json")


if __name__ == "__main__":
    main()

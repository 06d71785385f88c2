"""Cases of a PUMA 560 with other servos: healthy robots, clear effects and unlisted ones.

Each laboratory has two motions of 10 s, a servo of 7 Hz at 1 kHz, and parameters that are wrong by
1 to 3 %. Six effects of twelve and one of three unlisted ones are drawn. No oracle is computed.

    python -m laboratories.servo_cases DIR [--first 6000]       # in the folder benchmarks
    python laboratories_score.py --trial DIR --results NAME
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Parallel, delayed

from laboratories.draw import BASE, Laboratory
from laboratories.effects import ORDERS, UNLISTED, WAVES, Effect, axes_of, unit
from laboratories.files import without_oracle, write_truth
from laboratories.make import model_for, record_case, set_up

COMMON: dict[str, Any] = {
    "robot": "puma560",
    "bandwidth": 7.0,
    "servo_period": 1e-3,
    "seconds": 20.0,
    "segments": 2,
    "repeat": 0.005,
}
SETTINGS: tuple[dict[str, Any], ...] = (
    {"servo": "pd", "noise": "constant", "level": 0.005, "model_error": 0.01},
    {"servo": "pid_ff", "noise": "by_motion", "level": 0.01, "model_error": 0.02},
    {"servo": "cascade_ff", "noise": "by_load", "level": 0.01, "model_error": 0.03},
    {
        "servo": "pd_ff",
        "noise": "by_motion",
        "level": 0.005,
        "model_error": 0.02,
        "reference": False,
    },
)
"""What each laboratory has; the other factors are those of an easy one."""

CLEAR: tuple[tuple[str, float | None], ...] = (
    ("friction_wear", 0.2),
    ("viscous_friction", 0.3),
    ("static_friction", 0.5),
    ("backlash", 5e-4),
    ("torque_ripple", 0.1),
    ("payload_mass", 0.2),
    ("delay", 3e-3),
    ("gear_stiffness", 0.3),
    ("transmission_error", None),
    ("load_friction", 0.05),
    ("rotor_inertia", 0.15),
    ("temperature_friction", 0.3),
)
"""Effects and severities in the unit of the catalogue; a ripple as a share of Coulomb friction.
None: that of `effects.unit`."""
BESIDE = ("position_friction", "acceleration_friction", "dress_pack")
"""Unlisted effects, with twice the severity of `effects.unit`."""

_DRAWN = 6  # effects of a laboratory
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
    lab = Laboratory("development", number + first, BASE | COMMON | SETTINGS[number], ())
    setup, robot = set_up(lab), model_for(lab, folder)
    rng = np.random.default_rng([lab.seed, 77])
    drawn = sorted(rng.choice(np.arange(1, len(CLEAR) + 1), _DRAWN, replace=False).tolist())
    last = int(rng.integers(len(CLEAR) + 1, len(CLEAR) + 1 + len(BESIDE)))
    every = (None, *CLEAR, *((name, None) for name in BESIDE))
    entries: list[dict[str, Any]] = []
    for k in (0, *drawn, last):
        rng = np.random.default_rng([lab.seed, 6, k])
        what = every[k]
        effects = [] if what is None else [_effect(lab, what[0], what[1], rng)]
        name = f"a{lab.number}_{k}"
        floor = record_case(setup, effects, robot, folder / "cases" / name, rng)
        kind = "healthy" if not effects else "unlisted" if k == last else "single"
        entries += without_oracle(name, kind, lab, effects, floor)
    return entries


def _effect(lab: Laboratory, name: str, severity: float | None, rng: np.random.Generator) -> Effect:
    """An effect on a random one of its first axes."""
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


def main() -> None:
    """Write all cases to a folder."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--first", type=int, default=6000, help="Number of the first laboratory.")
    parser.add_argument("--workers", type=int, default=2)
    told = parser.parse_args()
    made = Parallel(n_jobs=told.workers)(
        delayed(make)(told.folder, number, told.first) for number in range(len(SETTINGS))
    )
    write_truth([entry for entries in made for entry in entries], told.folder / "truth.json")


if __name__ == "__main__":
    main()

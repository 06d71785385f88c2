"""Cases of a PUMA 560 with other servos: healthy robots, clear effects and unlisted ones.

Each laboratory has two motions of 10 s, a servo of 7 Hz at 1 kHz, and parameters that are wrong by
1 to 3 %. Six effects of twelve and one of three unlisted ones are drawn. No oracle is computed.

    python -m laboratories.servo_cases DIR [--first 6000]       # in the folder benchmarks
    python score_discovery.py --trial DIR --answers NAME
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from laboratories.draw import BASE, Laboratory
from laboratories.stated_cases import Stated, make_cases, write_cases

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

CLEAR: tuple[Stated, ...] = (
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
"""Effects and severities in the unit of the catalogue."""
BESIDE = ("position_friction", "acceleration_friction", "dress_pack")
"""Unlisted effects."""

_DRAWN = 6  # effects of a laboratory


def make(folder: Path, number: int, first: int) -> list[dict[str, Any]]:
    """Make the cases of one of `SETTINGS`, see `stated_cases.write_cases`."""
    lab = Laboratory("development", number + first, BASE | COMMON | SETTINGS[number], ())
    every: tuple[Stated | None, ...] = (None, *CLEAR, *((name, None) for name in BESIDE))
    rng = np.random.default_rng([lab.seed, 77])
    drawn = sorted(rng.choice(np.arange(1, len(CLEAR) + 1), _DRAWN, replace=False).tolist())
    last = int(rng.integers(len(CLEAR) + 1, len(every)))
    return make_cases(lab, folder, {k: every[k] for k in (0, *drawn, last)}, f"a{lab.number}_")


if __name__ == "__main__":
    write_cases((__doc__ or "").split("\n\n")[0], make, len(SETTINGS), 6000)

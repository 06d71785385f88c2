"""40 cases of four laboratories, with effects of a size that matters in a plant.

Each laboratory has a healthy robot and nine effects on axes 1 to 4 (payload: 6), and four motions
of 6.25 s. Their servos are that of the model and another one. No oracle is computed.

    python -m laboratories.plant_cases DIR [--first 1000]       # in the folder benchmarks
    python score_discovery.py --trial DIR --answers NAME --only alone
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from laboratories.draw import BASE, Laboratory
from laboratories.stated_cases import Stated, make_cases, write_cases

SETTINGS: tuple[dict[str, Any], ...] = (
    {"robot": "puma560"},
    {"robot": "puma560", "servo": "cascade_ff", "bandwidth": 7.0},
    {"robot": "irb6700"},
    {"robot": "irb6700", "servo": "pd_ff", "bandwidth": 7.0, "reference": False},
)
"""What each laboratory has; the other factors are those of an easy one, with longer motions."""

LONGER = {"seconds": 25.0, "segments": 4, "servo_period": 1e-3}

PLANT: tuple[Stated, ...] = (
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


def make(folder: Path, number: int, first: int) -> list[dict[str, Any]]:
    """Make the cases of one of `SETTINGS`, see `stated_cases.write_cases`."""
    lab = Laboratory("development", number + first, BASE | LONGER | SETTINGS[number], ())
    return make_cases(lab, folder, dict(enumerate((None, *PLANT))), f"lab{number}_")


if __name__ == "__main__":
    write_cases(__doc__.split("\n\n")[0], make, len(SETTINGS), 1000)

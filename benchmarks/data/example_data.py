"""Make the small datasets that are part of the package: `faultgen.datasets`.

    python -m benchmarks.data.example_data [NAME ...]

Writes `faultgen/datasets/data/NAME/` in a few minutes. Same code, same machine: same bytes. The
descriptions (README.md of each folder) are written by hand, and stay.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

from faultgen.dataset.experiment import Experiment
from faultgen.dataset.sweep import generate
from faultgen.fleet import generate_fleet, load_fleet

DATA = Path(__file__).parents[2] / "faultgen" / "datasets" / "data"
THIN = 25  # 10 samples a second are kept; the features were computed from all 250
LOGGED = ["signals/motor_position", "signals/motor_velocity", "signals/motor_torque"]

EXPERIMENTS = {
    "wear": Experiment(
        robot=["puma560"],
        task=["spot_weld"],
        effect=["friction_wear"],
        axis=[[1], [2], [3]],
        severity=[0.2],
        cycles=10,
        repetitions=3,
        sensors="realistic",
        signals=LOGGED,
        thin=THIN,
        seed=1,
    ),
    "faults": Experiment(
        robot=["puma560"],
        task=["pick_and_place"],
        effect=["friction_wear", "viscous_friction", "backlash", "gear_stiffness", "torque_ripple"],
        axis=[[2]],
        cycles=6,
        repetitions=3,
        sensors="realistic",
        signals=LOGGED,
        thin=THIN,
        seed=2,
    ),
    "run_to_failure": Experiment(
        robot=["puma560"],
        task=["pick_and_place"],
        effect=["friction_wear"],
        axis=[[1], [2], [3]],
        severity=[1.0],
        cycles=40,
        repetitions=3,
        healthy=False,
        sensors="realistic",
        signals=[],
        thin=THIN,
        seed=3,
    ),
}
"""The experiments, by name of the dataset."""

FLEET = """
seed = 4
robots = 8
failing = 4
days = 40
models = ["puma560"]

[production]
samples_a_day = [1, 1]
"""
"""The plan of the fleet."""


def make(name: str) -> None:
    """Make a dataset, and put it into the package.

    Args:
        name: A name of `EXPERIMENTS`, or "fleet".
    """
    place = DATA / name
    place.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "made"
        if name == "fleet":
            plan = Path(folder) / "fleet.toml"
            plan.write_text(FLEET)
            generate_fleet(load_fleet(plan), made, workers=1)
            files = [path for path in made.rglob("*") if path.is_file()]
        else:
            generate(EXPERIMENTS[name], made, workers=1)
            files = [made / "dataset.h5", made / "dataset.h5.sha256"]
        for path in files:
            target = place / path.relative_to(made)
            target.parent.mkdir(exist_ok=True)
            shutil.copyfile(path, target)


if __name__ == "__main__":
    for chosen in sys.argv[1:] or [*EXPERIMENTS, "fleet"]:
        make(chosen)

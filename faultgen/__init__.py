"""Generate labelled condition-monitoring data of industrial robots that wear in MuJoCo.

import faultgen
faultgen.generate("experiment.toml", "out")
dataset = faultgen.open_dataset("out")
"""

from typing import Any

from faultgen.dataset.parted import open_parts
from faultgen.dataset.reader import open_dataset
from faultgen.errors import InputError, SimulationFailed

__all__ = [
    "InputError",
    "SimulationFailed",
    "discover",
    "generate",
    "load_robot",
    "open_dataset",
    "open_fleet",
    "open_parts",
]


def __getattr__(name: str) -> Any:
    """Import names that need MuJoCo on first use, because reading a dataset does not need it."""
    if name == "generate":
        from faultgen.dataset.sweep import generate

        return generate
    if name == "discover":
        from faultgen.report.discover import discover

        return discover
    if name == "load_robot":
        from faultgen.robot import load_robot

        return load_robot
    if name == "open_fleet":
        from faultgen.fleet import open_fleet

        return open_fleet
    raise AttributeError(f"module 'faultgen' has no attribute '{name}'")

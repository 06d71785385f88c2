"""Generate labelled condition-monitoring data of industrial robots that wear in MuJoCo.

import faultgen
faultgen.generate("experiment.toml", "out")
dataset = faultgen.open_dataset("out")
"""

from typing import TYPE_CHECKING

from faultgen.errors import InputError, SimulationFailed
from faultgen.system.lazy import lazily

if TYPE_CHECKING:
    from faultgen.dataset.parted import open_parts
    from faultgen.dataset.reader import open_dataset
    from faultgen.dataset.sweep import generate
    from faultgen.fleet.data import open_fleet
    from faultgen.report.discover import discover
    from faultgen.robot import load_robot

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

# reading a dataset does not need MuJoCo, and a refusal needs neither h5py nor numpy
lazily(
    __name__,
    {
        "discover": "faultgen.report.discover",
        "generate": "faultgen.dataset.sweep",
        "load_robot": "faultgen.robot",
        "open_dataset": "faultgen.dataset.reader",
        "open_fleet": "faultgen.fleet.data",
        "open_parts": "faultgen.dataset.parted",
    },
)

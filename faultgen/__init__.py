"""Generate labelled condition-monitoring data of industrial robots that wear in MuJoCo.

import faultgen
faultgen.generate("experiment.toml", "out")
dataset = faultgen.open_dataset("out")

Every command has a function or class here; ``dir(faultgen)`` lists them. Methods on plain arrays
are in ``faultgen.analysis``, small datasets in ``faultgen.datasets``.
"""

from typing import TYPE_CHECKING

from faultgen.errors import InputError, SimulationFailed
from faultgen.system.lazy import lazily

if TYPE_CHECKING:
    from faultgen import analysis, datasets
    from faultgen.dataset.parted import open_parts
    from faultgen.dataset.reader import open_dataset
    from faultgen.dataset.sweep import generate
    from faultgen.discovery.calibration.calibrate import calibrate
    from faultgen.discovery.discover import Discovery
    from faultgen.evaluation.benchmark import run_benchmark
    from faultgen.evaluation.detect import detect
    from faultgen.evaluation.isolate import isolate
    from faultgen.fleet import generate_fleet, load_fleet
    from faultgen.fleet.data import open_fleet
    from faultgen.recordings.import_log import import_log
    from faultgen.recordings.read import read_recording
    from faultgen.recordings.recording import Recording, write_recording
    from faultgen.report import write_report
    from faultgen.report.discover import discover
    from faultgen.robot import load_robot
    from faultgen.studies.runner import run_study
    from faultgen.system.version import __version__
    from faultgen.twin.detector import load_detector
    from faultgen.twin.judge import Judge
    from faultgen.twin.make import make_twin
    from faultgen.twin.monitor import Monitor, load_monitor
    from faultgen.twin.train import train

__all__ = [
    "Discovery",
    "InputError",
    "Judge",
    "Monitor",
    "Recording",
    "SimulationFailed",
    "__version__",
    "analysis",
    "calibrate",
    "datasets",
    "detect",
    "discover",
    "generate",
    "generate_fleet",
    "import_log",
    "isolate",
    "load_detector",
    "load_fleet",
    "load_monitor",
    "load_robot",
    "make_twin",
    "open_dataset",
    "open_fleet",
    "open_parts",
    "read_recording",
    "run_benchmark",
    "run_study",
    "train",
    "write_recording",
    "write_report",
]

# reading a dataset does not need MuJoCo, and a refusal needs neither h5py nor numpy
lazily(
    __name__,
    {
        "Discovery": "faultgen.discovery.discover",
        "Judge": "faultgen.twin.judge",
        "Monitor": "faultgen.twin.monitor",
        "Recording": "faultgen.recordings.recording",
        "__version__": "faultgen.system.version",
        "calibrate": "faultgen.discovery.calibration.calibrate",
        "detect": "faultgen.evaluation.detect",
        "discover": "faultgen.report.discover",
        "generate": "faultgen.dataset.sweep",
        "generate_fleet": "faultgen.fleet",
        "import_log": "faultgen.recordings.import_log",
        "isolate": "faultgen.evaluation.isolate",
        "load_detector": "faultgen.twin.detector",
        "load_fleet": "faultgen.fleet",
        "load_monitor": "faultgen.twin.monitor",
        "load_robot": "faultgen.robot",
        "make_twin": "faultgen.twin.make",
        "open_dataset": "faultgen.dataset.reader",
        "open_fleet": "faultgen.fleet.data",
        "open_parts": "faultgen.dataset.parted",
        "read_recording": "faultgen.recordings.read",
        "run_benchmark": "faultgen.evaluation.benchmark",
        "run_study": "faultgen.studies.runner",
        "train": "faultgen.twin.train",
        "write_recording": "faultgen.recordings.recording",
        "write_report": "faultgen.report",
    },
    modules=("analysis", "datasets"),
)

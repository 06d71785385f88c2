"""Small datasets that are part of the package, to try a method at once.

from faultgen.datasets import load_wear
wear = load_wear()
wear.data.shape, wear.target, wear.feature_names
faultgen.open_dataset(wear.path)

They are simulated, and their licence is CC BY 4.0.
"""

from faultgen.datasets.bunch import SmallDataset
from faultgen.datasets.load import load_faults, load_fleet, load_run_to_failure, load_wear

__all__ = ["SmallDataset", "load_faults", "load_fleet", "load_run_to_failure", "load_wear"]

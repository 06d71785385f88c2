"""Labelled datasets: the experiment that defines one, the runs it consists of, and its reader."""

from faultgen.dataset.reader import Dataset, open_dataset
from faultgen.dataset.stored_run import StoredRun

__all__ = ["Dataset", "StoredRun", "open_dataset"]

"""Labelled datasets: the experiment that defines one, the runs it consists of, and its reader."""

from faultgen.dataset.reader import Dataset, StoredRun, open_dataset

__all__ = ["Dataset", "StoredRun", "open_dataset"]

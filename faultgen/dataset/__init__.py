"""Labelled datasets: what they consist of, how they are made, and how they are read."""

from faultgen.dataset.reader import Dataset, StoredRun, open_dataset

__all__ = ["Dataset", "StoredRun", "open_dataset"]

"""Evaluation of detectors and isolators on a dataset."""

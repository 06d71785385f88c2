"""Evaluation of detectors and isolators on a dataset, and what a detector and an isolator are."""

from faultgen.analysis.isolation import Answer
from faultgen.evaluation.methods import Detector, Isolator, Setting

__all__ = ["Answer", "Detector", "Isolator", "Setting"]

"""Evaluation of detectors and isolators on a dataset, and what a detector and an isolator are."""

from faultgen.analysis.isolation import Answer
from faultgen.evaluation.classifier import Classifier
from faultgen.evaluation.methods import Detector, Isolator, LabelledRun, Setting

__all__ = ["Answer", "Classifier", "Detector", "Isolator", "LabelledRun", "Setting"]

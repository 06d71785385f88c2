"""Isolators that are classifiers: they learn from labelled runs which axis is worn.

class Forest(Classifier):
name = "random forest"
features = ("mean_abs_torque", "temperature")

def model(self):
return RandomForestClassifier(random_state=0)
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np

from faultgen.evaluation.methods import Isolator, LabelledRun


class Classifier(Isolator):
    """An isolator around a classifier with the interface of scikit-learn.

    It is trained on single cycles. The columns are its features, each cycle flattened to one row;
    values that are not defined become 0. The label is the first worn axis from 1, or 0. Cycles in
    which the fault is still small are not used for training, because they cannot be told from
    healthy ones. The answer is the most probable label, averaged over the last cycles.
    """

    supervised = True
    learns = False
    worn_from: ClassVar[float] = 0.25
    """Smallest severity of the cycles of worn runs that are used for training, as a share of the
    largest severity of the run."""
    window: ClassVar[int] = 5
    """Number of cycles over which probabilities are averaged."""

    @abstractmethod
    def model(self) -> Any:
        """Make the classifier, not yet fitted. It needs ``fit`` and ``predict_proba``."""

    def fit(self, *healthy: Sequence[np.ndarray]) -> None:
        """Learn nothing from healthy cycles alone; see `learn`."""

    def learn(self, runs: Sequence[LabelledRun]) -> None:
        """Train the classifier.

        Args:
            runs: Runs of the training part.

        Raises:
            ValueError: All runs have the same label.
        """
        rows, labels = [], []
        for run in runs:
            worn = run.severity > 0
            used = ~worn | (run.severity >= self.worn_from * run.severity.max())
            axis = run.axes[0] + 1 if run.axes else 0
            rows.append(self.columns(*(run.features[name] for name in self.features))[used])
            labels.append(np.where(worn, axis, 0)[used])
        y = np.concatenate(labels)
        if len(set(y.tolist())) < 2:
            raise ValueError("all training runs have the same label")
        self.model_ = self.model().fit(np.vstack(rows), y)

    def isolate(self, *features: np.ndarray) -> int:
        """Name the most probable axis of the last cycles.

        Args:
            features: Each feature of the cycles up to now.

        Returns:
            The axis from 0, or -1 for none.
        """
        last = self.columns(*(one[-self.window :] for one in features))
        probability = self.model_.predict_proba(last).mean(axis=0)
        return int(self.model_.classes_[np.argmax(probability)]) - 1

    def columns(self, *features: np.ndarray) -> np.ndarray:
        """Put the features side by side.

        Args:
            features: Each feature, shape (cycles, ...).

        Returns:
            Shape (cycles, columns).
        """
        return np.nan_to_num(np.hstack([one.reshape(len(one), -1) for one in features]))

"""Classifiers of failing robots. The test leaves out one failing and one normal robot at a time.

    rows = [prepare(record, combination)[1] for record in records]  # one array per robot
    make = partial(make_classifier, "LR", combination)
    found = leave_pair_out(rows, failed, make)
    found.auc  # shape (failing, normal)

The training data contain nothing of the two robots under test: scaling, components and tuning are
learned from the other robots. Tuning keeps the rows of a robot together. Results do not depend on
the number of workers.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, Self

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, ClassifierMixin, clone
from sklearn.ensemble import RandomForestClassifier, StackingClassifier
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import roc_auc_score
from sklearn.model_selection import GridSearchCV, StratifiedGroupKFold
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC
from threadpoolctl import threadpool_limits

from .preprocessing import Combination

Floats = NDArray[np.float64]
Ints = NDArray[np.int_]
Splits = list[tuple[Ints, Ints]]
Make = Callable[[int, Splits, int], BaseEstimator]
"""Makes a classifier from the number of columns, the splits of the training rows and a seed."""

CLASSIFIERS = ("LR", "SVM", "RF", "ES")
"""Logistic regression, support vector machine, random forest, and a stack of the first two."""

_TREES = 100
_COSTS = (0.1, 1.0, 10.0)
_WIDTHS = (0.1, 1.0)  # of the kernel's gamma, over one by the number of columns
_FOLDS = 3
_ITERATIONS = 2000


def make_classifier(
    name: str, combination: Combination, n_columns: int, splits: Splits, seed: int
) -> BaseEstimator:
    """Make a classifier of thesis 5.2.1 that includes standardisation and principal components.

    LR has a ridge penalty with scikit-learn's default weight, C = 1. Without a penalty the
    likelihood has no maximum if the training rows can be separated, which is often so here. SVM has
    a radial kernel, and its C and gamma are tuned for AUC. RF has 100 trees. ES is a logistic
    regression on the outputs of LR and the tuned SVM for rows on which these two were not trained.

    Args:
        name: One of `CLASSIFIERS`.
        combination: Preprocessing. Its principal components are a step of the pipeline.
        n_columns: Number of columns of the rows.
        splits: Training and validation rows for tuning and stacking.
        seed: Seed of the random forest.

    Returns:
        The classifier, not yet fitted.

    Raises:
        ValueError: The name is unknown.
    """
    linear = _pipeline(combination, LogisticRegression(max_iter=_ITERATIONS))
    if name == "LR":
        return linear
    if name == "RF":
        return _pipeline(combination, RandomForestClassifier(_TREES, random_state=seed))
    grid = {"svc__C": _COSTS, "svc__gamma": [width / n_columns for width in _WIDTHS]}
    radial = GridSearchCV(_pipeline(combination, SVC()), grid, scoring="roc_auc", cv=splits)
    if name == "SVM":
        return radial
    if name == "ES":
        return _Stack(linear, radial, splits)
    raise ValueError(f"unknown classifier '{name}': choose {', '.join(CLASSIFIERS)}")


def _pipeline(combination: Combination, last: BaseEstimator) -> Pipeline:
    return make_pipeline(StandardScaler(), *combination.reduction(), last)


class _Stack(ClassifierMixin, BaseEstimator):
    """Stack of two classifiers. The second one is tuned first, on all training rows."""

    def __init__(self, linear: BaseEstimator, tuned: GridSearchCV, splits: Splits) -> None:
        self.linear = linear
        self.tuned = tuned
        self.splits = splits

    def fit(self, X: Floats, y: Ints) -> Self:
        radial = clone(clone(self.tuned).fit(X, y).best_estimator_)
        base = [("LR", self.linear), ("SVM", radial)]
        self.stack_ = StackingClassifier(base, LogisticRegression(), cv=self.splits).fit(X, y)
        self.classes_ = self.stack_.classes_
        return self

    def decision_function(self, X: Floats) -> Floats:
        return self.stack_.decision_function(X)


@dataclass(frozen=True, eq=False)
class PairResult:
    """Result of leaving out pairs of robots."""

    auc: Floats
    """Area under the ROC curve of each pair, shape (failing, normal)."""
    seconds: float
    """Processor time of all pairs for training, tuning and testing [s]."""
    importance: dict[Any, float]
    """Decrease of the AUC if a group of columns is shuffled, by name of the group: mean over the
    pairs."""


def count_pairs(failed: ArrayLike) -> int:
    """Number of pairs of a failing and a normal robot.

    Args:
        failed: Whether each robot fails, shape (robots,).
    """
    fails = np.asarray(failed, dtype=bool)
    return int(fails.sum()) * int((~fails).sum())


def leave_pair_out(
    rows: Sequence[ArrayLike],
    failed: ArrayLike,
    make: Make,
    *,
    seed: int = 0,
    workers: int = 1,
    groups: Mapping[Any, Ints] | None = None,
    on_pair: Callable[[], object] | None = None,
) -> PairResult:
    """Train on all robots except a failing and a normal one, and test on these two, for all pairs.

    Source: thesis procedure 1; Airola et al. (2011), An experimental comparison of cross-validation
    techniques for estimating the area under the ROC curve.

    Args:
        rows: Rows of each robot, shape (its rows, columns).
        failed: Whether each robot fails, shape (robots,).
        make: Makes the classifier: `make_classifier` with its first two arguments given.
        seed: Seed of all random draws.
        workers: Number of processes. It has no effect on the results.
        groups: Columns whose importance is computed. Each group is shuffled over the rows of the
            tested pair. Default: none.
        on_pair: Function that is called after each pair, such as one that shows progress.

    Returns:
        AUC of each pair over the rows of both robots, shape (failing, normal), processor time, and
        importance of the groups.

    Raises:
        ValueError: There are fewer than three robots of either kind, the robots have different
            columns, or a robot has no rows.
    """
    arrays = [np.asarray(own, dtype=float) for own in rows]
    fails = np.asarray(failed, dtype=bool)
    if fails.shape != (len(arrays),):
        raise ValueError(f"{len(arrays)} robots have rows, failed has shape {fails.shape}")
    if min(fails.sum(), (~fails).sum()) < 3:
        raise ValueError("leaving out pairs needs three failing and three normal robots")
    widths = {own.shape[1:] for own in arrays}
    if len(widths) != 1 or len(next(iter(widths))) != 1 or min(map(len, arrays)) == 0:
        raise ValueError("every robot needs rows, of the same columns")
    ill, well = np.flatnonzero(fails), np.flatnonzero(~fails)
    pairs = list(product(ill.tolist(), well.tolist()))
    done = Parallel(n_jobs=workers, return_as="generator")(
        delayed(_pair)(arrays, fails, pair, make, [seed, *pair], groups or {}) for pair in pairs
    )
    found = []
    for one in done:
        found.append(one)
        if on_pair is not None:
            on_pair()
    return PairResult(
        auc=np.array([auc for auc, _, _ in found]).reshape(len(ill), len(well)),
        seconds=sum(seconds for _, seconds, _ in found),
        importance={
            name: float(np.mean([lost[name] for _, _, lost in found])) for name in groups or {}
        },
    )


def _pair(
    rows: Sequence[Floats],
    failed: NDArray[np.bool_],
    pair: tuple[int, int],
    make: Make,
    seed: Sequence[int],
    groups: Mapping[Any, Ints],
) -> tuple[float, float, dict[Any, float]]:
    """AUC of one pair, processor time [s], and loss of AUC for each shuffled group of columns."""
    with threadpool_limits(1):  # sums in another order would differ in their last digits
        started = time.process_time()
        kept = [k for k in range(len(rows)) if k not in pair]
        X = np.vstack([rows[k] for k in kept])
        robot = np.repeat(kept, [len(rows[k]) for k in kept])
        y = failed[robot].astype(int)
        rng = np.random.default_rng(seed)
        # The forest and the folds take whole numbers.
        own = int(rng.integers(2**31))
        estimator = make(X.shape[1], grouped_splits(y, robot, own), own).fit(X, y)
        test, answer = (
            np.vstack([rows[k] for k in pair]),
            np.repeat([1, 0], [len(rows[k]) for k in pair]),
        )
        auc = float(roc_auc_score(answer, score(estimator, test)))
        seconds = time.process_time() - started
        lost = {}
        for name, columns in groups.items():
            shuffled = test.copy()
            shuffled[:, columns] = test[rng.permutation(len(test))][:, columns]
            lost[name] = auc - float(roc_auc_score(answer, score(estimator, shuffled)))
        return auc, seconds, lost


def grouped_splits(y: ArrayLike, groups: ArrayLike, seed: int) -> Splits:
    """Divide rows into folds that keep the rows of a robot together and contain both classes.

    Args:
        y: Class of each row, 0 or 1. Shape (rows,).
        groups: Robot of each row. Shape (rows,).
        seed: Seed of the order in which robots are assigned to folds.

    Returns:
        Indices of the training and validation rows of three folds, or of two if a class has only
        two robots. Shape (rows of the fold,) each.

    Raises:
        ValueError: A class has fewer than two robots.
    """
    y, groups = np.asarray(y), np.asarray(groups)
    fewest = min(len(np.unique(groups[y == label])) for label in (0, 1))
    if fewest < 2:
        raise ValueError("tuning needs two failing and two normal robots")
    folds = StratifiedGroupKFold(min(_FOLDS, fewest), shuffle=True, random_state=seed)
    return list(folds.split(y[:, None], y, groups))


def score(estimator: Any, X: ArrayLike) -> Floats:
    """Compute how much each row looks like one of a failing robot.

    Args:
        estimator: A fitted classifier.
        X: Rows. Shape (rows, columns).

    Returns:
        Decision function of the classifier or, if it has none, probability of failing. Shape
        (rows,).
    """
    if hasattr(estimator, "decision_function"):
        return estimator.decision_function(X)
    return estimator.predict_proba(X)[:, 1]

"""Classifiers and leave-pair-out, against plain loops and robots that can and cannot be told."""

from functools import partial

import numpy as np
import pytest
from faultgen.analysis.classification import (
    CLASSIFIERS,
    grouped_splits,
    leave_pair_out,
    make_classifier,
)
from faultgen.analysis.preprocessing import Combination
from sklearn.base import BaseEstimator
from sklearn.linear_model import LogisticRegression
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

FAILED = np.array([True, False, True, False, False, True, False])


def robots(shift, seed=0, columns=4):
    """Five rows a robot; the first column of failing ones is shifted."""
    rng = np.random.default_rng(seed)
    rows = [rng.standard_normal((5, columns)) for _ in FAILED]
    for own, fails in zip(rows, FAILED, strict=True):
        own[:, 0] += shift * fails
    return rows


class Witness(BaseEstimator):
    """Remembers nothing but the robots that it was trained on, told by the last column."""

    # ruff: noqa: D102

    def __init__(self, splits):
        self.splits = splits

    def fit(self, X, y):
        self.seen_ = set(X[:, -1].astype(int))
        assert len(self.seen_) == len(FAILED) - 2
        assert all(y[X[:, -1] == robot].var() == 0 for robot in self.seen_)
        for train, held_out in self.splits:
            assert not set(X[train, -1]) & set(X[held_out, -1])
            assert len(set(y[train])) == len(set(y[held_out])) == 2
        return self

    def decision_function(self, X):
        assert not self.seen_ & set(X[:, -1].astype(int))
        return X[:, 0]


def test_nothing_of_the_tested_pair_is_trained_on():
    """Neither in training nor in tuning; and folds keep robots together."""
    rows = [np.column_stack([np.full((5, 1), k % 3), np.full(5, k)]) for k in range(len(FAILED))]
    found = leave_pair_out(rows, FAILED, lambda columns, splits, seed: Witness(splits))
    # Robots 0, 2, 5 fail; their first columns are 0, 2, 2, those of the others 1, 0, 1, 0.
    assert found.auc.tolist() == [[0, 0.5, 0, 0.5], [1, 1, 1, 1], [1, 1, 1, 1]]


def test_the_stack_combines_two_classifiers():
    """A logistic regression of LR and SVM, as in thesis figure 5-3; the forest is no part of it."""
    x, y = np.vstack(robots(1.0)), np.repeat(FAILED, 5)
    of_robot = np.repeat(np.arange(len(FAILED)), 5)
    folds = grouped_splits(y, of_robot, 0)
    stack = make_classifier("ES", Combination.of("control"), x.shape[1], folds, 0).fit(x, y).stack_
    assert list(stack.named_estimators_) == ["LR", "SVM"]
    assert isinstance(stack.final_estimator_, LogisticRegression)


def test_auc_is_that_of_a_plain_loop():
    """Each pair's area, by counting ordered pairs of rows."""
    rows = robots(1.0)
    found = leave_pair_out(rows, FAILED, partial(make_classifier, "LR", Combination.of("control")))
    for a, i in enumerate(np.flatnonzero(FAILED)):
        for b, j in enumerate(np.flatnonzero(~FAILED)):
            kept = [k for k in range(len(rows)) if k not in (i, j)]
            model = make_pipeline(StandardScaler(), LogisticRegression())
            model.fit(np.vstack([rows[k] for k in kept]), np.repeat(FAILED[kept], 5))
            bad, good = (model.predict_proba(rows[k])[:, 1] for k in (i, j))
            assert found.auc[a, b] == pytest.approx(np.mean(bad[:, None] > good[None, :]))


@pytest.mark.parametrize("name", CLASSIFIERS)
def test_classifiers_learn_what_is_there(name):
    """Failing robots that differ clearly are told, also through components of windows."""
    make = partial(make_classifier, name, Combination.of("+diff+var3+pca"))
    assert leave_pair_out(robots(8.0, columns=6), FAILED, make).auc.mean() > 0.9


def test_classifiers_learn_no_more_than_is_there():
    """Failing robots that do not differ are told as by chance."""
    make = partial(make_classifier, "LR", Combination.of("control"))
    chance = [leave_pair_out(robots(0.0, seed), FAILED, make).auc.mean() for seed in range(10)]
    assert 0.4 < np.mean(chance) < 0.6


@pytest.mark.slow
def test_classifiers_bend_where_they_should():
    """Robots that differ in their spread only are told by SVM and RF, not by LR."""
    rng = np.random.default_rng(3)
    rows = [rng.standard_normal((12, 2)) * (6.0 if fails else 0.5) for fails in FAILED]
    mean = {
        name: leave_pair_out(
            rows, FAILED, partial(make_classifier, name, Combination.of("control"))
        ).auc.mean()
        for name in CLASSIFIERS
    }
    assert mean["LR"] < 0.75 < 0.9 < min(mean["SVM"], mean["RF"], mean["ES"])


@pytest.mark.slow
def test_workers_do_not_change_results():
    """The same to the last digit, importance included; another seed is another forest."""
    make = partial(make_classifier, "RF", Combination.of("control"))
    rows = robots(3.0)[:6]
    groups = {"first": np.array([0]), "others": np.array([1, 2, 3])}
    one, two = (
        leave_pair_out(rows, FAILED[:6], make, seed=5, workers=n, groups=groups) for n in (1, 2)
    )
    assert np.array_equal(one.auc, two.auc)
    assert one.importance == two.importance
    assert one.importance["first"] > 0.3 > 0.1 > abs(one.importance["others"])
    assert (
        one.importance != leave_pair_out(rows, FAILED[:6], make, seed=6, groups=groups).importance
    )


def test_bad_input_is_told():
    """Too few robots, rows that do not fit, a name that is none."""
    rows = robots(1.0)
    make = partial(make_classifier, "LR", Combination.of("control"))
    with pytest.raises(ValueError, match="three failing and three normal"):
        leave_pair_out(rows[:5], FAILED[:5], make)
    with pytest.raises(ValueError, match="of the same columns"):
        leave_pair_out([*rows[:-1], rows[-1][:, :3]], FAILED, make)
    with pytest.raises(ValueError, match="choose LR, SVM, RF, ES"):
        make_classifier("NN", Combination.of("control"), 3, [], 0)
    with pytest.raises(ValueError, match="two failing and two normal"):
        grouped_splits([0, 0, 1], [1, 2, 3], 0)

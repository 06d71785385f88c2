"""Which features a detector is trained on."""

import itertools

import numpy as np
import pytest

from faultgen.twin import train as module
from faultgen.twin.alignment import KnownMotion
from faultgen.twin.classes import Belief
from faultgen.twin.features import KINDS
from faultgen.twin.train import Examples, learn


@pytest.fixture(scope="module")
def examples():
    """A motion of one axis, and cycles of a healthy robot and of one whose torque grows."""
    rng = np.random.default_rng(0)
    samples = 80
    path = np.sin(np.linspace(0, 2 * np.pi, samples))[:, None]
    motion = KnownMotion(path, ((0, samples),), 0.01, np.ones(1))
    fault = np.repeat([-1, 0], 40)
    severity = np.where(fault < 0, 0.0, np.tile(np.linspace(0, 1, 40), 2))
    torque = (1 + severity)[:, None] * np.sign(np.gradient(path[:, 0]))
    torque = torque + 0.1 * rng.standard_normal(torque.shape)
    held_out = np.arange(80) % 4 == 0
    return Examples(torque[..., None], fault, severity, held_out), motion


@pytest.mark.parametrize(
    ("scores", "chosen"),
    [
        ((-0.40, -0.20, -0.11, -0.90), 0),  # about as good as the best one
        ((-0.42, -0.41, -0.11, -0.10), 2),
        ((-0.10, -0.90, -0.90, -0.39), 0),
        ((-0.90, -0.41, -0.35, -0.10), 2),
        ((-0.90, -0.90, -0.90, -0.10), 3),
    ],
)
def test_most_features_among_those_about_as_good_as_the_best(examples, scores, chosen, monkeypatch):
    """About as good: the mean log-probability of the truth is at most 0.3 lower.

    The candidates are ordered by their number of features. All results are told.
    """
    judged = itertools.count()
    cycles = len(examples[0].part(held_out=True))

    def told(*_):
        """Give each held-out cycle the same probability of the truth, kind by kind."""
        probability = np.exp(scores[next(judged) // cycles])
        return Belief(
            healthy=probability,
            faults=np.array([probability]),
            severity=np.array([0.5]),
            interval=np.array([[0.0, 1.0]]),
            gain=0.0,
            explained=0.0,
        )

    monkeypatch.setattr(module, "believe", told)
    found = learn(*examples, 1, np.zeros((0, 80, 1)), 0, 0.01, seed=0)
    assert found.kind == list(KINDS)[chosen]
    assert [one["log_probability"] for one in found.candidates] == pytest.approx(list(scores))
    assert found.classes.whitener.shape[0] == (60, 20, 4, 1)[chosen]


def test_a_fault_that_shows_is_recognised_in_cycles_that_were_held_out(examples):
    """With all kinds of features, and its severity is found to within a tenth of the largest."""
    found = learn(*examples, 1, np.zeros((0, 80, 1)), 0, 0.01, seed=0)
    assert [one["features"] for one in found.candidates] == list(KINDS)
    for one in found.candidates:
        assert -0.1 < one["log_probability"] <= 0
        assert one["severity_error"] < 0.1

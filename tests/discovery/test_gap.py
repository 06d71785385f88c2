"""The error on the scoring motions."""

import numpy as np
import pytest
from linear import COUNT, written_down

from faultgen.discovery.fit.gap import gap, scored
from faultgen.errors import InputError


def test_scored_samples_are_those_of_the_last_motion():
    """As far as they are used."""
    nothing = np.zeros((COUNT, 2))
    problem = written_down([], np.zeros((0, COUNT, 2)), nothing)
    problem.inside[550:, 1] = False
    mask = scored(problem)
    assert np.flatnonzero(mask[:, 0]).tolist() == list(range(500, 600))
    assert np.flatnonzero(mask[:, 1]).tolist() == list(range(500, 550))


def test_the_gap_is_relative_to_the_torque_of_each_axis():
    """Root mean squares; of all axes that have torque, the root mean square of theirs.

    The torque is that of the whole recording: an axis may rest where it is scored.
    """
    rng = np.random.default_rng(2)
    error = rng.normal(size=(COUNT, 3)) * [1.0, 3.0, 2.0]
    problem = written_down([], np.zeros((0, COUNT, 3)), error)
    problem.recording.torque[:, 1] = 5 * rng.normal(size=COUNT)
    problem.recording.torque[:, 2] = 0
    for inside in (None, rng.random((COUNT, 3)) < 0.5):
        mask = scored(problem) if inside is None else inside
        expected = [
            np.sqrt(np.mean(error[mask[:, k], k] ** 2))
            / np.sqrt(np.mean(problem.recording.torque[:, k] ** 2))
            for k in (0, 1)
        ]
        whole, by_axis = gap(problem, error, inside)
        assert by_axis == pytest.approx([*expected, 0.0])
        assert whole == pytest.approx(np.sqrt(np.mean(np.square(expected))))
    with pytest.raises(InputError, match="no sample can be used"):
        gap(problem, error, np.zeros((COUNT, 3), bool))

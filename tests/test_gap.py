"""The error of a set on the scoring motions, and what calibration makes of the rest."""

from dataclasses import replace

import numpy as np
import pytest
from linear import COUNT, PARTS, least_squares, written_down

from faultgen.discovery.fit.gap import gap, scored, unexplained
from faultgen.discovery.terms.candidates import Term
from faultgen.errors import InputError

SCORED = PARTS[-1]


def moving(problem, samples):
    """The same problem whose axes stand still at all other samples."""
    speed = np.where(np.asarray(samples), 100.0, 0.0)
    position = np.repeat(np.cumsum(speed)[:, None], 2, axis=1) * 0.01
    recording = replace(problem.recording, position=position)
    replay = type(problem.replay)(**{**vars(problem.replay), "recording": recording})
    return replace(problem, replay=replay)


def test_calibration_takes_its_part_of_what_a_set_leaves():
    """Ridge regression, written out; the scoring motion is not fitted but explained."""
    rng = np.random.default_rng(1)
    columns = rng.normal(size=(3, COUNT, 2))
    residual = 2 * columns[0] + 0.3 * columns[1] + rng.normal(size=(COUNT, 2))
    widths = [0.5, 0.05, 0.02]
    names = ["torque_offset", "viscous_friction", "coulomb_friction"]
    terms = [Term(name, 1, 0.1, width) for name, width in zip(names, widths, strict=True)]
    problem = written_down(terms, columns, residual)
    left, solution = unexplained(problem, least_squares(problem, [(0,)]))
    x = columns[:, : SCORED.start].reshape(3, -1).T
    weight = np.diag([0.0, *(1 / np.array(widths[1:]) ** 2)])
    value = np.linalg.solve(x.T @ x + weight, x.T @ residual[: SCORED.start].ravel())
    assert solution[0] == 0
    np.testing.assert_allclose(solution[1:] * widths[1:], value[1:], rtol=1e-4)
    expected = residual - np.tensordot(value, columns, axes=1)
    np.testing.assert_allclose(left, expected, atol=1e-4)


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

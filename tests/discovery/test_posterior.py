"""What recordings of a healthy robot tell of its numbers."""

import json

import numpy as np
import pytest

from faultgen.discovery.decision.numbers import KINDS, Numbers
from faultgen.discovery.decision.posterior import FILE, KEY, Posterior, posterior_beside
from faultgen.errors import InputError
from faultgen.system.sums import write_listed

_WHICH = (("coulomb_friction", 1, ()), ("inertia", 2, (("parameter", 0),)), ("other", 1, ()))


@pytest.fixture
def posterior(rng):
    half = rng.normal(size=(3, 3))
    return Posterior(_WHICH, rng.normal(size=3), half @ half.T)


@pytest.fixture
def rng():
    return np.random.default_rng(7)


def test_the_prior_of_the_torque_is_that_of_posterior_and_days(posterior, rng):
    """Numbers of unit variance make torques with the covariance of columns times numbers."""
    numbers = Numbers(baseline=False)
    columns = rng.normal(size=(3, 4, 2))
    numbers.add(columns[0], 0.3, "links", _WHICH[1])
    numbers.add(columns[1], 0.5, "damping", None)
    numbers.add(columns[2], 0.2, "friction", _WHICH[0])
    made, torque = posterior.given_to(numbers)
    flat = np.array(made.columns)[[0, 2]].reshape(2, -1) * np.array(made.std)[[0, 2], None]
    days = np.array([0.3 * KINDS["links"].days, 0.2 * KINDS["friction"].days])
    wanted = posterior.covariance[np.ix_([1, 0], [1, 0])] + np.diag(days**2)
    raw = columns[[0, 2]].reshape(2, -1)
    np.testing.assert_allclose(flat.T @ flat, raw.T @ wanted @ raw, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(
        torque, posterior.mean[1] * columns[0] + posterior.mean[0] * columns[2], rtol=1e-5
    )
    np.testing.assert_allclose(made.std[::2], np.sqrt(np.diag(wanted)))
    np.testing.assert_array_equal(made.columns[1], numbers.columns[1])
    assert (made.std[1], made.kinds, made.which) == (0.5, numbers.kinds, numbers.which)


def test_it_is_kept_beside_the_model(posterior, tmp_path):
    assert posterior_beside("puma560") is None
    assert posterior_beside(tmp_path) is None
    write_listed(tmp_path, FILE, json.dumps({KEY: posterior.contract()}))
    for path in (tmp_path, tmp_path / FILE):
        read = posterior_beside(path)
        assert read.which == posterior.which
        np.testing.assert_allclose(read.mean, posterior.mean, rtol=1e-5)
        np.testing.assert_allclose(read.covariance, posterior.covariance, rtol=1e-5)
    write_listed(tmp_path, FILE, json.dumps({KEY: None}))
    assert posterior_beside(tmp_path) is None


@pytest.mark.parametrize("entry", [{}, {"numbers": [], "mean": [1.0], "covariance": []}, 3])
def test_a_damaged_entry_is_one_line(entry, tmp_path):
    (tmp_path / FILE).write_text(json.dumps({KEY: entry}))
    with pytest.raises(InputError, match="run calibrate again"):
        posterior_beside(tmp_path)

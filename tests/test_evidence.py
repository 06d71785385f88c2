"""Linear algebra of naming, against brute force."""

import numpy as np
import pytest

from faultgen.discovery.fit.evidence import FREE, Evidence

PARTS = [slice(0, 40), slice(40, 100), slice(100, 160)]


@pytest.fixture(scope="module")
def data():
    rng = np.random.default_rng(0)
    columns = rng.normal(size=(7, 160, 2))
    residual = 3 * columns[2] + 0.5 * columns[5] + rng.normal(size=(160, 2))
    return columns, residual, Evidence.of(columns, residual, PARTS)


def ridge(columns, residual, weight):
    """Minimum over b of |g - X b|^2 + b' W b, written out."""
    x, y = columns.reshape(len(columns), -1).T, residual.ravel()
    value = np.linalg.solve(x.T @ x + np.diag(weight), x.T @ y)
    return value, float(np.sum((y - x @ value) ** 2) + value @ (weight * value))


def test_a_fit_is_the_minimum_of_its_misfit(data):
    columns, residual, evidence = data
    weight = np.ones(7)
    weight[[2, 4]] = FREE
    expected, least = ridge(columns, residual, weight)
    value, inverse, misfit = evidence.solve(free=[2, 4])
    np.testing.assert_allclose(value, expected, rtol=1e-9)
    assert misfit == pytest.approx(least, rel=1e-9)
    x = columns.reshape(7, -1).T
    np.testing.assert_allclose(inverse, np.linalg.inv(x.T @ x + np.diag(weight)), rtol=1e-9)


def test_what_is_held_stays_zero(data):
    _, _, evidence = data
    value, _, _ = evidence.solve(held=[2])
    assert abs(value[2]) < 1e-6 and abs(value[5]) > 0.1


def test_gains_are_those_of_fits(data):
    """Freeing a group takes off the misfit what two fits differ by."""
    _, _, evidence = data
    groups = [(2,), (5,), (0, 1)]
    gains, first = evidence.gains(groups, free=[6])
    _, _, before = evidence.solve(free=[6])
    for group, gain, value in zip(groups, gains, first, strict=True):
        solution, _, after = evidence.solve(free=[6, *group])
        assert gain == pytest.approx(before - after, rel=1e-2, abs=1e-3)
        assert value == pytest.approx(solution[group[0]], rel=1e-2)


def test_what_no_sample_shows_gains_nothing(data):
    """A term whose column is 0 may have any value; the other terms do not notice it."""
    columns, residual, evidence = data
    dumb = np.concatenate([columns, np.zeros_like(columns[:1])])
    with_dumb = Evidence.of(dumb, residual, PARTS)
    gains, first = with_dumb.gains([(2,), (7,), (2, 7)], free=[5])
    expected, at = evidence.gains([(2,)], free=[5])
    np.testing.assert_allclose(gains, [expected[0], 0.0, expected[0]], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(first, [at[0], 0.0, at[0]], rtol=1e-6, atol=1e-9)


def test_a_free_term_may_be_far_off(data):
    """Thousands of its prior_std, as differences of twins are: not drawn towards zero."""
    columns, _, _ = data
    residual = 5000 * columns[3]
    value, _, misfit = Evidence.of(columns, residual, PARTS).solve(free=[3])
    assert value[3] == pytest.approx(5000, rel=1e-6)
    assert misfit < 1


def test_columns_and_gaps_are_replaced(data):
    """As if all products had been computed anew."""
    columns, residual, evidence = data
    other, moved = columns.copy(), residual + columns[1]
    new = {2: columns[0] - columns[2], 4: 2 * columns[3]}
    for term, column in new.items():
        other[term] = column
    made = evidence.against(columns, moved, PARTS).replaced(new, columns, moved, PARTS)
    expected = Evidence.of(other, moved, PARTS)
    for name in ("gram", "right", "energy"):
        np.testing.assert_allclose(getattr(made, name), getattr(expected, name), atol=1e-9)


def test_recordings_without_noise_are_solved():
    """Two columns of one shape, 1e20 times the prior: rounding leaves nothing of the priors."""
    column = np.random.default_rng(3).standard_normal((200, 2))
    columns = np.stack([column, 2 * column, column[::-1]]).astype(np.float32) * np.float32(1e10)
    gap = 3e10 * column
    evidence = Evidence.of(columns, gap, [slice(0, 100), slice(100, 200)])
    value, _, misfit = evidence.solve()
    assert value[0] + 2 * value[1] == pytest.approx(3, rel=1e-3)
    assert value[2] == pytest.approx(0, abs=1e-3)
    assert misfit < 1e-3 * np.sum(gap**2)


def test_a_part_is_predicted_from_the_others(data):
    columns, residual, evidence = data
    errors = evidence.held_out(free=[2])
    weight = np.ones(7)
    weight[2] = FREE
    others = np.r_[0:40, 100:160]
    value, _ = ridge(columns[:, others], residual[others], weight)
    left = residual[PARTS[1]] - np.tensordot(value, columns[:, PARTS[1]], axes=1)
    assert errors[1] == pytest.approx(np.sum(left**2), rel=1e-9)

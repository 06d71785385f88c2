import numpy as np
import pytest

from faultgen.dataset.wear import SCHEDULES, severities
from faultgen.errors import InputError


@pytest.mark.parametrize("schedule", SCHEDULES)
def test_schedules_end_at_the_final_severity_and_never_fall(schedule):
    """Every schedule reaches exactly what was asked for and grows monotonically from >= 0."""
    s = severities(schedule, 0.2, 100)
    assert s.shape == (100,)
    assert s[-1] == pytest.approx(0.2, rel=1e-12)
    assert s[0] >= 0
    assert (np.diff(s) >= 0).all()


def test_exponential_is_equation_6_6():
    """1 + s = exp(c k^4); 10 % is passed in cycle 86, as thesis 6.4 has it."""
    s = severities("exponential", 0.2, 100)
    k = np.arange(1, 101)
    np.testing.assert_allclose(np.log1p(s) / k**4, np.log(1.2) / 100**4, rtol=1e-12)
    assert np.flatnonzero(s >= 0.10)[0] + 1 == 86


def test_sigmoid_is_equation_3_7():
    """S = c1 / (1 + exp(-(c2 k)^4)) - c1 / 2, with some c1 and c2 for all k."""
    s = severities("sigmoid", 0.1, 120)
    plateau = 0.1 / 0.99
    x = 2 * np.arctanh(s / plateau)  # (c2 k)^4
    np.testing.assert_allclose(x / np.arange(1, 121) ** 4, x[-1] / 120**4, rtol=1e-9)
    c1, exponent = 2 * plateau, x
    np.testing.assert_allclose(c1 / (1 + np.exp(-exponent)) - c1 / 2, s, atol=1e-15)


def test_severity_zero_is_no_wear():
    """A final severity of 0 is 0 in every cycle, whatever the schedule."""
    for schedule in SCHEDULES:
        np.testing.assert_array_equal(severities(schedule, 0.0, 7), np.zeros(7))


def test_arrays_are_taken_as_they_are():
    """An array gives the severity of each cycle; one of another length is refused."""
    np.testing.assert_array_equal(severities([0, 0.3, 0.1], 9.9, 3), [0, 0.3, 0.1])
    with pytest.raises(InputError, match="schedule has 3 severities, but cycles = 4"):
        severities([0, 0.3, 0.1], 0.1, 4)


def test_unknown_schedules_are_refused_with_the_choices():
    """The message names the schedules that there are."""
    with pytest.raises(InputError, match="unknown schedule 'cubic': choose exponential, sigmoid"):
        severities("cubic", 0.1, 4)


@pytest.mark.parametrize("cycles", [1, 5, 6])
def test_a_step_comes_after_the_first_half(cycles):
    """The first half of the cycles, rounded down, is healthy; the rest has the whole severity."""
    healthy = cycles // 2
    expected = [0.0] * healthy + [0.3] * (cycles - healthy)
    np.testing.assert_array_equal(severities("step", 0.3, cycles), expected)

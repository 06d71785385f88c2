import numpy as np
import pytest

from faultgen.monitoring.reductions import Limits, histogram, mean_abs_torque, monitor

LIMITS = Limits(
    torque=np.array([6.0]),
    speed=np.array([120.0]),
    angle=np.array([[-1.2, 1.2]]),
    gear_ratio=np.array([-10.0]),
)


def column(*values):
    return np.array(values, float)[:, None]


def test_only_samples_within_the_speed_window_count():
    """Mean |torque| over 50 to 120 rad/s, both ends and both directions."""
    speed = column(49.9, 50, -120, 120.1, 0)
    torque = column(9, -1, 3, 9, 9)
    assert mean_abs_torque(speed, torque)[0] == 2


def test_no_sample_in_the_window_is_nan():
    """An axis that never turns so fast has no value."""
    assert np.isnan(mean_abs_torque(column(1, 2), column(1, 1))[0])


def test_histograms_are_shares_of_time():
    """12 equal bins over the design range; values beyond it are kept in the end bins."""
    torque = column(-99, -6, -5.01, 0, 0.5, 5.99, 6, 99)
    shares = monitor(column(*[0] * 8), column(*[0] * 8), torque, LIMITS)["torque_histogram"][0]
    np.testing.assert_allclose(shares * 8, [3, 0, 0, 0, 0, 0, 2, 0, 0, 0, 0, 3])


def test_angles_are_joint_side():
    """A motor at -10 x 1.15 rad stands for a joint at 1.15 rad: the last bin."""
    shares = monitor(column(-11.5), column(0), column(0), LIMITS)["angle_histogram"][0]
    assert shares[-1] == 1
    shares = monitor(column(-5), column(0), column(0), LIMITS)["angle_histogram"][0]
    assert shares[8] == 1  # 0.5 rad of -1.2 to 1.2 rad


def test_indicators():
    """Constant speed and torque give themselves; time at rest does not load a gearbox."""
    seen = monitor(column(0, 0), column(60, 60), column(-2, 2), LIMITS)
    assert seen["speed_indicator"][0] == 60
    assert seen["torque_indicator"][0] == pytest.approx(2)
    resting = monitor(column(0, 0), column(60, 0), column(2, 5), LIMITS)
    assert resting["speed_indicator"][0] == 30
    assert resting["torque_indicator"][0] == pytest.approx(2)
    still = monitor(column(0), column(0), column(5), LIMITS)
    assert still["torque_indicator"][0] == 0


def test_torque_indicator_is_the_rating_life_mean():
    """Weighted by speed, exponent 10/3, by hand."""
    seen = monitor(column(0, 0), column(10, -30), column(1, 2), LIMITS)
    expected = ((10 * 1 + 30 * 2 ** (10 / 3)) / 40) ** 0.3
    assert seen["torque_indicator"][0] == pytest.approx(expected)


def test_one_sample_in_the_window_is_enough():
    """The mean of a single sample is that sample."""
    assert mean_abs_torque(column(10, 60, 130), column(1, -2.5, 4))[0] == 2.5


def test_every_axis_has_all_its_bins():
    """Bins beyond the highest value are there, on the last axis too."""
    values = np.array([[0.0, 0.0], [0.3, 0.01]])
    shares = histogram(values, np.array([-1.0, 0.0]), np.array([1.0, 1.0]))
    assert shares.shape == (2, 12)
    np.testing.assert_array_equal(shares[1], [1.0] + [0.0] * 11)
    np.testing.assert_array_equal(np.flatnonzero(shares[0]), [6, 7])

"""Smoothing of measured positions."""

import numpy as np
import pytest

from faultgen.recordings.smoothing import is_rough, noise_of_position, smoothed

TIMES = np.arange(4000) * 0.004
TRUE = np.sin(2 * TIMES) + 0.3 * np.cos(5 * TIMES)


@pytest.mark.parametrize("noise", [1e-6, 1e-5, 1e-4])
def test_noise_is_taken_away_and_motion_is_kept(noise):
    measured = TRUE + noise * np.random.default_rng(2).normal(size=TRUE.shape)
    assert noise_of_position(measured) == pytest.approx(noise, rel=0.1)
    error = (smoothed(measured) - TRUE)[20:-20]
    assert np.sqrt(np.mean(error**2)) < 0.4 * noise
    for found, true in zip((smoothed(measured), measured), (0.03, np.inf), strict=True):
        acceleration = np.gradient(np.gradient(found, 0.004), 0.004)[50:-50]
        right = (-4 * np.sin(2 * TIMES) - 7.5 * np.cos(5 * TIMES))[50:-50]
        assert np.sqrt(np.mean((acceleration - right) ** 2)) < true * np.std(right)


def test_nothing_is_changed_without_noise():
    np.testing.assert_allclose(smoothed(TRUE), TRUE, atol=1e-8)
    still = np.full(100, 0.7)
    np.testing.assert_array_equal(smoothed(still), still)
    np.testing.assert_array_equal(smoothed(still[:5]), still[:5])


def test_an_encoder_that_counts_is_smoothed():
    counted = np.round(TRUE / 1e-4) * 1e-4
    error = smoothed(counted) - TRUE
    assert np.sqrt(np.mean(error**2)) < 0.6 * 1e-4 / np.sqrt(12)


def test_a_command_that_was_logged_at_uneven_times_is_rough():
    """Its accelerations are noise then; those of a command written with 7 digits are not."""
    late = np.random.default_rng(4).normal(size=TIMES.shape)
    uneven = np.interp(TIMES + 0.1 * 0.004 * late, TIMES, TRUE)
    assert is_rough(uneven, 0.004)
    assert not is_rough(TRUE, 0.004) and not is_rough(TRUE.astype(np.float32), 0.004)
    error = np.diff(smoothed(uneven) - TRUE, 2)[50:-50] / 0.004**2
    assert np.std(error) < 0.1 * np.std(np.diff(TRUE, 2) / 0.004**2)
    assert not is_rough(np.zeros(100), 0.004) and not is_rough(TRUE[:5], 0.004)

"""Smoothing of measured positions."""

import numpy as np
import pytest

from faultgen.recordings.smoothing import (
    is_rough,
    noise_of_position,
    required,
    smoothed,
    smoothed_with,
)

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


def test_noise_requires_a_penalty_with_which_the_rest_is_as_large():
    """More for more noise; none without noise."""
    assert required(TRUE[:10]) is None and required(np.full(100, 0.7)) is None
    rng, known = np.random.default_rng(5), []
    for noise in (1e-5, 1e-4, 1e-3):
        measured = TRUE + noise * rng.normal(size=TRUE.shape)
        penalty = required(measured)
        left = measured - smoothed_with(measured, penalty)
        assert np.std(left) == pytest.approx(noise_of_position(measured), rel=0.02)
        np.testing.assert_array_equal(smoothed_with(measured, penalty), smoothed(measured))
        known.append(penalty)
    assert known[0] < known[1] < known[2]


@pytest.mark.parametrize("rate", [2.0, 10.0, 60.0])
def test_smoothing_with_a_penalty_is_a_low_pass_filter(rate):
    """Of a sine of w rad a sample, 1 / (1 + p (2 sin(w/2))^6) remains (Whittaker 1923)."""
    exponent = 4.0
    wave = np.sin(rate * TIMES)
    share = 1 / (1 + 10.0**exponent * (2 * np.sin(rate * 0.004 / 2)) ** 6)
    inner = slice(500, -500)
    np.testing.assert_allclose(smoothed_with(wave, exponent)[inner], share * wave[inner], atol=1e-4)


def test_smoothing_with_a_penalty_is_linear_and_keeps_parabolas():
    two = np.stack([TRUE, TIMES**2], axis=1)
    both = smoothed_with(two, 6.0)
    np.testing.assert_allclose(both[:, 1], TIMES**2, atol=1e-6)
    np.testing.assert_allclose(both[:, 0], smoothed_with(TRUE, 6.0), atol=1e-12)
    np.testing.assert_allclose(smoothed_with(2 * TRUE, 6.0), 2 * both[:, 0], atol=1e-10)

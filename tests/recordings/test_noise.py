import numpy as np
import pytest
from scipy.signal import lfilter

from faultgen.recordings.noise import autoregression, is_same_noise, shared_noise


def coloured(rng, n, memory, deviation):
    kicks = rng.standard_normal(n) * deviation * np.sqrt(1 - memory**2)
    return lfilter([1.0], [1.0, -memory], kicks)


def test_too_little_to_tell():
    residual = np.zeros((100, 2))
    inside = np.ones_like(residual, bool)
    inside[20:, 1] = False
    with pytest.raises(ValueError, match="axis 2: fewer than 50 samples"):
        autoregression(residual, inside, [slice(0, 100)])


def test_a_short_part_is_left_out():
    """A part may have five samples, fewer than the order of the autoregression."""
    residual = np.random.default_rng(2).standard_normal((400, 2))
    parts = [slice(0, 200), slice(200, 205), slice(205, 400)]
    noise = autoregression(residual, np.ones_like(residual, bool), parts)
    white = noise.whiten(residual, parts)
    assert (white[200:205] == 0).all()
    np.testing.assert_array_equal(white[205:], noise.whiten(residual[205:], [slice(0, 195)]))
    own = noise.of_axis(2).whiten(residual[:, 1:], parts)
    np.testing.assert_array_equal(own, white[:, 1:])


@pytest.fixture(scope="module")
def motion():
    """Torque of a motion, the same in both recordings: slow, with ripple and friction's jumps."""
    time = np.arange(6000) * 0.004
    turn = 40 * np.sin(0.7 * time)
    torque = np.sin(0.7 * time) + 0.1 * np.sin(turn) + 0.3 * np.sign(np.cos(0.7 * time))
    return np.stack([torque, 2 * torque], axis=1)


@pytest.mark.parametrize("memory", [0.0, 0.8])
@pytest.mark.parametrize("size", [1e-2, 0.3])
def test_noise_of_two_recordings_is_their_own_or_shared(motion, memory, size):
    """On any axis by itself; an effect in one of them does not hide it."""
    rng = np.random.default_rng(4)
    parts = [slice(0, 2500), slice(2500, 6000)]
    noises = [
        np.stack([coloured(rng, 6000, memory, size * (k + 1)) for k in range(2)], axis=1)
        for _ in range(2)
    ]
    worn = 1.05 * motion + noises[0]
    assert not shared_noise(worn, motion + noises[1], parts).any()
    assert shared_noise(worn, motion + noises[0], parts).all()
    mixed = np.stack([noises[0][:, 0], noises[1][:, 1]], axis=1)
    assert shared_noise(worn, motion + mixed, parts).tolist() == [True, False]
    assert is_same_noise(worn, motion + mixed, parts).tolist() == [True, False]
    against = 1.0  # gravity, say, from the other side
    assert is_same_noise(worn - against, motion + mixed - against, parts).tolist() == [True, False]
    smooth = np.sin(np.outer(np.arange(6000) * 0.004, [0.7, 1.3]))
    assert not is_same_noise(1.05 * smooth, smooth, parts).any()  # there is none at all


def test_motions_that_are_shorter_than_the_order_show_a_lower_one():
    """As in recordings that move one axis after another."""
    residual = np.random.default_rng(0).normal(0.0, 0.2, (600, 1))
    inside = (np.arange(600) % 60 < 20)[:, None]  # 20 samples in a row
    noise = autoregression(residual, inside, [slice(0, 600)], 30)
    assert noise.coefficients.shape == (1, 30) and not noise.coefficients[:, 8:].any()
    assert noise.innovation[0] == pytest.approx(0.2, rel=0.2)

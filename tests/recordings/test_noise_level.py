"""Noise whose level differs between recordings, and grows with speed and load."""

import numpy as np
import pytest
from scipy.signal import lfilter

from faultgen.recordings.noise import Autoregression, typical
from faultgen.recordings.noise_level import Noise, level_of, levelled

COUNT = 6000
PARTS = [slice(0, 1500), slice(1500, 4000), slice(4000, COUNT)]
STEADY = np.ones((COUNT, 1), bool)


@pytest.fixture
def rng():
    return np.random.default_rng(8)


@pytest.fixture
def speed(rng):
    return np.abs(np.sin(np.arange(COUNT) / 150))[:, None]


def test_the_level_of_each_recording_is_found(rng, speed):
    """Coloured noise of three levels becomes white noise of one level."""
    true = np.repeat([1.0, 4.0, 0.5], [1500, 2500, 2000])[:, None]
    x = true * lfilter([1], [1, -0.6], rng.normal(size=(COUNT, 1)), axis=0)
    noise = levelled(x, STEADY, PARTS, [speed])
    for part, level in zip(PARTS, (1.0, 4.0, 0.5), strict=True):
        ratio = noise.of_samples()[part].mean() / (level / np.sqrt(1 - 0.36))
        assert ratio == pytest.approx(1, abs=0.06)
        assert noise.whiten(x, PARTS)[part].std() == pytest.approx(1, abs=0.06)


@pytest.mark.parametrize("share", [0.0, 3.0])
def test_the_level_grows_with_speed_only_where_it_does(rng, speed, share):
    true = np.sqrt(1 + share**2 * speed**2)
    white = true * rng.normal(size=(COUNT, 1))
    other = rng.uniform(size=(COUNT, 1))
    level = level_of(white, STEADY, PARTS, [speed, other])
    if share == 0:
        for part in PARTS:
            assert np.ptp(level[part]) == 0
    assert np.abs(level / true - 1).max() < 0.2
    assert np.abs(level / true - 1).mean() < 0.06


def test_effects_and_outliers_do_not_count_as_noise(rng, speed):
    """Rare jumps, and values that are mostly zero because they are coarse."""
    x = rng.normal(size=5000)
    assert typical(x) == pytest.approx(1, abs=0.05)
    x[::100] += 100
    assert typical(x) == pytest.approx(1, abs=0.05)
    coarse = np.round(rng.normal(size=5000) / 2.5)
    assert np.median(np.abs(coarse)) == 0
    assert typical(coarse) == pytest.approx(coarse.std(), rel=0.5)


def coloured():
    """Noise of two axes that lasts for some samples."""
    colour = Autoregression(np.array([[0.8], [0.3]]), np.array([0.6, 0.5]))
    return Noise(colour, np.ones((COUNT, 2)))


def test_plain_noise_gives_lasting_errors_their_weight():
    """White, with the information of the coloured noise about something that lasts little."""
    noise = coloured()
    plain = noise.plain()
    assert not plain.colour.coefficients.any()
    longer = noise.deviation / noise.colour.innovation
    assert plain.deviation == pytest.approx(noise.deviation * longer)
    steady = np.ones((COUNT, 2))
    told, lasting = (np.mean(one.whiten(steady, PARTS)[10:1500] ** 2) for one in (noise, plain))
    assert lasting > told  # an error that does not change is no drifting noise
    np.testing.assert_allclose(plain.whiten(steady, PARTS)[100], 1 / plain.deviation)


def test_noise_is_at_least_as_large_as_simulations_are_exact():
    """On each axis; the colour and larger noise stay."""
    noise = coloured()
    found = noise.at_least(np.array([0.1, 2.0]))
    assert found.colour.innovation.tolist() == [0.6, 2.0]
    np.testing.assert_array_equal(found.colour.coefficients, noise.colour.coefficients)
    np.testing.assert_array_equal(found.level, noise.level)

"""What is to be explained: on which samples, whitened."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from linear import COUNT, PARTS, written_down

from faultgen.discovery.fit.problem import division_of
from faultgen.discovery.terms.candidates import Term
from faultgen.errors import InputError, SimulationFailed
from faultgen.recordings.noise import Autoregression
from faultgen.recordings.noise_level import Noise
from faultgen.recordings.recording import Recording

OFFSET = Term("torque_offset", 1, 0.1, 0.5)


@pytest.fixture
def rng():
    return np.random.default_rng(9)


@pytest.fixture
def coloured(rng):
    """A problem of noise with memory on the first axis, of which some samples are not used."""
    problem = written_down([OFFSET], rng.normal(size=(1, COUNT, 2)), rng.normal(size=(COUNT, 2)))
    colour = Autoregression(np.array([[0.8], [0.0]]), np.array([2.0, 0.5]))
    noise = Noise(colour, np.ones((COUNT, 2)))
    return replace(problem, noise=noise, inside=rng.random((COUNT, 2)) < 0.7)


def test_whitened_torques_are_innovations_over_their_deviation(coloured, rng):
    """Masked, and 0 at the first sample of each part, before which nothing is known."""
    x = rng.normal(size=(3, COUNT, 2))
    before = np.concatenate([np.zeros((3, 1, 2)), x[:, :-1]], axis=1)
    expected = (x - before * [0.8, 0.0]) / [2.0, 0.5]
    expected[:, [part.start for part in PARTS]] = 0
    expected *= coloured.inside
    np.testing.assert_allclose(coloured.whiten(x), expected, atol=1e-12)
    for axis in (1, 2):
        own = coloured.whiten_axis(x[..., axis - 1], axis)
        np.testing.assert_allclose(own, expected[..., axis - 1], atol=1e-12)


def test_white_noise_of_the_same_deviation(coloured, rng):
    """A sample counts for less where noise has memory."""
    deviation = np.array([2.0 / np.sqrt(1 - 0.8**2), 0.5])
    longer = deviation / [2.0, 0.5]  # root of the samples that one is worth
    x = rng.normal(size=(COUNT, 2))
    expected = x / (deviation * longer)
    expected[[part.start for part in PARTS]] = 0
    np.testing.assert_allclose(coloured.noise.plain().whiten(x, PARTS), expected, atol=1e-9)


@pytest.mark.parametrize("how", ["nan", "raises", "works"])
def test_what_cannot_be_simulated_has_no_change(coloured, how):
    def simulate(changes=(), disturbance=None):
        if how == "raises":
            raise SimulationFailed("it diverges")
        torque = np.full((COUNT, 2), 3.0)
        torque[7, 1] = np.nan if how == "nan" else 3.0
        return torque

    problem = replace(coloured, replay=SimpleNamespace(torque=simulate), base=np.ones((COUNT, 2)))
    change = problem.change([(OFFSET, 1.0)])
    if how == "works":
        np.testing.assert_array_equal(change, 2.0)
    else:
        assert change is None


# A recording of two axes that swing, faster and slower

MANY = 6000
PERIOD = 0.004


def swing():
    """Two axes that turn back and forth, the second half of each part slowly."""
    at = np.arange(MANY) * PERIOD
    slow = (np.arange(MANY) // 1000) % 2 == 1
    speed = np.where(slow, 1.5, 60.0) * np.sign(np.sin(at * 2.1))
    return np.cumsum(speed)[:, None] * PERIOD * np.ones(2)


def replayed(position):
    robot = SimpleNamespace(
        n_axes=2,
        gear_ratio=np.ones(2),
        stribeck_velocity=np.full(2, 5.0),
        set_points=np.ones(3),
    )
    recording = Recording(
        source="written down",
        robot="",
        side="motor",
        sample_period=PERIOD,
        position=position,
        torque=np.ones((MANY, 2)),
    )
    return SimpleNamespace(recording=recording, robot=robot, left_out=None)


def test_the_last_part_is_kept_for_scoring():
    """Without a baseline, samples at rest are not compared."""
    position = swing()
    position[:1500] = position[1500]
    division = division_of(replayed(position), baseline=False)
    assert not division.inside[:1500].any() and division.inside[1600:].any()
    assert (division.fitting, division.scoring) == ([0, 1, 2, 3, 4], [5])
    used = division.samples(division.fitting)
    assert used.sum() == sum(part.stop - part.start for part in division.parts[:5])


def test_nothing_can_be_scored_where_nothing_moves():
    position = swing()
    position[:] = position[4900]
    with pytest.raises(InputError, match="too little moves to keep a fifth of it for scoring"):
        division_of(replayed(position), baseline=False)

"""A residual prepared for regression: whitened, masked and weighted."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from linear import COUNT, PARTS, written_down

from faultgen.discovery.fit.regression import plain, pose
from faultgen.discovery.terms.candidates import Term
from faultgen.errors import SimulationFailed
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
    trust, inside = rng.uniform(0.3, 1, (COUNT, 2)), rng.random((COUNT, 2)) < 0.7
    return replace(problem, noise=noise, trust=trust, inside=inside)


def test_whitened_torques_are_innovations_over_their_deviation(coloured, rng):
    """Masked, weighted, and 0 at the first sample of each part, before which nothing is known."""
    x = rng.normal(size=(3, COUNT, 2))
    before = np.concatenate([np.zeros((3, 1, 2)), x[:, :-1]], axis=1)
    expected = (x - before * [0.8, 0.0]) / [2.0, 0.5]
    expected[:, [part.start for part in PARTS]] = 0
    expected *= coloured.inside * coloured.trust
    np.testing.assert_allclose(coloured.whiten(x), expected, atol=1e-12)
    for axis in (1, 2):
        own = coloured.whiten_axis(x[..., axis - 1], axis)
        np.testing.assert_allclose(own, expected[..., axis - 1], atol=1e-12)


def test_white_noise_of_the_same_deviation(coloured, rng):
    """A sample counts for less where noise has memory; every sample that is used counts fully."""
    white = plain(coloured)
    deviation = np.array([2.0 / np.sqrt(1 - 0.8**2), 0.5])
    longer = deviation / [2.0, 0.5]  # root of the samples that one is worth
    x = rng.normal(size=(COUNT, 2))
    expected = x / (deviation * longer) * coloured.inside
    expected[[part.start for part in PARTS]] = 0
    np.testing.assert_allclose(white.whiten(x), expected, atol=1e-9)
    column = white.whiten(coloured.raw.astype(float)) * OFFSET.prior_std
    np.testing.assert_allclose(white.white, column, atol=1e-5)


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


# Posed problems: one axis that swings, faster and slower

MANY = 6000
PERIOD = 0.004
STRIBECK = 5.0


def swing(speed=None):
    """Two axes that turn back and forth, the second half of each part slowly."""
    at = np.arange(MANY) * PERIOD
    if speed is None:
        slow = (np.arange(MANY) // 1000) % 2 == 1
        speed = np.where(slow, 1.5, 60.0) * np.sign(np.sin(at * 2.1))
    position = np.cumsum(speed)[:, None] * PERIOD * np.ones(2)
    robot = SimpleNamespace(
        n_axes=2,
        gear_ratio=np.ones(2),
        stribeck_velocity=np.full(2, STRIBECK),
        set_points=np.ones(3),
    )
    return robot, position, speed


def given(residual, columns, base, *, baseline=True, position=None, torque=None):
    """The problem of a residual, posed."""
    robot, way, _ = swing()
    recording = Recording(
        source="written down",
        robot="",
        side="motor",
        sample_period=PERIOD,
        position=way if position is None else position,
        torque=base + residual if torque is None else torque,
    )
    replay = SimpleNamespace(recording=recording, robot=robot, torque=None, left_out=None)
    terms = [OFFSET, Term("viscous_friction", 1, 0.1, 0.05)][: len(columns)]
    return pose(replay, terms, base, np.asarray(columns, np.float32), residual, baseline=baseline)


@pytest.fixture
def smooth(rng):
    """Torque of a model, and of a term."""
    at = np.arange(MANY)[:, None] * PERIOD
    base = 20 * np.sin(at * 2.1 + [0.0, 1.0]) + 4 * np.sin(at * 13)
    column = np.sin(at * 5.3 + [0.3, 0.8])
    return base, column


def test_noise_is_what_no_term_explains(rng, smooth):
    """Neither an effect nor what happens at samples that are not used, as at rest."""
    base, column = smooth
    robot, position, _ = swing()
    position[:1500] = position[1500]  # at rest
    noise = np.array([0.3, 0.05]) * rng.normal(size=(MANY, 2))
    residual = noise + 4 * column
    residual[:1500] += 100 * rng.normal(size=(1500, 2))
    problem = given(residual, [column], base, position=position)
    assert not problem.inside[:1500].any()
    assert problem.noise.deviation == pytest.approx([0.3, 0.05], rel=0.06)
    white = problem.whiten(noise)[problem.inside & (problem.trust == 1)]
    assert white.std() == pytest.approx(1.0, abs=0.06)
    assert (problem.fitting, problem.scoring) == ([0, 1, 2, 3, 4], [5])
    expected = problem.noise.whiten(problem.raw, problem.parts) * OFFSET.prior_std
    expected *= problem.inside * problem.trust
    np.testing.assert_allclose(problem.white, expected, atol=1e-5)


def test_noise_is_no_smaller_than_simulations_are_exact(smooth):
    """A hundred-thousandth of the root mean square of the torque."""
    base, column = smooth
    nothing = np.zeros_like(base)
    problem = given(nothing, [column], base)
    least = 1e-5 * np.sqrt(np.mean(base**2, axis=0))
    assert problem.noise.deviation == pytest.approx(least, rel=0.05)


def test_slow_motion_is_trusted_less_where_more_is_left_there(rng, smooth):
    """By as much as the errors there are larger than the noise."""
    base, column = smooth
    _, _, speed = swing()
    slow = np.abs(speed) < 3 * STRIBECK
    residual = 0.1 * rng.normal(size=(MANY, 2))
    residual[slow, 0] *= 4
    problem = given(residual, [column], base)
    inner = slow & problem.inside[:, 0]
    assert np.median(problem.trust[inner, 0]) == pytest.approx(1 / 4, rel=0.15)
    assert np.median(problem.trust[~slow, 0]) == 1
    assert np.median(problem.trust[inner, 1]) == pytest.approx(1.0, abs=0.1)
    assert (problem.trust <= 1).all()


def test_what_known_effects_explain_is_no_noise(rng, smooth):
    """Strokes that no sum of columns explains count as noise until their effect is known."""
    base, column = smooth
    noise = np.array([0.3, 0.05]) * rng.normal(size=(MANY, 2))
    strokes = np.where(rng.random((MANY, 2)) < 0.3, 2.0, 0.0) * rng.normal(size=(MANY, 2))
    before = given(noise + strokes, [column], base, baseline=False)
    after = pose(
        before.replay,
        before.terms,
        base,
        before.raw,
        before.residual,
        baseline=False,
        explained=strokes,
    )
    assert after.noise.deviation == pytest.approx([0.3, 0.05], rel=0.06)
    assert (before.noise.deviation > 1.3 * after.noise.deviation).all()
    np.testing.assert_array_equal(after.residual, before.residual)


@pytest.mark.parametrize("rough", [False, True])
def test_noise_that_two_recordings_share_is_that_of_one_of_them_twice(rng, smooth, rough):
    """As if each had its own: the root of 2 times what the model does not foretell.

    Where the samples before foretell the torque better than a rough model does, the noise is what
    they do not foretell.
    """
    base, column = smooth
    shared = np.array([0.3, 0.2]) * rng.normal(size=(MANY, 2))
    wrong = 5 * rng.normal(size=(MANY, 2)) if rough else 0.0
    residual = 1e-3 * rng.normal(size=(MANY, 2)) + 0.5 * column
    healthy = base + shared
    model = base + wrong
    problem = given(residual, [column], model, torque=healthy + residual)
    assert problem.shared.all()
    expected = np.sqrt(2) * np.array([0.3, 0.2])
    ratio = problem.noise.deviation / expected
    if rough:
        assert (ratio > 0.95).all() and (ratio < 2.5).all()
        np.testing.assert_array_equal(problem.noise.colour.coefficients, 0.0)
    else:
        assert ratio == pytest.approx([1.0, 1.0], abs=0.06)


def test_nothing_can_be_scored_where_nothing_moves(rng, smooth):
    base, column = smooth
    robot, position, _ = swing()
    position[:] = position[4900]
    residual = rng.normal(size=(MANY, 2))
    with pytest.raises(ValueError, match="too little moves to keep a fifth of it for scoring"):
        given(residual, [column], base, position=position, baseline=False)

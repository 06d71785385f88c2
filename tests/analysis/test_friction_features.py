"""FrictionFeatures against planted friction and NumPy's least squares."""

import numpy as np
import pytest
from faultgen.analysis.friction_features import FrictionFeatures
from sklearn.base import clone
from sklearn.exceptions import NotFittedError

STRIBECK = np.array([4.0, 10.0, 7.0])


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def motion(rng, samples=400):
    """Speed and load of three axes that turn both ways. Shape (samples, 3)."""
    t = np.linspace(0, 2 * np.pi, samples)[:, None]
    phase = rng.uniform(0, 2 * np.pi, size=(2, 3))
    speed = 8 * STRIBECK * (np.sin(2 * t + phase[0]) + 0.5 * np.sin(3 * t + phase[1]))
    return speed, np.cos(t + phase[1]) + np.cos(5 * t)


def terms(speed, load=None, widths=(0.6, 1.0, 1.6)):
    """All terms of one axis after the docstring, written out. Shape (samples, terms)."""
    columns = []
    for w, scale, carried in zip(
        speed.T, STRIBECK, speed.T if load is None else load.T, strict=True
    ):
        sign = np.tanh(w / (0.3 * scale))
        rows = [sign, w] + ([] if load is None else [carried])
        rows += [sign * np.exp(-((w / (width * scale)) ** 2)) for width in widths]
        columns.append(np.stack(rows, axis=1))
    return columns


@pytest.mark.parametrize("with_load", [True, False])
@pytest.mark.parametrize("widths", [(), (1.0,), (0.6, 1.0, 1.6), (0.95, 1.0, 1.05)])
def test_planted_coefficients_are_recovered(rng, with_load, widths):
    """Coulomb, viscous, load and Stribeck coefficients come out of a torque with any offset."""
    speed, load = motion(rng)
    load = load if with_load else None
    features = FrictionFeatures(stribeck_velocity=STRIBECK, widths=widths).fit(speed, load=load)
    design = terms(speed, load, widths)
    planted = rng.normal(size=(5, 3, design[0].shape[1]))
    torque = np.stack([planted[:, a] @ design[a].T for a in range(3)], axis=2)
    torque += 10 * rng.normal(size=(5, 1, 3))
    np.testing.assert_allclose(features.transform(torque), planted.reshape(5, -1), atol=1e-8)


def test_names_follow_the_columns(rng):
    """Each name says which coefficient of which axis its column is."""
    speed, load = motion(rng)
    features = FrictionFeatures(stribeck_velocity=STRIBECK, widths=(1.0,)).fit(speed, load=load)
    own = ["coulomb", "viscous", "load", "stribeck 1"]
    assert features.names_ == [f"axis {a} {name}" for a in (1, 2, 3) for name in own]
    torque = np.zeros((1, len(speed), 3))
    torque[0, :, 1] = 7.0 * load[:, 1]
    expected = 7.0 * np.array([name == "axis 2 load" for name in features.names_])
    np.testing.assert_allclose(features.transform(torque)[0], expected, atol=1e-9)


def test_noise_is_treated_as_by_numpy(rng):
    """Coefficients of any torque are those of numpy.linalg.lstsq with the same columns."""
    speed, load = motion(rng)
    features = FrictionFeatures(stribeck_velocity=STRIBECK).fit(speed, load=load)
    torque = rng.normal(size=(4, len(speed), 3))
    found = features.transform(torque).reshape(4, 3, -1)
    for axis, design in enumerate(terms(speed, load)):
        wide = np.column_stack([design, np.ones(len(design))])
        expected = np.linalg.lstsq(wide, torque[:, :, axis].T, rcond=None)[0][:-1].T
        np.testing.assert_allclose(found[:, axis], expected, rtol=1e-6, atol=1e-8)


def test_coefficients_are_linear_in_torque(rng):
    """Coefficients have the unit of torque, and what is expected can be taken off after."""
    speed, load = motion(rng)
    features = FrictionFeatures(stribeck_velocity=STRIBECK).fit(speed, load=load)
    torque, expected = rng.normal(size=(2, 3, len(speed), 3))
    difference = features.transform(1000 * (torque - expected))
    both = 1000 * (features.transform(torque) - features.transform(expected))
    np.testing.assert_allclose(difference, both, rtol=1e-9, atol=1e-6)


def test_inactive_axis(rng):
    """An axis that rests or trembles gives zeros; the others are as they were."""
    speed, _ = motion(rng)
    torque = rng.normal(size=(2, len(speed), 3))
    plain = FrictionFeatures(stribeck_velocity=STRIBECK).fit(speed).transform(torque)
    for slow, active in ((0.0, False), (0.29, False), (0.31, True)):
        still = speed.copy()
        still[:, 1] *= slow * STRIBECK[1] / np.abs(speed[:, 1]).max()
        features = FrictionFeatures(stribeck_velocity=STRIBECK).fit(still)
        np.testing.assert_array_equal(features.active_, [True, active, True])
        found = features.transform(torque).reshape(2, 3, -1)
        assert (found[:, 1] != 0).any() == active
        np.testing.assert_array_equal(found[:, [0, 2]], plain.reshape(2, 3, -1)[:, [0, 2]])


def test_terms_that_cannot_be_told_apart(rng):
    """A load without effect gets 0; one like the viscous term shares its coefficient."""
    speed, _ = motion(rng)
    torque = np.stack([design @ [1.0, 0.2, 0.5] for design in terms(speed, widths=(1.0,))], axis=1)
    features = FrictionFeatures(stribeck_velocity=STRIBECK, widths=(1.0,))
    plain = features.fit(speed).transform(torque[None]).reshape(3, 3)
    none = features.fit(speed, load=0 * speed).transform(torque[None]).reshape(3, 4)
    np.testing.assert_allclose(none, np.insert(plain, 2, 0.0, axis=1), atol=1e-9)
    twice = features.fit(speed, load=speed).transform(torque[None]).reshape(3, 4)
    np.testing.assert_allclose(twice[:, 1] + twice[:, 2], 0.2, rtol=1e-6)


def test_parameters_survive_cloning(rng):
    """A clone has the same parameters and knows nothing."""
    features = FrictionFeatures(stribeck_velocity=STRIBECK, widths=(1.0,)).fit(motion(rng)[0])
    copy = clone(features)
    assert copy.get_params()["widths"] == (1.0,)
    np.testing.assert_array_equal(copy.get_params()["stribeck_velocity"], STRIBECK)
    with pytest.raises(NotFittedError):
        copy.transform(np.zeros((1, 400, 3)))


def test_wrong_shapes(rng):
    """Speeds, loads and torques of other shapes are refused by name."""
    speed, load = motion(rng)
    features = FrictionFeatures(stribeck_velocity=STRIBECK)
    for wrong in (speed[:, :2], speed[:, 0], speed[None]):
        with pytest.raises(ValueError, match=r"velocity must have shape \(samples, 3 axes\), got"):
            features.fit(wrong)
    for wrong in (load[:-1], load[:, :1]):
        with pytest.raises(ValueError, match=r"load must have shape \(400, 3\), got"):
            features.fit(speed, load=wrong)
    features.fit(speed)
    for wrong in (speed, speed[None, :-1], speed[None, :, :2]):
        with pytest.raises(ValueError, match=r"torque must have shape \(cycles, 400, 3\), got"):
            features.transform(wrong)

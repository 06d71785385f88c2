"""Forms of friction against closed forms and a fine integration."""

import numpy as np
import pytest

from faultgen.discovery.laws.friction_forms import (
    COUNT,
    FALLING,
    LENGTHS,
    friction_forms,
    without_level,
)

PERIOD = 0.004
TIMES = np.arange(1500) * PERIOD
ANGLE = np.stack([3 * np.sin(4 * TIMES), 2 * np.cos(7 * TIMES) + 0.5 * TIMES], axis=1)
SPEED = np.stack([12 * np.cos(4 * TIMES), -14 * np.sin(7 * TIMES) + 0.5], axis=1)
LENGTH, WIDTH = np.array([0.05, 0.2]), np.array([1.0, 2.0])


@pytest.fixture(scope="module")
def forms():
    return friction_forms(ANGLE, SPEED, [slice(0, len(TIMES))], LENGTH, WIDTH)


def integrated(angle_of, length):
    """Dahl's law dz/dt = w / length - |w| z / length by very small steps, from 0."""
    every = 200
    fine = np.arange(len(TIMES) * every) * PERIOD / every
    way = np.diff(angle_of(fine), prepend=angle_of(fine[:1]))
    z, out = 0.0, np.empty(len(fine))
    for k, step in enumerate(way):
        z += (step - abs(step) * z) / length
        out[k] = z
    return out[::every]


@pytest.mark.parametrize("share", [0.2, 1.0, 5.0])
def test_bristles_are_those_of_a_fine_integration(forms, share):
    told = forms[LENGTHS.index(share), :, 0]
    exact = integrated(lambda t: 3 * np.sin(4 * t), share * LENGTH[0])
    np.testing.assert_allclose(told, exact, atol=0.02)


def test_bristles_of_one_direction_are_exponential():
    """Z = 1 - exp(-x / length) from rest, in each separate recording anew."""
    angle = np.tile(np.linspace(0, 1, 200), 2)[:, None]
    speed = np.ones_like(angle)
    parts = [slice(0, 200), slice(200, 400)]
    found = friction_forms(angle, speed, parts, np.array([0.1]), np.array([1.0]))
    exact = 1 - np.exp(-angle[:, 0] / 0.1)
    for part in parts:
        np.testing.assert_allclose(found[LENGTHS.index(1.0), part, 0], exact[part], atol=1e-9)


def test_an_axis_at_rest_has_no_friction_of_any_form():
    still = np.zeros((50, 1))
    found = friction_forms(still, still, [slice(0, 50)], np.array([0.1]), np.array([1.0]))
    assert found.shape == (COUNT, 50, 1) and not found.any()


def test_forms_are_shares_of_friction(forms):
    """At most 1, and in the direction of a fast motion; falls vanish there."""
    assert forms.shape == (COUNT, *ANGLE.shape)
    assert np.abs(forms).max() <= 1 + 1e-9
    fast = (np.abs(SPEED) > 10) & (TIMES > 0.1)[:, None]  # bristles are bent after a while
    usual = forms[LENGTHS.index(1.0)]
    assert np.all((usual * np.sign(SPEED))[fast] > 0.8)
    assert np.abs(forms[FALLING][1][fast]).max() < 1e-3


def test_forms_without_level_hold_no_coulomb_or_viscous_friction(forms):
    """A law that is Coulomb and viscous friction alone is no combination of them."""
    fast = (np.abs(SPEED[:, 0]) > 8) & (TIMES > 0.1)
    other = without_level(forms)[:, fast, 0]
    assert len(other) == COUNT - 3
    scale = SPEED[fast, 0] / np.abs(SPEED[:, 0]).max()
    curved = np.sign(scale) * scale**2 - scale
    np.testing.assert_allclose(other[-1], curved, atol=0.01)
    elastic, smooth = other[: len(LENGTHS) - 1], other[len(LENGTHS) - 1 :][:3]
    assert np.abs(elastic[:3]).max() < 0.01  # the longest bristles lag behind
    assert np.abs(smooth).max() < 0.01

"""Samples after reversals count by how well they are foretold."""

from types import SimpleNamespace

import numpy as np
import pytest

from faultgen.discovery.fit.regimes import OWN, trust_by_regime
from faultgen.recordings.recording import Recording

PERIOD, COUNT = 0.004, 12000
TIMES = PERIOD * np.arange(COUNT)


def swinging(*starts):
    """Axes that turn round every second, each from its own time on, in one recording."""
    speed = np.stack([np.where((TIMES - start) % 2 < 1, 50.0, -50.0) for start in starts], axis=1)
    recording = Recording(
        source="written down",
        robot="",
        side="motor",
        sample_period=PERIOD,
        position=np.cumsum(speed, axis=0) * PERIOD,
        torque=np.ones_like(speed),
    )
    n_axes = len(starts)
    robot = SimpleNamespace(
        n_axes=n_axes,
        gear_ratio=np.ones(n_axes),
        stribeck_velocity=np.ones(n_axes),
        set_points=np.ones(3),
    )
    return recording, robot


@pytest.fixture
def error():
    return np.random.default_rng(5).standard_normal((COUNT, 2))


def test_samples_that_are_foretold_as_well_as_others_count_fully(error):
    recording, robot = swinging(0.0, 0.5)
    trust = trust_by_regime(error, recording, robot, np.ones(error.shape, bool))
    assert trust.max() == 1 and trust.min() > 0.85


def test_errors_after_an_own_reversal_count_less(error):
    """Three times larger errors get a third of the weight, on this axis and for this time only."""
    recording, robot = swinging(0.0, 0.5)
    since = TIMES % 1
    after = (since >= OWN[1]) & (since < OWN[2])
    error[after, 0] *= 3
    trust = trust_by_regime(error, recording, robot, np.ones(error.shape, bool))
    # the edges of a regime are a sample apart from those of the written error
    inner = (since > OWN[1] + 2 * PERIOD) & (since < OWN[2] - 2 * PERIOD) & (TIMES > 1)
    assert np.median(trust[inner, 0]) == pytest.approx(1 / 3, rel=0.15)
    assert np.median(trust[since > OWN[-1], 0]) == 1
    assert trust[:, 1].min() > 0.85


def test_the_jolt_of_another_axis_counts_less(error):
    recording, robot = swinging(0.0, 0.5)
    jolt = ((TIMES - 0.5) % 1 < 0.03) & (TIMES > 1)
    error[jolt, 0] *= 5
    trust = trust_by_regime(error, recording, robot, np.ones(error.shape, bool))
    assert np.median(trust[jolt, 0]) == pytest.approx(1 / 5, rel=0.2)
    assert np.median(trust[~jolt, 0]) == 1


def test_one_axis_has_no_others():
    recording, robot = swinging(0.0)
    error = np.random.default_rng(6).standard_normal((COUNT, 1))
    trust = trust_by_regime(error, recording, robot, np.ones(error.shape, bool))
    assert trust.min() > 0.85

"""Orders and regimes in a gap whose content is known."""

from types import SimpleNamespace

import numpy as np
import pytest

from faultgen.discovery.decision.verdict import significance
from faultgen.discovery.fit.diagnostics import where
from faultgen.discovery.fit.problem import Kinematics
from faultgen.discovery.laws.order_analysis import find_orders
from faultgen.recordings.noise import autoregression
from faultgen.recordings.recording import Recording

PERIOD, COUNT = 0.004, 4000


@pytest.fixture
def problem(tiny_robot):
    """Both axes swing; the noise is white with deviation 1."""
    time = np.arange(COUNT) * PERIOD
    joint = np.stack([np.sin(1.3 * time), 0.8 * np.sin(2.1 * time + 1)], axis=1)
    recording = Recording(
        source="",
        robot="tiny",
        side="motor",
        sample_period=PERIOD,
        position=joint * tiny_robot.gear_ratio,
        torque=np.ones((COUNT, 2)),
        segments=(0, COUNT // 2),
    )
    position = recording.motor_position(tiny_robot)
    _, velocity, acceleration = recording.derivatives(position)
    use = np.arange(COUNT)
    return SimpleNamespace(
        motion=Kinematics(position, velocity, acceleration),
        samples=lambda parts: np.isin(use // (COUNT // 2), parts),
        recording=recording,
        robot=tiny_robot,
        inside=np.ones((COUNT, 2), bool),
        parts=recording.parts,
        fitting=[0, 1],
        base=np.abs(joint),
        whiten=lambda x: x,
    )


def orders(problem, error):
    return find_orders(problem.recording, problem.robot, error, problem.inside)


@pytest.fixture
def noise():
    return np.random.default_rng(3).normal(size=(COUNT, 2))


def test_noise_has_no_order_and_no_regime(problem, noise):
    assert orders(problem, noise) == []
    assert where(problem, noise) == []
    assert significance(problem, noise) > 0.01


@pytest.mark.parametrize("order", [1.0, 3.4, 7.25])
def test_an_order_is_found(problem, noise, order):
    """Within a tenth of a cycle over the angle that was travelled."""
    noise[:, 1] += 0.4 * np.sin(order * problem.recording.position[:, 1] + 0.7)
    found = orders(problem, noise)
    assert [one.axis for one in found] == [2]
    turns = np.ptp(problem.recording.position[:, 1]) / (2 * np.pi)
    assert abs(found[0].order - order) * turns < 0.1


def test_regimes_of_a_one_sided_gap(problem, noise):
    """All of it on axis 2, and forward."""
    speed = np.gradient(problem.recording.position[:, 1])
    noise[speed > 0, 1] += 1.0
    told = where(problem, noise)
    assert (told[0].axis, told[0].regime) == (2, "all") and told[0].share > 0.9
    assert ("forward", 2) in [(one.regime, one.axis) for one in told]
    assert all(one.axis == 2 and one.regime != "backward" for one in told)
    assert significance(problem, noise) < 1e-3


def test_an_autoregression_is_estimated_and_taken_away():
    """x_t = 0.7 x_(t-1) - 0.2 x_(t-2) + e."""
    rng = np.random.default_rng(5)
    x = np.zeros((20000, 1))
    e = 0.3 * rng.normal(size=20000)
    for t in range(2, len(x)):
        x[t] = 0.7 * x[t - 1] - 0.2 * x[t - 2] + e[t]
    parts = [slice(0, 12000), slice(12000, 20000)]
    noise = autoregression(x, np.ones(x.shape, bool), parts, order=2)
    np.testing.assert_allclose(noise.coefficients[0], [0.7, -0.2], atol=0.02)
    assert noise.innovation[0] == pytest.approx(0.3, rel=0.02)
    assert noise.deviation[0] == pytest.approx(x.std(), rel=0.02)
    white = noise.whiten(x, parts)
    assert white.std() == pytest.approx(1, rel=0.02)
    assert abs(np.corrcoef(white[1:, 0], white[:-1, 0])[0, 1]) < 0.03


def test_a_gap_with_less_noise_than_is_reckoned_with_has_no_order(problem, noise):
    """What is small beside the noise is none, however regular: tests are against the noise."""
    motion = problem.motion
    turn = motion.position[:, :1] / 3
    regular = 0.02 * np.abs(motion.velocity) / 200 + 0.02 * np.sin(2 * np.pi * turn)
    assert orders(problem, regular) == []
    assert significance(problem, regular) > 0.5

"""Orders, regimes and patterns in a gap whose content is known."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from faultgen.discovery.decision.verdict import significance
from faultgen.discovery.fit.diagnostics import where
from faultgen.discovery.fit.regression import Kinematics
from faultgen.discovery.laws.order_analysis import find_orders
from faultgen.discovery.laws.patterns import patterns
from faultgen.discovery.laws.spikes import spikes
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


@pytest.fixture
def noise():
    return np.random.default_rng(3).normal(size=(COUNT, 2))


def test_noise_has_no_order_and_no_pattern(problem, noise):
    assert find_orders(problem, noise) == []
    assert min(one.p_value for one in patterns(problem, noise, [0, 1])) > 1e-3
    assert where(problem, noise) == []
    assert significance(problem, noise) > 0.01


@pytest.mark.parametrize("order", [1.0, 3.4, 7.25])
def test_an_order_is_found(problem, noise, order):
    """Within a tenth of a cycle over the angle that was travelled."""
    noise[:, 1] += 0.4 * np.sin(order * problem.recording.position[:, 1] + 0.7)
    found = find_orders(problem, noise)
    assert [one.axis for one in found] == [2]
    turns = np.ptp(problem.recording.position[:, 1]) / (2 * np.pi)
    assert abs(found[0].order - order) * turns < 0.1


def test_a_pattern_is_found_where_it_is(problem, noise):
    """A bump over 0.2 rad of joint 1, going forward only."""
    joint = problem.recording.position[:, 0] / problem.robot.gear_ratio[0]
    forward = np.gradient(joint) > 0
    noise[(np.abs(joint - 0.4) < 0.1) & forward, 0] += 1.0
    first = patterns(problem, noise, [0, 1])[0]
    assert (first.axis, first.along) == (1, "joint angle")
    assert first.place == pytest.approx(0.4, abs=0.1)
    assert first.p_value < 1e-6


def test_a_burst_is_found(problem, noise):
    noise[2500:2560, 1] += 5
    found = patterns(problem, noise, [0, 1])
    burst = [one for one in found if one.along == "time" and one.axis == 2][0]
    assert burst.p_value < 1e-4 and abs(burst.place - 10.0) < 0.4


def test_more_noise_for_a_while_is_no_pattern(problem, noise):
    """Nor are outliers: neither predicts anything."""
    noise[2500:2700, 1] *= 2.5
    noise[100:4000:90, 0] *= 15
    assert min(one.p_value for one in patterns(problem, noise, [0, 1])) > 1e-3


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


def test_a_gap_with_less_noise_than_is_reckoned_with_has_no_pattern(problem, noise):
    """What is small beside the noise is none, however regular: tests are against the noise."""
    motion = problem.motion
    turn = motion.position[:, :1] / 3
    regular = 0.02 * np.abs(motion.velocity) / 200 + 0.02 * np.sin(2 * np.pi * turn)
    assert find_orders(problem, regular) == []
    assert min(one.p_value for one in patterns(problem, regular, [0, 1])) > 0.5
    assert significance(problem, regular) > 0.5


@pytest.mark.parametrize(("before", "after", "is_found"), [(0, 40, True), (40, 40, False)])
def test_sudden_errors_count_only_after_the_change(problem, noise, before, after, is_found):
    """Outliers in both recordings are noise; outliers in one of them are not."""
    rng = np.random.default_rng(5)
    runs = [rng.normal(size=(COUNT, 2)) / np.sqrt(2) for _ in range(2)]
    for run, count in zip(runs, (before, after), strict=True):
        run[rng.choice(COUNT, count, replace=False), 0] += 12
    difference = runs[1] - runs[0]
    problem.baseline, problem.residual = True, difference
    problem.recording = replace(problem.recording, torque=problem.base + runs[1])
    found = {one.axis: one for one in spikes(problem, difference)}
    assert 2 not in found or found[2].p_value > 1e-3
    assert (found[1].p_value < 1e-6) is is_found
    if is_found:
        assert found[1].strength == pytest.approx(after * 12**2, rel=0.2)

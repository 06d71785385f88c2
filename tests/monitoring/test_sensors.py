import numpy as np
import pytest

from faultgen.errors import InputError
from faultgen.monitoring.environment import surroundings
from faultgen.monitoring.sensors import SENSORS, get_sensors, measure, torque_noise

RATIO, COUNTS, MEAN = np.array([100.0, -50.0]), np.array([1000.0, 0.0]), np.array([2.0, 0.5])


def measured(preset, position, velocity, torque, seed=0):
    return measure(
        SENSORS[preset],
        position,
        velocity,
        torque,
        gear_ratio=RATIO,
        encoder_counts=COUNTS,
        mean_torque=MEAN,
        sample_period=0.004,
        rng=np.random.default_rng(seed),
    )


@pytest.fixture
def motion():
    t = np.arange(20000) * 0.004
    position = np.stack([30 * np.sin(t), 20 * np.cos(t)], axis=1)
    velocity = np.stack([30 * np.cos(t), -20 * np.sin(t)], axis=1)
    return position, velocity, np.stack([np.sin(t), np.cos(t)], axis=1)


def test_none_measures_the_truth(motion):
    """Without noise, what is measured is what was simulated."""
    seen = measured("none", *motion)
    for value, true in zip(
        (seen.motor_position, seen.motor_velocity, seen.motor_torque), motion, strict=True
    ):
        np.testing.assert_array_equal(value, true)


def test_thesis_noise_has_the_documented_size(motion):
    """1 % of the mean torque; 1e-4 rad and 2e-4 rad/s at the joint, times the gear ratio."""
    seen = measured("thesis", *motion)
    position, velocity, torque = motion
    n = len(torque)
    within = 4 / np.sqrt(2 * n)  # four standard errors of a standard deviation
    for error, size in (
        (seen.motor_torque - torque, 0.01 * MEAN),
        (seen.motor_position - position, 1e-4 * np.abs(RATIO)),
        (seen.motor_velocity - velocity, 2e-4 * np.abs(RATIO)),
    ):
        np.testing.assert_allclose(error.std(axis=0), size, rtol=within)
        assert np.abs(np.corrcoef(error[1:, 0], error[:-1, 0])[0, 1]) < 4 / np.sqrt(n)


def test_realistic_torque_noise_is_coloured(motion):
    """Its autocorrelation falls to 1/e in 20 ms, its size is 1 % of the mean torque throughout."""
    noise = torque_noise(SENSORS["realistic"], (100_000, 2), MEAN, 0.004, np.random.default_rng(1))
    np.testing.assert_allclose(noise.std(axis=0), 0.01 * MEAN, rtol=0.05)
    later = np.corrcoef(noise[5:, 0], noise[:-5, 0])[0, 1]
    assert later == pytest.approx(np.exp(-1), abs=0.03)
    firsts = [
        torque_noise(SENSORS["realistic"], (1, 2), MEAN, 0.004, np.random.default_rng(k))
        for k in range(2000)
    ]
    np.testing.assert_allclose(np.std(firsts, axis=0)[0], 0.01 * MEAN, rtol=0.08)


def test_encoders_count(motion):
    """Positions are whole counts; velocities are their differences; 0 counts means exact."""
    seen = measured("realistic", *motion)
    count = 2 * np.pi / 1000
    steps = seen.motor_position[:, 0] / count
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
    assert np.abs(seen.motor_position - motion[0])[:, 0].max() <= count / 2 * (1 + 1e-9)
    np.testing.assert_array_equal(seen.motor_position[:, 1], motion[0][:, 1])
    np.testing.assert_allclose(
        seen.motor_velocity[1:], np.diff(seen.motor_position, axis=0) / 0.004, atol=1e-9
    )
    assert np.abs(seen.motor_velocity[0, 0] - motion[1][0, 0]) < 2 * count / 0.004


def test_surroundings_have_their_size_and_memory():
    """Temperature wanders by 4 K with a memory of 30 cycles, the payload scatters by 1 %."""
    around = surroundings(SENSORS["realistic"], 200_000, 40.0, np.random.default_rng(0))
    wander = around.temperature - 40.0
    assert wander.std() == pytest.approx(4.0, rel=0.05)
    assert np.corrcoef(wander[30:], wander[:-30])[0, 1] == pytest.approx(np.exp(-1), abs=0.05)
    error = around.measured_temperature - around.temperature
    assert error.std() == pytest.approx(0.5, rel=0.02)
    assert (around.payload_factor - 1).std() == pytest.approx(0.01, rel=0.02)


def test_quiet_presets_leave_the_surroundings_alone():
    """Without wander and scatter every cycle is nominal."""
    for name in ("none", "thesis"):
        around = surroundings(SENSORS[name], 9, 40.0, np.random.default_rng(0))
        assert (around.temperature == 40).all()
        assert (around.measured_temperature == 40).all()
        assert (around.payload_factor == 1).all()
        assert not SENSORS[name].changes_motion


def test_same_seed_same_noise(motion):
    """Noise comes from the generator alone."""
    one, two = (measured("realistic", *motion, seed=5).motor_torque for _ in range(2))
    np.testing.assert_array_equal(one, two)
    assert (measured("realistic", *motion, seed=6).motor_torque != one).any()


def test_unknown_presets_are_refused_with_the_choices():
    """The message names the presets that there are."""
    with pytest.raises(InputError, match="unknown sensors 'loud': choose none, thesis, realistic"):
        get_sensors("loud")

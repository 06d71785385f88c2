"""Faults of a log: samples that repeat the one before, and encoders with coarse steps."""

from dataclasses import replace

import numpy as np
import pytest

import faultgen
from faultgen.discovery import Recording, write_recording
from faultgen.discovery.inputs import read_together
from faultgen.recordings.log_faults import new_faults, repaired
from faultgen.recordings.several import joined

PERIOD, COUNT = 0.004, 3000


def moved(seed=0, noise=0.05):
    """Two axes that swing and rest, with noise on the torque."""
    number = np.arange(COUNT)
    times = PERIOD * np.where(number < 1200, number, np.maximum(number - 200, 1200))
    way = np.stack([np.sin(2 * times), np.cos(3 * times)], axis=1)
    rng = np.random.default_rng(seed)
    return Recording(
        source=f"run {seed}",
        robot="tiny",
        side="motor",
        sample_period=PERIOD,
        position=50 * way,
        torque=way + noise * rng.standard_normal(way.shape),
        reference_position=way,
    )


def shown(recording, axis, samples):
    """The recording with other samples shown on one axis."""
    position, torque = recording.position.copy(), recording.torque.copy()
    for values in (position, torque):
        values[:, axis] = values[samples, axis]
    return replace(recording, position=position, torque=torque)


def losing(recording, axis, share, seed=1):
    lost = np.random.default_rng(seed).random(COUNT) < share
    lost[0] = False
    return shown(recording, axis, np.maximum.accumulate(np.where(lost, 0, np.arange(COUNT)))), lost


@pytest.mark.parametrize("share", [0.01, 0.05, 0.3])
def test_lost_samples_are_counted_and_replaced(share):
    """The share is within its interval, and the position is again what it was."""
    whole = moved()
    worn, lost = losing(whole, 1, share)
    found = repaired(worn)
    (fault,) = found.faults
    assert (fault.effect, fault.axis) == ("sensor_dropout", 2)
    assert fault.interval[0] < share < fault.interval[1]
    assert fault.interval[0] < fault.severity < fault.interval[1]
    error = np.abs(found.position - whole.position)[:-20]  # the end cannot be interpolated
    assert error.max() < 0.005 * 50
    assert not found.lost[:, 0].any()
    long = np.convolve(lost, np.ones(4))[:COUNT] == 4  # the end of a stretch: what follows, too
    assert not (
        found.lost[:, 1] & ~lost & ~np.convolve(long, np.ones(11))[:COUNT].astype(bool)
    ).any()
    assert found.lost[:, 1].sum() > 0.75 * lost.sum()  # not at rest
    assert np.array_equal(found.torque[~lost], whole.torque[~lost])


def test_a_stretch_that_stands_still_is_a_stuck_sensor():
    """The first sample is real, and some after the stretch are not used."""
    samples = np.arange(COUNT)
    samples[500:650] = 500
    found = repaired(shown(moved(), 0, samples))
    (fault,) = found.faults
    assert (fault.effect, fault.axis) == ("sensor_stuck", 1)
    assert fault.severity == pytest.approx(150 / COUNT, abs=1 / COUNT)
    assert np.flatnonzero(found.lost[:, 0]).tolist() == list(range(501, 660))


def test_both_faults_of_one_axis_are_told_apart():
    worn, _ = losing(moved(), 0, 0.05)
    samples = np.arange(COUNT)
    samples[2000:2200] = 2000
    found = {one.effect: one for one in repaired(shown(worn, 0, samples)).faults}
    assert found["sensor_stuck"].severity == pytest.approx(200 / COUNT, abs=5 / COUNT)
    low, high = found["sensor_dropout"].interval
    assert low < 0.05 < high


@pytest.mark.parametrize(
    "healthy",
    [
        moved(),
        moved(noise=0.0),  # at rest everything repeats
        replace(moved(), torque=np.round(moved().torque, 1)),
        replace(moved(), position=np.round(moved().position, 1)),
        shown(shown(moved(), 0, np.arange(COUNT) // 4 * 4), 1, np.arange(COUNT) // 4 * 4),
    ],
    ids=["noise", "no noise", "coarse torque", "coarse position", "written four times"],
)
def test_healthy_logs_have_no_fault(healthy):
    found = repaired(healthy)
    assert found is healthy
    assert found.faults == ()


def test_faults_that_a_healthy_log_has_too_are_not_new(tiny_robot):
    """Only a clearly larger share counts, also if several recordings are used together."""
    healthy = repaired(losing(moved(1), 0, 0.05, seed=2)[0])
    alike, worse = (repaired(losing(moved(), 0, share)[0]) for share in (0.05, 0.1))
    assert new_faults(alike, [healthy], tiny_robot) == ()
    assert new_faults(worse, [healthy], tiny_robot) == worse.faults
    assert new_faults(worse, [], tiny_robot) == worse.faults
    both = joined([alike, worse, moved()])
    assert new_faults(both, [], tiny_robot) == worse.faults
    assert both.lost.sum() == alike.lost.sum() + worse.lost.sum()


def test_a_few_lost_samples_are_usual(tiny_robot):
    """Real logs lose some; three after the change and none before it are no change."""
    few = repaired(losing(moved(), 0, 0.003)[0])
    assert few.faults and few.faults[0].severity < 0.003
    assert new_faults(few, [moved(1)], tiny_robot) == ()
    assert new_faults(few, [], tiny_robot) == ()


def test_an_encoder_that_counts_more_coarsely_is_found(tiny_robot):
    """Steps are compared with those of the healthy recording, or with none."""

    def counting(step, seed):
        one = moved(seed)
        position = one.position.copy()
        position[:, 1] = np.round(position[:, 1] / step) * step
        return replace(one, position=position)

    for before in (moved(1), counting(0.005, 1)):
        (fault,) = new_faults(counting(0.02, 0), [before], tiny_robot)
        assert (fault.effect, fault.axis) == ("encoder_quantisation", 2)
        assert fault.severity == pytest.approx(0.02, rel=1e-6)
    assert new_faults(counting(0.02, 0), [counting(0.02, 1)], tiny_robot) == ()
    assert new_faults(counting(0.02, 0), [], tiny_robot) == ()

    # digits so few that the steps of the healthy recording are not whole ones any more
    before = counting(0.02, 1)
    before = replace(before, position=before.position + 3e-4 * np.sin(1e3 * before.position))
    assert new_faults(counting(0.02, 0), [before], tiny_robot) == ()


@pytest.mark.slow
def test_an_answer_holds_the_faults_of_the_log(tiny_robot_path, tiny_robot, measured, tmp_path):
    """They are named, the samples are not used, and nothing else is named for them."""
    healthy, worn = measured([], 0), measured([], 1)
    lost = np.random.default_rng(3).random(len(worn.position)) < 0.1
    lost[0] = False
    shows = np.maximum.accumulate(np.where(lost, 0, np.arange(len(lost))))
    write_recording(shown(worn, 0, shows), tmp_path / "worn.h5")
    write_recording(healthy, tmp_path / "healthy.h5")
    files = [tmp_path / "worn.h5"], tiny_robot, [tmp_path / "healthy.h5"]
    assert read_together(*files).recording.lost[:, 0].any()
    told = faultgen.discover(tmp_path / "worn.h5", tiny_robot_path, tmp_path / "healthy.h5")
    assert told["verdict"] == "named"
    (effect,) = told["effects"]
    assert (effect["effect"], effect["axis"]) == ("sensor_dropout", 1)
    assert effect["parameters"]["severity"] == pytest.approx(0.1, abs=0.03)
    assert "axis 1: sensor_dropout is seen in the log itself" in " ".join(told["warnings"])
    without = faultgen.discover(
        tmp_path / "worn.h5",
        tiny_robot_path,
        tmp_path / "healthy.h5",
        exclude=["sensor_dropout"],
    )
    assert without["verdict"] == "no missing effect"

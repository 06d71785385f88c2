"""Samples that are not evenly spaced in time: interpolated, divided at gaps, or refused."""

from dataclasses import replace

import h5py
import numpy as np
import pytest

from faultgen.discovery import read_recording, write_recording
from faultgen.discovery.inputs import usable
from faultgen.errors import InputError
from faultgen.recordings.in_step import in_step
from faultgen.recordings.recording import Recording
from faultgen.recordings.resampling import irregular

PERIOD = 0.004


def jittered(count, size, seed=0):
    """Times that are off even ones by up to a share of the period."""
    rng = np.random.default_rng(seed)
    return PERIOD * (np.arange(count) + size * rng.uniform(-1, 1, count))


def write(path, time, arrays, **attributes):
    """A file with times instead of a period."""
    with h5py.File(path, "w") as file:
        file["time"] = time
        for name, values in arrays.items():
            file[name] = values
        file.attrs.update(attributes)
    return path


def motion(time):
    """Joint angle and torque of two axes as functions of time."""
    angle = np.stack([np.sin(2 * time), 0.5 * np.cos(3 * time)], axis=1)
    return {"joint_position": angle, "joint_torque": 20 * angle}


def test_even_times_are_a_period(tmp_path):
    """Clocks that start anywhere, or round: nothing is changed."""
    even = np.arange(500) * PERIOD
    for time in (even, 1.7e9 + even, np.round(even * 100 / 3, 3)):
        made = write(tmp_path / "r.h5", time, motion(even))
        recording = read_recording(made)
        assert recording.notes == ()
        assert recording.sample_period == pytest.approx((time[-1] - time[0]) / 499, rel=1e-3)
        np.testing.assert_array_equal(recording.position, motion(even)["joint_position"])


def test_small_jitter_that_is_known_is_no_noise(tmp_path):
    """2 % of the period would be an error of position of 1e-4 rad at this speed."""
    time = jittered(1000, 0.02)
    recording = read_recording(write(tmp_path / "r.h5", time, motion(time)))
    right = motion(time[0] + PERIOD * np.arange(len(recording.position)))
    np.testing.assert_allclose(recording.position, right["joint_position"], atol=1e-7)


def test_a_period_is_used_where_there_is_one(tmp_path):
    """Times beside a sample_period are not read, whatever they are."""
    arrays = motion(np.arange(50) * PERIOD)
    made = write(tmp_path / "r.h5", np.bytes_(b"noon"), arrays, sample_period=PERIOD)
    assert read_recording(made).sample_period == PERIOD


def test_jitter_is_interpolated(tmp_path):
    """Positions lie on the motion, torque nearly; the line states what was done."""
    time = 100.0 + jittered(1000, 0.3)
    recording = read_recording(write(tmp_path / "r.h5", time, motion(time)))
    assert recording.sample_period == PERIOD
    right = motion(time[0] + PERIOD * np.arange(len(recording.position)))
    np.testing.assert_allclose(recording.position, right["joint_position"], atol=1e-7)
    np.testing.assert_allclose(recording.torque, right["joint_torque"], atol=1e-3)
    largest = np.abs(np.diff(time) - PERIOD).max()
    (line,) = recording.notes
    assert "its 1000 samples are not evenly spaced" in line
    assert f"at {len(recording.position)} times 0.004 s apart" in line
    assert f"the largest jitter is {largest:.3g} s" in line and "gap" not in line


def test_missing_samples_are_no_jitter(tmp_path):
    time = np.delete(np.arange(600) * PERIOD, [100, 101, 300])
    (line,) = read_recording(write(tmp_path / "r.h5", time, motion(time))).notes
    assert "the largest jitter is 0 s; 3 that are missing between others" in line
    assert irregular(time, [0], PERIOD) == (0.0, pytest.approx(np.zeros(0)), 3)


def test_missing_samples_are_interpolated_and_gaps_divide(tmp_path):
    """Two samples are missing, then twenty; segments of the file stay, however their clock runs."""
    time = np.arange(600) * PERIOD
    again = time[:100] - 7.0
    lost = np.delete(time, [*range(100, 102), *range(300, 320), 597])
    both = np.concatenate([lost, again])
    made = write(tmp_path / "r.h5", both, motion(both), segments=[0, len(lost)])
    recording = read_recording(made)
    assert recording.segments == (0, 300, 580)
    right = np.concatenate([time[:300], time[320:], again])
    np.testing.assert_allclose(recording.position, motion(right)["joint_position"], atol=1e-7)
    (line,) = recording.notes
    assert "new segments begin after gaps (1, of up to 0.084 s)" in line and "left out" not in line


def test_what_cannot_be_interpolated_is_left_out(tmp_path):
    """Three samples between two gaps, and a sample that is logged twice in a hundredth period."""
    time = np.arange(300) * PERIOD
    time[100:] += 1.0
    time[103:] += 1.0
    time = np.insert(time, 50, time[49] + PERIOD / 100)
    recording = read_recording(write(tmp_path / "r.h5", time, motion(time)))
    assert recording.segments == (0, 100) and len(recording.position) == 297
    assert "; samples between gaps, or too close to others, were left out (4)" in recording.notes[0]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t[::-1], "times must ascend within a segment; sample 1 is at 0.392 s, and"),
        (lambda t: np.where(t == t[7], t[6], t), "times must ascend within a segment; sample 7"),
        (lambda t: np.where(t == t[7], np.nan, t), "time is not finite in sample 7"),
        (lambda t: t[:-1], r"time has shape \(99,\), expected \(100,\)"),
        (lambda t: 1000 * t, "its times are 4 s apart, .* check the unit of time"),
        (lambda t: t + (np.arange(100) // 4) * 0.1, "no 5 samples without a gap of more than"),
    ],
)
def test_bad_times_are_refused_in_one_line(tmp_path, change, message):
    time = np.arange(100) * PERIOD
    made = write(tmp_path / "bad.h5", change(time), motion(time))
    with pytest.raises(InputError, match=message) as error:
        read_recording(made)
    assert "\n" not in str(error.value)


def test_csv_has_the_same_times(tmp_path):
    """A gap, and times that do not ascend."""
    time = np.arange(30) * 0.01
    time[12:] += 0.05
    columns = np.stack([time, np.sin(time), np.cos(time)], axis=1)
    header = "time,joint_position_1,joint_torque_1"
    path = tmp_path / "r.csv"
    np.savetxt(path, columns, delimiter=",", header=header, comments="")
    recording = read_recording(path)
    assert recording.segments == (0, 12) and "after gaps (1, of up to 0.06 s)" in recording.notes[0]
    np.savetxt(path, columns[::-1], delimiter=",", header=header, comments="")
    with pytest.raises(InputError, match="times must ascend"):
        read_recording(path)


def test_the_command_reports_what_was_done(measured, tiny_robot, tmp_path):
    """The line is a warning, and the data stay usable."""
    recording = measured([], 1)
    time = jittered(len(recording.torque), 0.2)
    nominal = PERIOD * np.arange(len(time))

    def at(values):
        return np.stack([np.interp(time, nominal, column) for column in values.T], axis=1)

    arrays = {
        "motor_position": at(recording.position),
        "motor_torque": at(recording.torque),
        "reference_position": at(recording.reference_position),
    }
    found, warnings = usable(write(tmp_path / "r.h5", time, arrays), tiny_robot)
    assert found.sample_period == PERIOD
    assert "warn: its 1875 samples are not evenly spaced" in warnings[0]
    again = tmp_path / "again.h5"
    write_recording(found, again)
    assert usable(again, tiny_robot)[1] == []


def test_resampled_recordings_of_one_program_are_cut_to_one_length():
    """Two segments of two files, one of them resampled; very different lengths stay."""
    one = Recording(
        source="one",
        robot="",
        side="joint",
        sample_period=PERIOD,
        position=np.arange(400.0)[:, None] * 1e-3,
        torque=np.arange(400.0)[:, None],
        temperature=np.arange(400.0),
        segments=(0, 200),
    )
    other = replace(
        one, torque=one.torque[1:], position=one.position[1:], temperature=None, segments=(0, 199)
    )
    assert in_step([one, other]) == [one, other]  # nothing was resampled
    first, second = in_step([one, replace(other, notes=("resampled",))])
    assert first.segments == second.segments == (0, 199)
    assert len(first.torque) == len(second.torque) == len(first.temperature) == 399
    np.testing.assert_array_equal(first.torque[198:200, 0], [198.0, 200.0])
    short = replace(other, notes=("resampled",), segments=(0, 100))
    assert in_step([one, short]) == [one, short]

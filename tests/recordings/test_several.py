"""Several recordings of one robot are used together, each with its own healthy runs."""

import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

import faultgen
from faultgen.cli.app import app
from faultgen.discovery import Recording, read_recording, write_recording
from faultgen.discovery.inputs import read_together
from faultgen.errors import InputError
from faultgen.recordings.several import joined, with_healthy

COUNT = 40
"""Samples of the small recordings."""


def small(source, seed=0, start=0.0, **other):
    """A recording with some of the arrays."""
    position = start + np.linspace(0, 1, COUNT)[:, None] * [1.0, 2.0]
    one = Recording(
        source=source,
        robot="tiny",
        side="motor",
        sample_period=0.004,
        position=position,
        torque=np.random.default_rng(seed).standard_normal((COUNT, 2)),
        reference_position=position / 50,
    )
    return replace(one, **other)


def test_recordings_become_separate_ones_of_one():
    """Samples stand one after another, and only what all have is kept."""
    first = small("a", 1, segments=(0, 15), temperature=np.full(COUNT, 30.0))
    second = small("b", 2, temperature=np.full((COUNT, 2), 40.0), reference_position=None)
    both = joined([first, second])
    assert both.segments == (0, 15, COUNT)
    assert np.array_equal(both.torque, np.vstack([first.torque, second.torque]))
    assert np.array_equal(both.position[COUNT:], second.position)
    assert np.array_equal(both.temperature, [[30.0, 30.0]] * COUNT + [[40.0, 40.0]] * COUNT)
    assert both.reference_position is None
    assert both.source == "a, b"
    assert joined([first]) is first


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"side": "joint"}, "the side is motor in the first and joint in the second"),
        ({"sample_period": 0.005}, "0.004 s and 0.005 s apart"),
        ({"current": True}, "the torque is torque in the first and motor current in the second"),
        ({"payload_mass": 2.0}, r"the payload \[kg\] is None in the first and 2.0 in the second"),
    ],
)
def test_recordings_of_other_kinds_are_refused(change, message):
    with pytest.raises(InputError, match=f"a and b: cannot be used together: .*{message}"):
        joined([small("a"), small("b", **change)])


def test_clocks_may_differ_by_little():
    assert joined([small("a"), small("b", sample_period=0.0040001)]).sample_period == 0.004


def test_healthy_runs_go_with_the_same_motion():
    """Runs are in the order of the measured motions, however they were given."""
    measured = [small("a", 1), small("b", 2, start=5.0)]
    names = ("b1", "a1", "a2", "b2")
    healthy = [small(name, 3 + k, start=5.0 * (name[0] == "b")) for k, name in enumerate(names)]
    recording, runs = with_healthy(measured, healthy)
    assert recording.source == "a, b"
    assert [run.source for run in runs] == ["a1, b1", "a2, b2"]


def test_healthy_runs_that_do_not_fit_are_refused():
    measured = [small("a", 1), small("b", 2, start=5.0)]
    with pytest.raises(InputError, match="c: none of the measured recordings contains the same"):
        with_healthy(measured, [small("c", 3, start=9.0)])
    with pytest.raises(InputError, match="b has 0 healthy recordings .* a has 1; give equally"):
        with_healthy(measured, [small("a1", 3)])


@pytest.fixture(scope="module")
def files(measured, tmp_path_factory):
    """A recording and a healthy one, each also as two files, cut where all axes move on."""
    folder = tmp_path_factory.mktemp("several")
    for name, effects, seed in (
        ("healthy", [], 1),
        ("worn", [("viscous_friction", 2, 0.3)], 3),
    ):
        whole = measured(effects, seed)
        half = len(whole.torque) // 2
        write_recording(replace(whole, segments=(0, half)), folder / f"{name}.h5")
        for k, rows in enumerate((slice(half), slice(half, None)), start=1):
            arrays = ("position", "torque", "reference_position")
            part = {array: getattr(whole, array)[rows] for array in arrays}
            write_recording(replace(whole, **part), folder / f"{name}{k}.h5")
    return folder


@pytest.mark.slow
def test_two_files_say_what_one_with_both_says(files, tiny_robot_path, tmp_path):
    """The command gives the same result, with the healthy files in the other order."""
    healthy = ["--healthy", files / "healthy2.h5", "--healthy", files / "healthy1.h5"]
    words = ["discover", files / "worn1.h5", files / "worn2.h5", "--robot", tiny_robot_path]
    words += [*healthy, "-o", tmp_path, "--workers", 1, "--json"]
    done = CliRunner().invoke(app, [str(word) for word in words])
    assert done.exit_code == 0, done.output
    several = json.loads(done.stdout)
    one = faultgen.discover(files / "worn.h5", tiny_robot_path, files / "healthy.h5")
    assert [(e["effect"], e["axis"]) for e in one["effects"]] == [("viscous_friction", 2)]
    timed = {"seconds": None}
    assert several | timed == one | timed


def test_calibration_gets_all_files(files, tiny_robot):
    """Its recordings are put together as those of discovery are."""
    both = read_together([files / "worn1.h5", files / "worn2.h5"], tiny_robot)
    whole = read_recording(files / "worn.h5")
    assert both.recording.segments == whole.segments
    assert np.array_equal(both.recording.torque, whole.torque)
    assert not both.runs and not both.warnings


def test_a_file_counts_once(files, tiny_robot):
    """Twice the same file would look like twice the evidence."""
    with pytest.raises(InputError, match="worn1.h5: the same run; give each run once"):
        read_together([files / "worn1.h5", files / "worn2.h5", files / "worn1.h5"], tiny_robot)


def test_what_some_files_lack_is_told(files, tiny_robot, tmp_path):
    """A file without commanded positions makes discovery follow the measured ones of all."""
    bare = replace(read_recording(files / "worn2.h5"), reference_position=None)
    write_recording(bare, tmp_path / "bare.h5")
    both = read_together([files / "worn1.h5", tmp_path / "bare.h5"], tiny_robot)
    assert both.recording.reference_position is None
    (line,) = both.warnings
    assert line == (
        f"reference_position is not used, because it is missing in {tmp_path / 'bare.h5'}"
    )

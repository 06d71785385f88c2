"""Runs of a dataset as recordings."""

import json

import h5py
import numpy as np
import pytest
from typer.testing import CliRunner

import faultgen
from faultgen.cli.app import app
from faultgen.dataset.experiment import Experiment
from faultgen.discovery import read_recording
from faultgen.errors import InputError
from faultgen.recordings.from_runs import recording_of
from faultgen.robot import load_robot
from faultgen.simulation.motion import plan
from faultgen.tasks import load_task


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Run files of a small dataset: healthy and worn, each third sample."""
    folder = tmp_path_factory.mktemp("export") / "data"
    experiment = Experiment(
        robot=["puma560"],
        task=["pick_and_place"],
        axis=[[2]],
        schedule=[0.1, 0.2],
        cycles=2,
        thin=3,
        sensors="realistic",
    )
    faultgen.generate(experiment, folder, workers=1, progress=False)
    return [run.path for run in faultgen.open_dataset(folder).runs]


def invoke(*arguments):
    return CliRunner().invoke(app, [str(one) for one in arguments])


def test_a_recording_holds_what_was_logged_and_no_label(runs, tmp_path):
    out = tmp_path / "measured.h5"
    told = invoke("export", *runs, "-o", out, "--cycle", 1, "--json")
    assert told.exit_code == 0, told.output
    recording = read_recording(out)
    assert json.loads(told.stdout)["samples"] == len(recording.position)
    assert recording.sample_period == pytest.approx(0.012)
    for run, part in zip(runs, recording.parts, strict=True):
        with h5py.File(run) as file:
            np.testing.assert_array_equal(recording.torque[part], file["signals/motor_torque"][0])
            assert np.all(recording.temperature[part] == file["cycle/temperature"][0])
    robot = load_robot("puma560")
    motion = plan(load_task("puma560", "pick_and_place"), robot)
    part = recording.parts[1]
    times = np.arange(part.stop - part.start) * 0.012
    np.testing.assert_allclose(recording.reference_position[part], motion(times)[0], atol=1e-6)
    with h5py.File(out) as file:
        assert not {"severity", "effect", "axis"} & set(file.attrs)


def test_the_last_cycle_is_taken(runs):
    with h5py.File(runs[1]) as file:
        last = file["signals/motor_torque"][1]
    np.testing.assert_array_equal(recording_of([runs[1]]).torque, last)


@pytest.mark.parametrize(
    ("cycle", "message"),
    [(0, "cycle: must be from 1 to 2"), (3, "cycle: must be from 1 to 2 for .*, not 3")],
)
def test_cycles_that_are_not_there_are_refused(runs, cycle, message):
    with pytest.raises(InputError, match=message):
        recording_of(runs, cycle)


def test_files_that_are_no_runs_are_refused(runs):
    merged = runs[0].parents[1] / "dataset.h5"
    told = invoke("export", merged)
    assert isinstance(told.exception, InputError)
    assert "dataset.h5: is not a run; give DATASET/runs/ID.h5" in str(told.exception)

"""`faultgen detect`: what is counted, and what is said where detectors cannot learn.

Also what both `detect` and `isolate` say of runs that are too short.
"""

import re

import numpy as np
import pytest

from faultgen.cli import main
from faultgen.dataset.experiment import make_experiment
from faultgen.dataset.reader import open_dataset
from faultgen.dataset.sweep import generate
from faultgen.errors import InputError
from faultgen.evaluation.detect import detect, detection_table
from faultgen.evaluation.isolators import FRICTION


@pytest.fixture(scope="module")
def made(tiny_robot_path, tiny_task_path, tmp_path_factory):
    def make(name, **changes):
        out = tmp_path_factory.mktemp(name)
        base = {"robot": tiny_robot_path, "task": tiny_task_path, "axis": [1], "cycles": 30}
        generate(make_experiment(base | changes), out, progress=False)
        return open_dataset(out)

    return make


def test_wear_is_detected_and_the_healthy_robot_stands_beside(made):
    """Noise drawn anew: the best detector finds 20 % wear in every draw, seldom the healthy one."""
    result = detect(made("plain"), seeds=4, levels=(0.1, 0.2), progress=False)
    cells = {(row["method"], row["level"]): row for row in result.results}
    assert cells[FRICTION, 0.2]["alarms"] == cells[FRICTION, 0.2]["total"] == 4
    assert cells[FRICTION, 0.0]["alarms"] <= 1
    assert set(result.healthy_cycles.values()) == {300}
    # an alarm stays: by a higher level there are at least as many
    for method in {row["method"] for row in result.results}:
        assert cells[method, 0.1]["alarms"] <= cells[method, 0.2]["alarms"]
    text = detection_table(result)
    assert "300 cycles" in text and "| 20 % (n = 4)" in re.sub(" +", " ", text)


@pytest.mark.slow
def test_stored_noise_learns_from_other_seeds(made):
    """With realistic noise a run is judged by healthy runs of other seeds only."""
    dataset = made("stored", sensors="realistic", repetitions=3, paired=True)
    result = detect(dataset, progress=False)
    assert not result.redrawn and result.seeds == 3
    assert set(result.healthy_cycles.values()) == {60}
    with pytest.raises(InputError, match="'realistic' runs differ in their motion"):
        detect(dataset, sensors="thesis", progress=False)


@pytest.mark.slow
def test_what_is_missing_is_said(made):
    """One seed with stored noise; no healthy run; no torque in the files; other effects."""
    with pytest.raises(InputError, match="of another seed to learn from"):
        detect(made("one", sensors="realistic", paired=True), progress=False)
    with pytest.raises(InputError, match="no healthy run to learn from"):
        detect(made("worn", healthy=False), progress=False)
    bare = detect(made("bare", sensors="realistic", repetitions=3, signals="none"), progress=False)
    assert FRICTION not in {row["method"] for row in bare.results}
    assert any(FRICTION in reason for reason in bare.left_out.values())
    other = detect(made("other", effect="backlash", severity=1e-3), seeds=2, progress=False)
    text = detection_table(other)
    assert "backlash: our isolators look for friction wear" in text
    assert "| 0.001 rad (n = " in re.sub(" +", " ", text)
    assert np.isfinite([row["share"] for row in other.results]).all()


def test_a_detector_that_can_learn_for_some_runs_only(made):
    """A worn run learns from two healthy runs, a healthy run only from the other one."""
    dataset = made("two", sensors="thesis", repetitions=2, cycles=20)
    result = detect(dataset, levels=(0.2,), progress=False)
    methods = {
        level: {row["method"] for row in result.results if row["level"] == level}
        for level in (0.0, 0.2)
    }
    assert methods[0.0] < methods[0.2]
    table = detection_table(result)
    assert len(re.findall(r"\| - +\|$", table, re.MULTILINE)) == len(methods[0.2] - methods[0.0])


@pytest.mark.parametrize("command", ["detect", "isolate"])
@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"cycles": 3}, "at least 5 cycles, the longest run has 3; generate with more --cycles"),
        ({"cycles": 3, "healthy": False}, "at least 5 cycles, the longest run has 3"),
        (
            {"cycles": 8, "healthy": False, "schedule": "constant"},
            "none reaches a severity of 1 %, 5 %, 10 %, 15 % in cycle 5 or later",
        ),
    ],
)
def test_runs_that_are_too_short(made, command, changes, message, monkeypatch, capsys):
    """One line, exit status 2, and no file of results: not an empty table."""
    folder = made("short", **changes).path
    monkeypatch.setattr("sys.argv", ["faultgen", command, str(folder)])
    with pytest.raises(SystemExit) as stopped:
        main()
    assert stopped.value.code == 2
    said = capsys.readouterr()
    assert said.out == "" and said.err.count("\n") == 1
    assert said.err.startswith("faultgen: ") and message in said.err
    assert not [name for name in ("detection", "isolation") if (folder / f"{name}.json").exists()]

"""Datasets that are made in parts, as by several machines that share a folder."""

from pathlib import Path

import pytest
from conftest import contents, faultgen, faultgen_here

from faultgen.dataset.experiment import make_experiment
from faultgen.dataset.reader import open_dataset
from faultgen.dataset.sweep import generate, merge_parts
from faultgen.errors import InputError
from faultgen.system.files import temporary_name


@pytest.fixture
def experiment(tiny_robot_path, tiny_task_path):
    return make_experiment(
        {"robot": tiny_robot_path, "task": tiny_task_path, "axis": [1, 2], "cycles": 2}
        | {"repetitions": 2, "signals": "none"}
    )


def without_locks(folder):
    return {name: told for name, told in contents(folder).items() if ".lock" not in name}


def test_parts_give_the_same_dataset(experiment, tmp_path):
    """Byte by byte; a part can be made again, and leaves unfinished files of others alone."""
    generate(experiment, tmp_path / "whole", progress=False)
    parts = tmp_path / "parts"
    made = [generate(experiment, parts, part=(1, 3), progress=False)]
    others = [run for run in open_dataset(parts).missing]
    unfinished = parts / "runs" / temporary_name(Path(f"{others[0]}.h5")).name
    unfinished.write_text("another machine writes this")
    with pytest.raises(InputError, match="4 of 6 runs are missing"):
        merge_parts(parts)
    again = generate(experiment, parts, part=(1, 3), progress=False)
    assert (again.planned, again.done, again.kept) == (2, 0, 2)
    assert unfinished.exists()
    unfinished.unlink()
    made += [generate(experiment, parts, part=(k, 3), progress=False) for k in (2, 3)]
    assert [one.done for one in made] == [2, 2, 2]
    assert not (parts / "dataset.h5").exists()
    summary = merge_parts(parts)
    assert (summary.planned, summary.kept, summary.failed) == (6, 6, {})
    assert without_locks(parts) == without_locks(tmp_path / "whole")
    assert not open_dataset(parts).damaged()


@pytest.mark.parametrize(
    ("part", "message"),
    [
        ("3", "--part: must be K/N such as 3/10, not '3'"),
        ("0/2", "part: must be K/N with K from 1 to N, not 0/2"),
        ("3/2", "part: must be K/N with K from 1 to N, not 3/2"),
        ("1/2 --keep merged", "part: 2 parts need at least 2 repetitions"),
        ("3/2 --keep merged", "part: must be K/N with K from 1 to N, not 3/2"),
    ],
)
def test_parts_that_cannot_be(tiny_robot_path, tiny_task_path, tmp_path, part, message):
    words = ["generate", "--robot", tiny_robot_path, "--task", tiny_task_path, "-o", "out"]
    words += ["--workers", "1"]
    done = faultgen_here(*words, "--part", *part.split(), cwd=tmp_path)
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert message in done.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_the_commands(tiny_robot_path, tiny_task_path, tmp_path):
    """Two parts and their merger; a folder without a dataset is refused."""
    words = ["--robot", tiny_robot_path, "--task", tiny_task_path, "--cycles", "2", "--axis", "1"]
    for part in ("1/2", "2/2"):
        done = faultgen("generate", *words, "-o", "out", "--part", part, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        assert done.stdout.startswith("out: 1 runs, 1 made now")
    done = faultgen("merge", "out", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout == "out: 2 runs, 0 made now, 2 already present, 0 failed\n"
    assert faultgen("merge", "other", cwd=tmp_path).returncode == 2

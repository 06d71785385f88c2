"""Names of files are shown as text, on the terminal and in pages; links are not followed."""

import os
import shutil

import pytest
from conftest import faultgen_here

from faultgen.dataset.experiment import make_experiment
from faultgen.dataset.sweep import generate
from faultgen.errors import InputError
from faultgen.evaluation.markdown import table
from faultgen.system.arrays import read_arrays, write_arrays
from faultgen.system.files import temporary_name, write_text
from faultgen.system.progress import Progress
from faultgen.system.terminal import LOGGER, note, say, tell, tell_progress, visible

NAME = "a\nfaultgen: b.h5: healthy, probability 1.00\x1b[2K\r\x9b31m\u202e\u2028\udcff"
"""Line breaks, an escape sequence in two forms, a mark of direction, and a byte that is no text."""


def shows_no_control(text):
    """Whether a text has no other special characters than ends of lines."""
    return all(one.isprintable() or one == "\n" for one in text)


def test_special_characters_are_shown_as_python_writes_them():
    """What can be printed is not changed."""
    assert visible("Größe µ [N m] ± 5 °C, × – “x”") == "Größe µ [N m] ± 5 °C, × – “x”"
    assert visible("a\nb\t\x1b[0m\x9b\u202e\u2028\udcff\U000e0001") == (
        r"a\nb\t\x1b[0m\x9b\u202e\u2028\udcff\U000e0001"
    )
    assert shows_no_control(visible(NAME)) and "\n" not in visible(NAME)


def test_lines_stay_lines(capsys):
    """A name with a line break makes no line of its own, on stdout or stderr."""
    say(f"{NAME}: unknown change", "second")
    note(f"{NAME}: no such file")
    out, err = capsys.readouterr()
    assert out.count("\n") == 2 and err.count("\n") == 1
    assert shows_no_control(out) and shows_no_control(err)


@pytest.mark.parametrize(
    "call",
    [
        ("judge", "{}", "new.h5"),
        ("info", "{}"),
        ("import", "{}", "--preset", "ur_rtde"),
        ("discover", "{}", "--robot", "puma560"),
        ("discover", "new.h5", "--robot", "{}"),
        ("calibrate", "{}", "--robot", "puma560"),
        ("twin", "{}", "--robot", "puma560"),
        ("train", "{}"),
        ("export", "{}"),
        ("report", "{}"),
        ("isolate", "{}"),
        ("detect", "{}"),
        ("merge", "{}"),
        ("generate", "{}"),
        ("fleet", "{}"),
        ("robot", "check", "{}"),
        ("robot", "build", "{}"),
        ("list", "tasks", "--robot", "{}"),
        ("{}",),
    ],
)
def test_messages_name_files_in_one_line(call, tmp_path):
    """Whatever command gets the name."""
    done = faultgen_here(*(one.format(NAME) for one in call), cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1 and shows_no_control(done.stderr), done.stderr
    assert shows_no_control(done.stdout)


def test_tables_and_progress_show_names_in_one_line(monkeypatch, capsys):
    """Cells, heads and the name of the work."""
    text = table([NAME], [[NAME], ["b"]])
    assert text.count("\n") == 3 and shows_no_control(text)
    monkeypatch.delenv("TQDM_DISABLE", raising=False)
    monkeypatch.setattr("faultgen.system.progress.FIRST_LINE", 0.0)
    with Progress(f"reading {NAME}", 3):
        pass
    err = capsys.readouterr().err
    assert err.count("\n") == 1 and "reading a" in err and shows_no_control(err)


@pytest.mark.skipif(os.name == "nt", reason="such names do not exist there")
def test_a_robot_with_a_hostile_name(tiny_robot_path, tiny_task_path, tmp_path):
    """Its dataset, list of runs and data card hold the name as text."""
    name = "<img src=x onerror=alert(1)>\n\x1b[31m"
    robot = tmp_path / f"{name}.xml"
    shutil.copy(tiny_robot_path, robot)
    experiment = make_experiment(
        {"robot": str(robot), "task": tiny_task_path, "axis": [1], "cycles": 1}
    )
    generate(experiment, tmp_path / "out", progress=False)
    card = (tmp_path / "out" / "DATACARD.md").read_text()
    assert "<img" not in card and "&lt;img src=x" in card and shows_no_control(card)
    done = faultgen_here("info", tmp_path / "out")
    assert done.returncode == 0 and shows_no_control(done.stdout + done.stderr)


@pytest.mark.skipif(not hasattr(os, "O_NOFOLLOW"), reason="the system has no such flag")
@pytest.mark.parametrize("kind", ["text", "arrays"])
def test_links_under_temporary_names_are_not_followed(tmp_path, kind):
    """What a link leads to is not overwritten; what a killed process left is replaced."""
    path, precious = tmp_path / "new.h5", tmp_path / "precious"
    precious.write_text("keep me")
    for before in ("link", "file"):
        if before == "link":
            temporary_name(path).symlink_to(precious)
        else:
            temporary_name(path).write_text("left behind, and longer than what is written now")
        if kind == "text":
            write_text(path, "new")
            assert path.read_text() == "new"
        else:
            write_arrays(path, {}, {"seed": 1})
            assert read_arrays(path) == ({}, {"seed": 1})
        assert precious.read_text() == "keep me" and not path.is_symlink()
        assert not temporary_name(path).exists()


def test_a_folder_under_a_temporary_name_is_one_line(tmp_path):
    """Nothing is written, and the message says why."""
    path = tmp_path / "new.txt"
    temporary_name(path).mkdir()
    with pytest.raises((InputError, OSError), match="new.txt"):
        write_text(path, "new")
    assert not path.exists()


def test_messages_of_the_library_go_to_its_logger(caplog, capsys, monkeypatch):
    """A program decides what becomes of them; nothing is printed beside."""
    monkeypatch.setattr(LOGGER, "handlers", [])
    monkeypatch.setattr(LOGGER, "propagate", True)
    tell("one file is\ndamaged")
    with caplog.at_level("INFO", logger="faultgen"):
        tell_progress("done")
    assert [r.getMessage() for r in caplog.records] == ["one file is\\ndamaged", "done"]
    assert capsys.readouterr() == ("", "")

"""Robots that are monitored: a configuration, what is judged, the page and the table."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from conftest import faultgen_here
from recorded import record

from faultgen.errors import InputError
from faultgen.recordings.read import read_recording
from faultgen.recordings.recording import write_recording
from faultgen.system.dates import date_of
from faultgen.twin.followed import in_units
from faultgen.twin.monitor import PAGE, TABLE, Monitor, load_monitor
from faultgen.twin.together import together

WEAR = (0.0, 0.0, 0.05, 0.1, 0.15, 0.2)
"""Wear of the robot that wears, on each day."""


@pytest.fixture(scope="module")
def place(twin, tiny_robot, tiny_task_path, tmp_path_factory):
    """Two robots with six recordings each, one of which wears, and their configuration."""
    folder = tmp_path_factory.mktemp("monitor")
    for robot, worn in (("fine", False), ("worn", True)):
        (folder / robot).mkdir()
        for day, size in enumerate(WEAR):
            effects = [("friction_wear", 2, size)] if worn else []
            one = record(tiny_robot, tiny_task_path, 200 + day + 50 * worn, effects)
            date = date_of(f"2026-03-{day + 1:02d}T08:00")
            write_recording(replace(one, date=date), folder / robot / f"day{day}.h5")
    config = folder / "monitor.toml"
    config.write_text(
        "".join(
            f'[[robot]]\nname = "{name}"\nlimits = {{ friction_wear = 0.4 }}\n'
            f'[[robot.program]]\ndetector = "{twin[0] / "detector"}"\nfolder = "{name}"\n'
            for name in ("fine", "worn")
        )
    )
    return folder


@pytest.fixture(scope="module")
def out(place):
    """What the command wrote."""
    done = faultgen_here("monitor", place / "monitor.toml", "--once", "-o", place / "out")
    assert done.returncode == 0, done.stderr
    assert "2 robots, 1 with an alarm" in done.stdout
    return place / "out"


def test_the_robot_that_wears_is_told_with_its_axis_and_its_future(out):
    fine, worn = json.loads((out / TABLE).read_text())
    assert fine["sentence"] == "fine, fine: healthy (6 recordings)"
    assert (worn["answer"]["effect"], worn["answer"]["axes"]) == ("friction_wear", [2])
    assert worn["answer"]["since"][:10] in ("2026-03-03", "2026-03-04")
    assert worn["answer"]["severity"] == pytest.approx(0.2, rel=0.3) and worn["limit"] == 0.4
    early, usual, late = worn["days_until_limit"]
    assert 0 < early <= usual and (late is None or usual <= late)
    assert re.match(r"worn, worn, axis 2: friction_wear of \S+ % \[", worn["sentence"])


def test_the_page_has_a_map_sentences_and_charts_and_needs_no_network(out):
    text = (out / PAGE).read_text()
    assert "1 alarm" in text and "worn, worn, axis 2: friction_wear" in text
    charts = [
        json.loads(one)
        for one in re.findall(r'<script type="application/json">(.*?)</script>', text, re.S)
    ]
    kinds = [chart["traces"][0]["type"] for chart in charts]
    assert kinds == ["scatter", "scatter", "heatmap"]
    course, torque, heat = charts
    assert [t["name"] for t in course["traces"]][-1] == "limit"
    assert torque["traces"][-1]["name"] == "this recording"
    assert np.array(heat["traces"][0]["z"]).argmax() == 3  # second robot, second axis
    assert not re.findall(r'(?:src|href)="http', text)


def test_what_was_judged_is_not_judged_again_and_new_files_are(place, out, tiny_robot):
    told = []
    one = Monitor(
        load_monitor(place / "monitor.toml"),
        out,
        tell=lambda robot, program, answer: told.append((robot, answer["recordings"])),
        settled=0.0,
    )
    assert one.look() == 0
    content = (place / "fine" / "day0.h5").read_bytes()
    (place / "fine" / "copy.h5").write_bytes(content)
    (place / "fine" / "half.h5").write_bytes(content[: len(content) // 2])
    assert one.look() == 0  # the same content, and no complete file
    (place / "fine" / "half.h5").unlink()
    later = (place / "worn" / "day1.h5").read_bytes()
    (place / "fine" / "later.h5").write_bytes(later)
    assert one.look() == 1 and told == [("fine", 3)]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "robot: Field required"),
        ("x = [", "is no valid TOML"),
        ('[[robot]]\nname = "a"\n', "robot.0.program: Field required"),
        (2 * '[[robot]]\nname="a"\n[[robot.program]]\ndetector="d"\nfolder="f"\n', "listed twice"),
        (
            '[[robot]]\nname="a"\nlimits={rust=1}\n[[robot.program]]\ndetector="d"\nfolder="f"\n',
            "unknown effect 'rust'",
        ),
        (
            '[[robot]]\nname="a"\n' + 2 * '[[robot.program]]\nname="p"\ndetector="d"\nfolder="f"\n',
            "two programs 'p'",
        ),
    ],
)
def test_a_configuration_that_is_wrong_is_one_line(tmp_path, text, words):
    path = tmp_path / "monitor.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=re.escape(words)) as caught:
        load_monitor(path)
    assert "\n" not in str(caught.value)


def test_a_missing_folder_of_recordings_is_named(place, tmp_path):
    path = tmp_path / "monitor.toml"
    path.write_text((place / "monitor.toml").read_text())
    with pytest.raises(InputError, match="robot 'fine': .*no such folder of recordings"):
        Monitor(load_monitor(path), tmp_path / "out")


def test_a_robot_is_repaired_in_the_memory_of_a_monitor(place, out, twin):
    done = faultgen_here(
        "judge", twin[0] / "detector", "--repaired", "2026-03-05T12:00", "--state",
        out / "monitor.sqlite", "--robot", "worn", "--program", "worn",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    one = Monitor(load_monitor(place / "monitor.toml"), out)
    assert len(one.followed[1].judge.history()[0]) == 1


@pytest.mark.parametrize(
    ("severity", "unit", "words"),
    [(0.0625, "1", "6.2 %"), (2e-4, "rad", "0.2 mrad"), (3.14, "kg", "3.1 kg")],
)
def test_severities_are_written_with_their_units(severity, unit, words):
    assert in_units(severity, unit) == words


def test_programs_of_one_robot_are_put_together(place, out, tmp_path):
    """Wear in one program only: the healthy recordings of the other speak against it."""
    detector = re.search(r'detector = "(.*)"', (place / "monitor.toml").read_text())[1]
    config = tmp_path / "two.toml"
    config.write_text(
        '[[robot]]\nname = "worn"\n'
        + "".join(
            f'[[robot.program]]\ndetector = "{detector}"\nfolder = "{place / name}"\n'
            for name in ("worn", "fine")
        )
    )
    monitor = Monitor(load_monitor(config), tmp_path / "out", settled=0.0)
    monitor.look()
    monitor.write()
    (robot,) = json.loads((tmp_path / "out" / TABLE).read_text())
    of_worn, of_fine = robot["programs"]
    assert of_worn["answer"]["verdict"] == "fault" and not of_fine["answer"]["alarm"]
    answer = robot["answer"]
    assert set(answer["programs"]) == {"worn", "fine"}
    assert answer["recordings"] > of_fine["answer"]["recordings"] - 2
    assert answer["severity"] < of_worn["answer"]["severity"]
    assert "worn, fine: healthy" in (tmp_path / "out" / PAGE).read_text()


def test_the_same_fault_in_two_programs_is_as_severe_and_surer(place, out, tmp_path):
    text = (place / "monitor.toml").read_text()
    detector = re.search(r'detector = "(.*)"', text)[1]
    (tmp_path / "again").mkdir()
    for path in sorted((place / "worn").glob("day*.h5")):
        one = read_recording(path)
        late = replace(one, date=one.date + 60.0, torque=one.torque * (1 + 1e-9))
        write_recording(late, tmp_path / "again" / path.name)
    config = tmp_path / "two.toml"
    config.write_text(
        '[[robot]]\nname = "worn"\n'
        + "".join(
            f'[[robot.program]]\ndetector = "{detector}"\nfolder = "{folder}"\n'
            for folder in (place / "worn", tmp_path / "again")
        )
    )
    monitor = Monitor(load_monitor(config), tmp_path / "out", settled=0.0)
    monitor.look()
    (robot,) = monitor.robots()
    one = robot.programs[0].answer
    assert (robot.answer["effect"], robot.answer["axes"]) == ("friction_wear", [2])
    assert robot.answer["probability"] >= one["probability"] - 1e-9
    single = together([robot.programs[0], robot.programs[0]])
    assert single["recordings"] == robot.answer["recordings"]
    assert robot.answer["severity"] == pytest.approx(single["severity"], rel=1e-3)
    assert robot.sentence().startswith("worn, axis 2: friction_wear")
    assert robot.course is not None


def test_judge_writes_a_page(place, out, twin, tmp_path):
    state, page = tmp_path / "state.sqlite", tmp_path / "page.html"
    files = sorted((place / "worn").glob("day*.h5"))
    done = faultgen_here("judge", twin[0] / "detector", *files, "--state", state, "--page", page)
    assert done.returncode == 0, done.stderr
    assert "1 alarm" in page.read_text() and "friction_wear" in page.read_text()
    page.unlink()
    again = faultgen_here("judge", twin[0] / "detector", "--state", state, "--page", page)
    assert again.returncode == 0 and "1 alarm" in page.read_text()
    wrong = faultgen_here("judge", twin[0] / "detector", "--page", tmp_path)
    assert wrong.returncode == 2 and "must be a file" in wrong.stderr

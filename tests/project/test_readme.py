import re
import subprocess
import sys
from pathlib import Path

from conftest import HANG

from faultgen.dataset.wear import SCHEDULES
from faultgen.effects import EFFECTS
from faultgen.fleet.events import event_names
from faultgen.monitoring.sensors import SENSORS
from faultgen.robot import load_robot, robot_names
from faultgen.simulation.motion import plan
from faultgen.tasks import load_task, task_names

ROOT = Path(__file__).parents[2]


def test_the_python_examples_of_the_readme_run(tmp_path):
    """What the README shows works as it stands."""
    codes = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    printed = []
    for code in codes:
        code = code.replace("benchmarks/example.toml", str(ROOT / "benchmarks" / "example.toml"))
        done = subprocess.run(
            [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=HANG
        )
        assert done.returncode == 0, done.stderr
        printed.append(done.stdout)
    generated, isolated = printed
    assert isolated.startswith("[False  True]") and isolated.endswith("[False False]\n")
    assert generated.startswith("1 [")


def test_the_task_example_of_the_docs_can_be_planned(tmp_path):
    """The task in docs/robots.md works on the robot that it is for."""
    texts = re.findall(r"```toml\n(.*?)```", (ROOT / "docs" / "robots.md").read_text(), re.DOTALL)
    (text,) = (one for one in texts if "[start]" in one)
    path = tmp_path / "boxes.toml"
    path.write_text(text)
    motion = plan(load_task("puma560", path), load_robot("puma560"))
    assert 1 < motion.period < 20


def test_numbers_and_names_in_the_docs_are_those_of_the_package():
    """The effects, kinds of events and choices that pages count or list."""
    pages = [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]
    text = "\n".join(page.read_text() for page in pages)
    assert set(re.findall(r"(?:\| effect \||catalogue has) (\d+) effects", text)) == {
        str(len(EFFECTS))
    }
    assert set(re.findall(r"(\d+) kinds of events", text)) == {str(len(event_names()))}
    readme = (ROOT / "README.md").read_text()
    for row, names in (
        ("robot", robot_names()),
        ("task", {name for robot in robot_names() for name in task_names(robot)}),
        ("schedule", SCHEDULES),
        ("sensors", SENSORS),
    ):
        (line,) = re.findall(rf"^\| {row} \| (.*)$", readme, re.MULTILINE)
        told = set(re.findall(r"`(\w+)`", line.replace("`3`", "`chapter3_task2` `chapter3_task3`")))
        assert told == set(names), row


def test_discovery_tells_which_effects_it_never_considers():
    """The lists are those of the catalogue."""
    text = (ROOT / "docs" / "discovery_details.md").read_text()
    for use, begins in (("never", "Some effects"), ("on request", "`viscous_asymmetry`")):
        (line,) = re.findall(rf"^- ({begins}.*?(?:sensor_stuck|on request))", text, re.MULTILINE)
        told = set(re.findall(r"`?(\w+_\w+)`?", line))
        assert told == {name for name, effect in EFFECTS.items() if effect.prior.use == use}


def test_links_lead_somewhere():
    """Every relative link of README and docs has its file."""
    for page in [ROOT / "README.md", *(ROOT / "docs").glob("*.md"), *ROOT.glob("robots/*/*.md")]:
        for target in re.findall(r"\]\((?!http)([^)#]+)", page.read_text()):
            assert (page.parent / target).is_file(), (page.name, target)

import re
import subprocess
import sys
from pathlib import Path

from conftest import HANG

from faultgen.robot import load_robot
from faultgen.simulation.motion import plan
from faultgen.tasks import load_task

ROOT = Path(__file__).parents[1]


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
    (text,) = re.findall(r"```toml\n(.*?)```", (ROOT / "docs" / "robots.md").read_text(), re.DOTALL)
    path = tmp_path / "boxes.toml"
    path.write_text(text)
    motion = plan(load_task("puma560", path), load_robot("puma560"))
    assert 1 < motion.period < 20


def test_links_lead_somewhere():
    """Every relative link of README and docs has its file."""
    for page in [ROOT / "README.md", *(ROOT / "docs").glob("*.md"), *ROOT.glob("robots/*/*.md")]:
        for target in re.findall(r"\]\((?!http)([^)#]+)", page.read_text()):
            assert (page.parent / target).is_file(), (page.name, target)

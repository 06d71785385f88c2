"""The examples of docs/extending.md, as they stand on the page."""

import json
import os
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from conftest import HANG

PAGE = (Path(__file__).parents[2] / "docs" / "extending.md").read_text()


def blocks():
    """Text of each file that the page shows, by its name; blocks of one file are put together."""
    files = {}
    for text in re.findall(r"```(?:python|toml|xml)\n(.*?)```", PAGE, re.DOTALL):
        name = re.match(r"(?:#|<!--) (\S+)", text).group(1)
        files[name] = files.get(name, "") + text
    return files


def commands():
    """Every command of the page, in its order."""
    (text,) = re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL)
    return [shlex.split(line) for line in text.splitlines()]


def install(site, files):
    """Put the module of the page into a folder, with its entry points, as pip would."""
    project = tomllib.loads(files["pyproject.toml"])["project"]
    info = site / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
    info.mkdir(parents=True)
    for name in ("my_effects.py", "my_methods.py"):
        (site / name).write_text(files[name])
    (info / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n"
    )
    lines = []
    for group, points in project["entry-points"].items():
        lines += [f"[{group}]", *(f"{name} = {value}" for name, value in points.items())]
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with every file of the page, and the package installed beside it."""
    out = tmp_path_factory.mktemp("extending")
    files = blocks()
    for name in ("arm.xml", "swing.toml", "my_classifier.py"):
        (out / name).write_text(files[name])
    install(out / "site", files)
    return out


def run(folder, command, *more):
    """Run one command of the page in the folder, with the package installed."""
    assert command[0] == "faultgen"
    return subprocess.run(
        [sys.executable, "-m", "faultgen.cli", *command[1:], *more],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=HANG,
        env={**os.environ, "PYTHONPATH": str(folder / "site")},
    )


def results_of(folder, datasets):
    """What the commands on some datasets print as JSON, by name and dataset."""
    found = {}
    for command in commands():
        if command[-1] in datasets:
            done = run(folder, command, "--json")
            assert done.returncode == 0, done.stderr
            found[command[1], command[-1]] = json.loads(done.stdout)
    return found


@pytest.fixture(scope="module")
def results(folder):
    """What the commands on the dataset of the worn robot print."""
    return results_of(folder, ["worn"])


@pytest.mark.slow
def test_the_effect_of_the_page_is_simulated(folder):
    """Two processes simulate it, on both axes; the dataset is in order."""
    results = results_of(folder, ["grease"])
    assert results["generate", "grease"]["planned"] == 3
    assert not results["generate", "grease"]["failed"]
    listed = json.loads(run(folder, ["faultgen", "effects"], "--json").stdout)
    assert "thick_grease" in {row["effect"] for row in listed}
    done = run(folder, ["faultgen", "info", "grease"], "--json")
    assert {row["effect"] for row in json.loads(done.stdout)["runs"]} == {"healthy", "thick_grease"}


@pytest.mark.slow
def test_the_isolator_of_the_page_names_the_worn_axis(results):
    """Beside the others, and better than chance at 15 % wear; a healthy robot is left alone."""
    rows = {(r["method"], r["level"]): r for r in results["isolate", "worn"]["results"]}
    assert len({method for method, _ in rows}) == 8
    assert rows["largest change", 0.15]["accuracy"] > 0.8
    assert rows["largest change", 0.0]["named"] <= rows["largest change", 0.0]["total"] / 4


@pytest.mark.slow
def test_the_detector_of_the_page_raises_alarms(results):
    """Beside the others: worn runs raise an alarm up to 15 % wear more often than healthy ones."""
    rows = {(r["method"], r["level"]): r for r in results["detect", "worn"]["results"]}
    assert len({method for method, _ in rows}) == 8
    worn, healthy = (rows["largest deviation", level]["share"] for level in (0.15, 0.0))
    assert worn > 0.5 > healthy


@pytest.mark.slow
def test_the_classifier_of_the_page_is_compared(folder):
    """In ten lines, beside the others, on test runs only; it is better than chance."""
    code = blocks()["my_classifier.py"].strip().splitlines()[1:]
    assert sum(bool(line.strip()) for line in code) <= 10
    found = results_of(folder, ["noisy"])["isolate", "noisy"]
    rows = {(r["method"], r["level"]): r for r in found["results"]}
    assert len({method for method, _ in rows}) == 9 and found["split"] == "run"
    # of each kind of run 2 of 8 are tested, and the others learned from
    assert {row["total"] for (_, level), row in rows.items() if level == 0.15} == {4}
    assert rows["random forest", 0.15]["accuracy"] >= 0.5


@pytest.mark.slow
def test_the_study_of_the_page_compares_the_isolator(folder):
    """The whole quick study of the robot of the page has it in its table and in its figure."""
    (command,) = [one for one in commands() if one[1] == "study"]
    done = run(folder, command)
    assert done.returncode == 0, done.stderr
    assert "largest change" in (folder / "study" / "tables.md").read_text()


def test_every_file_is_counted():
    """The files that the page names for this repository exist."""
    root = Path(__file__).parents[2]
    for name in ("benchmarks/pages/effect_cases.py", "docs/effects.md", "faultgen/effects/base.py"):
        assert name in PAGE and (root / name).is_file()
    for name, table in (("isolators", "ISOLATORS"), ("detectors", "DETECTORS")):
        path = root / "faultgen" / "evaluation" / f"{name}.py"
        assert f"faultgen/evaluation/{name}.py" in PAGE
        assert f"{table} = registered(" in path.read_text()

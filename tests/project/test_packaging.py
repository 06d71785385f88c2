"""What is installed claims only the name faultgen, and works beside a user's own files."""

import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
BUILD = "import sys; from setuptools import build_meta as b; print(getattr(b, sys.argv[1])('dist'))"
USE = """
import sys
from pathlib import Path
import faultgen, faultgen.robots
from faultgen.analysis import net_transfer_entropy
from faultgen.importing import load_map, preset_names
from faultgen.report.page import page
from faultgen.robot import load_robot, robot_names
from faultgen.tasks import task_names
assert all(load_robot(name).n_axes for name in robot_names())
assert callable(net_transfer_entropy)
assert "<html" in page("base.html")
assert [load_map(None, name) for name in preset_names()]
assert (Path(faultgen.__file__).parent / "py.typed").is_file()
names = ("wear", "faults", "run_to_failure", "fleet")
data = [Path(faultgen.__file__).parent / "datasets" / "data" / name for name in names]
assert all((one / "README.md").is_file() for one in data)
assert all((one / "dataset.h5").is_file() or (one / "robots").is_dir() for one in data)
print(Path(faultgen.__file__).parent)
print(*(f"{robot}/{task}" for robot in robot_names() for task in task_names(robot)))
"""
TASKS = {f"{path.parts[-3]}/{path.stem}" for path in ROOT.glob("robots/*/tasks/*.toml")}


@pytest.fixture
def own_files(tmp_path):
    """A folder of a user who has files with the names of ours."""
    folder = tmp_path / "own"
    (folder / "robots").mkdir(parents=True)
    (folder / "analysis.py").write_text("raise SystemExit('the wrong analysis was imported')")
    (folder / "robots" / "__init__.py").write_text("raise SystemExit('the wrong robots')")
    (folder / "use.py").write_text(USE)
    return folder


def use(folder, path=None):
    """Where a script in the folder finds faultgen, with every task of every robot."""
    environment = dict(os.environ)
    if path is not None:
        environment["PYTHONPATH"] = str(path)
    command = [sys.executable, "use.py"]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    place, tasks = done.stdout.splitlines()
    assert set(tasks.split()) == TASKS != set()
    return Path(place)


def build(source, what):
    """Build a wheel or an sdist of a source folder; the file."""
    command = [sys.executable, "-c", BUILD, what]
    done = subprocess.run(command, cwd=source, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return source / "dist" / done.stdout.splitlines()[-1]


def unpacked(wheel, folder):
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder)
    return folder


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    """A copy of the files that belong to the repository."""
    folder = tmp_path_factory.mktemp("source")
    for part in ("faultgen", "analysis", "robots"):
        ignored = shutil.ignore_patterns("__pycache__", "*.egg-info")
        shutil.copytree(ROOT / part, folder / part, ignore=ignored)
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copyfile(ROOT / name, folder / name)
    return folder


def test_the_installation_used_here_works_beside_own_files(own_files):
    """The editable installation finds its parts in the repository."""
    assert use(own_files) == ROOT / "faultgen"


def test_the_wheel_works_beside_own_files(source, own_files, tmp_path):
    """A wheel holds one top-level name and all data files."""
    folder = unpacked(build(source, "build_wheel"), tmp_path / "site")
    names = {path.name for path in folder.iterdir() if not path.name.endswith(".dist-info")}
    assert names == {"faultgen"}
    assert use(own_files, folder) == folder / "faultgen"
    assert (folder / "faultgen" / "robots" / "puma560" / "README.md").is_file()


@pytest.mark.slow
def test_the_sdist_builds_the_same_wheel(source, own_files, tmp_path):
    """From the source distribution, a wheel with the same files can be built."""
    with tarfile.open(build(source, "build_sdist")) as archive:
        archive.extractall(tmp_path / "sdist", filter="data")
    (inside,) = (tmp_path / "sdist").iterdir()
    again = unpacked(build(inside, "build_wheel"), tmp_path / "site")
    first = unpacked(build(source, "build_wheel"), tmp_path / "first")
    listed = [
        {str(path.relative_to(folder)) for path in (folder / "faultgen").rglob("*")}
        for folder in (again, first)
    ]
    assert listed[0] == listed[1]
    assert use(own_files, again) == again / "faultgen"


def test_lock_file_holds_every_dependency_within_its_bounds_and_with_checksums():
    """What `make install` installs is what pyproject.toml asks for."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    asked = [Requirement(one) for one in project["dependencies"]]
    asked += [Requirement(one) for one in project["optional-dependencies"]["dev"]]
    entries = re.split(r"^(?=[a-z0-9])", (ROOT / "requirements.lock").read_text(), flags=re.M)
    locked = {}
    for entry in filter(str.strip, entries):
        name, version = re.match(r"([a-z0-9.-]+)(?:\[.*?\])?==([^ ]+)", entry).groups()
        assert "--hash=sha256:" in entry, name
        locked.setdefault(name, []).append(version)
    for one in asked:
        versions = locked[canonicalize_name(one.name)]
        assert all(one.specifier.contains(version) for version in versions), one

"""Effects, isolators and detectors that a user's own package adds."""

import json
import os
import subprocess
import sys

import pytest
from conftest import faultgen

from faultgen.effects import Effect, Prior
from faultgen.errors import InputError

RUST = """
from faultgen.effects import Effect, Prior


def _edit(spec, axis, severity):
    spec.actuator(f"friction{axis}").damping[0] *= 1 + severity


EFFECTS = [
    Effect(
        name="rust",
        description="viscous friction grows",
        unit="fraction of nominal (0.1 = 10 % more)",
        signature="torque in proportion to speed",
        element="damping of the friction element",
        source="made up for a test",
        prior=Prior(std=0.05, steps=(0.1,)),
        edit=_edit,
    )
]
"""


def test_an_edit_that_fails_is_told_in_one_line(tiny_robot):
    """A user's own edit may name an element that the robot does not have."""

    def edit(spec, axis, severity):
        spec.actuator("nowhere").damping[0] *= 1 + severity

    facts = {"description": "-", "unit": "-", "signature": "-", "element": "-", "source": "-"}
    prior = Prior(std=0.05, steps=(0.1,))
    broken = Effect(name="rust", **facts, prior=prior, edit=edit)
    with pytest.raises(InputError, match="effect rust: its edit fails on axis 2 .*: Attribute"):
        broken.apply(tiny_robot.spec(), 2, 0.1)


@pytest.fixture
def package(tmp_path):
    """A folder with an installed package that adds an effect."""
    site = tmp_path / "site"
    info = site / "my_rust-1.0.dist-info"
    info.mkdir(parents=True)
    (site / "my_rust.py").write_text(RUST)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: my-rust\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[faultgen.effects]\nrust = my_rust:EFFECTS\n")
    return site


def with_package(site, *arguments):
    return faultgen(*arguments, variables={"PYTHONPATH": str(site)})


@pytest.mark.slow
def test_an_effect_of_another_package_works_with_several_workers(
    package, tiny_robot_path, tiny_task_path, tmp_path
):
    """It is listed, simulated in worker processes and labelled; its code is part of the version."""
    listed = json.loads(with_package(package, "effects", "--json").stdout)
    assert "rust" in {row["effect"] for row in listed}
    arguments = ["--robot", tiny_robot_path, "--task", tiny_task_path, "--cycles", 2]
    arguments += ["--axis", "1,2", "--effect", "rust", "--workers", 2, "-o", tmp_path / "out"]
    done = with_package(package, "generate", *arguments)
    assert done.returncode == 0, done.stderr
    said = json.loads(with_package(package, "info", tmp_path / "out", "--json").stdout)
    assert [row["effect"] for row in said["runs"]] == ["healthy", "rust", "rust"]
    assert said["complete"]
    assert said["intact"]
    # another law: the runs that are there are not mixed with new ones
    module = package / "my_rust.py"
    module.write_text(RUST.replace("1 + severity", "1 + 2 * severity"))
    done = with_package(package, "generate", *arguments)
    assert done.returncode == 2
    assert "were made by" in done.stderr


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("import Effect", "import Effects"), "my_rust:EFFECTS: cannot be loaded (ImportError"),
        (('name="rust"', 'name="backlash"'), "my_rust:EFFECTS: an effect 'backlash' exists"),
        (("EFFECTS = [", "EFFECTS = [3, "), "my_rust:EFFECTS: must be an Effect or a list"),
    ],
)
def test_packages_that_cannot_be_used_are_named(package, change, message):
    """One line with the entry point, exit status 2."""
    module = package / "my_rust.py"
    module.write_text(module.read_text().replace(*change))
    done = with_package(package, "effects")
    assert done.returncode == 2
    assert message in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("first", ["my_rust", "faultgen.effects", "faultgen.effects.prior"])
def test_the_module_of_an_effect_can_be_imported_in_any_order(package, first):
    """A user's own tests import it, before anything of faultgen."""
    code = f"import {first}; import my_rust; from faultgen.effects import EFFECTS, get_effect\n"
    code += "assert get_effect('rust') is EFFECTS['rust'] is my_rust.EFFECTS[0]"
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": str(package)},
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("text", [None, pytest.param("1 / 0", marks=pytest.mark.slow)])
def test_a_package_without_its_module_is_named_where_it_is_needed(package, text, tmp_path):
    """One line names the package; commands that need no effects work."""
    (package / "my_rust.py").unlink()
    if text is not None:
        (package / "my_rust.py").write_text(text)
    for arguments in (
        ["effects"],
        ["generate", "--robot", "puma560", "--task", "spot_weld", "-o", tmp_path / "out"],
    ):
        done = with_package(package, *arguments)
        assert done.returncode == 2
        assert done.stderr.startswith("faultgen: entry point my_rust:EFFECTS: cannot be loaded (")
        assert done.stderr.endswith("; correct or uninstall the package 'my-rust'\n")
        assert done.stderr.count("\n") == 1
    done = with_package(package, "robots")
    assert done.returncode == 0, done.stderr
    done = with_package(package, "info", tmp_path)
    assert "is not a dataset" in done.stderr


METHODS = """
import numpy as np

from faultgen.evaluation import Detector, Isolator


class Last(Isolator):
    name = "always the last"
    features = ("motor_torque", "temperature")
    learns = False

    def fit(self, torque, temperature):
        assert torque == temperature == []

    def isolate(self, torque, temperature):
        assert torque.ndim == 3 and len(torque) == len(temperature)
        return torque.shape[2] - 1


class Level(Detector):
    name = "level"
    features = ("mean_abs_torque",)

    def fit(self, torque):
        self.limit_ = float(np.nan_to_num(np.vstack(torque)).max())

    def score(self, torque):
        return np.nan_to_num(torque).max(axis=1)
"""

STUDIES = """
import json, sys
from pathlib import Path
from faultgen.studies.chapter3_detection import study as detection
from faultgen.studies.chapter6_isolation import study as isolation

if __name__ == "__main__":
    robot, task, out, workers = sys.argv[1:]
    given = {"robots": (robot,), "tasks": (task,), "seed": 1, "workers": int(workers)}
    small = isolation.Size(reference=5, healthy=2, worn=1, pairs=0)
    one = isolation.run_isolation(Path(out), size=small, **given)
    small = detection.Size(seeds=1, months=1)
    two = detection.run_detection(Path(out), size=small, **given)
    print(json.dumps({"isolation": one["isolation"], "detectors": two["detectors"]}))
"""


@pytest.fixture
def methods(tmp_path):
    """A folder with an installed package that adds an isolator and a detector."""
    site = tmp_path / "site"
    info = site / "my_methods-1.0.dist-info"
    info.mkdir(parents=True)
    (site / "my_methods.py").write_text(METHODS)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: my-methods\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[faultgen.isolators]\nlast = my_methods:Last\n\n[faultgen.detectors]\nlevel = "
        "my_methods:Level\n"
    )
    return site


@pytest.mark.slow
def test_studies_compare_methods_of_another_package_with_several_workers(
    methods, tiny_robot_path, tiny_task_path, tmp_path
):
    """Signals and reductions reach them; one process or two give the same results."""
    script = tmp_path / "studies.py"
    script.write_text(STUDIES)
    found = []
    for workers in (1, 2):
        arguments = [tiny_robot_path, tiny_task_path, tmp_path / "out", workers]
        done = subprocess.run(
            [sys.executable, str(script), *map(str, arguments)],
            capture_output=True,
            text=True,
            env={**os.environ, "PYTHONPATH": str(methods)},
        )
        assert done.returncode == 0, done.stderr
        found.append(json.loads(done.stdout))
    assert found[0] == found[1]
    last = [row for row in found[0]["isolation"] if row["method"] == "always the last"]
    assert len(last) == 3 * 4 and all(row["by_axis"] == [0, 1] for row in last)
    level = [row for row in found[0]["detectors"] if row["detector"] == "level"]
    assert level and all(row["located"] is None for row in level)


@pytest.mark.slow
def test_results_name_the_code_of_another_package(methods, tiny_robot_path, tiny_task_path):
    """Another version of an isolator gives another provenance; runs do not depend on it."""
    code = (
        "from faultgen import plugins; from faultgen.provenance import provenance\n"
        "print(provenance('faultgen.evaluation.isolate', plugins.ISOLATORS).key)\n"
        "print(provenance('faultgen.dataset.run').key)"
    )

    def keys():
        environment = {**os.environ, "PYTHONPATH": str(methods)}
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, env=environment)
        return done.stdout.split()

    before = keys()
    module = methods / "my_methods.py"
    module.write_text(module.read_text().replace("- 1", "- 2"))
    after = keys()
    assert before[0] != after[0] and before[1] == after[1]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("def isolate", "def isolated"), "my_methods.Last has no method 'isolate'"),
        pytest.param(
            ("def fit(self, torque, t", "def fitted(self, t, t"),
            "my_methods.Last has no method 'fit'",
            marks=pytest.mark.slow,
        ),
        (('"temperature")', '"warmth")'), "my_methods.Last: there is no feature 'warmth': choose"),
        pytest.param(
            ('    name = "always the last"', ""),
            "my_methods.Last has no name",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            ("always the last", "CC"),
            "my_methods.Last: the name 'CC' exists",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            ("Last(Isolator)", "Last"),
            "must be a subclass of faultgen.evaluation.Isolator",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_isolators_that_cannot_be_used_are_named(methods, change, message):
    """One line with the entry point and the class, exit status 2."""
    module = methods / "my_methods.py"
    changed = module.read_text().replace(*change)
    assert changed != module.read_text()
    module.write_text(changed)
    done = with_package(methods, "isolate", methods)
    assert done.returncode == 2
    assert done.stderr.startswith("faultgen: entry point my_methods:Last: ")
    assert message in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ((".max(axis=1)", ""), r"my_methods.Level: score must return shape (12,), not (12, 2)"),
        (("self.limit_", "self.limit"), "my_methods.Level: fit must set limit_ to a number"),
        (("np.nan_to_num(torque).max", "np.nan * torque.max"), "score must not return nan"),
    ],
)
@pytest.mark.slow
def test_wrong_scores_are_named(
    methods, change, message, tiny_robot_path, tiny_task_path, tmp_path_factory
):
    """One line with the class, exit status 2."""
    out = tmp_path_factory.getbasetemp() / "scored"
    arguments = ["--robot", tiny_robot_path, "--task", tiny_task_path, "--cycles", 12]
    done = with_package(methods, "generate", *arguments, "--axis", 1, "-o", out, "--workers", 1)
    assert done.returncode == 0, done.stderr
    module = methods / "my_methods.py"
    changed = module.read_text().replace(*change)
    assert changed != module.read_text()
    module.write_text(changed)
    done = with_package(methods, "detect", out, "--seeds", 1)
    assert done.returncode == 2
    assert message in done.stderr
    assert done.stderr.count("\n") == 1

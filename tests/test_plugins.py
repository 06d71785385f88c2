"""Effects that a user's own package adds."""

import json

import pytest
from conftest import faultgen

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

"""Torque limits that are placeholders, and drives that cannot belong to their arm."""

import json
import re

import mujoco
import numpy as np
import pytest
from plain_arm import NAMES, urdf
from typer.testing import CliRunner

from faultgen.building.build import build
from faultgen.building.check import check
from faultgen.building.doubts import drive_doubts, weight_warnings
from faultgen.building.drives import Drives
from faultgen.building.limits import disbelieved_limits
from faultgen.building.resonance import sampled_poses
from faultgen.building.seen import loads
from faultgen.building.usual import usual_torque
from faultgen.cli.app import app
from faultgen.robot import load_robot
from faultgen.simulation.arm import Arm

EVERYWHERE = [(f'effort="{effort}"', 'effort="100"') for effort in (120, 160, 80, 25, 20, 12)]


def scaled(text, mass, length=1.0):
    """The arm with all masses, and all lengths, times a factor."""

    def times(factor):
        return lambda found: f'{found[1]}="{float(found[2]) * factor:.6g}"'

    text = re.sub(r'(<mass value)="([^"]*)"', times(mass), text)
    text = re.sub(r'(i[xyz][xyz])="([^"]*)"', times(mass * length**2), text)
    return re.sub(
        r'xyz="([^"]*)"/><(mass|axis)',
        lambda found: (
            ('xyz="' + " ".join(f"{float(x) * length:.6g}" for x in found[1].split()) + '"/><')
            + found[2]
        ),
        text,
    )


def drives_of(made):
    """Numbers of the drives of a robot at the joints, each of shape (6,)."""
    value = lambda name: np.array([one[name].value for one in made.values])  # noqa: E731
    n = value("gear_ratio")
    return {
        "torque": value("torque_limit"),
        "rotor": value("rotor_inertia") * n**2,
        "coulomb": value("coulomb_friction") * n,
    }


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A small arm of 3 kg with 100 N m on every axis, and what is built from it."""
    path = tmp_path_factory.mktemp("small") / "small.urdf"
    path.write_text(scaled(urdf(*EVERYWHERE), 1 / 6))
    return path, build(path, Drives(joints=list(NAMES)), "small")


def test_the_same_limit_on_every_axis_of_a_small_arm_is_not_used(small):
    """The rotor had 16 to 1650 times the inertia of such arms, and friction up to 12 N m."""
    path, made = small
    found = drives_of(made)
    poses = sampled_poses(made.robot.joint_range, made.robot.slides, 64)
    inertia = loads(Arm(made.robot).model, poses).inertia.max(axis=0)
    assert (found["rotor"] < 10 * inertia).all()
    assert found["coulomb"].max() < 2.0
    assert found["torque"][0] < 50 and found["torque"][5] < 10
    assert all(one["torque_limit"].source == "assumed" for one in made.values)
    (line,) = [one for one in made.warnings if "placeholder" in one]
    assert all(f"'{name}'" in line for name in NAMES) and "state torque_limit" in line
    assert made.drives.count("the limit of the model, 100, is not used, because it is") == 6
    plain = check(str(path))
    assert line in plain.warnings


def test_check_repeats_that_limits_were_not_used(small, tmp_path):
    _, made = small
    made.write(tmp_path / "small")
    done = CliRunner().invoke(app, ["robot", "check", str(tmp_path / "small"), "--json"])
    content = json.loads(done.stdout)
    assert content["fit"] and done.exit_code == 0
    assert any("placeholders are not used" in one for one in content["warnings"])
    assert "faultgen: warning: torque limits of the model that look like" in done.stderr


def test_a_limit_that_the_user_gives_is_used(small):
    path, _ = small
    made = build(path, Drives(all={"torque_limit": 100.0}), "given")
    assert (drives_of(made)["torque"] == 100).all()
    assert not any("placeholder" in one for one in made.warnings)
    findings, warnings = drive_doubts(made.robot)
    told = [*(f"{one.where} {one.what}" for one in findings), *warnings]
    assert any("axis 6 (yaw) has a torque limit of 100 N m, 2" in one for one in told)


def test_heavy_links_are_warned_of(tmp_path):
    """Links of 4.9 t: a torque limit of 166 kN m was assumed for such an arm without a word."""
    path = tmp_path / "heavy.urdf"
    path.write_text(scaled(re.sub(r'effort="\d+"', 'effort="0"', urdf()), 275, 3.0))
    made = build(path, Drives(joints=list(NAMES)), "heavy")
    assert drives_of(made)["torque"].max() < 80e3  # 1.5 times what holds them
    line = "the moving links weigh 4895 kg"
    assert any(one.startswith(line) for one in made.warnings)
    made.write(tmp_path / "heavy")
    assert any(one.startswith(line) for one in check(str(tmp_path / "heavy")).warnings)
    assert any(one.startswith(line) for one in check(str(path)).warnings)


LEVERS = np.array([60.0, 60.0, 15.0, 1.5])


@pytest.mark.parametrize(
    ("efforts", "disbelieved"),
    [
        ([120, 120, 60, 15], []),  # as drives of such arms have them
        ([120, 120, 60, 100], []),
        ([120, 120, 60, 150], [3]),
        ([100, 100, 100, 100], [0, 1, 2, 3]),
        ([50, 50, 50, 50], []),
        ([20, 20, 20, 20], [0, 1, 2, 3]),  # the same everywhere, and too weak for the second
        ([100, 100, None, 100], [0, 1, 3]),
        ([120, 20, 60, 15], [1]),  # cannot hold the arm
        ([None] * 4, []),
    ],
)
def test_placeholders_are_told_from_limits(efforts, disbelieved):
    gravity = np.array([0.0, 60.0, 15.0, 1.5])
    reasons = disbelieved_limits(list("abcd"), efforts, LEVERS, gravity)
    assert [k for k, reason in enumerate(reasons) if reason] == disbelieved


def test_the_same_limit_can_be_right():
    """Small arms with the same actuator everywhere, and arms of two axes."""
    usual = usual_torque(0.05, 1.0)
    weights = np.array([1.0, 1.0, 0.4, 0.05])
    assert not any(disbelieved_limits(list("abcd"), [2 * usual] * 4, weights, 0 * weights))
    assert not any(disbelieved_limits(list("ab"), [9.0, 9.0], np.ones(2), np.ones(2)))


@pytest.fixture(scope="module")
def healthy(tmp_path_factory):
    path = tmp_path_factory.mktemp("arm") / "arm.urdf"
    path.write_text(urdf())
    return path, build(path, Drives(), "healthy").robot


@pytest.mark.parametrize("name", ["puma560", "irb6700", "built"])
def test_robots_with_usual_drives_are_not_doubted(name, healthy):
    robot = healthy[1] if name == "built" else load_robot(name)
    assert drive_doubts(robot) == ([], [])


def edited(robot, change):
    spec = robot.spec()
    change(spec)
    return robot.edited(spec)


def rotor(factor, axis):
    def change(spec):
        body = spec.body(f"rotor{axis}")
        body.inertia = np.array(body.inertia) * factor

    return change


def friction(factor, axis):
    def change(spec):
        element = spec.actuator(f"friction{axis}")
        law = np.array(element.biasprm)
        law[3:5] *= factor
        element.biasprm = law

    return change


def torque(factor, axis):
    def change(spec):
        element = spec.actuator(f"drive{axis}")
        element.forcerange = np.array(element.forcerange) * factor

    return change


@pytest.mark.parametrize(
    ("change", "axis", "words", "impossible"),
    [
        (rotor(80, 2), 2, "times the inertia of all that the axis carries", False),
        (rotor(400, 2), 2, "times the inertia of all that the axis carries", True),
        (rotor(2000, 6), 6, "times the inertia of all that the axis carries", True),
        (torque(8, 1), 1, "times what drives of such an arm have", False),
        (torque(60, 3), 3, "times what drives of such an arm have", True),
        (friction(8, 3), 3, "its Coulomb friction is 45% of its torque limit", False),
        (friction(20, 4), 4, "is not below its torque limit", True),
    ],
)
def test_drives_that_do_not_fit_to_the_arm_are_found(change, axis, words, impossible, healthy):
    """What is doubtful is a warning; what cannot be true makes the robot unfit."""
    findings, warnings = drive_doubts(edited(healthy[1], change))
    where = f"axis {axis} ({NAMES[axis - 1]})"
    if impossible:
        assert any(one.where == where and words in one.what and one.remedy for one in findings)
    else:
        assert not findings
        assert any(one.startswith(where) and words in one for one in warnings)


@pytest.mark.slow
def test_an_impossible_rotor_makes_a_robot_unfit(healthy, tmp_path):
    """From drives.toml to the exit status of `check`."""
    drives, out = tmp_path / "drives.toml", tmp_path / "odd"
    drives.write_text("[axis.yaw]\nrotor_inertia = 0.05\n")
    run = CliRunner().invoke
    done = run(app, ["robot", "build", str(healthy[0]), str(drives), "-o", str(out)])
    assert done.exit_code == 0, done.output
    done = run(app, ["robot", "check", str(out)])
    assert done.exit_code == 1
    assert "finding: axis 6 (yaw): has a rotor with" in done.stdout


@pytest.mark.parametrize(("masses", "count"), [((2.0,) * 4, 1), ((2.0,) * 3 + (1.9,), 0)])
def test_equal_masses_are_placeholders(masses, count):
    """As in public models of large arms that state 2 kg for each link."""
    text = "".join(
        f'<body pos="0 0 0.3"><joint axis="0 1 0"/><geom size="0.1" mass="{m}"/>' for m in masses
    )
    xml = f"<mujoco><worldbody>{text}{'</body>' * len(masses)}</worldbody></mujoco>"
    found = weight_warnings(mujoco.MjModel.from_xml_string(xml))
    assert len(found) == count
    assert all("4 moving links all weigh 2 kg" in line for line in found)

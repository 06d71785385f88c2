"""The check of robots and plain models: everything that is wrong at once, each with a remedy."""

import json

import pytest
from plain_arm import NAMES, TETRAHEDRON, urdf
from typer.testing import CliRunner

from faultgen.building.check import check
from faultgen.cli.app import app
from faultgen.robot import load_robot


def run(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def changed(robot, *changes):
    """Text of a robot's model with other text in it."""
    text = robot.xml
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return text


def test_a_supplied_robot_is_fit():
    found = check("irb6700")
    assert found.fit and found.complete and not found.warnings
    assert set(found.tasks) == {"pick_and_place", "spot_weld", "arc_weld"}
    assert found.largest_timestep > found.timestep
    assert 0 < found.trial["largest torque, as a share of its limit"] < 0.85


def test_a_robot_without_tasks_makes_a_small_move(tiny_robot_path):
    found = check(tiny_robot_path)
    assert found.fit and not found.tasks
    assert 0 < found.trial["largest lag of a joint [rad]"] < 0.01


SHORT = '<body name="link2" pos="0.4 0 0">', '<body name="link2" pos="400 0 0">'
FAULTY = {
    "a step above the stable one": (
        [('timestep="0.001"', 'timestep="0.01"')],
        {"timestep": "above the largest stable one", "simulation": "diverged"},
    ),
    "stiff bristles": (
        [('lugre="20 0.1 0.2', 'lugre="20000 2 0.2')],
        {"friction1": "its bristles are too stiff for a step of 0.001 s"},
    ),
    "a torque limit below the weight": (
        [('saturation="2 0 0"', 'saturation="0.02 0 0"')],
        {"axis 2": "needs 1.96 N m to hold the arm, but its torque limit is 1 N m"},
    ),
    "millimetres": (
        [SHORT, ('pos="0.1 0 0" mass="1"', 'pos="0.1 0 0" mass="9000"')],
        {"arm": "is 400 m long", "link 'link2'": "has the mass 9000 kg"},
    ),
    "degrees as radians": (
        [('axis="0 1 0" range="-3 3"', 'axis="0 1 0" range="-170 170"')],
        {"joint 'joint2'": "turns by 340 rad, which is 54 turns"},
    ),
    "radians as degrees": (
        [('range="-3 3"', 'range="-0.05 0.05"')],
        {"joints": "none turns by more than 5.7 deg"},
    ),
    "another integrator": (
        [('integrator="Euler"', 'integrator="implicit"')],
        {"integrator": "is not Euler"},
    ),
    "no tool": ([('<site name="tool"/>', "")], {"site 'tool'": "is missing"}),
    "grams times millimetres": (
        [('diaginertia="0.02 0.02 0.02"', 'diaginertia="90 90 90"')],
        {"link 'link2'": "its inertia is that of its mass at a distance of 9.49 m"},
    ),
}


@pytest.mark.parametrize("case", FAULTY)
def test_faults_of_a_robot_are_found(case, tiny_robot, tmp_path):
    changes, wanted = FAULTY[case]
    path = tmp_path / "tiny.xml"
    path.write_text(changed(tiny_robot, *changes))
    found = check(str(path))
    assert not found.fit
    for where, what in wanted.items():
        assert any(one.where == where and what in one.what for one in found.findings), where
        assert all(one.remedy for one in found.findings)


def test_nothing_stops_at_the_first_finding(tiny_robot, tmp_path):
    """Three faults at once give three findings, status 1, and the same as JSON."""
    names = ("a step above the stable one", "degrees as radians", "a torque limit below the weight")
    path = tmp_path / "tiny.xml"
    path.write_text(changed(tiny_robot, *(one for name in names for one in FAULTY[name][0])))
    done = run("robot", "check", path, "--json")
    content = json.loads(done.stdout)
    assert done.exit_code == 1 and content["fit"] is False
    assert {"timestep", "joint 'joint2'", "axis 2"} <= {one["where"] for one in content["findings"]}


def test_a_task_out_of_reach_is_found(tiny_robot, tmp_path):
    task = 'description = "far"\n[start]\njoints = [0, 0]\n[[move]]\njoints = [400, 0]\n'
    tiny_robot.write(tmp_path / "tiny")
    (tmp_path / "tiny" / "tasks").mkdir()
    (tmp_path / "tiny" / "tasks" / "far.toml").write_text(task)
    assert list(load_robot(tmp_path / "tiny").tasks) == ["far"]
    found = check(str(tmp_path / "tiny"))
    (one,) = found.findings
    assert one.where == "task far" and "axis 1 at 400 is outside" in one.what


def test_missing_elements_are_findings_of_their_own(tiny_robot, tmp_path):
    path = tmp_path / "tiny.xml"
    changes = [('name="friction2"', 'name="rubbing"'), ('data="300 300"', 'data="300"')]
    path.write_text(changed(tiny_robot, *changes))
    done = run("robot", "check", path)
    assert done.exit_code == 1
    assert "no actuator named 'friction2'" in done.stdout


def test_a_plain_model_is_told_what_it_lacks(tmp_path):
    """All of its faults, and what `robot build` would add."""
    (tmp_path / "hull.obj").write_text(TETRAHEDRON)
    mesh = '<visual><geometry><mesh filename="hull.obj" scale="900 900 900"/></geometry></visual>'
    path = tmp_path / "arm.urdf"
    path.write_text(
        urdf(
            ('<link name="pan_link">', f'<link name="pan_link">{mesh}'),
            ('izz="0.0003"', 'izz="0.01"'),
            ('lower="-2.6" upper="2.6" effort="160"', 'lower="-150" upper="150" effort="160"'),
        )
    )
    done = run("robot", "check", path)
    assert done.exit_code == 1
    for words in (
        "its 6 axes have other names than joint1 to joint6: pan, lift, elbow",
        "lacks 6 rotors (motor1, ...), gearboxes, drives and friction elements",
        "run 'faultgen robot build'",
        "link 'yaw_link': no body has its principal inertias",
        "joint 'lift': turns by 300 rad",
        "m large, but the arm is 0.94 m long; it is probably in millimetres",
    ):
        assert words in done.stdout


def test_fatal_findings_of_a_plain_model_do_not_hide_the_others(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(
        urdf(('<mass value="4.0"/>', '<mass value="0"/>'), ('izz="0.0003"', 'izz="0.01"'))
    )
    found = check(str(path))
    where = {one.where for one in found.findings}
    assert {"link 'elbow_link'", "link 'yaw_link'", "model"} <= where


def test_a_file_that_cannot_be_read_is_one_finding(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text("<robot")
    (one,) = check(str(path)).findings
    assert "not valid XML" in one.what


def test_unknown_robots_are_bad_input():
    done = run("robot", "check", "r2d2")
    assert "unknown robot 'r2d2'" in str(done.exception)


@pytest.mark.slow
def test_a_built_robot_is_checked_with_the_names_of_its_file(tmp_path):
    """Findings name the joint of the user's file beside the number of the axis."""
    (tmp_path / "arm.urdf").write_text(urdf())
    drives = tmp_path / "drives.toml"
    drives.write_text("timestep = 0.01\n[axis.lift]\ntorque_limit = 40\n")
    out = tmp_path / "arm"
    assert run("robot", "build", tmp_path / "arm.urdf", drives, "-o", out).exit_code == 0
    done = run("robot", "check", out)
    assert "finding: axis 2 (lift): needs" in done.stdout
    assert "finding: friction3 (elbow): its bristles" in done.stdout
    assert [row.split()[:2] for row in done.stdout.splitlines()[1:7]] == [
        [str(k), name] for k, name in enumerate(NAMES, start=1)
    ]


def test_numbers_have_units(tmp_path):
    """Those of the drives of a plain model, which depend on whether the joint turns or slides."""
    (tmp_path / "arm.urdf").write_text(urdf())
    slide = urdf(('name="elbow" type="revolute"', 'name="elbow" type="prismatic"'))
    (tmp_path / "slide.urdf").write_text(slide)
    done = run("robot", "check", tmp_path / "arm.urdf")
    assert "torque_limit [N m]" in done.stdout and "speed_limit [rad/s]" in done.stdout
    assert "m/s]" not in done.stdout
    done = run("robot", "check", tmp_path / "slide.urdf", "--json")
    third = json.loads(done.stdout)["axes"][2]
    assert third["torque_limit [N]"] == 80 and third["speed_limit [m/s]"] == 3.5

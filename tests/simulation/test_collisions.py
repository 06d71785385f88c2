"""Collisions of an arm with itself and the floor, and motions for controllers."""

import csv
import json
import re

import numpy as np
import pytest
from plain_arm import urdf
from typer.testing import CliRunner

from faultgen.building.build import build
from faultgen.building.drives import Drives
from faultgen.cli.app import app
from faultgen.discovery.planning.motion_library import library
from faultgen.errors import InputError
from faultgen.robot import load_robot
from faultgen.robot_formats.motions import motion_text
from faultgen.simulation.collisions import Collisions
from faultgen.simulation.motion import plan
from faultgen.tasks import load_task

PLANAR = """
<robot name="planar"><link name="base"/>{}</robot>
"""
LINK = """
<link name="l{k}"><inertial><origin xyz="0.2 0 0"/><mass value="2"/><inertia ixx="0.01" iyy="0.03"
  izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial><collision><origin xyz="0.2 0 0"/><geometry><box
  size="0.3 0.04 0.04"/></geometry></collision></link>
<joint name="j{k}" type="revolute"><parent link="{parent}"/><child link="l{k}"/><origin
  xyz="{x} 0 {z}"/><axis xyz="0 1 0"/><limit lower="-2.9" upper="2.9" effort="300" velocity="2"/>
</joint>
"""


@pytest.fixture(scope="module")
def planar(tmp_path_factory):
    """Three links of 0.4 m in a vertical plane, the first axis 0.5 m above the base."""
    path = tmp_path_factory.mktemp("planar") / "planar.urdf"
    parents = ("base", "l1", "l2")
    links = [
        LINK.format(k=k + 1, parent=parents[k], x=0.4 * (k > 0), z=0.5 * (k == 0)) for k in range(3)
    ]
    path.write_text(PLANAR.format("".join(links)))
    return build(path, Drives(), "planar").robot


def test_a_folded_arm_collides_with_itself_and_a_lowered_one_with_the_floor(planar):
    """Closed form: link 3 crosses link 1 if the other two axes turn by 137.5 deg each."""
    space = Collisions(planar, 0.0)
    up = -np.pi / 2
    assert space.is_free(np.array([up, 0.0, 0.0]))
    assert space.touching(np.array([up, 2.4, 2.4])) == [("link 1", "link 3")]
    assert space.is_free(np.array([up, 1.2, 1.2]))
    # straight down from 0.5 m, links of 0.4 m reach the floor, and only links 2 and 3
    down = space.touching(np.array([np.pi / 2, 0.0, 0.0]))
    assert down == [("floor", "link 2"), ("floor", "link 3")]
    assert Collisions(planar).is_free(np.array([np.pi / 2, 0.0, 0.0]))


def test_tasks_of_a_built_arm_are_free_of_collisions(planar):
    """In shapes that are rebuilt here: boxes as points along their middle lines."""
    assert sorted(planar.tasks) == ["arc_weld", "pick_and_place", "spot_weld"]
    along = np.linspace(0.05, 0.35, 31)
    for name in planar.tasks:
        motion = plan(load_task(planar.name, name, planar.tasks), planar)
        way, _, _ = motion(np.arange(0, motion.period, 0.02))
        angle = np.cumsum(way, axis=1)
        ahead = np.stack([np.cos(angle), -np.sin(angle)], axis=-1)
        starts = np.cumsum(np.concatenate([0 * ahead[:, :1], 0.4 * ahead[:, :2]], 1), axis=1)
        points = starts[:, :, None] + along[:, None] * ahead[:, :, None]
        first, third = points[:, 0, :, None], points[:, 2, None, :]
        assert np.linalg.norm(first - third, axis=-1).min() > 0.035, name
        assert points[..., 1].min() > -0.5, name


@pytest.mark.parametrize("name", ["puma560", pytest.param("irb6700", marks=pytest.mark.slow)])
def test_motions_of_a_plan_are_free_of_collisions(name):
    robot = load_robot(name)
    space = Collisions(robot, 0.0)
    assert 0.5 < space.share_free() < 1
    for motion in library(robot, np.random.default_rng(3)):
        way, _, _ = motion(np.arange(0, motion.period, 0.05))
        assert all(space.is_free(pose) for pose in way), motion.task.name


@pytest.fixture(scope="module")
def weld():
    return plan(load_task("puma560", "spot_weld"), load_robot("puma560"))


def test_a_motion_as_csv_is_the_planned_one(weld):
    rows = list(csv.reader(motion_text(weld, "csv", 0.01).splitlines()))
    assert rows[0][:3] == ["time [s]", "joint1 position [rad]", "joint2 position [rad]"]
    data = np.array(rows[1:], dtype=float)
    position, velocity, acceleration = weld(data[:-1, 0])
    np.testing.assert_allclose(data[:-1, 1:7], position, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(data[:-1, 7:13], velocity, rtol=1e-7, atol=1e-10)
    np.testing.assert_allclose(data[:-1, 13:], acceleration, rtol=1e-7, atol=1e-10)
    assert data[-1, 0] == pytest.approx(weld.period) and np.diff(data[:, 0]).min() > 0
    np.testing.assert_allclose(data[-1, 1:7], data[0, 1:7], atol=1e-8)


def test_a_motion_as_ros2_message(weld):
    """Times of the points increase to the period, and speeds are the slope of the positions."""
    message = json.loads(motion_text(weld, "ros2", 0.004))
    assert list(message) == ["header", "joint_names", "points"]
    points = message["points"]
    stamps = [p["time_from_start"] for p in points]
    times = np.array([one["sec"] + 1e-9 * one["nanosec"] for one in stamps])
    assert times[0] == 0 and times[-1] == pytest.approx(weld.period, abs=1e-9)
    positions = np.array([p["positions"] for p in points])
    velocities = np.array([p["velocities"] for p in points])
    middle = (velocities[1:] + velocities[:-1]) / 2
    slope = np.diff(positions, axis=0) / np.diff(times)[:, None]
    np.testing.assert_allclose(slope[:-1], middle[:-1], atol=1e-3)


def test_a_motion_as_urscript(weld, planar):
    text = motion_text(weld, "urscript", 0.008)
    assert text.splitlines()[2] == "def spot_weld():" and text.endswith("stopj(2.0)\nend\n")
    start = re.search(r"movej\(\[(.*?)\]", text)
    first = [float(x) for x in start.group(1).split(",")]
    np.testing.assert_allclose(first, weld(np.zeros(1))[0][0], atol=1e-6)
    assert text.count("servoj(") == int(np.ceil(weld.period / 0.008))
    with pytest.raises(InputError, match="needs an arm with six hinges"):
        name = "spot_weld"
        motion_text(plan(load_task("planar", name, planar.tasks), planar), "urscript", 0.008)


@pytest.mark.parametrize(
    ("form", "period", "match"), [("pdf", 0.01, "must be csv, ros2, urscript"), ("csv", 5, "0.001")]
)
def test_wrong_formats_are_refused(weld, form, period, match):
    with pytest.raises(InputError, match=match):
        motion_text(weld, form, period)


def test_the_command_writes_motions(tmp_path):
    out = tmp_path / "motions"
    words = ["tasks", "--robot", "puma560", "--task", "spot_weld", "--write", str(out), "--json"]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    (row,) = json.loads(result.stdout)
    assert row["file"] == str(out / "puma560_spot_weld.csv")
    assert (out / "puma560_spot_weld.csv").read_text().startswith("time [s],")


def test_shapes_that_always_overlap_are_no_collision(tmp_path):
    """A wrist whose shapes are larger than its links."""
    ball = '<collision><geometry><sphere radius="0.3"/></geometry></collision>'
    changes = [
        (f'<link name="{name}_link">', f'<link name="{name}_link">{ball}')
        for name in ("roll", "pitch", "yaw")
    ]
    (tmp_path / "arm.urdf").write_text(urdf(*changes))
    robot = build(tmp_path / "arm.urdf", Drives(), "fat").robot
    assert Collisions(robot).share_free() == 1.0

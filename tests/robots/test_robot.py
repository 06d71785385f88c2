import re

import numpy as np
import pytest
from IPython.core.formatters import format_display_data

from faultgen.applied import Applied
from faultgen.errors import InputError
from faultgen.robot import load_robot
from faultgen.simulation.nominal import nominal


def test_numbers_come_from_the_file():
    """Gear ratios keep their sign; limits are those of thesis table 3.1 over the gear ratio."""
    puma = load_robot("puma560")
    np.testing.assert_allclose(
        puma.gear_ratio, [-62.6111, 107.815, -53.7063, 76.0364, 71.923, 76.686], rtol=1e-6
    )
    np.testing.assert_allclose(
        puma.motor_torque_limit * np.abs(puma.gear_ratio), [120, 200, 100, 22, 22, 21], rtol=1e-4
    )
    irb = load_robot("irb6700")
    speeds = np.degrees(irb.motor_velocity_limit / irb.gear_ratio)
    np.testing.assert_allclose(speeds, [110, 110, 110, 190, 150, 210], rtol=1e-3)
    assert irb.n_axes == puma.n_axes == 6


def test_a_path_loads_like_a_name(tiny_robot):
    """A robot of one's own has its file's name and as many axes as it has joints."""
    assert tiny_robot.name == "tiny"
    assert tiny_robot.n_axes == 2
    np.testing.assert_allclose(tiny_robot.gear_ratio, [100, -50])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('name="joint1"', 'name="elbow"', "MuJoCo cannot read the model"),
        ('"motor2" coef="-0.02"', '"motor1" coef="-0.02"', "'gearbox2' must have coef 1/n on mot"),
        ('name="drive2"', 'name="driver"', "no actuator named 'drive2'"),
        ('data="300 300"', 'data="300"', "numeric 'motor_velocity_limit' has 1 values, not 2"),
        ("</mujoco>", "", "not valid XML: no element found"),
    ],
)
def test_wrong_files_are_refused_in_one_line(tiny_robot, tmp_path, old, new, message):
    """The message names the robot and the element."""
    path = tmp_path / "broken.xml"
    path.write_text(tiny_robot.xml.replace(old, new))
    with pytest.raises(InputError, match=message) as error:
        load_robot(path)
    assert str(error.value).startswith(("robot broken: ", f"robot file {path}: "))
    assert "\n" not in str(error.value)


def test_unknown_robots_are_refused_with_the_choices():
    """The message names the robots that there are."""
    with pytest.raises(InputError, match="unknown robot 'r2d2': choose irb6700, puma560"):
        load_robot("r2d2")


def test_joints_may_be_without_limits_and_without_friction(tiny_robot, tiny_task_path, tmp_path):
    """A joint that turns for ever and a frictionless motor are fine; histograms span the task."""
    path = tmp_path / "free.xml"
    text = tiny_robot.xml.replace('lugre="20 0.1 0.2 0.3 5"', 'lugre="0 0 0 0 0"')
    first = re.search(r'<joint name="joint1"[^>]*>', text)[0]
    path.write_text(text.replace(first, re.sub(r' range="[^"]*"', "", first)))
    free = load_robot(str(path))
    assert np.isinf(free.joint_range).tolist() == [[True, True], [False, False]]
    limits = nominal(str(path), tiny_task_path, 0.004).limits
    low, high = np.degrees(limits.angle[0])
    assert (low, high) == pytest.approx((-48, 48), abs=0.5)  # 20 % more than the swing to 40 deg


def test_what_a_task_needs_does_not_depend_on_the_controller(tiny_robot, tiny_task_path, tmp_path):
    """Noise, windows and histograms are also right where only positions are commanded."""
    path = tmp_path / "plain.xml"
    numbers = '<numeric name="servo_set_points" data="1 0 0"/></custom>'
    path.write_text(tiny_robot.xml.replace("</custom>", numbers))
    assert load_robot(str(path)).set_points.tolist() == [1, 0, 0]
    (tmp_path / "full.xml").write_text(tiny_robot.xml)
    only, full = (
        nominal(str(tmp_path / f"{one}.xml"), tiny_task_path, 0.004) for one in ("plain", "full")
    )
    for name in ("mean_torque", "speed", "position"):
        np.testing.assert_array_equal(getattr(only, name), getattr(full, name))
    assert (only.mean_torque > 0).all() and not only.control.any(axis=0).all()
    for name in ("angle", "speed", "torque"):
        np.testing.assert_array_equal(getattr(only.limits, name), getattr(full.limits, name))


def test_a_robot_is_shown_in_one_line_and_in_notebooks_as_a_table():
    robot = load_robot("puma560")
    assert repr(robot) == "Robot('puma560', 6 axes)"
    worn = robot.with_effects([Applied("delay", 2, 0.004)])
    assert repr(worn) == "Robot('puma560', 6 axes, with delay of axis 2)"
    shown, _ = format_display_data(robot)
    assert shown["text/html"].count("<tr>") == 7

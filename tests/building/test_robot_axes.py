"""Which joints of a plain model become axes: no gripper, and nothing that only follows."""

import mujoco
import numpy as np
import pytest
from plain_arm import NAMES, urdf

from faultgen.building.build import build
from faultgen.building.check import check
from faultgen.building.drives import Drives
from faultgen.building.plain import plain_arm
from faultgen.errors import InputError

NAME_THEM = "name all axes in drives.toml, joints = [...]"


def finger(name, parent="yaw_link", more="", kind="prismatic", upper=0.04):
    """URDF of a link with a joint `name`."""
    return (
        f'<link name="{name}_part"><inertial><mass value="0.1"/><inertia ixx="1e-4" iyy="1e-4" '
        'izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{name}_part"/>'
        f'<axis xyz="0 1 0"/><limit lower="0" upper="{upper}" effort="20" velocity="0.2"/>{more}'
        "</joint>"
    )


def fixed(name, parent="yaw_link"):
    """URDF of a link that is fixed to another one."""
    return (
        f'<link name="{name}"/><joint name="to_{name}" type="fixed"><parent link="{parent}"/>'
        f'<child link="{name}"/></joint>'
    )


def with_parts(*parts):
    return urdf(("</robot>", "".join(parts) + "</robot>"))


FOLLOWS = '<mimic joint="{}" multiplier="{}"/>'
GRIPPERS = {
    "a finger": [finger("finger_joint")],
    "two fingers": [finger("left_finger"), finger("right_finger")],
    "a finger that follows": [
        finger("finger_1"),
        finger("finger_2", more=FOLLOWS.format("finger_1", 1)),
    ],
    "a pair of slides": [finger("a7"), finger("a8")],
    "one hinge": [finger("gripper", kind="revolute", upper=0.8)],
    "a part that is called hand": [finger("hand", kind="revolute", upper=0.8)],
    "beyond the flange": [fixed("tool0"), finger("a7", "tool0", kind="revolute", upper=0.8)],
    "knuckles": [
        finger("left_knuckle", kind="revolute", upper=0.8),
        finger(
            "left_tip", "left_knuckle_part", FOLLOWS.format("left_knuckle", -1), "revolute", 0.8
        ),
    ],
}


@pytest.mark.parametrize("case", GRIPPERS)
def test_the_gripper_is_no_axis(case, tmp_path):
    """It is locked, and a line says so and what to do, in `build` and in `check`."""
    path = tmp_path / "arm.urdf"
    path.write_text(with_parts(*GRIPPERS[case]))
    arm = plain_arm(path)
    assert arm.joints == NAMES
    (line,) = [note for note in arm.notes if "taken for" in note]
    assert NAME_THEM in line and "\n" not in line
    assert line in check(str(path)).warnings


def test_a_gripper_can_be_an_axis(tmp_path):
    """The user has the last word."""
    path = tmp_path / "arm.urdf"
    path.write_text(with_parts(*GRIPPERS["a finger"]))
    assert plain_arm(path, [*NAMES, "finger_joint"]).joints == (*NAMES, "finger_joint")


def test_a_short_slide_at_the_end_is_told(tmp_path):
    """A single one without a telling name may be the quill of a small arm."""
    path = tmp_path / "arm.urdf"
    path.write_text(with_parts(finger("a7")))
    arm = plain_arm(path)
    assert arm.joints == (*NAMES, "a7")
    assert any("'a7' slides by 0.04 m only" in note for note in arm.notes)
    path.write_text(with_parts(finger("a7", upper=0.3)))
    assert not any("slides by" in note for note in plain_arm(path).notes)


def test_an_arm_whose_joints_are_all_called_so_has_axes(tmp_path):
    """A hand alone."""
    path = tmp_path / "arm.urdf"
    names = [(f'name="{name}" type', f'name="finger_{name}" type') for name in NAMES]
    path.write_text(urdf(*names))
    assert plain_arm(path).joints == tuple(f"finger_{name}" for name in NAMES)


def following(name, leader):
    """Text of the arm, of which one joint follows another one."""
    start = f'name="{name}" type="revolute">'
    return urdf((start, start + FOLLOWS.format(leader, -1)))


def test_a_joint_that_follows_within_the_chain_is_no_axis(tmp_path):
    """One line says so; the user can lock it or give it a motor."""
    path = tmp_path / "arm.urdf"
    path.write_text(following("elbow", "lift"))
    with pytest.raises(InputError, match=r"joint 'elbow': follows joint 'lift' \(<mimic>") as no:
        build(path, Drives(), "x")
    assert "carries the axis 'roll'" in str(no.value) and "joints = [...]" in str(no.value)
    assert "\n" not in str(no.value)
    without = [name for name in NAMES if name != "elbow"]
    assert plain_arm(path, without).joints == tuple(without)
    arm = plain_arm(path, NAMES)
    assert arm.joints == NAMES
    assert any("gets a motor of its own" in note for note in arm.notes)


def test_a_joint_that_follows_at_the_end_is_locked(tmp_path):
    """The arm is that without the joint, as MuJoCo sees it with the joint at zero."""
    path = tmp_path / "arm.urdf"
    path.write_text(following("yaw", "pitch"))
    arm = plain_arm(path)
    assert arm.joints == NAMES[:-1]
    assert any("'yaw' follows 'pitch'" in note and NAME_THEM in note for note in arm.notes)
    model = mujoco.MjSpec.from_string(arm.xml).compile()
    whole = mujoco.MjModel.from_xml_string(urdf())
    small, large = np.zeros((5, 5)), np.zeros((6, 6))
    for one, matrix in ((model, small), (whole, large)):
        data = mujoco.MjData(one)
        mujoco.mj_forward(one, data)
        mujoco.mj_fullM(one, data, matrix)
    np.testing.assert_allclose(small, large[:5, :5], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("leader", ["nobody", "elbow"])
def test_a_joint_that_follows_nothing_is_no_axis_either(leader, tmp_path):
    """MuJoCo ignores such a <mimic>; within the chain the user decides, at the end it is locked."""
    path = tmp_path / "arm.urdf"
    path.write_text(following("elbow", leader))
    with pytest.raises(InputError, match=rf"joint 'elbow': follows joint '{leader}'"):
        plain_arm(path)
    assert plain_arm(path, NAMES).joints == NAMES
    path.write_text(following("yaw", leader))
    assert plain_arm(path).joints == NAMES[:-1]


def test_many_branches_are_told_in_one_short_line(tmp_path):
    """A legged robot has as many as legs."""
    parts = [
        finger(f"leg{k}", "pan_link", kind="revolute", upper=1) + finger(f"toe{k}", f"leg{k}_part")
        for k in range(4)
    ]
    path = tmp_path / "arm.urdf"
    path.write_text(with_parts(*parts))
    with pytest.raises(InputError, match="do not follow each other in one chain") as refused:
        plain_arm(path)
    assert "(and 3 other neighbours)" in str(refused.value)
    assert str(refused.value).count("drives.toml") == 1
    ready = 'the longest chain is: joints = ["pan", "lift", "elbow", "roll", "pitch", "yaw"]'
    assert ready in str(refused.value)


def test_a_wrist_that_turns_a_gripper_is_an_axis(tmp_path):
    """As in the SO-101, whose wrist_roll moves the link gripper_link."""
    text = urdf(('"yaw"', '"wrist_yaw"'), ('"yaw_link"', '"gripper_link"'))
    path = tmp_path / "arm.urdf"
    path.write_text(text)
    assert plain_arm(path).joints == (*NAMES[:-1], "wrist_yaw")


def test_comments_of_xacro_do_not_count(tmp_path):
    """Expanded files often keep those of the file that they were made from."""
    path = tmp_path / "arm.urdf"
    comment = '<!-- <xacro:arm name="${name}"/> -->'
    path.write_text(urdf(("</robot>", comment + "</robot>")))
    assert plain_arm(path).joints == NAMES
    for part in ('<xacro:arm name="x"/>', '<link name="${name}"/>'):
        path.write_text(urdf(("</robot>", part + "</robot>")))
        with pytest.raises(InputError, match="is a xacro file"):
            plain_arm(path)


def test_a_constraint_of_mjcf_makes_a_joint_follow(tmp_path):
    """As a <mimic> of a URDF does."""
    path = tmp_path / "arm.xml"
    body = '<body name="b{0}" pos="0 0 0.3"><joint name="j{0}" axis="0 1 0" range="-90 90"/>'
    body += '<geom type="capsule" fromto="0 0 0 0 0 0.3" size="0.04"/>'
    arm = "".join(body.format(k) for k in range(3)) + "</body>" * 3
    equal = '<equality><joint joint1="j1" joint2="j0"/></equality>'
    path.write_text(f"<mujoco><worldbody>{arm}</worldbody>{equal}</mujoco>")
    with pytest.raises(InputError, match="joint 'j1': follows joint 'j0'"):
        plain_arm(path)
    assert plain_arm(path, ["j0", "j2"]).joints == ("j0", "j2")


def test_an_axis_is_named_once(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(urdf())
    with pytest.raises(InputError, match="joint 'lift': is named twice"):
        plain_arm(path, ["pan", "lift", "lift"])

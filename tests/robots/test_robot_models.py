"""Models as other people write them: defaults for all elements, keyframes, ROS files, grippers."""

import re
import tomllib

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from faultgen.building.build import build
from faultgen.building.drives import Drives
from faultgen.dataset.experiment import make_experiment
from faultgen.dataset.sweep import generate
from faultgen.effects import get_effect
from faultgen.errors import InputError
from faultgen.mjcf.edit import forget_defaults
from faultgen.robot import Robot, load_robot

DEFAULTS = """
  <default>
    <joint range="-1.5 1.5" limited="true" damping="1" armature="0.04" stiffness="3"
      frictionloss="0.2"/>
    <tendon stiffness="7" damping="8" frictionloss="9"/>
    <general ctrlrange="-2 2" ctrllimited="true" forcerange="-1 1" forcelimited="true"/>
    <default class="link"><joint damping="2" armature="0.3"/></default>
  </default>"""


def arm(defaults="", joint="", grip="", extra=""):
    """Two hinges that swing a link of 1 kg each, with a gripper if it is asked for."""
    return f"""<mujoco><compiler angle="radian" autolimits="false"/>{defaults}<worldbody>
      <body childclass="{"link" if "link" in defaults else "main"}">
        <joint name="first" axis="0 0 1" range="-2 2" limited="true" {joint}/>
        <inertial pos="0 0 0.1" mass="1" diaginertia="0.01 0.01 0.01"/>
        <body pos="0 0 0.3" quat="0.9 0.1 0.2 0.3">
          <joint name="second" axis="0 1 0" pos="0.01 0.02 0" range="-2 2" limited="true" {joint}/>
          <inertial pos="0.1 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>{grip}
        </body></body></worldbody>{extra}</mujoco>"""


def built_from(text, folder, drives=None):
    path = folder / "arm.xml"
    path.write_text(text)
    return build(path, drives or Drives(), "arm")


PLAIN = 'damping="0" armature="0" stiffness="0" frictionloss="0"'


def test_defaults_of_a_model_do_not_reach_what_is_added(tmp_path):
    """Rotors, gearboxes and drives are those that the same model gets without any defaults."""
    with_defaults = built_from(arm(DEFAULTS, PLAIN), tmp_path).robot.model
    without = built_from(arm("", PLAIN), tmp_path).robot.model
    for name in dir(without):
        wanted = getattr(without, name)
        if isinstance(wanted, np.ndarray) and wanted.dtype.kind in "fib":
            assert np.array_equal(getattr(with_defaults, name), wanted, equal_nan=True), name


def test_defaults_of_a_model_do_not_reach_what_effects_add(tiny_robot):
    """The play of a gearbox is not damped by what the user's links have."""
    text = tiny_robot.xml
    at = text.index("<worldbody>")
    given = '<joint damping="1" armature="0.04" stiffness="3"/><tendon damping="8" stiffness="9"/>'
    changed = Robot("tiny", f"{text[:at]}<default>{given}</default>{text[at:]}", {})
    spec = changed.spec()
    reference = tiny_robot.spec()
    for name in ("backlash", "loose_tool", "wrist_coupling_friction"):
        if get_effect(name).axes(2):
            get_effect(name).apply(spec, 2, 0.001)
            get_effect(name).apply(reference, 2, 0.001)
    added = {one.name for one in reference.joints} - {one.name for one in tiny_robot.spec().joints}
    model, wanted = spec.compile(), reference.compile()
    assert added
    for name in added:
        for what in ("stiffness", "range", "limited"):
            assert np.array_equal(
                getattr(model.joint(name), what), getattr(wanted.joint(name), what)
            )
        assert model.joint(name).damping == wanted.joint(name).damping
        assert model.joint(name).armature == wanted.joint(name).armature
    before = {one.name for one in tiny_robot.spec().tendons}
    for name in {one.name for one in reference.tendons} - before:
        here, there = model.tendon(name).id, wanted.tendon(name).id
        assert np.array_equal(model.tendon_damping[here], wanted.tendon_damping[there])
        assert np.array_equal(model.tendon_stiffness[here], wanted.tendon_stiffness[there])


@pytest.mark.parametrize("name", ["puma560", "irb6700"])
def test_supplied_robots_are_the_same_without_their_defaults(name):
    """What a file states as default stays in the elements that it has."""
    xml = load_robot(name).xml
    spec = mujoco.MjSpec.from_string(xml)
    forget_defaults(spec)
    found, wanted = spec.compile(), mujoco.MjModel.from_xml_string(xml)
    for what in dir(wanted):
        value = getattr(wanted, what)
        if isinstance(value, np.ndarray) and value.dtype.kind in "fib":
            assert np.array_equal(getattr(found, what), value, equal_nan=True), what


GRIP = """<body name="hand" pos="0.2 0 0" quat="0.7 0.1 0 0.7">
  <inertial pos="0 0 0" mass="0.2" diaginertia="1e-3 1e-3 1e-3"/>
  <body name="finger" pos="0 0.03 0"><joint name="grip" type="slide" axis="1 0 0"
    range="0.01 0.04" limited="true"/>
    <inertial pos="0.01 0 0" mass="0.1" diaginertia="1e-4 1e-4 1e-4"/>
    <body name="tip" pos="0 0 0.1"><joint name="bend" axis="0 0.6 0.8" pos="0 0.02 0.01"
      range="-3 -0.5" limited="true"/>
      <inertial pos="0 0 0.05" mass="0.1" diaginertia="1e-4 1e-4 1e-4"/></body></body></body>"""
HOME = '<keyframe><key name="home" qpos="0.1 0.2 0.03 -1.3"/></keyframe>'


@pytest.mark.parametrize(
    ("extra", "pose", "told"),
    [
        ("", (0.01, -0.5), "2 joints locked: grip at 0.01 m, bend at -0.5 rad"),
        (HOME, (0.03, -1.3), "2 joints locked: grip at 0.03 m, bend at -1.3 rad"),
    ],
)
def test_joints_that_are_no_axes_are_locked_within_their_range(tmp_path, extra, pose, told):
    """At the keyframe home, or else as near to zero as they can be; the links are where they are.

    The position and the turn of the outermost link agree with those of the whole model.
    """
    text = arm(grip=GRIP, extra=extra)
    built = built_from(text, tmp_path, Drives(joints=["first", "second"]))
    assert any(note.startswith(told) for note in built.plain.notes)
    assert not any("keyframe" in note for note in built.plain.notes)  # it was used
    whole = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(whole)
    data.qpos = [0.4, -0.7, *pose]
    mujoco.mj_kinematics(whole, data)
    locked = mujoco.MjModel.from_xml_string(built.plain.xml)
    other = mujoco.MjData(locked)
    other.qpos = [0.4, -0.7]
    mujoco.mj_kinematics(locked, other)
    assert other.body("tip").xpos == pytest.approx(data.body("tip").xpos, abs=1e-9)
    one, two = (Rotation.from_quat(d.body("tip").xquat, scalar_first=True) for d in (data, other))
    assert (one.inv() * two).magnitude() < 1e-9


def test_friction_that_no_drive_could_overcome_is_not_used(tmp_path):
    """Damping that steadies a model elsewhere: a part of the torque limit is believed, not all."""
    limit = 'damping="{}" frictionloss="{}" actuatorfrcrange="-10 10" actuatorfrclimited="true"'
    believed = built_from(arm(joint=limit.format(1.0, 2.0)), tmp_path)
    speed, ratio = (believed.values[0][name].value for name in ("speed_limit", "gear_ratio"))
    assert believed.values[0]["viscous_friction"].value == pytest.approx(1.0 / ratio**2, rel=1e-3)
    assert believed.values[0]["coulomb_friction"].value == pytest.approx(2.0 / ratio, rel=1e-3)
    assert 1.0 * speed < 0.5 * 10 < 2.0 * speed
    built = built_from(arm(joint=limit.format(2.0, 6.0)), tmp_path)
    plain = built_from(arm(joint=limit.format(0.0, 0.0)), tmp_path)
    for name in ("viscous_friction", "coulomb_friction"):
        assert built.values[0][name].source == "assumed"
        assert built.values[0][name].value == plain.values[0][name].value
    notes = [note for note in built.notes if "is not used" in note]
    assert len(notes) == 4  # of two axes
    assert "'first', viscous_friction: the damping of the joint, 2, is not used" in notes[1]
    assert "63% of the torque limit at full speed" in notes[1]


URDF = """<robot name="r"><link name="base"/><link name="arm"><inertial><mass value="2"/>
<origin xyz="0 0 0.2"/>
<inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="50" velocity="2"/></joint>{}</robot>"""
GEAR = """<transmission name="t"><type>transmission_interface/SimpleTransmission</type>
<joint name="j"/><actuator name="m"><mechanicalReduction>{}</mechanicalReduction></actuator>
</transmission>"""


@pytest.mark.parametrize(
    ("reduction", "ratio", "source"),
    [("-160", 160.0, "model"), ("1", 140.0, "assumed"), ("none", 140.0, "assumed")],
)
def test_the_transmission_of_a_urdf_is_the_gear_ratio(tmp_path, reduction, ratio, source):
    """1 stands in most files, and says nothing."""
    path = tmp_path / "arm.urdf"
    path.write_text(URDF.format(GEAR.format(reduction)))
    value = build(path, Drives(), "arm").values[0]["gear_ratio"]
    assert (value.value, value.source) == (ratio, source)


@pytest.mark.parametrize(
    "text",
    [
        '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:property name="m" value="1"/>'
        "</robot>",
        URDF.format("").replace('"50"', '"${effort}"'),
        URDF.format("").replace('"base"', '"$(arg prefix)base"'),
    ],
)
def test_xacro_is_told_what_it_is(tmp_path, text):
    """Macros, and numbers or names that are still to be computed."""
    path = tmp_path / "arm.urdf.xacro"
    path.write_text(text)
    with pytest.raises(InputError, match=r"xacro 'xacro arm.urdf.xacro > arm.urdf'|xacro file"):
        build(path, Drives(), "arm")


def test_tasks_are_within_a_turn_of_home(tmp_path):
    """Joints that can turn by two turns are not sent once around."""
    text = arm(joint="").replace('range="-2 2"', 'range="-6.3 6.3"')
    text = text.replace(
        "</mujoco>", '<keyframe><key name="home" qpos="2.5 0.3"/></keyframe></mujoco>'
    )
    built = built_from(text, tmp_path)
    for task in built.robot.tasks.values():
        told = tomllib.loads(task)
        poses = [told["start"]["joints"], *(m["joints"] for m in told["move"] if "joints" in m)]
        away = np.radians(poses) - [2.5, 0.3]
        assert np.abs(away).max() < np.pi + 1e-6


def test_a_robot_that_does_not_follow_its_task_makes_no_data(tiny_robot, tiny_task_path, tmp_path):
    """A rotor that is stopped by a limit: the healthy run fails, and says which axis it is."""
    stopped = 'name="motor2" limited="true" range="-3 3"'
    path = tmp_path / "stopped.xml"
    path.write_text(tiny_robot.xml.replace('name="motor2"', stopped, 1))
    summary = generate(
        make_experiment({"robot": str(path), "task": tiny_task_path, "axis": 1, "cycles": 1}),
        tmp_path / "out",
        progress=False,
    )
    (reason,) = summary.failed.values()
    assert re.search(r"does not follow the task: axis 2 is up to [\d.]+ rad away", reason)
    assert summary.done == 1  # a fault may be the reason there

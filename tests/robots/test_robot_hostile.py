"""Models with senseless numbers, without end, or without limits: one line, and nothing else."""

import json
import struct
import time
import zlib

import numpy as np
import pytest
from plain_arm import NAMES, urdf
from typer.testing import CliRunner

from faultgen.building.build import build
from faultgen.building.check import check
from faultgen.building.drives import Drives
from faultgen.building.plain import plain_arm
from faultgen.cli.app import app
from faultgen.errors import InputError
from faultgen.robot import load_robot

MJCF = """<mujoco>
  <compiler angle="radian"/>
  <option gravity="0 0 -9.81"/>{more}
  <worldbody>
    <body name="upper" pos="0 0 0.3">
      <inertial mass="8" pos="0 0 0.15" diaginertia="0.16 0.16 0.08"/>
      <joint name="a" axis="0 1 0" range="-1.9 1.9" damping="0.5" armature="0.1"/>
      <geom type="box" size="0.1 0.1 0.1" pos="0 0 0.1" mass="1"/>
      <body name="fore" pos="0 0 0.4">
        <inertial mass="4" pos="0 0 0.15" diaginertia="0.08 0.08 0.04"/>
        <joint name="b" axis="0 1 0" range="-1.9 1.9"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="a" gear="100" ctrlrange="-2 2"/>
    <position joint="b" kp="50" forcerange="-60 60"/></actuator>
</mujoco>"""
LINK = '<link name="l{0}"><inertial><mass value="3"/><inertia ixx=".05" iyy=".05" izz=".05" '
LINK += 'ixy="0" ixz="0" iyz="0"/></inertial></link>'
JOINT = '<joint name="j{1}" type="revolute"><parent link="l{0}"/><child link="l{1}"/>'
JOINT += '<axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="50" velocity="2"/></joint>'
BOX = '<link name="yaw_link"><{}><geometry><{}/></geometry></{}>'


def chain(links):
    """Text of a URDF whose links follow each other."""
    parts = [LINK.format(k) for k in range(links)]
    parts += [JOINT.format(k, k + 1) for k in range(links - 1)]
    return f'<robot name="r">{"".join(parts)}</robot>'


def nested(bodies):
    """Text of an MJCF file whose bodies are nested."""
    one = '<body><joint axis="0 1 0" range="-60 60"/><geom size="0.1"/>'
    return f"<mujoco><worldbody>{one * bodies}{'</body>' * bodies}</worldbody></mujoco>"


def with_shape(shape, kind="visual"):
    return urdf(('<link name="yaw_link">', BOX.format(kind, shape, kind)))


PAN = '<limit lower="-2.6" upper="2.6" effort="120" velocity="3.0"/>'
REFUSED = {
    "mass nan": (urdf(('mass value="4.0"', 'mass value="nan"')), "link 'elbow_link': <mass value="),
    "mass inf": (urdf(('mass value="4.0"', 'mass value="inf"')), "must have numbers up to 1e"),
    "mass huge": (urdf(('mass value="4.0"', 'mass value="1e300"')), "numbers up to 1e"),
    "mass negative": (urdf(('mass value="4.0"', 'mass value="-4"')), "has the mass -4 kg"),
    "inertia nan": (urdf(('izz="0.01"', 'izz="nan"')), "link 'elbow_link': <inertia izz="),
    "effort": (urdf(('effort="80"', 'effort="1e300"')), "joint 'elbow': <limit effort="),
    "speed": (urdf(('velocity="7.0"', 'velocity="inf"')), "joint 'yaw': <limit velocity="),
    "limit nan": (urdf((PAN, PAN.replace("-2.6", "nan"))), "joint 'pan': <limit lower="),
    "axis of zero": (urdf(('<axis xyz="0 1 0"/>', '<axis xyz="0 0 0"/>')), "axis too small"),
    "far": (urdf(('<origin xyz="0 0 0.35"/>', '<origin xyz="0 0 1e12"/>')), "<origin xyz="),
    "far, but finite": (
        urdf(('xyz="0 0 0.35"', 'xyz="0 0 9e8"')),
        "link 'elbow_link': it or its centre of mass is 9e.08 m",
    ),
    "heavy": (urdf(('mass value="4.0"', 'mass value="4e6"')), "link 'elbow_link': has the mass 4e"),
    "g mm^2": (urdf(('ixx="0.05"', 'ixx="5e7"')), "link 'elbow_link': its inertia is that of"),
    "empty box": (with_shape('box size="0 0 0"'), "link 'yaw_link': the <box> of its <visual>"),
    "flat box": (with_shape('box size="1 1 -1"', "collision"), "the <box> of its <collision>"),
    "empty sphere": (with_shape('sphere radius="0"'), "has the radius '0'"),
    "empty cylinder": (with_shape('cylinder radius="1" length=""'), "<cylinder>"),
    "two joints of a name": (urdf(('name="yaw" ', 'name="pan" ')), "2 joints are called 'pan'"),
    "two links of a name": (urdf(("yaw_link", "roll_link")), "2 links are called 'roll_link'"),
    "two carriers": (urdf(('child link="yaw_link"', 'child link="pitch_link"')), "two joints have"),
    "a circle": (urdf(('parent link="base"', 'parent link="yaw_link"')), "form a circle"),
    "no such link": (urdf(('parent link="base"', 'parent link="floor"')), "'floor' is not in the"),
    "no link": ('<robot name="r"/>', "has no <link>"),
    "one link": ('<robot name="r"><link name="a"/></robot>', "no joint of it is a hinge"),
    "empty": ("", "not valid XML"),
    "binary": ("\x00\x01", "not valid XML"),
    "3000 links": (chain(3000), "3000 links follow each other, more than 200"),
    "30000 links": (chain(30000), "has more than 200000 elements"),
    "3000 bodies": (nested(3000), "nested more than 256 deep"),
    "210 bodies": (nested(210), "more than 200 links follow each other"),
    "300000 shapes": (nested(1).replace("<geom", '<geom size="1"/>' * 300000 + "<geom"), "more t"),
    "entities": (
        '<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>' + chain(3),
        "declares the XML entity 'a'",
    ),
    "includes in a URDF": (
        urdf(("<robot", "<robot"), ("</robot>", '<include file="x"/></robot>')),
        "<inc",
    ),
    "no elements": ("<mujoco/>", "no joint of it is a hinge"),
    "gravity nan": (MJCF.replace("0 0 -9.81", "0 0 nan"), "<option gravity="),
    "body nan": (MJCF.replace('pos="0 0 0.4"', 'pos="0 nan 0.4"'), "link 'fore': <body pos="),
    "force": (MJCF.replace("-60 60", "-60 1e300"), "<position forcerange="),
    "product of gear and force": (
        MJCF.replace('gear="100"', 'gear="1e8"').replace("-2 2", "-2e8 2e8"),
        "joint 'a': states a torque_limit of 2e.16, which no drive has",
    ),
    "far axis": (
        MJCF.replace('name="a" axis', 'name="a" pos="0 0 1e5" axis'),
        "joint 'a': its axis is up to 1e.05 m away",
    ),
    "long slide": (
        MJCF.replace(
            'name="b" axis="0 1 0" range="-1.9 1.9"', 'name="b" type="slide" range="0 9e5"'
        ),
        "joint 'b': its range is up to 9e.05 m away",
    ),
    "size of zero": (MJCF.replace('size="0.1 0.1 0.1"', 'size="0.1 0 0.1"'), "must be positive"),
    "pictures": (
        MJCF.format(
            more='<asset><texture type="2d" builtin="flat" width="9000" height="9000"/></asset>'
        ),
        "have 81000000 points, more than 33554432",
    ),
    "copies": (
        MJCF.format(more=f'<replicate count="{"9" * 5000}"></replicate>'),
        "'replicate' makes 1000000000000 copies",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_senseless_models_are_refused_in_one_line(case, tmp_path, monkeypatch, capfd):
    """Nothing is written but this line, not even a log file of MuJoCo, and it takes seconds."""
    text, message = REFUSED[case]
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    path = tmp_path / "arm.xml"
    path.write_text(text.replace("{more}", ""))
    with pytest.raises(InputError, match=message) as refused:
        build(path, Drives(), "x")
    assert "\n" not in str(refused.value)
    assert capfd.readouterr() == ("", "")
    assert not list((tmp_path / "here").iterdir())


LOCKED = {
    "empty box": ('visual><geometry><box size="0 0 0"/></geometry></visual', "the <box> of its"),
    "no inertia": (
        'inertial><mass value="1"/><inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" '
        'iyz="0"/></inertial',
        None,
    ),
    "no axis": ("", "axis too small"),
}


@pytest.mark.parametrize("case", LOCKED)
def test_joints_are_locked_whatever_their_links_are(case, tmp_path):
    """They are compiled once before they are locked; what fails there is told in one line."""
    part, message = LOCKED[case]
    axis = "0 0 0" if case == "no axis" else "0 0 1"
    text = urdf(
        (
            "</robot>",
            f'<link name="head">{f"<{part}>" if part else ""}</link><joint name="neck" '
            'type="revolute"><parent link="pan_link"/><child link="head"/>'
            f'<axis xyz="{axis}"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
            "</robot>",
        )
    )
    path = tmp_path / "arm.urdf"
    path.write_text(text)
    if message is None:
        assert plain_arm(path, NAMES).joints == NAMES
        return
    with pytest.raises(InputError, match=message) as refused:
        plain_arm(path, NAMES)
    assert "\n" not in str(refused.value) and "arm.urdf" in str(refused.value)


def test_files_that_include_the_next_twice_are_refused_at_once(tmp_path):
    """27 of them would become 2^27 shapes. Both readers count what they have included."""
    for k in range(1, 27):
        (tmp_path / f"f{k}.xml").write_text(
            f'<mujocoinclude><include file="f{k + 1}.xml"/><include file="f{k + 1}.xml"/>'
            "</mujocoinclude>"
        )
    (tmp_path / "f27.xml").write_text('<mujocoinclude><geom size="1"/></mujocoinclude>')
    path = tmp_path / "f0.xml"
    path.write_text(
        '<mujoco><worldbody><include file="f1.xml"/><include file="f1.xml"/></worldbody></mujoco>'
    )
    start = time.process_time()
    for read in (plain_arm, load_robot):
        with pytest.raises(InputError, match="includes more than 200 files"):
            read(path)
    (one,) = check(str(path)).findings
    assert "includes more than 200 files" in one.what
    assert time.process_time() - start < 3  # for the three of them


def test_included_text_is_limited(tmp_path):
    """A long file that is included often, and files that include each other in a long row."""
    (tmp_path / "long.xml").write_text(f"<mujocoinclude>{' ' * 10**6}</mujocoinclude>")
    path = tmp_path / "arm.xml"
    many = '<include file="long.xml"/>' * 30
    path.write_text(f"<mujoco><worldbody>{many}</worldbody></mujoco>")
    with pytest.raises(InputError, match="includes more than 16 MiB of text"):
        load_robot(path)
    for k in range(150):
        (tmp_path / f"c{k}.xml").write_text(
            f'<mujocoinclude><body><include file="c{k + 1}.xml"/></body></mujocoinclude>'
        )
    path.write_text('<mujoco><worldbody><include file="c0.xml"/></worldbody></mujoco>')
    with pytest.raises(InputError, match="nested more than 256 deep"):
        load_robot(path)


def test_pictures_are_measured_before_they_are_decompressed(tmp_path):
    """A PNG file of some kilobytes can state 400 million pixels."""
    head = b"IHDR" + struct.pack(">IIBBBBB", 20000, 20000, 8, 2, 0, 0, 0)
    chunk = struct.pack(">I", 13) + head + struct.pack(">I", zlib.crc32(head))
    (tmp_path / "picture.png").write_bytes(b"\x89PNG\r\n\x1a\n" + chunk)
    path = tmp_path / "arm.xml"
    texture = '<asset><texture type="2d" file="picture.png"/></asset>'
    path.write_text(MJCF.format(more=texture))
    with pytest.raises(InputError, match="pictures have 400000000 points"):
        plain_arm(path)


ZERO = '<limit lower="0" upper="0" effort="0" velocity="0"/>'
RANGES = {
    "zero": ZERO,
    "equal": '<limit lower="1" upper="1" effort="120" velocity="3"/>',
    "reversed": '<limit lower="2" upper="-2" effort="120" velocity="3"/>',
    "without end": '<limit lower="-1e16" upper="1e16" effort="120" velocity="3"/>',
    "no limit": "",
}


@pytest.mark.parametrize("case", RANGES)
def test_ranges_that_are_none_are_assumed_and_told(case, tmp_path, capfd):
    """In the model, which says so to everybody who checks it; nothing else is printed."""
    path = tmp_path / "arm.urdf"
    path.write_text(urdf((PAN, RANGES[case])))
    arm = plain_arm(path)
    wanted = "joint 'pan' states no range; assumed -180 to 180 deg, state it in the URDF or MJCF"
    assert [line.partition(" file")[0] for line in arm.warnings] == [wanted]
    assert arm.assumed_ranges == (1,)
    assert check(str(path)).warnings == list(arm.warnings)
    if case != "zero":  # the rest is the same
        return
    built = build(path, Drives(), "x")
    np.testing.assert_allclose(built.robot.joint_range[0], [-np.pi, np.pi])
    np.testing.assert_allclose(built.robot.joint_range[1], [-2.6, 2.6])
    built.write(tmp_path / "x")
    assert check(str(tmp_path / "x")).warnings == list(arm.warnings)
    assert capfd.readouterr() == ("", "")


def test_a_slide_without_a_range_gets_one_and_a_turning_joint_none(tmp_path):
    """Continuous joints turn without end, which is told in a note."""
    path = tmp_path / "arm.urdf"
    path.write_text(urdf(('name="pan" type="revolute"', 'name="pan" type="continuous"')))
    arm = plain_arm(path)
    assert not arm.warnings and not arm.assumed_ranges
    assert any("joint 'pan' has no range in the file and can turn" in note for note in arm.notes)
    path = tmp_path / "arm.xml"
    slide = MJCF.format(more="").replace(
        'name="b" axis="0 1 0" range="-1.9 1.9"', 'name="b" type="slide"'
    )
    path.write_text(slide)
    assert plain_arm(path).warnings == (
        "joint 'b' states no range; assumed -1 to 1 m, state it in the URDF or MJCF file",
    )


def test_warnings_also_appear_beside_json(tmp_path, capfd):
    """Each one is a line of faultgen on stderr, and an entry of the result."""
    path = tmp_path / "arm.urdf"
    path.write_text(urdf((PAN, ZERO)))
    for command in (["build", str(path), "-o", str(tmp_path / "x")], ["check", str(path)]):
        done = CliRunner().invoke(app, ["robot", *command, "--json"])
        assert json.loads(done.stdout)["warnings"]
        (line,) = done.stderr.splitlines()
        assert line.startswith("faultgen: warning: joint 'pan' states no range")
    assert capfd.readouterr() == ("", "")


WEIGHTLESS = {
    "no gravity": ('gravity="0 0 -9.81"', 'gravity="0 0 0"', "gravity is 0"),
    "a flag": ('-9.81"/>', '-9.81"><flag gravity="disable"/></option>', "gravity is 0"),
    "millimetres": ("-9.81", "-9810", "gravity is 9.81e.03 m/s.2, but 9.81"),
}


@pytest.mark.parametrize("case", WEIGHTLESS)
def test_missing_weight_is_told(case, tmp_path):
    """By `build` and by `check`, before and after."""
    old, new, wanted = WEIGHTLESS[case]
    path = tmp_path / "arm.xml"
    path.write_text(MJCF.format(more="").replace(old, new))
    with pytest.raises(AssertionError, match=wanted):
        raise AssertionError(*plain_arm(path).warnings)
    with pytest.raises(AssertionError, match=wanted):
        raise AssertionError(*check(str(path)).warnings)
    if case == "no gravity":
        build(path, Drives(), "x").write(tmp_path / "x")
        found = check(str(tmp_path / "x"))
        assert found.warnings == [
            'gravity is 0 (<option gravity="0 0 0"/>): the motors carry nothing, and the payload '
            "has no weight; remove it if the arm is not planar"
        ]

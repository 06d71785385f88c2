"""Robots in the formats of other programs: masses, dynamics, friction and armature agree."""

import csv
import json
from copy import copy
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from plain_arm import MJCF, NAMES, TETRAHEDRON, urdf
from typer.testing import CliRunner

from faultgen.building.build import build
from faultgen.building.drives import Drives
from faultgen.cli.app import app
from faultgen.errors import InputError
from faultgen.robot import COULOMB, load_robot
from faultgen.robot_formats.joints import joint_numbers
from faultgen.robot_formats.lumps import is_possible, pseudo_inertia, rigid_body
from faultgen.robot_formats.plain import plain_spec
from faultgen.robot_formats.urdf import urdf_text
from faultgen.robot_formats.write import check_folder, export_robot
from faultgen.simulation.arm import Arm

COMMENT = "<!-- do not lose this -->"


@pytest.fixture(scope="module")
def arm_folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plain")
    (folder / "arm.urdf").write_text(urdf(('<link name="base"/>', f'{COMMENT}<link name="base"/>')))
    build(folder / "arm.urdf", Drives(), "my_arm").write(folder / "my_arm")
    return folder / "my_arm"


@pytest.fixture(scope="module")
def cell_folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cell")
    (folder / "package.xml").write_text("<package/>")
    (folder / "meshes").mkdir()
    (folder / "meshes" / "hull.obj").write_text(TETRAHEDRON)
    (folder / "mjcf").mkdir()
    (folder / "mjcf" / "cell.xml").write_text(MJCF)
    build(folder / "mjcf" / "cell.xml", Drives(), "my_cell").write(folder / "my_cell")
    return folder / "my_cell"


def states(robot):
    """Random positions, speeds and accelerations of the axes, shape (3, 20, n_axes)."""
    rng = np.random.default_rng(1)
    low, high = robot.joint_range.T
    shape = (20, robot.n_axes)
    return rng.uniform(low, high, shape), rng.normal(size=shape), rng.normal(size=shape)


def torques(model, names, motion):
    """Joint torques of a compiled model, without friction and limits; other joints stand still."""
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    model.dof_damping[:] = 0
    data = mujoco.MjData(model)
    dofs = [int(model.joint(name).dofadr[0]) for name in names]
    places = [int(model.joint(name).qposadr[0]) for name in names]
    found = []
    for position, velocity, acceleration in zip(*motion, strict=True):
        data.qpos[places], data.qvel[dofs], data.qacc[dofs] = position, velocity, acceleration
        mujoco.mj_inverse(model, data)
        found.append(data.qfrc_inverse[dofs].copy())
    return np.array(found)


def agrees(path, robot, names, *, has_armature):
    """The file's joint torques are those of the robot's rigid arm and, in MJCF, of its rotors."""
    model = mujoco.MjModel.from_xml_path(str(path))
    motion = states(robot)
    arm = Arm(robot)
    if not has_armature:  # URDF has no springs
        arm.model = copy(arm.model)
        arm.model.tendon_stiffness[:] = 0
    expected = arm.inverse_dynamics(*motion)
    armature = robot.gear_ratio**2 * robot.model.dof_M0[list(robot.motors)]
    if has_armature:
        expected = expected + armature * motion[2]
    np.testing.assert_allclose(
        torques(model, names, motion), expected, rtol=0, atol=1e-9 * np.abs(expected).max()
    )
    return mujoco.MjModel.from_xml_path(str(path))


@pytest.mark.parametrize("name", ["puma560", "irb6700"])
def test_a_supplied_robot_becomes_mjcf_and_urdf_with_the_same_dynamics(name, tmp_path):
    robot = load_robot(name)
    exported = export_robot(robot)
    exported.write(tmp_path)
    names = [f"joint{k + 1}" for k in range(robot.n_axes)]
    plain = agrees(tmp_path / f"{name}.xml", robot, names, has_armature=True)
    assert ("balancer" in "".join(exported.notes)) == (name == "irb6700")
    other = agrees(tmp_path / f"{name}.urdf", robot, names, has_armature=False)
    rotors = robot.model.body_mass[[robot.model.body(f"rotor{k + 1}").id for k in range(6)]].sum()
    assert plain.body_mass.sum() == pytest.approx(robot.model.body_mass.sum() - rotors, rel=1e-12)
    assert other.body_mass.sum() == pytest.approx(plain.body_mass.sum(), rel=1e-12)
    friction = robot.ids("actuator", "friction")
    ratio = np.abs(robot.gear_ratio)
    coulomb = ratio * robot.model.actuator_biasprm[friction, COULOMB]
    viscous = ratio**2 * robot.model.actuator_damping[friction]
    for model in (plain, other):
        np.testing.assert_allclose(model.dof_frictionloss, coulomb, rtol=1e-12)
        np.testing.assert_allclose(model.dof_damping, viscous, rtol=1e-12)
        np.testing.assert_allclose(model.jnt_range, robot.joint_range, rtol=1e-12)
        effort = ratio * robot.motor_torque_limit
        np.testing.assert_allclose(model.jnt_actfrcrange[:, 1], effort, rtol=1e-12)
    rotor = ratio**2 * robot.model.dof_M0[list(robot.motors)]
    np.testing.assert_allclose(plain.dof_armature, rotor, rtol=1e-12)


def test_the_exported_arm_coasts_as_friction_and_rotor_demand():
    """A vertical axis alone: J dv/dt = -F - b v, from 1 rad/s, within the step's error."""
    robot = load_robot("puma560")
    rows = joint_numbers(robot)
    model = plain_spec(robot, rows, True).compile()
    model.opt.gravity[:] = 0
    for joint in range(1, 6):  # the others are held
        model.jnt_range[joint] = [-1e-6, 1e-6]
        model.dof_armature[joint] = 1e6
    model.actuator_gainprm[:] = model.actuator_biasprm[:] = 0
    data = mujoco.MjData(model)
    data.qvel[0] = 1.0
    mujoco.mj_forward(model, data)
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    steps = 20
    mujoco.mj_step(model, data, steps)
    friction, viscous = rows[0].frictionloss, rows[0].damping
    rate = viscous / inertia[0, 0]
    speed = (1 + friction / viscous) * np.exp(-rate * steps * 0.002) - friction / viscous
    assert 0.5 < speed < 0.97
    assert data.qvel[0] == pytest.approx(speed, rel=0.01)


def test_the_users_urdf_is_edited(arm_folder, tmp_path):
    """Comments and masses stay; the friction and the limits are those of the robot."""
    robot = load_robot(arm_folder)
    exported = export_robot(robot)
    exported.write(tmp_path)
    text = (tmp_path / "arm.urdf").read_text()
    assert COMMENT in text and '<mass value="6.0"' in text
    agrees(tmp_path / "arm.urdf", robot, NAMES, has_armature=False)
    model = agrees(tmp_path / "my_arm.xml", robot, NAMES, has_armature=True)
    rows = {row.joint: row for row in joint_numbers(robot)}
    assert list(rows) == list(NAMES)
    for name in NAMES:
        assert f'friction="{rows[name].frictionloss!r}"' in text
        assert model.actuator(name).gainprm[0] == pytest.approx(rows[name].kp)
        assert model.actuator(name).biasprm[2] == pytest.approx(-rows[name].kd)
    assert any("static friction" in line for line in exported.notes)


def test_calibrated_masses_get_into_the_users_urdf(arm_folder, tmp_path):
    """A link that became heavier in the robot is heavier in the file; the others do not change."""
    robot = load_robot(arm_folder)
    spec = robot.spec()
    link = spec.body("elbow_link")
    link.mass, link.ipos = 1.25 * link.mass, np.array([0.02, 0.01, 0.2])
    spec.compile()
    heavier = robot.edited(spec)
    assert heavier.origin == robot.origin
    export_robot(heavier).write(tmp_path)
    agrees(tmp_path / "arm.urdf", heavier, NAMES, has_armature=False)
    text = (tmp_path / "arm.urdf").read_text()
    assert '<mass value="5.0' in text and '<mass value="4.0"' not in text
    assert '<mass value="6.0"' in text and '<mass value="1.5"' in text


def test_a_link_that_cannot_be_edited_leads_to_a_new_file(arm_folder):
    """The elbow of the robot weighs less than what the file has fixed to it."""
    robot = load_robot(arm_folder)
    text = robot.origin["arm.urdf"].replace(
        "</robot>",
        '<link name="box"><inertial><mass value="9"/><inertia ixx="1" iyy="1" izz="1" ixy="0" '
        'ixz="0" iyz="0"/></inertial></link><joint name="b" type="fixed"><parent '
        'link="elbow_link"/><child link="box"/></joint></robot>',
    )
    exported = export_robot(replace(robot, origin={"arm.urdf": text}))
    assert any("cannot be edited" in line and "elbow_link" in line for line in exported.notes)
    assert "my_arm.urdf" in exported.files and "arm.urdf" not in exported.files


def test_the_users_mjcf_is_edited(cell_folder, tmp_path):
    robot = load_robot(cell_folder)
    exported = export_robot(robot)
    exported.write(tmp_path / "mjcf")
    text = (tmp_path / "mjcf" / "cell.xml").read_text()
    assert '<motor name="m1" joint="shoulder" gear="50" ctrlrange="-2 2" />' in text
    assert any("'shoulder'" in line and "position actuators" in line for line in exported.notes)
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "hull.obj").write_text(TETRAHEDRON)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "mjcf" / "cell.xml"))
    rows = joint_numbers(robot)
    for row in rows:
        dof = model.joint(row.joint).dofadr[0]
        assert model.dof_armature[dof] == pytest.approx(row.armature, rel=1e-12)
        assert model.dof_frictionloss[dof] == pytest.approx(row.frictionloss, rel=1e-12)
    assert model.body("payload").mass[0] == pytest.approx(robot.payload_mass)
    assert model.actuator("p2").gainprm[0] == pytest.approx(rows[1].kp)
    assert exported.agreement["cell.xml"] < 1e-12
    agrees(tmp_path / "mjcf" / "my_cell.urdf", robot, ("shoulder", "elbow"), has_armature=False)


ODD = """
<mujoco><worldbody><body name="base" pos="0 0 1" euler="0 20 0">
  <geom type="box" size="0.1 0.2 0.3" pos="0 0 0.1"/>
  <body name="a" pos="0.1 0 0" euler="10 30 0"><joint name="one" axis="0 1 1" pos="0.2 0.1 0"/>
    <geom type="capsule" size="0.05 0.2" pos="0.1 0 0"/>
    <body name="b" pos="0 0.3 0" euler="0 0 45"><joint name="two" type="slide" axis="1 0 0"
      ref="0.2"/><geom type="sphere" size="0.1" pos="0 0.1 0"/></body></body>
</body></worldbody></mujoco>
"""


def test_urdf_has_the_frames_of_joints_beside_the_origin_of_their_body():
    """Joints with pos and ref; the places of the shapes are those of the MJCF model."""
    spec = mujoco.MjSpec.from_string(ODD)
    rows = joint_numbers(load_robot("puma560"))[:2]
    rows = [replace(rows[0], joint="one"), replace(rows[1], joint="two", kind="slide")]
    text = urdf_text(spec, rows, "odd", [])
    one, other = spec.compile(), mujoco.MjSpec.from_string(text).compile()
    for pose in ([0.0, 0.0], [0.7, -0.3], [-1.2, 0.5]):
        seen = []
        for model in (one, other):
            data = mujoco.MjData(model)
            data.qpos[:] = pose
            mujoco.mj_kinematics(model, data)
            bodies = [model.body(name).id for name in ("a", "b")]
            seen.append((data.geom_xpos, data.xipos[bodies]))
        np.testing.assert_allclose(seen[0][0], seen[1][0], atol=1e-12)
        np.testing.assert_allclose(seen[0][1], seen[1][1], atol=1e-12)


def test_a_rigid_body_survives_as_a_matrix():
    inertia = np.array([[0.3, 0.01, 0.02], [0.01, 0.4, 0.03], [0.02, 0.03, 0.5]])
    centre = np.array([0.1, -0.2, 0.3])
    matrix = pseudo_inertia(2.0, centre, inertia)
    mass, place, back = rigid_body(matrix)
    assert mass == 2.0
    np.testing.assert_allclose(place, centre)
    np.testing.assert_allclose(back, inertia)
    assert is_possible(matrix)
    assert not is_possible(pseudo_inertia(2.0, centre, np.diag([0.1, 0.1, 0.5])))
    assert not is_possible(-matrix)


def test_the_tables_have_units_and_isaac_has_degrees(arm_folder, tmp_path):
    result = CliRunner().invoke(
        app, ["robot", "export", str(arm_folder), "-o", str(tmp_path / "out"), "--json"]
    )
    assert result.exit_code == 0, result.output
    told = json.loads(result.stdout)
    rows = list(csv.reader((tmp_path / "out" / "joints.csv").read_text().splitlines()))
    assert rows[0][4] == "armature [kg m^2]" and rows[1][0] == "pan"
    assert float(rows[1][4]) == told["joints"][0]["armature"]
    isaac = json.loads((tmp_path / "out" / "isaac.json").read_text())
    lab, usd = isaac["implicit_actuator"], isaac["usd"]["pan"]
    pan = told["joints"][0]
    assert lab["friction"]["pan"] == pan["static_friction"]
    assert lab["dynamic_friction"]["pan"] == pan["frictionloss"] <= pan["static_friction"]
    degree = 180 / np.pi
    assert usd["physxJointAxis:angular:viscousFrictionCoefficient"] * degree == pytest.approx(
        pan["damping"]
    )
    assert usd["physxJointAxis:angular:maxJointVelocity"] == pytest.approx(3.0 * degree)
    assert usd["drive:angular:physics:stiffness"] * degree == pytest.approx(pan["kp"])


def test_an_export_overwrites_no_other_files(tmp_path):
    (tmp_path / "arm.urdf").write_text("mine")
    with pytest.raises(InputError, match="is not empty"):
        check_folder(tmp_path)
    with pytest.raises(InputError, match="is a file"):
        check_folder(tmp_path / "arm.urdf")


def test_without_payload(arm_folder):
    files = export_robot(load_robot(arm_folder), payload=False).files
    assert "payload" not in files["my_arm.xml"].split("-->")[1]

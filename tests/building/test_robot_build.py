"""Building a robot from a plain model of an arm, and what the result can do."""

import json
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from plain_arm import EFFORT, MJCF, SPEED, TETRAHEDRON, urdf
from typer.testing import CliRunner

import faultgen
from faultgen.building.build import build
from faultgen.building.check import check
from faultgen.building.drive_numbers import Value
from faultgen.building.drives import Drives, read_drives
from faultgen.building.plain import plain_arm
from faultgen.building.quantities import QUANTITIES
from faultgen.building.resonance import largest_step, resonances, zero_pose
from faultgen.cli.app import app
from faultgen.effects import get_effect
from faultgen.errors import InputError, SimulationFailed
from faultgen.robot import STICTION, STRIBECK_VELOCITY, load_robot
from faultgen.simulation.arm import Arm, motor_torque
from faultgen.simulation.motion import plan
from faultgen.simulation.plant import assemble
from faultgen.simulation.servo import control_signal
from faultgen.simulation.stepping import simulate
from faultgen.tasks import load_task

LABORATORIES = Path(__file__).parents[2] / "benchmarks" / "laboratories" / "robots"
COUPLED = {"coupling": [{"gearbox": "yaw", "joint": "pitch", "factor": 0.8}]}


@pytest.fixture(scope="module")
def arm_path(tmp_path_factory):
    path = tmp_path_factory.mktemp("plain") / "arm.urdf"
    path.write_text(urdf())
    return path


@pytest.fixture(scope="module")
def built(arm_path):
    return build(arm_path, Drives(), "my_arm")


@pytest.fixture(scope="module")
def coupled(arm_path):
    return build(arm_path, Drives(**COUPLED), "my_arm")


@pytest.fixture
def cell(tmp_path):
    """Path of an MJCF file with a floor, loose objects, a gripper, actuators and a mesh."""
    (tmp_path / "cell").mkdir()
    (tmp_path / "package.xml").write_text("<package/>")
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "hull.obj").write_text(TETRAHEDRON)
    path = tmp_path / "cell" / "cell.xml"
    path.write_text(MJCF)
    return path


def run(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_limits_of_the_urdf_are_kept(built):
    """Effort and speed limits hold at the joint, whatever gear ratio is assumed."""
    robot = built.robot
    ratio = np.abs(robot.gear_ratio)
    assert robot.n_axes == 6
    np.testing.assert_allclose(robot.motor_torque_limit * ratio, EFFORT, rtol=1e-6)
    np.testing.assert_allclose(robot.motor_velocity_limit / ratio, SPEED, rtol=1e-6)
    np.testing.assert_allclose(robot.joint_range, [[-2.6, 2.6]] * 6)
    assert robot.payload_mass == 2.0


def test_torque_is_that_of_the_plain_model_plus_rotor_and_friction(built, arm_path):
    """Inverse dynamics of the URDF by MuJoCo itself, and closed forms for the drives."""
    robot = built.robot
    rng = np.random.default_rng(1)
    q, qd, qdd = (scale * rng.standard_normal((20, 6)) for scale in (1.0, 1.0, 5.0))
    model = mujoco.MjModel.from_xml_path(str(arm_path))
    data = mujoco.MjData(model)
    wanted = np.empty_like(q)
    numbers = [{name: one.value for name, one in values.items()} for values in built.values]
    for row in range(len(q)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[row], qd[row], qdd[row]
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
        mujoco.mj_inverse(model, data)
        for k, number in enumerate(numbers):
            n, speed = number["gear_ratio"], number["gear_ratio"] * qd[row, k]
            friction = number["coulomb_friction"] * np.tanh(speed / number["stribeck_velocity"])
            friction += number["viscous_friction"] * speed
            rotor = number["rotor_inertia"] * n * qdd[row, k]
            wanted[row, k] = data.qfrc_inverse[k] / n + rotor + friction
    np.testing.assert_allclose(motor_torque(Arm(robot), q, qd, qdd), wanted, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("with_body", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_an_arm_can_carry_nothing(with_body, built, tmp_path):
    """With mass = 0 only the flange is marked; what is written can be stated, and masses added."""
    path, drives = tmp_path / "arm.urdf", tmp_path / "drives.toml"
    text = urdf()
    path.write_text(text if with_body else text[: text.index('<link name="payload">')] + "</robot>")
    drives.write_text("[payload]\nmass = 0\n")
    made = build(path, read_drives(drives), "bare")
    assert made.robot.payload_mass == 0.0
    poses = np.random.default_rng(4).uniform(-1, 1, (5, 6))
    still = np.zeros_like(poses)
    lighter, heavier = (
        Arm(one).inverse_dynamics(poses, still, still) for one in (made.robot, built.robot)
    )
    payload = built.robot.model.body("payload")
    loaded = made.robot.spec()
    place = payload.ipos if with_body else payload.pos + payload.ipos  # there its frame is the link
    at = dict(zip("xyz", place.tolist(), strict=True))
    get_effect("payload_mass").apply(loaded, 6, float(payload.mass[0]), **at)
    loaded.compile()
    found = Arm(made.robot.edited(loaded)).inverse_dynamics(poses, still, still)
    np.testing.assert_allclose(found, heavier, atol=1e-9)
    assert np.abs(lighter - heavier).max() > 1.0
    made.write(tmp_path / "out")
    assert check(str(tmp_path / "out")).fit
    drives.write_text(made.drives.replace("# position", "position").replace("# inertia", "inertia"))
    again = Arm(build(path, read_drives(drives), "bare").robot)
    np.testing.assert_array_equal(again.inverse_dynamics(poses, still, still), lighter)


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("mass = -1", "payload.mass: input should be greater than or equal to 0"),
        ("mass = 2\ninertia = [0, 1, 1]", "inertia: must be above 0, or 0 for a payload with"),
        ("mass = 0\ninertia = [1, 1, 1]", "inertia: must be 0 for a payload with mass = 0"),
        ("inertia = [1, -1, 1]", "inertia: must be above 0"),
    ],
)
def test_a_payload_that_cannot_be_is_refused(tmp_path, entry, message):
    path = tmp_path / "drives.toml"
    path.write_text(f"[payload]\n{entry}\n")
    with pytest.raises(InputError, match=message) as caught:
        read_drives(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", ["built", "coupled"])
def test_the_simulated_torque_is_the_planned_one(kind, request):
    """Motors deliver the rigid torque within 1 % RMS, joints follow; also with coupled gears.

    Below three Stribeck velocities friction depends on what was before, within its static value.
    """
    robot = request.getfixturevalue(kind).robot
    motion = plan(load_task(robot.name, "pick_and_place", robot.tasks), robot)
    step = robot.model.opt.timestep
    steps = round(2.0 / step)
    control = control_signal(motion, step)[:steps]
    (cycle,) = simulate(robot, control, [assemble(robot)], sample_period=step, lead_in=0.0)
    q, qd, qdd = motion(np.arange(len(control)) * step)
    planned = motor_torque(Arm(robot), q, qd, qdd)
    error = (cycle.motor_torque - planned) / robot.motor_torque_limit
    law = robot.model.actuator_biasprm[robot.ids("actuator", "friction")]
    moving = np.abs(robot.gearing.outputs(qd) * robot.gear_ratio) > 3 * law[:, STRIBECK_VELOCITY]
    assert (moving.sum(axis=0) > 0.05 * len(q)).all()
    assert (np.sqrt(np.mean(error**2, axis=0, where=moving)) < 0.01).all()
    assert (np.abs(error) < 1.3 * law[:, STICTION] / robot.motor_torque_limit).all()
    assert np.abs(cycle.joint_position - q).max() < 0.01
    assert np.ptp(q, axis=0).min() > 0.01


def test_a_coupled_gearbox_turns_with_another_joint(built, coupled):
    """q_motor = n (q_own + factor q_other), and torques go with the transpose."""
    robot = coupled.robot
    wanted = np.diag(robot.gear_ratio)
    wanted[5, 4] = 0.8 * robot.gear_ratio[5]
    np.testing.assert_allclose(robot.gearing.matrix, wanted, rtol=1e-9)
    assert robot.gearing.coupled.tolist() == [False] * 5 + [True]
    q, still = np.random.default_rng(2).standard_normal((2, 5, 6))
    load = Arm(robot).inverse_dynamics(q, 0 * q, 0 * q)
    needed = motor_torque(Arm(robot), q, 0 * still, 0 * still)
    np.testing.assert_allclose(needed @ wanted, load, atol=1e-9)
    assert not built.robot.gearing.coupled.any()


def test_locked_rotor_resonances_are_those_of_inertia_and_spring(built, arm_path):
    """Eigenvalues from the URDF's own inertia matrix and the stiffnesses of drives.toml."""
    model = mujoco.MjModel.from_xml_path(str(arm_path))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    mass = np.zeros((6, 6))
    mujoco.mj_fullM(model, data, mass)
    spring = np.diag([values["gear_stiffness"].value for values in built.values])
    wanted = np.sort(np.sqrt(np.linalg.eigvals(np.linalg.solve(mass, spring)).real)) / (2 * np.pi)
    found = resonances(built.robot, zero_pose(built.robot))
    np.testing.assert_allclose(found.locked, wanted, rtol=1e-6)
    np.testing.assert_allclose(
        found.axis, np.sqrt(np.diag(spring) / np.diag(mass)) / (2 * np.pi), rtol=1e-6
    )


def test_an_arm_swings_at_its_locked_rotor_resonance(cell):
    """The time between zeros of a simulated swing, with the rotor held by an infinite inertia."""
    drives = Drives(joints=["shoulder"], all={"gear_damping": 0.0})
    robot = build(cell, drives, "swing").robot
    spec = robot.spec()
    spec.joint("motor1").armature = 1e9
    for name in ("friction1", "drive1"):
        spec.delete(spec.actuator(name))
    spec.option.timestep = 1e-4
    model = spec.compile()
    data = mujoco.MjData(model)
    data.joint("joint1").qpos = 1e-3
    angle = []
    for _ in range(10_000):
        mujoco.mj_step(model, data)
        angle.append(float(data.joint("joint1").qpos[0]))
    rising = np.flatnonzero(np.diff(np.signbit(angle).astype(int)) == -1)
    assert len(rising) > 5
    measured = (len(rising) - 1) / ((rising[-1] - rising[0]) * 1e-4)
    (wanted,) = resonances(robot, np.zeros(1)).axis
    assert measured == pytest.approx(wanted, rel=5e-3)


@pytest.mark.parametrize("bristle_damping", [(0.1, 0.07), (1.0, 0.5)])
@pytest.mark.parametrize(("factor", "grows"), [(0.9, False), (1.2, True)])
def test_the_largest_step_is_where_the_simulation_diverges(
    tiny_robot, factor, grows, bristle_damping
):
    """Below it a robot comes to rest; above it the smallest disturbance grows.

    With the larger damping of the bristles [N m s/rad], the largest step is three times smaller.
    """
    one, two = bristle_damping
    xml = tiny_robot.xml.replace('"20 0.1 ', f'"20 {one} ').replace('"10 0.07 ', f'"10 {two} ')
    robot = replace(tiny_robot, xml=xml)
    step = factor * largest_step(robot, zero_pose(robot))
    robot = replace(robot, xml=xml.replace('timestep="0.001"', f'timestep="{step!r}"'))
    control = np.zeros((round(3 / step), robot.model.nu))
    try:
        (cycle,) = simulate(robot, control, [assemble(robot)], sample_period=step, lead_in=0.0)
    except SimulationFailed as failed:
        assert grows and "diverged" in str(failed)
        return
    # friction limits what grows, and what does not grow has died away after two seconds
    last = np.abs(cycle.motor_velocity[-len(control) // 3 :]).max()
    assert last > 0.1 if grows else last < 1e-9, last


def test_what_does_not_belong_to_an_arm_is_taken_out_and_told(cell, tmp_path):
    """The gripper is locked, loose objects go, the mesh comes along, the drive data are used."""
    drives = Drives(joints=["shoulder", "elbow"])
    made = build(cell, drives, "cell2")
    told = "\n".join(made.notes)
    for words in (
        "2 actuators dropped: m1, p2",
        "1 sensor dropped: s1",
        "1 equality constraint dropped",
        "free joint 'floating' dropped: the base stands still",
        "body 'box' dropped: it is a loose object",
        "1 joint locked: grip",
    ):
        assert words in told
    made.write(tmp_path / "cell2")
    assert (tmp_path / "cell2" / "assets" / "hull.obj").read_text() == TETRAHEDRON
    shutil.rmtree(tmp_path / "meshes")
    robot = load_robot(tmp_path / "cell2")
    assert robot.n_axes == 2 and robot.model.nmesh == 1
    first, second = made.values
    assert first["torque_limit"].value == 100 and second["torque_limit"].value == 60
    n = first["gear_ratio"].value
    for name, wanted in (
        ("rotor_inertia", 0.5 / n**2),
        ("viscous_friction", 3 / n**2),
        ("coulomb_friction", 4 / n),
    ):
        assert first[name].source == "model"
        assert first[name].value == pytest.approx(wanted, rel=1e-3)
    assert made.plain.home == (0.3, -0.4)
    # full inertias: the inertia matrix of the original, without the objects and with the payload
    spec = mujoco.MjSpec.from_string(MJCF, assets={"../meshes/hull.obj": TETRAHEDRON.encode()})
    original = spec.compile()
    body = original.body("upper")
    again = robot.model.body("upper")
    np.testing.assert_allclose(np.sort(again.inertia), np.sort(body.inertia), rtol=1e-9)


def test_given_numbers_are_used_and_the_others_follow(built, arm_path, tmp_path):
    """A file that was written can be edited: lines without # count, the rest is new."""
    text = built.drives
    assert all(f"# {quantity.name} = " in text for quantity in QUANTITIES)
    at = text.index("# gear_ratio = ", text.index("[axis.elbow]"))
    edited = tmp_path / "edited.toml"
    edited.write_text(text[:at] + "gear_ratio = -40" + text[text.index("\n", at) :])
    made = build(arm_path, read_drives(edited), "second")
    assert made.values[2]["gear_ratio"] == Value(-40.0, "given")
    assert made.robot.gear_ratio[2] == pytest.approx(-40)
    assert made.values[2]["coulomb_friction"].source == "assumed"
    before = built.values[2]["coulomb_friction"].value * built.values[2]["gear_ratio"].value
    assert made.values[2]["coulomb_friction"].value * 40 == pytest.approx(before, rel=1e-3)
    assert made.values[1] == built.values[1]
    assert tomllib.loads(made.drives)["axis"]["elbow"] == {"gear_ratio": -40.0}


@pytest.mark.parametrize("name", ["scara4", "lift1", "arm7"])
def test_arms_of_other_kinds_are_fit(name, tmp_path):
    """Models of the laboratories without their drives: a SCARA, a lift and an arm of seven axes."""
    robot = load_robot(LABORATORIES / f"{name}.xml")
    spec = robot.spec()
    for one in [*spec.actuators, *spec.tendons, *spec.numerics, spec.body("payload")]:
        spec.delete(one)
    for k in range(1, robot.n_axes + 1):
        spec.delete(spec.body(f"rotor{k}"))
        spec.joint(f"joint{k}").name = f"axis {k}"
    spec.compile()
    (tmp_path / "plain.xml").write_text(spec.to_xml())
    done = run("robot", "build", tmp_path / "plain.xml", "-o", tmp_path / "made")
    assert done.exit_code == 0, done.output
    checked = run("robot", "check", tmp_path / "made", "--json")
    content = json.loads(checked.stdout)
    assert (checked.exit_code, content["fit"], content["findings"]) == (0, True, [])
    assert set(content["tasks"]) == {"pick_and_place", "spot_weld", "arc_weld"}


@pytest.mark.slow
def test_what_is_in_a_folder_is_not_overwritten(arm_path, tmp_path):
    """Edited numbers would be lost, and a folder of something else would be mixed with a robot."""
    folder = tmp_path / "made"
    assert run("robot", "build", arm_path, "-o", folder).exit_code == 0
    assert run("robot", "build", arm_path, "-o", folder).exit_code == 0
    stated = folder / "drives.toml"
    edited = stated.read_text() + "\n# mine\n"
    stated.write_text(edited)
    done = run("robot", "build", arm_path, "-o", folder)
    assert isinstance(done.exception, InputError) and "would be lost" in str(done.exception)
    assert stated.read_text() == edited
    assert run("robot", "build", arm_path, stated, "-o", folder).exit_code == 0
    other = tmp_path / "other"
    other.mkdir()
    (other / "notes.txt").write_text("mine")
    done = run("robot", "build", arm_path, "-o", other)
    assert isinstance(done.exception, InputError) and "is not empty" in str(done.exception)
    assert [path.name for path in other.iterdir()] == ["notes.txt"]


def test_from_a_plain_model_to_a_dataset_in_three_commands(arm_path, tmp_path):
    folder, data = tmp_path / "my_arm", tmp_path / "data"
    assert run("robot", "build", arm_path, "-o", folder).exit_code == 0
    assert run("robot", "check", folder).exit_code == 0
    arguments = ["--task", "spot_weld", "--axis", "2", "--cycles", "2", "--workers", "1"]
    done = run("generate", "--robot", folder, *arguments, "-o", data)
    assert done.exit_code == 0, done.output
    dataset = faultgen.open_dataset(data)
    assert {run_["axis"] for run_ in dataset.runs} == {0, 2}
    listed = json.loads(run("tasks", "--robot", folder, "--json").stdout)
    assert {row["task"] for row in listed} == {"pick_and_place", "spot_weld", "arc_weld"}


def test_meshes_of_packages_are_found_and_lost_ones_told(tmp_path):
    """A URDF names meshes by their package; one that is missing costs only its picture."""
    package = tmp_path / "arm_description"
    (package / "meshes").mkdir(parents=True)
    (package / "urdf").mkdir()
    (package / "meshes" / "hull.obj").write_text(TETRAHEDRON)
    shape = '<visual><geometry><mesh filename="package://arm_description/meshes/{}"/></geometry></visual>'
    path = package / "urdf" / "arm.urdf"
    links = [
        (f'<link name="{name}_link">', f'<link name="{name}_link">{shape.format(file)}')
        for name, file in (("pan", "hull.obj"), ("lift", "lost.stl"))
    ]
    path.write_text(urdf(*links))
    made = build(path, Drives(), "meshed")
    assert list(made.robot.assets) == ["assets/hull.obj"]
    assert made.robot.model.nmesh == 1
    assert any("lost.stl" in note for note in made.notes)


def test_impossible_inertias_are_repaired_and_told(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(urdf(('izz="0.0003"', 'izz="0.01"')))
    made = build(path, Drives(), "odd")
    assert any("link 'yaw_link': its principal inertias" in note for note in made.notes)
    values = np.sort(made.robot.model.body("yaw_link").inertia)
    assert values[2] == pytest.approx(0.01) and values[2] <= values[0] + values[1]


BALL = '<joint name="elbow" axis="0 1 0" range="-2 2"/>', '<joint name="elbow" type="ball"/>'
BAD = {
    "ball joint": (MJCF.replace(*BALL), "", r"joint 'elbow': is a ball joint"),
    "two arms": (
        MJCF.replace("</mujoco>", "").replace(
            "</worldbody>",
            '<body name="other"><joint name="second"/><geom size="0.1"/></body></worldbody>',
        )
        + "</mujoco>",
        "",
        r"joints 'grip' and 'second': do not follow each other in one chain",
    ),
    "no mass": (
        urdf(('<mass value="4.0"/>', '<mass value="0"/>')),
        "",
        r"link 'elbow_link': has the mass 0 kg",
    ),
    "unknown key": (urdf(), "[axis.pan]\ngear = 3", r"axis\.pan\.gear: unknown; a drive has speed"),
    "unknown table": (urdf(), "[motors]\nx = 1", r"motors: unknown; the file has joints"),
    "unknown axis": (urdf(), "[axis.wrist]\ngear_ratio = 3", r"axis\.wrist: no such axis"),
    "no ratio": (urdf(), "[all]\ngear_ratio = 0", r"all\.gear_ratio: must not be 0"),
    "huge": (urdf(), "[all]\ngear_ratio = 1e300", r"gear_ratio: must be between .*, not 1e\+300"),
    "tiny": (urdf(), "[all]\nrotor_inertia = 1e-30", r"rotor_inertia: must be .*, not 1e-30"),
    "negative": (urdf(), "[all]\ngear_stiffness = -1", r"gear_stiffness: must be positive, not -1"),
    "not toml": (urdf(), "[all", "not valid TOML"),
    "unknown joint": (
        urdf(),
        'joints = ["pan", "x"]',
        r"joint 'x': is not in the model; it has pan",
    ),
    "unknown tool": (urdf(), 'tool = "hook"', r"no body or site 'hook'; it has yaw_link, payload"),
    "not xml": ("<robot", "", "not valid XML"),
    "other xml": ("<sdf/>", "", r"its outermost element is <sdf>"),
    "no joints": ('<mujoco><worldbody><geom size="1"/></worldbody></mujoco>', "", "no joint of it"),
    "home outside the range": (
        urdf(),
        "home = [0, -160, 0, 0, 150, 0]",
        r"drives: home: axis 2 \(lift\) at -160 is outside its range of -149 to 149 deg; axis 5",
    ),
    "keyframe outside the range": (
        MJCF.replace("0.3 -0.4 0", "0.3 -2.4 0"),
        'joints = ["shoulder", "elbow"]',
        r"arm.xml: keyframe 'home': axis 2 \(elbow\) at -137.5 is outside its range of -114.6",
    ),
    "too weak to hold the arm": (
        urdf(),
        "[axis.lift]\ntorque_limit = 1",
        r"axis 2 \(lift\): with a torque limit of 1 N m it cannot hold the arm, which needs up to "
        "[56]",
    ),
    "singular coupling": (
        urdf(),
        '[[coupling]]\ngearbox = "pan"\njoint = "lift"\nfactor = 1\n'
        '[[coupling]]\ngearbox = "lift"\njoint = "pan"\nfactor = 1',
        "the motors cannot hold the arm",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_gets_one_line(case, tmp_path):
    text, toml, message = BAD[case]
    (tmp_path / "package.xml").write_text("<package/>")
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "hull.obj").write_text(TETRAHEDRON)
    (tmp_path / "in").mkdir()
    path, drives = tmp_path / "in" / "arm.xml", tmp_path / "drives.toml"
    path.write_text(text)
    drives.write_text(toml)
    done = run("robot", "build", path, drives, "-o", tmp_path / "out")
    assert isinstance(done.exception, InputError)
    assert done.exception.args and "\n" not in str(done.exception)
    with pytest.raises(InputError, match=message):
        raise done.exception
    assert not (tmp_path / "out").exists()


def test_all_links_without_mass_are_named_at_once(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(urdf(('<mass value="4.0"/>', '<mass value="0"/>'), ('"6.0"', '"0"')))
    with pytest.raises(InputError, match=r"pan_link.*elbow_link") as refused:
        build(path, Drives(), "x")
    assert "\n" not in str(refused.value)


def test_names_of_supplied_robots_are_taken(arm_path):
    with pytest.raises(InputError, match="'puma560' is the name of a robot that comes with"):
        build(arm_path, Drives(), "puma560")


@pytest.mark.slow
def test_an_arm_that_is_just_strong_enough_works_where_it_can_be_held(arm_path):
    """With less than 85 % of the torque for some poses, the tool moves through others."""
    robot = build(arm_path, Drives(axis={"lift": {"torque_limit": 40.0}}), "weak").robot
    arm = Arm(robot)
    assert len(robot.tasks) == 3
    for name in robot.tasks:
        task = load_task(robot.name, name, robot.tasks)
        assert any(move.position for move in task.move)
        q = plan(task, robot)(np.arange(0, 2, 0.01))[0]
        held = np.abs(motor_torque(arm, q, 0 * q, 0 * q)) / robot.motor_torque_limit
        assert held.max() <= 0.86


def test_a_move_between_poses_that_cannot_be_held_is_refused_at_once(built, monkeypatch):
    """No timing is tried, because every timing begins and ends at rest."""
    robot = built.robot
    move = "[[move]]\njoints = {}\n"
    text = 'description = "x"\n[start]\njoints = [0, 0, 0, 0, 0, 0]\n'
    text += move.format([0, 90, 0, 0, 0, 0]) + move.format([0] * 6)
    spec = robot.spec()
    spec.actuator("drive2").forcerange *= 0.1
    weak = robot.edited(spec)
    monkeypatch.setattr("faultgen.simulation.timing.Ruckig", None)
    with pytest.raises(InputError, match=r"move 1: axis 2 \(lift\) needs more than 85 % of its"):
        plan(load_task("my_arm", "x", {"x": text}), weak)


@pytest.mark.slow
def test_no_link_and_no_tool_is_below_the_base_during_the_tasks(tmp_path):
    """A long arm that starts close to the floor; heights by MuJoCo over the whole cycle."""
    path = tmp_path / "long.urdf"
    long = [('xyz="0 0 0.2"', 'xyz="0 0 0.05"'), ('xyz="0 0 0.1"', 'xyz="0 0 0"')]
    long += [('xyz="0 0 0.35"', 'xyz="0 0 0.6"'), ('xyz="0 0 0.3"', 'xyz="0 0 0.6"')]
    path.write_text(urdf(*long, ('effort="', 'effort="9')))
    robot = build(path, Drives(home=[0, 60, 100, 0, 20, 0]), "long").robot
    model = Arm(robot).model
    data = mujoco.MjData(model)
    assert len(robot.tasks) == 3
    for name in robot.tasks:
        motion = plan(load_task(robot.name, name, robot.tasks), robot)
        for pose in motion(np.arange(0, motion.period, 0.02))[0]:
            data.qpos[:] = pose
            mujoco.mj_kinematics(model, data)
            assert min(data.xpos[1:, 2].min(), data.site("tool").xpos[2]) > -1e-3, name


@pytest.mark.parametrize(
    ("unit", "limits", "told"),
    [
        ("radian", "-170 170", "range of 340 rad is unusual; if the file states degrees, write"),
        ("degree", "-2 2", "range of 0.0698 rad is unusual; if the file states radians, write"),
        ("degree", "-170 170", None),
        ("radian", "-3 3", None),
    ],
)
def test_angles_in_the_wrong_unit_are_told(cell, unit, limits, told):
    text = MJCF.replace('angle="radian"', f'angle="{unit}"')
    cell.write_text(text.replace('range="-2 2" armature', f'range="{limits}" armature'))
    assert limits in cell.read_text()
    notes = plain_arm(cell, ["shoulder", "elbow"]).notes
    of_shoulder = [note for note in notes if note.startswith("joint 'shoulder'")]
    assert len(of_shoulder) == (told is not None)
    assert told is None or told in of_shoulder[0]


@pytest.mark.slow
def test_a_build_like_a_known_arm_says_so_and_keeps_it(arm_path, tmp_path):
    """The numbers stand in drives.toml with their source, and are given when built again."""
    built = build(arm_path, Drives(), "my_arm", like="manutec")
    told = next(line for line in built.notes if line.startswith("taken from Manutec r3"))
    assert "coulomb_friction" in told and "gear_ratio" in told and "torque_limit" not in told
    (tmp_path / "drives.toml").write_text(built.drives)
    assert "like Manutec r3: ratios, rotors" in built.drives
    again = read_drives(tmp_path / "drives.toml")
    assert again.of("lift")["gear_ratio"] == 210.0
    assert "torque_limit" not in again.of("lift")

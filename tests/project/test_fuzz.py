"""Input that is wrong in ways that nobody thought of: one clear line, and never a traceback.

Each test changes a good file in up to three places, as `hypothesis` chooses them. What reads the
file either accepts it or refuses it with an `InputError` of one line. The changes are the same in
every run. `make fuzz` tries more of them.
"""

import os
import re
import resource
from contextlib import contextmanager
from functools import partial

import h5py
import numpy as np
import pytest
from conftest import SWING, TWO_AXES
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from faultgen.building.drives import read_drives
from faultgen.building.plain import plain_arm
from faultgen.dataset.experiment import load_experiment
from faultgen.dataset.planning import plan_runs
from faultgen.dataset.reader import open_dataset
from faultgen.dataset.sweep import generate
from faultgen.discovery import check_recording, read_recording
from faultgen.errors import InputError
from faultgen.fleet.plan import load_fleet
from faultgen.importing import load_map
from faultgen.recordings.import_log import import_log
from faultgen.robot import load_robot
from faultgen.simulation.arm import Arm
from faultgen.simulation.motion import plan
from faultgen.tasks import load_task

TIMES = int(os.environ.get("FAULTGEN_FUZZ", "60"))
"""Number of inputs of each test."""

fuzz = partial(
    settings,
    max_examples=TIMES,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=list(HealthCheck),
)

NASTY = [
    *("", " ", "\n", "0", "1", "-1", "2", "-0.0", "0.5", "1e-300", "1e9", "1e308", "-1e308"),
    *("nan", "inf", "-inf", "9" * 30, "1_000", "0x10", "1,5", "1;2", "true", "none", "axis", "é"),
    *('"', "'", '""', '"x"', "[", "]", "[[", "]]", "{", "}", "[]", "{}", "<", ">", "/>", "&", "="),
    *(",", ";", "\t", "#", "\\", "../x", "/dev/null", "/dev/zero", ".", "\x00", "\ufeff", "\ud83d"),
    *("2020-01-01", "joint1", "motor1", "gearbox1", "free", "ball", "slide", "mesh", "x" * 500),
]
TOKEN = re.compile(r"[A-Za-z_]+|-?\d+\.?\d*(?:e-?\d+)?|\s+|.", re.DOTALL)


@st.composite
def changed(draw, text):
    """A text in which up to three words, numbers or signs are replaced, repeated or moved."""
    tokens = TOKEN.findall(text)
    for _ in range(draw(st.integers(1, 3))):
        at = draw(st.integers(0, len(tokens) - 1))
        how = draw(st.sampled_from(["replace", "repeat", "drop a line", "swap"]))
        if how == "replace":
            tokens[at] = draw(st.sampled_from(NASTY))
        elif how == "repeat":
            tokens[at] = tokens[at] * draw(st.sampled_from([2, 30]))
        elif how == "swap":
            other = draw(st.integers(0, len(tokens) - 1))
            tokens[at], tokens[other] = tokens[other], tokens[at]
        else:
            lines = "".join(tokens).split("\n")
            del lines[draw(st.integers(0, len(lines) - 1))]
            tokens = TOKEN.findall("\n".join(lines)) or [" "]
    return "".join(tokens).encode("utf-8", "surrogatepass")


@contextmanager
def one_line():
    """Nothing but an `InputError` of one line may be raised, and memory stays below 4 GB."""
    try:
        yield
    except InputError as error:
        assert str(error) and "\n" not in str(error), str(error)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss < 4e6


@pytest.fixture(scope="session")
def places(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fuzz")
    (folder / "tiny.xml").write_text(TWO_AXES)
    (folder / "swing.toml").write_text(SWING)
    return folder


EXPERIMENT = """
robot = "tiny.xml"
task = ["swing.toml"]
effect = ["friction_wear", "torque_ripple"]
axis = [1, [1, 2]]
schedule = "exponential"
cycles = 3
healthy = true
sensors = "realistic"
seed = 4
repetitions = 2
paired = false
sample_period = 0.004
signals = ["motor_torque"]
thin = 2
speed_window = [5, 20]
[severity]
friction_wear = [0.1, 0.2]
torque_ripple = 0.01
[parameters.torque_ripple]
order = 4
[[beside]]
effect = "backlash"
severity = 0.001
axis = 2
"""


@fuzz()
@given(data=st.data())
def test_experiments(places, data):
    text = EXPERIMENT.replace("tiny.xml", str(places / "tiny.xml"))
    text = text.replace("swing.toml", str(places / "swing.toml"))
    path = places / "experiment.toml"
    path.write_bytes(data.draw(changed(text)))
    with one_line():
        plan_runs(load_experiment(path))


TASK = """
description = "moves of all kinds"
[start]
joints = [10, 20]
[[move]]
joints = [40, 20]
speed = 0.5
dwell = 0.1
[[move]]
joints = [-40, 30]
duration = 2.0
[[move]]
joints = [10, 20]
"""


@fuzz()
@given(data=st.data())
def test_tasks(places, tiny_robot, data):
    path = places / "task.toml"
    path.write_bytes(data.draw(changed(TASK)))
    with one_line():
        plan(load_task("tiny", path), tiny_robot)


@fuzz()
@given(data=st.data())
def test_robots(places, data):
    path = places / "robot.xml"
    path.write_bytes(data.draw(changed(TWO_AXES)))
    with one_line():
        robot = load_robot(path)
        assert robot.gearing.matrix.shape == (robot.n_axes, robot.n_axes)
        Arm(robot).inverse_dynamics(*np.zeros((3, 1, robot.n_axes)))


PLAIN = """<robot name="arm">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0.1 0 0.2" rpy="0 0 0.1"/><mass value="4"/>
    <inertia ixx="0.1" ixy="0.01" ixz="0" iyy="0.1" iyz="0" izz="0.08"/></inertial></link>
  <link name="lower"><inertial><origin xyz="0 0 0.2"/><mass value="2"/>
    <inertia ixx="0.04" ixy="0" ixz="0" iyy="0.05" iyz="0" izz="0.02"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
    <origin xyz="0 0 0.3"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="100" velocity="3"/></joint>
  <joint name="elbow" type="prismatic"><parent link="upper"/><child link="lower"/>
    <origin xyz="0 0 0.4"/><axis xyz="0 0 1"/>
    <limit lower="0" upper="0.5" effort="400" velocity="1"/></joint>
</robot>
"""


@fuzz()
@given(data=st.data())
def test_plain_arms(places, data):
    path = places / "arm.urdf"
    path.write_bytes(data.draw(changed(PLAIN)))
    with one_line():
        plain_arm(path, None, None)


PLAIN_MJCF = """<mujoco model="demo">
  <compiler angle="radian"/>
  <option gravity="0 0 -9.81"/>
  <worldbody>
    <body name="upper" pos="0 0 0.3" euler="0 0 0.1">
      <inertial mass="8" pos="0 0 0.15" diaginertia="0.16 0.16 0.08"/>
      <joint name="a" axis="0 1 0" range="-1.9 1.9" damping="0.5" armature="0.1"/>
      <geom type="box" size="0.1 0.1 0.1" pos="0 0 0" mass="1"/>
      <body name="fore" pos="0 0 0.3">
        <joint name="b" axis="0 1 0" range="-1.9 1.9" ref="0.1"/>
        <geom type="capsule" fromto="0 0 0 0 0 0.3" size="0.05" density="1000"/>
        <site name="tool0" pos="0 0 0.3" size="0.01"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="a" gear="100" ctrlrange="-2 2"/></actuator>
</mujoco>
"""


@fuzz()
@given(data=st.data())
def test_plain_arms_of_mjcf(places, data):
    path = places / "plain.xml"
    path.write_bytes(data.draw(changed(PLAIN_MJCF)))
    with one_line():
        plain_arm(path, None, None)


DRIVES = """
joints = ["shoulder", "elbow"]
tool = "lower"
timestep = 0.001
gear_ratio = 100
[payload]
mass = 2.0
[elbow]
gear_ratio = 80
torque_limit = 300
coulomb_friction = 0.1
[[coupling]]
gearbox = "elbow"
joint = "shoulder"
factor = 0.5
"""


@fuzz()
@given(data=st.data())
def test_drives(places, data):
    path = places / "drives.toml"
    path.write_bytes(data.draw(changed(DRIVES)))
    with one_line():
        read_drives(path)


FLEET = """
seed = 3
robots = 4
failing = 2
days = 10
models = ["puma560"]
torque_noise = 0.01
[production]
shifts = [1, 3]
ambient = [18.0, 30.0]
[damage]
life = [120.0, 600.0]
"""


@fuzz()
@given(data=st.data())
def test_fleet_plans(places, data):
    path = places / "fleet.toml"
    path.write_bytes(data.draw(changed(FLEET)))
    with one_line():
        load_fleet(path)


def table(rows=120):
    """A short measured file."""
    time = np.arange(rows) * 0.01
    columns = {
        "time": time,
        **{f"motor_position_{k}": 30 * k * np.sin(2 * time) for k in (1, 2)},
        **{f"motor_torque_{k}": 0.3 * k * np.cos(2 * time) for k in (1, 2)},
        "temperature": 40 + time,
    }
    lines = [",".join(columns)]
    lines += [",".join(f"{x:.5g}" for x in row) for row in zip(*columns.values(), strict=True)]
    return "\n".join(lines) + "\n"


@fuzz()
@given(data=st.data())
def test_csv_recordings(places, tiny_robot, data):
    path = places / "measured.csv"
    path.write_bytes(data.draw(changed(table())))
    with one_line():
        check_recording(read_recording(path), tiny_robot)


LOG = """# cell 7; recorded by hand
Zeit [ms];A1 Ist [deg];A2 Ist [deg];A1 Strom [A];A2 Strom [A]
""" + "".join(
    f"{10 * k};{k / 7:.3f};{-k / 3:.3f};{k % 5},1;{k % 3},2\n".replace(".", ",") for k in range(80)
)

MAP = """
side = "motor"
[file]
separator = ";"
decimal = ","
comment = "#"
[axes]
gear_ratio = [100, -50]
torque_constant = 0.5
sign = [1, -1]
[time]
column = "Zeit"
unit = "ms"
[position]
columns = "A{axis} Ist"
unit = "deg"
side = "joint"
[current]
columns = ["A1 Strom", "A2 Strom"]
unit = "A"
"""


@fuzz()
@given(data=st.data())
def test_logs_and_their_maps(places, data):
    log, column_map = places / "log.txt", places / "map.toml"
    texts = [LOG.encode(), MAP.encode()]
    which = data.draw(st.integers(0, 1))
    texts[which] = data.draw(changed([LOG, MAP][which]))
    for path, text in zip((log, column_map), texts, strict=True):
        path.write_bytes(text)
    with one_line():
        import_log(log, load_map(column_map))


SHAPES = st.one_of(
    st.just((60, 2)),
    st.lists(st.integers(0, 4), max_size=4).map(tuple),
    st.sampled_from([(60,), (60, 1), (2, 60), (59, 2), (60, 2, 1), (1, 2)]),
)
VALUES = st.one_of(
    st.floats(-10, 10),
    st.sampled_from([np.nan, np.inf, -np.inf, 1e308, 1e-300]),
)
KINDS = st.sampled_from([*("f8", "f4", "i4", "u1", "?", "S3", "c16", "f2"), *("<f8", ">f8")])
ATTRIBUTES = st.one_of(
    st.floats(),
    st.integers(-(2**63), 2**63 - 1),
    st.text(st.characters(exclude_characters="\x00", exclude_categories=["Cs"]), max_size=10),
    st.lists(st.integers(-2, 70), max_size=5),
    st.sampled_from([0.01, [0], [0, 30], [0, 30, 30], "tiny", "link", "motor", b"\xff", [[0, 1]]]),
)


@fuzz()
@given(data=st.data())
def test_hdf5_recordings(places, tiny_robot, data):
    """Arrays and attributes of any shape and type."""
    path = places / "measured.h5"
    names = ["motor_position", "motor_torque", "motor_velocity", "joint_position", "joint_torque"]
    names += ["motor_current", "reference_position", "temperature", "time"]
    with h5py.File(path, "w") as file:
        for name in names[:2] + data.draw(st.lists(st.sampled_from(names[2:]), unique=True)):
            if data.draw(st.integers(0, 19)) == 0:
                continue
            shape, kind = data.draw(SHAPES), data.draw(KINDS)
            values = np.random.default_rng(0).standard_normal(shape)
            with np.errstate(all="ignore"):
                values = (values + data.draw(VALUES)).astype(kind)
            file[name] = values
        for name in ("robot", "sample_period", "segments", "payload_mass", "torque_sensor"):
            if data.draw(st.booleans()):
                file.attrs[name] = data.draw(ATTRIBUTES)
            elif name == "sample_period":
                file.attrs[name] = 0.01
    with one_line():
        check_recording(read_recording(path), tiny_robot)


@fuzz()
@given(data=st.data())
def test_damaged_hdf5_recordings(places, tiny_robot, data):
    """Bytes of a good file are changed, or its end is missing."""
    path = places / "damaged.h5"
    with h5py.File(path, "w") as file:
        file.attrs["sample_period"] = 0.01
        for name in ("motor_position", "motor_torque"):
            file.create_dataset(name, data=np.ones((60, 2)), compression="gzip")
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(content[: data.draw(st.sampled_from([len(content), len(content) // 2, 10]))])
    with one_line():
        check_recording(read_recording(path), tiny_robot)


@pytest.fixture(scope="session")
def good(places):
    """The files of a small dataset, by their path."""
    from faultgen.dataset.experiment import make_experiment

    experiment = {"robot": str(places / "tiny.xml"), "task": str(places / "swing.toml")}
    experiment |= {"axis": [1], "cycles": 1, "signals": "none"}
    generate(make_experiment(experiment), places / "data", progress=False)
    return {
        path: path.read_bytes() for path in sorted((places / "data").rglob("*")) if path.is_file()
    }


@fuzz()
@given(data=st.data())
def test_damaged_datasets(places, good, data):
    """A changed byte is noticed wherever it is, unless nothing was changed."""
    path = data.draw(st.sampled_from([path for path in good if path.name != ".lock"]))
    content = bytearray(good[path])
    assume(content)
    at, value = data.draw(st.integers(0, len(content) - 1)), data.draw(st.integers(0, 255))
    assume(content[at] != value)
    content[at] = value
    path.write_bytes(content)
    try:
        with one_line():
            dataset = open_dataset(places / "data")
            noticed = bool(dataset.damaged()) or len(dataset.runs) < 2
            for run in dataset.runs:
                run.read("cycle/severity")
            assert noticed, (path.name, at, value)
    finally:
        path.write_bytes(good[path])

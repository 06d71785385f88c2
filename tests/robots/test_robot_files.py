"""Robots from files of one's own: assets, included files, what is missing, and what is refused."""

import itertools
import pickle
import struct
from pathlib import Path

import numpy as np
import pytest

from faultgen.dataset.experiment import make_experiment
from faultgen.dataset.reader import open_dataset
from faultgen.dataset.sweep import generate
from faultgen.errors import InputError
from faultgen.robot import load_robot
from faultgen.simulation.plant import assemble
from faultgen.tasks import load_task

MESH = '<asset><mesh name="hull" file="hull.stl"/></asset>'
GEOM = '<geom type="mesh" mesh="hull" mass="0"/>'


def write_cube(path, size):
    """A cube as binary STL."""
    corners = np.array(list(itertools.product([0, size], repeat=3)))
    faces = "013 032 475 467 051 045 237 276 026 064 157 173".split()
    with path.open("wb") as file:
        file.write(bytes(80) + struct.pack("<I", len(faces)))
        for face in faces:
            points = corners[[int(corner) for corner in face]]
            file.write(struct.pack("<12f", 0, 0, 0, *points.ravel()) + bytes(2))


@pytest.fixture
def cad(tmp_path, tiny_robot):
    """The small robot with a mesh, in a folder beside it, and limits in an included file."""
    folder = tmp_path / "cad"
    (folder / "meshes").mkdir(parents=True)
    (folder / "parts").mkdir()
    write_cube(folder / "meshes" / "hull.stl", 0.1)
    start, end = tiny_robot.xml.index("<custom>"), tiny_robot.xml.index("</custom>") + 9
    limits = tiny_robot.xml[start:end]
    (folder / "parts" / "limits.xml").write_text(f"<mujocoinclude>{limits}</mujocoinclude>")
    xml = tiny_robot.xml.replace(limits, '<include file="parts/limits.xml"/>' + MESH)
    xml = xml.replace('<compiler angle="radian"/>', '<compiler angle="radian" meshdir="meshes"/>')
    path = folder / "cad.xml"
    path.write_text(xml.replace('<body name="link2"', GEOM + '<body name="link2"'))
    return path


def test_files_are_found_beside_the_model(cad, tiny_robot, monkeypatch, tmp_path):
    """Wherever the command is started: meshes and included files are those of the folder."""
    monkeypatch.chdir(tmp_path)
    robot = load_robot(cad)
    assert robot.model.nmesh == 1
    np.testing.assert_array_equal(robot.motor_velocity_limit, tiny_robot.motor_velocity_limit)
    assert load_robot("cad/cad.xml").sha256 == robot.sha256


def test_every_copy_has_the_files(cad):
    """Edits, the rigid arm, and what goes to another process."""
    robot = load_robot(cad)
    copy = pickle.loads(pickle.dumps(robot))
    cad.unlink()
    for one in (robot, copy):
        assert one.spec().compile().nmesh == 1
    assert robot.edited(assemble_spec(robot)).model.nmesh == 1
    assert assemble(robot, []).model.nmesh == 1


def assemble_spec(robot):
    spec = robot.spec()
    spec.compile()
    return spec


def test_the_model_is_told_apart_by_its_files(cad):
    before = load_robot(cad).sha256
    write_cube(cad.parent / "meshes" / "hull.stl", 0.2)
    assert load_robot(cad).sha256 != before


def test_datasets_of_robots_with_meshes(cad, tiny_task_path, tmp_path):
    """Two processes make them; the file names the assets by their checksums."""
    entries = {"robot": str(cad), "task": tiny_task_path, "axis": [1], "cycles": 1}
    done = generate(make_experiment(entries), tmp_path / "out", workers=2, progress=False)
    assert (done.done, done.failed) == (2, {})
    run = open_dataset(tmp_path / "out").runs[0]
    assert "meshes/hull.stl" in run["asset_sha256"]


def test_missing_files_are_named(cad):
    (cad.parent / "meshes" / "hull.stl").unlink()
    with pytest.raises(InputError, match="MuJoCo cannot read the model: .*hull.stl"):
        load_robot(cad)
    (cad.parent / "parts" / "limits.xml").unlink()
    with pytest.raises(InputError, match="included file .*limits.xml: cannot be read"):
        load_robot(cad)


def test_files_that_include_themselves_are_refused(cad):
    (cad.parent / "parts" / "limits.xml").write_text(
        '<mujocoinclude><include file="parts/limits.xml"/></mujocoinclude>'
    )
    with pytest.raises(InputError, match="limits.xml includes itself"):
        load_robot(cad)


def written(tmp_path, tiny_robot, *changes):
    path = tmp_path / "own.xml"
    xml = tiny_robot.xml
    for old, new in changes:
        assert old in xml
        xml = xml.replace(old, new)
    path.write_text(xml)
    return path


def test_all_that_is_missing_is_reported_at_once(tiny_robot, tmp_path):
    path = written(
        tmp_path,
        tiny_robot,
        ('<joint name="motor2"/>', '<joint name="rotor2"/>'),
        ('"motor2"', '"rotor2"'),
        ('name="drive1"', 'name="servo1"'),
        ('name="friction2"', 'name="rubbing2"'),
        ('name="gearbox1"', 'name="reducer1"'),
    )
    with pytest.raises(InputError) as caught:
        load_robot(path)
    assert str(caught.value) == (
        "robot own: no joint named 'motor2'; no tendon named 'gearbox1'; "
        "no actuator named 'drive1', 'friction2' (see docs/robots.md)"
    )


def test_all_that_is_wrong_is_reported_at_once(tiny_robot, tmp_path):
    path = written(
        tmp_path,
        tiny_robot,
        ('timestep="0.001"', 'timestep="0"'),
        ('data="300 300"', 'data="300 -1"'),
        ('data="10 10"', 'data="10"'),
        ('coef="-1"', 'coef="-2"'),
    )
    with pytest.raises(InputError) as caught:
        load_robot(path)
    for part in (
        "timestep",
        "motor_velocity_limit of axis 2",
        "'joint_acc",
        "gearbox1",
        "gearbox2",
    ):
        assert part in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('timestep="0.001"', 'timestep="0"', "timestep must be from 1e-05 to 0.1 s, not 0"),
        ('timestep="0.001"', 'timestep="-1"', "timestep must be from 1e-05 to 0.1 s, not -1"),
        ('timestep="0.001"', 'timestep="1e-9"', "timestep must be from 1e-05 to 0.1 s, not 1e-09"),
        ('timestep="0.001"', 'timestep="nan"', "an attribute of the model is NaN"),
        ('data="300 300"', 'data="300 0"', "velocity_limit of axis 2 must be positive, not 0"),
        ('data="300 300"', 'data="nan 1"', "an attribute of the model is NaN"),
        ('data="10 10"', 'data="-1 10"', "acceleration_limit of axis 1 must be positive, not -1"),
        ('data="1000 1000"', 'data="-1 0"', "encoder_counts of axis 1 must not be negative"),
        ('range="-3 3"', 'range="0 0"', "joint1: width of its range must be positive, not 0"),
        ('range="-3 3"', 'range="3 -3"', "joint1: width of its range must be positive, not -6"),
        ('range="-3 3"', 'range="nan nan"', "an attribute of the model is NaN"),
        ('range="-3 3"', 'range="inf inf"', "joint1: width of its range must be positive, not nan"),
        ('range="-3 3"', "range = '0 0'", "joint1: width of its range must be positive, not 0"),
        ('saturation="2 0 0"', 'saturation="-2 0 0"', "saturation must not be negative"),
        ('saturation="2 0 0"', 'saturation="nan 0 0"', "an attribute of the model is NaN"),
        ('stiffness="20000"', 'stiffness="0"', "gearbox1: stiffness must be positive, not 0"),
        ('0.1 0.15 5"', '0.1 0.15 0"', "friction2: Stribeck velocity must be positive, not 0"),
        ('mass="3"', 'mass="inf"', "robot own: "),
        ('input="pos vel ff"', 'input="pos"', "actuator 'drive1' must be a dcmotor on motor1"),
        ('name="friction1" joint="motor1"', 'name="friction1" joint="motor2"', "'friction1' must"),
    ],
)
def test_senseless_numbers_are_refused(tiny_robot, tmp_path, monkeypatch, capfd, old, new, message):
    """One line, nothing printed beside it, and no log file of MuJoCo."""
    path = written(tmp_path, tiny_robot, (old, new))
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    with pytest.raises(InputError, match=message) as caught:
        load_robot(path)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")
    assert not list(folder.iterdir())


def test_limits_in_a_comment_or_without_numbers_do_not_count(tiny_robot, tmp_path):
    """A joint whose range is empty has no limits, and a comment in the file gives none."""
    comment = '<worldbody><!-- <joint name="joint2" range="nan nan"/> -->'
    empty = ('axis="0 0 1" range="-3 3"', 'axis="0 0 1" range=""')
    path = written(tmp_path, tiny_robot, ("<worldbody>", comment), empty)
    assert np.isinf(load_robot(path).joint_range[0]).all()
    assert load_robot(path).joint_range[1].tolist() == [-3, 3]


HUGE = {
    "height field": '<asset><hfield name="h" nrow="40000" ncol="40000" size="1 1 1 1"/></asset>',
    "texture": '<asset><texture name="t" type="2d" builtin="flat" width="40000" height="40000"/>'
    "</asset>",
    "memory": '<size memory="200G"/>',
}


@pytest.mark.parametrize("case", HUGE)
def test_models_that_take_gigabytes_are_refused(tiny_robot, tmp_path, case):
    """They are compiled in another process first, whose memory is limited."""
    pytest.importorskip("resource")
    path = written(tmp_path, tiny_robot, ("<custom>", HUGE[case] + "<custom>"))
    with pytest.raises(InputError, match="robot own: the model needs more than 2 GiB"):
        load_robot(path)


def test_sensible_assets_are_taken(tiny_robot, tmp_path):
    """A height field and a texture of some kilobytes are no reason to refuse a robot."""
    small = HUGE["height field"].replace("40000", "40"), HUGE["texture"].replace("40000", "64")
    path = written(tmp_path, tiny_robot, ("<custom>", "".join(small) + "<custom>"))
    assert load_robot(path).model.nhfield == 1


def test_many_copies_are_refused(tiny_robot, tmp_path):
    """`replicate` within `replicate`, before MuJoCo makes the copies."""
    many = '<replicate count="{}"><replicate count="200"><geom size="1"/></replicate></replicate>'
    path = written(
        tmp_path, tiny_robot, ('<body name="rotor1">', many.format(300) + '<body name="rotor1">')
    )
    with pytest.raises(InputError, match="'replicate' makes 60000 copies, more than 10000"):
        load_robot(path)
    path = written(
        tmp_path, tiny_robot, ('<body name="rotor1">', many.format(2) + '<body name="rotor1">')
    )
    assert load_robot(path).model.ngeom == 400


def test_other_models_inside_are_refused(tiny_robot, tmp_path):
    part = '<asset><model name="gripper" file="gripper.xml"/></asset><custom>'
    with pytest.raises(InputError, match="attaches another model"):
        load_robot(written(tmp_path, tiny_robot, ("<custom>", part)))


@pytest.mark.parametrize("what", ["/dev/zero", "folder", "huge", "latin"])
def test_what_is_no_text_file_is_refused(tmp_path, what, monkeypatch):
    """Devices, folders, huge files and other encodings, as robot, task or experiment."""
    from faultgen.dataset.experiment import load_experiment

    path = tmp_path / "file"
    if what == "folder":
        path.mkdir()
    elif what == "huge":
        with path.open("wb") as file:
            file.truncate(2**40)
    elif what == "latin":
        path.write_bytes("name = 'Gerät'".encode("latin-1"))
    else:
        path = "/dev/zero"
    for read in (load_robot, load_experiment, lambda path: load_task("tiny", path)):
        with pytest.raises(InputError, match="cannot be read|has no robot.json") as caught:
            read(path)
        assert "\n" not in str(caught.value)


def test_long_cycles_are_refused(tiny_robot_path, tmp_path):
    """An hour may be too long for a robot of short time steps."""
    robot = tmp_path / "fine.xml"
    robot.write_text(Path(tiny_robot_path).read_text().replace('0.001" int', '0.0005" int'))
    task = tmp_path / "long.toml"
    task.write_text(
        'description = "waits"\n[start]\njoints = [0, 0]\n[[move]]\njoints = [1, 0]\n'
        "[[move]]\njoints = [0, 0]\ndwell = 3500\n"
    )
    entries = {"robot": str(robot), "task": str(task), "cycles": 1}
    with pytest.raises(InputError, match="has more than 5e.06 steps"):
        generate(make_experiment(entries), tmp_path / "out", progress=False)

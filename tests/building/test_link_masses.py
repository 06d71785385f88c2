"""Links that state no mass: what their shapes fill, what is assumed, and what the user can give."""

import json
import re
import tomllib
from itertools import pairwise

import mujoco
import numpy as np
import pytest
from plain_arm import NAMES, urdf
from typer.testing import CliRunner

from faultgen.building.build import build
from faultgen.building.drives import Drives, read_drives
from faultgen.building.masses import DENSITY
from faultgen.building.plain import plain_arm
from faultgen.building.shapes import fill
from faultgen.cli.app import app
from faultgen.errors import InputError

R, LENGTH = 0.06, 0.3
CYLINDER = np.pi * R**2 * LENGTH


def filled(*geoms):
    """What shapes fill, each given by the attributes of a geom."""
    lines = "".join(f"<geom {one}/>" for one in geoms)
    tetrahedron = '<mesh name="t" vertex="0 0 0 .1 0 0 0 .1 0 0 0 .1"/>'
    spec = mujoco.MjSpec.from_string(
        f"<mujoco><asset>{tetrahedron}</asset><worldbody>{lines}</worldbody></mujoco>"
    )
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return fill(model, data, range(model.ngeom))


@pytest.mark.parametrize(
    ("geoms", "volume", "centre"),
    [
        (['type="box" size=".1 .2 .3"'], 0.048, (0, 0, 0)),
        (['type="box" size=".1 .1 .1"'] * 5, 0.008, (0, 0, 0)),
        (['type="sphere" size=".1"'], 4 / 3 * np.pi * 1e-3, (0, 0, 0)),
        (['type="ellipsoid" size=".1 .2 .05"'], 4 / 3 * np.pi * 1e-3, (0, 0, 0)),
        (['type="cylinder" size=".1 .2" pos="1 0 0"'], np.pi * 4e-3, (1, 0, 0)),
        (['type="capsule" size=".1 .2"'], np.pi * (4e-3 + 4 / 3 * 1e-3), (0, 0, 0)),
        (['type="mesh" mesh="t" pos="0 0 2"'], 1e-3 / 6, (0.025, 0.025, 2.025)),
        # half of the second box is in the first one
        (
            ['type="box" size=".1 .1 .1"', 'type="box" size=".1 .1 .1" pos=".1 0 0"'],
            0.012,
            (0.05, 0, 0),
        ),
        # apart, of different size, and turned
        (
            [
                'type="box" size=".1 .1 .1" pos="-1 0 0" euler="20 30 40"',
                'type="sphere" size=".02" pos="1 0 0"',
            ],
            0.008 + 4 / 3 * np.pi * 8e-6,
            (-1 + 2 * 4 / 3 * np.pi * 8e-6 / (0.008 + 4 / 3 * np.pi * 8e-6), 0, 0),
        ),
    ],
)
def test_overlapping_shapes_fill_their_union(geoms, volume, centre):
    """Closed forms, within 1 %, which is the error of the points that sample them."""
    found = filled(*geoms)
    assert found.volume == pytest.approx(volume, rel=0.01)
    np.testing.assert_allclose(found.centre, centre, atol=2e-3)


def test_the_inertia_is_that_of_the_union():
    """Two boxes that form one longer box, turned; within 2 %."""
    turned = 'euler="0 0 90"'
    found = filled(
        f'type="box" size=".2 .1 .05" pos="0 .1 0" {turned}',
        f'type="box" size=".2 .1 .05" pos="0 -.1 0" {turned}',
    )
    x, y, z = 0.1, 0.3, 0.05  # half sizes of the union
    mass = 8 * x * y * z
    wanted = mass / 3 * np.diag([y * y + z * z, x * x + z * z, x * x + y * y])
    np.testing.assert_allclose(found.inertia, wanted, atol=0.02 * wanted.max())


def test_shapes_without_volume_fill_nothing():
    assert filled('type="plane" size="1 1 1"') is None


def bare(*changes, shapes=2):
    """The plain arm with shapes instead of masses: each visible, and several times for contacts."""
    geometry = f'<geometry><cylinder radius="{R}" length="{LENGTH}"/></geometry>'
    link = f"<visual>{geometry}</visual>" + shapes * f"<collision>{geometry}</collision>"
    text = re.sub(r"<inertial>.*?</inertial>", link, urdf())
    payload = text.index('<link name="payload">')
    text = text[:payload] + urdf()[urdf().index('<link name="payload">') :]
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return text


def masses(path, given=None):
    """Masses of the moving links of an arm by name, and the arm."""
    arm = plain_arm(path, mass=given)
    model = mujoco.MjModel.from_xml_string(arm.xml)
    return {f"{name}": model.body(f"{name}_link").mass[0] for name in NAMES}, arm


@pytest.mark.parametrize("shapes", [0, 1, 4])
def test_shapes_of_a_link_count_once(tmp_path, shapes):
    """Visible ones, and those for contacts however often they are repeated."""
    path = tmp_path / "arm.urdf"
    path.write_text(bare(shapes=shapes))
    found, arm = masses(path)
    for name in NAMES:
        assert found[name] == pytest.approx(DENSITY * CYLINDER, rel=0.01)
    model = mujoco.MjModel.from_xml_string(arm.xml)
    inertia = DENSITY * CYLINDER * (3 * R**2 + LENGTH**2) / 12
    assert np.sort(model.body("lift_link").inertia)[-1] == pytest.approx(inertia, rel=0.03)


def test_shapes_of_fixed_links_do_not_add_up(tmp_path):
    """Coarse shapes about a link, on a link of their own, as in models of cobots."""
    coarse = (
        '<link name="coarse"><collision><geometry><cylinder radius="0.06" length="0.3"/></geometry>'
        '</collision></link><joint name="rigid" type="fixed"><parent link="lift_link"/>'
        '<child link="coarse"/></joint></robot>'
    )
    path = tmp_path / "arm.urdf"
    path.write_text(bare(("</robot>", coarse)))
    found, arm = masses(path)
    assert found["lift"] == pytest.approx(DENSITY * CYLINDER, rel=0.01)
    assert mujoco.MjModel.from_xml_string(arm.xml).body("coarse").mass[0] == 0
    # and beside a link that states its mass they weigh nothing
    path.write_text(urdf(("</robot>", coarse)))
    found, arm = masses(path)
    assert found["lift"] == 5.0
    assert mujoco.MjModel.from_xml_string(arm.xml).body("coarse").mass[0] == 0
    assert any(note.startswith("link 'coarse' states no mass and is fixed") for note in arm.notes)
    assert not arm.masses.warnings


def test_assumed_masses_are_named_written_and_remembered(tmp_path):
    """One warning names every link; the robot keeps it, and `check` repeats it."""
    path, folder = tmp_path / "arm.urdf", tmp_path / "made"
    path.write_text(bare(('effort="', 'effort="5')))
    run = CliRunner().invoke
    done = run(app, ["robot", "build", str(path), "-o", str(folder)])
    assert done.exit_code == 0, done.output
    listed = ", ".join(f"'{name}_link'" for name in NAMES)
    line = f"links {listed} state no mass; assumed "
    assert f"faultgen: warning: {line}" in done.stderr
    assert "state mass = TOTAL or the mass of each link in [mass] of drives.toml" in done.stderr
    text = (folder / "drives.toml").read_text()
    assert text.count("assumed: 1100 kg/m^3 of its shapes") == len(NAMES)
    checked = run(app, ["robot", "check", str(folder), "--json"])
    told = json.loads(checked.stdout)["warnings"]
    assert sum(line in one for one in told) == 1 and line in checked.stderr
    plain = run(app, ["robot", "check", str(path), "--json"])
    assert any(line in one for one in json.loads(plain.stdout)["warnings"])
    # the masses that were written can be given, and then nothing is assumed
    edited = tmp_path / "edited.toml"
    edited.write_text(text.replace("# mass.", "mass."))
    assert len(tomllib.loads(edited.read_text())["mass"]) == len(NAMES)
    again = plain_arm(path, mass=read_drives(edited).mass)
    assert not again.masses.warnings


def test_a_mass_that_is_given_for_the_arm_is_shared_by_volume(tmp_path):
    """Links that state a mass keep it; the payload is not part of the arm."""
    path = tmp_path / "arm.urdf"
    path.write_text(bare())
    found, arm = masses(path, 30.0)
    assert sum(found.values()) == pytest.approx(30.0, rel=1e-6)
    assert max(found.values()) == pytest.approx(5.0, rel=1e-3)
    assert not arm.masses.warnings and any("given 30 kg" in note for note in arm.notes)
    text = bare()
    start = text.index('<link name="pan_link">') + len('<link name="pan_link">')
    inertial = re.search(r"<inertial>.*?</inertial>", urdf()).group()
    path.write_text(text[:start] + inertial + text[start:])
    found, _ = masses(path, 31.0)
    assert found["pan"] == 6.0
    assert found["yaw"] == pytest.approx(5.0, rel=1e-3)


def test_a_mass_that_is_given_for_a_link_is_used(tmp_path):
    """With the inertia of its shapes, or with its own inertia if it states one."""
    path = tmp_path / "arm.urdf"
    path.write_text(bare())
    found, arm = masses(path, {"elbow_link": 7.0})
    assert found["elbow"] == 7.0 and found["lift"] == pytest.approx(DENSITY * CYLINDER, rel=0.01)
    assert "elbow_link" not in arm.masses.warnings[0] and "lift_link" in arm.masses.warnings[0]
    model = mujoco.MjModel.from_xml_string(arm.xml)
    wanted = 7.0 * (3 * R**2 + LENGTH**2) / 12
    assert np.sort(model.body("elbow_link").inertia)[-1] == pytest.approx(wanted, rel=0.03)
    path.write_text(urdf())
    before = mujoco.MjModel.from_xml_string(masses(path)[1].xml).body("elbow_link").inertia
    found, arm = masses(path, {"elbow_link": 8.0})
    assert found["elbow"] == 8.0 and found["lift"] == 5.0
    after = mujoco.MjModel.from_xml_string(arm.xml).body("elbow_link").inertia
    np.testing.assert_allclose(after, 2 * before, rtol=1e-9)


def test_a_link_without_mass_and_shape_can_be_given_one(tmp_path):
    """It is refused without, and the remedy works."""
    path = tmp_path / "arm.urdf"
    path.write_text(urdf(('<mass value="4.0"/>', '<mass value="0"/>')))
    with pytest.raises(InputError, match=r"'elbow_link'.* or its mass in \[mass\] of drives.toml"):
        plain_arm(path)
    found, _ = masses(path, {"elbow_link": 4.0})
    assert found["elbow"] == 4.0


def test_a_tiny_mass_counts_as_none_where_there_is_a_shape(tmp_path):
    shape = '<collision><geometry><sphere radius="0.05"/></geometry></collision>'
    path = tmp_path / "arm.urdf"
    path.write_text(
        urdf(
            ('<mass value="4.0"/>', '<mass value="1e-6"/>'),
            ('<link name="elbow_link">', f'<link name="elbow_link">{shape}'),
        )
    )
    found, arm = masses(path)
    assert found["elbow"] == pytest.approx(DENSITY * 4 / 3 * np.pi * 0.05**3, rel=0.01)
    assert "'elbow_link' states no mass" in arm.masses.warnings[0]


def test_masses_and_densities_of_shapes_in_mjcf_are_believed(tmp_path):
    """Only shapes with MuJoCo's own density have an invented mass."""
    path = tmp_path / "arm.xml"
    joint, at = '<joint axis="0 1 0" range="-90 90"/>', 'pos="0 0 0.4"'
    path.write_text(
        f'<mujoco><worldbody><body name="a">{joint}<geom size="0.1" mass="3"/>'
        f'<body name="b" {at}>{joint}<geom size="0.1" density="2700"/>'
        f'<body name="c" {at}>{joint}<geom size="0.1"/></body></body></body></worldbody></mujoco>'
    )
    arm = plain_arm(path)
    model = mujoco.MjModel.from_xml_string(arm.xml)
    ball = 4 / 3 * np.pi * 1e-3
    wanted = (3.0, 2700 * ball, DENSITY * ball)
    for name, mass in zip("abc", wanted, strict=True):
        assert model.body(name).mass[0] == pytest.approx(mass, rel=0.01)
    assert arm.masses.warnings[0].startswith("link 'c' states no mass; assumed 4.6")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("mass = -3", r"mass: must be a number of kg above 0 and up to 100000, not -3"),
        ("mass = true", "mass: must be a number of kg above 0 .*, not True"),
        ("[mass]\nyaw_link = 0", "mass: yaw_link: must be a number of kg above 0 .*, not 0"),
        ("[mass]\nhand = 2", "drives: mass: no link 'hand'; the arm has base, elbow_link"),
        ("mass = 3", "drives: mass: every link of the model states one"),
    ],
)
def test_wrong_masses_get_one_line(tmp_path, given, message):
    path, drives = tmp_path / "arm.urdf", tmp_path / "drives.toml"
    path.write_text(urdf())
    drives.write_text(given)
    with pytest.raises(InputError, match=message) as refused:
        build(path, read_drives(drives), "x")
    assert "\n" not in str(refused.value)


def test_an_arm_cannot_weigh_less_than_its_links(tmp_path):
    path = tmp_path / "arm.urdf"
    text = urdf(('<mass value="4.0"/>', '<mass value="0"/>'))
    shape = '<collision><geometry><sphere radius="0.05"/></geometry></collision>'
    path.write_text(text.replace('<link name="elbow_link">', f'<link name="elbow_link">{shape}'))
    with pytest.raises(
        InputError, match=r"state one weigh 13.8 kg, so that the arm cannot weigh 9"
    ):
        plain_arm(path, mass=9.0)


def test_results_are_always_the_same(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(bare())
    texts = [build(path, Drives(joints=list(NAMES[:2])), "same").robot.xml for _ in range(2)]
    assert all(a == b for a, b in pairwise(texts))

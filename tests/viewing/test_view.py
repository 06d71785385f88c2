"""Looking at robots: what is drawn is where it should be, in software as by OpenGL."""

import json
import os
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from conftest import faultgen, faultgen_here
from PIL import Image

from faultgen.errors import InputError
from faultgen.robot import load_robot
from faultgen.viewing.canvas import open_canvas
from faultgen.viewing.film import save_film, save_picture
from faultgen.viewing.painter import Painter, triangles
from faultgen.viewing.playback import play
from faultgen.viewing.stage import FLOOR, LIGHT, LINE, Stage
from faultgen.viewing.window import open_window, require_display


@pytest.fixture(scope="module")
def shown(tiny_robot_path, tiny_task_path):
    """A cycle of the tiny robot, healthy and with a worn second axis."""
    return play(str(tiny_robot_path), str(tiny_task_path), axis=2, severity=0.5)


@pytest.fixture
def in_software(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "disable")


def picture(geoms, *, lookat=(0, 0, 0), distance=10.0, size=200):
    """Geoms in MJCF, drawn in software by a camera that looks along the x axis."""
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{geoms}</worldbody></mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    camera = SimpleNamespace(lookat=np.array(lookat, float), distance=distance)
    axes = np.array([[0, -1, 0], [0, 0, 1], [-1, 0, 0]], float)  # right, up, towards the viewer
    stage = SimpleNamespace(
        model=model,
        data=data,
        camera=camera,
        view_axes=lambda: axes,
        shown=lambda: np.arange(model.ngeom),
        floor=None,
    )
    return Painter(stage, size, size).draw()


def is_red(image):
    return (image[..., 0] > 1.8 * image[..., 1].astype(float)) & (image[..., 0] > 60)


def test_a_sphere_is_a_disc_of_the_right_size_and_place():
    """Perspective: radius r at distance d is seen under the angle asin(r / d)."""
    image = picture('<geom type="sphere" size="1" pos="0 1.5 0" rgba="1 0 0 1"/>')
    rows, columns = np.nonzero(is_red(image))
    scale = 100 / np.tan(np.radians(45) / 2)  # MuJoCo's usual angle is 45 degrees
    assert len(rows) == pytest.approx(np.pi * (scale * 0.1) ** 2, rel=0.05)
    assert rows.mean() == pytest.approx(99.5, abs=1)  # upright in the middle
    assert columns.mean() == pytest.approx(99.5 - scale * 0.15, abs=1)  # y points to the left


def test_what_is_nearer_covers_what_is_behind():
    """Whatever comes first in the model."""
    near = '<geom type="box" size="0.1 0.5 0.5" pos="-2 0 0" rgba="1 0 0 1"/>'
    far = '<geom type="box" size="0.1 1 1" pos="2 0 0" rgba="0 0 1 1"/>'
    for geoms in (near + far, far + near):
        image = picture(geoms)
        assert is_red(image)[100, 100]
        assert image[100, 100 + 18, 2] > 2 * image[100, 100 + 18, 0]  # the border of the far one


@pytest.mark.parametrize(
    ("kind", "size", "volume"),
    [
        ("box", "0.1 0.2 0.3", 8 * 0.1 * 0.2 * 0.3),
        ("sphere", "0.2", 4 / 3 * np.pi * 0.2**3),
        ("ellipsoid", "0.1 0.2 0.3", 4 / 3 * np.pi * 0.1 * 0.2 * 0.3),
        ("cylinder", "0.2 0.3", np.pi * 0.2**2 * 0.6),
        ("capsule", "0.2 0.3", np.pi * 0.2**2 * 0.6 + 4 / 3 * np.pi * 0.2**3),
    ],
)
def test_shapes_are_closed_and_turned_outwards(kind, size, volume):
    """The volume within the triangles, by the divergence theorem, is that of the shape."""
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><geom type="{kind}" size="{size}"/></worldbody></mujoco>'
    )
    a, b, c = triangles(model, 0).transpose(1, 0, 2)
    found = np.einsum("ij,ij->", a, np.cross(b, c)) / 6
    assert 0.93 * volume < found <= volume * (1 + 1e-9)


def test_the_camera_sees_all_of_the_robot_in_every_pose(in_software):
    """Nothing of the robot touches the border; the robot fills a good part of the picture."""
    robot = load_robot("puma560")
    position = np.linspace([-1, -0.5, -2, 0, 0, 0], [1.5, 1.0, 0, 0, 1, 0], 40)
    stage = Stage(robot, position)
    stage.model.geom_rgba[:] = [1, 0, 0, 1]
    stage.model.geom_matid[:] = -1
    reached = np.zeros((160, 160), bool)
    with open_canvas(stage, width=160, height=160) as canvas:
        for row in position[::6]:
            stage.pose(row)
            reached |= is_red(canvas.draw())
    border = np.concatenate([reached[0], reached[-1], reached[:, 0], reached[:, -1]])
    assert not border.any()
    rows, columns = np.nonzero(reached)
    assert max(np.ptp(rows), np.ptp(columns)) > 0.7 * 160


@pytest.mark.parametrize("payload", [False, True], ids=["no shapes", "payload only"])
def test_a_robot_without_shapes_is_drawn_as_sticks(tiny_robot, payload):
    """Also if its last link has one: the payload is drawn where faultgen adds one."""
    spec = tiny_robot.spec()
    for geom in list(spec.geoms):
        spec.delete(geom)
    if payload:
        spec.body("payload").add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.05, 0.05, 0.05], mass=0
        )
    spec.compile()
    model = Stage(tiny_robot.edited(spec), np.zeros((2, 2))).model
    sticks = np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_CAPSULE)
    assert {model.body(model.geom_bodyid[k]).name for k in sticks} == {"link1", "link2"}


def test_a_floor_of_the_file_itself_is_hidden(tiny_robot):
    spec = tiny_robot.spec()
    spec.worldbody.add_geom(
        name="ground", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], rgba=[0, 1, 0, 1]
    )
    spec.compile()
    model = Stage(tiny_robot.edited(spec), np.zeros((2, 2))).model
    planes = np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE)
    seen = [model.geom(k).name for k in planes if model.geom_rgba[k, 3] > 0]
    assert seen == ["faultgen_floor"]


def test_opengl_and_software_draw_the_same_shape():
    """Silhouettes of the PUMA agree to within the width of a pixel at the edges."""
    stage = Stage(load_robot("puma560"), np.zeros((2, 6)))
    stage.pose(np.array([0.4, 0.3, -1.5, 0, 0.5, 0]))
    robot = stage.model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE
    stage.model.geom_rgba[robot] = [1, 0, 0, 1]
    stage.model.geom_matid[:] = -1
    images = {}
    for asked in ("egl", "osmesa", "disable"):
        os.environ["MUJOCO_GL"] = asked
        try:
            with open_canvas(stage, width=200, height=200) as canvas:
                images[canvas.name] = is_red(canvas.draw())
        except InputError:
            continue
        finally:
            del os.environ["MUJOCO_GL"]
    software = images.pop("software")
    if not images:
        pytest.skip("no OpenGL library works on this machine (neither EGL nor OSMesa)")
    for drawn in images.values():
        assert software.sum() > 2000
        assert np.count_nonzero(drawn != software) < 0.06 * software.sum()


def test_the_faulty_link_is_red(shown, in_software):
    """And only in the picture of the faulty robot."""
    stage = Stage(shown[0].robot, shown[0].position)
    found = []
    with open_canvas(stage, width=120, height=120) as canvas:
        for one in shown:
            stage.pose(one.position[0])
            stage.paint(one.axis)
            found.append(np.count_nonzero(is_red(canvas.draw())))
    assert found[0] == 0 and found[1] > 20


def test_a_cycle_is_played_healthy_and_worn(shown, tiny_robot_path, tiny_task_path):
    """Friction against the motion of the worn axis; the other axis hardly changes."""
    healthy, worn = shown
    assert (healthy.name, worn.name) == ("healthy", "axis 2: friction_wear 50 %")
    assert len(healthy.times) == len(healthy.position) == len(worn.torque)
    change = np.abs(worn.torque - healthy.torque).mean(axis=0)
    assert change[1] > 10 * change[0]
    (alone,) = play(str(tiny_robot_path), str(tiny_task_path))
    np.testing.assert_array_equal(alone.torque, healthy.torque)


@pytest.mark.slow
def test_a_gif_repeats_and_its_curves_grow(shown, in_software, tmp_path):
    """Ten pictures a second; the last one shows all of the curve, the first one nothing."""
    assert save_film(shown, tmp_path / "a.gif") == "software"
    with Image.open(tmp_path / "a.gif") as film:
        assert film.info["loop"] == 0 and film.info["duration"] == 100
        assert film.n_frames == len(np.arange(0, shown[0].times[-1], 0.1))
        drawn = []
        for number in (0, film.n_frames // 2, film.n_frames - 1):
            film.seek(number)
            below = np.asarray(film.convert("RGB"), int)[-160:, :320]
            drawn.append(np.count_nonzero((below[..., 0] > 150) & (below[..., 1] < 90)))
    assert drawn[0] < drawn[1] < drawn[2]


def test_a_picture_shows_one_or_two_robots(shown, in_software, tmp_path):
    """Side by side, at the same size."""
    save_picture(shown[:1], tmp_path / "one.png")
    save_picture(shown, tmp_path / "two.png")
    with Image.open(tmp_path / "one.png") as one, Image.open(tmp_path / "two.png") as two:
        assert two.width == 2 * one.width


def test_mp4_is_written(shown, in_software, tmp_path):
    """25 pictures a second."""
    av = pytest.importorskip("av", reason="the package av encodes MP4")
    short = [SimpleNamespace(**vars(one)) for one in shown]
    for one in short:
        one.times, one.position, one.torque = one.times[:50], one.position[:50], one.torque[:50]
    save_film(short, tmp_path / "a.mp4")
    with av.open(str(tmp_path / "a.mp4")) as film:
        assert len(list(film.decode(video=0))) == len(np.arange(0, short[0].times[-1], 0.04))


def test_without_a_display_there_is_one_line(monkeypatch, shown):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    with pytest.raises(InputError, match="there is no display here; give --video out.gif"):
        require_display()
    with pytest.raises(InputError, match="no display"):
        open_window(shown)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["r2d2", "--image", "a.png"], "unknown robot 'r2d2'"),
        (["puma560", "--video", "a.avi"], "a.avi: the name must end in .gif or .mp4"),
        (["puma560", "--image", "no/a.png"], "the folder no does not exist"),
        (["puma560", "--axis", "9", "--image", "a.png"], "axis 9: robot puma560 has axes 1 to 6"),
        (["puma560", "--severity", "-1", "--image", "a.png"], "friction_wear takes -0.9 to 10"),
    ],
)
def test_wrong_input_is_one_line(arguments, message, tmp_path):
    done = faultgen_here("view", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert message in done.stderr and done.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_the_command_writes_a_picture(tiny_robot_path, tiny_task_path, tmp_path):
    """Of any robot and task that the other commands accept."""
    command = ("view", tiny_robot_path, "--task", tiny_task_path, "--axis", 1)
    off = {"MUJOCO_GL": "disable"}
    done = faultgen(*command, "--image", "a.png", "--json", cwd=tmp_path, variables=off)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["shown"] == ["healthy", "axis 1: friction_wear 20 %"]
    assert (told["drawn_with"], told["image"]) == ("software", "a.png")
    assert (tmp_path / "a.png").is_file()


def test_an_opengl_library_that_is_asked_for_and_missing_is_named(monkeypatch, shown):
    """One line says what to install."""
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    monkeypatch.setattr(
        "faultgen.viewing.canvas.import_module", lambda name: SimpleNamespace(GLContext=None)
    )
    stage = Stage(shown[0].robot, shown[0].position)
    with (
        pytest.raises(InputError, match="install the package libosmesa6, or set MUJOCO_GL=disable"),
        open_canvas(stage, width=10, height=10),
    ):
        pass
    monkeypatch.delenv("MUJOCO_GL")
    with open_canvas(stage, width=10, height=10) as canvas:
        assert canvas.name == "software"


def test_the_floor_has_a_grid_and_a_shadow(in_software, puma):
    """From points in the shadow, the robot stands before the light; from those around, it does not.

    Points that are near to the border of the shadow, or to the robot, are left out.
    """
    position = np.tile([0.4, 0.3, -1.5, 0, 0.5, 0], (2, 1))
    stage = Stage(puma, position)
    stage.pose(position[0])
    size = 200
    with open_canvas(stage, width=size, height=size) as canvas:
        drawn = canvas.draw().astype(int)
    floor, line = (255 * np.array(one) for one in (FLOOR, LINE))

    def inner(mask):
        return mask & np.all([np.roll(mask, k, (0, 1)) for k in ((2, 2), (-2, 2), (2, -2))], axis=0)

    shadow = inner(np.abs(drawn - 0.82 * floor).max(axis=2) < 3)
    light = inner(np.abs(drawn - floor).max(axis=2) < 2)
    assert (np.abs(drawn - line).max(axis=2) < 8).sum() > 100 and shadow.sum() > 100
    light[: size // 2] = False  # near to the horizon, a pixel is wide
    axes, slope = stage.view_axes(), np.tan(np.radians(stage.model.vis.global_.fovy) / 2)
    eye = stage.camera.lookat + stage.camera.distance * axes[2]
    rng = np.random.default_rng(0)
    for mask, is_dark in ((shadow, True), (light, False)):
        for row, column in rng.permutation(np.argwhere(mask))[:40]:
            across, up = (2 * (column + 0.5) / size - 1, 1 - 2 * (row + 0.5) / size)
            ray = slope * (across * axes[0] + up * axes[1]) - axes[2]
            point = eye + (stage.floor.height - eye[2]) / ray[2] * ray + [0, 0, 1e-6]
            hit = np.zeros(1, np.int32)
            groups = np.array([1, 1, 1, 0, 0, 0], np.uint8)
            mujoco.mj_ray(stage.model, stage.data, point, np.array(LIGHT), groups, 1, -1, hit, None)
            assert (hit[0] >= 0) == is_dark, (row, column)


def test_the_grid_suits_the_size_of_the_robot(puma):
    """Some lines cross the room that the robot needs, but not hundreds."""
    position = np.linspace([-1, -0.5, -2, 0, 0, 0], [1.5, 1.0, 0, 0, 1, 0], 40)
    assert Stage(puma, position).floor.grid in (0.25, 0.5)


@pytest.mark.parametrize("hulls", [True, False], ids=["both", "collision shapes only"])
def test_shapes_to_look_at_hide_those_for_collisions(tiny_robot, hulls):
    """A link that has only collision shapes is drawn with them."""
    spec = tiny_robot.spec()
    link = spec.body("link1")
    for geom in list(link.geoms):
        spec.delete(geom)
    box = mujoco.mjtGeom.mjGEOM_BOX
    link.add_geom(name="hull", type=box, size=[0.1] * 3, contype=1, conaffinity=1, mass=0)
    if hulls:
        link.add_geom(name="seen", type=box, size=[0.05] * 3, contype=0, conaffinity=0, mass=0)
    spec.compile()
    stage = Stage(tiny_robot.edited(spec), np.zeros((2, 2)))
    names = {stage.model.geom(int(k)).name for k in stage.shown()}
    assert names & {"hull", "seen"} == ({"seen"} if hulls else {"hull"})


def test_fine_meshes_keep_their_hollows():
    """A ring of many faces is simplified, and still has its hole, which a hull would fill."""
    around, along = np.meshgrid(*[np.linspace(0, 2 * np.pi, 60, endpoint=False)] * 2)
    radius = 0.5 + 0.1 * np.cos(along)
    points = np.stack(
        [radius * np.cos(around), radius * np.sin(around), 0.1 * np.sin(along)], axis=-1
    )
    a, b, c, d = (
        np.roll(points, shift, axis=(0, 1)) for shift in ((0, 0), (0, -1), (-1, -1), (-1, 0))
    )
    faces = np.stack([a, b, c, a, c, d], axis=2).reshape(-1, 3, 3)
    corners, numbers = np.unique(faces.reshape(-1, 3), axis=0, return_inverse=True)
    spec = mujoco.MjSpec()
    spec.add_mesh(name="ring", uservert=corners.ravel(), userface=numbers.ravel().astype(np.int32))
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="ring")
    model = spec.compile()
    assert len(faces) == 7200
    drawn = triangles(model, 0)
    assert 300 < len(drawn) <= 1500
    first, second, third = drawn.transpose(1, 0, 2)
    volume = np.einsum("ij,ij->", first, np.cross(second, third)) / 6
    assert volume == pytest.approx(2 * np.pi**2 * 0.5 * 0.1**2, rel=0.15)
    across = np.delete(drawn, np.argmin(np.ptp(drawn, axis=(0, 1))), axis=2)  # it may be turned
    assert np.linalg.norm(across, axis=2).min() > 0.3

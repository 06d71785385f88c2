"""Which files a model may name: those of its folder, of its package, and where the user allows."""

import json
import os
from pathlib import Path

import pytest
from plain_arm import TETRAHEDRON, urdf
from typer.testing import CliRunner

from faultgen.building.source import read_source
from faultgen.cli.app import app
from faultgen.errors import InputError
from faultgen.robot import load_robot

SHAPE = '<visual><geometry><mesh filename="{}"/></geometry></visual>'
MJCF = """<mujoco>
  <asset>{asset}</asset>
  <worldbody>
    {include}
    <body name="upper">
      <inertial pos="0 0 0.2" mass="5" diaginertia="0.1 0.1 0.02"/>
      <joint name="shoulder" axis="0 1 0" range="-100 100"/>
      <geom type="mesh" mesh="hull"/>
    </body>
  </worldbody>
</mujoco>"""


def arm_with(mesh):
    """Text of a URDF whose first link shows a mesh."""
    return urdf(('<link name="pan_link">', f'<link name="pan_link">{SHAPE.format(mesh)}'))


@pytest.fixture
def user(tmp_path, monkeypatch):
    """Home of a user with a private mesh and a model that somebody else wrote."""
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "private").mkdir()
    (tmp_path / "private" / "secret.obj").write_text(TETRAHEDRON)
    (tmp_path / "private" / "secret.xml").write_text("<mujocoinclude><geom/></mujocoinclude>")
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "hull.obj").write_text(TETRAHEDRON)
    return tmp_path


OUTSIDE = {
    "a file": "file://{home}/private/secret.obj",
    "a path": "{home}/private/secret.obj",
    "dots": "../private/secret.obj",
    "dots in a package": "package://../../private/secret.obj",
    "dots after a package": "package://arm/../private/secret.obj",
    "the home as a package": "package://{name}/private/secret.obj",
    "a link": "link.obj",
    "a linked folder": "folder/secret.obj",
}


CASES = [("urdf", case) for case in OUTSIDE]
CASES += [("mjcf", case) for case, mesh in OUTSIDE.items() if "://" not in mesh]


@pytest.mark.parametrize(("form", "case"), CASES)
def test_files_elsewhere_are_refused(user, form, case):
    """Also those behind symbolic links, and nothing is written."""
    models, out = user / "models", user / "out"
    (models / "link.obj").symlink_to(user / "private" / "secret.obj")
    (models / "folder").symlink_to(user / "private")
    mesh = OUTSIDE[case].format(home=user, name=user.name)
    path = models / f"arm.{form}"
    if form == "mjcf":
        asset = f'<mesh name="hull" file="{mesh}"/>'
        path.write_text(MJCF.format(asset=asset, include=""))
    else:
        path.write_text(arm_with(mesh))
    done = CliRunner().invoke(app, ["robot", "build", str(path), "-o", str(out)])
    assert isinstance(done.exception, InputError)
    assert "secret.obj: lies outside of the model's folder" in str(done.exception) or (
        "link.obj: lies outside of the model's folder" in str(done.exception)
    )
    assert "--files" in str(done.exception) and "\n" not in str(done.exception)
    assert not out.exists()


@pytest.mark.parametrize("file", ["../private/secret.xml", "{home}/private/secret.xml", "link.xml"])
@pytest.mark.parametrize("load", [load_robot, read_source])
def test_included_files_elsewhere_are_refused(user, file, load):
    (user / "models" / "link.xml").symlink_to(user / "private" / "secret.xml")
    path = user / "models" / "arm.xml"
    include = f'<include file="{file.format(home=user)}"/>'
    asset = '<mesh name="hull" file="hull.obj"/>'
    path.write_text(MJCF.format(asset=asset, include=include))
    with pytest.raises(
        InputError, match=r"included file .*xml: lies outside of the model's folder"
    ):
        load(path)


def test_a_robot_folder_uses_no_files_elsewhere(user, tiny_robot):
    """Neither do robots that come with their drives."""
    tiny_robot.write(user / "models" / "tiny")
    model = user / "models" / "tiny" / "model.xml"
    mesh = '<asset><mesh name="hull" file="../../private/secret.obj"/></asset><custom>'
    model.write_text(model.read_text().replace("<custom>", mesh, 1))
    (model.parent / "checksums.txt").unlink(missing_ok=True)
    with pytest.raises(InputError, match=r"secret.obj: lies outside of the model's folder"):
        load_robot(model.parent)


def test_the_user_can_name_a_folder(user):
    """The refusal names the option, with which the model is read, and `check` has it too."""
    path = user / "models" / "arm.xml"
    asset = f'<mesh name="hull" file="{user}/private/secret.obj"/>'
    path.write_text(MJCF.format(asset=asset, include='<include file="../private/secret.xml"/>'))
    assert list(read_source(path, [user / "private"]).assets) == ["assets/secret.obj"]
    path = user / "models" / "arm.urdf"
    path.write_text(arm_with("package://private/secret.obj"))
    assert list(read_source(path, [user / "private"]).assets) == ["assets/secret.obj"]
    check = ["robot", "check", str(path), "--json"]
    where = [one["where"] for one in json.loads(CliRunner().invoke(app, check).stdout)["findings"]]
    assert where == ["file"]
    done = CliRunner().invoke(app, [*check, "--files", str(user / "private")])
    assert "file" not in [one["where"] for one in json.loads(done.stdout)["findings"]]
    with pytest.raises(InputError, match=r"--files .*nowhere: is no folder"):
        read_source(path, [user / "nowhere"])


@pytest.mark.parametrize("marked", [True, False])
@pytest.mark.parametrize("mesh", ["package://arm_description/meshes/a.obj", "../meshes/a.obj"])
def test_packages_of_ros_are_found(user, marked, mesh):
    """By package.xml, or without it by the name that the model gives it."""
    package = user / ("somewhere" if marked else "arm_description")
    (package / "urdf").mkdir(parents=True)
    (package / "meshes").mkdir()
    (package / "meshes" / "a.obj").write_text(TETRAHEDRON)
    if marked:
        (package / "package.xml").write_text("<package/>")
    path = package / "urdf" / "arm.urdf"
    path.write_text(arm_with(mesh))
    if marked or "package" in mesh:
        assert list(read_source(path).assets) == ["assets/a.obj"]
    else:
        with pytest.raises(InputError, match="lies outside"):
            read_source(path)


def test_a_model_that_is_a_link_uses_the_folder_of_its_file(user):
    """As packages of ROS that are installed with links."""
    (user / "models" / "arm.urdf").write_text(arm_with("hull.obj"))
    (user / "installed").mkdir()
    link = user / "installed" / "arm.urdf"
    link.symlink_to(user / "models" / "arm.urdf")
    (user / "installed" / "hull.obj").symlink_to(user / "models" / "hull.obj")
    assert list(read_source(link).assets) == ["assets/hull.obj"]


def test_large_files_are_refused_before_they_are_read(user):
    with (user / "models" / "large.stl").open("wb") as file:
        file.truncate(2**33)
    path = user / "models" / "arm.urdf"
    path.write_text(arm_with("large.stl"))
    with pytest.raises(InputError, match="files together are larger than 256 MiB"):
        read_source(path)


def test_circles_of_links_are_refused(user):
    os.symlink("b.xml", user / "models" / "a.xml")
    os.symlink("a.xml", user / "models" / "b.xml")
    path = Path(user / "models" / "arm.xml")
    path.write_text(MJCF.format(asset="", include='<include file="a.xml"/>'))
    with pytest.raises(InputError, match="cannot be read") as refused:
        load_robot(path)
    assert "\n" not in str(refused.value)

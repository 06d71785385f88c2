"""Collada meshes (.dae) of a URDF, with and without the extra ``meshes``."""

import numpy as np
import pytest
from plain_arm import NAMES, urdf

from faultgen.building import collada
from faultgen.building.plain import plain_arm
from faultgen.errors import InputError
from faultgen.mjcf.compiling import compiled, parsed

SHAPE = (
    '<link name="elbow_link">',
    '<link name="elbow_link"><visual><origin xyz="0 0 0.1"/><geometry><mesh '
    'filename="package://arm_meshes/elbow.dae"/></geometry></visual>',
)


@pytest.fixture
def model(tmp_path):
    """A URDF whose elbow has a mesh of another package, and the folder of the packages."""
    (tmp_path / "robot").mkdir()
    (tmp_path / "robot" / "arm.urdf").write_text(urdf(SHAPE))
    (tmp_path / "packages" / "arm_meshes").mkdir(parents=True)
    return tmp_path / "robot" / "arm.urdf", tmp_path / "packages"


def test_a_box_in_millimetres_arrives_in_metres(model):
    """The unit of the file is used, and STL is what MuJoCo gets."""
    trimesh = pytest.importorskip("trimesh", reason=collada.HINT)
    pytest.importorskip("collada", reason=collada.HINT)
    path, packages = model
    box = trimesh.creation.box((100.0, 200.0, 300.0))
    text = box.export(file_type="dae").decode()
    text = text.replace("<up_axis>", '<unit name="millimeter" meter="0.001"/><up_axis>', 1)
    assert "millimeter" in text
    (packages / "arm_meshes" / "elbow.dae").write_text(text)
    plain = plain_arm(path, folders=[packages])
    assert plain.joints == NAMES
    assert any("1 Collada meshes" in note for note in plain.notes)
    assert list(plain.assets) == ["assets/elbow.stl"]
    built = compiled(parsed(plain.xml, plain.assets, "arm")[0], "arm")
    size = np.ptp(built.mesh_vert, axis=0)
    np.testing.assert_allclose(np.sort(size), [0.1, 0.2, 0.3], rtol=1e-6)


def test_what_is_no_collada_is_told_in_one_line(model):
    pytest.importorskip("trimesh", reason=collada.HINT)
    pytest.importorskip("collada", reason=collada.HINT)
    path, packages = model
    (packages / "arm_meshes" / "elbow.dae").write_text("<nonsense/>")
    with pytest.raises(InputError, match="elbow.dae: cannot be read as Collada|holds no faces"):
        plain_arm(path, folders=[packages])


def test_without_the_extra_one_line_says_how_to_get_it(model, monkeypatch):
    monkeypatch.setattr(collada, "is_there", lambda: False)
    path, packages = model
    (packages / "arm_meshes" / "elbow.dae").write_text("")
    notes = plain_arm(path, folders=[packages]).notes
    (told,) = [note for note in notes if "elbow.dae" in note]
    assert "pip install 'faultgen[meshes]'" in told and "\n" not in told


def test_a_package_that_was_not_found_is_named(model):
    path, _ = model
    (told,) = [note for note in plain_arm(path).notes if "elbow.dae" in note]
    assert "the package arm_meshes with --package-path FOLDER" in told

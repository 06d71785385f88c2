"""Inertias that are given in any way, and text that keeps every digit."""

import mujoco
import numpy as np
import pytest

from faultgen.discovery.terms.inertia import apply_inertia, inertia_terms
from faultgen.effects import get_effect
from faultgen.mjcf.edit import mjcf_text, write_model
from faultgen.robot import Robot

LINK = '<inertial pos="0.1 0 0" mass="1" diaginertia="0.02 0.02 0.02"/>'
PAYLOAD = '<inertial pos="0 0 0" mass="0.5" diaginertia="0.001 0.001 0.001"/>'
FORMS = {
    "full": '<inertial pos="0.1 0 0" mass="1" fullinertia="0.02 0.03 0.04 0.003 0.002 0.001"/>',
    "angles": '<inertial pos="0.1 0 0" mass="1" euler="0.3 0.2 0.1" diaginertia="0.02 0.03 0.04"/>',
    "shape": '<geom type="box" size="0.1 0.02 0.03" pos="0.1 0 0" euler="0.1 0.2 0.3" mass="1"/>',
}
INERTIAL = ("body_mass", "body_inertia", "body_ipos", "body_iquat")


@pytest.fixture(params=FORMS)
def given(request, tiny_robot):
    """The small robot with the inertia of its last link and of its payload in another form."""
    xml = tiny_robot.xml.replace(LINK, FORMS[request.param])
    return Robot("given", xml.replace(PAYLOAD, FORMS[request.param]))


def same(given):
    """The same robot with plain inertias, by MuJoCo alone."""
    spec = mujoco.MjSpec.from_string(given.xml)
    compiled = spec.compile()
    return Robot("same", spec.to_xml()), compiled


def test_resolved_inertias_are_those_that_mujoco_computes(given):
    _, compiled = same(given)
    for name in INERTIAL:
        np.testing.assert_allclose(
            getattr(given.model, name), getattr(compiled, name), rtol=1e-12, atol=1e-15
        )
    for name in ("link1", "link2", "payload"):
        assert np.all(np.array(given.spec().body(name).inertia) > 0)


def test_a_link_changes_the_same_in_any_form(given):
    """Terms of links and of the payload, and effects on it, do what they do to a plain robot."""
    plain, _ = same(given)
    rng = np.random.default_rng(0)
    terms = inertia_terms(given)
    assert {term.axis for term in terms} == {1, 2, 3}
    for old, new in zip(inertia_terms(plain), terms, strict=True):
        assert new.prior_std == pytest.approx(old.prior_std, rel=1e-4)
    changes = [(term, 3 * term.prior_std * rng.normal()) for term in terms]
    models = []
    for robot in (given, plain):
        spec = robot.spec()
        apply_inertia(spec, robot, changes)
        get_effect("payload_mass").apply(spec, 2, 0.3)
        models.append(spec.compile())
    for name in ("body_mass", "body_inertia", "body_ipos"):
        one, other = (getattr(model, name) for model in models)
        np.testing.assert_allclose(one, other, rtol=1e-4, atol=1e-6)
    assert models[0].body_mass[3] == pytest.approx(1.3 * (1 + changes[23][1]) ** 2, rel=1e-6)


@pytest.mark.filterwarnings("ignore:compiler attribute .settotalmass. is deprecated")
def test_total_mass_is_resolved_once(tiny_robot):
    """A heavier payload makes the robot heavier where the file sets its total mass."""
    xml = tiny_robot.xml.replace('angle="radian"', 'angle="radian" settotalmass="20"')
    robot = Robot("scaled", xml)
    assert robot.model.body_mass.sum() == pytest.approx(20)
    spec = robot.spec()
    get_effect("payload_mass").apply(spec, 2, 1.0)
    own = robot.model.body("payload").mass[0]
    assert spec.compile().body_mass.sum() == pytest.approx(20 + own)


def test_all_digits_are_written(robot):
    """A model that is written and read again is the same, bit for bit."""
    spec = robot.spec()
    spec.compile()
    again = mujoco.MjModel.from_xml_string(mjcf_text(spec))
    names = (*INERTIAL, "actuator_biasprm", "actuator_gainprm", "actuator_dynprm", "wrap_prm")
    for name in (*names, "tendon_stiffness", "numeric_data", "actuator_damping"):
        np.testing.assert_array_equal(getattr(again, name), getattr(robot.model, name))
    assert len(spec.to_xml()) < len(mjcf_text(spec))  # MuJoCo's own digits are back


def test_impossible_links_are_made_possible_and_written(tiny_robot):
    """Links as thin as a plate, or far from the model, can be written and read again."""
    rng = np.random.default_rng(2)
    terms = inertia_terms(tiny_robot)
    for size in (1.0, 30.0, 300.0):
        for _ in range(20):
            spec = tiny_robot.spec()
            changes = [(term, size * term.prior_std * rng.normal()) for term in terms]
            changes += [(terms[k], -1.0) for k in rng.integers(len(terms), size=3)]
            apply_inertia(spec, tiny_robot, changes)
            spec.compile()
            model = mujoco.MjModel.from_xml_string(mjcf_text(spec))
            a, b, c = np.sort(model.body_inertia[1:], axis=1).T
            assert (a > 0).all() and (a + b >= c).all() and (model.body_mass[1:] > 0).all()


def test_a_written_model_has_its_files_beside_it(tmp_path):
    """But nothing is written outside the folder."""
    files = {"meshes/a.stl": b"a", "../b.stl": b"b", str(tmp_path / "c.stl"): b"c"}
    write_model(tmp_path / "out" / "model.xml", "<mujoco/>", files)
    every = sorted(str(p.relative_to(tmp_path)) for p in tmp_path.rglob("*") if p.is_file())
    assert every == ["out/meshes/a.stl", "out/model.xml"]

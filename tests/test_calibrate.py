"""Models that are only roughly known: calibration, payloads of no mass, followed motion."""

import json
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from typer.testing import CliRunner

from faultgen.cli.app import app
from faultgen.discovery import Replay, write_recording
from faultgen.discovery import calibrate as calibration
from faultgen.discovery.calibrate import calibrate, changed, replaying
from faultgen.discovery.candidates import (
    Term,
    applied,
    effect_terms,
    names_by_use,
    payload_terms,
    with_model_scale,
)
from faultgen.discovery.inertia import inertia_terms
from faultgen.discovery.recording import low_passed
from faultgen.effects import get_effect
from faultgen.errors import InputError
from faultgen.robot import COULOMB, STICTION, STRIBECK_VELOCITY, Robot, load_robot


def rotor_force(model, dof, speed):
    """Torque on a rotor that turns with a speed [N m]."""
    data = mujoco.MjData(model)
    data.qvel[dof] = speed
    mujoco.mj_forward(model, data)
    return (data.qfrc_passive + data.qfrc_actuator - data.qfrc_bias)[dof]


@pytest.mark.parametrize("severity", [0.3, -0.3])
def test_viscous_friction_of_one_direction(tiny_robot, severity):
    """Nominal backward, times 1 + severity forward."""
    spec = tiny_robot.spec()
    get_effect("viscous_asymmetry").apply(spec, 2, severity)
    model, dof = spec.compile(), tiny_robot.motors[1]
    assert model.nu == tiny_robot.model.nu
    viscous = tiny_robot.model.actuator_damping[tiny_robot.ids("actuator", "friction")[1]]
    for speed, share in ((100.0, severity), (-100.0, 0.0)):
        change = rotor_force(model, dof, speed) - rotor_force(tiny_robot.model, dof, speed)
        assert change == pytest.approx(-share * viscous * speed, rel=1e-6, abs=1e-9)


def test_low_speed_friction_has_a_width_where_the_model_has_none(tiny_robot):
    spec = tiny_robot.spec()
    bias = spec.actuator("friction1").biasprm
    bias[STICTION] = bias[COULOMB]
    get_effect("low_speed_friction").apply(spec, 1, -0.3, width=50.0)
    assert bias[STICTION] == pytest.approx(0.7 * bias[COULOMB])
    assert bias[STRIBECK_VELOCITY] == 50.0


def test_effects_on_request_are_no_candidates_without(tiny_robot):
    optional = set(names_by_use("on request"))
    assert optional and not {t.name for t in effect_terms(tiny_robot)} & optional
    assert optional <= {t.name for t in effect_terms(tiny_robot, include=optional)}


def massless(robot):
    spec = robot.spec()
    payload = spec.body("payload")
    payload.mass, payload.inertia = 0.0, np.zeros(3)
    return Robot("massless", spec.to_xml())


def test_a_payload_of_no_mass_is_points(tiny_robot):
    """Their masses make one body: its weight is the sum, its centre the mean of their places."""
    robot = massless(tiny_robot)
    assert {t.axis for t in inertia_terms(robot)} == {1, 2}
    points = payload_terms(robot)
    assert [t.name for t in effect_terms(robot) if t.name.startswith("payload")] == (
        ["payload_mass"] * 4
    )
    (one,) = applied(list(zip(points, [1.0, 2.0, -1.0, 0.0], strict=True)))
    assert one.severity == pytest.approx(2.0)
    assert dict(one.parameters) == pytest.approx({"x": 0.1, "y": -0.05, "z": 0.0})
    model = changed(robot, list(zip(points, [1.0, 2.0, -1.0, 0.0], strict=True))).model
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, "payload")
    assert model.body_mass[body] == pytest.approx(2.0, rel=1e-5)
    np.testing.assert_allclose(model.body_ipos[body], [0.1, -0.05, 0.0], atol=1e-6)


def test_a_payload_moves_along_any_axis_of_the_flange(tiny_robot):
    before = np.array(tiny_robot.spec().body("payload").ipos)
    for direction in range(3):
        spec = tiny_robot.spec()
        get_effect("payload_offset").apply(spec, 2, 0.1, direction=direction)
        moved = np.array(spec.body("payload").ipos) - before
        np.testing.assert_allclose(moved, 0.1 * np.eye(3)[direction], atol=1e-12)


def test_numbers_get_wider_and_nothing_else(tiny_robot):
    terms = effect_terms(tiny_robot)
    for old, new in zip(terms, with_model_scale(terms, 10.0, known=["rotor_inertia"]), strict=True):
        wide = old.name in ("coulomb_friction", "viscous_friction", "torque_offset")
        wide |= old.name == "torque_constant"
        assert new.prior_std == pytest.approx((10.0 if wide else 1.0) * old.prior_std)


def test_a_rough_model_is_calibrated(measured, tiny_robot):
    """Numbers off by 30 to 40 % come back, on motions whose reference was not recorded."""
    recording = replace(measured([("viscous_friction", 2, 0.4)], 3), reference_position=None)
    found = calibrate(recording, tiny_robot, exclude=["torque_constant"])
    assert found.values["viscous_friction"][2] == pytest.approx(0.4, rel=0.2)
    friction = tiny_robot.ids("actuator", "friction")[1]
    ratio = found.robot.model.actuator_damping[friction]
    ratio = ratio / tiny_robot.model.actuator_damping[friction]
    assert ratio == pytest.approx(1 + found.values["viscous_friction"][2], rel=1e-4)
    before, after = (
        np.sqrt(np.mean((recording.torque - Replay(recording, model).torque()) ** 2))
        for model in (tiny_robot, found.robot)
    )
    assert after < 0.6 * before  # the rest is noise


def test_a_torque_constant_becomes_a_gain_of_the_log(tiny_robot):
    term = Term("torque_constant", 1, 0.1, 0.1)
    gain = changed(tiny_robot, [(term, 0.1)]).torque_gain
    np.testing.assert_allclose(gain, [0.9, 1.0])
    assert np.all(tiny_robot.torque_gain == 1)


def test_recordings_are_filtered_and_thinned(measured):
    recording = replace(measured([], 1), reference_position=None)
    rate = 1 / recording.sample_period
    thin = low_passed(recording, rate / 10)
    assert thin.sample_period == pytest.approx(4 * recording.sample_period)
    assert len(thin.position) == len(thin.torque)
    assert len(thin.parts) == len(recording.parts)
    middle = slice(50, -50)
    np.testing.assert_allclose(
        thin.position[middle], recording.position[::4][: len(thin.position)][middle], atol=0.05
    )
    assert low_passed(recording, rate) is recording


def test_the_command_writes_a_calibrated_model(measured, tiny_robot_path, tmp_path):
    recording = measured([("coulomb_friction", 1, 0.3)], 3)
    write_recording(recording, tmp_path / "rough.h5")
    arguments = ["calibrate", str(tmp_path / "rough.h5"), "--robot", tiny_robot_path]
    out = tmp_path / "model.xml"
    told = CliRunner().invoke(app, [*arguments, "--known", "inertia", "-o", str(out), "--json"])
    assert told.exit_code == 0, told.output
    kept = json.loads((tmp_path / "model.json").read_text())
    assert kept["values"]["coulomb_friction"]["1"] > 0.2 and kept["lacks"] == []
    before, after = load_robot(tiny_robot_path), load_robot(out)
    friction = before.ids("actuator", "friction")[0]
    coulomb = [one.model.actuator_biasprm[friction, COULOMB] for one in (before, after)]
    assert coulomb[1] / coulomb[0] / after.torque_gain[0] == pytest.approx(1.3, rel=0.1)


def test_numbers_are_known_by_their_names(measured, tiny_robot):
    for option in ("known", "exclude"):
        with pytest.raises(InputError, match=f"{option}: unknown name 'foo'; choose coulomb_fr"):
            calibrate(measured([], 1), tiny_robot, **{option: ["foo"]})


def test_a_model_that_diverges_is_not_a_result(measured, tiny_robot):
    """A spring that pushes the arm away is noticed, whether or not MuJoCo compiles it."""
    recording = measured([], 1)
    term = Term("gravity_spring", 2, 1.0, 1.0)
    assert replaying(recording, tiny_robot, [(term, -1e6)]) is None
    assert replaying(recording, tiny_robot, [(term, 1.0)]) is not None
    assert replaying(recording, tiny_robot, []) is tiny_robot


@pytest.mark.parametrize(("failing", "share"), [(0, 1.0), (2, 0.25), (99, 0.0)])
def test_what_was_fitted_is_kept_where_a_model_of_it_diverges(
    measured, tiny_robot, monkeypatch, failing, share
):
    """The model gets the largest share that can be simulated; the values are those fitted."""
    asked = []

    def sometimes(recording, robot, changes, *, measured=None):
        asked.append(changes)
        return None if len(asked) <= failing else replaying(recording, robot, changes)

    monkeypatch.setattr(calibration, "replaying", sometimes)
    recording = measured([("viscous_friction", 2, 0.4)], 3)
    found = calibrate(
        recording, tiny_robot, prior_scales=[10.0], exclude=["torque_constant", "inertia"]
    )
    friction = tiny_robot.ids("actuator", "friction")[1]
    own, given = (one.model.actuator_damping[friction] for one in (found.robot, tiny_robot))
    fitted = found.values["viscous_friction"][2]
    assert fitted == pytest.approx(0.4, rel=0.2)
    assert own / given == pytest.approx(1 + share * fitted, rel=1e-9)
    assert len(found.lacks) == (share < 1)


def test_a_link_of_full_inertia_is_calibrated(measured, tiny_robot):
    """The same recording gives the same link, however the file states its inertia."""
    plain = 'mass="1" diaginertia="0.02 0.02 0.02"'
    full = 'mass="1" fullinertia="0.02 0.02 0.02 0 0 0"'
    assert plain in tiny_robot.xml
    given = Robot("given", tiny_robot.xml.replace(plain, full))
    recording = measured([("viscous_friction", 2, 0.4)], 3)
    models = [
        calibrate(recording, robot, prior_scales=[10.0], exclude=["torque_constant"]).robot.model
        for robot in (tiny_robot, given)
    ]
    before = tiny_robot.model.body("link2").mass[0]
    masses = [model.body("link2").mass[0] for model in models]
    assert masses[1] == pytest.approx(masses[0], rel=1e-6) and masses[0] != before

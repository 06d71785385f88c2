"""Models that are only roughly known: calibration, payloads of no mass, followed motion."""

import json
import re
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from typer.testing import CliRunner

from faultgen.cli.app import app
from faultgen.discovery import Replay, write_recording
from faultgen.discovery.calibration import freedom
from faultgen.discovery.calibration.calibrate import calibrate
from faultgen.discovery.calibration.model_edit import changed, replaying
from faultgen.discovery.calibration.own_friction import with_own_friction
from faultgen.discovery.calibration.result import Calibrated
from faultgen.discovery.inputs import usable
from faultgen.discovery.laws.friction_law import with_friction_law
from faultgen.discovery.posterior_of import posterior_of
from faultgen.discovery.rigid.base_parameters import identify
from faultgen.discovery.rigid.drives import Drives
from faultgen.discovery.rigid.regression import Regression
from faultgen.discovery.terms.candidates import (
    Term,
    applied,
    effect_terms,
    names_by_use,
    payload_terms,
)
from faultgen.discovery.terms.inertia import inertia_terms
from faultgen.effects import get_effect
from faultgen.errors import InputError
from faultgen.recordings.low_pass import low_passed
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
    points = payload_terms(robot, 2)
    assert [t.key for t in effect_terms(robot) if t.name.startswith("payload")] == (
        [("payload_mass", 1)] * 4 + [("payload_mass", 2)] * 4
    )
    (one,) = applied(list(zip(points, [1.0, 2.0, -1.0, 0.0], strict=True)))
    assert one.severity == pytest.approx(2.0)
    assert dict(one.parameters) == pytest.approx({"x": 0.1, "y": -0.05, "z": 0.0})
    model = changed(robot, list(zip(points, [1.0, 2.0, -1.0, 0.0], strict=True))).model
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, "payload")
    assert model.body_mass[body] == pytest.approx(2.0, rel=1e-5)
    np.testing.assert_allclose(model.body_ipos[body], [0.1, -0.05, 0.0], atol=1e-6)
    changes = zip(
        payload_terms(robot, 1) + points, [0.0, 0.0, 3.0, 0.0, 1.0, 2.0, -1.0, 0.0], strict=True
    )
    both = applied(list(changes))  # each link has its own
    assert [(b.axis, b.severity) for b in both] == [(1, 3.0), (2, pytest.approx(2.0))]
    assert dict(both[0].parameters) == pytest.approx({"x": 0.0, "y": 0.1, "z": 0.0})


def test_a_payload_moves_along_any_axis_of_the_flange(tiny_robot):
    before = np.array(tiny_robot.spec().body("payload").ipos)
    for direction in range(3):
        spec = tiny_robot.spec()
        get_effect("payload_offset").apply(spec, 2, 0.1, direction=direction)
        moved = np.array(spec.body("payload").ipos) - before
        np.testing.assert_allclose(moved, 0.1 * np.eye(3)[direction], atol=1e-12)


def test_a_rough_model_is_calibrated(measured, tiny_robot):
    """Numbers off by 30 to 40 % come back, on motions whose reference was not recorded."""
    recording = replace(measured([("viscous_friction", 2, 0.4)], 3), reference_position=None)
    found = calibrate(recording, tiny_robot, exclude=["torque_constant"])
    assert found.errors["given"] > 1.5 * found.errors["calibrated"]
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
    posterior = posterior_of(recording, found.robot)
    told = posterior.which.index(("viscous_friction", 2, ()))
    assert np.sqrt(posterior.covariance[told, told]) < 0.05  # what is usual


def test_a_torque_constant_becomes_a_gain_of_the_log(tiny_robot):
    term = Term("torque_constant", 1, 0.1, 0.1)
    gain = changed(tiny_robot, [(term, 0.1)]).torque_gain
    np.testing.assert_allclose(gain, [0.9, 1.0])
    assert np.all(tiny_robot.torque_gain == 1)


@pytest.mark.slow
def test_changed_models_keep_the_tasks_of_the_folder(measured, tiny_robot):
    """A folder that `robot build` wrote has tasks, with which datasets are made afterwards."""
    given = replace(tiny_robot, tasks={"weld": "start = 1"})
    named = {term.key: term for term in effect_terms(given)}
    both = changed(given, [(named["torque_constant", 2], 0.2), (named["load_friction", 1], 0.1)])
    bare = replace(given, xml=re.sub(r' lugre="[^"]*" damping="[^"]*"', "", tiny_robot.xml))
    recording = measured([], 1)
    fitted = calibrate(recording, bare, prior_scales=[3.0]).robot
    for robot in (both, with_friction_law(bare, recording), fitted):
        assert robot.tasks == given.tasks


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
    assert low_passed(recording, rate / 2) is recording
    with pytest.raises(
        InputError, match=r"low-pass: must be at most [\d.]+ Hz, half of the sample"
    ):
        low_passed(recording, 0.51 * rate)


def test_the_command_writes_a_calibrated_model(measured, tiny_robot_path, tmp_path):
    recording = measured([("coulomb_friction", 1, 0.3)], 3)
    write_recording(recording, tmp_path / "rough.h5")
    arguments = ["calibrate", str(tmp_path / "rough.h5"), "--robot", tiny_robot_path]
    out = tmp_path / "out"
    told = CliRunner().invoke(app, [*arguments, "--known", "inertia", "-o", str(out), "--json"])
    assert told.exit_code == 0, told.output
    kept = json.loads((out / "calibration.json").read_text())
    assert kept["values"]["coulomb_friction"]["1"] > 0.2 and kept["lacks"] == []
    assert kept["errors"]["calibrated"] <= kept["errors"]["classical"]
    before, after = load_robot(tiny_robot_path), load_robot(out / "model.xml")
    friction = before.ids("actuator", "friction")[0]
    coulomb = [one.model.actuator_biasprm[friction, COULOMB] for one in (before, after)]
    assert coulomb[1] / coulomb[0] / after.torque_gain[0] == pytest.approx(1.3, rel=0.1)


def test_findings_are_those_of_the_log_and_of_the_calibration(
    measured, tiny_robot, tiny_robot_path, tmp_path, monkeypatch
):
    found = Calibrated(
        robot=tiny_robot,
        errors=dict.fromkeys(("given", "classical", "calibrated"), 0.1),
        prior_scale=1.0,
        values={},
        parameters={},
        findings=("axis 2 is unusual",),
    )
    module = "faultgen.discovery.calibration.calibrate.calibrate"
    monkeypatch.setattr(module, lambda *_, **__: found)
    recording = measured([], 3)
    write_recording(replace(recording, torque=recording.torque * [-1, 1]), tmp_path / "turned.h5")
    arguments = ["calibrate", str(tmp_path / "turned.h5"), "--robot", tiny_robot_path]
    told = CliRunner().invoke(app, [*arguments, "-o", str(tmp_path / "out"), "--json"])
    assert told.exit_code == 0, told.output
    kept = json.loads((tmp_path / "out" / "calibration.json").read_text())["findings"]
    assert len(kept) == 2 and "axis 1" in kept[0] and kept[1] == "axis 2 is unusual"


def test_torque_constants_differ_where_the_links_are_known(measured, tiny_robot):
    """Links that are 3 % uncertain could take a part of the difference otherwise."""
    recording = measured([], 3)
    recording = replace(recording, torque=1.06 * recording.torque)
    found = calibrate(recording, tiny_robot, known=["inertia"])
    assert found.robot.torque_gain == pytest.approx([1 / 1.06] * 2, abs=0.03)


def test_a_file_as_output_of_the_command_is_refused(measured, tiny_robot_path, tmp_path):
    """An older version wrote one file."""
    write_recording(measured([], 3), tmp_path / "some.h5")
    arguments = ["calibrate", str(tmp_path / "some.h5"), "--robot", tiny_robot_path]
    told = CliRunner().invoke(app, [*arguments, "-o", str(tmp_path / "model.xml")])
    assert isinstance(told.exception, InputError)
    assert str(told.exception).startswith("out: must be a folder")


@pytest.mark.parametrize(
    "effects",
    [
        [("viscous_friction", 2, 1.0), ("rotor_inertia", 2, 0.5)],
        pytest.param(
            [("coulomb_friction", 1, 2.0), ("torque_offset", 1, 0.1), ("payload_mass", 2, 1.0)],
            marks=pytest.mark.slow,
        ),
        pytest.param([("wrist_coupling_friction", 2, 3.0)], marks=pytest.mark.slow),
    ],
)
def test_calibration_predicts_no_worse_than_classical_identification(measured, tiny_robot, effects):
    """Three robots that differ from their model, on motions that no method was fitted to."""
    recording = measured(effects, 3)
    other = measured(effects, 4)  # other noise
    half = len(recording.torque) // 2
    first = replace(
        recording,
        position=recording.position[: 3 * half // 2],
        torque=recording.torque[: 3 * half // 2],
        reference_position=recording.reference_position[: 3 * half // 2],
    )
    found = calibrate(first, tiny_robot, prior_scales=[3.0, 30.0])
    # both are near the noise of 1 %, so that they differ by chance
    assert found.errors["calibrated"] <= 1.05 * found.errors["classical"]
    assert found.errors["calibrated"] < 0.1 * found.errors["given"]
    model = with_friction_law(tiny_robot, first)
    regressions = [Regression(one, model, couplings=found.couplings) for one in (first, other)]
    classical = regressions[1].torque(identify(regressions[0].products))
    ours = Replay(other, found.robot).torque()
    rest = regressions[1].inside.copy()
    rest[: 3 * half // 2] = False
    size = np.mean(other.torque**2, axis=0, where=rest)
    errors = [
        np.sqrt(np.mean(np.mean((other.torque - torque) ** 2, axis=0, where=rest) / size))
        for torque in (ours, classical)
    ]
    assert errors[0] <= 1.15 * errors[1] < 0.01


@pytest.mark.slow
def test_a_model_without_friction_is_calibrated(measured, tiny_robot, tmp_path):
    """It is accepted, and its friction is found."""
    recording = measured([], 3)
    bare = tmp_path / "bare.xml"
    bare.write_text(re.sub(r' lugre="[^"]*" damping="[^"]*"', "", tiny_robot.xml))
    robot = load_robot(bare)
    assert np.all(robot.model.actuator_damping == 0)
    path = tmp_path / "recording.h5"
    write_recording(recording, path)
    _, warnings = usable(
        path, robot
    )  # refused if the torque were compared with a model without friction
    assert sum("has no friction on axes 1, 2:" in line for line in warnings) == 1
    made, _ = with_own_friction(recording, robot, healthy=False)
    own = Drives.of(made)
    np.testing.assert_allclose(own.coulomb, [0.2, 0.1], rtol=0.1)
    np.testing.assert_allclose(own.inertia, Drives.of(robot).inertia)
    assert with_own_friction(recording, tiny_robot, healthy=False) == (tiny_robot, [])
    found = calibrate(recording, robot, prior_scales=[3.0])
    np.testing.assert_allclose(found.parameters["coulomb"], [0.2, 0.1], rtol=0.1)
    np.testing.assert_allclose(found.parameters["viscous"], 1e-3, rtol=0.1)
    assert found.errors["calibrated"] <= found.errors["classical"] < 0.2 * found.errors["given"]


def test_numbers_are_known_by_their_names(measured, tiny_robot):
    for option in ("known", "exclude"):
        with pytest.raises(InputError, match=f"{option}: unknown name 'foo'; choose coulomb_fr"):
            calibrate(measured([], 1), tiny_robot, **{option: ["foo"]})


def test_a_model_that_diverges_is_not_a_result(measured, tiny_robot):
    """A spring that pushes the arm away is noticed, whether or not MuJoCo compiles it."""
    replay = Replay(measured([], 1), tiny_robot)
    term = Term("gravity_spring", 2, 1.0, 1.0)
    assert replaying(replay, [(term, -1e6)]) is None
    assert replaying(replay, [(term, 1.0)]) is not None
    assert replaying(replay, []) is tiny_robot


def test_a_fit_that_diverges_leaves_the_given_model(measured, tiny_robot, monkeypatch):
    """A line says so."""
    monkeypatch.setattr(freedom, "fit", lambda *_: Unusable(tiny_robot))
    recording = measured([("viscous_friction", 2, 0.4)], 3)
    found = calibrate(
        recording, tiny_robot, prior_scales=[10.0], exclude=["torque_constant", "inertia"]
    )
    assert found.errors["physical"] == np.inf and np.isfinite(found.errors["calibrated"])
    assert any("the given one is kept" in line for line in found.lacks)


class Unusable:
    """A fit whose model cannot be simulated: a spring pushes its arm away."""

    def __init__(self, robot):
        spec = robot.spec()
        get_effect("gravity_spring").apply(spec, 2, -1e6)
        spec.compile()
        self.robot = robot.edited(spec)

    def squares(self, products):
        """No error at all."""
        return np.zeros_like(products.energy)


@pytest.mark.slow
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

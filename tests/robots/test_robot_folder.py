"""Robots as folders: MJCF plus the effects that it cannot express."""

import json

import numpy as np
import pytest
from recorded import NOISE, record_cycle
from typer.testing import CliRunner

import faultgen
from faultgen.applied import Applied
from faultgen.cli import app
from faultgen.discovery import write_recording
from faultgen.discovery.replay.replay import Replay
from faultgen.effects import EFFECTS
from faultgen.errors import InputError
from faultgen.robot import load_robot
from faultgen.simulation.motion import plan
from faultgen.simulation.plant import assemble
from faultgen.simulation.servo import control_signal
from faultgen.simulation.stepping import simulate
from faultgen.tasks import load_task

LATE = Applied("delay", 2, 0.1 / 30)
RUBS = Applied("load_friction", 2, 0.2)
BESIDE = [name for name, effect in EFFECTS.items() if not effect.in_mjcf and not effect.sense]


def run_of(robot, task, effects=()):
    motion = plan(load_task("tiny", task), robot)
    control = control_signal(motion, robot.model.opt.timestep)
    temperature = (np.array([0.0, 3.0]), np.array([30.0, 60.0]))
    machine = assemble(robot, effects, temperature=temperature)
    (cycle,) = simulate(robot, control, [machine], sample_period=0.01)
    return cycle.motor_torque


def test_a_folder_is_read_as_it_was_written(tiny_robot, tmp_path):
    """Every digit, the name and the effects; the hash covers the effects."""
    made = tiny_robot.with_effects([LATE, Applied("encoder_offset", 1, np.float64(1) / 3)])
    made.write(tmp_path / "any")
    again = load_robot(tmp_path / "any")
    assert (again.name, again.xml) == (made.name, made.xml)
    assert again.effects == made.effects
    assert again.sha256 == made.sha256
    assert len({one.sha256 for one in (made, tiny_robot, tiny_robot.with_effects([LATE]))}) == 3


def test_a_plain_folder_is_a_robot_too(tiny_robot, tmp_path):
    folder = tmp_path / "small"
    folder.mkdir()
    (folder / "small.xml").write_text(tiny_robot.xml)
    found = load_robot(folder)
    assert (found.name, found.xml, found.effects) == ("small", tiny_robot.xml, ())


@pytest.mark.parametrize("name", BESIDE)
def test_severities_count_from_the_robot_of_the_folder(name, tiny_robot, tiny_task_path, tmp_path):
    """A second severity acts on top of the first, as if both had been put into the plain robot."""
    effect = EFFECTS[name]
    axis = effect.axes_on(tiny_robot)[-1]
    first, second = (Applied(name, axis, size * effect.step) for size in (1.0, 0.5))
    tiny_robot.with_effects([first]).write(tmp_path / "worn")
    worn = load_robot(tmp_path / "worn")
    both = run_of(tiny_robot, tiny_task_path, [first, second])
    assert np.array_equal(run_of(worn, tiny_task_path, [second]), both)
    assert np.array_equal(run_of(worn, tiny_task_path), run_of(tiny_robot, tiny_task_path, [first]))
    assert not np.array_equal(run_of(worn, tiny_task_path), run_of(tiny_robot, tiny_task_path))
    assert not np.array_equal(both, run_of(worn, tiny_task_path))


def test_a_torque_gain_is_logged(tiny_robot, tiny_task_path):
    """A drive that believes in more torque than its motor gives logs more."""
    xml = tiny_robot.xml.replace("</custom>", '<numeric name="torque_gain" data="0.8 1"/></custom>')
    weak = type(tiny_robot)("weak", xml)
    ratio = run_of(weak, tiny_task_path) / run_of(tiny_robot, tiny_task_path)
    np.testing.assert_allclose(ratio, np.broadcast_to([1.25, 1.0], ratio.shape), rtol=1e-12)


def test_commands_accept_a_folder(tiny_robot, tiny_task_path, tmp_path):
    """`generate` simulates its effects, `info` finds the dataset whole, and the hash tells."""
    made = tiny_robot.with_effects([RUBS])
    made.write(tmp_path / "rubs")
    tiny_robot.write(tmp_path / "plain")
    torque = {}
    for name in ("plain", "rubs"):
        out = tmp_path / f"data-{name}"
        arguments = ["--robot", str(tmp_path / name), "--task", tiny_task_path, "--cycles", "2"]
        arguments += ["--axis", "2", "--severity", "0.1", "--sensors", "none", "--workers", "1"]
        done = CliRunner().invoke(app, ["generate", *arguments, "-o", str(out)])
        assert done.exit_code == 0, done.output
        assert CliRunner().invoke(app, ["info", str(out)]).exit_code == 0
        run = next(run for run in faultgen.open_dataset(out).runs if run["axis"] == 0)
        torque[name] = run.read("signals/motor_torque")[:, :, 1]
        assert run["model_sha256"] == load_robot(tmp_path / name).sha256
        if name == "rubs":
            (own,) = json.loads(run["robot_effects"])
            assert own["effect"] == "load_friction" and own["severity"] == RUBS.severity
    more = np.abs(torque["rubs"]).mean() / np.abs(torque["plain"]).mean()
    assert 1.005 < more < 1.3


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "robot.json: damaged: not valid JSON"),
        ('{"format": 1, "name": "x", "effects": [NaN]}', "NaN is not a number"),
        ('{"format": 2, "name": "x", "effects": []}', "has format 2, but this version"),
        ('{"format": 1, "name": "x"}', "must have format, name, effects"),
        ('{"format": 1, "name": "x", "effects": {}}', "effects: must be a list, not dict"),
        (
            '{"format": 1, "name": "x", "effects": [{"effect": "delay", "axis": 1}]}',
            "effect 1: 'parameters' is missing",
        ),
        (
            '{"format": 1, "name": "x", "effects": [{"effect": "delay", "axis": "1", '
            '"severity": 1, "parameters": {}}]}',
            "effect 1: 'axis' has the wrong type",
        ),
    ],
)
def test_a_damaged_folder_is_refused_in_one_line(tiny_robot, tmp_path, content, message):
    tiny_robot.write(tmp_path)
    (tmp_path / "robot.json").write_text(content)
    with pytest.raises(InputError, match=message) as refused:
        load_robot(tmp_path)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("one", "message"),
    [
        (Applied("rust", 1, 0.1), "robot tiny: its effects: unknown effect 'rust'"),
        (Applied("delay", 3, 0.1), "robot tiny: its effects: axis 3: robot tiny has axes 1 to 2"),
        (Applied("delay", 1, 0.1, {"shape": 1}), "its effects: delay has no parameter 'shape'"),
    ],
)
def test_effects_that_do_not_exist_are_refused(tiny_robot, tiny_task_path, tmp_path, one, message):
    """When they are first needed, also by a dataset of the healthy robot alone."""
    tiny_robot.with_effects([one]).write(tmp_path / "odd")
    robot = load_robot(tmp_path / "odd")
    with pytest.raises(InputError, match=message):
        assemble(robot)
    arguments = ["--robot", str(tmp_path / "odd"), "--task", tiny_task_path, "--cycles", "1"]
    done = CliRunner().invoke(
        app, ["generate", *arguments, "--effect", "healthy", "-o", str(tmp_path / "out")]
    )
    assert isinstance(done.exception, InputError)


def test_a_folder_without_a_robot_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"has no robot\.json; give the folder 'model'"):
        load_robot(tmp_path)


def test_calibrate_does_not_lose_effects(tiny_robot, measured, tmp_path):
    """An MJCF file cannot hold the effects of a folder; a folder can."""
    write_recording(measured([("coulomb_friction", 1, 0.3)], 3), tmp_path / "rough.h5")
    tiny_robot.with_effects([LATE]).write(tmp_path / "late")
    arguments = ["calibrate", str(tmp_path / "rough.h5"), "--robot", str(tmp_path / "late")]
    refused = CliRunner().invoke(app, [*arguments, "-o", str(tmp_path / "model.xml")])
    assert isinstance(refused.exception, InputError)
    done = CliRunner().invoke(app, [*arguments, "-o", str(tmp_path / "better")])
    assert done.exit_code == 0, done.output
    made = load_robot(tmp_path / "better")
    assert LATE in made.effects and made.xml != tiny_robot.xml


@pytest.mark.slow
def test_the_model_that_a_discovery_writes_explains_the_recording(puma, tmp_path):
    """Also what MJCF cannot express."""
    faults = [Applied("viscous_friction", 2, 0.5), Applied("delay", 1, 0.004)]
    files = {"measured": record_cycle(puma, faults, 1), "healthy": record_cycle(puma, [], 2)}
    for name, recording in files.items():
        write_recording(recording, tmp_path / f"{name}.h5")
    first = faultgen.discover(
        tmp_path / "measured.h5", "puma560", tmp_path / "healthy.h5", out=tmp_path / "first"
    )
    found = {(one["effect"], one["axis"]) for one in first["effects"]}
    assert found == {("delay", 1), ("viscous_friction", 2)}
    robot = load_robot(tmp_path / "first" / "model")
    assert [one.effect for one in robot.effects if one.axis == 1] == ["delay"]
    assert (tmp_path / "first" / "model.xml").read_text() == robot.xml
    measured = files["measured"]
    left = measured.torque - Replay(measured, robot, measured=False).torque()
    noise = NOISE * np.abs(measured.torque).mean(axis=0)
    assert np.all(left.std(axis=0) < 1.1 * noise)

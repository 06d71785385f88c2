"""Torque sensors behind the gearbox: they see the arm, and not the friction of the motors."""

from dataclasses import replace

import h5py
import numpy as np
import pytest

import faultgen
from faultgen.discovery import check_recording, read_recording, settled, write_recording
from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.replay.sensitivities import kept_in
from faultgen.discovery.rigid.base_parameters import held_out_error
from faultgen.discovery.rigid.regression import DRIVE, Regression
from faultgen.effects import get_effect
from faultgen.errors import InputError
from faultgen.recordings.several import check_same_motion
from faultgen.simulation.arm import Arm
from faultgen.simulation.stepping import simulate


@pytest.fixture(scope="module")
def link(measured, tiny_robot):
    """Records the torque of the gearboxes of the small robot, with 1 % of noise."""

    def record(effects, seed):
        recording = measured([], seed)
        reference = recording.reference_position
        own = Replay(recording, tiny_robot, measured=False)
        spec = tiny_robot.spec()
        for name, axis, severity in effects:
            get_effect(name).apply(spec, axis, severity)
        (run,) = simulate(
            tiny_robot, own.controls[0], [spec.compile()], sample_period=0.004, lead_in=0.0
        )
        count = len(reference)
        torque = run.gear_torque[:count]
        noise = np.random.default_rng(seed).standard_normal(torque.shape)
        return replace(
            recording,
            side="joint",
            link=True,
            position=run.joint_position[:count],
            torque=torque + 0.01 * np.abs(torque).mean(axis=0) * noise,
        )

    return record


def test_it_is_the_torque_of_the_arm(link, tiny_robot):
    """Rigid inverse dynamics explain it; the motor torque times the gear ratio is another."""
    recording = link([], 1)
    assert check_recording(recording, tiny_robot) == []
    rigid = Arm(tiny_robot).inverse_dynamics(*recording.derivatives(recording.position))
    inside = settled(recording, tiny_robot)
    for axis in (0, 1):
        rows = inside[:, axis]
        size = np.sqrt(np.mean(recording.torque[rows, axis] ** 2))
        models = {
            "rigid": rigid,
            "link": Replay(recording, tiny_robot).torque(),
            "motor": Replay(replace(recording, link=False), tiny_robot).torque(),
        }
        errors = {
            name: np.sqrt(np.mean((recording.torque - torque)[rows, axis] ** 2)) / size
            for name, torque in models.items()
        }
        assert errors["link"] < 0.03 and errors["rigid"] < 0.1 < errors["motor"], errors


def test_classical_identification_has_no_drives(link, tiny_robot):
    """The links alone predict the torque to within its noise."""
    recording = link([], 1)
    own = Regression(recording, tiny_robot)
    for name in DRIVE:
        assert not own.products.gram[..., own.drive(name)].any()
    assert held_out_error(own.products) < 0.02
    assert held_out_error(Regression(replace(recording, link=False), tiny_robot).products) > 0.02


EXCLUDED = ("transmission_error", "backlash", "gear_stiffness")
"""Effects that cost the most simulations, and are not looked for here."""


@pytest.mark.parametrize(
    ("effect", "named"),
    [
        (("payload_mass", 2, 0.2), [("payload_mass", 2)]),
        pytest.param(("friction_wear", 2, 1.0), [], marks=pytest.mark.slow),
    ],
)
def test_what_the_sensor_sees_is_named(link, tiny_robot_path, tmp_path, effect, named):
    """A heavier payload is named against the healthy robot; friction of the motors is not."""
    write_recording(link([], 1), tmp_path / "healthy.h5")
    write_recording(link([effect], 2), tmp_path / "worn.h5")
    result = faultgen.discover(
        tmp_path / "worn.h5", tiny_robot_path, tmp_path / "healthy.h5", exclude=EXCLUDED
    )
    assert [(one["effect"], one["axis"]) for one in result["effects"]] == named
    for one in result["effects"]:
        assert one["parameters"]["severity"] == pytest.approx(effect[2], rel=0.1)
    assert any("is 'link': what acts on the rotors is not visible" in w for w in result["warnings"])


def test_files_state_the_sensor(link, tiny_robot, tmp_path):
    """It is written and read; what it cannot be is refused, and so are two kinds of sensors."""
    recording, path = link([], 1), tmp_path / "link.h5"
    write_recording(recording, path)
    again = read_recording(path)
    assert again.link and again.side == "joint"
    plain = tmp_path / "plain.h5"
    write_recording(replace(recording, link=False), plain)
    assert not read_recording(plain).link
    with pytest.raises(InputError, match="not both have the torque sensor behind the gearbox"):
        check_same_motion(again, read_recording(plain))
    for value, message in (
        ("arm", "torque_sensor must be 'motor' or 'link', not 'arm'"),
        (3, "torque_sensor must be 'motor' or 'link', not 3"),
    ):
        with h5py.File(path, "r+") as file:
            file.attrs["torque_sensor"] = value
        with pytest.raises(InputError, match=message):
            read_recording(path)
    with h5py.File(path, "r+") as file:
        file.attrs["torque_sensor"] = np.bytes_(b"link")
        for name in ("position", "torque"):
            file.move(f"joint_{name}", f"motor_{name}")
    with pytest.raises(InputError, match="is 'link', but it has motor_torque; sensors behind"):
        read_recording(path)
    with h5py.File(path, "r+") as file:
        file.move("motor_position", "joint_position")
        file.move("motor_torque", "motor_current")
    with pytest.raises(InputError, match="is 'link', but it has motor_current"):
        read_recording(path)
    files = [
        kept_in(tmp_path, Replay(one, tiny_robot), b"")
        for one in (recording, replace(recording, link=False))
    ]
    assert files[0] != files[1]

"""Stepping many robots at once with MuJoCo Warp, here on its backend for processors."""

import subprocess
import sys

import numpy as np
import pytest
from conftest import HANG

from faultgen.applied import Applied
from faultgen.dataset.experiment import make_experiment
from faultgen.dataset.reader import open_dataset
from faultgen.dataset.sweep import generate
from faultgen.errors import InputError
from faultgen.robot import load_robot
from faultgen.simulation.nominal import nominal
from faultgen.simulation.plant import assemble
from faultgen.simulation.stepping import simulate

pytestmark = [
    pytest.mark.slow,  # two minutes of processor time, 70 s of it without compiling kernels
    pytest.mark.filterwarnings("default"),  # Warp has some of its own
]

PERIOD = 0.004


@pytest.fixture(scope="module")
def shared(tiny_robot_path, tiny_task_path):
    """The nominal cycle of a robot with two axes."""
    return nominal(str(tiny_robot_path), str(tiny_task_path), PERIOD)


def test_worlds_move_as_single_robots_do(shared):
    """Several structures, wear that grows, and a fault that adds an element in the second cycle."""
    from faultgen.simulation.worlds import simulate_together

    robot = shared.robot
    healthy = assemble(robot)
    worn = [assemble(robot, [Applied("friction_wear", 2, size)]) for size in (0.1, 0.3)]
    late = [assemble(robot, [Applied("delay", 1, 2e-3)]) for _ in range(2)]
    ripple = assemble(robot, [Applied("torque_ripple", 1, 0.05)])
    courses = [[healthy, healthy], worn, late, [healthy, ripple]]
    together = list(
        simulate_together(
            robot, shared.control, courses, sample_period=PERIOD, device="cpu", lead_in=0.5
        )
    )
    for k, plants in enumerate(courses):
        alone = simulate(robot, shared.control, plants, sample_period=PERIOD, lead_in=0.5)
        for told, exact in zip(together, alone, strict=True):
            error = told[k].motor_torque - exact.motor_torque
            assert np.all(np.sqrt(np.mean(error**2, axis=0)) < 1e-3 * shared.mean_torque)
            assert np.abs(told[k].joint_position - exact.joint_position).max() < 1e-5


def test_a_world_that_diverges_leaves_the_others_alone(shared):
    """It is told once, with its axis; the others are as before."""
    from faultgen.simulation.worlds import simulate_together

    robot = shared.robot
    healthy = assemble(robot)
    spec = robot.spec()
    spec.joint("motor1").stiffness[0] = -1e9
    broken = assemble(robot, spec=spec)
    control = shared.control[:800]
    first, second = simulate_together(
        robot,
        control,
        [[healthy, healthy], [broken, broken]],
        sample_period=PERIOD,
        device="cpu",
        lead_in=0.1,
    )
    assert "axis 1" in str(first[1]) and "diverged" in str(first[1])
    assert second[1] is None
    assert np.isfinite(second[0].motor_torque).all()


def test_a_dataset_has_the_same_labels_and_noise(tiny_robot_path, tiny_task_path, tmp_path):
    """Torques differ by rounding; a dataset is not finished with another kind of device."""
    told = {
        "robot": str(tiny_robot_path),
        "task": str(tiny_task_path),
        "axis": [1],
        "cycles": 2,
        "sensors": "realistic",
    }
    experiment = make_experiment(told)
    for name, device in (("exact", None), ("device", "cpu")):
        assert generate(experiment, tmp_path / name, device=device, progress=False).failed == {}
    pairs = zip(*(open_dataset(tmp_path / n).runs for n in ("exact", "device")), strict=True)
    for exact, other in pairs:
        for name in ("cycle/severity", "cycle/temperature", "truth/payload_mass"):
            assert np.array_equal(exact.read(name), other.read(name))
        noise = [
            r.read("signals/motor_torque") - r.read("truth/motor_torque") for r in (exact, other)
        ]
        assert np.abs(noise[0] - noise[1]).max() < 1e-5
        torque = exact.read("truth/motor_torque")
        error = torque - other.read("truth/motor_torque")
        assert 0 < np.abs(error).max() < 1e-3 * np.abs(torque).max()
        assert "Warp" in other["mujoco_version"] and "Warp" not in exact["mujoco_version"]
    with pytest.raises(InputError, match="--regenerate"):
        generate(experiment, tmp_path / "device", progress=False)


@pytest.mark.parametrize(
    ("more", "device", "message"),
    [
        ({"effect": "seizing_spot"}, "cpu", "seizing_spot acts between the steps"),
        ({"fidelity": "interpolated"}, "cpu", "interpolated runs"),
        ({}, "cuda:77", "no 'cuda:77' here"),
    ],
)
def test_what_a_device_cannot_do_is_refused(
    tiny_robot_path, tiny_task_path, tmp_path, more, device, message
):
    """In one line, and nothing is written."""
    told = {"robot": str(tiny_robot_path), "task": str(tiny_task_path), "cycles": 2, **more}
    with pytest.raises(InputError, match=message):
        generate(make_experiment(told), tmp_path / "out", device=device, progress=False)
    assert not (tmp_path / "out").exists()


def test_worlds_can_have_only_what_models_have():
    """Every field that is set for each world is a field of a model."""
    from faultgen.simulation.worlds import OWN

    model = load_robot("puma560").model
    assert len(OWN) > 50 and all(hasattr(model, name) for name in OWN)


def test_warp_prints_nothing_between_the_results():
    """Its greeting would stand before the JSON of `generate --device cpu --json`."""
    code = "from faultgen.simulation.worlds import check_device; print(check_device('cpu'))"
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, timeout=HANG)
    assert (done.returncode, done.stdout) == (0, "cpu\n"), done.stderr

import os

import mujoco
import mujoco.batch
import numpy as np
import pytest

import faultgen.simulation.stepping as module
from faultgen.effects import Applied
from faultgen.errors import InputError, SimulationFailed
from faultgen.mjcf.dcmotor import set_servo
from faultgen.robot import load_robot, robot_names
from faultgen.simulation.arm import Arm, motor_torque
from faultgen.simulation.motion import plan
from faultgen.simulation.plant import assemble
from faultgen.simulation.servo import control_signal
from faultgen.simulation.starting import start_on_reference
from faultgen.simulation.stepping import simulate
from faultgen.simulation.timers import stop_timers
from faultgen.tasks import load_task


@pytest.fixture(scope="module")
def swing(tiny_robot, tiny_task_path):
    """Motion and control of the small robot."""
    motion = plan(load_task("tiny", tiny_task_path), tiny_robot)
    return motion, control_signal(motion, tiny_robot.model.opt.timestep)


def channels(cycle):
    return np.concatenate([getattr(cycle, name) for name in cycle.__dataclass_fields__], axis=1)


def test_samples_are_those_of_plain_stepping(tiny_robot, swing):
    """Every channel equals what one MjData stepped by mj_step gives at the sample's time."""
    _, control = swing
    model, step = tiny_robot.model, tiny_robot.model.opt.timestep
    (cycle,) = simulate(tiny_robot, control, [model], sample_period=0.004)
    batch = mujoco.batch.Batch(model, 1, 1)
    lead = min(len(control), round(module.LEAD_IN / step))
    start_on_reference(tiny_robot, batch, control[len(control) - lead])
    data = batch.get_data(0)
    for row in control[len(control) - lead :]:
        data.ctrl[:] = row
        mujoco.mj_step(model, data)
    for k, row in enumerate(control):
        data.ctrl[:] = row
        if k % 4 == 0:
            mujoco.mj_forward(model, data)
            speed = data.qvel[list(tiny_robot.motors)]
            np.testing.assert_array_equal(
                cycle.motor_position[k // 4], data.qpos[list(tiny_robot.motors)]
            )
            np.testing.assert_array_equal(cycle.motor_velocity[k // 4], speed)
            np.testing.assert_array_equal(cycle.motor_torque[k // 4], data.actuator_force[:2])
            np.testing.assert_allclose(
                cycle.joint_position[k // 4], data.qpos[list(tiny_robot.joints)], atol=1e-13
            )
            friction = data.actuator_force[2:] - model.actuator_damping[2:] * speed
            np.testing.assert_allclose(cycle.friction_torque[k // 4], friction, atol=1e-13)
        mujoco.mj_step(model, data)


def test_chunks_do_not_matter(tiny_robot, swing, monkeypatch):
    """However many steps are recorded at once, the result is the same, bit for bit."""
    models = [tiny_robot.model] * 2
    whole = [channels(c) for c in simulate(tiny_robot, swing[1], models, sample_period=0.004)]
    monkeypatch.setattr(module, "CHUNK", 84)
    parts = [channels(c) for c in simulate(tiny_robot, swing[1], models, sample_period=0.004)]
    np.testing.assert_array_equal(whole, parts)


def test_cycles_repeat(robot):
    """A healthy robot without noise does the same in each cycle, to 0.1 % of the RMS torque."""
    motion = plan(load_task(robot.name, "pick_and_place"), robot)
    control = control_signal(motion, robot.model.opt.timestep)
    first, second = simulate(robot, control, [robot.model] * 2, sample_period=0.004)
    error = np.sqrt(((first.motor_torque - second.motor_torque) ** 2).mean(axis=0))
    assert (error < 1e-3 * np.sqrt((second.motor_torque**2).mean(axis=0))).all()


def test_the_arm_follows(robot):
    """The motors stay within 3 mrad (joint side) of the reference in every task."""
    for task in ("pick_and_place", "spot_weld", "arc_weld"):
        motion = plan(load_task(robot.name, task), robot)
        control = control_signal(motion, robot.model.opt.timestep)
        (cycle,) = simulate(robot, control, [robot.model], sample_period=0.004)
        reference = motion(np.arange(len(cycle.motor_position)) * 0.004)[0]
        error = cycle.motor_position / robot.gear_ratio - reference
        assert np.abs(error).max() < 3e-3, task


@pytest.mark.parametrize("name", robot_names())
def test_every_robot_runs_a_second_alone(name):
    """Stepped without control for one second, no robot raises a MuJoCo warning."""
    model = load_robot(name).model
    data = mujoco.MjData(model)
    for _ in range(round(1 / model.opt.timestep)):
        mujoco.mj_step(model, data)
    assert all(warning.number == 0 for warning in data.warning)


@pytest.mark.parametrize("axis", [1, 2])
@pytest.mark.parametrize("beside", [[], [Applied("load_friction", 1, 0.02)]])
def test_divergence_names_the_axis_and_the_time(tiny_robot, swing, axis, beside):
    """The axis whose gearbox is far too stiff, also with effects that act between steps."""
    spec = tiny_robot.spec()
    spec.tendon(f"gearbox{axis}").stiffness[0] = 1e9
    healthy = assemble(tiny_robot, beside)
    broken = assemble(tiny_robot, beside, spec=spec)
    cycles = simulate(tiny_robot, swing[1], [healthy, broken], sample_period=0.004)
    next(cycles)
    message = rf"cycle 2: the simulation diverged before 0\.[0-9]{{3}} s of .*, on axis {axis}: bad"
    with pytest.raises(SimulationFailed, match=message):
        next(cycles)


def test_divergence_is_reported(tiny_robot, swing, tmp_path, monkeypatch, capfd):
    """A run that blows up raises, says in which cycle, and leaves no log file behind."""
    monkeypatch.chdir(tmp_path)
    spec = tiny_robot.spec()
    spec.tendon("gearbox2").stiffness[0] = 1e12
    models = [tiny_robot.model, spec.compile()]
    cycles = simulate(tiny_robot, swing[1], models, sample_period=0.004)
    next(cycles)
    with pytest.raises(SimulationFailed, match="cycle 2: the simulation diverged before"):
        next(cycles)
    assert os.listdir(tmp_path) == []
    assert capfd.readouterr().err == ""


def test_sample_periods_must_fit(tiny_robot, swing):
    """A sample period that is no whole number of steps is refused."""
    with pytest.raises(InputError, match="sample period 0.0035 s must be a whole number of steps"):
        next(simulate(tiny_robot, swing[1], [tiny_robot.model], sample_period=0.0035))


def test_wear_raises_friction_torque_by_its_share(tiny_robot, swing):
    """30 % more Coulomb and static friction on axis 1 is 30 % more, where it slides fast."""
    spec = tiny_robot.spec()
    spec.actuator("friction1").biasprm[3:5] *= 1.3
    spec.actuator("friction1").damping[0] = 0
    plain = tiny_robot.spec()
    plain.actuator("friction1").damping[0] = 0
    models = [plain.compile(), spec.compile()]
    before, after = simulate(tiny_robot, swing[1], models, sample_period=0.004)
    fast = (np.abs(before.motor_velocity[:, 0]) > 40) & (np.abs(after.motor_velocity[:, 0]) > 40)
    ratio = after.friction_torque[fast, 0] / before.friction_torque[fast, 0]
    np.testing.assert_allclose(ratio, 1.3, rtol=1e-6)


def test_steps_do_not_read_the_clock(tiny_robot):
    """Timings that nobody reads took an eighth of each step."""
    assert stop_timers()
    data = mujoco.MjData(tiny_robot.model)
    mujoco.mj_step(tiny_robot.model, data, 10)
    assert all(timer.duration == 0 for timer in data.timer)


@pytest.mark.parametrize(
    ("effect", "severity"),
    [
        ("payload_mass", 1.0),
        ("gear_stiffness", 0.4),
        ("backlash", 1e-3),
        ("gravity_spring", 500.0),
        ("loose_tool", 1e-3),
    ],
)
def test_a_changed_robot_starts_in_equilibrium(effect, severity):
    """A heavy elastic arm that holds its pose does not ring when the simulation starts."""
    robot = load_robot("irb6700")
    pose = np.array([0.3, -0.4, 0.2, 0.5, 0.8, 0.1]) * robot.gear_ratio
    control = np.zeros((2000, int(robot.model.actuator_ctrlnum.sum())))
    at = robot.model.actuator_ctrladr[robot.ids("actuator", "drive")]
    still = np.zeros((1, robot.n_axes))
    control[:, at] = pose
    control[:, at + 2] = motor_torque(Arm(robot), pose / robot.gear_ratio + still, still, still)
    axis = 6 if effect in ("payload_mass", "loose_tool") else 2
    spec = robot.spec()
    fast = 0.35 / robot.model.opt.timestep  # a servo so stiff that no rotor gives way [rad/s]
    for number, inertia in enumerate(robot.model.dof_M0[list(robot.motors)].tolist(), start=1):
        set_servo(spec.actuator(f"drive{number}"), inertia * fast**2, 0, inertia * 2 * fast)
    plant = assemble(robot, [Applied(effect, axis, severity)], spec=spec)
    (cycle,) = simulate(robot, control, [plant], sample_period=0.005, lead_in=0.0)
    load = cycle.gear_torque[:, 1]
    assert np.ptp(load) < 0.01 * abs(load.mean())

"""Laws of gearbox, servo and effects at their edges: one-sided bands, shares, order of edits."""

import mujoco
import numpy as np
import pytest
from conftest import TWO_AXES

from faultgen.effects import Applied, get_effect
from faultgen.mjcf.gearbox import Gearbox
from faultgen.robot import load_robot
from faultgen.simulation.arm import nominal_friction
from faultgen.simulation.motion import plan
from faultgen.simulation.plant import assemble
from faultgen.simulation.servo import control_signal
from faultgen.tasks import load_task


@pytest.mark.parametrize("band", [(0.0, 2e-4), (-2e-4, 0.0), (-1e-4, 3e-4)])
def test_a_gearbox_with_every_term_has_the_torque_of_the_engine(tiny_robot, band):
    """Dead bands of one side, and every power of stiffness and damping, act as in MuJoCo."""
    model = tiny_robot.spec().compile()
    gearbox, joints = tiny_robot.ids("tendon", "gearbox"), list(tiny_robot.joints)
    model.opt.gravity[:] = 0
    model.actuator_damping[:] = 0
    model.tendon_lengthspring[gearbox] = band
    model.tendon_stiffnesspoly[gearbox] = model.tendon_stiffness[gearbox, None] * [800.0, 3e6]
    model.tendon_dampingpoly[gearbox] = model.tendon_damping[gearbox, None] * [2.0, 5.0]
    law, data = Gearbox(model, gearbox), mujoco.MjData(model)
    rng = np.random.default_rng(4)
    for _ in range(5):
        data.qpos[list(tiny_robot.motors)] = rng.uniform(-1e-3, 1e-3, 2) * tiny_robot.gear_ratio
        data.qvel[:] = rng.uniform(-1, 1, model.nv)
        mujoco.mj_forward(model, data)
        torque = law.torque(data.ten_length[gearbox], data.ten_velocity[gearbox])
        expected = (data.qfrc_spring + data.qfrc_damper)[joints]
        np.testing.assert_allclose(torque, expected, rtol=1e-10, atol=1e-10)


@pytest.fixture(scope="module")
def swing(tiny_task_path, tmp_path_factory):
    """Function: a robot like the small one, with more custom numbers, and its motion."""

    def make(numbers=""):
        path = tmp_path_factory.mktemp("variant") / "tiny.xml"
        path.write_text(TWO_AXES.replace("<custom>", "<custom>" + numbers))
        robot = load_robot(str(path))
        return robot, plan(load_task("tiny", tiny_task_path), robot)

    return make


def test_velocity_set_points_belong_half_a_step_before_the_positions(swing):
    """Between two position set points the mean speed is the later one's velocity set point."""
    robot, motion = swing()
    step = robot.model.opt.timestep
    control = control_signal(motion, step)
    at = robot.model.actuator_ctrladr[robot.ids("actuator", "drive")]
    mean = np.diff(control[:, at], axis=0) / step
    error = np.abs(mean - control[1:, at + 1]).max(axis=0)
    # at another time, even a sixth of a step off, it differs by that time x the acceleration
    acceleration = np.abs(np.diff(mean, axis=0)).max(axis=0) / step
    assert (error < step * acceleration / 20).all()


def test_shares_of_the_set_points(swing):
    """A controller may command a part of velocity and feed-forward, or no feed-forward."""
    robot, motion = swing()
    step = robot.model.opt.timestep
    whole = control_signal(motion, step)
    at = robot.model.actuator_ctrladr[robot.ids("actuator", "drive")]
    for shares in ((1.0, 0.5, 0.25), (1.0, 0.5, 0.0)):
        numbers = f'<numeric name="servo_set_points" data="{" ".join(map(str, shares))}"/>'
        part = control_signal(swing(numbers)[1], step)
        for k, share in enumerate(shares):
            np.testing.assert_allclose(part[:, at + k], share * whole[:, at + k], atol=1e-12)


def test_the_controller_reckons_with_a_constant_torque(tiny_robot, tmp_path):
    """A torque that pushes forward is subtracted in motion of both directions, and fades at rest.

    So it is of the nominal robot only.
    """
    spec = tiny_robot.spec()
    get_effect("torque_offset").apply(spec, 1, 0.05)
    path = tmp_path / "pushed.xml"
    path.write_text(spec.to_xml())
    speed = np.array([[200.0, 200.0], [-200.0, -200.0], [0.0, 0.0]])
    change = nominal_friction(load_robot(str(path)), speed) - nominal_friction(tiny_robot, speed)
    np.testing.assert_allclose(change[:, 0], [-0.05, -0.05, 0.0], atol=1e-12)
    np.testing.assert_allclose(change[:, 1], 0, atol=1e-12)


@pytest.mark.parametrize("effect", ["transmission_error", "tooth_damage"])
def test_what_depends_on_the_stiffness_sees_the_final_one(tiny_robot, effect):
    """The force of a gearbox error is that of the worn stiffness, in whatever order they come."""
    both = [Applied(effect, 1, 1e-4), Applied("gear_stiffness", 1, 0.4)]
    one, other = (assemble(tiny_robot, order).model for order in (both, both[::-1]))
    alone = assemble(tiny_robot, both[:1]).model
    np.testing.assert_array_equal(one.actuator_biasprm, other.actuator_biasprm)
    added = slice(tiny_robot.model.nu, None)
    assert not np.allclose(one.actuator_biasprm[added], alone.actuator_biasprm[added])


def test_severities_are_shown_with_their_unit():
    """Fractions of nominal are percent; other severities carry the first words of their unit."""
    assert get_effect("friction_wear").shown(0.125) == "12.5 %"
    assert get_effect("torque_offset").shown(-0.02) == "-0.02 N m"
    assert get_effect("backlash").shown(0.003) == "0.003 rad"
    assert get_effect("friction_asymmetry").shown(0.3) == "0.3 fraction"


def test_a_late_drive_begins_with_the_first_row(swing):
    """Of a control that does not repeat, the first row holds until the delayed ones come."""
    robot, motion = swing()
    step = robot.model.opt.timestep
    control = control_signal(motion, step)[200:]
    assert np.abs(control[1] - control[0]).max() > 1e-4
    late = assemble(robot, [Applied("delay", 2, 5 * step)]).command(control, False)
    own = robot.model.actuator_ctrladr[robot.ids("actuator", "drive")[1]] + np.arange(3)
    np.testing.assert_allclose(late[:5, own], control[[0] * 5][:, own], atol=1e-12)
    np.testing.assert_allclose(late[5:, own], control[:-5, own], atol=1e-9)

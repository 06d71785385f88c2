"""The robot models against closed forms and published numbers."""

from __future__ import annotations

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

from faultgen.mjcf.gearbox import Gearbox
from faultgen.robot import Robot, load_robot
from faultgen.simulation import stepping as simulate
from faultgen.simulation.arm import Arm
from faultgen.simulation.motion import plan
from faultgen.simulation.servo import control_signal
from faultgen.tasks import load_task

ROBOTS = ("irb6700", "puma560")
REFERENCE = json.loads((Path(__file__).parents[1] / "data" / "puma560_reference.json").read_text())

ARM_INERTIA, ROTOR_INERTIA, RATIO, STIFFNESS = 20.0, 0.003, 120.0, 4e5
ONE_AXIS = f"""
<mujoco>
  <compiler angle="radian" inertiafromgeom="false"/>
  <option timestep="1e-4" gravity="0 0 0"/>
  <worldbody>
    <body><joint name="joint1"/>
      <inertial pos="0 0 0" mass="1"
        diaginertia="{ARM_INERTIA} {ARM_INERTIA} {ARM_INERTIA}"/></body>
    <body><joint name="motor1"/><inertial pos="0 0 0" mass="1"
      diaginertia="{ROTOR_INERTIA} {ROTOR_INERTIA} {ROTOR_INERTIA}"/></body>
  </worldbody>
  <tendon>
    <fixed name="gearbox1" stiffness="{STIFFNESS}">
      <joint joint="motor1" coef="{1 / RATIO}"/><joint joint="joint1" coef="-1"/></fixed>
  </tendon>
  <actuator>
    <dcmotor name="drive1" joint="motor1" input="pos vel ff" motorconst="1" resistance="1"
      controller="9 0 0.5 0 0 0" saturation="4 0 0"/>
    <dcmotor name="friction1" joint="motor1" input="none" motorconst="0" resistance="1"
      lugre="90 0.5 0.8 1.4 5" damping="0.004" cogging="-0.1 0 1.5707963267948966"/>
  </actuator>
</mujoco>
"""


@pytest.fixture(params=ROBOTS)
def robot(request: pytest.FixtureRequest) -> Robot:
    """Each robot in turn."""
    return load_robot(request.param)


@pytest.fixture(params=(*ROBOTS, "one_axis"))
def any_robot(request: pytest.FixtureRequest) -> Robot:
    """Each robot in turn, and a robot of one axis."""
    return one_axis() if request.param == "one_axis" else load_robot(request.param)


def one_axis() -> Robot:
    """A robot of one axis, without gravity."""
    return Robot("one_axis", ONE_AXIS)


def undriven(robot: Robot) -> mujoco.MjModel:
    """The robot without drives; friction stays."""
    spec = robot.spec()
    for i in range(robot.n_axes):
        spec.delete(spec.actuator(f"drive{i + 1}"))
    return spec.compile()


def heavy_rotors(robot: Robot) -> mujoco.MjSpec:
    """The robot with rotors so heavy that they keep their speed."""
    spec = robot.spec()
    for i in range(robot.n_axes):
        # in the file: MuJoCo takes the inertia of such simple bodies from the compiler
        spec.joint(f"motor{i + 1}").armature = 1e9
    return spec


def frictionless(spec: mujoco.MjSpec, robot: Robot) -> mujoco.MjModel:
    """The robot without drives and friction, without gravity and balancing spring, undamped."""
    for actuator in list(spec.actuators):
        spec.delete(actuator)
    model = spec.compile()
    model.opt.gravity[:] = 0
    model.tendon_damping[:] = 0
    gearbox = robot.ids("tendon", "gearbox")
    model.tendon_stiffness[np.setdiff1d(np.arange(model.ntendon), gearbox)] = 0
    return model


def flywheels(robot: Robot) -> mujoco.MjModel:
    """The robot with its gearboxes open, drives off, and rotors that keep their speed."""
    model = heavy_rotors(robot).compile()
    model.actuator_gainprm[robot.ids("actuator", "drive"), 4:7] = 0
    gearbox = robot.ids("tendon", "gearbox")
    model.tendon_stiffness[gearbox] = 0
    model.tendon_damping[gearbox] = 0
    model.opt.gravity[:] = 0
    return model


def frequency(model: mujoco.MjModel, shape: np.ndarray, watched: int, expected: float) -> float:
    """Frequency [Hz] of a free oscillation that starts at rest, deflected by `shape`."""
    model.opt.timestep = 1 / (expected * 400)
    data = mujoco.MjData(model)
    data.qpos[:] = shape
    trace = np.empty(8000)
    for k in range(len(trace)):
        trace[k] = data.qpos[watched]
        mujoco.mj_step(model, data)
    trace -= trace.mean()
    rising = np.flatnonzero((trace[:-1] < 0) & (trace[1:] >= 0))
    at = rising + trace[rising] / (trace[rising] - trace[rising + 1])
    return (len(at) - 1) / ((at[-1] - at[0]) * model.opt.timestep)


def steady_friction(robot: Robot, speed: np.ndarray) -> np.ndarray:
    """Friction torque on rotors that turn steadily, against the motion, shape (n_axes,), [N m]."""
    model = flywheels(robot)
    data = mujoco.MjData(model)
    data.qvel[list(robot.motors)] = speed
    friction = robot.ids("actuator", "friction")
    # 30 relaxations of the slowest bristle
    bristle = model.actuator_biasprm[friction, 4] / model.actuator_dynprm[friction, 5]
    seconds = 30 * np.max(bristle / np.abs(speed))
    for _ in range(int(seconds / model.opt.timestep) + 10):
        mujoco.mj_step(model, data)
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.qvel[list(robot.motors)], speed, rtol=1e-7)
    return -(data.qfrc_actuator + data.qfrc_passive)[list(robot.motors)]


def test_resonance_of_one_axis() -> None:
    """Two inertias and a spring swing at sqrt(K (1/J_arm + 1/(J n^2))) / 2 pi."""
    robot = one_axis()
    model = frictionless(robot.spec(), robot)
    rotor = ROTOR_INERTIA * RATIO**2
    expected = np.sqrt(STIFFNESS * (1 / ARM_INERTIA + 1 / rotor)) / (2 * np.pi)
    shape = 1e-3 * np.array([1 / ARM_INERTIA, -RATIO / rotor])
    assert frequency(model, shape, 0, expected) == pytest.approx(expected, rel=1e-3)


def test_locked_rotor_resonance_of_one_axis() -> None:
    """With its rotor locked, the arm swings at sqrt(K / J_arm) / 2 pi, the anti-resonance."""
    robot = one_axis()
    model = frictionless(heavy_rotors(robot), robot)
    expected = np.sqrt(STIFFNESS / ARM_INERTIA) / (2 * np.pi)
    measured = frequency(model, np.array([1e-3, 0]), 0, expected)
    assert measured == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("locked", [False, True], ids=["free", "locked"])
def test_resonances_of_robot(robot: Robot, locked: bool) -> None:
    """Each elastic mode swings at the frequency that inertias, ratios and stiffnesses give."""
    model = frictionless(heavy_rotors(robot) if locked else robot.spec(), robot)
    gearbox = robot.ids("tendon", "gearbox")
    joints, motors = list(robot.joints), list(robot.motors)
    inertia = np.zeros((model.nv, model.nv))
    pose = np.zeros(robot.n_axes)
    inertia[np.ix_(joints, joints)] = Arm(robot).inertia(pose)
    rotor = model.body_inertia[model.jnt_bodyid[motors], 2]
    inertia[motors, motors] = rotor + model.dof_armature[motors]
    twist = np.zeros((robot.n_axes, model.nv))
    twist[range(robot.n_axes), motors] = 1 / robot.gear_ratio
    twist[range(robot.n_axes), joints] = -1
    stiffness = twist.T @ np.diag(model.tendon_stiffness[gearbox]) @ twist
    values, shapes = eigh(stiffness, inertia)
    elastic = range(model.nv - robot.n_axes, model.nv)
    for mode in elastic:
        expected = np.sqrt(values[mode]) / (2 * np.pi)
        deflected = shapes[:, mode] * 1e-6 / np.abs(twist @ shapes[:, mode]).max()
        watched = joints[int(np.argmax(np.abs(shapes[joints, mode])))]
        measured = frequency(model, deflected, watched, expected)
        assert measured == pytest.approx(expected, rel=0.01), f"mode {mode}"


def test_steady_sliding_is_the_stribeck_curve(any_robot: Robot) -> None:
    """In steady sliding friction is Fc + (Fs - Fc) exp(-(w / vs)^2) + B |w| + offset, to 1e-6."""
    robot = any_robot
    model = robot.model
    friction = robot.ids("actuator", "friction")
    coulomb, stiction, vs = model.actuator_biasprm[friction, 3:6].T
    offset = model.actuator_biasprm[friction, 0]
    for speed in (0.3, 1.0, 2.5, 5.0, 12.0, 25.0, 60.0, 200.0, 420.0):
        for sign in (1.0, -1.0):
            w = np.full(robot.n_axes, sign * speed)
            sliding = coulomb + (stiction - coulomb) * np.exp(-((w / vs) ** 2))
            expected = sign * sliding + model.actuator_damping[friction] * w - offset
            error = (steady_friction(robot, w) - expected) / coulomb
            np.testing.assert_allclose(error, 0, atol=1e-6, err_msg=f"speed {w[0]}")


def test_friction_of_puma_is_the_published_one() -> None:
    """Sliding friction is Tc + B w of the toolbox, with Tc of the joint's direction, to 1e-6."""
    robot = load_robot("puma560")
    gear = np.array([link["G"] for link in REFERENCE["links"]])
    viscous = np.array([link["B"] for link in REFERENCE["links"]])
    forward, backward = np.array([link["Tc"] for link in REFERENCE["links"]]).T
    for direction, coulomb in ((1.0, forward), (-1.0, -backward)):
        speed = 0.8 * robot.motor_velocity_limit
        along = steady_friction(robot, direction * np.sign(gear) * speed) * np.sign(gear)
        np.testing.assert_allclose(direction * along, coulomb + viscous * speed, rtol=1e-6)
    # the same numbers by the toolbox's own function of joint velocity; it returns what opposes
    qd = np.array(REFERENCE["qd"])
    decayed = np.flatnonzero((np.abs(qd * gear) > 15).all(axis=1))
    assert len(decayed) > 5
    for state in decayed:
        ours = -steady_friction(robot, qd[state] * gear) * gear
        np.testing.assert_allclose(ours, REFERENCE["friction"][state], rtol=1e-5)


def test_gears_of_puma_are_the_published_ones() -> None:
    """Gear ratios are the toolbox's, with their signs, to the 8 digits that the file gives."""
    gear = [link["G"] for link in REFERENCE["links"]]
    np.testing.assert_allclose(load_robot("puma560").gear_ratio, gear, rtol=1e-7)


def test_presliding(any_robot: Robot) -> None:
    """Torque below stiction deflects a rotor like a spring of sigma0; above it the rotor slides."""
    robot = any_robot
    model = robot.spec().compile()
    gearbox = robot.ids("tendon", "gearbox")
    model.tendon_stiffness[gearbox] = 0
    model.tendon_damping[gearbox] = 0
    drive, friction = robot.ids("actuator", "drive"), robot.ids("actuator", "friction")
    model.actuator_gainprm[drive, 4:7] = 0
    feedforward = model.actuator_ctrladr[drive] + 2
    offset = model.actuator_biasprm[friction, 0]
    stiction, sigma0 = model.actuator_biasprm[friction, 4], model.actuator_dynprm[friction, 5]
    data = mujoco.MjData(model)

    def settle(torque: np.ndarray) -> np.ndarray:
        """Go to a torque in 1 s, slowly since the bristle is hardly damped, and wait for 0.5 s."""
        steps = int(1.0 / model.opt.timestep)
        begin = data.ctrl[feedforward]
        for k in range(steps + steps // 2):
            data.ctrl[feedforward] = begin + min(1, k / steps) * (torque - offset - begin)
            mujoco.mj_step(model, data)
        return data.qpos[list(robot.motors)].copy()

    data.ctrl[feedforward] = -offset
    # the bristle softens by torque / stiction, so that 0.5 % of it shows the initial stiffness
    torque = 0.005 * stiction
    deflection = settle(torque)
    np.testing.assert_allclose(deflection, torque / sigma0, rtol=0.01)
    np.testing.assert_allclose(settle(0 * torque) / deflection, 0, atol=0.01)
    # dz/dq = 1 - sigma0 z / Fs, integrated from rest
    held = settle(0.6 * stiction)
    np.testing.assert_allclose(held, -stiction / sigma0 * np.log(1 - 0.6), rtol=0.01)
    assert (settle(1.05 * stiction) > 1).all()


def test_energy_counts_springs(robot: Robot) -> None:
    """MuJoCo's potential energy is gravity, gearbox springs and the balancing spring."""
    model = robot.spec().compile()
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data = mujoco.MjData(model)
    data.qpos[:] = np.random.default_rng(1).normal(0, 0.3, model.nq)
    mujoco.mj_forward(model, data)
    gravity = -model.body_mass @ data.xipos @ model.opt.gravity
    stretch = data.ten_length - model.tendon_lengthspring[:, 0]
    springs = model.tendon_stiffness @ stretch**2 / 2
    assert springs > 1
    assert data.energy[0] == pytest.approx(gravity + springs, rel=1e-12)


def energy(robot: Robot, timestep: float, *, lossless: bool = False) -> tuple[np.ndarray, float]:
    """Energy of a robot left alone, from a random state on.

    Args:
        robot: The robot.
        timestep: Step [s].
        lossless: Without friction and damping of the gearboxes.

    Returns:
        Total energy every 0.5 ms for 0.5 s, shape (1000,), and the kinetic energy at the start [J].
    """
    model = undriven(robot)
    model.opt.timestep = timestep
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT  # its energy is not counted
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    motors, joints = list(robot.motors), list(robot.joints)
    friction = [model.actuator(f"friction{i + 1}").id for i in range(robot.n_axes)]
    if lossless:
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_DAMPER
    offset = model.actuator_biasprm[friction, 0] * (not lossless)
    sigma0 = model.actuator_dynprm[friction, 5] * (not lossless)
    bristle = model.actuator_actadr[friction]
    random = np.random.default_rng(7)
    data, probe = mujoco.MjData(model), mujoco.MjData(model)
    data.qpos[joints] = random.uniform(-0.8, 0.8, robot.n_axes)
    data.qpos[motors] = data.qpos[joints] * robot.gear_ratio
    speed = random.uniform(-0.6, 0.6, robot.n_axes) * robot.motor_velocity_limit
    data.qvel[motors] = speed
    data.qvel[joints] = speed / robot.gear_ratio * 0.98  # so that the gearboxes ring
    every = round(5e-4 / timestep)
    total = np.empty(1000)
    for k in range(len(total) * every):
        if k % every:
            mujoco.mj_step(model, data)
            continue
        strain = sigma0 @ data.act[bristle] ** 2 / 2
        # the difference of friction between directions is a constant torque: it has a potential
        constant = -offset @ data.qpos[motors]
        probe.qpos[:] = data.qpos
        before = data.qvel.copy()
        mujoco.mj_step(model, data)
        # the velocity of a semi-implicit step is that of half a step before, hence the mean of two
        probe.qvel[:] = (before + data.qvel) / 2
        mujoco.mj_forward(model, probe)
        if k == 0:
            kinetic = float(probe.energy[1])
        total[k // every] = probe.energy.sum() + strain + constant
    return total, kinetic


def test_passivity(robot: Robot) -> None:
    """Left alone, a robot loses energy all the time, at its own step and at a fifth of it."""
    for timestep in (robot.model.opt.timestep, robot.model.opt.timestep / 5):
        total, kinetic = energy(robot, timestep)
        assert total[0] - total[-1] > 0.3 * kinetic
        assert np.diff(total).max() < 0


def test_energy_is_conserved_without_losses(robot: Robot) -> None:
    """Without losses energy drifts by < 0.1 % of the kinetic, in proportion to the step."""
    drift = []
    for timestep in (5e-4, 1.25e-4):
        total, kinetic = energy(robot, timestep, lossless=True)
        drift.append(np.abs(total - total[0]).max() / kinetic)
    assert drift[0] < 1e-3
    assert drift[1] == pytest.approx(drift[0] / 4, rel=0.1)


def test_gearbox_acts_equally_on_both_sides(any_robot: Robot) -> None:
    """A gearbox acts on the motor with -1/n of its torque on the joint, as logged."""
    robot = any_robot
    model = robot.spec().compile()
    gearbox = robot.ids("tendon", "gearbox")
    motors, joints = list(robot.motors), list(robot.joints)
    model.opt.gravity[:] = 0
    model.actuator_damping[:] = 0
    model.tendon_stiffness[np.setdiff1d(np.arange(model.ntendon), gearbox)] = 0
    random = np.random.default_rng(2)
    data = mujoco.MjData(model)
    for variant in ("linear", "dead band", "polynomial"):
        if variant == "dead band":
            model.tendon_lengthspring[gearbox] = [-2e-4, 2e-4]
        if variant == "polynomial":
            model.tendon_stiffnesspoly[gearbox, 1] = 3e6 * model.tendon_stiffness[gearbox]
            model.tendon_dampingpoly[gearbox, 0] = 2 * model.tendon_damping[gearbox]
        for _ in range(5):
            data.qpos[joints] = random.uniform(-1, 1, robot.n_axes)
            twist = random.uniform(-1e-3, 1e-3, robot.n_axes)
            data.qpos[motors] = (data.qpos[joints] + twist) * robot.gear_ratio
            data.qvel[:] = random.uniform(-1, 1, model.nv)
            mujoco.mj_forward(model, data)
            force = data.qfrc_spring + data.qfrc_damper
            scale = np.abs(force[joints]).max()
            np.testing.assert_allclose(
                force[motors] * robot.gear_ratio, -force[joints], atol=1e-12 * scale
            )
            logged = Gearbox(model, gearbox).torque(
                data.ten_length[gearbox], data.ten_velocity[gearbox]
            )
            np.testing.assert_allclose(logged, force[joints], atol=1e-12 * scale)


def test_logged_torques_obey_newton(robot: Robot) -> None:
    """At each step J dw/dt = drive + friction - gear / n, and gear torque moves the rigid arm."""
    step = robot.model.opt.timestep
    control = control_signal(plan(load_task(robot.name, "pick_and_place"), robot), step)
    cycle = next(simulate.simulate(robot, control, [robot.model], sample_period=step))
    inertia = robot.model.body_inertia[robot.model.jnt_bodyid[list(robot.motors)], 2]
    acceleration = np.diff(cycle.motor_velocity, axis=0) / step
    torque = cycle.motor_torque + cycle.friction_torque - cycle.gear_torque / robot.gear_ratio
    # MuJoCo applies viscous friction at the velocity after the step; logged is the one before
    viscous = robot.model.actuator_damping[robot.ids("actuator", "friction")]
    implicit = -viscous * np.diff(cycle.motor_velocity, axis=0)
    error = np.abs(inertia * acceleration - torque[:-1] - implicit).max(axis=0)
    np.testing.assert_array_less(error, 1e-6 * robot.motor_torque_limit)
    few = slice(0, len(control) - 1, 50)
    load = Arm(robot).inverse_dynamics(
        cycle.joint_position[few],
        cycle.joint_velocity[few],
        (np.diff(cycle.joint_velocity, axis=0) / step)[few],
    )
    error = np.abs(load - cycle.gear_torque[few]).max(axis=0)
    limit = robot.motor_torque_limit * np.abs(robot.gear_ratio)
    np.testing.assert_array_less(error, 1e-6 * limit)


def test_drive_saturates(any_robot: Robot) -> None:
    """The drive gives kp dq + kd dw + ff up to its limit, and the limit beyond it."""
    robot = any_robot
    model = robot.model
    drive = robot.ids("actuator", "drive")
    control = model.actuator_ctrladr[drive]
    kp, kd = model.actuator_gainprm[drive, 4], model.actuator_gainprm[drive, 6]
    limit = robot.motor_torque_limit
    data = mujoco.MjData(model)
    for share in (-3.0, -1.01, -0.99, 0.4, 0.99, 1.01, 3.0):
        parts = share * limit * np.array([[0.5], [0.3], [0.2]])
        data.ctrl[control] = parts[0] / kp
        data.ctrl[control + 1] = parts[1] / kd
        data.ctrl[control + 2] = parts[2]
        mujoco.mj_forward(model, data)
        torque = data.actuator_force[model.actuator_outadr[drive]]
        np.testing.assert_allclose(torque, np.clip(share, -1, 1) * limit, rtol=1e-12)


def test_simulated_drive_saturates(robot: Robot) -> None:
    """In a run that asks for more, the logged torque reaches the limit and stays within it."""
    step = robot.model.opt.timestep
    control = control_signal(plan(load_task(robot.name, "pick_and_place"), robot), step)[:2000]
    at = robot.model.actuator_ctrladr[robot.ids("actuator", "drive")]
    control[1000:1100, at + 2] += 1.5 * robot.motor_torque_limit
    cycle = next(simulate.simulate(robot, control, [robot.model], sample_period=step))
    largest = np.abs(cycle.motor_torque).max(axis=0)
    np.testing.assert_array_equal(largest, robot.motor_torque_limit)


def test_rigid_arm_of_puma_is_the_published_one() -> None:
    """Torque, gravity and inertia of the arm are the Robotics Toolbox's, to 1e-6 N m and kg m2."""
    arm = Arm(load_robot("puma560"), payload=False)
    q, qd, qdd = (np.array(REFERENCE[name]) for name in ("q", "qd", "qdd"))
    torque = arm.inverse_dynamics(q, qd, qdd)
    np.testing.assert_allclose(torque, REFERENCE["tau_rigid"], atol=1e-6, rtol=0)
    gravity = arm.inverse_dynamics(q, 0 * q, 0 * q)
    np.testing.assert_allclose(gravity, REFERENCE["gravity"], atol=1e-6, rtol=0)
    for state, matrix in zip(
        REFERENCE["inertia_matrix_states"], REFERENCE["inertia_matrix"], strict=True
    ):
        np.testing.assert_allclose(arm.inertia(q[state]), matrix, atol=1e-6, rtol=0)


def test_kinematics_of_puma_are_the_published_ones() -> None:
    """The frame of the body link6 is the toolbox's, to 1e-9."""
    arm = Arm(load_robot("puma560"), payload=False)
    for q, expected in zip(REFERENCE["q"], REFERENCE["fkine"], strict=True):
        np.testing.assert_allclose(link6(arm, q), expected, atol=1e-9)


def test_kinematics_of_irb_are_the_published_ones() -> None:
    """The flange is where lengths of 780, 320, 1125, 200, 1142.5 and 200 mm put it."""
    arm = Arm(load_robot("irb6700"), payload=False)

    def move(x: float, z: float) -> np.ndarray:
        transform = np.eye(4)
        transform[:3, 3] = x, 0, z
        return transform

    def turn(axis: str, angle: float) -> np.ndarray:
        transform = np.eye(4)
        transform[:3, :3] = Rotation.from_euler(axis, angle).as_matrix()
        return transform

    for q in np.random.default_rng(3).uniform(-2, 2, (20, 6)):
        expected = move(0, 0.780) @ turn("z", q[0]) @ move(0.320, 0) @ turn("y", q[1])
        expected = expected @ move(0, 1.125) @ turn("y", q[2]) @ move(0, 0.200) @ turn("x", q[3])
        expected = expected @ move(1.1425, 0) @ turn("y", q[4]) @ move(0.200, 0) @ turn("x", q[5])
        np.testing.assert_allclose(link6(arm, q), expected, atol=1e-9)


def link6(arm: Arm, q: np.ndarray) -> np.ndarray:
    """Pose of the last link, shape (4, 4)."""
    data = mujoco.MjData(arm.model)
    data.qpos[:] = q
    mujoco.mj_kinematics(arm.model, data)
    body = data.body("link6")
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = body.xmat.reshape(3, 3), body.xpos
    return pose


def test_balancing_device() -> None:
    """The spring turns axis 2 with -F D r sin(q2) / L, F = 20 kN + 60 kN/m (L - 0.470 m)."""
    arm = Arm(load_robot("irb6700"))
    data = mujoco.MjData(arm.model)
    pivot, rod = np.hypot(0.349 + 0.320, 0.142), 0.214
    peak = 0.0
    for q2 in np.radians(np.linspace(-65, 85, 31)):
        data.qpos[1] = q2
        mujoco.mj_forward(arm.model, data)
        length = np.sqrt(pivot**2 + rod**2 - 2 * pivot * rod * np.cos(q2))
        force = 20e3 + 60e3 * (length - 0.470)
        expected = -force * pivot * rod * np.sin(q2) / length
        # the sites are given to a hundredth of a millimetre, the formula's lengths to a millimetre
        assert data.qfrc_spring[1] == pytest.approx(expected, rel=0.005, abs=5.0)
        peak = max(peak, abs(data.qfrc_spring[1]))
    assert 6.9e3 < peak < 7.1e3

"""The simulator of the laboratories against closed forms, MuJoCo and the sealed one; its cases."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from laboratories.arm import body_arrays, forward, inverse, workspace
from laboratories.draw import ADDED, BASE, LEVELS, draw_cases, draw_laboratory
from laboratories.effects import CATALOGUE, UNLISTED, Effect, apply, axes_of, unit
from laboratories.files import read_truth, write_truth
from laboratories.make import Session, make_laboratory, record, set_up, without_friction
from laboratories.mjcf import Machine
from laboratories.motions import MOTIONS, draw_motion
from laboratories.noise import KINDS, draw_noise
from laboratories.oracle import Oracle
from laboratories.plant import DENSE, GRID, STEP, integrate, whole
from laboratories.robots import (
    ROBOTS,
    STILL,
    Plant,
    machine_of,
    nominal,
    robot_file,
    rotor_motion,
    sampled,
    set_points,
    simulate,
)
from laboratories.servo import SERVOS, with_servo
from sealed.motions import protocol
from sealed.physics import LEAD, SAMPLE_PERIOD, nominal_physics
from sealed.physics import set_points as sealed_points
from sealed.physics import simulate as sealed_simulate

from faultgen.discovery import check_recording, read_recording
from faultgen.robot import load_robot
from faultgen.simulation.arm import Arm

pytestmark = pytest.mark.slow  # its simulator has to be compiled

MASS, LENGTH, GRAVITY = 2.0, 0.5, 9.81


def pendulum(**values: float) -> Plant:
    """A point mass on a rod, a rotor and a gearbox, without friction unless it is given."""
    one = {field.name: np.zeros(1) for field in fields(Machine)}
    machine = Machine(
        **{
            **one,
            "kind": np.zeros(1, int),
            "turn": np.eye(3)[None],
            "place": np.zeros((1, 3)),
            "axis": np.array([[0.0, 1.0, 0.0]]),
            "mass": np.array([MASS]),
            "com": np.array([[0.0, 0.0, -LENGTH]]),
            "inertia": np.zeros((1, 3, 3)),
            "payload": np.zeros(13),
            "payload_turn": np.eye(3),
            "spring": np.zeros((0, 10)),
            "gravity": np.array([0.0, 0.0, -GRAVITY]),
            "ratio": np.array([50.0]),
            "rotor": np.array([1e-4]),
            "stiffness": np.array([5e3]),
            "stribeck": np.array([5.0]),
            "limit": np.array([2.0]),
            "speed_limit": np.array([300.0]),
            "bristle": np.array([10.0]),
        }
    )
    return nominal(machine).with_columns(**values)


def free(plant: Plant, seconds: float, angle: float = 0.0, speed: float = 0.0) -> np.ndarray:
    """A run without servo from a joint angle and a motor speed, every 0.5 ms."""
    ratio = plant.column("RATIO")
    state = np.array([[angle], [speed / ratio[0]], [angle * ratio[0]], [speed]])
    table = np.zeros((round(seconds / GRID) + 1, 3, 1))
    slow = np.tile(STILL, (1, 1))
    run: np.ndarray = integrate(
        body_arrays(plant.machine), plant.table, table, slow, state, STEP, 0.0, False, np.zeros(1)
    )
    return run[:, 0]


@pytest.mark.parametrize("name", ROBOTS)
def test_arm_is_mujocos(name: str) -> None:
    """Torque and acceleration of the own reading of the file agree with MuJoCo to rounding."""
    robot, machine = load_robot(str(robot_file(name))), machine_of(name)
    rng = np.random.default_rng(0)
    q = rng.uniform(machine.low, machine.high, (30, machine.n_axes))
    qd, qdd = rng.normal(size=(2, 30, machine.n_axes))
    body = body_arrays(machine)
    torque = inverse(body, q, qd, qdd)
    theirs = Arm(robot).inverse_dynamics(q, qd, qdd)
    assert np.allclose(torque, theirs, rtol=0, atol=1e-11 * np.abs(theirs).max())
    found, work = np.zeros(machine.n_axes), workspace(machine.n_axes)
    for k in range(len(q)):
        forward(body, q[k], qd[k], torque[k].copy(), found, work)
        assert np.allclose(found, qdd[k], rtol=0, atol=1e-9)


def test_pendulum_keeps_its_energy() -> None:
    """Without friction, the energy of arm, rotor and gearbox stays; the small period is right."""
    plant = pendulum()
    run = free(plant, 5.0, angle=1.0)
    q, th, w = run[:, 4], run[:, 0], run[:, 1]
    qd = np.gradient(q, DENSE)
    twist = th / 50 - q
    energy = (
        0.5 * MASS * LENGTH**2 * qd**2
        + 0.5 * 1e-4 * w**2
        + 0.5 * 5e3 * twist**2
        - MASS * GRAVITY * LENGTH * np.cos(q)
    )
    kinetic = (0.5 * MASS * LENGTH**2 * qd**2).max()
    assert np.ptp(energy[5:-5]) < 1e-4 * kinetic
    run = free(plant, 5.0, angle=0.01)
    crossings = np.flatnonzero(np.diff(np.sign(run[:, 4])) < 0) * DENSE
    inertia = MASS * LENGTH**2 + 50**2 * 1e-4
    period = 2 * np.pi * np.sqrt(inertia / (MASS * GRAVITY * LENGTH))
    assert np.diff(crossings).mean() == pytest.approx(period, rel=2e-3)


def test_rotor_slows_down_as_it_should() -> None:
    """Alone, a rotor loses speed exponentially by viscous and linearly by Coulomb friction."""
    alone = {"STIFF": 0.0, "DAMP": 0.0}
    run = free(pendulum(VISCOUS=4e-4, **alone), 0.5, speed=100.0)
    times = np.arange(len(run)) * DENSE
    assert np.allclose(run[:, 1], 100 * np.exp(-4 * times), rtol=1e-5)
    run = free(pendulum(COULOMB=0.05, REST=50.0, **alone), 0.5, speed=100.0)
    moving = (times > 0.01) & (times < 0.19)
    slope = np.polyfit(times[moving], run[moving, 1], 1)[0]
    assert slope == pytest.approx(-0.05 / 1e-4, rel=1e-4)
    # it stops after J w / F = 0.2 s, but for the swing of the bristle
    assert np.abs(run[times > 0.4, 1]).max() < 2.0


def test_friction_holds_up_to_its_static_level() -> None:
    """A torque below Coulomb friction and rise does not turn the rotor, one above does."""
    held = {"STIFF": 0.0, "COULOMB": 0.05, "RISE": 0.02, "SPEED": 5.0, "REST": 20.0}
    # viscous friction keeps the rotor from swinging over
    below = free(pendulum(OFFSET=0.95 * 0.07, VISCOUS=0.1, **held), 5.0)
    above = free(pendulum(OFFSET=1.05 * 0.07, VISCOUS=0.1, **held), 5.0)
    # below, the bristle gives by -F ln(1 - share) / stiffness and stays there
    assert below[-1, 0] == pytest.approx(0.07 * np.log(20) / 20, rel=0.05)
    assert above[-1, 0] > 0.1


@pytest.mark.slow
def test_agrees_with_the_sealed_simulator() -> None:
    """The same healthy PUMA on the same motion: motor torques differ by less than 0.1 %."""
    physics = nominal_physics(load_robot("puma560"))
    table = physics.table.copy()
    plant, _ = with_servo(nominal(machine_of("puma560")), "model", 0.0, STEP)
    # without a rise at low speed, both friction laws are Dahl's
    for axis in range(6):
        level = float(plant.column("COULOMB")[axis])
        physics = physics.changed(axis + 1, FS=level, S1=0.0)
    assert not np.array_equal(physics.table, table)
    plant = plant.with_columns(RISE=0.0)
    for motion in protocol("puma560")[:3]:
        points = sealed_points(physics, motion)
        theirs = sealed_simulate(physics, points, lead=LEAD)[:, :, 2]
        own = simulate(plant, np.ascontiguousarray(points[::2]))
        times = np.arange(len(theirs)) * SAMPLE_PERIOD
        torque = sampled(own, times)[:, :, 2]
        error = np.sqrt(((torque - theirs) ** 2).mean(axis=0) / (theirs**2).mean(axis=0))
        assert (error < 1e-3).all(), error


@pytest.mark.parametrize("robot", ["scara4", "lift1"])
def test_oracle_sees_the_recorded_motion(robot: str) -> None:
    """The oracle's torque of the robot is the recorded one but for noise, on every axis."""
    lab = draw_laboratory("development", 1)
    changes = {"robot": robot, "seconds": 5.0, "segments": 2, "level": 0.002, "rate": 250}
    lab = replace(lab, factors=BASE | changes)
    setup = set_up(lab)
    oracle = Oracle(
        setup.ideal, setup.robot, setup.points[:2], setup.noise, setup.period, setup.lab
    )
    n = lab.machine.n_axes
    day = Session(np.ones(n), np.full(len(setup.motions), 40.0), np.ones(len(setup.motions)))
    arrays, _ = record(setup, [], day, range(2), np.random.default_rng(0))
    seen = np.concatenate([torque for torque, _ in oracle.healthy])
    assert seen.shape == arrays["motor_torque"].shape
    for axis in range(n):
        assert np.corrcoef(seen[:, axis], arrays["motor_torque"][:, axis])[0, 1] > 0.999


def test_steps_must_divide() -> None:
    """A step that does not divide the time between rows, or a servo's period, is refused."""
    assert whole(DENSE, STEP) == 4
    assert all(whole(period, STEP) for period in LEVELS["servo_period"])
    for time, part in ((DENSE, 2e-4), (0.25e-3, 1e-4), (1e-4, STEP)):
        with pytest.raises(ValueError, match="does not divide"):
            whole(time, part)
    plant, points, _ = healthy_puma()
    with pytest.raises(ValueError, match="0.0002 s does not divide 0.0005 s"):
        simulate(plant, points, step=2e-4)


def test_prescribed_rotors_need_the_same_torque() -> None:
    """On its own motion a robot needs its own torque; friction adds itself, a delay nothing."""
    plant, points, healthy = healthy_puma()
    machine, follow = machine_of("puma560"), rotor_motion(plant, points)
    same = simulate(plant, points, follow=follow)
    assert np.allclose(same, healthy, rtol=0, atol=1e-8 * np.abs(healthy).max(axis=(0, 1)))
    late = simulate(apply(Effect("delay", 2, 2e-3), plant, machine), points, follow=follow)
    assert np.array_equal(late, same)
    moved = simulate(plant.changed(2, OFFSET=1.25), points, follow=follow)
    change = moved[:, :, 2] - same[:, :, 2]
    expected = float(plant.column("OFFSET")[1]) - 1.25
    assert np.allclose(change[:, 1], expected, atol=1e-9)
    assert np.abs(change[:, [0, 2, 3, 4, 5]]).max() < 1e-9


@pytest.mark.parametrize("kind", MOTIONS)
def test_motions_keep_the_limits(kind: str) -> None:
    """A motion keeps the limits of the model, is at rest at both ends, and moves all axes."""
    for name in ROBOTS:
        machine = machine_of(name)
        motion = draw_motion(kind, machine, 4.0, np.random.default_rng(3))
        assert motion.seconds == pytest.approx(4.0)
        assert (motion.q > machine.low).all() and (motion.q < machine.high).all()
        assert (np.abs(motion.qd * machine.ratio) <= machine.speed_limit).all()
        assert (np.abs(motion.qdd) <= 1.001 * machine.acceleration_limit).all()
        assert (np.abs(motion.qd[[0, -1]]) < 1e-9).all()
        assert (np.ptp(motion.q * machine.ratio, axis=0) > 0.5).all()
        # velocity is the derivative of the angle
        assert np.allclose(np.gradient(motion.q, GRID, axis=0)[2:-2], motion.qd[2:-2], atol=2e-3)


@pytest.mark.parametrize("kind", SERVOS)
def test_servos_follow(kind: str) -> None:
    """Every servo follows a motion; those with feed-forward closely, and none saturates."""
    machine = machine_of("scara4")
    plant, bandwidth = with_servo(nominal(machine), kind, 8.0, 1e-3)
    motion = draw_motion("multisine", machine, 4.0, np.random.default_rng(1))
    points = set_points(machine, motion.q, motion.qd, motion.qdd)
    run = simulate(plant, points)
    error = np.abs(run[::2, :, 0] - points[:, 0]).max(axis=0)
    assert (
        error < (0.05 if kind.endswith(("ff", "model")) else 0.5) * machine.speed_limit / 8
    ).all()
    assert (np.abs(run[:, :, 2]) < machine.limit).all()
    assert 0 < bandwidth <= 8.0


@cache
def healthy_puma() -> tuple[Plant, np.ndarray, np.ndarray]:
    """The nominal PUMA with the model's servo, set points of a short motion, and its run."""
    machine = machine_of("puma560")
    plant, _ = with_servo(nominal(machine), "model", 0.0, 1e-3)
    motion = draw_motion("task", machine, 2.5, np.random.default_rng(2))
    points = set_points(machine, motion.q, motion.qd, motion.qdd)
    return plant, points, simulate(plant, points)


@pytest.mark.parametrize("name", [*CATALOGUE, *UNLISTED])
def test_effects_change_their_axis(name: str) -> None:
    """Severity 0 is the healthy run, bit for bit; a severity changes the torque of its axis."""
    plant, points, healthy = healthy_puma()
    machine = machine_of("puma560")
    axis = 2 if 2 in axes_of(name, 6) else 6
    if name in ("temperature_friction", "torque_lowpass", "speed_clipping"):
        return  # the first two act outside the robot; the third has a limit at any severity
    none = apply(Effect(name, axis, 0.0), plant, machine)
    assert np.array_equal(simulate(none, points), healthy)
    severity = unit(name, axis, machine)
    changed = simulate(apply(Effect(name, axis, severity), plant, machine), points)
    change = np.sqrt(((changed - healthy)[:, :, 2] ** 2).mean(axis=0)) / machine.limit
    assert change[axis - 1] > 1e-5
    if not name.startswith("payload"):
        assert change[axis - 1] > 0.5 * change.max()


@pytest.mark.parametrize("kind", KINDS)
def test_noise_is_what_the_filter_assumes(kind: str) -> None:
    """Noise of every kind, rounding included, has variance 1 after the filter of the oracle."""
    rng = np.random.default_rng(5)
    times = np.arange(40_000) * 0.004
    torque = np.stack([np.sin(times), 3 * np.cos(0.7 * times)], axis=1)
    speed = 50 * np.gradient(torque, 0.004, axis=0)
    noise = draw_noise(
        kind,
        0.01,
        torque,
        speed,
        n_motions=3,
        sample_period=0.004,
        limit=np.array([5.0, 5.0]),
        rng=rng,
    )
    scale = noise.scale(torque, speed, 1)
    seen = noise.logged(torque + noise.sample(scale, rng)) - torque
    white = noise.whitened(seen, scale)
    # the median leaves the outliers out
    spread = np.median(np.abs(white), axis=0) / 0.6745
    assert np.allclose(spread, 1, atol=0.1), spread
    assert (noise.by_motion.max() / noise.by_motion.min() > 2) == (kind == "by_motion")


def test_plan_is_balanced_and_repeatable() -> None:
    """A quarter of the cases is healthy, an eighth unlisted, and every factor is stressed."""
    labs = [draw_laboratory("development", k) for k in range(48)]
    assert labs == [draw_laboratory("development", k) for k in range(48)]
    assert labs[:5] != [draw_laboratory("report", k) for k in range(5)]
    plans = [plan for lab in labs for plan in draw_cases(lab)]
    kinds = [plan.kind for plan in plans]
    assert kinds.count("healthy") == len(plans) / 4
    assert kinds.count("unlisted") == len(plans) / 8
    assert {plan.effect for plan in plans if plan.kind == "single"} == set(CATALOGUE)
    assert {name for lab in labs for name in lab.stressed} == {*BASE, "all"} - {*ADDED}
    newer = [draw_laboratory("report2", k) for k in range(48)]
    assert {name for lab in newer for name in lab.stressed} == {*BASE, "all"}
    forced = draw_laboratory("development", 3, {"noise": "by_motion"})
    assert forced.factors["noise"] == "by_motion"
    assert all(lab.factors[name] in LEVELS[name] for lab in labs for name in ("robot", "servo"))


def test_a_laboratory_becomes_files(tmp_path: Path) -> None:
    """The files of a slide are read and checked by faultgen; severities are at their multiple."""
    lab = draw_laboratory("development", 5, {"model_friction": "given"})
    assert lab.factors["robot"] == "lift1"
    lab = replace(lab, factors=lab.factors | {"seconds": 5.0, "segments": 2})
    entries = make_laboratory(lab, tmp_path)
    write_truth(entries, tmp_path / "truth" / "lab005.json")
    assert read_truth(tmp_path) == {e["name"]: json.loads(json.dumps(e)) for e in entries}
    assert {e["mode"] for e in entries} == {"twin", "alone"}
    for folder in {e["folder"] for e in entries}:
        own = tmp_path / "cases" / folder
        told = json.loads((own / "case.json").read_text())
        assert set(told) == {"robot", "mode"}
        robot = load_robot(str(own / told["robot"]))
        for name in ("measured", "healthy", "validate"):
            recording = read_recording(own / f"{name}.h5")
            assert not [f for f in check_recording(recording, robot) if f.level == "refuse"]
    for plan in draw_cases(lab):
        if plan.multiple is not None:
            (entry,) = (
                e for e in entries if e["folder"] == plan.name and e["mode"] == plan.limit_of
            )
            assert entry["d_prime"] == pytest.approx(4 * plan.multiple, rel=0.3)


def test_a_model_can_lack_friction(tmp_path: Path) -> None:
    """The file without friction is a complete robot with a hundredth of the friction."""
    path = tmp_path / "puma560.xml"
    path.write_text(without_friction(robot_file("puma560").read_text()))
    plant = load_robot(str(path))
    assert plant.n_axes == 6
    from laboratories.mjcf import read_machine

    assert np.allclose(read_machine(path).coulomb, 0.01 * machine_of("puma560").coulomb)
    assert np.allclose(read_machine(path).viscous, 0.01 * machine_of("puma560").viscous)

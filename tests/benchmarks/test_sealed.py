"""The sealed simulator against MuJoCo and another integration, and the cases made with it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from independent import from_busy_move, integrate
from replayed import replay
from sealed.cases import make_case, make_recordings, read_truth, write_truth
from sealed.effects import CATALOGUE, Effect, apply_effect, context, unchanging
from sealed.limits import combos, torque_of, typical_temperatures
from sealed.motions import KINDS, protocol
from sealed.physics import GRID, SAMPLE_PERIOD, Reference, nominal_physics, set_points, simulate
from sealed.plan import COUNTS, MULTIPLES, ROBOTS, Case, plan_cases, sample
from sealed.rigid import body_arrays, inverse_dynamics
from sealed.robots import baseline, random_robot
from sealed.unlisted import UNLISTED

from faultgen.discovery import check_recording, read_recording
from faultgen.effects import EFFECTS
from faultgen.recordings.recording import Recording
from faultgen.robot import load_robot
from faultgen.simulation.arm import Arm
from faultgen.simulation.motion import plan
from faultgen.simulation.servo import control_signal
from faultgen.simulation.stepping import simulate as simulate_mujoco
from faultgen.tasks import load_task

SECONDS = 2.5


def relative(error: np.ndarray, signal: np.ndarray) -> np.ndarray:
    """RMS of an error over the RMS of a signal, by axis, shape (n_axes,)."""
    return np.sqrt((error**2).mean(axis=0) / (signal**2).mean(axis=0))


@pytest.mark.parametrize("name", ROBOTS)
def test_rigid_torque_is_mujocos(name: str) -> None:
    """Inverse dynamics agrees with MuJoCo's to rounding, balancing device included."""
    robot = load_robot(name)
    rng = np.random.default_rng(0)
    q = rng.uniform(*robot.joint_range.T, (50, robot.n_axes))
    qd, qdd = rng.normal(size=(2, 50, robot.n_axes))
    own = inverse_dynamics(body_arrays(nominal_physics(robot).chain), q, qd, qdd)
    assert np.allclose(own, Arm(robot).inverse_dynamics(q, qd, qdd), rtol=0, atol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("name", ROBOTS)
def test_trajectory_agrees(name: str) -> None:
    """Motor torque: 0.05 % of an adaptive integration, 0.3 % of the MuJoCo simulation."""
    robot = load_robot(name)
    motion = from_busy_move(plan(load_task(name, "pick_and_place"), robot), SECONDS)
    reference = Reference(*motion(np.arange(0, SECONDS, GRID)))
    nominal = nominal_physics(robot)
    own = simulate(nominal, set_points(nominal, reference), lead=0)[:, :, 2]
    times = np.arange(len(own)) * SAMPLE_PERIOD
    truth = integrate(motion, robot.model, times, start=-1e-9).motor_torque
    assert (relative(own - truth, truth) < 5e-4).all()
    control = control_signal(motion, robot.model.opt.timestep)
    run = next(
        simulate_mujoco(
            robot,
            control,
            [robot.model],
            sample_period=SAMPLE_PERIOD,
            lead_in=robot.model.opt.timestep,
        )
    )
    assert (relative(own - run.motor_torque[: len(own)], truth) < 3e-3).all()


@pytest.mark.parametrize("name", ROBOTS)
def test_protocol_is_within_limits(name: str) -> None:
    """All axes turn their motors several times, within speed and position limits, from rest."""
    robot = load_robot(name)
    for kind, motion in zip(KINDS, protocol(name), strict=True):
        assert 0.75 < len(motion.q) * GRID / 3.5 < 1.25
        assert (np.abs(motion.qd[[0, -1]]) < 1e-6).all()
        assert (motion.q > robot.joint_range[:, 0]).all()
        assert (motion.q < robot.joint_range[:, 1]).all()
        speed = np.abs(motion.qd * robot.gear_ratio)
        assert (speed <= 1.001 * robot.motor_velocity_limit).all()
        turns = np.ptp(motion.q, axis=0) * np.abs(robot.gear_ratio) / (2 * np.pi)
        assert (turns > (2 if kind == "task" else 4)).all()


@pytest.mark.slow
def test_healthy_robots_are_off() -> None:
    """Every parameter of the baseline but the offset is 1 to 5 % off, the exponent is not 2."""
    nominal = context("puma560").nominal
    robot = random_robot(nominal, np.random.default_rng(5))
    for column in ("FC", "FV", "VS", "J", "K", "D"):
        off = np.abs(robot.column(column) / nominal.column(column) - 1)
        assert ((off >= 0.0099) & (off <= 0.0501)).all(), column
    assert (np.abs(robot.column("EXPONENT") - 2) > 0.09).all()
    assert len(set(baseline(nominal))) == len(baseline(nominal))
    again = random_robot(nominal, np.random.default_rng(5))
    assert np.array_equal(robot.table, again.table)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in CATALOGUE if name in EFFECTS])
def test_effects_leave_other_axes_alone(name: str) -> None:
    """An effect changes its own axis' row only, or what changes with time, or the payload."""
    where = context("irb6700")
    slow = unchanging(where)
    effect = Effect(name, 6, 0.01, {"order": 2.0})
    worn, worn_slow = apply_effect(effect, where.nominal, where, slow, typical_temperatures(where))
    assert np.array_equal(worn.table[:5], where.nominal.table[:5])
    changed = [
        not np.array_equal(worn.table, where.nominal.table),
        any((a != b).any() for a, b in zip(slow, worn_slow, strict=True)),
        not np.array_equal(worn.chain.com, where.nominal.chain.com),
        not np.array_equal(worn.chain.mass, where.nominal.chain.mass),
    ]
    assert sum(changed) == 1


class _Fake:
    """Limits that are all the same."""

    def limit(self, *args: object, **kwargs: object) -> float:
        return 1e-3

    def largest(self, name: str, axis: int) -> float:
        return 1.0


LIMITS = {robot: _Fake() for robot in ROBOTS}


def test_plan_is_balanced() -> None:
    """Counts by kind; effects, severities and robots alike; development and report differ."""
    cases = plan_cases("development", "twin", LIMITS)
    assert {kind: sum(c.kind == kind for c in cases) for kind in COUNTS} == COUNTS
    singles = [c for c in cases if c.kind == "single"]
    for multiple in MULTIPLES:
        assert abs(sum(c.multiples == (multiple,) for c in singles) - 60) <= 2
    names = [c.effects[0].name for c in singles]
    assert {names.count(name) for name in CATALOGUE} <= {10, 11}
    assert all(c.exclude for c in cases if c.kind == "unknown")
    assert not any(c.exclude for c in cases if c.kind != "unknown")
    assert len({c.name for c in cases}) == len({c.seed for c in cases}) == len(cases)
    other = plan_cases("report", "twin", LIMITS)
    assert not {c.seed for c in cases} & {c.seed for c in other}
    assert plan_cases("development", "twin", LIMITS) == cases
    few = sample(4, "development", "twin", LIMITS)
    assert sorted(c.kind for c in few) == ["clean", "pair", "single", "unknown"]


def test_every_combination_can_be_drawn() -> None:
    """Payload effects belong to the last axis, coupling to the wrist."""
    drawn = combos(6)
    assert {name for name, _, _ in drawn} == {*CATALOGUE, *UNLISTED}
    assert {axis for name, axis, _ in drawn if name == "payload_mass"} == {6}
    assert {axis for name, axis, _ in drawn if name == "wrist_coupling_friction"} == {5, 6}


def oracle(
    measured: Path,
    robot: str,
    healthy: Path | None = None,
    validate: Path | None = None,
    *,
    exclude: tuple[str, ...] = (),
    cache: Path | None = None,
) -> dict:
    """A stand-in for discovery that knows the truth of clean and unknown cases only."""
    if measured.parent.name.endswith("bad"):
        raise RuntimeError("no")
    verdict = "unknown effect" if exclude else "no missing effect"
    return {"verdict": verdict, "effects": [], "alternatives": []}


@pytest.mark.slow
def test_files_carry_no_label(tmp_path: Path) -> None:
    """A case is read and checked like any recording."""
    effect = Effect("coulomb_friction", 2, 0.3)
    case = Case("case_a", "twin", "puma560", "single", 0.01, 3, (effect,), (5.0,))
    folder = make_case(case, tmp_path / "cases")
    told = (folder / "case.json").read_text()
    assert "coulomb" not in told and set(json.loads(told)) == {"robot", "mode", "exclude"}
    recordings = [read_recording(folder / name) for name in ("measured.h5", "healthy.h5")]
    for recording in recordings:
        assert len(recording.parts) == 6
        assert check_recording(recording, load_robot("puma560")) == []
    gap = np.abs(recordings[0].torque - recordings[1].torque).mean(axis=0)
    assert np.argmax(gap / np.abs(recordings[1].torque).mean(axis=0)) == 1


def test_truth_is_sealed(tmp_path: Path) -> None:
    """A truth that was changed after its digest was taken is refused."""
    cases = sample(8, "development", "alone", LIMITS)
    digest = write_truth(cases, tmp_path)
    assert (tmp_path / "truth.sha256").read_text().strip() == digest
    assert set(read_truth(tmp_path)) == {case.name for case in cases}
    (tmp_path / "truth.json").write_text("[]\n")
    with pytest.raises(ValueError, match="SHA-256"):
        read_truth(tmp_path)


ALIKE = {
    "coulomb_friction": 0.1,
    "friction_wear": 0.1,
    "viscous_friction": 0.3,
    "backlash": 3e-4,
    "gear_stiffness": 0.2,
    "rotor_inertia": 0.1,
    "payload_mass": 0.05,
    "torque_offset": 0.05,
}


@pytest.mark.slow
@pytest.mark.parametrize("name", ALIKE)
def test_forms_mean_what_the_catalogue_means(name: str) -> None:
    """The change of torque is like the catalogue's in MuJoCo, and of the same size."""
    robot, where = load_robot("irb6700"), context("irb6700")
    axis = 6 if name == "payload_mass" else 2
    severity = ALIKE[name]
    temperatures = typical_temperatures(where)
    effects = [Effect(name, axis, severity)]
    seen = [
        np.concatenate(torque_of(e, where.nominal, where, temperatures, step=2e-4)[1])
        for e in ([], effects)
    ]
    recording, _ = make_recordings(Case("x", "alone", "irb6700", "clean", 0.005, 1))
    assert isinstance(recording, Recording)
    theirs = [  # in both, a servo follows the commands
        replay(recording, robot, e, measured=False) for e in ([], [(name, axis, severity)])
    ]
    own, other = seen[1] - seen[0], theirs[1] - theirs[0]
    cosine = float(np.sum(own * other) / np.linalg.norm(own) / np.linalg.norm(other))
    assert cosine > 0.8
    assert 0.75 < np.linalg.norm(own) / np.linalg.norm(other) < 1.33

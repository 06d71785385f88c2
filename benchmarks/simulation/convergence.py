"""How accurate and how costly MuJoCo's integrators are on the robots; prints Markdown.

Errors are of the logged motor torque: RMS of the error over RMS of the torque, by axis.

    python -m benchmarks.simulation.convergence > tables.md
    python -m benchmarks.simulation.convergence --quick
"""

from __future__ import annotations

import copy
import itertools
import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache

import mujoco
import numpy as np
from independent import from_busy_move, integrate
from mujoco.batch import Batch
from scipy.interpolate import CubicSpline

from faultgen.robot import COULOMB, STICTION, Robot, load_robot, robot_names
from faultgen.simulation.arm import Arm
from faultgen.simulation.motion import Motion, plan
from faultgen.simulation.servo import control_signal, motor_torque
from faultgen.simulation.stepping import Cycle, simulate
from faultgen.tasks import load_task, task_names

INTEGRATORS = {
    "Euler": mujoco.mjtIntegrator.mjINT_EULER,
    "implicitfast": mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
    "discrete": mujoco.mjtIntegrator.mjINT_DISCRETE,
    "RK4": mujoco.mjtIntegrator.mjINT_RK4,
}
STEPS = (2e-3, 1e-3, 5e-4, 2.5e-4)
FINE = 2.5e-5  # 20 times smaller than the models' step
SAMPLE = 2e-3  # at which errors are taken [s]
FIRST = 0.02  # time of the first sample [s]
STRETCH = 2.5  # of a cycle that is also integrated independently [s]
SHIFTS = (-0.5, 0.0, 0.5, 1.0)
LOGS = ("recorded", "velocity after", "state after", "from state")


@dataclass(frozen=True)
class Alignment:
    """When set points are taken, and what is logged for which time; in steps after the step."""

    position: float = 0.0
    velocity: float = -0.5
    torque: float = 0.0
    log: str = "recorded"
    log_time: float = 0.0

    def __str__(self) -> str:
        shifts = f"{self.position:+g} / {self.velocity:+g} / {self.torque:+g}"
        return f"{shifts}; {self.log}, {self.log_time:+g}"


CHOSEN = Alignment()
"""What `faultgen.simulation.servo` and `faultgen.simulation.stepping` do."""


@dataclass(frozen=True)
class Log:
    """Logged motor torque by kind of log, each of shape (samples, n_axes), in [N m]."""

    times: np.ndarray
    torque: dict[str, np.ndarray]
    step_cost: float
    """Processor time of a step [s]."""


@lru_cache(maxsize=2)
def _motion(robot: str) -> Motion:
    """A cycle of pick_and_place from a move of all axes on; it begins at rest."""
    return from_busy_move(plan(load_task(robot, "pick_and_place"), load_robot(robot)), STRETCH)


@lru_cache(maxsize=8)
def _setpoints(
    robot: str, timestep: float, shift: float, seconds: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position, velocity and torque of every step, shifted; shape (steps, n_axes), motor side."""
    motion = _motion(robot)
    times = (np.arange(round(seconds / timestep)) + shift) * timestep
    q, qd, qdd = motion(times)
    ratio = motion.robot.gear_ratio
    return q * ratio, qd * ratio, motor_torque(Arm(motion.robot), q, qd, qdd)


def run(
    motion: Motion,
    model: mujoco.MjModel,
    integrator: str,
    timestep: float,
    alignment: Alignment,
    *,
    seconds: float,
    sample: float = SAMPLE,
) -> Log | None:
    """Simulate a motion from rest.

    Args:
        motion: The motion.
        model: The model, whose options are changed.
        integrator: Name of the integrator.
        timestep: Time step [s].
        alignment: How the control is aligned with the steps.
        seconds: Simulated time [s].
        sample: Time between samples [s].

    Returns:
        The log, or None if the simulation diverges.
    """
    robot = motion.robot
    model = copy.copy(model)
    model.opt.timestep = timestep
    model.opt.integrator = INTEGRATORS[integrator]
    at = model.actuator_ctrladr[robot.ids("actuator", "drive")]
    control = np.zeros((round(seconds / timestep), model.nu))
    shifts = alignment.position, alignment.velocity, alignment.torque
    for i, shift in enumerate(shifts):
        control[:, at + i] = _setpoints(robot.name, timestep, shift, seconds)[i]

    batch = Batch(model, 1, 1)
    q = motion(np.zeros(1))[0]
    load = Arm(robot).inverse_dynamics(q, 0 * q, 0 * q)[0]
    stiffness = model.tendon_stiffness[robot.ids("tendon", "gearbox")]
    joints, motors = list(robot.joints), list(robot.motors)
    batch.qpos[0, motors] = q[0] * robot.gear_ratio
    batch.qpos[0, joints] = q[0] - load / stiffness

    every = max(1, round(sample / timestep))
    first = round(FIRST / timestep)
    chunk = max(1, 4000 // every) * every
    rows, spent = [], 0.0
    drive = model.actuator_outadr[robot.ids("actuator", "drive")]
    for start in range(0, len(control), chunk):
        part = control[None, start : start + chunk]
        before = batch.qpos[:, motors].copy(), batch.qvel[:, motors].copy()
        clock = time.process_time()
        out = batch.rollout(part.shape[1], part, record=("qpos", "qvel", "actuator_force"))
        spent += time.process_time() - clock
        if batch.warning[0, :, 1].any():
            return None
        position = np.concatenate([before[0], out["qpos"][0][:, motors]])
        velocity = np.concatenate([before[1], out["qvel"][0][:, motors]])
        keep = np.arange((first - start) % every, part.shape[1], every)
        force = out["actuator_force"][0][:, drive]
        state = position[keep], velocity[keep], position[keep + 1], velocity[keep + 1]
        rows.append((start + keep, force[keep], *state))
    steps, force, q0, w0, q1, w1 = (np.concatenate(values) for values in zip(*rows, strict=True))
    cycle = steps >= first
    steps, force, q0, w0, q1, w1 = (v[cycle] for v in (steps, force, q0, w0, q1, w1))
    gains = model.actuator_gainprm[robot.ids("actuator", "drive")]

    def servo(setpoint: tuple[np.ndarray, ...], q: np.ndarray, w: np.ndarray) -> np.ndarray:
        torque = gains[:, 4] * (setpoint[0] - q) + gains[:, 6] * (setpoint[1] - w) + setpoint[2]
        return np.clip(torque, -robot.motor_torque_limit, robot.motor_torque_limit)

    given = tuple(control[steps][:, at + i] for i in range(3))
    unshifted = _setpoints(robot.name, timestep, 0.0, seconds)
    exact = tuple(values[steps] for values in unshifted)
    torque = {
        "recorded": force,
        "velocity after": servo(given, q0, w1),
        "state after": servo(given, q1, w1),
        "from state": servo(exact, q0, w0),
    }
    return Log(steps * timestep, torque, spent / len(control))


def error(log: Log, alignment: Alignment, timestep: float, truth: CubicSpline) -> np.ndarray:
    """Compute the relative error of each axis.

    Args:
        log: The log.
        alignment: How the control was aligned with the steps.
        timestep: Time step [s].
        truth: The true torque over time.

    Returns:
        RMS error over RMS torque, shape (n_axes,), without unit.
    """
    return _relative(log.torque[alignment.log], truth(log.times + alignment.log_time * timestep))


def _relative(torque: np.ndarray, truth: np.ndarray) -> np.ndarray:
    return np.sqrt(((torque - truth) ** 2).mean(axis=0) / (truth**2).mean(axis=0))


def _independent(motion: Motion, model: mujoco.MjModel, seconds: float) -> CubicSpline:
    """Motor torque [N m] as a function of time, by the independent integration of the tests."""
    times = np.arange(0, seconds + 0.004, 1.25e-4)
    cycle = integrate(motion, model, times, start=0, tolerance=1e-7)
    return CubicSpline(times, cycle.motor_torque)


def _table(header: str, rows: Iterable[Iterable[object]]) -> None:
    columns = header.split(" | ")
    print(f"| {header} |\n|{'---|' * len(columns)}")
    for row in rows:
        print(f"| {' | '.join(str(cell) for cell in row)} |", flush=True)
    print()


def _percent(value: float) -> str:
    return f"{100 * value:.3g} %"


def _percents(values: np.ndarray) -> str:
    return " / ".join(f"{100 * value:.2f}" for value in values) + " %"


def _best(
    motion: Motion,
    model: mujoco.MjModel,
    integrator: str,
    timestep: float,
    truth: CubicSpline,
    seconds: float,
    quick: bool,
) -> tuple[tuple[float, Alignment], tuple[float, Alignment], float] | None:
    """Least error of the worst axis and its alignment, and cost of a step [s]; None if it diverges.

    First of all alignments, then of those that log the recorded force.
    """
    found, costs = [], []
    shifts = (0.0, 0.5) if quick else SHIFTS
    velocities = (-0.5, 0.0, 0.5) if quick else SHIFTS
    for position, velocity, torque in itertools.product(shifts, velocities, (0.0, 0.5, 1.0)):
        alignment = Alignment(position, velocity, torque)
        log = run(motion, model, integrator, timestep, alignment, seconds=seconds)
        if log is None:
            continue
        costs.append(log.step_cost)
        for kind, log_time in itertools.product(LOGS, SHIFTS):
            alignment = Alignment(position, velocity, torque, kind, log_time)
            worst = float(error(log, alignment, timestep, truth).max())
            found.append((worst, alignment))
    if not found:
        return None
    recorded = [item for item in found if item[1].log == "recorded"]
    best, best_recorded = (min(items, key=lambda item: item[0]) for items in (found, recorded))
    return best, best_recorded, float(np.median(costs))


def alignments(quick: bool) -> dict[tuple[str, str], Alignment]:
    """Best alignment of each integrator against the independent integration."""
    print(f"## Best alignment of each integrator, {STRETCH:g} s of pick_and_place\n")
    print("Against the independent integration; error of the worst axis. Alignment: set points of")
    print("position / velocity / feed-forward, in steps; what is logged, and its time in steps.")
    print("Any log: also the servo's law at the velocity or state after the step, and at the state")
    print("before it with set points of that time.\n")
    chosen: dict[tuple[str, str], Alignment] = {}

    def rows() -> Iterator[Iterable[object]]:
        for name in robot_names():
            motion = _motion(name)
            model = motion.robot.model
            truth = _independent(motion, model, STRETCH)
            for integrator, step in itertools.product(INTEGRATORS, STEPS):
                if quick and step != 5e-4:
                    continue
                best = _best(motion, model, integrator, step, truth, STRETCH, quick)
                case = name, integrator, f"{1000 * step:g} ms"
                if best is None or best[0][0] > 1:
                    yield *case, "diverges", "", "", "", ""
                    continue
                (worst, alignment), (recorded, with_recorded), cost = best
                if step == 5e-4:
                    chosen[name, integrator] = alignment
                errors = _percent(recorded), with_recorded, _percent(worst), alignment
                yield *case, *errors, f"{1e6 * cost:.1f} us"

    _table(
        "robot | integrator | step | recorded torque | alignment | any log | alignment | "
        "cost of a step",
        rows(),
    )
    return chosen


def stagger(quick: bool) -> None:
    """Euler with the velocity set point taken at the step, and half a step before it."""
    print("## Euler: time of the velocity set point\n")
    print("Against the independent integration, error by axis; recorded torque.\n")

    def rows() -> Iterator[Iterable[object]]:
        for name in robot_names():
            motion = _motion(name)
            truth = _independent(motion, motion.robot.model, STRETCH)
            steps = STEPS[2:3] if quick else (*STEPS, FINE)
            for step, shift in itertools.product(steps, (0.0, -0.5)):
                alignment = Alignment(velocity=shift)
                log = run(motion, motion.robot.model, "Euler", step, alignment, seconds=STRETCH)
                at = "at the step" if shift == 0 else "half a step before"
                result = (
                    "diverges" if log is None else _percents(error(log, alignment, step, truth))
                )
                yield name, f"{1000 * step:g} ms", at, result

    _table("robot | step | velocity set point | error by axis", rows())


def bristles(quick: bool) -> None:
    """Where the error of the implicit integrators comes from: the bristles' damping."""
    if quick:
        return
    print("## Bristle damping and the implicit integrators, 0.5 ms\n")
    print("The same with a hundredth of the bristle damping; best alignment, worst axis.\n")

    def rows() -> Iterator[Iterable[object]]:
        for name, share in itertools.product(robot_names(), (1.0, 0.01)):
            motion = _motion(name)
            model = copy.copy(motion.robot.model)
            model.actuator_dynprm[motion.robot.ids("actuator", "friction"), 6] *= share
            truth = _independent(motion, model, STRETCH)
            results = [
                _best(motion, model, integrator, 5e-4, truth, STRETCH, quick)
                for integrator in ("Euler", "implicitfast", "discrete")
            ]
            yield name, share, *("diverges" if r is None else _percent(r[0][0]) for r in results)

    _table("robot | bristle damping | Euler | implicitfast | discrete", rows())


def whole_cycles(chosen: dict[tuple[str, str], Alignment], quick: bool) -> None:
    """Compare each integrator with itself at a step that is 20 times smaller.

    Args:
        chosen: Alignment by robot and integrator.
        quick: Whether to simulate less.
    """
    print("## Whole cycles of pick_and_place against the same integrator at 25 us\n")
    print("With the alignment that was best at 0.5 ms. Speed: simulated seconds per second.\n")

    def rows() -> Iterator[Iterable[object]]:
        for name, integrator in itertools.product(robot_names(), INTEGRATORS):
            motion = _motion(name)
            model = motion.robot.model
            seconds = 2.0 if quick else motion.period
            alignment = CHOSEN if integrator == "Euler" else chosen[name, integrator]
            fine = run(motion, model, integrator, FINE, alignment, seconds=seconds, sample=2.5e-4)
            if fine is None:
                raise RuntimeError(f"{name}, {integrator}: the fine run diverged")
            at = fine.times + alignment.log_time * FINE
            truth = CubicSpline(at, fine.torque[alignment.log])
            for step in STEPS[2:3] if quick else STEPS:
                log = run(motion, model, integrator, step, alignment, seconds=seconds)
                case = name, integrator, f"{1000 * step:g} ms"
                if log is None:
                    yield *case, "diverges", "", "", ""
                    continue
                errors = error(log, alignment, step, truth)
                cost = f"{1e6 * log.step_cost:.1f} us", f"{step / log.step_cost:.0f}"
                yield *case, _percent(errors.max()), _percents(errors), *cost

    _table("robot | integrator | step | worst axis | by axis | cost of a step | speed", rows())


def _public(name: str, task: str, timestep: float) -> tuple[Cycle, float]:
    """A cycle by the public functions at another step, and processor time of a step [s]."""
    nominal = load_robot(name)
    old = f'timestep="{nominal.model.opt.timestep:g}"'
    if nominal.xml.count(old) != 1:
        raise RuntimeError(f"{name}: no {old} in the model")
    robot = Robot(name, nominal.xml.replace(old, f'timestep="{timestep}"'))
    motion = plan(load_task(name, task), robot)
    control = control_signal(motion, timestep)
    clock = time.process_time()
    cycle = next(simulate(robot, control, [robot.model], sample_period=SAMPLE))
    return cycle, (time.process_time() - clock) / (len(control) + 2.0 / timestep)


def all_tasks(quick: bool) -> None:
    """The chosen integrator on every task, by the public functions."""
    print("## Every task, Euler as `faultgen.simulation.stepping` runs it, against 25 us\n")

    def rows() -> Iterator[Iterable[object]]:
        for name in robot_names():
            for task in ["pick_and_place"] if quick else task_names(name):
                fine, _ = _public(name, task, FINE)
                for step in (1e-3, 5e-4):
                    cycle, cost = _public(name, task, step)
                    errors = _relative(cycle.motor_torque, fine.motor_torque)
                    period = f"{len(fine.motor_torque) * SAMPLE:.2f} s"
                    case = name, task, period, f"{1000 * step:g} ms"
                    yield *case, _percent(errors.max()), _percents(errors), f"{1e6 * cost:.1f} us"

    _table("robot | task | cycle | step | worst axis | by axis | cost of a step", rows())


def stability(quick: bool) -> None:
    """Largest step at which Euler is stable, found by bisection."""
    print("## Largest stable step of Euler over a cycle of pick_and_place\n")
    print("Stable: finite, and within 10 % of the torque at 25 us on every axis. The payload's")
    print("mass and inertia are scaled; the controller always reckons with the whole payload.\n")

    def rows() -> Iterator[Iterable[object]]:
        for name in robot_names():
            motion = _motion(name)
            robot = motion.robot
            worn = copy.copy(robot.model)
            friction = robot.ids("actuator", "friction")
            worn.actuator_biasprm[friction, COULOMB] *= 2
            worn.actuator_biasprm[friction, STICTION] *= 2
            yield name, "friction x 2", f"{1000 * _stable_step(motion, worn, quick):.2f} ms"
            for share in (1.0, 0.0) if quick else (1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.0):
                spec = robot.spec()
                payload = spec.body("payload")
                payload.mass *= share
                payload.inertia *= share
                if share == 0:
                    spec.delete(payload)
                step = _stable_step(motion, spec.compile(), quick)
                yield name, f"payload x {share:g}", f"{1000 * step:.2f} ms"

    _table("robot | case | largest stable step", rows())


def _stable_step(motion: Motion, model: mujoco.MjModel, quick: bool) -> float:
    """Largest step [s] at which Euler is stable, to 2 %."""
    seconds = 2.0 if quick else motion.period
    fine = run(motion, model, "Euler", FINE, CHOSEN, seconds=seconds, sample=2.5e-4)
    if fine is None:
        raise RuntimeError(f"{motion.robot.name}: diverged at 25 us")
    truth = CubicSpline(fine.times, fine.torque["recorded"])
    stable, unstable = 5e-5, 8e-3
    while unstable / stable > 1.02:
        step = float(np.sqrt(stable * unstable))
        log = run(motion, model, "Euler", step, CHOSEN, seconds=seconds)
        if log is not None and error(log, CHOSEN, step, truth).max() < 0.1:
            stable = step
        else:
            unstable = step
    return stable


def main() -> None:
    """Print all tables; `--quick` leaves most cases out."""
    quick = "--quick" in sys.argv[1:]
    mujoco.set_mju_user_warning(lambda message: None)  # of runs that diverge on purpose
    chosen = alignments(quick)
    stagger(quick)
    bristles(quick)
    whole_cycles(chosen, quick)
    stability(quick)
    all_tasks(quick)
    _motion.cache_clear()  # Ruckig complains of what is alive at exit


if __name__ == "__main__":
    main()

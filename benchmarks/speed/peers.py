"""What a simulated second costs in the programs that one would write instead of faultgen.

    python -m benchmarks.speed.peers [--save FILE]

All of them move the same robot along the same motion with the same servo, gearbox and LuGre
friction. Their torque is compared with the independent integration of the tests. The cost is the
processor time of one simulated second of a whole cycle, the median of three measurements that are
taken in turn within one process. Each program gets the longest step of a list at which its torque
error is at most 1.02 times that of faultgen.

- faultgen: MuJoCo steps a model that contains servo and friction (`mujoco.batch`).
- mujoco.rollout: the same model, stepped by MuJoCo's other function for many steps.
- Python loop: `mujoco.mj_step` for arm and gearboxes; servo and friction in numpy.
- compiled loop: `mj_step` of the rigid arm, called from code that numba compiles, which also has
  rotors, gearboxes, servo and friction: what somebody would write who needs speed.
- Pinocchio: its articulated-body algorithm for the arm; everything else in numpy. It needs the
  package `pin` (`pip install 'faultgen[peers]'`).
"""

from __future__ import annotations

import argparse
import copy
import ctypes
import functools
import json
import platform
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import mujoco.rollout
import numpy as np
from independent import Drivetrain, from_busy_move, integrate

from faultgen.robot import Robot, load_robot
from faultgen.simulation.arm import Arm
from faultgen.simulation.motion import Motion, plan
from faultgen.simulation.servo import control_signal
from faultgen.simulation.starting import start_on_reference
from faultgen.simulation.stepping import Batch
from faultgen.tasks import load_task

ROBOT, TASK = "puma560", "pick_and_place"
SECONDS, SKIPPED, SAMPLE = 2.5, 0.5, 0.005  # simulated, without error at first, between samples
STEPS = (0.001, 0.0005, 0.00025, 0.000125)
REPEATS = 3

Program = Callable[[np.ndarray, float], np.ndarray]
"""Maps set points, shape (steps, 3, n_axes), and a step [s] to motor torques, (steps, n_axes)."""


class Peers:
    """The programs, for one motion that begins at rest."""

    def __init__(self, motion: Motion) -> None:
        self.motion, self.robot = motion, motion.robot
        self.drive = Drivetrain(motion.robot, motion.robot.model)
        self.position = motion(np.zeros(1))[0][0]
        load = Arm(self.robot).inverse_dynamics(self.position[None], *np.zeros((2, 1, 6)))[0]
        self.wound = self.position - load / self.drive.stiffness

    def setpoints(self, step: float) -> np.ndarray:
        """Position, velocity and feed-forward in each step of a cycle, (steps, 3, n_axes)."""
        control = control_signal(self.motion, step)
        at = self.robot.model.actuator_ctrladr[self.robot.ids("actuator", "drive")]
        return np.stack([control[:, at + k] for k in range(3)], axis=1)

    def _control(self, setpoints: np.ndarray, model: mujoco.MjModel) -> np.ndarray:
        control = np.zeros((len(setpoints), model.nu))
        at = model.actuator_ctrladr[self.robot.ids("actuator", "drive")]
        for k in range(3):
            control[:, at + k] = setpoints[:, k]
        return control

    def _model(self, step: float) -> mujoco.MjModel:
        spec = self.robot.spec()
        spec.option.timestep = step
        return spec.compile()

    def faultgen(self, setpoints: np.ndarray, step: float) -> np.ndarray:
        """The stepping of faultgen."""
        model = self._model(step)
        control = self._control(setpoints, model)
        batch = Batch(model, 1, 1)
        start_on_reference(self.robot, batch, control[0])
        out = batch.rollout(len(control), control[None], record=("actuator_force",))
        return out["actuator_force"][0][:, self.robot.ids("actuator", "drive")]

    def rollout(self, setpoints: np.ndarray, step: float) -> np.ndarray:
        """MuJoCo's rollout; the torque is that of a sensor."""
        spec = self.robot.spec()
        spec.option.timestep = step
        for k in range(self.robot.n_axes):
            spec.add_sensor(
                name=f"log{k + 1}",
                type=mujoco.mjtSensor.mjSENS_ACTUATORFRC,
                objtype=mujoco.mjtObj.mjOBJ_ACTUATOR,
                objname=f"drive{k + 1}",
            )
        model = spec.compile()
        control = self._control(setpoints, model)
        batch = Batch(model, 1, 1)
        start_on_reference(self.robot, batch, control[0])
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = batch.qpos[0], batch.qvel[0]
        state = np.zeros(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
        mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        _, sensors = mujoco.rollout.rollout(model, data, state, control)
        return sensors[0][:, -self.robot.n_axes :]

    def python_loop(self, setpoints: np.ndarray, step: float) -> np.ndarray:
        """One call of MuJoCo for each step; servo and friction in numpy."""
        spec = self.robot.spec()
        spec.option.timestep = step
        for actuator in list(spec.actuators):
            spec.delete(actuator)
        model = spec.compile()
        data = mujoco.MjData(model)
        motors, joints = (np.array(x) for x in (self.robot.motors, self.robot.joints))
        data.qpos[motors], data.qpos[joints] = self.position * self.drive.n, self.wound
        bristle = np.zeros(self.robot.n_axes)
        torque = np.empty((len(setpoints), self.robot.n_axes))
        for k, setpoint in enumerate(setpoints):
            angle, speed = data.qpos[motors], data.qvel[motors]
            torque[k] = self.drive.drive_torque(setpoint, angle, speed)
            data.qfrc_applied[motors] = torque[k] + self._friction(speed, bristle, step)
            mujoco.mj_step(model, data)
        return torque

    def _friction(self, speed: np.ndarray, bristle: np.ndarray, step: float) -> np.ndarray:
        """Friction torque; the bristles move on by a step, exactly for a constant speed."""
        drive = self.drive
        torque = drive.friction_torque(speed, bristle)
        decay = np.exp(-((speed / drive.stribeck_velocity) ** 2))
        level = drive.coulomb + (drive.stiction - drive.coulomb) * decay
        rate = drive.sigma0 * np.abs(speed) / level
        end = np.where(rate > 0, speed / np.where(rate > 0, rate, 1.0), 0.0)
        bristle += (end - bristle) * -np.expm1(-rate * step)
        return torque

    def compiled_loop(self, setpoints: np.ndarray, step: float) -> np.ndarray:
        """MuJoCo's rigid arm and a drivetrain of its own, in one compiled loop."""
        drive, spec = self.drive, Arm(self.robot).model
        model = copy.copy(spec)
        model.opt.timestep = step
        data = mujoco.MjData(model)
        data.qpos[:] = self.wound
        numbers = np.stack(
            [
                drive.n,
                drive.rotor_inertia,
                drive.stiffness,
                drive.damping,
                drive.kp,
                drive.kd,
                drive.limit,
                drive.sigma0,
                drive.sigma1,
                drive.coulomb,
                drive.stiction,
                drive.stribeck_velocity,
                drive.offset,
                drive.viscous,
            ]
        )
        torque = np.empty((len(setpoints), self.robot.n_axes))
        angle = self.position * drive.n
        loop = compiled()
        loop(
            np.ascontiguousarray(setpoints),
            step,
            numbers,
            angle,
            data.qpos,
            data.qvel,
            data.qfrc_applied,
            torque,
            model._address,
            data._address,
        )
        return torque

    def pinocchio(self, setpoints: np.ndarray, step: float) -> np.ndarray:
        """The articulated-body algorithm of Pinocchio; everything else in numpy."""
        import pinocchio

        drive, model = self.drive, pinocchio_arm(self.robot)
        data = model.createData()
        q, qd = self.wound.copy(), np.zeros(self.robot.n_axes)
        angle, speed = self.position * drive.n, np.zeros(self.robot.n_axes)
        bristle = np.zeros(self.robot.n_axes)
        torque = np.empty((len(setpoints), self.robot.n_axes))
        for k, setpoint in enumerate(setpoints):
            torque[k] = drive.drive_torque(setpoint, angle, speed)
            gear = drive.gear_torque(q, qd, angle, speed)
            friction = self._friction(speed, bristle, step)
            qdd = pinocchio.aba(model, data, q, qd, gear)
            speed = speed + step * (torque[k] + friction - gear / drive.n) / drive.rotor_inertia
            qd = qd + step * qdd
            angle, q = angle + step * speed, q + step * qd
        return torque


@functools.cache
def compiled() -> Callable[..., None]:
    """The loop of `Peers.compiled_loop`, compiled by numba; MuJoCo is called as a C library."""
    import numba

    library = next(Path(mujoco.__file__).parent.glob("libmujoco*"))
    mj_step = ctypes.CDLL(str(library)).mj_step
    mj_step.argtypes, mj_step.restype = [ctypes.c_void_p, ctypes.c_void_p], None

    @numba.njit(fastmath=False)
    def loop(  # type: ignore[no-untyped-def]
        setpoints, step, numbers, angle, q, qd, applied, torque, model, data
    ):
        n_axes = len(angle)
        speed, bristle = np.zeros(n_axes), np.zeros(n_axes)
        for k in range(len(setpoints)):
            for i in range(n_axes):
                n, inertia, stiffness, damping, kp, kd, limit = numbers[:7, i]
                sigma0, sigma1, coulomb, stiction, stribeck, offset, viscous = numbers[7:, i]
                w = speed[i]
                asked = kp * (setpoints[k, 0, i] - angle[i]) + kd * (setpoints[k, 1, i] - w)
                drive = min(max(asked + setpoints[k, 2, i], -limit), limit)
                gear = stiffness * (angle[i] / n - q[i]) + damping * (w / n - qd[i])
                level = coulomb + (stiction - coulomb) * np.exp(-((w / stribeck) ** 2))
                rate = sigma0 * abs(w) / level
                bend = sigma0 * bristle[i] + sigma1 * (w - rate * bristle[i])
                end = w / rate if rate > 0 else 0.0
                bristle[i] += (end - bristle[i]) * -np.expm1(-rate * step)
                friction = offset - bend - viscous * w
                torque[k, i] = drive
                applied[i] = gear
                speed[i] += step * (drive + friction - gear / n) / inertia
                angle[i] += step * speed[i]
            mj_step(model, data)

    return loop


def pinocchio_arm(robot: Robot) -> Any:
    """The rigid arm in Pinocchio, with the frames and inertias that MuJoCo compiled."""
    import pinocchio

    arm = Arm(robot).model
    model = pinocchio.Model()
    model.gravity.linear = np.array(arm.opt.gravity)

    def placed(position: np.ndarray, quaternion: np.ndarray) -> pinocchio.SE3:
        w, x, y, z = quaternion
        return pinocchio.SE3(pinocchio.Quaternion(w, x, y, z).matrix(), np.array(position))

    frames = {0: (0, pinocchio.SE3.Identity())}  # of a body: its joint, and where it is there
    for body in range(1, arm.nbody):
        parent, place = frames[int(arm.body_parentid[body])]
        place = place * placed(arm.body_pos[body], arm.body_quat[body])
        if arm.body_jntnum[body]:
            joint = int(arm.body_jntadr[body])
            place = place * pinocchio.SE3(np.eye(3), np.array(arm.jnt_pos[joint]))
            axis = np.array(arm.jnt_axis[joint])
            kind = pinocchio.JointModelRevoluteUnaligned(axis)
            parent = model.addJoint(parent, kind, place, f"joint{joint}")
            place = pinocchio.SE3(np.eye(3), -np.array(arm.jnt_pos[joint]))
        frames[body] = parent, place
        if arm.body_mass[body] > 0 and parent:
            own = placed(arm.body_ipos[body], arm.body_iquat[body])
            about = own.rotation @ np.diag(arm.body_inertia[body]) @ own.rotation.T
            inertia = pinocchio.Inertia(float(arm.body_mass[body]), own.translation, about)
            model.appendBodyToJoint(parent, inertia, place)
    model.armature = np.array(arm.dof_armature)
    return model


def measure() -> dict:
    """Run all programs.

    Returns:
        For each program its step, torque error and cost.
    """
    robot = load_robot(ROBOT)
    motion = from_busy_move(plan(load_task(ROBOT, TASK), robot))
    peers = Peers(motion)
    times = np.arange(SKIPPED, SECONDS, SAMPLE)
    truth = integrate(motion, robot.model, times, start=0, tolerance=1e-7).motor_torque
    size = np.sqrt(np.mean(truth**2, axis=0))

    def error(program: Program, step: float) -> float:
        setpoints = peers.setpoints(step)[: round(SECONDS / step)]
        found = program(setpoints, step)[np.round(times / step).astype(int)]
        wrong = np.sqrt(np.mean((found - truth) ** 2, axis=0)) / size
        return float(wrong.max()) if np.isfinite(wrong).all() else np.inf

    programs: dict[str, Program] = {
        "faultgen": peers.faultgen,
        "mujoco.rollout": peers.rollout,
        "Python loop": peers.python_loop,
    }
    try:
        compiled()
        programs["compiled loop"] = peers.compiled_loop
    except ImportError:
        print("numba is not installed; left out", file=sys.stderr)
    try:
        import pinocchio  # noqa: F401

        programs["Pinocchio"] = peers.pinocchio
    except ImportError:
        print("pinocchio is not installed; left out", file=sys.stderr)
    own = robot.model.opt.timestep
    goal = error(peers.faultgen, own)
    chosen = {}
    for name, program in programs.items():
        tried = {step: error(program, step) for step in (own, *STEPS) if step}
        enough = [step for step, wrong in tried.items() if wrong <= 1.02 * goal]
        step = max(enough) if enough else min(tried, key=tried.__getitem__)
        chosen[name] = {"step": step, "error": tried[step], "as_exact": bool(enough)}
        chosen[name]["errors"] = {str(key): value for key, value in tried.items()}
    spent: dict[str, list[float]] = {name: [] for name in programs}
    for _ in range(REPEATS):
        for name, program in programs.items():
            step = chosen[name]["step"]
            setpoints = peers.setpoints(step)
            clock = time.process_time()
            program(setpoints, step)
            spent[name].append((time.process_time() - clock) / motion.period)
    ratios = {
        name: [a / b for a, b in zip(costs, spent["faultgen"], strict=True)]
        for name, costs in spent.items()
    }
    for name in programs:
        step = chosen[name]["step"]
        cost = float(np.median(spent[name]))
        chosen[name]["milliseconds_per_second"] = 1000 * cost
        chosen[name]["microseconds_per_step"] = 1e6 * cost * step
        chosen[name]["over_faultgen"] = float(np.median(ratios[name]))
        chosen[name]["over_faultgen_each"] = ratios[name]
    return {
        "robot": ROBOT,
        "task": TASK,
        "machine": f"{platform.machine()}, {platform.system()}, Python {platform.python_version()}",
        "mujoco": mujoco.__version__,
        "programs": chosen,
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--save", type=Path, help="JSON file to write")
    given = parser.parse_args()
    text = json.dumps(measure(), indent=1)
    print(text)
    if given.save:
        given.save.write_text(text + "\n")

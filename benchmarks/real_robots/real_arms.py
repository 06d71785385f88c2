"""Calibration of two real arms, judged on motions that were not fitted.

    python -m benchmarks.real_robots.real_arms [tx40] [gen3]
        --data ../shared/data/measured -o real-arms

builds a model of each arm from its public URDF, calibrates it on some of its recordings, and prints
the relative RMS torque error on the others: of the model as it was built, of classical
identification and of the calibrated model. The recordings are not part of the project.

What the URDF does not state is assumed: no friction, a rotor whose inertia at the joint is that of
the arm, a gearbox of 60 Hz with that rotor held, a servo of 8 Hz; and gear ratios of 100 for Gen3.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
from real_robots.measured_data import joined
from scipy.signal import butter, filtfilt

from faultgen.discovery.calibration.calibrate import calibrate
from faultgen.discovery.calibration.compared import compared
from faultgen.discovery.inputs import usable
from faultgen.discovery.laws.friction_law import with_friction_law
from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.rigid.base_parameters import identify
from faultgen.discovery.rigid.regression import CUT_OFF, Coupling, Regression
from faultgen.mjcf.edit import mjcf_text
from faultgen.recordings.low_pass import low_passed
from faultgen.recordings.recording import Recording, write_recording
from faultgen.robot import Robot, load_robot

TX40_RATIOS = (32.0, 32.0, 45.0, -48.0, 45.0, 32.0)
"""Rotor turns per joint turn. Source: published.yaml of the data set."""
TX40_ZEROS = (0.0, -np.pi / 2, np.pi / 2, 0.0, 0.0, 0.0)
"""Joint angles of the URDF where the encoders say zero [rad]."""
TX40_FITTED = 0.6
"""Share of the recording that is fitted; the rest is judged, as in the published comparison."""
GEN3_FITTED = ("opti_traj_testing1", "RecordTrajectory_quadratic")
GEN3_JUDGED = ("opti_traj_testing2", "RunTrajectory1")
GEN3_RATIO = 100.0

START, END = 0.3, 0.05
"""Time at the start of a recording in which the simulation settles, and at its end, where the
filters do not know the motion [s]. It is not judged."""
MOVING = 0.05
"""Joint speed from which samples are judged [rad/s]: at rest friction may have any value."""

LOW_PASS = {"tx40": 100.0, "gen3": CUT_OFF}
"""Cut-off of the filter of positions and torques [Hz]. The angles of the Gen3 are noisy."""

LEAST = 0.01
"""Smallest inertia for which a drive is built, as a share of that of the first axis: assumed."""

_STIFF, _DAMPED, _FAST = 60.0, 0.1, 8.0  # gearbox [Hz], its damping ratio, servo [Hz]: assumed
_STEP = 0.0005  # time step [s]


@dataclass(frozen=True)
class Case:
    """A robot, and recordings joint side."""

    robot: Robot
    fitted: Recording
    judged: Recording


def model(name: str, urdf: Path, ratios: np.ndarray, speed: float = 10.0) -> Robot:
    """Build a robot from a URDF with assumed drives and without friction.

    Args:
        name: Name of the robot.
        urdf: The file.
        ratios: Gear ratio of each axis.
        speed: Largest joint speed [rad/s], for the checks of recordings.
    """
    tree = ElementTree.parse(urdf).getroot()
    for link in tree.iter("link"):
        for kind in ("visual", "collision"):
            for found in link.findall(kind):
                link.remove(found)
    possible = {"balanceinertia": "true", "boundmass": "1e-3", "boundinertia": "1e-4"}
    ElementTree.SubElement(ElementTree.SubElement(tree, "mujoco"), "compiler", possible)
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(tree, encoding="unicode"))
    spec.modelname = name
    compiled = spec.compile()
    for body in spec.bodies[1:]:  # links that could not exist were given the nearest that can
        body.explicitinertial, body.mass = True, float(compiled.body_mass[body.id])
        body.ipos, body.iquat = compiled.body_ipos[body.id], compiled.body_iquat[body.id]
        body.inertia = compiled.body_inertia[body.id]
        body.fullinertia = np.append(np.nan, np.zeros(5))
    spec.compiler.boundmass = spec.compiler.boundinertia = 0.0
    data = mujoco.MjData(compiled)
    mujoco.mj_forward(compiled, data)
    inertia = np.zeros((compiled.nv, compiled.nv))
    mujoco.mj_fullM(compiled, data, inertia)
    spec.option.timestep = _STEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    spec.add_numeric(name="motor_velocity_limit", data=list(speed * np.abs(ratios)))
    joints = [joint for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_HINGE]
    for k, (joint, ratio) in enumerate(zip(joints, ratios.tolist(), strict=True)):
        arm = max(float(inertia[k, k]), LEAST * float(inertia[0, 0]))
        joint.name = f"joint{k + 1}"
        joint.range, joint.limited = [-7.0, 7.0], mujoco.mjtLimited.mjLIMITED_TRUE
        joint.damping, joint.frictionloss = np.zeros(3), 0.0
        rotor = spec.worldbody.add_body(name=f"rotor{k + 1}", pos=[-1.0, 0.2 * k, 0.0])
        rotor.explicitinertial, rotor.mass, rotor.ipos = True, 1.0, np.zeros(3)
        rotor.inertia = [arm / ratio**2] * 3
        rotor.add_joint(name=f"motor{k + 1}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1])
        gearbox = spec.add_tendon(name=f"gearbox{k + 1}")
        gearbox.wrap_joint(f"motor{k + 1}", 1 / ratio)
        gearbox.wrap_joint(f"joint{k + 1}", -1.0)
        rate = 2 * np.pi * _STIFF
        gearbox.stiffness[0], gearbox.damping[0] = arm * rate**2, 2 * _DAMPED * arm * rate
        both, servo = 2 * arm / ratio**2, 2 * np.pi * _FAST
        for kind, settings in (
            ("drive", {"controller": [both * servo**2, 0, 1.6 * both * servo, 0, 0, 0]}),
            ("friction", {}),
        ):
            actuator = spec.add_actuator(
                name=f"{kind}{k + 1}",
                trntype=mujoco.mjtTrn.mjTRN_JOINT,
                target=f"motor{k + 1}",
            )
            drives = kind == "drive"
            actuator.set_to_dcmotor(
                motorconst=[float(drives)] * 2,
                resistance=1.0,
                ctrlspec=7 if drives else 16,
                **settings,
            )
    spec.compile()
    return Robot(name, mjcf_text(spec))


def tx40(folder: Path) -> Case:
    """The Staubli TX40, joint side. Motor 6 also turns with joint 5.

    Args:
        folder: The data set's folder.
    """
    position, torque = (
        np.loadtxt(folder / f"{name}.csv.gz", delimiter=",", skiprows=1)
        for name in ("pos_read_data", "curr_data")
    )
    turns = np.diag(TX40_RATIOS)  # motor angles = turns x joint angles
    turns[5, 4] = TX40_RATIOS[5]
    whole = Recording(
        source="tx40",
        robot="tx40",
        side="joint",
        sample_period=2e-4,
        position=np.linalg.solve(turns, position.T).T + TX40_ZEROS,
        torque=torque @ turns,
    )
    whole = low_passed(whole, LOW_PASS["tx40"])
    cut = round(TX40_FITTED * len(whole.position))
    return Case(
        model("tx40", folder / "tx40_mdh_modified.urdf", np.array(TX40_RATIOS)),
        _cut(whole, slice(None, cut)),
        _cut(whole, slice(cut, None)),
    )


def _cut(recording: Recording, rows: slice) -> Recording:
    return replace(recording, position=recording.position[rows], torque=recording.torque[rows])


def gen3(folder: Path) -> Case:
    """The Kinova Gen3: torque by motor current, joint side.

    Args:
        folder: The data set's folder.
    """

    def read(name: str) -> Recording:
        path = folder / f"{name}.csv.gz"
        table = np.genfromtxt(path, delimiter=",", names=True)
        columns = {
            kind: np.stack([table[f"{kind}{k}"] for k in range(1, 8)], axis=1)
            for kind in ("Position", "TorqueCur")
        }
        recording = Recording(
            source=name,
            robot="gen3",
            side="joint",
            sample_period=1e-3,
            position=columns["Position"],
            torque=columns["TorqueCur"],
        )
        return low_passed(recording, LOW_PASS["gen3"])

    return Case(
        model("gen3", folder / "gen3.urdf", np.full(7, GEN3_RATIO), speed=3.0),
        joined([read(name) for name in GEN3_FITTED]),
        joined([read(name) for name in GEN3_JUDGED]),
    )


CASES = {"tx40": tx40, "gen3": gen3}


def _smooth(x: np.ndarray, period: float) -> np.ndarray:
    if 2.5 * CUT_OFF * period >= 1:  # filtered already
        return x
    b, a = butter(4, 2 * CUT_OFF * period)
    return np.asarray(filtfilt(b, a, x, axis=0))


def errors(recording: Recording, torque: np.ndarray) -> np.ndarray:
    """Relative RMS torque error of each axis while it moves, after the same filter for both.

    Args:
        recording: The measured data.
        torque: The predicted torque, shape (samples, n_axes).

    Returns:
        Shape (n_axes,), in [%].
    """
    error, measured, use = _judged(recording, torque)
    wrong = np.sum(np.where(use, error, 0) ** 2, axis=0)
    return 100 * np.sqrt(wrong / np.sum(np.where(use, measured, 0) ** 2, axis=0))


def _judged(recording: Recording, torque: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Error and torque after the filter, and the samples that count, each (samples, n_axes)."""
    error, measured = np.zeros_like(torque), np.zeros_like(torque)
    use = np.zeros(torque.shape, bool)
    for part in recording.parts:
        measured[part], predicted = (
            _smooth(x[part], recording.sample_period) for x in (recording.torque, torque)
        )
        error[part] = measured[part] - predicted
        speed = np.gradient(recording.position[part], recording.sample_period, axis=0)
        moves = np.abs(speed) > MOVING
        moves[: round(START / recording.sample_period)] = False
        moves[len(moves) - round(END / recording.sample_period) :] = False
        use[part] = moves
    return error, measured, use


def against(recording: Recording, torque: np.ndarray, other: np.ndarray) -> list[str]:
    """95 % interval of the difference of the errors of two predictions, by axis, in [%].

    Args:
        recording: The measured data.
        torque: The predicted torque, shape (samples, n_axes).
        other: Another prediction.
    """
    error, measured, use = _judged(recording, torque)
    size = np.sqrt(np.mean(measured**2, axis=0, where=use))
    of_other = _judged(recording, other)[0]
    one = compared(error / size, of_other / size, use, recording.parts, recording.sample_period)
    return [
        f"{100 * low:+.1f} to {100 * high:+.1f}{' WORSE' if worse else ''}"
        for low, high, worse in zip(one.low, one.high, one.worse, strict=True)
    ]


def simulated(recording: Recording, robot: Robot) -> np.ndarray:
    """Torque of a model in the recording's unit, simulated on the recorded motion.

    Args:
        recording: The measured data.
        robot: The model.
    """
    return Replay(recording, robot).torque()


def judge(name: str, data: Path, out: Path, workers: int) -> dict[str, list[float]]:
    """Calibrate one robot and print its errors.

    Args:
        name: One of `CASES`.
        data: Folder with the data sets.
        out: Folder for the recordings and models.
        workers: Number of processes.

    Returns:
        Error of each axis by method, in [%].
    """
    case = CASES[name](data / name)
    out.mkdir(parents=True, exist_ok=True)
    nominal = out / f"{name}.xml"
    nominal.write_text(case.robot.xml)
    write_recording(case.fitted, out / f"{name}_fitted.h5")
    write_recording(case.judged, out / f"{name}_judged.h5")
    robot = load_robot(nominal)
    fitted, _ = usable(out / f"{name}_fitted.h5", robot)
    table: dict[str, list[float]] = {}

    def row(label: str, torque: np.ndarray) -> None:
        error = errors(case.judged, torque)
        table[label] = error.tolist()
        total = np.sqrt(np.mean(error**2))
        each = " | ".join(f"{x:.0f}" for x in error)
        print(f"| {name}, {label} | **{total:.1f}** | {each} |", flush=True)

    start = time.perf_counter()
    found = calibrate(fitted, robot, workers=workers)
    seconds = time.perf_counter() - start
    row("as built", simulated(case.judged, robot))
    row("classical", _classical(fitted, case.judged, robot, ()))
    if found.couplings:
        row("classical, coupled", _classical(fitted, case.judged, robot, found.couplings))
    torque = simulated(case.judged, found.robot)
    row("calibrated", torque)
    best = _classical(fitted, case.judged, robot, found.couplings)
    told = " | ".join(against(case.judged, torque, best))
    print(f"| {name}, calibrated less classical | | {told} |")
    print(f"{seconds:.0f} s; couplings {found.couplings}; prior scale {found.prior_scale:g}")
    print({key: round(100 * value, 1) for key, value in found.errors.items()}, *found.lacks)
    for one in found.per_axis:
        print("not fitted:", one)
    print(*found.findings, sep="\n")
    found.robot.write(out / f"{name}_calibrated")
    return table


def _classical(
    fitted: Recording, judged: Recording, robot: Robot, couplings: Sequence[Coupling]
) -> np.ndarray:
    """Torque that classical identification on some recordings predicts for others."""
    robot = with_friction_law(robot, fitted)
    value = identify(Regression(fitted, robot, couplings=couplings).products)
    return Regression(judged, robot, couplings=couplings).torque(value)


def main() -> None:
    """Judge the robots that were asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("robots", nargs="*", default=list(CASES), help="tx40, gen3; default: all")
    parser.add_argument("--data", type=Path, required=True, help="folder with tx40 and gen3")
    parser.add_argument("-o", "--out", type=Path, default=Path("real-arms"))
    parser.add_argument("--workers", type=int, default=1)
    args = parser.parse_args()
    print("| robot, model | RMS over axes [%] | axes 1, 2, ... |\n| --- | --- | --- |")
    tables = {name: judge(name, args.data, args.out, args.workers) for name in args.robots}
    (args.out / "errors.json").write_text(json.dumps(tables, indent=1))


if __name__ == "__main__":
    main()

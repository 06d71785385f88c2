import contextlib
import io
import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from unittest.mock import patch

import matplotlib.legend
import numpy as np
import pytest

from faultgen.cli import main
from faultgen.discovery import Recording
from faultgen.effects import get_effect
from faultgen.robot import Robot, load_robot
from faultgen.simulation.motion import plan
from faultgen.simulation.servo import control_signal
from faultgen.simulation.stepping import simulate
from faultgen.system.files import file_sha256
from faultgen.tasks import load_task

HANG = 1800
"""A process that takes longer hangs [s]; no test may depend on how fast or busy the machine is."""

os.environ["TQDM_DISABLE"] = "1"  # whether a line tells the progress depends on the speed too


def faultgen(*arguments, cwd=None, variables=None) -> subprocess.CompletedProcess[str]:
    """Run the command faultgen, in a folder and with further environment variables."""
    return subprocess.run(
        [sys.executable, "-m", "faultgen.cli", *map(str, arguments)],
        cwd=cwd,
        env=os.environ | (variables or {}),
        capture_output=True,
        text=True,
        timeout=HANG,
    )


def faultgen_here(*arguments, cwd=None) -> subprocess.CompletedProcess[str]:
    """Run the command in this process, which starts sooner.

    Use it for commands that only list or refuse something, not for what starts or ends processes.
    """
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    out, err = io.StringIO(), io.StringIO()
    with (
        patch.object(sys, "argv", ["faultgen", *map(str, arguments)]),
        patch.dict(os.environ),
        contextlib.chdir(cwd or Path.cwd()),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        try:
            main()
            status = 0
        except SystemExit as ended:
            status = int(ended.code or 0)
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)
    return subprocess.CompletedProcess(arguments, status, out.getvalue(), err.getvalue())


def contents(folder: Path) -> dict[str, str]:
    """Checksums of all files of a dataset, by their path in its folder."""
    found = [path for path in folder.rglob("*") if path.is_file() and path.name != ".lock"]
    return {str(path.relative_to(folder)): file_sha256(path) for path in found}


TWO_AXES = """
<mujoco model="tiny">
  <compiler angle="radian"/>
  <option timestep="0.001" integrator="Euler"><flag contact="disable"/></option>
  <custom>
    <numeric name="motor_velocity_limit" data="300 300"/>
    <numeric name="joint_acceleration_limit" data="10 10"/>
    <numeric name="encoder_counts" data="1000 1000"/>
  </custom>
  <worldbody>
    <body name="link1">
      <joint name="joint1" axis="0 0 1" range="-3 3"/>
      <inertial pos="0.2 0 0" mass="3" diaginertia="0.1 0.1 0.1"/>
      <body name="link2" pos="0.4 0 0">
        <joint name="joint2" axis="0 1 0" range="-3 3"/>
        <inertial pos="0.1 0 0" mass="1" diaginertia="0.02 0.02 0.02"/>
        <body name="payload" pos="0.2 0 0">
          <inertial pos="0 0 0" mass="0.5" diaginertia="0.001 0.001 0.001"/>
          <site name="tool"/>
        </body>
      </body>
    </body>
    <body name="rotor1"><joint name="motor1"/>
      <inertial pos="0 0 0" mass="1" diaginertia="1e-3 1e-3 1e-3"/></body>
    <body name="rotor2"><joint name="motor2"/>
      <inertial pos="0 0 0" mass="1" diaginertia="5e-4 5e-4 5e-4"/></body>
  </worldbody>
  <tendon>
    <fixed name="gearbox1" stiffness="20000" damping="20">
      <joint joint="motor1" coef="0.01"/><joint joint="joint1" coef="-1"/></fixed>
    <fixed name="gearbox2" stiffness="5000" damping="5">
      <joint joint="motor2" coef="-0.02"/><joint joint="joint2" coef="-1"/></fixed>
  </tendon>
  <actuator>
    <dcmotor name="drive1" joint="motor1" input="pos vel ff" motorconst="1" resistance="1"
      controller="5 0 0.2 0 0 0" saturation="3 0 0"/>
    <dcmotor name="drive2" joint="motor2" input="pos vel ff" motorconst="1" resistance="1"
      controller="2 0 0.1 0 0 0" saturation="2 0 0"/>
    <dcmotor name="friction1" joint="motor1" input="none" motorconst="0" resistance="1"
      lugre="20 0.1 0.2 0.3 5" damping="1e-3"/>
    <dcmotor name="friction2" joint="motor2" input="none" motorconst="0" resistance="1"
      lugre="10 0.07 0.1 0.15 5" damping="1e-3"/>
  </actuator>
</mujoco>
"""

SWING = """
description = "swings both axes"
[start]
joints = [-40, -30]
[[move]]
joints = [40, 20]
dwell = 0.1
[[move]]
joints = [-40, -30]
"""


@pytest.fixture(scope="session")
def tiny_robot_path(tmp_path_factory) -> str:
    """Path of a robot with two axes, cheap to simulate."""
    path = tmp_path_factory.mktemp("robot") / "tiny.xml"
    path.write_text(TWO_AXES)
    return str(path)


@pytest.fixture(scope="session")
def tiny_task_path(tmp_path_factory) -> str:
    """Path of a task for it."""
    path = tmp_path_factory.mktemp("task") / "swing.toml"
    path.write_text(SWING)
    return str(path)


@pytest.fixture(scope="session")
def tiny_robot(tiny_robot_path) -> Robot:
    return load_robot(tiny_robot_path)


@pytest.fixture(scope="session")
def puma() -> Robot:
    """The PUMA 560 that comes with the package."""
    return load_robot("puma560")


@pytest.fixture(params=["puma560", "irb6700"], scope="session")
def robot(request) -> Robot:
    """Each robot that comes with the package."""
    return load_robot(request.param)


RICH = """
description = "fast and slow, both ways, and some waiting, so that effects differ"
[start]
joints = [-60, -60]
[[move]]
joints = [60, 40]
dwell = 0.1
[[move]]
joints = [-20, -90]
speed = 0.3
[[move]]
joints = [50, 80]
speed = 0.6
[[move]]
joints = [40, 70]
speed = 0.05
[[move]]
joints = [-60, -60]
"""


@pytest.fixture(scope="session")
def measured(tiny_robot, tmp_path_factory):
    """Records the small robot with effects, and noise of 1 % of the mean torque."""
    path = tmp_path_factory.mktemp("screen") / "rich.toml"
    path.write_text(RICH)
    motion = plan(load_task("tiny", str(path)), tiny_robot)
    control = control_signal(motion, tiny_robot.model.opt.timestep)

    def record(effects, seed, **parameters):
        spec = tiny_robot.spec()
        for name, axis, severity in effects:
            get_effect(name).apply(spec, axis, severity, **parameters.get(name, {}))
        (run,) = simulate(tiny_robot, control, [spec.compile()], sample_period=0.004)
        times = np.arange(len(run.motor_torque)) * 0.004
        clean = run.motor_torque
        noise = np.random.default_rng(seed).standard_normal(clean.shape)
        return Recording(
            source="simulated",
            robot="tiny",
            side="motor",
            sample_period=0.004,
            position=run.motor_position,
            torque=clean + 0.01 * np.abs(clean).mean(axis=0) * noise,
            reference_position=motion(times)[0],
        )

    return record


@pytest.fixture(autouse=True)
def legends_have_a_place(monkeypatch):
    """No figure searches for the best place of its legend: on a busy machine that takes seconds."""
    place = matplotlib.legend.Legend.set_loc

    def checked(self, loc=None):
        chosen = matplotlib.rcParams["legend.loc"] if loc is None and self.isaxes else loc
        assert chosen not in ("best", 0), "give this legend a place instead of loc='best'"
        place(self, loc)

    monkeypatch.setattr(matplotlib.legend.Legend, "set_loc", checked)


@pytest.fixture(scope="session")
def twin(tiny_robot, tiny_task_path, tmp_path_factory):
    """A furnished robot, a dataset of it and a detector."""
    from recorded import record

    from faultgen.dataset.experiment import make_experiment
    from faultgen.dataset.reader import open_dataset
    from faultgen.dataset.sweep import generate
    from faultgen.recordings.recording import write_recording
    from faultgen.twin.folder import RESULT, TASK
    from faultgen.twin.make import furnish
    from faultgen.twin.train import train

    folder = tmp_path_factory.mktemp("twin")
    healthy = [record(tiny_robot, tiny_task_path, seed) for seed in (1, 2, 3)]
    furnish(tiny_robot, healthy, folder / "robot", compare=False)
    told = {"recordings": ["a", "b", "c"], "torque_constants": None}
    (folder / "robot" / RESULT).write_text(json.dumps(told))
    experiment = make_experiment(
        {
            "robot": str(folder / "robot"),
            "task": TASK,
            "severity": [0.3],
            "schedule": "linear",
            "cycles": 12,
            "repetitions": 2,
        }
    )
    generate(experiment, folder / "data", progress=False)
    train(open_dataset(folder / "data")).save(folder / "detector")
    files = {}
    cases = {"healthy": (), "worn": [("friction_wear", 2, 0.15)], "heavy": [("payload_mass", 2, 2)]}
    for name, effects in cases.items():
        recording = record(tiny_robot, tiny_task_path, 50 + len(files), effects)
        files[name] = folder / f"{name}.h5"
        write_recording(recording, files[name])
    return folder, files

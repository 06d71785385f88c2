"""Charts of the signals of a dataset: torque, friction, path of the tool, and spectra.

Each chart compares the last cycle of a healthy run with that of the most worn run of an axis.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from faultgen.dataset.stored_run import StoredRun
from faultgen.effects import Applied, get_effect
from faultgen.errors import InputError
from faultgen.report.chart import Chart, axes, line, path
from faultgen.robot import Robot, load_robot
from faultgen.simulation.arm import Arm, steady_friction
from faultgen.simulation.plant import assemble

HEALTHY, WORN, DIFFERENCE = 0, 1, 2
"""Numbers of the colours."""

_MOST_TIMES = 1500  # samples of a line over time
_MOST_POINTS = 400  # of a cloud of points, or of a path
_CURVE = 200  # points of the model's friction curve
_CYCLES = 5  # last ones of a run, whose spectra are averaged
_TORQUE = "signals/motor_torque"
_SPEED, _FRICTION = "signals/motor_velocity", "truth/friction_torque"


@dataclass(frozen=True)
class Place:
    """A robot and task with its runs."""

    runs: Sequence[StoredRun]
    """All runs."""
    robot: Robot | None
    """The healthy robot; None if it cannot be found any more."""

    @classmethod
    def of(cls, runs: Sequence[StoredRun], robot_path: str) -> Place:
        """Find the robot of some runs.

        Args:
            runs: Runs of one robot and task.
            robot_path: Name of the robot, or path of its MJCF file or folder.
        """
        try:
            robot = load_robot(robot_path)
        except InputError:
            return cls(runs, None)
        same = robot.sha256 == runs[0]["model_sha256"]
        return cls(runs, robot if same else None)

    @property
    def n_axes(self) -> int:
        """Number of axes."""
        return len(self.runs[0]["gear_ratio"])

    @property
    def healthy(self) -> StoredRun | None:
        """The first healthy run."""
        return next((run for run in self.runs if run["axis"] == 0), None)

    def worn(self, axis: int) -> StoredRun | None:
        """The run in which an axis has the largest share of its worn runs' final severity.

        Args:
            axis: Axis, from 1.
        """
        there = [run for run in self.runs if axis in run["axes"]]
        return max(there, key=lambda run: float(run["severity"]), default=None)

    def compared(self, axis: int) -> list[tuple[str, int, StoredRun]]:
        """Runs that are compared for an axis: name, number of the colour, and run.

        Args:
            axis: Axis, from 1.
        """
        found = [("healthy", HEALTHY, self.healthy), (None, WORN, self.worn(axis))]
        return [(name or in_words(run), k, run) for name, k, run in found if run is not None]


def in_words(run: StoredRun) -> str:
    """Name a run by its fault."""
    if run["axis"] == 0:
        return "healthy"
    shown = get_effect(run["effect"]).shown(run["severity"], run["severity_units"])
    worn = "+".join(str(axis) for axis in run["axes"])
    return f"axis {worn}: {run['effect']} {shown}"


def signal_charts(place: Place) -> tuple[list[Chart], list[str]]:
    """Make the charts of the signals that a dataset has kept.

    Args:
        place: A robot and task.

    Returns:
        The charts, and a line for each chart that cannot be drawn.
    """
    charts: list[Chart] = []
    notes = []
    for what, make, needs in _KINDS:
        lacking = [name for name in needs if name not in place.runs[0]]
        chart = None if lacking else make(place)
        if chart is not None:
            charts.append(chart)
            continue
        why = (
            f"the dataset holds no {' and no '.join(lacking)}; --signals chooses what 'faultgen "
            "generate' keeps"
            if lacking
            else "the robot that made the dataset is not found any more"
        )
        notes.append(f"The chart of {what} is left out: {why}.")
    return charts, notes


def _last(run: StoredRun, name: str, count: int = 1) -> np.ndarray:
    """An array in the last cycles of a run, shape (count, samples, n_axes)."""
    cycles = int(run["cycles"])
    return run.read(name, slice(max(0, cycles - count), cycles)).astype(float)


def stored_period(run: StoredRun) -> float:
    """Return the time between the stored samples of a run [s]."""
    return float(run["sample_period"]) * int(run["thin"])


def _torque(place: Place) -> Chart:
    traces, told = [], []
    for axis in range(1, place.n_axes + 1):
        kept = []
        for name, number, run in place.compared(axis):
            torque = _last(run, _TORQUE)[0, :, axis - 1]
            kept.append(torque)
            traces.append(_over_time(name, torque, number, run, axis))
        if len(kept) == 2:
            gap = kept[1] - kept[0]
            run = place.compared(axis)[1][2]
            traces.append(_over_time("worn minus healthy", gap, DIFFERENCE, run, axis))
            told.append(f"axis {axis} {np.sqrt(np.mean(gap**2)):.3g}")
    return Chart(
        title="Motor torque over a cycle",
        over_time=True,
        traces=traces,
        layout=axes("time [s]", "motor torque [N m]"),
        caption="Last cycle of the healthy run and of the run in which the axis is worn most, as "
        "the sensors show it, and the difference of the two.",
        description="Lines of the motor torque over one cycle, healthy and worn. RMS difference "
        f"in N m: {', '.join(told) or 'no worn run'}.",
    )


def _over_time(
    name: str, values: np.ndarray, number: int, run: StoredRun, axis: int
) -> dict[str, Any]:
    every = -(-len(values) // _MOST_TIMES)
    return line(name, values[::every], number, step=every * stored_period(run), axis=axis)


def _friction(place: Place) -> Chart | None:
    if place.robot is None:
        return None
    traces, told = [], []
    for axis in range(1, place.n_axes + 1):
        top = 0.0
        for name, number, run in place.compared(axis):
            speed, friction = (_last(run, one)[0, :, axis - 1] for one in (_SPEED, _FRICTION))
            every = -(-len(speed) // _MOST_POINTS)
            top = max(top, float(np.abs(speed).max()))
            marker = {"size": 4, "opacity": 0.6}
            traces.append(
                line(
                    name,
                    -friction[::every],
                    number,
                    x=speed[::every],
                    axis=axis,
                    mode="markers",
                    marker=marker,
                )
            )
        half = np.geomspace(1e-3, 1, _CURVE // 2) * max(top, 1.0)
        grid = np.concatenate([-half[::-1], half])
        curves = []
        for name, number, run in place.compared(axis):
            curve = steady_friction(place.robot, _model(place.robot, run), axis, grid)
            curves.append(curve)
            traces.append(
                line(f"model, {name}", curve, number, x=grid, axis=axis, line={"width": 1.6})
            )
        if len(curves) == 2:
            told.append(f"axis {axis} {100 * (curves[1][-1] / curves[0][-1] - 1):+.3g} %")
    return Chart(
        title="Friction against speed",
        traces=traces,
        layout=axes("motor speed [rad/s]", "torque that overcomes friction [N m]"),
        caption="Points: true friction in the last cycle. Lines: the friction of the model in "
        "steady sliding, at the temperature for which its parameters hold. Points leave the line "
        "where the direction of motion changes, and where temperature or load change friction.",
        description="Points and curves of the friction torque over the motor speed, healthy and "
        "worn. Growth of the model's friction at the highest speed: "
        f"{', '.join(told) or 'no worn run'}.",
    )


def _model(robot: Robot, run: StoredRun) -> mujoco.MjModel:
    """The model of a robot with the main fault of a run at its final severity."""
    if run["axis"] == 0:
        return robot.model
    own = json.loads(run["parameters"])
    faults = [Applied(run["effect"], int(k), float(run["severity"]), own) for k in run["axes"]]
    return assemble(robot, faults).model


def _paths(place: Place) -> Chart | None:
    robot = place.robot
    if robot is None:
        return None
    arm = Arm(robot)

    def points(position: np.ndarray) -> np.ndarray:
        every = -(-len(position) // _MOST_POINTS)
        return np.array([arm.tool_pose(one)[0] for one in position[::every]])

    run = place.runs[0]
    commanded = points(run.read("command/reference_position"))
    traces = [path("commanded", commanded, DIFFERENCE, line={"width": 3, "dash": "dot"})]
    told = []
    for axis in range(1, place.n_axes + 1):
        for name, number, one in place.compared(axis):
            position = joint_positions(one, robot)
            if position is None:
                continue
            reached = points(position)
            traces.append(path(name, reached, number, axis=axis))
            if number == WORN:
                off = 1000 * np.linalg.norm(reached - commanded, axis=1).max()
                told.append(f"axis {axis} {off:.2g}")
    size = np.ptp(commanded, axis=0)
    titles = {f"{k}axis": {"title": {"text": f"{k} [m]"}} for k in "xyz"}
    return Chart(
        title="Path of the tool",
        traces=traces,
        layout={
            "scene": {**titles, "aspectmode": "data", "camera": {"eye": {k: 2.1 for k in "xyz"}}},
            "height": 360,
        },
        caption="The tool in the base frame of the robot: as commanded, and as it moved in the "
        "last cycle of the healthy and of the worn run. Drag to turn, scroll to zoom.",
        description=f"Path of the tool in space, {size[0]:.2g} by {size[1]:.2g} by {size[2]:.2g} "
        "m. Largest distance between the commanded and the worn path in mm: "
        f"{', '.join(told) or 'not stored'}.",
    )


def joint_positions(run: StoredRun, robot: Robot) -> np.ndarray | None:
    """Read the joint positions in the last cycle of a run.

    Args:
        run: The run.
        robot: Its healthy robot.

    Returns:
        Shape (samples, n_axes), in [rad], or [m] for slides; None if they are not stored.
    """
    if "truth/joint_position" in run:
        return _last(run, "truth/joint_position")[0]
    if "signals/motor_position" in run:
        return robot.gearing.joints(_last(run, "signals/motor_position")[0])
    return None


def _spectra(place: Place) -> Chart:
    traces, told = [], []
    for axis in range(1, place.n_axes + 1):
        found = []
        for name, number, run in place.compared(axis):
            torque = _last(run, _TORQUE, _CYCLES)[..., axis - 1]
            samples = torque.shape[1]
            amplitude = np.abs(np.fft.rfft(torque, axis=1)).mean(axis=0)[1:] * 2 / samples
            resolution = 1 / (samples * stored_period(run))
            # neighbouring frequencies of long cycles are joined by their largest amplitude
            width = -(-len(amplitude) // _MOST_TIMES)
            whole = amplitude[: len(amplitude) // width * width].reshape(-1, width).max(axis=1)
            found.append(whole)
            traces.append(
                line(name, whole, number, start=resolution, step=width * resolution, axis=axis)
            )
        if len(found) == 2:
            ratio = found[1] / np.maximum(found[0], 1e-12)
            at = int(np.argmax(np.where(found[1] > 1e-3 * found[1].max(), ratio, 0)))
            told.append(f"axis {axis} at {resolution * (1 + width * at):.3g} Hz")
    return Chart(
        title="Spectrum of the motor torque",
        traces=traces,
        layout=axes("frequency [Hz]", "amplitude [N m]", type="log", exponentformat="power"),
        caption=f"Amplitude of the motor torque by frequency, mean of the last {_CYCLES} cycles. "
        "A cycle repeats, so no window is needed. Ripple and damaged teeth show as lines, "
        "friction as a change at low frequencies.",
        description="Lines of the amplitude of the motor torque over the frequency, healthy and "
        f"worn. The amplitude grows by the largest factor: {', '.join(told) or 'no worn run'}.",
    )


_KINDS: tuple[tuple[str, Callable[[Place], Chart | None], tuple[str, ...]], ...] = (
    ("the motor torque", _torque, (_TORQUE,)),
    ("friction", _friction, (_SPEED, _FRICTION)),
    ("the path of the tool", _paths, ()),
    ("spectra", _spectra, (_TORQUE,)),
)

"""Pictures of all effects, each beside the healthy run of the same motion, and docs/effects.md.

    python -m benchmarks.pages.effect_signatures [EFFECT ...]

Without names of effects, it also writes the curves that `faultgen effects --gallery` draws.

Left the motor torque over time, right what the effect changes over the quantity that shows it. The
text needs no simulation; a test holds it against the catalogue.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import typer
from pages.effect_cases import CASES, MOTIONS, Case

from faultgen.effects import EFFECTS, Applied, Effect
from faultgen.monitoring.sensors import Measured
from faultgen.robot import Robot, load_robot
from faultgen.simulation.cycle import Cycle
from faultgen.simulation.motion import Motion, plan
from faultgen.simulation.plant import assemble
from faultgen.simulation.servo import control_signal
from faultgen.simulation.stepping import simulate
from faultgen.tasks import Move, Pose, Task

ROBOT, PERIOD, TEMPERATURE, SEED = "irb6700", 0.004, 65.0, 1
PAGE = Path(__file__).parents[2] / "docs" / "effects.md"
FOLDER = PAGE.parent / "figures" / "effects"
GALLERY = PAGE.parents[1] / "faultgen" / "report" / "gallery.json"
POINTS = 240  # most points of a curve in the gallery
DIGITS = 400  # steps of a curve in the gallery, from its lowest to its highest point
HEALTHY = {"color": "0.7", "lw": 3.0}
FAULTY = {"color": "#c1121f", "lw": 1.0}
QUANTITIES = {
    "time": "time [s]",
    "speed": "motor speed [rad/s]",
    "both speeds": "sum of the joints' speeds [rad/s]",
    "acceleration": "motor acceleration [rad/s²]",
    "angle": "joint angle [deg]",
    "motor angle": "motor angle [rad], one turn",
    "load": "|torque of the gearbox| [kN m]",
    "torque": "healthy motor torque [N m]",
    "torque rate": "rate of the healthy torque [N m/s]",
}
"""What gaps are drawn over, with units."""
SHOWN = {
    "gap": "gap of torque [N m]",
    "against": "gap against motion [N m]",
    "velocity": "logged speed [rad/s]",
}
"""What is drawn, with units."""
INTRODUCTION = """\
# The effects

This page shows what each effect changes in a robot, and how it shows in the recorded signals. \
Use it to choose an effect, its severity s and its unit. The catalogue has {count} effects. \
A severity of 0 is the healthy robot, and a fraction of 0.1 is 10 % more. Each entry states the \
unit and the range of s, and the equation in the symbols of [physics](physics.md). \
`faultgen effects` also prints the source of each effect.

The pictures compare an IRB 6700 that has the effect with a healthy one in the same motion. On the \
left is the logged motor torque of both robots, on the right what the effect changes: a gap is the \
torque of the faulty robot minus that of the healthy one. `faultgen effects --gallery` writes a \
page with small pictures of all effects."""


def motion_of(robot: Robot, name: str) -> Motion:
    """Return a motion of `MOTIONS`.

    Args:
        robot: The robot.
        name: Name of the motion.

    Returns:
        The motion.
    """
    start, moves = MOTIONS[name]
    poses, pose = [], list(start)
    for angles, speed, dwell in moves:
        for axis, angle in angles.items():
            pose[axis - 1] = angle
        poses.append(Move(joints=list(pose), speed=speed, dwell=dwell))
    begin = Pose(joints=list(start))
    task = Task(name=name, robot=robot.name, description=name, start=begin, move=poses)
    return plan(task, robot)


def run(robot: Robot, motion: Motion, effects: list[Applied]) -> tuple[Cycle, Measured]:
    """Simulate a cycle of a robot with effects.

    Args:
        robot: The healthy robot.
        motion: The motion.
        effects: Effects of the robot.

    Returns:
        The cycle as it was simulated, and as its sensors measure it.
    """
    plant = assemble(robot, effects, temperature=TEMPERATURE)
    control = control_signal(motion, robot.model.opt.timestep)
    (cycle,) = simulate(robot, control, [plant], sample_period=PERIOD)
    clean = Measured(cycle.motor_position, cycle.motor_velocity, cycle.motor_torque)
    return cycle, plant.sense(clean, PERIOD, np.random.default_rng(SEED))


def quantity(name: str, healthy: Cycle, robot: Robot, axis: int) -> np.ndarray:
    """Compute the quantity over which a gap is drawn, from the healthy run.

    Args:
        name: Name of the quantity.
        healthy: The healthy run.
        robot: The robot.
        axis: Axis, from 1.

    Returns:
        The quantity, shape (samples,), in the unit of its label.
    """
    i = axis - 1
    speed, torque = healthy.motor_velocity[:, i], healthy.motor_torque[:, i]
    if name == "time":
        return np.arange(len(speed)) * PERIOD
    if name == "speed":
        return speed
    if name == "both speeds":
        return healthy.joint_velocity[:, i] + healthy.joint_velocity[:, i - 1]
    if name == "acceleration":
        return np.gradient(speed, PERIOD)
    if name == "angle":
        return np.degrees(healthy.joint_position[:, i])
    if name == "motor angle":
        return np.mod(healthy.motor_position[:, i] + np.pi, 2 * np.pi) - np.pi
    if name == "load":
        return np.abs(healthy.gear_torque[:, i]) / 1000
    return torque if name == "torque" else np.gradient(torque, PERIOD)


@dataclass(frozen=True, eq=False)
class Signature:
    """What a picture shows."""

    time: np.ndarray
    """Times of the left half [s]."""
    torque: tuple[np.ndarray, np.ndarray]
    """Motor torque of the healthy robot and of the faulty one then, in [N m]."""
    over: np.ndarray
    """Quantity of the right half, in the unit of its label."""
    shown: tuple[np.ndarray, ...]
    """What is drawn over it: a gap, or the channel of the healthy and of the faulty robot."""


def signature(effect: Effect, case: Case, robot: Robot, motion: Motion) -> Signature:
    """Simulate an effect beside the healthy robot.

    Args:
        effect: The effect.
        case: Axis, severity and quantity that are shown.
        robot: The robot.
        motion: The motion.

    Returns:
        The curves of both halves.
    """
    applied = Applied(effect.name, case.axis, case.severity, case.parameters)
    healthy, exact = run(robot, motion, [])
    _, seen = run(robot, motion, [applied])
    axis = case.seen or case.axis
    i = axis - 1
    time = quantity("time", healthy, robot, axis)
    inside = (time >= case.window[0]) & (time <= case.window[1])
    pair = exact.motor_torque[inside, i], seen.motor_torque[inside, i]

    speed = healthy.motor_velocity[:, i]
    over = quantity(case.over, healthy, robot, axis)
    chosen = np.ones(len(time), bool)
    if case.over == "time":
        chosen &= inside
    if case.near is not None:
        chosen &= np.abs(over) <= case.near
    if case.forward:
        steady = np.median(speed[inside])
        chosen &= inside & (np.abs(speed - steady) < 0.2 * steady)
    if case.gap == "against":
        chosen &= np.abs(speed) > 10
    shown: tuple[np.ndarray, ...]
    if case.gap in ("gap", "against"):
        gap = seen.motor_torque[:, i] - exact.motor_torque[:, i]
        shown = (gap * np.sign(speed) if case.gap == "against" else gap,)
    else:
        shown = tuple(getattr(one, f"motor_{case.gap}")[:, i] for one in (exact, seen))
    return Signature(time[inside], pair, over[chosen], tuple(one[chosen] for one in shown))


def draw(effect: Effect, case: Case, told: Signature, path: Path) -> None:
    """Draw the picture of an effect, 700 points wide.

    Args:
        effect: The effect.
        case: Axis, severity and quantity that are drawn.
        told: The curves.
        path: Picture to write.
    """
    axis = case.seen or case.axis
    figure, (left, right) = plt.subplots(1, 2, figsize=(7, 2.5), dpi=100, layout="constrained")
    lines = ((HEALTHY, "healthy"), (FAULTY, "faulty"))
    for torque, (line, label) in zip(told.torque, lines, strict=True):
        left.plot(told.time, torque, label=label, **line)
    left.set_xlabel(QUANTITIES["time"], size=8)
    left.set_ylabel(f"motor torque, axis {axis} [N m]", size=8)
    left.legend(frameon=False, fontsize=8, loc="best")
    style = {} if case.over == "time" else {"ls": "", "marker": ".", "ms": 2.5}
    if len(told.shown) == 1:
        right.axhline(0.0, color="0.5", lw=0.8)
        right.plot(told.over, told.shown[0], **(FAULTY | style))
    else:
        for values, (line, _) in zip(told.shown, lines, strict=True):
            right.plot(told.over, values, drawstyle="steps-post", **line)
    right.set_xlabel(QUANTITIES[case.over], size=8)
    right.set_ylabel(SHOWN[case.gap], size=8)
    for panel in (left, right):
        panel.grid(alpha=0.25)
        panel.tick_params(labelsize=8)
    shown = effect.shown(case.severity)
    figure.suptitle(f"{effect.name}, {shown}, axis {case.axis} of the IRB 6700", fontsize=10)
    figure.savefig(path, metadata={"Software": ""})
    plt.close(figure)


def stored(case: Case, told: Signature) -> dict[str, Any]:
    """Thin the curves of an effect for the gallery.

    Args:
        case: Axis, severity and quantity that are drawn.
        told: The curves.

    Returns:
        Two charts, each with the titles of its axes, whether it has lines or points, its places and
        the values of each curve.
    """
    axis = case.seen or case.axis
    signal = f"motor torque, axis {axis} [N m]"
    halves = (
        (QUANTITIES["time"], signal, True, told.time, told.torque),
        (QUANTITIES[case.over], SHOWN[case.gap], case.over == "time", told.over, told.shown),
    )
    charts = []
    for x_title, y_title, lines, x, curves in halves:
        every = -(-len(x) // POINTS)
        charts.append(
            {
                "x_title": x_title,
                "y_title": y_title,
                "lines": lines,
                "x": _digits(x[::every]),
                "y": [_digits(one[::every]) for one in curves],
            }
        )
    return {"severity": case.severity, "axis": case.axis, "charts": charts}


def _digits(values: np.ndarray) -> list[float]:
    """Numbers with as many digits as a small picture can show."""
    step = max(float(np.ptp(values)), 1e-9) / DIGITS
    places = max(0, -int(np.floor(np.log10(step))))
    return [round(float(one), places) + 0.0 for one in values]


_OF_ROBOT = {"width": "the Stribeck velocity [rad/s]", "temperature": "that of the robot [°C]"}
"""Defaults that depend on the robot."""


def page() -> str:
    """docs/effects.md, from the catalogue and `CASES`."""
    lines = INTRODUCTION.format(count=len(EFFECTS)).splitlines()
    for name, effect in EFFECTS.items():
        unit = effect.unit.replace(" (0.1 = 10 % more)", "")
        span = f"{effect.smallest:g} to {effect.largest:g}"
        given = ", ".join(
            f"`{key}` = {_OF_ROBOT[key] if value is None else value}"
            for key, value in effect.parameters.items()
        )
        text = f"{effect.description[0].upper()}{effect.description[1:]}."
        lines += ["", f"## {name}", "", f"{text} Shows as: {effect.signature}."]
        lines += [f"Severity: {unit}; {span}. Equation: {CASES[name].equation}."]
        lines += [f"Parameters: {given}."] if given else []
        lines += ["", f"![{name}](figures/effects/{name}.png)"]
    return "\n".join(lines) + "\n"


def main(
    names: Annotated[list[str] | None, typer.Argument(help="Effects; default: all.")] = None,
) -> None:
    """Draw the pictures and write the page."""
    robot = load_robot(ROBOT)
    motions = {name: motion_of(robot, name) for name in MOTIONS}
    FOLDER.mkdir(parents=True, exist_ok=True)
    gallery = {}
    for name in names or list(EFFECTS):
        case = CASES[name]
        told = signature(EFFECTS[name], case, robot, motions[case.motion])
        draw(EFFECTS[name], case, told, FOLDER / f"{name}.png")
        gallery[name] = stored(case, told)
        print(name, flush=True)
    if not names:
        lines = [f'"{name}": {json.dumps(one)}' for name, one in gallery.items()]
        GALLERY.write_text("{" + ",\n".join(lines) + "}\n")
    PAGE.write_text(page())


if __name__ == "__main__":
    typer.run(main)

"""The signals of a choice beside the healthy ones, in the form in which the page draws them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from faultgen.applied import Applied
from faultgen.dataset.planning import Run
from faultgen.dataset.run import prepare
from faultgen.effects import get_effect
from faultgen.exploring.choice import Choice
from faultgen.exploring.cycles import Cycles
from faultgen.exploring.store import CycleArrays, Found
from faultgen.monitoring.reductions import REDUCTIONS
from faultgen.monitoring.sensors import Measured, Sensors, measure
from faultgen.report.packing import packed
from faultgen.simulation.nominal import Nominal
from faultgen.simulation.plant import Plant, assemble
from faultgen.viewing.playback import SAMPLE_PERIOD

HISTOGRAMS = ("torque_histogram", "speed_histogram", "angle_histogram")
"""Names of the reductions that the page shows."""

_POINTS = 900  # most samples of a curve that are drawn
_UNSEEN = 1e-5  # a change below this share of the largest torque is not told as one


def answer(cycles: Cycles, choice: Choice, *, exact: bool) -> dict[str, Any]:
    """Answer a move of a slider.

    Args:
        cycles: The cycles of the robot and task.
        choice: What is chosen.
        exact: Whether to simulate what is not known, and wait for it.

    Returns:
        The signals of the healthy robot and of that with the fault, and the command that makes
        them. If they are not known yet, `ready` is False.

    Raises:
        InputError: The robot cannot have the fault, or cannot be operated so.
        SimulationFailed: The simulation diverged.
    """
    healthy = replace(choice, severity=0.0)
    find = cycles.exact if exact else cycles.near
    usual, found = find(healthy), find(choice)
    told: dict[str, Any] = {"command": cycles.subject.command(choice), "ready": False}
    if usual is None or found is None:
        return told
    shared = cycles.shared(choice.operation)
    if _is_plain(choice, shared):
        logged = [_plain(usual.arrays), _plain(found.arrays)]
    else:
        runs = cycles.subject.runs(replace(choice, cycles=1))
        logged = [
            seen_in(run, shared, one.arrays) for run, one in ((runs[0], usual), (runs[-1], found))
        ]
    return {
        **told,
        "ready": True,
        "exact": usual.is_exact and found.is_exact,
        "how": _how(usual, found, choice),
        "note": _note(logged, choice),
        "period": SAMPLE_PERIOD,
        "step": _step(shared),
        "bins": _bins(shared, choice.axis),
        "healthy": _curves(logged[0], shared, usual.arrays, choice.axis),
        "now": _curves(logged[1], shared, found.arrays, choice.axis),
    }


def seen_in(run: Run, shared: Nominal, arrays: CycleArrays) -> Measured:
    """Measure the only cycle of a run, with the noise that `faultgen generate` draws for it.

    Args:
        run: The run.
        shared: What it shares with other runs of its robot and task.
        arrays: Its cycle without noise.

    Returns:
        What the controller logs.
    """
    ready = prepare(run)
    plant = sensing(shared, run.faults)
    clean = measured(ready.sensors, shared, arrays, ready.rng_sensors)
    return plant.sense(clean, SAMPLE_PERIOD, ready.rng_faults)


def measured(
    sensors: Sensors, shared: Nominal, arrays: CycleArrays, rng: np.random.Generator
) -> Measured:
    """Measure a cycle with the noise of sensors.

    Args:
        sensors: The sensors.
        shared: What all runs of the robot and task share.
        arrays: The cycle without noise.
        rng: Random number generator.

    Returns:
        What the controller logs.
    """
    return measure(
        sensors,
        arrays["motor_position"],
        arrays["motor_velocity"],
        arrays["motor_torque"],
        gear_ratio=shared.robot.gear_ratio,
        encoder_counts=shared.robot.encoder_counts,
        mean_torque=shared.mean_torque,
        sample_period=SAMPLE_PERIOD,
        rng=rng,
    )


def _is_plain(choice: Choice, shared: Nominal) -> bool:
    """Whether the log shows what the simulation holds; then no run has to be planned."""
    return choice.sensors == "none" and not _senses((*choice.faults, *shared.robot.effects))


def _plain(arrays: CycleArrays) -> Measured:
    return Measured(arrays["motor_position"], arrays["motor_velocity"], arrays["motor_torque"])


def _senses(effects: Sequence[Applied]) -> bool:
    """Whether one of some effects is a fault of sensors."""
    return any(get_effect(one.effect).sense is not None for one in effects)


def sensing(shared: Nominal, faults: list[Applied]) -> Plant:
    """Make a plant whose sensors have the faults of a run.

    Args:
        shared: What all runs of the robot and task share.
        faults: The faults.

    Returns:
        The plant; the healthy one if no fault is one of sensors, which is made faster.
    """
    if _senses((*faults, *shared.robot.effects)):
        return assemble(shared.robot, faults)
    return Plant(shared.robot.model)


def _step(shared: Nominal) -> int:
    """How many samples there are from one point of a curve to the next."""
    return -(-shared.samples // _POINTS)


def _bins(shared: Nominal, axis: int) -> dict[str, Any]:
    """Range and title of the histograms of an axis."""
    limits, slides = shared.limits, shared.robot.slides[axis - 1]
    torque, speed = float(limits.torque[axis - 1]), float(limits.speed[axis - 1])
    low, high = limits.angle[axis - 1].tolist()
    return {
        "torque_histogram": [-torque, torque, "torque [N m]"],
        "speed_histogram": [-speed, speed, "motor speed [rad/s]"],
        "angle_histogram": [
            low,
            high,
            "position of the joint [m]" if slides else "angle of the joint [rad]",
        ],
    }


def _curves(seen: Measured, shared: Nominal, arrays: CycleArrays, axis: int) -> dict[str, Any]:
    """What the page draws of one axis in one cycle, and the RMS torque of every axis."""
    every, own = _step(shared), slice(axis - 1, axis)
    cycle = seen.motor_position, seen.motor_velocity, seen.motor_torque
    reduced = {name: REDUCTIONS[name](*cycle, shared.limits, None) for name in HISTOGRAMS}
    curves = {
        "torque": seen.motor_torque,
        "velocity": arrays["motor_velocity"],
        "friction": arrays["friction_torque"],
    }
    return {
        **{name: packed(values[::every, own].ravel()) for name, values in curves.items()},
        "rms": np.sqrt(np.mean(seen.motor_torque**2, axis=0)).tolist(),
        "histograms": {name: values[axis - 1].tolist() for name, values in reduced.items()},
    }


def _note(logged: Sequence[Measured], choice: Choice) -> str:
    """Say if a fault does not show in this motion."""
    usual, now = (one.motor_torque for one in logged)
    small = np.abs(now - usual).max(axis=0) <= _UNSEEN * np.abs(usual).max(axis=0)
    if choice.severity and small.all():
        return "The fault hardly changes the torque of any axis in this cycle."
    return ""


def _how(usual: Found, found: Found, choice: Choice) -> str:
    """Say how the signals came about, in one sentence."""
    if usual.is_exact and found.is_exact:
        return "This cycle is simulated, not interpolated."
    parts = []
    if found.between is not None:
        low, high = found.between
        parts.append(f"Interpolated between simulated severities of {low:g} and {high:g}.")
        if found.error is not None:
            error, change = found.error[choice.axis - 1], _change(usual, found, choice.axis)
            share = f", {error / change:.1%} of the change" if change > 0 else ""
            parts.append(
                f"In the middle between severities at least as far apart, the RMS error of the "
                f"torque of axis {choice.axis} was {error:.2g} N m{share}."
            )
        else:
            parts.append("The error is not known yet.")
    if usual.moved or found.moved:
        parts.append(
            "The change by temperature and payload is interpolated too, as that of a healthy robot."
        )
    return " ".join(parts)


def _change(usual: Found, found: Found, axis: int) -> float:
    """RMS change of the torque of an axis by the fault [N m]."""
    change = found.arrays["motor_torque"] - usual.arrays["motor_torque"]
    return float(np.sqrt(np.mean(change[:, axis - 1] ** 2)))

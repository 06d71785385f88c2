"""`faultgen.simulation.stepping` against an independent integration of the same robot."""

from __future__ import annotations

import copy
from functools import lru_cache

import mujoco
import numpy as np
import pytest
from independent import TOLERANCE, from_busy_move, integrate

from faultgen.robot import COULOMB, STICTION, Robot, load_robot
from faultgen.simulation.motion import Motion, plan
from faultgen.simulation.servo import control_signal
from faultgen.simulation.stepping import Cycle, simulate
from faultgen.tasks import load_task

SECONDS = 2.5
SAMPLE_PERIOD = 0.002
WORN_AXIS = 2
TIMES = np.arange(0, SECONDS, SAMPLE_PERIOD)


def motion_of(name: str) -> Motion:
    """The motion of pick_and_place, from a move of all axes on."""
    return from_busy_move(plan(load_task(name, "pick_and_place"), load_robot(name)), SECONDS)


def worn(robot: Robot) -> mujoco.MjModel:
    """The robot with half as much friction again on one axis."""
    model = copy.copy(robot.model)
    friction = robot.ids("actuator", "friction")[WORN_AXIS]
    model.actuator_biasprm[friction, [COULOMB, STICTION]] *= 1.5
    return model


def relative(error: np.ndarray, signal: np.ndarray) -> np.ndarray:
    """RMS of an error over the RMS of a signal, by axis, shape (n_axes,)."""
    return np.sqrt((error**2).mean(axis=0) / (signal**2).mean(axis=0))


ROBOTS = ["irb6700", pytest.param("puma560", marks=pytest.mark.slow)]


@lru_cache
def both(name: str, wear: bool) -> tuple[Cycle, Cycle]:
    """The first seconds of a motion as simulated, and as integrated independently."""
    motion = motion_of(name)
    model = worn(motion.robot) if wear else motion.robot.model
    step = model.opt.timestep
    control = control_signal(motion, step)
    # begin one step before the motion, at rest
    run = simulate(motion.robot, control, [model], sample_period=SAMPLE_PERIOD, lead_in=step)
    whole = next(run)
    cycle = Cycle(**{channel: values[: len(TIMES)] for channel, values in vars(whole).items()})
    return cycle, integrate(motion, model, TIMES, start=-step)


@pytest.mark.parametrize(
    "wear",
    [pytest.param(False, id="healthy", marks=pytest.mark.slow), pytest.param(True, id="worn")],
)
@pytest.mark.parametrize("name", ROBOTS)
def test_simulation_agrees(name: str, wear: bool) -> None:
    """At the model's own step torques agree within 0.5 % RMS on every axis.

    Velocity, which is logged half a step early, agrees within 0.2 %, positions within 0.005 %.
    """
    simulated, independent = both(name, wear)
    limits = {
        "motor_torque": 5e-3,
        "friction_torque": 5e-3,
        "gear_torque": 5e-3,
        "motor_velocity": 2e-3,
        "joint_velocity": 2e-3,
        "motor_position": 5e-5,
        "joint_position": 5e-5,
    }
    for channel, limit in limits.items():
        truth = getattr(independent, channel)
        offset = truth.mean(axis=0) if channel.endswith("position") else 0.0
        error = relative(getattr(simulated, channel) - truth, truth - offset)
        assert (error < limit).all(), f"{channel}: {error}"


@pytest.mark.parametrize("name", ROBOTS)
def test_wear_is_seen_alike(name: str) -> None:
    """The change of motor torque on the worn axis agrees within 1 % RMS."""
    torque = [[c.motor_torque[:, WORN_AXIS] for c in both(name, wear)] for wear in (False, True)]
    seen, change = np.subtract(torque[1], torque[0])
    assert relative(seen - change, change) < 0.01


@pytest.mark.parametrize("name", ROBOTS)
def test_independent_integration_has_converged(name: str) -> None:
    """A tenth of its tolerance changes the independent motor torque by less than 1e-4 RMS."""
    motion = motion_of(name)
    coarse = both(name, False)[1].motor_torque
    start = -motion.robot.model.opt.timestep
    fine = integrate(
        motion, motion.robot.model, TIMES, start=start, tolerance=TOLERANCE / 10
    ).motor_torque
    change = relative(coarse - fine, fine)
    assert (change < 1e-4).all(), change

"""Recordings of the small robot, as a controller would log them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.terms.candidates import applied
from faultgen.effects import get_effect
from faultgen.effects.temperature import set_temperature
from faultgen.recordings.recording import Recording
from faultgen.simulation.motion import plan
from faultgen.simulation.plant import assemble
from faultgen.simulation.servo import control_signal
from faultgen.simulation.stepping import simulate
from faultgen.tasks import load_task

NOISE = 0.01
"""Noise of the torque over its mean size."""
PERIOD = 0.004
"""Time between samples [s]."""


def logged(robot, changes, seconds, period):
    """What a robot logs of the start of `pick_and_place` with terms in it, without noise."""
    timestep = robot.model.opt.timestep
    motion = plan(load_task(robot.name, "pick_and_place"), robot)
    control = control_signal(motion, timestep)[: round(seconds / timestep)]
    plant = assemble(robot, applied(changes))
    (run,) = simulate(robot, control, [plant], sample_period=period, lead_in=0.0)
    return Recording(
        source="test",
        robot=robot.name,
        side="motor",
        sample_period=period,
        position=run.motor_position,
        torque=run.motor_torque,
        reference_position=motion(np.arange(len(run.motor_torque)) * period)[0],
    )


def record(robot, task, seed, effects=(), spread=0.01, noise=NOISE, temperature=None):
    """One run of a task. Its friction differs from that of other runs by `spread`.

    Friction follows a temperature that is given, by the law of the catalogue.
    """
    rng = np.random.default_rng(seed)
    motion = plan(load_task("tiny", task), robot)
    spec = robot.spec()
    for axis in (1, 2):
        get_effect("coulomb_friction").apply(spec, axis, spread * rng.standard_normal())
        if temperature is not None:
            set_temperature(spec, axis, temperature, robot.friction_temperature)
    for name, axis, severity in effects:
        get_effect(name).apply(spec, axis, severity)
    control = control_signal(motion, robot.model.opt.timestep)
    (run,) = simulate(robot, control, [spec.compile()], sample_period=PERIOD)
    clean = run.motor_torque
    drawn = rng.standard_normal(clean.shape)
    return Recording(
        source=f"run{seed}",
        robot="tiny",
        side="motor",
        sample_period=PERIOD,
        position=run.motor_position,
        torque=clean + noise * np.abs(clean).mean(axis=0) * drawn,
        reference_position=motion(np.arange(len(clean)) * PERIOD)[0],
        temperature=None if temperature is None else np.full(len(clean), float(temperature)),
    )


def record_cycle(robot, effects=(), seed=1):
    """One cycle of a PUMA, with noise of torque (1 %) and of position (1 mrad of the motor)."""
    motion = plan(load_task("puma560", "pick_and_place"), robot)
    way = motion(np.arange(round(motion.period / PERIOD)) * PERIOD)[0]
    planned = Recording.planned(robot, [way], PERIOD)
    worn = Replay(planned, robot.with_effects(effects), measured=False)
    rng = np.random.default_rng(seed)
    torque, position = worn.torque(), worn.position()
    return replace(
        planned,
        torque=torque + NOISE * np.abs(torque).mean(axis=0) * rng.standard_normal(torque.shape),
        position=position + 1e-3 * rng.standard_normal(position.shape),
        reference_position=way,
    )

"""Masses and friction of the robot, where its recording shows them better than the model.

An effect of which the torque is far from proportional acts at certain moments: a play is crossed
when the torque of the gearbox changes its sign. A model whose masses are wrong by 3 % crosses it
some 10 ms too early or too late, and what it foretells is then not what was measured. Discovery
with a baseline therefore begins with a model that was fitted to it.

    robot, told = with_own_numbers(healthy, robot)
"""

from __future__ import annotations

from dataclasses import replace

from faultgen.discovery.calibration.held_out import EQUAL, HeldOut
from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.rigid.drives import GAIN
from faultgen.discovery.rigid.physical import Physical, Spread, fit
from faultgen.discovery.rigid.regression import possible_regression
from faultgen.errors import SimulationFailed
from faultgen.recordings.recording import Recording
from faultgen.robot import Robot

_SCALES = (1.0, 10.0, 100.0)  # of priors, tried in turn: coarser than those of `calibrate`
_BETTER = 0.9  # torque error over that of the given model from which a fit is used: assumed


def with_own_numbers(healthy: Recording, robot: Robot) -> tuple[Robot, str]:
    """Fit inertias and friction of a model to a recording of the healthy robot.

    Args:
        healthy: The recording.
        robot: The model.

    Returns:
        The model, and a sentence about the fit. The given robot and an empty text if the fit does
        not predict motions that it was not made from clearly better, or if the unit of the torque
        is not known.
    """
    found = _fitted(healthy, robot)
    if found is None:
        return robot, ""
    made, before, after = found
    return made.robot, (
        "masses and friction of the model were fitted to the healthy recording, which lowers the "
        f"torque error of motions that were not fitted from {before:.4f} to {after:.4f}"
    )


def _fitted(
    recording: Recording, robot: Robot, replay: Replay | None = None
) -> tuple[Physical, float, float] | None:
    """The least change of a model that predicts about as well as classical identification.

    Torque constants stay, because a recording can hardly tell them from masses.

    Returns:
        The fit, and the torque errors of the model and of the fit on motions that were not fitted.
        None if the fit is not clearly better, or cannot be made.
    """
    if recording.constants is not None:
        return None
    modelled = replace(recording, torque=recording.torque * robot.torque_gain)
    held_out = HeldOut(recording, possible_regression(modelled, robot), replay)
    if not held_out.is_possible:
        return None
    regression = held_out.regression
    before = best = held_out.error_of(robot)
    chosen = None
    for scale in _SCALES:
        spread = Spread(scale, exclude=(GAIN,))
        try:
            error = held_out.error_of(fit(regression, held_out.products, spread).robot)
        except SimulationFailed:
            continue
        if error < best:
            best, chosen = error, spread
        if error <= EQUAL * held_out.classical:
            break
    if chosen is None or best > _BETTER * before:
        return None
    made = fit(regression, regression.products, chosen)
    try:
        last = held_out.error_of(made.robot)
    except SimulationFailed:
        return None
    return (made, before, best) if last <= _BETTER * before else None

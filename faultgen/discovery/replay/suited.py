"""Whether rotors that follow measured or commanded positions explain a recording better."""

from __future__ import annotations

import numpy as np

from faultgen.discovery.replay.followed import differences, unexplained
from faultgen.discovery.replay.replay import Replay, settled
from faultgen.discovery.replay.torque_error import relative_error
from faultgen.errors import SimulationFailed
from faultgen.recordings.recording import Recording
from faultgen.robot import Robot

_CLEARLY = 0.1
"""Squared torque error on commanded positions, over that on measured ones, up to which the
commanded ones are used; and its inverse, up to which they are used beside the measured ones.
Assumed: what smoothing of measured positions takes from a torque is known and allowed for, and the
servo of the model may be another one than that of the robot, which the torque error alone does not
show."""

_LINEAR = 0.1
"""RMS difference of two recordings over the RMS torque, up to which they are compared at their
commands. There, friction that differs much makes rotors stick and ring otherwise than a linear
signature says: with 20 to 40 % on development robots, gearboxes looked softer."""


def suited_replay(recording: Recording, robot: Robot) -> Replay:
    """Return the replay whose torque is nearer to the recorded one, see `suited_replays`.

    Args:
        recording: The measured data.
        robot: The model.
    """
    return suited_replays(recording, robot)[0]


def suited_replays(
    recording: Recording, robot: Robot, baseline: Recording | None = None
) -> tuple[Replay, Replay | None]:
    """Return the replay whose torque is nearer to the recorded one, and one on commands beside it.

    Measured positions need no servo. But their noise, differentiated twice, can be much larger than
    all that a servo does. This shows in the torque: see `followed.unexplained`. Two recordings of
    one program have the same commands, so that no model has a part in the difference of their
    torques.

    Args:
        recording: The measured data.
        robot: The model.
        baseline: The recording with which it is compared.

    Returns:
        The replay on measured positions, or on commanded ones if they were recorded and explain the
        torque clearly better; with a baseline that differs little, unless they explain it clearly
        worse. Beside measured ones, the replay on commanded ones, unless these explain the torque
        clearly worse.
    """
    measured = Replay(recording, robot)
    if recording.reference_position is None or recording.link:
        return measured, None
    commanded = Replay(recording, robot, measured=False)
    inside = settled(recording, robot)
    speed = differences(recording, commanded.wanted)[0]

    def error(replay: Replay) -> float:
        try:
            return unexplained(recording, speed, replay.torque(), inside, scaled=False)
        except SimulationFailed:
            return np.inf

    of_commanded, of_measured = error(commanded), error(measured)
    follows = _CLEARLY * of_commanded < of_measured
    alike = False
    if baseline is not None and baseline.reference_position is not None:
        squared = (recording.torque - baseline.torque) ** 2
        alike = relative_error(squared, recording, inside) < _LINEAR
    if of_commanded < _CLEARLY * of_measured or (follows and alike):
        return commanded, None
    return measured, commanded if follows else None

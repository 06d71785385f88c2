"""A recorded motion, simulated once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.terms.candidates import Term
from faultgen.recordings.recording import Recording
from faultgen.robot import Robot


def replay(
    recording: Recording,
    robot: Robot,
    effects: Sequence[tuple[str, int, float]] = (),
    *,
    measured: bool = True,
) -> np.ndarray:
    """Torque of a robot with effects (name, axis, severity), on the recording's side."""
    changes = [(Term(name, axis, 0.0, 0.0), severity) for name, axis, severity in effects]
    return Replay(recording, robot, measured=measured).torque(changes)

"""What a recording of a healthy robot tells of the numbers of its model."""

from __future__ import annotations

import numpy as np

from faultgen.discovery.decision.near import fitted_numbers
from faultgen.discovery.decision.posterior import Posterior
from faultgen.discovery.replay.suited import suited_replay
from faultgen.errors import InputError, SimulationFailed
from faultgen.recordings.recording import Recording
from faultgen.robot import Robot


def posterior_of(recording: Recording, robot: Robot) -> Posterior | None:
    """Compute means and covariance of the numbers of a model, given a recording.

    Args:
        recording: A recording of the healthy robot.
        robot: The model, which was calibrated with it.

    Returns:
        They; None if torques do not follow from the recorded motion, or cannot be simulated on it.
    """
    replay = suited_replay(recording, robot)
    if not replay.measured:
        return None
    try:
        difference = fitted_numbers(replay, np.ones(len(recording.torque), bool))
    except (InputError, SimulationFailed):
        return None
    fitted, numbers = difference.exact.healthy, difference.numbers
    told = {one: k for k, n in enumerate(numbers.known) if (one := numbers.which[n]) is not None}
    own = list(told.values())
    return Posterior(tuple(told), fitted.values[own], fitted.covariance[np.ix_(own, own)])

"""Which positions the model follows: the commanded ones, or the measured ones.

The model's servo follows the commanded positions. If the servo of the robot is another one, it
does not make the same motion and torque of them, and the model had better follow the measured
positions. One simulation of each kind shows it. Before the two are compared, everything that a
rigid arm with other links, rotors and friction can explain is taken away: such errors are the same
for both, and they may be much larger than those of the servo.

    replay, why = suited_replay(recording, robot)
"""

from __future__ import annotations

import numpy as np

from faultgen.discovery.replay.followed import differences
from faultgen.discovery.replay.replay import Replay, relative_error, settled
from faultgen.discovery.rigid.regressor import gear_regressor
from faultgen.errors import SimulationFailed
from faultgen.recordings.recording import Recording
from faultgen.robot import STRIBECK_VELOCITY, Robot
from faultgen.simulation.arm import Arm

_BETTER = 0.8  # torque error, over that with commanded positions, from which others are followed
_SAMPLES = 2000  # of a recording, at which the errors are compared
_RANK = 1e-4  # smallest singular value that counts, over the largest: assumed


def suited_replay(
    recording: Recording, robot: Robot, inside: np.ndarray | None = None
) -> tuple[Replay, str]:
    """Choose the positions that the model follows.

    Args:
        recording: The measured data.
        robot: The model.
        inside: Samples whose torque will be compared, shape (samples, n_axes). None: those of
            `settled`.

    Returns:
        The replay, and a sentence that states the choice and the reason.

    Raises:
        SimulationFailed: The model diverges on the recorded motion.
    """
    measured = Replay(recording, robot, measured=True)
    if recording.reference_position is None:
        return measured, (
            "the model follows the measured positions, smoothed according to their noise, "
            "because the recording has no reference_position"
        )
    commanded = Replay(recording, robot, measured=False)
    if inside is None or not inside.any():
        inside = settled(recording, robot)
    errors = _errors((commanded, measured), inside)
    if not np.isfinite(min(errors)):
        raise SimulationFailed("the model diverges on the recorded motion")
    told = (
        "torque error that no other masses and friction explain: "
        f"{errors[0]:.4f} with the commanded, {errors[1]:.4f} with the measured positions"
    )
    if errors[1] < _BETTER * errors[0]:
        return measured, (
            "the model follows the measured positions, because its servo differs from that of "
            f"the robot ({told})"
        )
    return commanded, f"the model's servo follows the commanded positions ({told})"


def _errors(replays: tuple[Replay, Replay], inside: np.ndarray) -> list[float]:
    """Relative torque error of each replay without what a rigid arm explains.

    Args:
        replays: The model on the commanded, and on the measured positions.
        inside: Samples whose torque is compared, shape (samples, n_axes).
    """
    recording, robot = replays[0].recording, replays[0].robot
    rows = np.flatnonzero(inside.any(axis=1))
    rows = rows[:: max(1, len(rows) // _SAMPLES)]
    columns = rigid_columns(replays[1], rows)
    errors = []
    for replay in replays:
        try:
            left = recording.torque - replay.torque()
        except SimulationFailed:
            errors.append(np.inf)
            continue
        square = np.zeros_like(left)
        for axis in range(robot.n_axes):
            own = inside[rows, axis]
            at, target = rows[own], left[rows[own], axis]
            fitted = columns[own, axis] @ _least_squares(columns[own, axis], target)
            square[at, axis] = (target - fitted) ** 2
        compared = np.zeros_like(inside)
        compared[rows] = inside[rows]
        errors.append(relative_error(square, recording, compared))
    return errors


def rigid_columns(replay: Replay, rows: np.ndarray) -> np.ndarray:
    """Compute the torque of each gearbox for each parameter of a rigid arm, on the measured motion.

    Args:
        replay: The model on the measured positions.
        rows: Indices of the samples.

    Returns:
        Shape (rows, n_axes, parameters): the parameters of `link_parameters`, per unit, in [N m],
        and then shapes of the drive's torque, without unit.
    """
    robot = replay.robot
    speed, acceleration = (x[rows] for x in differences(replay.recording, replay.wanted))
    links = gear_regressor(Arm(robot), replay.wanted[rows], speed, acceleration)
    speed, acceleration = robot.gearing.outputs(speed), robot.gearing.outputs(acceleration)
    width = robot.model.actuator_biasprm[robot.ids("actuator", "friction"), STRIBECK_VELOCITY]
    slow = speed * robot.gear_ratio / np.where(width > 0, width, 1.0)
    drive = [acceleration, np.sign(speed), speed, np.ones_like(speed)]
    drive.append(np.sign(speed) * np.exp(-(slow**2)))
    return np.concatenate([links, np.stack(drive, axis=2)], axis=2)


def _least_squares(columns: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Values of parameters, of which some are combinations of others."""
    size = np.linalg.norm(columns, axis=0)
    scale = np.where(size > 0, size, 1.0)
    return np.asarray(np.linalg.lstsq(columns / scale, target, rcond=_RANK)[0] / scale)

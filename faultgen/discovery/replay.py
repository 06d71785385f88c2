"""What the model would have measured: a recorded motion, simulated closed loop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from faultgen.discovery.recording import Recording
from faultgen.effects import Applied
from faultgen.machine import assemble
from faultgen.robot import Robot
from faultgen.servo import control_signal
from faultgen.simulate import simulate

SETTLING = 0.3
"""Time that the simulation needs to settle after an axis begins to turn [s]: assumed."""

TURN = 0.2
"""Motor angle after which friction has forgotten how the axis came to rest [rad]: assumed, some ten
times the reach of the bristles."""

Effects = Sequence[tuple[str, int, float]]
"""Name, axis from 1, severity."""


@dataclass(frozen=True, eq=False)
class _Motion:
    """A recorded reference as a motion, by cubic splines through its samples."""

    robot: Robot
    period: float
    spline: CubicSpline

    def __call__(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return self.spline(times), self.spline(times, 1), self.spline(times, 2)


def replay(recording: Recording, robot: Robot, effects: Effects = ()) -> np.ndarray:
    """Simulate the recorded motion with effects in the model.

    The commanded positions are tracked by the model's own servo; where they were not recorded, the
    measured ones stand in for them.

    Args:
        recording: The measured data.
        robot: The model without the effects.
        effects: Effects to put into it.

    Returns:
        Torque that would have been measured, on the recording's side, shape (samples, n_axes).

    Raises:
        InputError: No such effect or axis.
        SimulationFailed: The simulation diverged.
    """
    machine = assemble(robot, [Applied(*effect) for effect in effects])
    ratio = robot.gear_ratio
    reference = recording.reference_position
    if reference is None:
        reference = recording.position / (ratio if recording.side == "motor" else 1.0)
    torque = np.empty_like(recording.torque)
    timestep = robot.model.opt.timestep
    for part in recording.parts:
        count = part.stop - part.start
        times = np.arange(count) * recording.sample_period
        motion = _Motion(robot, times[-1] + timestep, CubicSpline(times, reference[part]))
        control = control_signal(motion, timestep)  # type: ignore[arg-type]
        (run,) = simulate(robot, control, [machine], sample_period=timestep, lead_in=0.0)
        simulated = np.arange(len(run.motor_torque)) * timestep
        for axis in range(robot.n_axes):
            torque[part, axis] = np.interp(times, simulated, run.motor_torque[:, axis])
    return torque if recording.side == "motor" else torque * ratio


def relative_error(square: np.ndarray, recording: Recording, inside: np.ndarray) -> float:
    """RMS error over RMS torque, root mean square over the axes.

    Args:
        square: Squared error of each sample, or of each axis; shape (samples, n_axes) or (n_axes,).
        recording: Where the torque is taken from.
        inside: Samples that count, shape (samples, n_axes).
    """
    torque = (np.where(inside, recording.torque, 0.0) ** 2).sum(axis=0)
    wrong = np.where(inside, square, 0.0).sum(axis=0)
    seen = torque > 0
    return float(np.sqrt(np.mean(wrong[seen] / torque[seen])))


def settled(recording: Recording, robot: Robot) -> np.ndarray:
    """Samples that a replay can be compared at, as a mask of shape (samples, n_axes).

    At rest the torque of an axis depends on how it came to rest, which the recording does not tell;
    an axis counts from `SETTLING` after it has turned its motor by `TURN` in a separate recording.
    """
    ratio = np.abs(robot.gear_ratio) if recording.side == "joint" else np.ones(robot.n_axes)
    skipped = round(SETTLING / recording.sample_period)
    mask = np.zeros(recording.position.shape, bool)
    for part in recording.parts:
        turned = np.abs(recording.position[part] - recording.position[part.start]) * ratio > TURN
        for axis in np.flatnonzero(turned.any(axis=0)):
            first = part.start + int(np.argmax(turned[:, axis])) + skipped
            mask[first : part.stop, axis] = True
    return mask

"""Features of a recording of one program: its whitened torque in short windows.

program = Program(motion, noise, window)
program.features(cycle)  # shape (features,)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from faultgen.discovery.decision.numbers import KINDS, Numbers
from faultgen.recordings.noise import ORDER
from faultgen.recordings.noise_level import Noise, levelled
from faultgen.recordings.recording import Recording
from faultgen.twin.alignment import KnownMotion

WINDOW = 0.064
"""Time over which whitened torques are averaged [s]. A model does not predict faster changes, such
as the swinging of gearboxes, to less than their own size: with 16 to 64 ms, simulated play looks
like that of robots of another simulator (correlation 0.8 to 0.9); without windows, 0.3 to 0.7."""


@dataclass(frozen=True, eq=False)
class Program:
    """A known motion, with the noise of its torque."""

    motion: KnownMotion
    """The motion."""
    noise: Noise
    """Noise of the torque at the places that are compared."""
    window: int
    """Places in each window."""

    @property
    def parts(self) -> list[slice]:
        """Each stretch of the motion, among the places that are compared."""
        return parts_of(self.motion)

    def whiten(self, torque: np.ndarray) -> np.ndarray:
        """Compute features of torques at the places that are compared.

        Args:
            torque: Shape (..., places, n_axes), in [N m].

        Returns:
            Shape (..., features). The noise has a variance of 1 in each.
        """
        white = self.noise.whiten(np.asarray(torque, float), self.parts)
        found = []
        for part in self.parts:
            own = white[..., part, :]
            count = own.shape[-2] // self.window
            own = own[..., : count * self.window, :]
            own = own.reshape(*own.shape[:-2], count, self.window, own.shape[-1])
            found.append(own.mean(axis=-2) * np.sqrt(self.window))
        together = np.concatenate(found, axis=-2)
        return together.reshape(*together.shape[:-2], -1)

    def features(self, cycle: np.ndarray) -> np.ndarray:
        """Compute the features of a cycle, or of the mean of some.

        Args:
            cycle: Torque of the motors over the whole motion, shape (samples, n_axes), in [N m].

        Returns:
            Shape (features,).
        """
        return self.whiten(cycle[self.motion.compared])


def parts_of(motion: KnownMotion) -> list[slice]:
    """Return the stretches of a motion, as places among those that are compared.

    Args:
        motion: The motion.
    """
    ends = np.cumsum([0, *(end - start for start, end in motion.stretches)]).tolist()
    return [slice(a, b) for a, b in zip(ends[:-1], ends[1:], strict=True)]


def as_recording(motion: KnownMotion, torque: np.ndarray, robot: str) -> Recording:
    """Return what a healthy robot does as a recording.

    Args:
        motion: The motion.
        torque: Mean torque of its motors at the places that are compared, shape (places, n_axes).
        robot: Name of the robot.
    """
    return Recording(
        source="the healthy recordings",
        robot=robot,
        side="motor",
        sample_period=motion.sample_period,
        position=motion.path[motion.compared] * motion.gear_ratio,
        torque=torque,
        segments=tuple(part.start for part in parts_of(motion)),
    )


def program_of(
    motion: KnownMotion,
    torque: np.ndarray,
    numbers: Numbers,
    drivers: Sequence[np.ndarray],
    *,
    of_model: bool = False,
) -> Program:
    """Learn the noise of a program.

    Args:
        motion: The motion.
        torque: Of healthy recordings at the places that are compared, shape (recordings, places,
            n_axes), in [N m], at least two.
        numbers: What may differ from day to day.
        drivers: Quantities with which the noise may grow, shape (places, n_axes) each.
        of_model: Whether a recording is compared with its model, and not with other recordings.

    Returns:
        The program.
    """
    count = len(torque)
    apart = (torque - torque.mean(axis=0)) * np.sqrt(count / (count - 1))
    std = np.array(numbers.std)
    if of_model:
        std = std / np.array([KINDS[kind].days for kind in numbers.kinds])
    left = _without_days(apart, numbers, std)
    places, n_axes = torque.shape[1:]
    parts = [
        slice(k * places + part.start, k * places + part.stop)
        for k in range(count)
        for part in parts_of(motion)
    ]
    together = left.reshape(-1, n_axes)
    repeated = [np.tile(np.abs(driver), (count, 1)) for driver in drivers]
    noise = levelled(together, np.ones(together.shape, bool), parts, repeated, ORDER)
    level = np.sqrt(np.mean(noise.level.reshape(count, places, n_axes) ** 2, axis=0))
    window = max(1, round(WINDOW / motion.sample_period))
    shortest = min(part.stop - part.start for part in parts_of(motion))
    return Program(motion, Noise(noise.colour, level), min(window, max(1, shortest // 2)))


def _without_days(apart: np.ndarray, numbers: Numbers, std: np.ndarray) -> np.ndarray:
    """What differences from day to day leave: noise, shape (recordings, places, n_axes)."""
    left = np.zeros_like(apart)
    columns = np.array(numbers.columns, float)
    for axis in range(apart.shape[2]):
        own = columns[:, :, axis].any(axis=1)
        design = columns[own, :, axis].T * std[own]
        target = apart[:, :, axis].T
        # the noise, from its changes between neighbours: enough to weigh data against `std`
        deviation = np.median(np.abs(np.diff(target, axis=0))) / (0.6745 * np.sqrt(2))
        inner = design.T @ design + max(deviation**2, 1e-12) * np.eye(design.shape[1])
        left[:, :, axis] = (target - design @ np.linalg.solve(inner, design.T @ target)).T
    return left

"""A recording beside a model: what is to be explained, by which terms, on which samples.

division = division_of(replay, baseline=False)
division.fitting
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from faultgen.discovery.replay.replay import Changes, Replay
from faultgen.discovery.replay.samples import counted, cut, divided, enough, samples_of
from faultgen.discovery.terms.candidates import Term
from faultgen.errors import InputError, SimulationFailed
from faultgen.recordings.noise_level import Noise
from faultgen.recordings.recording import Recording
from faultgen.robot import Robot


@dataclass(frozen=True, eq=False)
class Kinematics:
    """Measured motion, motor side. Arrays have shape (samples, n_axes)."""

    position: np.ndarray
    """[rad]."""
    velocity: np.ndarray
    """Smoothed [rad/s]."""
    acceleration: np.ndarray
    """Smoothed [rad/s^2]."""


@dataclass(frozen=True, eq=False)
class Division:
    """Samples that are compared, and the parts of a recording."""

    inside: np.ndarray
    """Samples that are compared, shape (samples, n_axes)."""
    parts: list[slice]
    """Separate recordings, or blocks of a single one."""
    scoring: list[int]
    """Parts that are used neither for fitting nor for the choice of effects."""

    @property
    def fitting(self) -> list[int]:
        """Parts that are used for fitting and for the choice of effects."""
        return [p for p in range(len(self.parts)) if p not in self.scoring]

    def samples(self, parts: Sequence[int]) -> np.ndarray:
        """Find the samples of some parts.

        Args:
            parts: Indices of the parts.

        Returns:
            Whether each sample belongs to one of them. Shape (samples,).
        """
        return samples_of([self.parts[p] for p in parts], len(self.inside))

    @property
    def folds(self) -> list[slice]:
        """Periods of the parts for fitting, each of which may be foretold from all others."""
        return divided([self.parts[p] for p in self.fitting])


def division_of(replay: Replay, *, baseline: bool) -> Division:
    """Divide a recording into parts, some of which are kept for scoring.

    Args:
        replay: The recording and the model.
        baseline: Whether the recording is compared with another recording.

    Returns:
        The division.

    Raises:
        InputError: Too little of the recording can be used.
    """
    recording, robot = replay.recording, replay.robot
    inside = counted(recording, robot, baseline=baseline)
    if replay.left_out is not None:
        inside &= ~replay.left_out
    parts, scoring = cut(recording, robot, inside)
    inside = enough(inside, parts)
    if not inside[samples_of([parts[p] for p in scoring], len(inside))].any():
        raise InputError(f"{recording.source}: too little moves to keep a fifth of it for scoring")
    return Division(inside, parts, scoring)


@dataclass(frozen=True, eq=False)
class Problem(Division):
    """A residual and the terms that may explain it.

    Arrays of samples have shape (samples, n_axes).
    """

    replay: Replay
    """The recording and the model on which effects are simulated."""
    commanded: Replay | None
    """The same model, whose servo follows the commands, for terms that are `Term.commanded`."""
    given: Replay
    """The recording and the model as it was given, which may have other links; see `near_model`.
    The residual and the values of all terms count from there."""
    terms: list[Term]
    """All terms, with the standard deviations of a comparison with a model."""
    base: np.ndarray
    """Torque of the unchanged model."""
    residual: np.ndarray
    """Torque that is to be explained."""
    raw: np.ndarray
    """Change of the torque per unit of each term, shape (terms, samples, n_axes)."""
    noise: Noise
    """Noise of the residual."""
    baseline: bool
    """Whether the residual is the difference of two recordings."""
    shared: np.ndarray
    """Axes on which the two recordings have the same noise, which cancels in their difference;
    shape (n_axes,)."""

    @property
    def recording(self) -> Recording:
        """The recording."""
        return self.replay.recording

    @property
    def robot(self) -> Robot:
        """The model."""
        return self.replay.robot

    @cached_property
    def motion(self) -> Kinematics:
        """Measured motion, smoothed."""
        position = self.recording.motor_position(self.robot)
        _, velocity, acceleration = self.recording.derivatives(position)
        return Kinematics(position, velocity, acceleration)

    def change(self, effects: Changes) -> np.ndarray | None:
        """Simulate by how much effects change the torque.

        Args:
            effects: Terms, without any of links, and values.

        Returns:
            Shape (samples, n_axes), in the unit of the recording's torque, or None if the
            simulation diverges.
        """
        return self._with_commanded(effects, lambda own: self.replay.torque(own) - self.base)

    def _with_commanded(
        self, effects: Changes, simulate: Callable[[Changes], np.ndarray]
    ) -> np.ndarray | None:
        """Change by effects, of which some are simulated on commands."""
        kicks = [one for one in effects if one[0].commanded]
        own = [one for one in effects if not one[0].commanded]

        def change() -> np.ndarray:
            made = simulate(own) if own or not kicks else np.zeros_like(self.base)
            if kicks:
                assert self.commanded is not None
                made = made + self.commanded.torque(kicks) - self._commanded_torque
            return made

        return _finite(change)

    @cached_property
    def _commanded_torque(self) -> np.ndarray:
        """Torque of the unchanged model whose servo follows the commands."""
        assert self.commanded is not None
        return self.commanded.torque()

    def change_of_given(self, changes: Changes) -> np.ndarray | None:
        """Simulate by how much changes of the given model change its torque.

        Args:
            changes: Terms and values, also of links.

        Returns:
            Shape (samples, n_axes), as for `change`, or None if the simulation diverges.
        """
        if self.given is self.replay:
            return self.change(changes)
        given_torque = self.recording.torque - self.residual  # there is no baseline
        return self._with_commanded(changes, lambda own: self.given.torque(own) - given_torque)

    def whiten(self, x: np.ndarray) -> np.ndarray:
        """Whiten torques, and mask samples that are not compared.

        Args:
            x: Torques. Shape (..., samples, n_axes), in the unit of the recording's torque.

        Returns:
            The array in standard deviations of the noise. Same shape.
        """
        return self.noise.whiten(x, self.parts) * self.inside.astype(x.dtype)

    def whiten_axis(self, x: np.ndarray, axis: int) -> np.ndarray:
        """Whiten torques of one axis, and mask samples that are not compared.

        Args:
            x: Shape (..., samples), in the unit of the recording's torque.
            axis: Axis, from 1.

        Returns:
            Same shape as x, as from `whiten`.
        """
        inside = self.inside[:, axis - 1].astype(x.dtype)
        return self.noise.whiten_axis(x, axis, self.parts) * inside


def _finite(simulated: Callable[[], np.ndarray]) -> np.ndarray | None:
    """What a simulation gives, or None if it diverges."""
    try:
        torque = simulated()
    except SimulationFailed:
        return None
    return torque if np.isfinite(torque).all() else None

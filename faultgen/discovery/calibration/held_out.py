"""Models judged on the parts of a recording to which they were not fitted.

held_out = HeldOut(recording, Regression(recording, robot))
made = fit(held_out.regression, held_out.products, spread).robot
held_out.error_of(made) < EQUAL * held_out.classical
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from faultgen.discovery.calibration.compared import Compared, compared
from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.replay.samples import samples_of
from faultgen.discovery.replay.torque_error import relative_error
from faultgen.discovery.rigid.base_parameters import identify
from faultgen.discovery.rigid.regression import Regression
from faultgen.errors import InputError, SimulationFailed
from faultgen.recordings.recording import Recording
from faultgen.robot import Robot

EQUAL = 1.05
"""Ratio of two errors up to which their difference may be chance: assumed."""


def judging(count: int) -> list[int]:
    """Blocks on which the models are judged: every third, so that they differ as the motion does.

    Args:
        count: Number of blocks.

    Returns:
        Their numbers, from 0; at least one of them.
    """
    return list(range(count))[1::3] or [count - 1]


class HeldOut:
    """A recording of which some blocks are fitted, and the others judge the fit."""

    def __init__(
        self, recording: Recording, regression: Regression, replay: Replay | None = None
    ) -> None:
        """Divide the blocks.

        Args:
            recording: The measured data.
            regression: The regression of the recording. Its torque may have another unit.
            replay: Of the recording and its model on measured positions, if there is one already.
        """
        self.recording = recording
        self._replay = replay
        self.regression = regression
        self.scoring = judging(len(regression.parts))
        """Numbers of the blocks that judge."""
        self.fitting = [k for k in range(len(regression.parts)) if k not in self.scoring]
        """Numbers of the others."""
        self.products = regression.products.only(self.fitting)
        """Their inner products."""
        rows = samples_of([regression.parts[k] for k in self.scoring], len(recording.torque))
        self.judged = regression.inside & rows[:, None]
        """Samples that judge, shape (samples, n_axes)."""

    @property
    def is_possible(self) -> bool:
        """Whether both kinds of blocks have samples."""
        scored = self.regression.products.only(self.scoring)
        return bool(self.products.count.sum() and scored.count.sum())

    @cached_property
    def classical_torque(self) -> np.ndarray:
        """Torque by classical identification, in the unit of the regression's recording.

        Returns:
            Shape (samples, n_axes).
        """
        return self.regression.torque(identify(self.products))

    @cached_property
    def classical(self) -> float:
        """Relative torque error of classical identification."""
        return self._error(self.regression.recording, self.classical_torque)

    def against_classical(self, torque: np.ndarray) -> Compared:
        """Compare a predicted torque with that of classical identification, axis by axis.

        Args:
            torque: What was predicted, in the unit of the recording, shape (samples, n_axes).
        """
        of_classical = _relative(self.regression.recording, self.classical_torque)
        return self._compared(torque, of_classical)

    def against(self, torque: np.ndarray, other: np.ndarray) -> Compared:
        """Compare two predicted torques axis by axis.

        Args:
            torque: What was predicted, in the unit of the recording, shape (samples, n_axes).
            other: The same by another model.
        """
        return self._compared(torque, _relative(self.recording, other))

    def _compared(self, torque: np.ndarray, other: np.ndarray) -> Compared:
        parts = [self.regression.parts[k] for k in self.scoring]
        error = _relative(self.recording, torque)
        return compared(error, other, self.judged, parts, self.recording.sample_period)

    def error(self, torque: np.ndarray) -> float:
        """Compute the relative error of a predicted torque.

        Args:
            torque: What was predicted, in the unit of the recording, shape (samples, n_axes).

        Returns:
            RMS error over RMS torque; infinite if the prediction is not finite.
        """
        return self._error(self.recording, torque)

    def error_of(self, model: Robot) -> float:
        """Compute the relative torque error of a model that is simulated on the recorded motion.

        Args:
            model: The model.

        Returns:
            RMS error over RMS torque; infinite if the simulation diverges.
        """
        return self.error(self.torque_of(model))

    def torque_of(self, model: Robot) -> np.ndarray:
        """Simulate a model on the recorded motion.

        Args:
            model: The model.

        Returns:
            Torque in the unit of the recording, shape (samples, n_axes); not a number if the
            simulation diverges.
        """
        known = self._replay
        try:
            if known is None or known.robot is not model:
                known = Replay(self.recording, model)
            return known.torque()
        except (InputError, SimulationFailed):
            return np.full(self.recording.torque.shape, np.nan)

    def _error(self, recording: Recording, torque: np.ndarray) -> float:
        if not np.isfinite(torque).all():
            return float("inf")
        return relative_error((recording.torque - torque) ** 2, recording, self.judged)


def _relative(recording: Recording, torque: np.ndarray) -> np.ndarray:
    """Error of a torque over the RMS torque of its axis, shape (samples, n_axes)."""
    size = np.sqrt(np.mean(recording.torque**2, axis=0))
    return np.asarray((recording.torque - torque) / np.where(size > 0, size, np.inf))

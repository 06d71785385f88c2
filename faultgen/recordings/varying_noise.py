"""Noise whose colour changes with time: another autoregression in each short frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_toeplitz

from faultgen.recordings.block_filter import block_filter, blocks_of


@dataclass(frozen=True, eq=False)
class VaryingNoise:
    """Noise of each axis, x_t = sum of a_k x_(t-k) + e_t, in frames."""

    coefficients: np.ndarray
    """The a_k, shape (frames, order, n_axes)."""
    gain: np.ndarray
    """What innovations are multiplied by, shape (frames, n_axes): noise of white sensors keeps its
    size."""
    growth: np.ndarray
    """Deviation of the noise over that of its innovations times `gain`, shape (frames, n_axes)."""
    frame: np.ndarray
    """Frame of each sample, shape (samples,)."""

    @classmethod
    def of_covariances(
        cls, covariances: np.ndarray, white: np.ndarray, frame: np.ndarray
    ) -> VaryingNoise:
        """Find the autoregressions of noise with given autocovariances.

        Args:
            covariances: Over delays of 0 to the order, of what is added to the white noise of the
                sensors; shape (frames, order + 1, n_axes), in the square of any unit.
            white: Variance of the white noise, shape (frames, n_axes), in the same unit.
            frame: Frame of each sample, shape (samples,).

        Returns:
            The noise. Source: equations of Yule and Walker.
        """
        frames, longer, axes = covariances.shape
        out = cls(
            np.zeros((frames, longer - 1, axes)), np.ones(white.shape), np.ones(white.shape), frame
        )
        for k in range(frames):
            for axis in range(axes):
                own = covariances[k, :, axis].copy()
                if white[k, axis] <= 0 or own[0] <= 0:
                    continue
                own[0] += white[k, axis]
                a = solve_toeplitz(own[:-1], own[1:])
                out.coefficients[k, :, axis] = a
                out.gain[k, axis] = np.sqrt(white[k, axis] / (own[0] - a @ own[1:]))
                out.growth[k, axis] = np.sqrt(own[0] / white[k, axis])
        return out

    def whiten(self, x: np.ndarray, parts: Sequence[slice]) -> np.ndarray:
        """Compute innovations, in the size of the noise of the sensors.

        Args:
            x: Shape (..., samples, n_axes), in the unit of the noise.
            parts: Samples of each separate recording.

        Returns:
            Same shape and unit. Before the first sample of a part, x is taken as 0.
        """
        blocks, out = blocks_of(parts, self.frame), np.empty_like(x)
        frame = self.frame[blocks.start]
        for axis in range(x.shape[-1]):
            own = -self.coefficients[frame, :, axis]
            taps = self.gain[frame, axis, None] * np.insert(own, 0, 1.0, axis=1)
            out[..., axis] = block_filter(x[..., axis], blocks, taps)
        return out

    def of_axis(self, axis: int) -> VaryingNoise:
        """Return the noise of one axis, counted from 1."""
        own = slice(axis - 1, axis)
        return VaryingNoise(
            self.coefficients[..., own], self.gain[:, own], self.growth[:, own], self.frame
        )

    def without(self, axes: np.ndarray) -> VaryingNoise:
        """Return the noise with white noise on some axes.

        Args:
            axes: A mask of shape (n_axes,).

        Returns:
            The noise.
        """
        return VaryingNoise(
            np.where(axes, 0.0, self.coefficients),
            np.where(axes, 1.0, self.gain),
            np.where(axes, 1.0, self.growth),
            self.frame,
        )

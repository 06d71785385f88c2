"""Noise of a logged torque whose size may change with the motion, the speed or the load.

noise = draw_noise("by_motion", 0.01, rms, n_motions=2, sample_period=0.004, rng=rng)
seen = torque + noise.sample(noise.scale(torque, speed, motion=0), rng)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from laboratories.real_noise import colour, draw_series
from scipy.signal import lfilter

KINDS = ("constant", "by_motion", "by_speed", "by_load", "coloured", "quantised", "outliers")
"""Kinds of noise; `draw_noise` says what each of them is."""
REAL = "real"
"""Kind whose noise is taken from recordings of real machines, see `real_noise`."""
_BLOCK = 0.5  # blocks of real noise [s]: several times its memory
_FAR = (8.0, 20.0)  # size of an outlier, in standard deviations of the noise


@dataclass(frozen=True, kw_only=True)
class TorqueNoise:
    """Noise of one laboratory. Arrays have shape (n_axes,) where nothing else is said."""

    kind: str
    level: np.ndarray
    """Standard deviation on a motion of average speed and load [N m]."""
    rms_torque: np.ndarray
    """RMS of the torque [N m]."""
    rms_speed: np.ndarray
    """RMS of the motor speed [rad/s]."""
    by_motion: np.ndarray
    """Factor of each motion, shape (n_motions,)."""
    share: np.ndarray
    """Share of the variance that is first-order autoregressive."""
    memory: np.ndarray
    """Correlation of the autoregressive part from sample to sample."""
    step: np.ndarray
    """Resolution of the logged torque [N m]."""
    outliers: float
    """Share of samples that are outliers."""
    bank: tuple[np.ndarray, ...] = ()
    """Residuals of a real machine with unit variance, one array for each axis."""
    block: int = 0
    """Samples of `bank` that stay together."""

    def scale(self, torque: np.ndarray, speed: np.ndarray, motion: int) -> np.ndarray:
        """Compute the standard deviation of the noise along a motion.

        Args:
            torque: Torque without noise [N m], shape (samples, n_axes).
            speed: Motor speed [rad/s], same shape.
            motion: Number of the motion, from 0.

        Returns:
            Standard deviation [N m], same shape.
        """
        size = np.ones_like(torque)
        if self.kind == "by_speed":
            size = 0.3 + 0.9 * np.abs(speed) / self.rms_speed
        elif self.kind == "by_load":
            size = 0.3 + 0.8 * np.abs(torque) / self.rms_torque
        return self.level * self.by_motion[motion] * size

    def sample(self, scale: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Draw noise.

        Args:
            scale: From `scale`.
            rng: Source of randomness.

        Returns:
            Noise [N m], same shape.
        """
        if self.bank:
            return scale * self._from_bank(len(scale), rng)
        white, kicks = rng.standard_normal((2, *scale.shape))
        for axis, memory in enumerate(self.memory):
            kicks[1:, axis] *= np.sqrt(1 - memory**2)
            kicks[:, axis] = lfilter([1.0], [1.0, -memory], kicks[:, axis])
        unit = np.sqrt(1 - self.share) * white + np.sqrt(self.share) * kicks
        if self.outliers:
            hit = rng.random(scale.shape) < self.outliers
            unit += hit * rng.uniform(*_FAR, scale.shape) * rng.choice([-1.0, 1.0], scale.shape)
        return scale * unit

    def _from_bank(self, samples: int, rng: np.random.Generator) -> np.ndarray:
        """Blocks of the residuals one after another, shape (samples, n_axes)."""
        out = np.empty((samples, len(self.bank)))
        for axis, series in enumerate(self.bank):
            length = min(self.block, len(series))
            for start in range(0, samples, length):
                at = int(rng.integers(len(series) - length + 1))
                part = series[at : at + min(length, samples - start)]
                out[start : start + length, axis] = part * rng.choice([-1.0, 1.0])
        return out

    def logged(self, torque: np.ndarray) -> np.ndarray:
        """Round torques to the resolution of the log [N m], shape (samples, n_axes)."""
        return np.round(torque / self.step) * self.step

    def whitened(self, change: np.ndarray, scale: np.ndarray) -> np.ndarray:
        """Divide a change of torque by the noise: the spectrum of the noise becomes flat.

        Args:
            change: A change of torque along one motion [N m], shape (samples, n_axes).
            scale: From `scale`.

        Returns:
            The same in units of the noise, same shape. The norm is d' of a matched filter.
        """
        # rounding adds white noise of step^2 / 12; outliers leave the other samples as they are
        scale = np.sqrt(scale**2 + self.step**2 / 12)
        turn = np.exp(-2j * np.pi * np.fft.rfftfreq(len(change)))[:, None]
        colour = (1 - self.memory**2) / np.abs(1 - self.memory * turn) ** 2
        spectrum = 1 - self.share + self.share * colour
        flat = np.fft.rfft(change / scale, axis=0) / np.sqrt(spectrum)
        return np.fft.irfft(flat, len(change), axis=0)


def draw_noise(
    kind: str,
    level: float,
    torque: np.ndarray,
    speed: np.ndarray,
    *,
    n_motions: int,
    sample_period: float,
    limit: np.ndarray,
    rng: np.random.Generator,
) -> TorqueNoise:
    """Draw the noise of a laboratory.

    `constant` is white with a weak coloured part. `by_motion` has another level on each motion
    (factors between 0.3 and 3). `by_speed` and `by_load` grow with speed and torque. `coloured` is
    almost only coloured. `quantised` is logged in steps of 2 to 4 standard deviations. `outliers`
    has 0.1 to 1 % of samples far off. `real` is taken from residuals of a real machine; its share
    and memory are fitted to their autocorrelation.

    Args:
        kind: Of `KINDS`, or `REAL`.
        level: Standard deviation over RMS torque.
        torque: Typical torque [N m], shape (samples, n_axes).
        speed: Typical motor speed [rad/s], same shape.
        n_motions: Number of motions.
        sample_period: Of the recording [s].
        limit: Torque limit, shape (n_axes,), in [N m]; the log has 14 bit over twice this range.
        rng: Source of randomness.

    Returns:
        The noise.

    Raises:
        FileNotFoundError: The kind is `REAL`, and the recordings of real machines are not here.
    """
    rms = np.sqrt(np.mean(torque**2, axis=0))
    axes = len(rms)
    size = level * rms * rng.uniform(0.8, 1.25, axes)
    coloured = kind == "coloured"
    share = rng.uniform(0.8, 0.95, axes) if coloured else rng.uniform(0.0, 0.4, axes)
    time = rng.uniform(0.01, 0.06, axes) if coloured else rng.uniform(0.005, 0.02, axes)
    factors = np.ones(n_motions)
    if kind == "by_motion":
        # spread over the whole range, so that motions surely differ
        place = (np.arange(n_motions) + rng.uniform(0, 1, n_motions)) / n_motions
        factors = rng.permutation(0.3 * 10**place)
    memory = np.exp(-sample_period / time)
    bank: tuple[np.ndarray, ...] = ()
    if kind == REAL:
        bank = draw_series(axes, sample_period, rng)
        share, memory = (np.array(values) for values in zip(*map(colour, bank), strict=True))
    step = limit / 2**13
    if kind == "quantised":
        step = rng.uniform(2.0, 4.0) * size
    return TorqueNoise(
        kind=kind,
        level=size,
        rms_torque=rms,
        rms_speed=np.sqrt(np.mean(speed**2, axis=0)),
        by_motion=factors,
        share=share,
        memory=memory,
        step=step,
        outliers=float(10 ** rng.uniform(-3, -2)) if kind == "outliers" else 0.0,
        bank=bank,
        block=max(1, round(_BLOCK / sample_period)),
    )

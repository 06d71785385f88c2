"""Noise of a residual, estimated from its changes over a few samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from faultgen.errors import InputError
from faultgen.monitoring.autoregression import amplification
from faultgen.recordings.block_filter import block_filter, blocks_of

ORDER = 8
"""Order of the autoregression of the noise.

White plus coloured noise is an autoregression of infinite order. Eight steps are close enough:
patterns over seconds in healthy robots then occur as often as they should. With three steps they
occur too often.
"""

FEWEST = 50
"""Samples from which the noise of an axis is estimated."""

_SAME = 0.05  # as `SHARED`, of noise that is the same beyond doubt
_CONSIDERABLE = 3e-3  # noise over torque; simulations without any seem to have 0.001


@dataclass(frozen=True, eq=False)
class Autoregression:
    """Noise of each axis as an autoregression, x_t = sum of a_k x_(t-k) + e_t."""

    coefficients: np.ndarray
    """The a_k. Shape (n_axes, order)."""
    innovation: np.ndarray
    """Standard deviation of e, shape (n_axes,)."""

    @property
    def deviation(self) -> np.ndarray:
        """Standard deviation of the noise, shape (n_axes,)."""
        return self.innovation * np.array([amplification(a) for a in self.coefficients])

    def times(self, factor: float) -> Autoregression:
        """Return the noise multiplied by a factor."""
        return Autoregression(self.coefficients, factor * self.innovation)

    def of_axis(self, axis: int) -> Autoregression:
        """Return the noise of one axis, counted from 1."""
        return Autoregression(self.coefficients[axis - 1 : axis], self.innovation[axis - 1 : axis])

    def replaced(self, other: Autoregression, axes: np.ndarray) -> Autoregression:
        """Return the noise with other noise on some axes.

        Args:
            other: The other noise, of the same order.
            axes: Axes on which the other noise is used, a mask of shape (n_axes,).

        Returns:
            The combined noise.
        """
        return Autoregression(
            np.where(axes[:, None], other.coefficients, self.coefficients),
            np.where(axes, other.innovation, self.innovation),
        )

    def whiten(self, x: np.ndarray, parts: Sequence[slice]) -> np.ndarray:
        """Compute innovations divided by their standard deviation.

        Args:
            x: Shape (..., samples, n_axes), in the unit of the noise.
            parts: Samples of each separate recording.

        Returns:
            Same shape as x, without unit. The first samples of each part, as many as the order, are
            0, and so are parts that are not longer.
        """
        order = self.coefficients.shape[1]
        blocks, out = blocks_of(parts), np.empty_like(x)
        for axis, (own, size) in enumerate(zip(self.coefficients, self.innovation, strict=True)):
            taps = np.append(1.0, -own) / size
            out[..., axis] = block_filter(x[..., axis], blocks, taps[None])
        for part in parts:
            out[..., part.start : min(part.start + order, part.stop), :] = 0.0
        return out


def typical(values: np.ndarray) -> float:
    """Standard deviation of normal values among which some are jumps.

    Args:
        values: Shape (samples,).

    Returns:
        The deviation by the median size. If most values are 0, as with coarse quantisation, it is
        found from the nine tenths of smaller size.
    """
    size = np.abs(values)
    by_median = 1.4826 * float(np.median(size))
    # root mean square of the central 90 % of a normal distribution: 0.789 of its deviation
    central = float(np.sqrt(np.mean(size[size <= np.quantile(size, 0.9)] ** 2))) / 0.789
    return max(by_median if by_median > 0.5 * central else central, 1e-12)


def autoregression(
    residual: np.ndarray, inside: np.ndarray, parts: Sequence[slice], order: int = ORDER
) -> Autoregression:
    """Fit an autoregression to the error that remains.

    Args:
        residual: Shape (samples, n_axes), in any unit; or draws of it, (draws, samples, n_axes).
        inside: Samples that may be used, shape (samples, n_axes).
        parts: Samples of each separate recording.
        order: Order of the autoregression.

    Returns:
        The noise. The scale of the innovations comes from their median size, so that rare jumps do
        not affect it.

    Raises:
        InputError: An axis has fewer than 50 usable samples.
    """
    axes = residual.shape[-1]
    coefficients, innovation = np.zeros((axes, order)), np.zeros(axes)
    for axis in range(axes):
        for own in dict.fromkeys((order, min(order, ORDER))):  # short motions show a low order only
            rows, targets, count = [], [], 0
            for part in parts:
                x, use = residual[..., part, axis], inside[part, axis]
                if len(use) <= own:
                    continue
                windows = sliding_window_view(x, own + 1, axis=-1)
                whole = sliding_window_view(use, own + 1).all(axis=1)
                rows.append(windows[..., whole, -2::-1].reshape(-1, own))
                targets.append(windows[..., whole, -1].ravel())
                count += int(whole.sum())
            if count >= FEWEST:
                break
        else:
            raise InputError(
                f"axis {axis + 1}: fewer than {FEWEST} samples in which it moves; record longer, "
                "or at a higher rate"
            )
        design, target = np.concatenate(rows), np.concatenate(targets)
        coefficients[axis, :own], *_ = np.linalg.lstsq(design, target, rcond=None)
        new = target - design @ coefficients[axis, :own]
        innovation[axis] = typical(new)
    return Autoregression(coefficients, innovation)


def usable(use: np.ndarray, parts: Sequence[slice]) -> int:
    """Count the samples from which `autoregression` can learn.

    Args:
        use: Samples that may be used, a mask of shape (samples,).
        parts: Samples of each separate recording.

    Returns:
        Number of samples that may be used together with the `ORDER` samples before them.
    """
    long = [use[part] for part in parts if part.stop - part.start > ORDER]
    return sum(int(sliding_window_view(one, ORDER + 1).all(axis=1).sum()) for one in long)


SHARED = 0.2
"""Two recordings share their noise if the unpredictable part of their difference, divided by that
of both, is below this limit. On a simulated PUMA it is 0.45 to 0.73 by axis for independent noise,
and 0.0006 to 0.11 for the same noise or none."""


def shared_noise(
    first: np.ndarray, second: np.ndarray, parts: Sequence[slice], share: float = SHARED
) -> np.ndarray:
    """Find the axes on which two recordings of the same motions may have the same noise.

    The part of a sample that cannot be predicted from the samples before it is noise, or a jump.
    The median excludes the jumps. If each recording has its own noise, their difference contains
    both. The test finds too many axes if the motion is hard to predict and the noise is below a
    thousandth of the torque.

    Args:
        first: Torque of one recording, shape (samples, n_axes).
        second: Torque of the other recording, same shape and unit.
        parts: Samples of each separate recording.
        share: Noise is shared if that of the difference, divided by that of both, is below this
            limit.

    Returns:
        Mask of shape (n_axes,).

    Raises:
        InputError: There are fewer than 50 samples.
    """
    use = np.ones(first.shape, bool)
    one, other, apart = (
        autoregression(x, use, parts).innovation for x in (first, second, first - second)
    )
    return apart < share * np.hypot(one, other)


def is_same_noise(first: np.ndarray, second: np.ndarray, parts: Sequence[slice]) -> np.ndarray:
    """Find the axes on which two recordings have considerable noise that is exactly the same.

    Args:
        first: Torque of one recording, shape (samples, n_axes).
        second: Torque of the other recording, same shape and unit.
        parts: Samples of each separate recording.

    Returns:
        Mask of shape (n_axes,).

    Raises:
        InputError: There are fewer than 50 samples.
    """
    noise = autoregression(second, np.ones(second.shape, bool), parts).innovation
    considerable = noise > _CONSIDERABLE * np.sqrt(np.mean(second**2, axis=0))
    return considerable & shared_noise(first, second, parts, _SAME)

"""Friction of each axis in each cycle: coefficients of friction terms in the torque."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator
from sklearn.utils.validation import check_is_fitted

Floats = NDArray[np.float64]


class FrictionFeatures(BaseEstimator):
    """Least-squares coefficients of friction and load terms in the torque of repeated cycles.

        torque(t) - expected(t) = offset + c0 sgn(w) + c1 w + c2 load(t)
                                  + sum_j d_j sgn(w) exp(-(w / (width_j stribeck_velocity))^2)

    This holds for each axis, with w its speed; sgn(w) is tanh(w / (0.3 stribeck_velocity)). c0 is
    Coulomb friction and c1 viscous friction. With several widths the Stribeck part can change its
    shape, as it does with temperature. Since the motion repeats, the terms come from one reference
    cycle, and every coefficient is a fixed weighted sum of torque samples. A constant `expected`
    shifts the coefficients of all cycles equally. An isolator that compares with healthy cycles
    does not need it.

    Source: Bittencourt et al. (2010), An extended friction model to capture load and temperature
    effects in robot joints, for the terms.

    Attributes:
        names_: Name of each coefficient, in the order of `transform`.
        operator_: Weights of the torque samples, shape (n_axes, coefficients, samples).
        active_: Axes that turn; coefficients of the others are 0. Shape (n_axes,).
    """

    def __init__(
        self, *, stribeck_velocity: ArrayLike, widths: Sequence[float] = (0.6, 1.0, 1.6)
    ) -> None:
        """Store the settings.

        Args:
            stribeck_velocity: Stribeck velocity of each axis, shape (n_axes,), in the unit of
                speed.
            widths: Widths of the Stribeck terms, as multiples of the Stribeck velocity.
        """
        self.stribeck_velocity = stribeck_velocity
        self.widths = widths

    def fit(
        self, velocity: ArrayLike, y: None = None, *, load: ArrayLike | None = None
    ) -> FrictionFeatures:
        """Learn the terms from the reference cycle.

        Args:
            velocity: Speed of each axis in the cycle. Shape (samples, n_axes).
            y: Not used.
            load: Change of torque with the load, same shape; None: no such term.

        Returns:
            The estimator.

        Raises:
            ValueError: The shapes do not agree.
        """
        w = np.asarray(velocity, float)
        scale = np.asarray(self.stribeck_velocity, float)
        if not (np.isfinite(scale).all() and (scale > 0).all() and min(self.widths, default=1) > 0):
            raise ValueError("stribeck_velocity and widths must be positive")
        if not np.isfinite(w).all():
            raise ValueError("velocity must be finite")
        if w.ndim != 2 or scale.shape != (w.shape[1],):
            raise ValueError(
                f"velocity must have shape (samples, {scale.size} axes), got {w.shape}"
            )
        sign = np.tanh(w / (0.3 * scale))
        terms = [sign, w]
        names = ["coulomb", "viscous"]
        if load is not None:
            terms.append(np.asarray(load, float))
            if terms[-1].shape != w.shape:
                raise ValueError(f"load must have shape {w.shape}, got {terms[-1].shape}")
            names.append("load")
        for width in self.widths:
            terms.append(sign * np.exp(-((w / (width * scale)) ** 2)))
            names.append(f"stribeck {width:g}")
        stacked = np.stack([*terms, np.ones_like(w)])  # (terms, samples, n_axes)
        # an axis that only trembles about its place tells nothing of its friction
        self.active_ = np.abs(w).max(axis=0) > 0.3 * scale
        self.operator_ = np.zeros((w.shape[1], len(terms), len(w)))
        for axis in np.flatnonzero(self.active_):
            design = stacked[:, :, axis].T
            size = np.linalg.norm(design, axis=0)
            size[size == 0] = 1.0
            inverse = np.linalg.pinv(design / size, rcond=1e-6) / size[:, None]
            self.operator_[axis] = inverse[:-1]
        self.names_ = [f"axis {a + 1} {name}" for a in range(w.shape[1]) for name in names]
        return self

    def transform(self, torque: ArrayLike) -> Floats:
        """Compute the coefficients of cycles.

        Args:
            torque: Shape (cycles, samples, n_axes), in any unit.

        Returns:
            Shape (cycles, n_axes * coefficients), axis by axis, in the unit of the torque, or this
            unit over that of the speed for c1.

        Raises:
            ValueError: The samples or axes are not those of the reference cycle.
        """
        check_is_fitted(self)
        cycles = np.asarray(torque, float)
        n_axes, _, samples = self.operator_.shape
        if cycles.ndim != 3 or cycles.shape[1:] != (samples, n_axes):
            raise ValueError(
                f"torque must have shape (cycles, {samples}, {n_axes}), got {cycles.shape}"
            )
        by_axis = [cycles[:, :, a] @ self.operator_[a].T for a in range(n_axes)]
        return np.hstack(by_axis)

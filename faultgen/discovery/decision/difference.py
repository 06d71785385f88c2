"""A difference between a recording and its model, or its baseline, ready for `faultgen.inference`.

difference = difference_of(posed)
difference.model, difference.hypotheses
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from faultgen.discovery.decision.arrays import Arrays, Posed, arrays_of
from faultgen.discovery.decision.hypotheses import PLAY_SPREAD, Group, size_of
from faultgen.discovery.decision.numbers import GENERIC, Numbers
from faultgen.discovery.decision.whitening import whitened
from faultgen.discovery.terms.candidates import Term
from faultgen.inference.hypotheses import Hypothesis
from faultgen.inference.model import Fitted, Model
from faultgen.inference.products import Products
from faultgen.recordings.noise_level import Noise


@dataclass(frozen=True, eq=False)
class Difference:
    """The difference, and what may explain it."""

    model: Model
    """Numbers and effects."""
    held_out: Products
    """Inner products of its columns on motions that are kept for scoring."""
    numbers: Numbers
    """The numbers."""
    of_model: Numbers
    """The numbers as the model has them, see `Arrays`."""
    hypotheses: list[Hypothesis]
    """What may be there."""
    groups: list[Group]
    """Terms of each form of each hypothesis by its first column; () for other columns."""
    over: dict[int, str]
    """Variable of each form of an unknown effect by its first column."""
    noise: Noise
    """The noise."""
    inside: np.ndarray
    """Samples that are used, shape (samples, n_axes)."""
    comparable: np.ndarray
    """The same, also on motions that must not be used."""
    weight: np.ndarray
    """Weight of each sample, same shape."""
    residual: np.ndarray
    """Torque that is to be explained, same shape."""
    from_model: np.ndarray
    """The same beside `of_model`."""
    parts: list[slice]
    """Samples of each separate recording."""
    rest: np.ndarray
    """What numbers and effects leave together, whitened and weighted, same shape."""

    def whiten(self, x: np.ndarray) -> np.ndarray:
        """Whiten, mask and weight torques.

        Args:
            x: Shape (..., samples, n_axes), in the unit of the recording's torque.

        Returns:
            Same shape, in standard deviations of the noise.
        """
        return self.noise.whiten(x, self.parts) * self.weight.astype(x.dtype)

    def whiten_axis(self, x: np.ndarray, axis: int) -> np.ndarray:
        """Whiten, mask and weight torques of one axis.

        Args:
            x: Shape (..., samples), in the unit of the recording's torque.
            axis: Axis, from 1.

        Returns:
            Same shape, as from `whiten`.
        """
        weight = self.weight[:, axis - 1].astype(x.dtype)
        return self.noise.whiten_axis(x, axis, self.parts) * weight

    @cached_property
    def exact(self) -> Model:
        """The model without torques of no known form, of which a healthy robot has hardly any."""
        return self.model.without(GENERIC)

    def white_numbers(self, scales: np.ndarray) -> np.ndarray:
        """Whiten the columns of all numbers of known form, in units of their standard deviations.

        Args:
            scales: Logarithm of the scale of each group, shape (groups,).

        Returns:
            Shape (numbers, samples, n_axes), in single precision.
        """
        numbers = self.numbers
        size = np.exp(scales)[numbers.group] * numbers.std
        scaled = [(size[k] * numbers.columns[k]).astype(np.float32) for k in numbers.known]
        return self.whiten(np.array(scaled, np.float32).reshape(-1, *self.residual.shape))

    def left(self, fitted: Fitted, change: np.ndarray | None = None) -> np.ndarray:
        """Compute the torque that numbers of known form leave.

        Args:
            fitted: A fit of these numbers.
            change: Change of the torque by effects, shape (samples, n_axes), as a simulation has
                it. The numbers are fitted again beside it, because those of the fit stand beside
                effects that are linear in their severities. None: there are no effects.

        Returns:
            Shape (samples, n_axes).
        """
        known = self.numbers.known
        if not known:
            return self.residual if change is None else self.residual - change
        columns = np.array([self.numbers.columns[k] for k in known])
        if change is None:
            values = fitted.values[: len(known)].astype(np.float32)
            return self.residual - np.tensordot(values, columns, axes=1)
        target = self.residual - change
        size = (np.exp(fitted.log_scales)[self.numbers.group] * self.numbers.std)[known]
        white = self.white_numbers(fitted.log_scales).reshape(len(known), -1).astype(float)
        right = white @ self.whiten(target).ravel().astype(float)
        values = size * np.linalg.solve(white @ white.T + np.eye(len(known)), right)
        return np.asarray(target - np.tensordot(values.astype(np.float32), columns, axes=1))

    def beside(
        self,
        columns: np.ndarray,
        terms: Sequence[Term],
        values: np.ndarray | None,
        scales: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Compute the posterior of effects beside the numbers.

        Scales are not found again: a column that holds for one severity only could lose what the
        effect explains to a group that widens.

        Args:
            columns: Change of the torque per unit of each term, shape (terms, samples, n_axes).
            terms: Terms of the effects.
            values: Values near which the columns hold, shape (terms,); None if they are not known.
            scales: Logarithm of the scale of each group.

        Returns:
            Severities, shape (terms,), and their covariance.
        """
        numbers = self.numbers.known
        every = np.array([*(self.numbers.columns[k] for k in numbers), *columns], np.float32)
        sizes, means = np.array([size_of(term) for term in terms]).T
        if values is not None:
            means = np.where(means != 0, values, means)
            sizes = np.where(means != 0, PLAY_SPREAD * np.abs(values), sizes)
        model = Model(
            Products.of(self.whiten(every), self.whiten(self.residual), int(self.inside.sum())),
            np.concatenate([np.array(self.numbers.std)[numbers], sizes]),
            np.concatenate([np.zeros(len(numbers)), means]),
            self.numbers.group[numbers],
            self.model.groups,
        )
        value, covariance = model.at(scales, range(len(terms)))
        own = slice(len(numbers), None)
        return value[own], covariance[own, own]


def difference_of(posed: Posed, *, only_numbers: bool = False) -> Difference:
    """Prepare a difference.

    Args:
        posed: The recording and what may differ.
        only_numbers: Whether there are no hypotheses.
    """
    arrays = arrays_of(posed, only_numbers=only_numbers)
    white = whitened(arrays)
    effects = arrays.effects
    return Difference(
        model_of(arrays, white.products),
        white.held_out,
        arrays.numbers,
        arrays.of_model,
        effects.hypotheses,
        effects.groups,
        effects.over,
        white.noise,
        arrays.inside,
        arrays.comparable,
        white.weight,
        arrays.residual,
        arrays.from_model,
        arrays.parts,
        white.left,
    )


def model_of(arrays: Arrays, products: Products) -> Model:
    """Build the probabilistic model of a difference.

    Args:
        arrays: Columns of numbers and effects beside a residual.
        products: Inner products of the whitened columns and the whitened residual.
    """
    numbers = arrays.numbers
    groups = arrays.posed.groups or numbers.groups
    return Model(products, arrays.std, arrays.mean, numbers.group, groups)

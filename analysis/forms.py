"""Bayes factors of all forms of all causes at once.

A form has the scores a = A C^-1 x of its columns and their information I = A C^-1 A'. In units of
its prior standard deviations, I = V diag(l) V', so that in turned coordinates V'a everything is a
product of numbers, whatever the number of recordings. Source: linear regression with a normal prior
(Bishop 2006, 3.3).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtr

from .causes import Cause

Floats = NDArray[np.float64]

_GRID = np.linspace(-5.0, 5.0, 81)
"""Standard deviations about the mean of a form, between which quantiles are interpolated."""


class Forms:
    """Forms of causes, with columns padded to the same number."""

    def __init__(self, causes: Sequence[Cause], information: Floats) -> None:
        """Turn the coordinates.

        Args:
            causes: The causes.
            information: Of all columns, shape (columns, columns).
        """
        forms = [(k, form) for k, cause in enumerate(causes) for form in cause.forms]
        width = max((len(form.columns) for _, form in forms), default=1)
        shape = (len(forms), width)
        self.cause = np.array([k for k, _ in forms], int)
        """Number of the cause of each form, shape (forms,)."""
        self._first = np.flatnonzero(np.diff(self.cause, prepend=-1))
        self._count = np.bincount(self.cause, minlength=len(causes))
        self._columns = np.zeros(shape, int)
        self._turn = np.zeros((*shape, width))  # size of each column times V
        self._gain = np.zeros(shape)  # l
        self._about = np.zeros(shape)  # V' of the prior mean
        self._of_severity = np.zeros(shape)  # size of the first column times its row of V
        self._mean = np.array([form.mean for _, form in forms])
        self._size = np.array([form.sizes[0] for _, form in forms])
        self._positive = np.array([causes[k].positive for k, _ in forms], bool)
        for f, (_, form) in enumerate(forms):
            own, sizes = list(form.columns), np.array(form.sizes)
            count = len(own)
            gram = information[np.ix_(own, own)] * np.outer(sizes, sizes)
            gain, vectors = np.linalg.eigh(gram)
            self._columns[f, :count] = own
            self._turn[f, :count, :count] = sizes[:, None] * vectors
            self._gain[f, :count] = np.maximum(gain, 0.0)
            self._about[f, :count] = form.mean / sizes[0] * vectors[0]
            self._of_severity[f, :count] = sizes[0] * vectors[0]

    def turned(self, scores: Floats) -> Floats:
        """Turn scores into the coordinates of each form.

        Args:
            scores: Shape (..., columns).

        Returns:
            Shape (..., forms, columns of a form).
        """
        turn = self._turn.astype(scores.dtype)
        chosen = np.moveaxis(scores[..., self._columns].reshape(-1, *self._columns.shape), 1, 0)
        turned = np.moveaxis(chosen @ turn, 0, 1)
        return np.asarray(turned.reshape(*scores.shape[:-1], *self._columns.shape))

    def _of_forms(
        self, turned: Floats, variance: float, signs: bool
    ) -> tuple[Floats, Floats, Floats]:
        """Log Bayes factor of each form; mean and deviation of its severity without a sign."""
        kind = turned.dtype  # single precision is enough to simulate, and twice as fast
        gain = (self._gain / variance).astype(kind)
        about = self._about.astype(kind)
        share = 1 / (1 + gain)
        told = turned / kind.type(variance)
        apart = told - gain * about
        logs = 0.5 * np.einsum("...fj,...fj,fj->...f", apart, apart, share)
        logs -= 0.5 * np.log1p(gain).sum(axis=-1)
        # what the prior mean explains: scores times mean less half of what the mean would show
        logs += np.einsum("...fj,fj->...f", told, about) - 0.5 * (gain * about**2).sum(axis=-1)
        weight = (self._of_severity * share).astype(kind)
        mean = np.einsum("...fj,fj->...f", apart, weight) + self._mean.astype(kind)
        spread = np.sqrt((self._of_severity**2 * share).sum(axis=-1)).astype(kind)
        if signs:
            own = self._positive
            more = log_ndtr(mean[..., own] / spread[own]) - log_ndtr(self._mean / self._size)[own]
            logs[..., own] += more
        return logs, mean, spread

    def log_bayes_factors(self, turned: Floats, variance: float, *, signs: bool = True) -> Floats:
        """Compute the logarithm of the Bayes factor of each cause against none.

        Args:
            turned: Mean of the scores of some recordings, shape (..., forms, columns of a form).
            variance: Of this mean less that of the healthy recordings, over that of one recording.
            signs: Whether it counts that some severities cannot be negative.

        Returns:
            Shape (..., causes).
        """
        logs, _, _ = self._of_forms(turned, variance, signs)
        top = np.maximum.reduceat(logs, self._first, axis=-1)
        shares = np.exp(logs - np.repeat(top, self._count, axis=-1))
        mean_share = np.add.reduceat(shares, self._first, axis=-1) / self._count
        return np.asarray(top + np.log(mean_share))

    def severities(self, turned: Floats, variance: float) -> tuple[Floats, Floats, Floats]:
        """Compute quantiles of the severity of each cause, if it is the one.

        Args:
            turned: Mean of the scores of some recordings, shape (forms, columns of a form).
            variance: As for `log_bayes_factors`.

        Returns:
            The quantiles 0.025, 0.5 and 0.975, shape (causes,) each.
        """
        logs, mean, spread = self._of_forms(turned, variance, signs=True)
        out = np.empty((3, len(self._first)))
        for k in range(len(self._first)):
            own = self.cause == k
            weight = np.exp(logs[own] - np.logaddexp.reduce(logs[own]))
            at = np.sort((mean[own, None] + spread[own, None] * _GRID).ravel())
            low = np.where(self._positive[own], ndtr(-mean[own] / spread[own]), 0.0)
            share = (ndtr((at[:, None] - mean[own]) / spread[own]) - low) / np.maximum(
                1 - low, 1e-300
            )
            out[:, k] = np.interp((0.025, 0.5, 0.975), np.maximum(share, 0.0) @ weight, at)
        return out[0], out[1], out[2]

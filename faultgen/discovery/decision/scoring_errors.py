"""Errors of sets of effects on the scoring motions, and when one is clearly larger than another."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from faultgen.discovery.fit.fit import Fit
from faultgen.discovery.fit.gap import gap, unexplained
from faultgen.discovery.fit.regression import Problem
from faultgen.discovery.result import CONSIDERABLE, PART
from faultgen.discovery.terms.candidates import INERTIA

LARGER_WITH_BASELINE, LARGER_OWN_WITH_BASELINE = 1.005, 1.03
"""Gap with an effect, over that without it, from which the effect counts as refuted if there is a
baseline: gap of all axes, and of the axis on which the effect acts. Assumed."""

LARGER, LARGER_OWN = 1.02, 1.015
"""The same without a baseline, where the model's own numbers imitate an effect that is left out. On
development cases, seven of eight real effects leave the gap of their axis as it is or make it
smaller; one makes it larger by 3 %, and five false ones by 1.8 % to 5.8 %."""

LARGER_BUILT, LARGER_OWN_BUILT = 1.02, 1.06
"""The same without a baseline if the model is simulated with the effects, or if the evidence for an
effect is strong: assumed."""

LARGER_SURE, LARGER_OWN_SURE = 1.1, 1.2
"""The same if the scoring motions bear out every effect by themselves. Other errors may be so much
larger than an effect that the gap grows by chance: assumed."""

REFUTED, WORSE = -1.0, 9.0
"""An effect is refuted if the error on the scoring motions increases by more than one standard
error, and the squared whitened error by more than 9, as in a test of three standard deviations:
assumed. Where the effect is a number that calibration may change too, the two models foretell
almost the same, and a small increase says nothing."""

MAJOR = 0.5
"""Share of what differs on an axis that an effect explains if something like it has changed, also
if it is refuted on other motions: assumed. In two runs of an unchanged real arm, which differ by 18
to 68 % of the torque, no effect reaches 0.1."""

Gap = tuple[float, list[float]]
"""Relative error of all axes, and of each axis."""


@dataclass(frozen=True, eq=False)
class Error:
    """Error of a set of effects on the scoring motions. Arrays have shape (samples, n_axes)."""

    torque: np.ndarray
    """In N m."""
    whitened: np.ndarray
    """Without unit; 0 outside the samples that are compared."""
    of_all: np.ndarray
    """The same of all recordings, also those for fitting; 0 outside the samples that are used."""
    paid: np.ndarray
    """Squared values of the other terms of each axis, in their prior standard deviations, shape
    (n_axes,). Links are not counted, because they act on several axes."""

    @classmethod
    def of(cls, problem: Problem, fitted: Fit, inside: np.ndarray) -> Error:
        """Compute the error of a set at the samples that are compared.

        Args:
            problem: The recording and the model.
            fitted: The set of effects.
            inside: Samples that are compared, shape (samples, n_axes).
        """
        torque, solution = unexplained(problem, fitted)
        white = problem.whiten(torque)
        paid = np.zeros(inside.shape[1])
        for term, value in zip(problem.terms, solution, strict=True):
            if term.name != INERTIA and 1 <= term.axis <= len(paid):
                paid[term.axis - 1] += value**2
        return cls(torque, white * inside, white * problem.inside, paid)


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors on the scoring motions without and with effects."""

    without: Error
    """Error without the effects."""
    having: Error
    """Error with them."""
    inside: np.ndarray
    """Samples that are compared, shape (samples, n_axes)."""
    length: int
    """Samples of the blocks from which standard errors come."""

    @classmethod
    def of(cls, problem: Problem, without: Fit, having: Error, inside: np.ndarray) -> Errors:
        """Compare the error with effects with that of a set without them.

        Args:
            problem: The recording and the model.
            without: The set without the effects.
            having: The error with them.
            inside: Samples that are compared, shape (samples, n_axes).
        """
        length = max(5, round(0.1 / problem.recording.sample_period))
        return cls(Error.of(problem, without, inside), having, inside, length)

    @property
    def over(self) -> float:
        """Overdispersion with the effects: mean squared whitened error, at least 1."""
        return max(1.0, float(np.sum(self.having.whitened**2) / max(self.inside.sum(), 1)))

    @property
    def seen(self) -> float:
        """Decrease of the squared whitened error by the effects."""
        return float(np.sum(self.without.whitened**2 - self.having.whitened**2))

    @property
    def gain(self) -> float:
        """The same over its standard error, which comes from blocks of 0.1 s."""
        by_sample = (self.without.whitened**2 - self.having.whitened**2).sum(axis=1)
        whole = len(by_sample) // self.length * self.length
        blocks = by_sample[:whole].reshape(-1, self.length).sum(axis=1)
        return self.seen / max(float(np.sqrt(np.sum(blocks**2))), 1e-300)

    def grows(
        self, problem: Problem, axes: Iterable[int] = (), limits: tuple[float, float] | None = None
    ) -> bool:
        """Whether the gap of all axes, or of one of some axes, becomes clearly larger.

        Args:
            problem: The recording and the model.
            axes: Those axes, from 1.
            limits: Ratio from which a gap is clearly larger. Default: as from `limits_of`.
        """
        errors = self.without, self.having
        before, after = (gap(problem, error.torque, self.inside) for error in errors)
        return is_larger(before, after, limits or limits_of(problem), axes)

    def share_of(
        self, problem: Problem, axis: int, parts: Sequence[int], *, paid: bool = False
    ) -> tuple[float, float, float]:
        """Compute how much of what differs on an axis effects explain.

        Args:
            problem: The recording and the model.
            axis: From 1; another one than those of the robot has no difference.
            parts: Parts of the recording that are looked at.
            paid: Whether it counts as a difference, too, that other terms have values that are not
                usual. Without an effect, they may imitate it at this price.

        Returns:
            The share of what differs beyond noise that they explain; the squared error beyond that
            of noise, over that of noise, without them; and the same with them.
        """
        if not 1 <= axis <= problem.inside.shape[1]:
            return 0.0, 0.0, 0.0
        rows = problem.inside[:, axis - 1] & problem.samples(parts)
        count = max(float(rows.sum()), 1.0)
        before, after = (
            float(np.sum(error.of_all[rows, axis - 1] ** 2) + paid * error.paid[axis - 1]) / count
            - 1
            for error in (self.without, self.having)
        )
        return (before - after) / max(before, 1e-300), before, after

    def is_minor(self, problem: Problem, axis: int) -> bool:
        """Whether effects explain less than `PART` of what differs on an axis beyond noise.

        It takes a considerable difference that they leave: the level of the noise is not known
        better.

        Args:
            problem: The recording and the model.
            axis: From 1.
        """
        every = range(len(problem.parts))
        _, _, after = self.share_of(problem, axis, every)
        share, _, _ = self.share_of(problem, axis, every, paid=True)
        return after > CONSIDERABLE and share < PART

    def is_major(self, problem: Problem, axis: int) -> bool:
        """Whether effects explain more than `MAJOR` of a considerable difference on an axis.

        The motions for fitting are looked at, because those for scoring may say the opposite.

        Args:
            problem: The recording and the model.
            axis: From 1.
        """
        share, before, _ = self.share_of(problem, axis, problem.fitting)
        return before > CONSIDERABLE and share > MAJOR

    def are_worse(self, problem: Problem) -> bool:
        """Whether the effects as a whole make the scoring motions clearly worse.

        Args:
            problem: The recording and the model.
        """
        return is_worse(self.gain, self.seen / self.over) or self.grows(problem)


def is_worse(gain: float, seen: float) -> bool:
    """Whether the squared whitened error becomes clearly larger.

    Args:
        gain: Its decrease, over its standard error.
        seen: Its decrease, over the overdispersion.
    """
    return gain < REFUTED and seen < -WORSE


def limits_of(problem: Problem, *, built: bool = False) -> tuple[float, float]:
    """Ratio from which a gap is clearly larger: of all axes, and of one axis.

    Args:
        problem: The recording and the model.
        built: Whether the models are simulated, or the evidence is strong.
    """
    if problem.baseline:
        return LARGER_WITH_BASELINE, LARGER_OWN_WITH_BASELINE
    return (LARGER_BUILT, LARGER_OWN_BUILT) if built else (LARGER, LARGER_OWN)


def is_larger(before: Gap, after: Gap, limits: tuple[float, float], axes: Iterable[int]) -> bool:
    """Whether the gap of all axes, or of one of some axes, becomes clearly larger.

    Args:
        before: Gap without effects.
        after: Gap with them.
        limits: Ratio from which a gap is clearly larger: of all axes, and of one axis.
        axes: Axes on which the effects act, from 1; others than those of the robot have no gap.
    """
    own = [k - 1 for k in axes if 1 <= k <= len(after[1])]
    larger = any(after[1][k] > limits[1] * before[1][k] for k in own)
    return larger or after[0] > limits[0] * before[0]

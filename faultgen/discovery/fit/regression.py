"""A residual prepared for regression: masked and whitened, with one column for each term."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from faultgen.discovery.fit.evidence import Evidence
from faultgen.discovery.fit.regimes import trust_by_regime
from faultgen.discovery.replay.replay import Changes, Replay
from faultgen.discovery.replay.samples import (
    counted,
    cut,
    divided,
    for_noise,
    moving,
    near_reversal,
    samples_of,
)
from faultgen.discovery.terms.candidates import Term
from faultgen.errors import SimulationFailed
from faultgen.recordings.noise import SHARED, Autoregression, autoregression, noise_of, shared_noise
from faultgen.recordings.noise_level import Noise, levelled
from faultgen.recordings.recording import Recording
from faultgen.robot import Robot

_FEWEST = 50  # samples of a regime from which its weight is told
_LOOSE = 0.01  # weight of the square of each term: ten times the prior standard deviation
_EXACT = 1e-5  # noise over torque that simulations and columns are not exact enough to go below


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
class Problem:
    """A residual and the terms that may explain it.

    Arrays of samples have shape (samples, n_axes).
    """

    replay: Replay
    """The recording and the model on which effects are simulated."""
    given: Replay
    """The recording and the model as it was given, which may have other links; see `own_numbers`.
    The residual and the values of all terms count from there."""
    terms: list[Term]
    """All terms, with the prior standard deviations of this comparison."""
    base: np.ndarray
    """Torque of the unchanged model."""
    residual: np.ndarray
    """Torque that is to be explained."""
    inside: np.ndarray
    """Samples that are used."""
    parts: list[slice]
    """Separate recordings, or blocks of a single one."""
    scoring: list[int]
    """Parts that are used neither for fitting nor for the choice of effects."""
    raw: np.ndarray
    """Change of the torque per unit of each term, shape (terms, samples, n_axes)."""
    noise: Noise
    """Noise of the residual."""
    trust: np.ndarray
    """Weight of each sample: 1, or less where models of friction are usually wrong."""
    white: np.ndarray
    """Whitened columns in units of the prior standard deviations, shape (terms, samples,
    n_axes)."""
    baseline: bool
    """Whether the residual is the difference of two recordings."""
    shared: np.ndarray
    """Axes on which the two recordings have the same noise, which cancels in their difference;
    shape (n_axes,)."""

    @property
    def fitting(self) -> list[int]:
        """Parts that are used for fitting and for the choice of effects."""
        return [p for p in range(len(self.parts)) if p not in self.scoring]

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

    def samples(self, parts: Sequence[int]) -> np.ndarray:
        """Find the samples of some parts.

        Args:
            parts: Indices of the parts.

        Returns:
            Whether each sample belongs to one of them. Shape (samples,).
        """
        return samples_of([self.parts[p] for p in parts], len(self.residual))

    def change(self, effects: Changes) -> np.ndarray | None:
        """Simulate by how much effects change the torque.

        Args:
            effects: Terms, without any of links, and values.

        Returns:
            Shape (samples, n_axes), in the unit of the recording's torque, or None if the
            simulation diverges.
        """
        return _finite(lambda: self.replay.torque(effects) - self.base)

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
        return _finite(lambda: self.given.torque(changes) - given_torque)

    def whiten(self, x: np.ndarray) -> np.ndarray:
        """Whiten, mask and weight an array.

        Args:
            x: Torques. Shape (..., samples, n_axes), in the unit of the recording's torque.

        Returns:
            The array in standard deviations of the noise. Same shape.
        """
        return self.noise.whiten(x, self.parts) * (self.inside * self.trust).astype(x.dtype)

    def whiten_axis(self, x: np.ndarray, axis: int) -> np.ndarray:
        """Whiten, mask and weight torques of one axis.

        Args:
            x: Shape (..., samples), in the unit of the recording's torque.
            axis: Axis, from 1.

        Returns:
            Same shape as x, as from `whiten`.
        """
        weight = (self.inside * self.trust)[:, axis - 1].astype(x.dtype)
        return self.noise.of_axis(axis).whiten(x[..., None], self.parts)[..., 0] * weight

    @cached_property
    def _nominal(self) -> Evidence:
        return Evidence.of(self.white, self.whiten(self.residual), self.folds)

    @property
    def folds(self) -> list[slice]:
        """Periods of the parts for fitting, each of which is predicted from all others."""
        return divided([self.parts[p] for p in self.fitting])

    def evidence(
        self, residual: np.ndarray | None = None, slopes: dict[int, np.ndarray] | None = None
    ) -> Evidence:
        """Compute inner products on the parts for fitting.

        Args:
            residual: Another residual than that of the problem, shape (samples, n_axes).
            slopes: Other columns for some terms, per unit of the term, shape (samples, n_axes)
                each.

        Returns:
            The inner products.
        """
        if residual is None:
            return self._nominal
        target = self.whiten(residual)
        evidence = self._nominal.against(self.white, target, self.folds)
        if not slopes:
            return evidence
        white = {t: self.whiten(c) * self.terms[t].prior_std for t, c in slopes.items()}
        return evidence.replaced(white, self.white, target, self.folds)


def _finite(simulated: Callable[[], np.ndarray]) -> np.ndarray | None:
    """What a simulation gives, or None if it diverges."""
    try:
        torque = simulated()
    except SimulationFailed:
        return None
    return torque if np.isfinite(torque).all() else None


def pose(
    replay: Replay,
    terms: Sequence[Term],
    base: np.ndarray,
    raw: np.ndarray,
    residual: np.ndarray,
    *,
    baseline: bool,
    explained: np.ndarray | None = None,
    given: Replay | None = None,
) -> Problem:
    """Estimate the noise of a residual, and whiten the residual and all columns with it.

    The noise is estimated from what no combination of the terms explains. Its level may differ
    between separate recordings, and grow with speed and load. With a baseline, samples in slow
    motion get less weight if this is larger there than at speed, because the friction of any real
    robot differs from a model's there. Without a baseline, samples at rest and shortly after it are
    not used, and the others get weights by `regimes.trust_by_regime`. On axes on which two
    recordings have the same noise, the noise of the recording is used, as if the other recording
    had noise of its own.

    Args:
        replay: The recording and the model.
        terms: All terms.
        base: Torque of the unchanged model, shape (samples, n_axes).
        raw: Columns, shape (terms, samples, n_axes).
        residual: Torque that is to be explained, shape (samples, n_axes).
        baseline: Whether the residual is the difference of two recordings.
        explained: Part of the residual that known effects explain and that does not count as noise,
            shape (samples, n_axes). None: nothing.
        given: The recording and the given model, if its links differ from those of `replay`.

    Returns:
        The residual and the terms, ready for fitting.

    Raises:
        ValueError: Too little of the recording can be used.
    """
    recording, robot = replay.recording, replay.robot
    inside = counted(recording, robot, baseline=baseline)
    if replay.left_out is not None:
        inside &= ~replay.left_out
    parts, scoring = cut(recording, robot, inside)
    inside, steady = for_noise(inside, inside & ~near_reversal(recording, robot), parts)
    if not inside[samples_of([parts[p] for p in scoring], len(inside))].any():
        raise ValueError("too little moves to keep a fifth of it for scoring")
    prior_stds = np.array([term.prior_std for term in terms], np.float32)[:, None, None]
    scale = prior_stds[:, 0, 0]

    mask = inside.astype(np.float32)

    def unexplained(x: np.ndarray, by: Autoregression | Noise) -> np.ndarray:
        """What no combination of the terms explains."""
        white = [by.whiten(y, parts) * mask for y in (raw, x)]
        evidence = Evidence.of(white[0] * prior_stds, white[1], parts)
        value, _, _ = evidence.solve(free=range(len(terms)))
        return x - np.tensordot((value * scale).astype(np.float32), raw, axes=1)

    drivers = _drivers(recording, robot)
    torque = np.sqrt(np.mean(recording.torque**2, axis=0))

    def exact(colour: Autoregression) -> Autoregression:
        """Noise that is no smaller than the errors of simulations."""
        return replace(colour, innovation=np.maximum(colour.innovation, _EXACT * torque))

    def noise_in(x: np.ndarray) -> Noise:
        by: Autoregression | Noise = exact(noise_of(x, steady, parts))
        for _ in range(2):
            found = levelled(unexplained(x, by), steady, parts, drivers)
            by = found = found.with_colour(exact(found.colour))
        return found

    rest = residual if explained is None else residual - explained
    noise = noise_in(rest)
    shared = np.zeros(robot.n_axes, bool)
    if baseline:
        shared = shared_noise(recording.torque, recording.torque - residual, parts)
    if shared.any():  # what neither the model nor the samples before foretell of the healthy one
        healthy = recording.torque - residual
        own, plainly = noise_in(healthy - base), autoregression(healthy, steady, parts)
        white = replace(plainly, coefficients=0 * plainly.coefficients)
        colour = own.colour.replaced(white, white.innovation < own.colour.innovation)
        own = own.with_colour(colour.times(np.sqrt(2)))
        shared &= noise.colour.innovation < SHARED * own.colour.innovation
        noise = noise.replaced(own, shared)
        noise = noise.with_colour(exact(noise.colour))
    columns = noise.whiten(raw, parts) * mask * prior_stds
    target = noise.whiten(rest, parts) * mask
    if baseline:
        left = noise.whiten(unexplained(rest, noise), parts)
        trust = _trust(recording, robot, left, inside)
    else:
        trust = trust_by_regime(_foretold_error(columns, target, parts), recording, robot, inside)
    weight = trust.astype(np.float32)
    return Problem(
        replay=replay,
        given=given or replay,
        terms=list(terms),
        base=base,
        residual=residual,
        inside=inside,
        parts=parts,
        scoring=scoring,
        raw=raw,
        noise=noise,
        trust=trust,
        white=columns * weight,
        baseline=baseline,
        shared=shared,
    )


def posed_again(
    problem: Problem,
    terms: Sequence[Term] = (),
    columns: np.ndarray | None = None,
    *,
    explained: np.ndarray | None = None,
) -> Problem:
    """Pose a problem again, with further terms or with effects that have become known.

    Args:
        problem: The residual and the terms.
        terms: Further terms.
        columns: Their columns, shape (further terms, samples, n_axes). None: there are none.
        explained: As for `pose`.
    """
    return pose(
        problem.replay,
        [*problem.terms, *terms],
        problem.base,
        problem.raw if columns is None else np.concatenate([problem.raw, columns]),
        problem.residual,
        baseline=problem.baseline,
        explained=explained,
        given=problem.given,
    )


def plain(problem: Problem) -> Problem:
    """Return the same problem with white noise of the same deviation and information.

    An autoregression fitted to a model's residual treats long-lasting errors as drifting noise.
    This helps to distinguish effects. Values, however, should make the torque right where it is
    steady as well, and white noise gives long-lasting errors their full weight.
    """
    new = replace(problem, noise=problem.noise.plain(), trust=np.ones_like(problem.trust))
    prior_stds = np.array([term.prior_std for term in problem.terms], np.float32)
    return replace(new, white=new.whiten(problem.raw) * prior_stds[:, None, None])


def with_priors(problem: Problem, terms: list[Term]) -> Problem:
    """Return the same problem with other prior standard deviations.

    Args:
        problem: The residual and the terms.
        terms: The same terms in the same order, with other prior standard deviations.
    """
    pairs = zip(terms, problem.terms, strict=True)
    ratio = np.array([new.prior_std / old.prior_std for new, old in pairs], np.float32)
    return replace(problem, terms=terms, white=problem.white * ratio[:, None, None])


def _foretold_error(white: np.ndarray, target: np.ndarray, parts: Sequence[slice]) -> np.ndarray:
    """Error of each period if loosely bound terms are fitted to all others, shape of target."""
    folds = divided(parts)
    evidence = Evidence.of(white, target, folds).weighted(np.full(len(white), _LOOSE))
    left = target.copy()
    every = range(len(folds))
    for k, fold in enumerate(folds):
        value, _, _ = evidence.only([j for j in every if j != k]).solve()
        left[fold] -= np.tensordot(value.astype(np.float32), white[:, fold], axes=1)
    return left


def _trust(recording: Recording, robot: Robot, left: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Weights that make the residual in slow motion as large as the noise, by axis."""
    slow = near_reversal(recording, robot)
    trust = np.ones(left.shape)
    moves = moving(recording, robot)
    for axis in range(robot.n_axes):
        for regime in (slow[:, axis] & moves[:, axis], ~moves[:, axis]):
            rows = regime & inside[:, axis]
            if rows.sum() >= _FEWEST:
                trust[rows, axis] = 1 / np.sqrt(max(float(np.mean(left[rows, axis] ** 2)), 1.0))
    return trust


def _drivers(recording: Recording, robot: Robot) -> list[np.ndarray]:
    """Speed and load, with which noise may grow; each of shape (samples, n_axes), not negative."""
    position = recording.motor_position(robot)
    _, velocity, _ = recording.derivatives(position)
    load, _, _ = recording.derivatives(recording.torque)
    return [np.abs(velocity), np.abs(load)]

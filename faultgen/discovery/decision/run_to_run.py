"""How much an unchanged robot differs from run to run, measured from recordings of its motions.

Friction, load and offsets differ a little between any two runs. The prior standard deviations
between two recordings of one robot (`candidates.SAME_MOTIONS`) are only assumed. Several healthy
recordings, or several repetitions of a motion in one of them, show how large they are:

    problem = widened(problem, differences(healthy))

The differences between runs are projected onto the sensitivities. Each term then gets the variance
with which these differences are most probable, one term after the other (Tipping and Faul 2003).

A single healthy recording shows nothing of this, but the axes of the robot do: a fault changes the
friction of one axis or two, a warmer day that of all of them. `between_axes` takes the median. With
fewer than four axes, `USUAL` is assumed.
If both recordings have one temperature each, `between_temperatures` allows for what the difference
changes by Bittencourt's law.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_solve
from scipy.optimize import brentq
from scipy.stats import chi2, norm, t

from faultgen.discovery.fit.evidence import Evidence, factored
from faultgen.discovery.fit.regression import Problem, with_priors
from faultgen.discovery.replay.sensitivities import FOLLOWS, LEAST_RANGE
from faultgen.discovery.terms.candidates import DAY_TO_DAY
from faultgen.effects.temperature import friction_ratios
from faultgen.recordings.recording import Recording

USUAL = 0.02
"""Standard deviation of friction between two recordings of a robot of few axes: assumed. On a UR10e
(benchmarks/reference_ur10e.py) friction differs by 0.5 to 5 %."""

FEWEST_AXES = 4
"""Axes whose median is hardly changed by a fault of one of them: assumed."""

_EQUAL = 1e-6  # difference of equal reference positions, over their range
_NEEDED = 4.0  # fall of minus two times the log-likelihood that a wider prior requires: assumed
_VARIANCES = np.logspace(0, 8, 161)  # variances that are tried, over that of the prior
_ALL_FRICTION = ("friction_wear", "viscous_friction")  # equal severities: all friction grows
_FRICTION = ("coulomb_friction", "static_friction", "viscous_friction")  # what may differ then
_KNOWN = 0.1  # standard error of a friction factor from which an axis counts: assumed
_LEVEL = 0.975  # quantile at which few differences are made up for, as a confidence interval does


@dataclass(frozen=True, eq=False)
class Difference:
    """A difference between runs of one motion.

    Its noise, and its variance from run to run, are those of a healthy recording minus its
    baseline.
    """

    torque: np.ndarray
    """Shape (samples, n_axes), in the unit of the torque of the recordings."""
    part: slice
    """Samples that it has. The others are 0."""


def differences(healthy: Sequence[Recording]) -> list[Difference]:
    """Form independent differences between runs of the same motions.

    Args:
        healthy: Recordings of the same motions of an unchanged robot. If there is only one, its
            separate recordings with equal reference positions are compared.

    Returns:
        One difference less than there are runs of each motion. It is empty if no motion was
        recorded twice.
    """
    first = healthy[0]
    if len(healthy) > 1:
        runs = np.stack([one.torque for one in healthy])
        whole = slice(0, len(first.torque))
        return [Difference(torque, whole) for torque in _contrasts(runs, 1 + 1 / len(runs))]
    found = []
    for parts in repetitions(first):
        for torque in _contrasts(np.stack([first.torque[part] for part in parts]), 2.0):
            whole_torque = np.zeros_like(first.torque)
            whole_torque[parts[0]] = torque
            found.append(Difference(whole_torque, parts[0]))
    return found


def repetitions(recording: Recording) -> list[list[slice]]:
    """Find separate recordings of the same motion: those with equal reference positions.

    Args:
        recording: The recording.

    Returns:
        The parts of each motion that was recorded at least twice.
    """
    reference = recording.reference_position
    if reference is None:
        return []
    slack = _EQUAL * np.ptp(reference, axis=0)
    groups: list[list[slice]] = []
    for part in recording.parts:
        for group in groups:
            known = reference[group[0]]
            if len(known) == part.stop - part.start and np.all(
                np.abs(reference[part] - known) <= slack
            ):
                group.append(part)
                break
        else:
            groups.append([part])
    return [group for group in groups if len(group) > 1]


def _contrasts(runs: np.ndarray, variance: float) -> np.ndarray:
    """Independent differences of runs, shape (runs - 1, ...), with a multiple of their variance."""
    count = len(runs)
    weights = np.zeros((count - 1, count))
    for k in range(1, count):  # Helmert: each run minus the mean of those before it
        weights[k - 1, :k], weights[k - 1, k] = -1 / k, 1
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    return np.sqrt(variance) * np.tensordot(weights, runs, axes=1)


def widened(problem: Problem, found: Sequence[Difference]) -> Problem:
    """Return the same problem with priors that allow for the differences between runs.

    No prior becomes narrower. If there are few differences, the standard deviations become larger
    by the ratio of the quantiles of Student's t and the normal distribution.

    Args:
        problem: The difference of a recording and its baseline, and the terms.
        found: Differences between runs of the unchanged robot.

    Returns:
        The problem with other prior standard deviations, and with `run_to_run`.
    """
    if not found:
        return problem
    variance = variances(_products(problem, found))
    prior = np.array([term.prior_std for term in problem.terms])
    spread = np.sqrt(variance - 1) * prior
    return _with_usual(problem, spread, _made_up(len(found)) * spread)


def _made_up(count: int) -> float:
    """Factor of a standard deviation that is known from a number of differences only."""
    return float(t.ppf(_LEVEL, count) / norm.ppf(_LEVEL))


def _with_usual(problem: Problem, spread: np.ndarray, allowed: np.ndarray) -> Problem:
    """The problem with wider priors, and with the `run_to_run` of what differs from run to run.

    Args:
        problem: The problem.
        spread: Standard deviation of each term from run to run, shape (terms,).
        allowed: The same, made up for its being known only roughly. It is added to the prior.
    """
    prior = np.array([term.prior_std for term in problem.terms])
    terms = [
        replace(term, prior_std=float(size))
        for term, size in zip(problem.terms, np.hypot(prior, allowed), strict=True)
    ]
    apart = np.zeros_like(problem.residual)
    if problem.run_to_run is not None:
        apart += problem.run_to_run**2
    for k in np.flatnonzero(spread > 0):
        apart += (spread[k] * problem.raw[k].astype(float)) ** 2
    return replace(with_priors(problem, terms), run_to_run=np.sqrt(apart))


def between_temperatures(problem: Problem, baseline: Recording) -> Problem:
    """Return the same problem with priors that allow for friction at another temperature.

    This is for recordings at one temperature each. Where the temperature changes within a
    recording, the data show whether friction follows it.

    Args:
        problem: The difference of a recording and its baseline, and the terms.
        baseline: The baseline.

    Returns:
        The problem with wider priors of the friction that follows the temperature, and with
        `run_to_run`; the given one if a temperature was not measured, changes within a recording,
        or is the same.
    """
    now, before = problem.recording.axis_temperature, baseline.axis_temperature
    if now is None or before is None:
        return problem
    if max(np.ptp(now, axis=0).max(), np.ptp(before, axis=0).max()) >= LEAST_RANGE:
        return problem
    reference = problem.robot.friction_temperature
    change: dict[tuple[str, int], float] = {}
    for axis, both in enumerate(zip(now.mean(axis=0), before.mean(axis=0), strict=True), start=1):
        warm, cold = (np.array(friction_ratios(float(one), reference)) for one in both)
        other = np.abs(warm / cold - 1).tolist()
        change |= {(name, axis): size for name, size in zip(FOLLOWS, other, strict=True)}
    # several terms may stand for one effect, each with another probing severity
    spread = np.array([change.get((term.name, term.axis), 0.0) for term in problem.terms])
    return _with_usual(problem, spread, spread) if spread.any() else problem


def between_axes(problem: Problem) -> Problem:
    """Return the same problem with priors that allow for friction that differs on most axes.

    The friction of each axis is multiplied by a factor of its own. Its standard deviation is the
    one with which the median of the axes is as expected (of an even number, the lower one of the
    two in the middle), so that faults of fewer than half of the axes hardly change it.

    Args:
        problem: The difference of a recording and its baseline, and the terms.

    Returns:
        The problem with other prior standard deviations, `run_to_run` and `friction_spread`. The
        given one if friction differs by no more than is allowed for anyway.
    """
    n_axes = problem.robot.n_axes
    if not problem.baseline:
        return problem
    place = {term.key: k for k, term in enumerate(problem.terms)}
    axes = range(1, n_axes + 1)
    if not all((name, axis) in place for name in {*_ALL_FRICTION, *_FRICTION} for axis in axes):
        return problem  # excluded by the user
    growing = [[place[name, axis] for name in _ALL_FRICTION] for axis in axes]
    used = problem.samples(problem.fitting)
    error = problem.whiten(problem.residual)[used].astype(float)
    factor, variance = np.empty((2, n_axes))
    for axis, both in enumerate(growing):
        std = np.array([problem.terms[k].prior_std for k in both])
        column = np.tensordot(1 / std, problem.white[both][:, used].astype(float), axes=1)
        length = max(float(np.sum(column**2)), 1e-300)
        factor[axis], variance[axis] = np.sum(column * error) / length, 1 / length
    seen = variance < _KNOWN**2
    count = int(seen.sum())
    differs = np.zeros(len(problem.terms))
    friction = [place[name, axis] for name in _FRICTION for axis in axes]
    if count < FEWEST_AXES:
        differs[friction] = USUAL
        return replace(_with_usual(problem, differs, differs), friction_spread=USUAL)

    def excess(spread: float) -> float:
        squares = np.sort(factor[seen] ** 2 / (spread**2 + variance[seen]))
        return float(squares[(count - 1) // 2] - chi2.ppf(0.5, 1))

    smallest = max(DAY_TO_DAY.values())
    if excess(smallest) <= 0:
        return problem
    spread = brentq(excess, smallest, 10 * float(np.abs(factor[seen]).max()))
    differs[friction] = spread
    wider = _with_usual(problem, differs, differs * _made_up(count - 1))
    return replace(wider, friction_spread=spread)


def _products(problem: Problem, found: Sequence[Difference]) -> list[Evidence]:
    """Inner products of the columns and each difference; the columns' once for each motion."""
    known: dict[tuple[int, int], Evidence] = {}
    products = []
    for one in found:
        white, key = problem.whiten(one.torque), (one.part.start, one.part.stop)
        if key not in known:
            known[key] = Evidence.of(problem.white, white, [one.part])
        products.append(known[key].against(problem.white, white, [one.part]))
    return products


def variances(products: Sequence[Evidence]) -> np.ndarray:
    """Find the variances of terms with which differences are most probable.

    In each step, one term gets another variance: the one that raises the likelihood most. Source:
    Tipping and Faul (2003), with the marginal likelihood of all differences together, and with
    variances of at least 1.

    Args:
        products: Inner products of the columns with each difference.

    Returns:
        Variance of each term in units of its prior variance, at least 1, shape (terms,).
    """
    count = len(products[0].right[0])
    variance = np.ones(count)
    trials = _VARIANCES[:, None, None]
    for _ in range(count):
        own, pull = np.empty((2, len(products), count))
        for k, one in enumerate(products):
            precision = one.gram.sum(axis=0)
            precision[np.diag_indices_from(precision)] += 1 / variance
            inverse = cho_solve(factored(precision), np.eye(count))
            diagonal = np.diag(inverse)
            # what a term explains beyond all others, and what it would have to be for that
            own[k] = np.maximum(1 / diagonal - 1 / variance, 0.0)
            pull[k] = inverse @ one.right.sum(axis=0) / diagonal
        now = _likelihood(variance, own, pull)
        tried = _likelihood(trials, own, pull)
        best = np.argmax(tried, axis=0)
        gain = tried[best, np.arange(count)] - now
        term = int(np.argmax(gain))
        if gain[term] < _NEEDED:
            break
        variance[term] = _VARIANCES[best[term]]
    return variance


def _likelihood(variance: np.ndarray, own: np.ndarray, pull: np.ndarray) -> np.ndarray:
    """Two times the log-likelihood with a variance of each term, less that of its being 0."""
    spread = 1 + variance * own
    return np.asarray(np.sum(variance * pull**2 / spread - np.log(spread), axis=-2))

"""How often would discovery name the right effect, if motions tell this much about each term?

The model of `evidence` is used in both directions: recordings are drawn from it, and each is
answered by the effect whose release lowers the misfit most. An answer is right if this is the true
effect on the true axis, and if it lowers the misfit by as much as discovery asks for. Everything is
linear and the noise is Gaussian, so that a recording is drawn as its inner products with the
columns. The rates are therefore ideal: a real robot also differs from its model in other ways.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from faultgen.discovery.decision.hypotheses import groups_of
from faultgen.discovery.terms.candidates import Term
from faultgen.effects import get_effect
from faultgen.inference.limits import FALL
from faultgen.robot import COULOMB, Robot

SEVERITIES = {
    "friction_wear": 0.2,
    "coulomb_friction": 0.2,
    "viscous_friction": 0.2,
    "gear_stiffness": 0.2,
    "backlash": 2e-4,
    "payload_mass": 0.1,
    "delay": 1e-3,
}
"""Severities that matter in a plant, in the unit of each effect: assumed."""

RIPPLE = 0.05
"""The same of a torque ripple, as a share of Coulomb friction: assumed."""

STANDARD_DEVIATIONS = 7.0
"""Smallest severity in standard deviations among healthy robots. Without a healthy recording, no
motion shows much smaller ones: the misfit falls by their square at most, and discovery asks for
`FALL`."""

_DRAWS = 200  # recordings of each fault
_ROUNDING = 1e-9


def severity(robot: Robot, term: Term) -> float:
    """Return the severity at which the rate of an effect is asked for.

    It is one that matters in a plant (`SEVERITIES`; for other effects their default, or the one
    with which they are probed), but at least `STANDARD_DEVIATIONS` of healthy robots.

    Args:
        robot: The robot.
        term: First term of the effect.

    Returns:
        The severity, in the unit of the effect.
    """
    effect = get_effect(term.name)
    usual = SEVERITIES.get(term.name, effect.default if effect.in_fractions else term.step)
    if term.name == "torque_ripple":
        friction = robot.ids("actuator", "friction")[term.axis - 1]
        usual = RIPPLE * float(robot.model.actuator_biasprm[friction, COULOMB]) or usual
    return max(usual, STANDARD_DEVIATIONS * term.prior_std)


@dataclass(frozen=True)
class Fault:
    """One effect on one axis, whose rate is asked for."""

    effect: str
    """Name of the effect."""
    axis: int
    """Axis, from 1."""
    severity: float
    """In the unit of the effect."""
    group: int
    """Index of the candidate that stands for it."""


@dataclass(frozen=True, eq=False)
class Candidates:
    """The candidates of a list of terms, and what discovery asks of each."""

    terms: Sequence[Term]
    """All terms."""
    groups: list[tuple[int, ...]]
    """Terms of each candidate. The sine and the cosine of a wave make one, as do the points of a
    payload."""
    keys: list[tuple[str, int]]
    """Effect and axis of each candidate."""
    sure: np.ndarray
    """By how much each must lower the misfit, shape (candidates,)."""
    least: np.ndarray
    """Smallest value of the first term of each, in prior standard deviations, same shape."""

    @classmethod
    def of(cls, terms: Sequence[Term]) -> Candidates:
        """Group the effects among terms into candidates."""
        groups = groups_of(terms)
        first = [terms[group[0]] for group in groups]
        priors = [get_effect(term.name).prior for term in first]
        return cls(
            terms=terms,
            groups=groups,
            keys=[term.key for term in first],
            sure=np.full(len(priors), FALL),
            least=np.array(
                [
                    get_effect(term.name).smallest / term.prior_std if len(group) == 1 else -np.inf
                    for term, group in zip(first, groups, strict=True)
                ]
            ),
        )

    def faults(self, robot: Robot) -> list[Fault]:
        """List the faults whose rates are asked for: all candidates at their `severity`.

        Args:
            robot: The robot.

        Returns:
            The faults, without those whose severity would not be sensible.
        """
        found = []
        for number, group in enumerate(self.groups):
            term = self.terms[group[0]]
            value = severity(robot, term)
            if value <= get_effect(term.name).largest_with(dict(term.parameters)):
                found.append(Fault(term.name, term.axis, value, number))
        return found

    def gains(self, inverse: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Compute by how much the misfit falls if a candidate becomes free.

        Args:
            inverse: Posterior covariance of all terms with their priors, shape (terms, terms).
            values: Fitted values of all terms, in prior standard deviations, of one or more
                recordings, shape (terms, recordings).

        Returns:
            Shape (candidates, recordings); 0 where the value is outside the effect's bounds.
        """
        gains = np.zeros((len(self.groups), values.shape[1]))
        for g, group in enumerate(self.groups):
            index = list(group)
            block = inverse[np.ix_(index, index)]
            own = values[index]
            # taking the unit prior of a block away, as in `Evidence.gains`
            left = np.linalg.solve(np.eye(len(index)) * (1 + _ROUNDING) - block, own)
            gain = np.sum(own * left, axis=0)
            first = (own + block @ left)[0]
            gains[g] = np.where(first > self.least[g], gain, 0.0)
        return gains


@dataclass(frozen=True, eq=False)
class Clarity:
    """How clearly each fault shows in recordings without noise; arrays of shape (faults,).

    If k is the posterior variance that data take away from a number with a prior variance of 1, a
    fault of s standard deviations lowers the misfit by k s^2. The root of what a recording shows is
    normal, with a mean of sqrt(k) s and a variance of 1 - k. The same holds for the difference of
    two effects.
    """

    size: np.ndarray
    """Severity in prior standard deviations, s."""
    own: np.ndarray
    """Share k for the true effect, from 0 to 1."""
    apart: np.ndarray
    """The same for its difference from the nearest wrong effect."""
    sure: np.ndarray
    """By how much the true effect has to lower the misfit."""

    @property
    def share(self) -> np.ndarray:
        """Share of right answers, estimated without drawing recordings.

        It is the probability that the nearest wrong effect does not lower the misfit more than the
        true one, times the probability that the true one lowers it enough.

        Returns:
            Shape (faults,).
        """
        visible = self.size * np.sqrt(self.own) - np.sqrt(self.sure)
        nearer = self.size * np.sqrt(self.apart) / 2
        spreads = (np.sqrt(np.maximum(1 - k, _ROUNDING)) for k in (self.own, self.apart))
        shares = [norm.cdf(x / y) for x, y in zip((visible, nearer), spreads, strict=True)]
        return np.asarray(shares[0] * shares[1])

    @property
    def smallest(self) -> np.ndarray:
        """Severity from which a fault is named, over that of the fault; infinite if it never is.

        Both probabilities of `share` are then at least 90 %.

        Returns:
            Shape (faults,).
        """
        z = norm.ppf(0.9)
        with np.errstate(divide="ignore"):
            seen = (np.sqrt(self.sure) + z * np.sqrt(1 - self.own)) / np.sqrt(self.own)
            nearer = 2 * z * np.sqrt(1 - self.apart) / np.sqrt(self.apart)
            return np.asarray(np.maximum(seen, nearer) / self.size)


def clarity(candidates: Candidates, faults: Sequence[Fault], gram: np.ndarray) -> Clarity:
    """Compute how clearly faults show.

    Args:
        candidates: The candidates.
        faults: The faults.
        gram: Inner products of the whitened columns, shape (terms, terms).
    """
    inverse = np.linalg.inv(gram + np.eye(len(gram)))
    first, size = _truth(candidates, faults)
    gains = candidates.gains(inverse, (np.eye(len(gram)) - inverse)[:, first] * size) / size**2
    group = [fault.group for fault in faults]
    own = np.clip(gains[group, np.arange(len(faults))], 0, 1)
    wrong = np.array([[key != (f.effect, f.axis) for f in faults] for key in candidates.keys])
    nearest = np.where(wrong, gains, 0.0).max(axis=0)
    return Clarity(size, own, np.clip(own - nearest, 0, 1), candidates.sure[group])


def _truth(candidates: Candidates, faults: Sequence[Fault]) -> tuple[list[int], np.ndarray]:
    """First term of each fault, and its severity in prior standard deviations."""
    first = [candidates.groups[fault.group][0] for fault in faults]
    size = [f.severity / candidates.terms[t].prior_std for f, t in zip(faults, first, strict=True)]
    return first, np.array(size)


@dataclass(frozen=True)
class Rate:
    """How often the answers for one fault are right."""

    right: float
    """Share of right answers."""
    wrong: float
    """Share of answers that name another effect or axis. The other answers name nothing."""
    instead: tuple[str, int] | None
    """Effect and axis that is named most often among the wrong ones."""


def draw_rates(
    candidates: Candidates, faults: Sequence[Fault], gram: np.ndarray, rng: np.random.Generator
) -> tuple[list[Rate], float]:
    """Draw recordings of robots with each fault, and count the right answers.

    The numbers of each robot differ from the model as much as those of healthy robots do.

    Args:
        candidates: The candidates.
        faults: The faults.
        gram: Inner products of the whitened columns, shape (terms, terms).
        rng: Source of the robots and the noise.

    Returns:
        Rates of each fault, and the share of healthy robots in which an effect is named.
    """
    terms = len(gram)
    inverse = np.linalg.inv(gram + np.eye(terms))
    told = np.eye(terms) - inverse
    size, axes = np.linalg.eigh(gram)
    root = axes * np.sqrt(np.maximum(size, 0.0))
    own = rng.standard_normal((terms, _DRAWS))
    noise = root @ rng.standard_normal((terms, _DRAWS))
    healthy = told @ own + inverse @ noise

    def named(values: np.ndarray) -> np.ndarray:
        """Candidate that is named in each recording; -1 if none is."""
        gains = candidates.gains(inverse, values)
        gains = np.where(gains > candidates.sure[:, None], gains, 0.0)
        return np.where(gains.max(axis=0) > 0, gains.argmax(axis=0), -1)

    rates = []
    for fault, first, severity in zip(faults, *_truth(candidates, faults), strict=True):
        answers = named(healthy + np.outer(told[:, first], severity - own[first]))
        keys = [candidates.keys[g] if g >= 0 else None for g in answers]
        counts = Counter(keys)
        right = counts.pop((fault.effect, fault.axis), 0)
        nothing = counts.pop(None, 0)
        instead = counts.most_common(1)[0][0] if counts else None
        rates.append(Rate(right / _DRAWS, (_DRAWS - right - nothing) / _DRAWS, instead))
    return rates, float(np.mean(named(healthy) >= 0))

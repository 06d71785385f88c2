"""Steps from what the simulator knows to what `faultgen discover` knows, and their answers.

steps = Steps(recorded, scales)
steps.decide(3)["C"].best      # name and axis of the best effect, with effect 3 in the robot
steps.seen(3)                  # how well discovery's columns show it
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from laboratories.effects import WAVES
from laboratories.recorded import Recorded, true_std
from scipy.special import logsumexp

from faultgen.discovery.decision.arrays import Arrays
from faultgen.discovery.decision.choice import OF_MODEL, SURE
from faultgen.discovery.decision.difference import model_of
from faultgen.discovery.decision.hypotheses import Effects
from faultgen.discovery.decision.numbers import GENERIC, KINDS, Numbers
from faultgen.discovery.decision.whitening import whitened
from faultgen.inference.hypotheses import Hypothesis
from faultgen.inference.limits import HEALTHY
from faultgen.inference.model import Model
from faultgen.inference.products import Products
from faultgen.inference.search import log_priors, search

STEPS = {
    "A": "true columns, noise and standard deviations, on the samples that discovery uses",
    "B": "as A, with discovery's noise and weights",
    "C": "discovery's columns and numbers, with true positions, noise and standard deviations",
    "D": "as C, with measured positions, and discovery's noise and weights",
    "E1": "as D, with discovery's stated standard deviations",
    "E0": "as D, with discovery's standard deviations and the scales of the healthy recording",
    "E": "as D, with discovery's standard deviations and learned scales: its decision",
}
"""Steps, each with a threshold at the largest odds of the healthy recordings."""
LIMIT = SURE + OF_MODEL
"""Threshold of discovery itself."""


@dataclass(frozen=True)
class Decision:
    """The answer of one step."""

    odds: float
    """Logarithm of the odds that there is an effect."""
    best: tuple
    """Name and axis of the most probable one."""


def _truth(one: Recorded) -> tuple[Arrays, list[Hypothesis]]:
    """The true columns in the form of discovery's; a wave has a column for each phase."""
    known, count = one.known, len(one.known.numbers)
    ones = [1.0] * count
    numbers = Numbers(False, list(known.numbers), ones, ["links"] * count, [None] * count)
    effects = Effects(numbers)
    forms: dict[tuple, list[int]] = {}
    for k, (effect, change) in enumerate(zip(known.effects, known.changes, strict=True)):
        effects.columns.append(change)
        effects.std.append(1.0)
        effects.mean.append(0.0)
        effects.unknown.append(False)
        key: tuple = (effect.name, effect.axis)
        if effect.name in WAVES:
            key = (effect.name, effect.axis, effect.details["order"])
        forms.setdefault(key, []).append(k)
    residual = one.arrays.posed.replay.recording.torque - known.base
    arrays = replace(one.arrays, residual=residual, numbers=numbers, effects=effects)
    return arrays, [Hypothesis(key, key[0], (tuple(own),)) for key, own in forms.items()]


def _with_true_std(arrays: Arrays, one: Recorded) -> Arrays:
    """The same numbers with the standard deviations that they have in the simulator."""
    std = true_std(arrays, one.known.setup).tolist()
    return replace(arrays, numbers=replace(arrays.numbers, std=std))


def _named(arrays: Arrays) -> list[Hypothesis]:
    """Hypotheses of the catalogue."""
    return [one for one in arrays.effects.hypotheses if not one.unknown]


def decided(model: Model, hypotheses: Sequence[Hypothesis], log_scales: np.ndarray) -> Decision:
    """Weigh single effects by Bayes factors with given scales of the numbers.

    Args:
        model: The numbers and effects.
        hypotheses: What may be there.
        log_scales: Shape (groups,).
    """
    forms = [form for one in hypotheses for form in one.forms]
    owner = np.repeat(np.arange(len(hypotheses)), [len(one.forms) for one in hypotheses])
    factors = model.bayes_factors(log_scales, forms)
    total = log_priors(hypotheses)
    for h in range(len(hypotheses)):
        own = factors[owner == h]
        total[h] += logsumexp(own) - np.log(len(own))
    odds = float(logsumexp(total) - np.log(HEALTHY))
    return Decision(odds, hypotheses[int(np.argmax(total))].key[:2])


class Steps:
    """The decisions of all steps on one healthy recording, with an effect or without."""

    def __init__(self, one: Recorded, scales: np.ndarray) -> None:
        """Prepare what all effects share.

        Args:
            one: The recording.
            scales: From `true_scales`.
        """
        self.one, self.scales = one, scales
        self._true, self._true_hypotheses = _truth(one)
        self._exact, self._measured = (_with_true_std(a, one) for a in (one.exact, one.arrays))
        none = np.zeros((0, *one.known.clean.shape), np.float32)
        self._of_truth = self._clean(self._true, none)
        self._of_exact = self._clean(self._exact, one.known.changes)

    def _clean(self, arrays: Arrays, changes: np.ndarray) -> Products:
        """Products of columns, and of changes by effects, with the true noise."""
        known, inside = self.one.known, arrays.inside
        columns = np.concatenate([arrays.columns, changes.astype(np.float32)])
        target = known.white(arrays.residual) * inside
        return Products.of(known.white(columns) * inside, target, int(inside.sum()))

    @cached_property
    def _learned(self) -> np.ndarray:
        """Scales of the healthy recording, as discovery learns them."""
        model = model_of(self.one.arrays, whitened(self.one.arrays).products)
        return model.without(GENERIC).healthy.log_scales

    def decide(self, k: int | None) -> dict[str, Decision]:
        """Answers with an effect in the robot.

        Args:
            k: Number of the effect; None: the robot is healthy.

        Returns:
            By step.
        """
        one, zero = self.one, np.zeros(len(KINDS))
        change = 0.0 if k is None else one.known.changes[k]
        true, own = (replace(a, residual=a.residual + change) for a in (self._true, one.arrays))
        truth, exact = self._of_truth, self._of_exact
        if k is not None:
            truth = _added(truth, len(one.known.numbers) + k)
            exact = _added(exact, len(self._exact.std) + k)
        exact = exact.only(np.arange(len(self._exact.std)))
        out = {
            step: decided(model_of(true, products), self._true_hypotheses, zero)
            for step, products in (("A", truth), ("B", whitened(true).products))
        }
        noisy = whitened(own).products
        for step, arrays, products, scales in (
            ("C", self._exact, exact, self.scales),
            ("D", self._measured, noisy, self.scales),
            ("E1", own, noisy, zero),
            ("E0", own, noisy, self._learned),
        ):
            model = model_of(arrays, products).without(GENERIC)
            out[step] = decided(model, _named(arrays), scales)
        found = search(model_of(own, noisy), own.effects.hypotheses, LIMIT, GENERIC)
        first = found.effects[0] if found.effects else found.rejected
        return out | {"E": Decision(first.odds, first.keys[0][:2])}

    @cached_property
    def _grams(self) -> dict[str, tuple[Arrays, np.ndarray]]:
        """Inner products of discovery's effects, then of true changes, without its numbers."""
        own = self.one.arrays
        gram = self._clean(own, self.one.known.changes).gram
        exact = self._of_exact.gram
        raw = exact[len(self._exact.numbers.std) :, len(self._exact.numbers.std) :]
        return {
            "raw": (self._exact, raw),
            "C": (self._exact, _beside_numbers(self._exact, exact, self.scales)),
            "E": (own, _beside_numbers(own, gram, self._learned)),
        }

    def seen(self, k: int) -> dict[str, Any]:
        """How well discovery's columns show an effect, all in units of the true noise.

        Args:
            k: Number of the effect.

        Returns:
            `d_used`: the d' that is left on the samples that discovery uses, beside the true
            numbers. `d_<step>`, `r_<step>`, `rival_<step>`: the d' that is left beside discovery's
            numbers, the correlation of the true change with discovery's column (the best form), and
            the other effect and axis with the largest correlation. `raw` is C without numbers.
        """
        known = self.one.known
        n, effect = len(known.numbers), known.effects[k]
        left = _left(self._of_truth.gram, n, np.ones(n))
        out: dict[str, Any] = {"d_used": float(np.sqrt(left[k, k]))}
        for name, (arrays, gram) in self._grams.items():
            at = len(arrays.effects.std) + k
            out[f"d_{name}"] = float(np.sqrt(max(gram[at, at], 0.0)))
            shares: dict[tuple, float] = {}
            for one in _named(arrays):
                best = max(_share(gram, form, at) for form in one.forms)
                shares[one.key[:2]] = max(shares.get(one.key[:2], 0.0), best)
            mine = shares.pop((effect.name, effect.axis), 0.0)
            rival = max(shares, key=lambda key: shares[key])
            out[f"r_{name}"] = float(np.sqrt(mine))
            out[f"rival_{name}"] = [*rival, float(np.sqrt(shares[rival]))]
        return out


def _added(products: Products, k: int) -> Products:
    """Inner products with a difference to which column k was added."""
    energy = products.energy + 2 * products.right[k] + products.gram[k, k]
    right = products.right + products.gram[:, k]
    return Products(products.gram, right, float(energy), products.count)


def _beside_numbers(arrays: Arrays, gram: np.ndarray, log_scales: np.ndarray) -> np.ndarray:
    """Inner products without what numbers of known form explain."""
    numbers, known = arrays.numbers, np.array(arrays.numbers.known)
    std = np.array(numbers.std) * np.exp(log_scales)[numbers.group]
    both = np.concatenate([known, np.arange(len(std), len(gram))])
    return _left(gram[np.ix_(both, both)], len(known), std[known])


def _left(gram: np.ndarray, count: int, std: np.ndarray) -> np.ndarray:
    """Inner products of all but the first columns, given that those differ by `std`."""
    inner, outer = slice(count), slice(count, None)
    known = gram[inner, inner] * np.outer(std, std) + np.eye(count)
    across = gram[inner, outer] * std[:, None]
    return np.asarray(gram[outer, outer] - across.T @ np.linalg.solve(known, across))


def _share(gram: np.ndarray, form: Sequence[int], at: int) -> float:
    """Squared correlation of a column with the span of others."""
    columns = np.array(form)
    inner, along = gram[np.ix_(columns, columns)], gram[columns, at]
    value = np.linalg.lstsq(inner, along, rcond=1e-9)[0]
    return float(np.clip(along @ value / max(gram[at, at], 1e-12), 0.0, 1.0))

"""Whether data to which nothing was fitted speak for an effect, or against it.

kept, refuted = confirmed(found, held_out)
model = without_refuted(model, held_out, ["stiffness"])
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from faultgen.inference.hypotheses import SingleEffect
from faultgen.inference.limits import AGAINST, OF_EVIDENCE
from faultgen.inference.model import LARGEST, Fitted, Group, Model
from faultgen.inference.products import ROUNDING, Products
from faultgen.inference.search import Found

_EXACT = Group("", 1.01, float(np.exp(-LARGEST)))  # the smallest scale, which is known


def log_predictive(fitted: Fitted, held_out: Products) -> float:
    """Compute the logarithm of the probability of other data, up to a constant.

    They are normal about what the fit foretells, with the variance of the noise and of the errors
    of all numbers and effects (Bishop 2006, 3.3.2).

    Args:
        fitted: A fit to some data.
        held_out: Inner products of the columns of its model with the others.
    """
    model = fitted.model
    chosen = np.array([*range(model.count), *(model.count + k for k in fitted.effects)], int)
    mine = held_out.only(chosen).about(fitted.values)
    size = np.sqrt(np.diag(fitted.covariance))
    correlation = fitted.covariance / np.outer(size, size)
    root = np.linalg.cholesky(correlation + ROUNDING * len(size) * np.eye(len(size)))
    root *= size[:, None]
    inner = np.eye(len(size)) + root.T @ mine.gram @ root
    factor = cho_factor(inner)
    right = root.T @ mine.right
    explained = float(right @ cho_solve(factor, right))
    return 0.5 * (explained - mine.energy) - float(np.log(np.diag(factor[0])).sum())


def confirmed(
    found: Found, held_out: Products
) -> tuple[Found, tuple[tuple[SingleEffect, float], ...]]:
    """Take back effects that other data refute, the most refuted first.

    Args:
        found: What was found in some data.
        held_out: Inner products of the columns of its model with others.

    Returns:
        The effects that remain, and those that were taken back with the logarithm of the ratio of
        the probabilities of the other data with and without them.
    """
    refuted: list[tuple[SingleEffect, float]] = []
    while found.effects:
        whole = log_predictive(found.fitted, held_out)
        gained = []
        for k in range(len(found.effects)):
            without = _with(found.fitted, [one for j, one in enumerate(found.effects) if j != k])
            # numbers that stand for the effect are wide; as wide, they allow for errors of its law
            wide = replace(found.fitted, log_scales=without.log_scales)
            best = max(whole, log_predictive(wide, held_out))
            gained.append(best - log_predictive(without, held_out))
        allowed = [-AGAINST - OF_EVIDENCE * max(one.odds, 0.0) for one in found.effects]
        worst = int(np.argmin(np.subtract(gained, allowed)))
        if gained[worst] >= allowed[worst]:
            break
        refuted.append((found.effects[worst], gained[worst]))
        kept = tuple(one for j, one in enumerate(found.effects) if j != worst)
        found = replace(found, effects=kept, fitted=_with(found.fitted, kept))
    return found, tuple(refuted)


def without_refuted(model: Model, held_out: Products, names: Collection[str]) -> Model:
    """Take numbers of some groups for exact, where their values make other data less probable.

    Args:
        model: Numbers and effects.
        held_out: Inner products of its columns with other data.
        names: Names of the groups that are judged.

    Returns:
        The model, in which the numbers of refuted groups are as exact as they may be.
    """
    for _ in names:
        healthy = model.healthy
        whole = log_predictive(healthy, held_out)
        gained = {}
        for k, group in enumerate(model.groups):
            if group.name in names and group.centre > _EXACT.centre and np.any(model.group == k):
                scales = healthy.log_scales.copy()
                scales[k] = np.log(_EXACT.centre)
                gained[k] = log_predictive(replace(healthy, log_scales=scales), held_out) - whole
        worst = max(gained, key=lambda k: gained[k], default=None)
        if worst is None or gained[worst] < AGAINST:
            break
        groups = list(model.groups)
        groups[worst] = replace(_EXACT, name=groups[worst].name)
        model = replace(model, groups=tuple(groups))
    return model


def _with(fitted: Fitted, effects: Sequence[SingleEffect]) -> Fitted:
    """The fit with other effects."""
    model: Model = fitted.model
    return model.fit([column for one in effects for column in one.forms[0]], fitted)

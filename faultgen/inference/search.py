"""Which effects a difference shows: hypotheses, their posterior probabilities, and sets of effects.

A hypothesis is one effect at one place. It may have several forms, such as plays of several sizes,
which share its prior probability. Effects are added one at a time, each as a posterior distribution
over all hypotheses (a sum of single effects, as Wang et al. 2020 have it in genetics): what cannot
be told apart stays together in a credible set.

    found = search(model, hypotheses)
    found.effects[0].probabilities
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logsumexp

from faultgen.inference.hypotheses import Hypothesis, SingleEffect
from faultgen.inference.law_error import Kin, law_errors, of_kin, shared_error, shifted
from faultgen.inference.limits import FORM_ERROR, HEALTHY, LAW_ERROR, LIKELY, MOST_EFFECTS
from faultgen.inference.model import Fitted, Model

_LISTED = 12  # hypotheses whose scales are found again; the others are far behind


@dataclass(frozen=True, eq=False)
class Found:
    """The effects that a difference shows."""

    effects: tuple[SingleEffect, ...]
    """In the order in which they were found."""
    rejected: SingleEffect
    """The next one, which is not sure."""
    fitted: Fitted
    """The model with the best form of each effect."""

    def or_likely(self, named: Sequence[Hypothesis]) -> Found:
        """Return the same, with the next effect if there is none and this one is likely.

        Args:
            named: The hypotheses that have a name.
        """
        next_ = self.rejected
        if self.effects or next_.odds < LIKELY or _is_unknown(next_, named):
            return self
        return replace(
            self, effects=(next_,), fitted=self.fitted.model.fit(next_.forms[0], self.fitted)
        )

    def by_size(self) -> list[SingleEffect]:
        """Return the effects, the one that changes the torque most first.

        The surest one may be small, where numbers of a healthy robot take up a larger one.
        """
        count, values = self.fitted.model.count, self.fitted.values
        sizes, at = [], count
        for effect in self.effects:
            own = self.fitted.model.products.only(count + np.array(effect.forms[0])).gram
            value = values[at : at + len(own)]
            sizes.append(float(value @ own @ value))
            at += len(own)
        return [self.effects[k] for k in np.argsort(-np.array(sizes), kind="stable")]


def search(
    model: Model,
    hypotheses: Sequence[Hypothesis],
    sure: float,
    generic: Collection[str] = (),
) -> Found:
    """Find the effects.

    Named hypotheses are compared with a robot that has no torque of unknown form. No model is
    exact, and on real robots such a torque may explain much at every place. The evidence for an
    effect is therefore lowered by that for an unknown one at a typical other place, or by what an
    unknown one still explains at its own place beside the effect and the error of its law,
    whichever is more.

    An unknown effect, which could be anything, has to be more than what all axes of a healthy robot
    have of it. It takes the place of a named one if it explains clearly more.

    Args:
        model: The numbers and the columns of all effects.
        hypotheses: What may be there.
        sure: Logarithm of the odds from which an effect counts.
        generic: Groups of numbers that stand for torques of unknown form.

    Returns:
        The effects, each with its rivals.
    """
    named = [one for one in hypotheses if not one.unknown]
    unknown = [one for one in hypotheses if one.unknown]
    exact = model.without(generic)
    known: list[int] = []
    found: list[SingleEffect] = []
    taken: set[tuple] = set()
    fitted, rough = exact.healthy, model.healthy
    share = len(_families(named)) + 1
    while True:
        left = [one for one in named if one.key not in taken]
        kin = of_kin(named, found)
        best, after = _next(exact, left, known, fitted, np.log((share - 1) / share), kin)
        any_, with_any = _next(
            model, [one for one in unknown if one.key not in taken], known, rough, -np.log(share)
        )
        if left:
            place = next(one.place for one in left if one.key == best.keys[0])
            before = _misfits(exact, unknown, known, fitted)
            beside = _beside(exact, unknown, known, best.forms[0], after, place)
            others = [value for at, value in before.items() if at != place]
            misfit = max(0.0, beside, float(np.median(others)) if others else 0.0)
            best = replace(best, odds=best.odds - misfit)
        left_over = LAW_ERROR * sum(one.odds for one in found)
        best, any_ = (replace(one, odds=one.odds - left_over) for one in (best, any_))
        is_sure, is_there = best.odds >= sure, any_.odds >= sure
        if len(found) == MOST_EFFECTS or not (is_sure or is_there):
            rejected = best if best.odds > any_.odds else any_
            return _again(exact, named, Found(tuple(found), rejected, fitted), sure)
        if is_sure:
            with_best = model.fit([*known, *best.forms[0]], rough)
            own = model.count + np.array(best.forms[0])
            value = with_best.values[-len(own) :]
            errors = law_errors(model, with_best.log_scales, own, value, any_.forms[:1])
            gained = with_any.log_evidence - with_best.log_evidence - float(errors.sum())
            if not (is_there and gained > sure):
                any_, with_any = best, with_best
        found.append(any_)
        taken.add(any_.keys[0])
        known += any_.forms[0]
        rough = with_any
        fitted = after if any_ is best else exact.fit(known, fitted)


def _misfits(
    exact: Model, unknown: Sequence[Hypothesis], known: Sequence[int], fitted: Fitted
) -> dict[int, float]:
    """Logarithm of the Bayes factor of the best unknown effect at each place."""
    places = [one.place for one in unknown for _ in one.forms]
    forms = [form for one in unknown for form in one.forms]
    out: dict[int, float] = {}
    factors = exact.bayes_factors(fitted.log_scales, forms, known)
    for place, factor in zip(places, factors.tolist(), strict=True):
        out[place] = max(out.get(place, -np.inf), factor)
    return out


def _beside(
    exact: Model,
    unknown: Sequence[Hypothesis],
    known: Sequence[int],
    form: Sequence[int],
    fitted: Fitted,
    place: int,
) -> float:
    """Logarithm of the Bayes factor of the best unknown effect beside an effect at its place."""
    forms = [one for other in unknown if other.place == place for one in other.forms]
    if not forms:
        return 0.0
    factors = exact.bayes_factors(fitted.log_scales, forms, [*known, *form])
    own = exact.count + np.array(form)
    value = fitted.values[-len(own) :]
    return float((factors - law_errors(exact, fitted.log_scales, own, value, forms)).max())


def _again(exact: Model, named: Sequence[Hypothesis], found: Found, sure: float) -> Found:
    """Judge each named effect once more beside all others, as the first ones stood alone before."""
    effects: list[SingleEffect | None] = list(found.effects)
    fitted = found.fitted
    places = [k for k, one in enumerate(found.effects) if not _is_unknown(one, named)]
    if len(places) < 2:
        return found
    for place in places:
        others = [one for k, one in enumerate(effects) if k != place and one is not None]
        known = [column for one in others for column in one.forms[0]]
        taken = {one.keys[0] for one in others}
        beside = exact.fit(known, fitted)
        left = [one for one in named if one.key not in taken]
        share = len(_families(named)) + 1
        kin = of_kin(named, others)
        best, after = _next(exact, left, known, beside, np.log((share - 1) / share), kin)
        larger = [one.odds for one in others if one.odds > best.odds]
        stays = best.odds >= sure + LAW_ERROR * sum(larger)
        effects[place] = best if stays else None
        fitted = after if stays else beside
    kept = tuple(one for one in effects if one is not None)
    fitted = exact.fit([column for one in kept for column in one.forms[0]], fitted)
    return Found(kept, found.rejected, fitted)


def _is_unknown(effect: SingleEffect, named: Sequence[Hypothesis]) -> bool:
    """Whether an effect is none of the named ones."""
    return effect.keys[0] not in {one.key for one in named}


def _next(
    model: Model,
    hypotheses: Sequence[Hypothesis],
    known: Sequence[int],
    fitted: Fitted,
    log_share: float,
    kin: Kin | None = None,
) -> tuple[SingleEffect, Fitted]:
    """One more effect beside those that are known, and the model with it.

    Args:
        model: Numbers and effects.
        hypotheses: What may be there.
        known: Columns of the known effects.
        fitted: The model with them.
        log_share: Logarithm of the prior probability of all hypotheses, given that there is one.
        kin: The known effects by their laws.
    """
    if not hypotheses:
        return SingleEffect(-np.inf, (), np.zeros(0), ()), fitted
    prior = log_priors(hypotheses) + log_share
    forms = [form for one in hypotheses for form in one.forms]
    owner = np.repeat(np.arange(len(hypotheses)), [len(one.forms) for one in hypotheses])
    # numbers that a fault has widened hide it, and such of the literature do not
    usual = np.minimum(fitted.log_scales, 0.0)
    factors = [model.bayes_factors(one, forms, known) for one in (fitted.log_scales, usual)]
    candidates: list[int] = []
    for factor in factors:
        weighed = factor + prior[owner]
        candidates += np.argsort(-weighed)[:_LISTED].tolist()
    again: dict[int, tuple[float, Fitted]] = {}
    nearest = fitted
    for k in dict.fromkeys(candidates):
        made = model.fit([*known, *forms[k]], fitted, nearest)
        if made.log_evidence > nearest.log_evidence:
            nearest = made
        law = shifted(model, made, hypotheses[owner[k]], forms[k], kin or {})
        again[k] = made.log_evidence - fitted.log_evidence - law, made
    evidence = np.full(len(hypotheses), -np.inf)
    best = dict.fromkeys(range(len(hypotheses)), -1)
    for h in range(len(hypotheses)):
        own = [k for k in again if owner[k] == h]
        if not own:
            continue
        values = np.array([again[k][0] for k in own])
        evidence[h] = logsumexp(values) - np.log(len(hypotheses[h].forms))
        best[h] = own[int(np.argmax(values))]
    odds = float(logsumexp(evidence + prior) - np.log(HEALTHY))
    order = [h for h in np.argsort(-(evidence + prior)).tolist() if np.isfinite(evidence[h])]
    first = hypotheses[order[0]]
    same = [
        hypotheses[h].kin == first.kin != "" and hypotheses[h].place == first.place for h in order
    ]
    errors = np.full(len(order), FORM_ERROR * max(float(evidence[order[0]]), 0.0))
    leading, fit = forms[best[order[0]]], again[best[order[0]]][1]
    for place, h in enumerate(order):
        if same[place] and place:
            other = again[best[h]][1]
            errors[place] = shared_error(model, leading, fit, forms[best[h]], other)
    weights = evidence[order] + prior[order]
    weights = (weights - weights[0]) / (1 + errors)
    falling = np.argsort(-weights, kind="stable")
    order, weights = [order[k] for k in falling], weights[falling]
    effect = SingleEffect(
        odds,
        tuple(hypotheses[h].key for h in order),
        np.exp(weights - logsumexp(weights)),
        tuple(forms[best[h]] for h in order),
    )
    return effect, again[best[order[0]]][1]


def _families(hypotheses: Sequence[Hypothesis]) -> dict[str, int]:
    """Number of hypotheses of each family."""
    return Counter(one.family for one in hypotheses)


def log_priors(hypotheses: Sequence[Hypothesis]) -> np.ndarray:
    """Logarithm of the prior probability of each: families are equally probable.

    Args:
        hypotheses: What may be there.

    Returns:
        Shape (hypotheses,).
    """
    count = _families(hypotheses)
    shares = np.array([1 / (len(count) * count[one.family]) for one in hypotheses])
    return np.log((1 - HEALTHY) * shares)

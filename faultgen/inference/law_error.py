"""What errors of laws let other effects explain.

No real effect follows its law exactly. A share of what it explains, `LAW_ERROR`, is taken for an
error of this law, which another effect may imitate: another law of friction on the same axis, or a
torque of no known form.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from faultgen.inference.hypotheses import Hypothesis, SingleEffect
from faultgen.inference.limits import LAW_ERROR
from faultgen.inference.model import Fitted, Model

Kin = dict[tuple[str, int], list[tuple[int, ...]]]
"""Columns of known effects that change one law at one place, by both."""


def of_kin(named: Sequence[Hypothesis], found: Sequence[SingleEffect]) -> Kin:
    """Sort the columns of known effects by the law and the place.

    Args:
        named: The hypotheses that have a name.
        found: The known effects.

    Returns:
        Their columns.
    """
    laws = {one.key: (one.kin, one.place) for one in named}
    out: Kin = {}
    for effect in found:
        out.setdefault(laws.get(effect.keys[0], ("", 0)), []).append(effect.forms[0])
    return out


def law_errors(
    model: Model,
    log_scales: np.ndarray,
    columns: np.ndarray,
    values: np.ndarray,
    others: Sequence[Sequence[int]],
) -> np.ndarray:
    """What the error of a law lets others explain beside it.

    Args:
        model: Numbers and effects.
        log_scales: Logarithm of the scale of each group.
        columns: Columns of numbers and effects that change this law.
        values: Their values, same shape.
        others: Columns of effects of each form of others.

    Returns:
        Half of the squared residual that each may explain, shape (forms,): `LAW_ERROR` of that of
        the law, of which numbers take the same part as of the other one.
    """
    effects = model.products.only(np.arange(model.count, len(model.std)))
    left = np.diag(model.without_numbers(log_scales).gram)
    explained = 0.5 * float(values @ model.products.only(columns).gram @ values)
    whole = np.diag(effects.scaled(model.std[model.count :]).gram)
    sizes = [(left[list(one)].sum(), whole[list(one)].sum()) for one in others]
    # what changes no sample that is used, as on an axis that rests, explains nothing
    parts = [of_left / of_whole if of_whole > 0 else 0.0 for of_left, of_whole in sizes]
    return LAW_ERROR * explained * np.array(parts)


def shifted(
    model: Model, fitted: Fitted, hypothesis: Hypothesis, form: Sequence[int], kin: Kin
) -> float:
    """What the error of its own law lets a hypothesis explain, beside numbers and known effects.

    Args:
        model: Numbers and effects.
        fitted: The model with the known effects and the hypothesis, whose part numbers do not have
            to take there.
        hypothesis: The hypothesis.
        form: Its columns.
        kin: The known effects.
    """
    effects = [k for one in kin.get((hypothesis.kin, hypothesis.place), ()) for k in one]
    if not hypothesis.kin or not (hypothesis.same or effects):
        return 0.0
    places = [model.count + fitted.effects.index(k) for k in effects]
    columns = np.array([*hypothesis.same, *(model.count + k for k in effects)], int)
    values = fitted.values[[*hypothesis.same, *places]]
    return float(law_errors(model, fitted.log_scales, columns, values, [form])[0])


def shared_error(
    model: Model,
    form: Sequence[int],
    fitted: Fitted,
    other: Sequence[int],
    fitted_other: Fitted,
) -> float:
    """What the error of a law may explain of the difference of two effects that change it.

    Args:
        model: Numbers and effects.
        form: Columns of one effect.
        fitted: The model with it as its last one.
        other: Columns of the other effect.
        fitted_other: The model with that one.

    Returns:
        Half of the squared residual: `LAW_ERROR` of that of the first effect, of which numbers take
        the same part as of the difference.
    """
    columns, own = np.array([*form, *other]), len(form)
    values = np.concatenate([fitted.values[-own:], -fitted_other.values[-len(other) :]])
    raw = model.products.only(model.count + columns).gram
    left = model.without_numbers(fitted.log_scales).only(columns).gram
    size = values / model.std[model.count + columns]
    explained = 0.5 * float(values[:own] @ raw[:own, :own] @ values[:own])
    whole = float(values @ raw @ values)
    return LAW_ERROR * explained * float(size @ left @ size) / whole if whole > 0 else 0.0

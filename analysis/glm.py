"""Generalised linear models that are compared one after another, thesis tables 4.5 to 4.11.

    sequence(frame, "lead", ("source", "signal", "condition"), "poisson")  # rows of table 4.8
    terms(frame, "lead", ("source", "signal", "condition"), "poisson")  # rows of table 4.9

All models have a logarithmic link. Differences of deviance are tested as in R's
`anova(test = "Chisq")`: they are divided by the dispersion of the larger model (Pearson's statistic
over its degrees of freedom; 1 for Poisson) and compared with chi-squared.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import pandas as pd
import statsmodels.api as sm
import statsmodels.formula.api as smf
from scipy import stats

Family = Literal["gamma", "poisson"]
Factors = tuple[str, str, str]

_SMALLEST = 1e-6  # relative to the mean; responses of Gamma models are positive

COMPARED = (None, 1, 2, 3, 4, 4, 6, 7)
"""Model with which each of the eight is compared, in thesis tables 4.6, 4.8 and 4.10."""


def formulas(factors: Factors) -> list[str]:
    """Return the right-hand sides of the eight models of thesis table 4.5.

    As in R, the last model contains all products within its highest one. It has three degrees of
    freedom more than the model before it.

    Args:
        factors: Source of training, type of signal, condition of the robot.

    Returns:
        One formula per model.
    """
    a, b, c = factors
    main = f"{a} + {b} + {c}"
    return [
        "1",
        a,
        f"{a} + {b}",
        main,
        f"{main} + {a}:{b}",
        f"{main} + {b}:{c}",
        f"{main} + {a}:{b} + {b}:{c}",
        f"{main} + {a}:{b} + {b}:{c} + {a}:{c} + {a}:{b}:{c}",
    ]


def sequence(
    frame: pd.DataFrame, response: str, factors: Factors, family: Family
) -> list[dict[str, Any]]:
    """Fit the eight models, and compare each with the model that it extends.

    Args:
        frame: One row per observation.
        response: Column of the response: positive for gamma, counts for poisson.
        factors: Columns of the factors.
        family: Distribution of the response.

    Returns:
        One row per model, from 1: "model", "against", "residual_df", "residual_deviance" and,
        except for the first, "df", "deviance" and "p" of the difference.

    Raises:
        ValueError: The response does not fit the family.
    """
    fitted = [_fit(frame, response, right, family) for right in formulas(factors)]
    rows = []
    for number, (model, against) in enumerate(zip(fitted, COMPARED, strict=True), start=1):
        row = {"model": number, "against": against, **_residual(model)}
        if against is not None:
            row |= _difference(fitted[against - 1], model, _dispersion(model, family))
        rows.append(row)
    return rows


def terms(
    frame: pd.DataFrame, response: str, factors: Factors, family: Family, *, main_only: bool = False
) -> list[dict[str, Any]]:
    """Add the terms of one model one by one, thesis tables 4.7, 4.9 and 4.11.

    Args:
        frame: One row per observation.
        response: Column of the response, as `sequence`.
        factors: Columns of the factors.
        family: Distribution of the response.
        main_only: Whether to stop at model 4, as table 4.7 does, instead of model 8.

    Returns:
        One row per term, "null" first: "term", "residual_df", "residual_deviance" and, except for
        the first, "df", "deviance" and "p" with the dispersion of the last model.

    Raises:
        ValueError: The response does not fit the family.
    """
    a, b, c = factors
    added = [a, b, c]
    if not main_only:
        added += [f"{a}:{b}", f"{b}:{c}", f"{a}:{c}", f"{a}:{b}:{c}"]
    models = [
        _fit(frame, response, " + ".join(["1", *added[:n]]), family) for n in range(len(added) + 1)
    ]
    dispersion = _dispersion(models[-1], family)
    rows: list[dict[str, Any]] = [{"term": "null", **_residual(models[0])}]
    for term, smaller, larger in zip(added, models, models[1:], strict=False):
        name = term.replace(":", "*")
        rows.append({"term": name, **_residual(larger), **_difference(smaller, larger, dispersion)})
    return rows


def _fit(frame: pd.DataFrame, response: str, right: str, family: Family) -> Any:
    values = frame[response].to_numpy(float)
    if family == "gamma":
        if not (values > _SMALLEST * np.abs(values).mean()).all():
            raise ValueError(f"{response}: a Gamma model needs positive values")
        law: Any = sm.families.Gamma(sm.families.links.Log())
    else:
        if (values < 0).any() or (values != np.round(values)).any():
            raise ValueError(f"{response}: a Poisson model needs counts")
        law = sm.families.Poisson()
    return smf.glm(f"{response} ~ {right}", frame, family=law).fit(maxiter=200, tol=1e-12)


def _dispersion(model: Any, family: Family) -> float:
    return 1.0 if family == "poisson" else float(model.pearson_chi2 / model.df_resid)


def _residual(model: Any) -> dict[str, Any]:
    return {"residual_df": int(model.df_resid), "residual_deviance": float(model.deviance)}


def _difference(smaller: Any, larger: Any, dispersion: float) -> dict[str, Any]:
    df = int(smaller.df_resid - larger.df_resid)
    deviance = float(smaller.deviance - larger.deviance)
    p = float(stats.chi2.sf(max(deviance, 0.0) / dispersion, df))
    return {"df": df, "deviance": deviance, "p": p}

"""Comparison of groups: procedure 2 of the thesis, its factorial ANOVA, and bootstrap over robots.

    found = compare(groups)  # arrays of AUC by name of the preprocessing
    found.variances_differ, found.p, found.post_hoc["control", "+diff"]
    anova(frame, "variation", ["source", "signal", "condition"])  # rows of table 4.2

The generalised linear models of tables 4.5 to 4.11 are in `analysis.glm`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd
import statsmodels.formula.api as smf
from numpy.typing import ArrayLike, NDArray
from scipy import stats
from statsmodels.stats.anova import anova_lm

Floats = NDArray[np.float64]
Pairs = dict[tuple[str, str], float]

SIGNIFICANT = 0.05
"""Significance level of all tests in the thesis."""


@dataclass(frozen=True)
class Comparison:
    """Whether groups differ, and which pairs do."""

    levene: float
    """p-value of Levene's test for equal variances."""
    variances_differ: bool
    """Whether Welch's ANOVA and Games-Howell were used instead of ANOVA and Tukey's HSD."""
    statistic: float
    """F of the ANOVA."""
    p: float
    """p-value of the ANOVA for equal means."""
    post_hoc: Pairs
    """p-value of each pair, adjusted for the number of pairs; by names in the order of the
    groups."""

    @property
    def means_differ(self) -> bool:
        """Whether the means differ, so that the post-hoc test may be used."""
        return self.p < SIGNIFICANT

    def between(self, one: str, other: str) -> float:
        """Return the adjusted p-value of a pair.

        Args:
            one: Name of a group.
            other: Name of another group. The order does not matter.

        Returns:
            The adjusted p-value.

        Raises:
            ValueError: There is no such pair.
        """
        found = self.post_hoc.get((one, other), self.post_hoc.get((other, one)))
        if found is None:
            raise ValueError(f"no such pair of groups: {one} and {other}")
        return found


def compare(groups: Mapping[str, ArrayLike], *, significant: float = SIGNIFICANT) -> Comparison:
    """Compare the means of groups with equal or unequal variances (thesis procedure 2).

    Levene's test uses medians (Brown and Forsythe), as in R's lawstat. If it finds that variances
    differ, Welch's ANOVA and the Games-Howell test follow. Otherwise ANOVA and Tukey's HSD follow
    (Tukey and Kramer's if sizes differ). Post-hoc p-values are always computed, but procedure 2
    uses them only if `means_differ`.

    Args:
        groups: Values of at least two groups. Each group has at least two, and not all groups are
            constant.
        significant: Significance level of Levene's test.

    Returns:
        The comparison.

    Raises:
        ValueError: There are too few groups or values, a value is not finite, or no group varies.
    """
    values = _checked(groups)
    levene = levene_p(*values)
    differ = bool(levene < significant)
    anova_found = stats.f_oneway(*values, equal_var=not differ)
    return Comparison(
        levene=levene,
        variances_differ=differ,
        statistic=float(anova_found.statistic),
        p=float(anova_found.pvalue),
        post_hoc=_post_hoc(list(groups), values, equal_variances=not differ),
    )


def levene_p(*values: ArrayLike) -> float:
    """Compute the p-value of Levene's test about medians for equal variances of groups.

    It is 1 for two groups that are equal, and if all groups are constant.
    """
    arrays = [np.asarray(own, dtype=float) for own in values]
    deviations = np.concatenate([np.abs(own - np.median(own)) for own in arrays])
    if np.ptp(deviations) == 0:
        return 1.0
    return float(stats.levene(*arrays, center="median").pvalue)


def tukey(groups: Mapping[str, ArrayLike]) -> Pairs:
    """Compute adjusted p-values by Tukey's HSD (Tukey and Kramer's if sizes differ).

    Args:
        groups: Values of at least two groups, as `compare`.

    Returns:
        p-value of each pair, by names.
    """
    return _post_hoc(list(groups), _checked(groups), equal_variances=True)


def _post_hoc(names: Sequence[str], values: Sequence[Floats], *, equal_variances: bool) -> Pairs:
    found = stats.tukey_hsd(*values, equal_var=equal_variances).pvalue
    return {(names[i], names[j]): float(found[i, j]) for i, j in combinations(range(len(names)), 2)}


def anova(frame: pd.DataFrame, response: str, factors: Sequence[str]) -> list[dict[str, Any]]:
    """Factorial ANOVA with all interactions, type III sums of squares (thesis tables 4.2 to 4.4).

    Factors are coded by deviations that sum to zero. With another coding, type III tests would
    depend on the level that is coded by zeros.

    Args:
        frame: One row per observation.
        response: Column of the response.
        factors: Columns of the factors.

    Returns:
        One row per term, main effects first, then "Error" and "Total" (about the mean): "source",
        "df", "ss" and, except for the total, "ms"; for terms also "f" and "p".

    Raises:
        ValueError: A combination of levels has no observation, or there is none left for the error.
    """
    counts = frame.groupby(list(factors), observed=False).size()
    cells = int(np.prod([frame[factor].nunique() for factor in factors]))
    if len(counts) != cells or (counts == 0).any():
        raise ValueError("every combination of levels needs an observation")
    if len(frame) <= cells:
        raise ValueError("no observation is left for the error")
    terms = [part for n in range(1, len(factors) + 1) for part in combinations(factors, n)]
    formula = " + ".join(":".join(f"C({factor}, Sum)" for factor in part) for part in terms)
    fitted = smf.ols(f"{response} ~ {formula}", frame).fit()
    found = anova_lm(fitted, typ=3)
    rows: list[dict[str, Any]] = []
    for part in terms:
        own = found.loc[":".join(f"C({factor}, Sum)" for factor in part)]
        df, ss = float(own["df"]), float(own["sum_sq"])
        rows.append(
            {
                "source": "*".join(part),
                "df": int(df),
                "ss": ss,
                "ms": ss / df,
                "f": float(own["F"]),
                "p": float(own["PR(>F)"]),
            }
        )
    error = {"df": int(fitted.df_resid), "ss": float(fitted.ssr), "ms": float(fitted.mse_resid)}
    total = {"df": len(frame) - 1, "ss": float(fitted.centered_tss)}
    return [*rows, {"source": "Error", **error}, {"source": "Total", **total}]


@dataclass(frozen=True)
class Difference:
    """Difference of two means with its interval."""

    mean: float
    """The difference, in the unit of the values."""
    low: float
    """Lower end of the interval."""
    high: float
    """Upper end of the interval."""


def difference_over_robots(
    one: ArrayLike, other: ArrayLike, *, seed: int, draws: int = 2000, confidence: float = 0.95
) -> Difference:
    """Compute the mean of other - one over pairs of robots, with an interval for new robots.

    Pairs share robots, so that tests that assume independent pairs are overconfident. Here rows
    (failing robots) and columns (normal robots) are resampled with replacement, independently of
    each other. The interval lies between percentiles of the resampled means.

    Source: Owen (2007), The pigeonhole bootstrap.

    Args:
        one: AUC of each pair. Shape (failing, normal).
        other: The same of another method, same shape.
        seed: Seed of the random draws.
        draws: Number of draws.
        confidence: Confidence of the interval, within (0, 1).

    Returns:
        The mean difference with its interval.

    Raises:
        ValueError: The shapes differ.
    """
    first, second = np.asarray(one, dtype=float), np.asarray(other, dtype=float)
    if first.shape != second.shape or first.ndim != 2:
        raise ValueError(f"shapes must be (failing, normal), got {first.shape}, {second.shape}")
    change = second - first
    rng = np.random.default_rng(seed)
    rows, columns = (
        rng.multinomial(n, np.full(n, 1 / n), size=draws) / n for n in change.shape
    )  # weights of each robot in each draw
    means = np.einsum("dr,rc,dc->d", rows, change, columns, optimize=True)
    low, high = np.quantile(means, [(1 - confidence) / 2, (1 + confidence) / 2])
    return Difference(float(change.mean()), float(low), float(high))


def _checked(groups: Mapping[str, ArrayLike]) -> list[Floats]:
    values = [np.asarray(own, dtype=float) for own in groups.values()]
    if len(values) < 2:
        raise ValueError(f"at least two groups are needed, got {len(values)}")
    for name, own in zip(groups, values, strict=True):
        if own.ndim != 1 or len(own) < 2 or not np.isfinite(own).all():
            raise ValueError(f"group {name}: at least two finite values are needed")
    if all(np.ptp(own) == 0 for own in values):
        raise ValueError("no group varies")
    return values

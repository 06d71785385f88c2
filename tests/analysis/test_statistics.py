"""Statistics against published numbers, R's documented examples and own nested fits."""

import numpy as np
import pandas as pd
import pytest
from faultgen.analysis.glm import formulas, sequence, terms
from faultgen.analysis.statistics import anova, compare, difference_over_robots, levene_p, tukey
from scipy import stats

A = [24.5, 23.5, 26.4, 27.1, 29.9]
B = [28.4, 34.2, 29.5, 32.2, 30.1]
C = [26.1, 28.3, 24.3, 26.2, 27.8]

# Breaks of yarn, R's dataset `warpbreaks` (Tippett 1950): wool A and B at tensions L, M, H
BREAKS = """
26 30 54 25 70 52 51 26 67 18 21 29 17 12 18 35 30 36 36 21 24 18 10 43 28 15 26
27 14 29 19 29 31 41 20 44 42 26 19 16 39 28 21 39 29 20 21 24 17 13 15 15 16 28
"""


def yarn():
    return pd.DataFrame(
        {
            "breaks": [float(x) for x in BREAKS.split()],
            "wool": np.repeat(["A", "B"], 27),
            "tension": np.tile(np.repeat(["L", "M", "H"], 9), 2),
        }
    )


def test_equal_variances_lead_to_anova_and_tukey():
    """Levene of a published example; ANOVA and Tukey written out."""
    found = compare({"a": A, "b": B, "c": C})
    assert found.levene == pytest.approx(0.7219122186)
    assert not found.variances_differ
    grand, groups = np.mean([A, B, C]), np.array([A, B, C])
    between = 5 * np.sum((groups.mean(axis=1) - grand) ** 2) / 2
    within = groups.var(axis=1, ddof=1).mean()
    assert found.statistic == pytest.approx(between / within)
    assert found.p == pytest.approx(stats.f.sf(between / within, 2, 12))
    for pair, (i, j) in {("a", "b"): (0, 1), ("a", "c"): (0, 2), ("b", "c"): (1, 2)}.items():
        q = abs(groups[i].mean() - groups[j].mean()) / np.sqrt(within / 5)
        assert found.post_hoc[pair] == pytest.approx(stats.studentized_range.sf(q, 3, 12))
    assert found.means_differ
    assert found.between("b", "a") == found.post_hoc["a", "b"]
    with pytest.raises(ValueError, match="no such pair"):
        found.between("a", "d")


def test_unequal_variances_lead_to_welch_and_games_howell():
    """R's oneway.test and Games-Howell of the same example, where Levene's level is set so."""
    found = compare({"a": A, "b": B, "c": C}, significant=1.0)
    assert found.variances_differ
    assert found.statistic == pytest.approx(6.297840424652)
    assert found.p == pytest.approx(0.024168533812)
    told = [0.0390580481, 0.9788163923, 0.0247024504]
    assert list(found.post_hoc.values()) == pytest.approx(told, abs=2e-9)  # what R integrates to


def test_levene_decides():
    """Groups of very different spread go the other way; equal ones do not differ at all."""
    rng = np.random.default_rng(0)
    wide, narrow = 10 * rng.standard_normal(50), rng.standard_normal(50)
    assert compare({"wide": wide, "narrow": narrow}).variances_differ
    assert levene_p([1.0, 1.0], [2.0, 2.0]) == 1.0
    assert levene_p(wide, narrow) < 1e-6 < levene_p(wide, wide)


def test_bad_groups_are_told():
    with pytest.raises(ValueError, match="at least two groups"):
        compare({"a": A})
    with pytest.raises(ValueError, match="group b: at least two finite"):
        compare({"a": A, "b": [1.0, np.nan]})
    with pytest.raises(ValueError, match="no group varies"):
        compare({"a": [1.0, 1.0], "b": [2.0, 2.0]})


def test_balanced_anova_is_that_of_r():
    """What R prints for aov(breaks ~ wool * tension)."""
    rows = {row["source"]: row for row in anova(yarn(), "breaks", ["wool", "tension"])}
    for source, df, ss, f, p in (
        ("wool", 1, 450.7, 3.765, 0.058213),
        ("tension", 2, 2034.3, 8.498, 0.000693),
        ("wool*tension", 2, 1002.8, 4.189, 0.021044),
    ):
        row = rows[source]
        assert row["df"] == df
        assert (row["ss"], row["f"]) == (pytest.approx(ss, abs=0.06), pytest.approx(f, abs=6e-4))
        assert row["p"] == pytest.approx(p, abs=6e-7)
    assert (rows["Error"]["df"], rows["Error"]["ss"]) == (48, pytest.approx(5745.1, abs=0.06))
    assert rows["Total"]["ss"] == pytest.approx(
        sum(r["ss"] for k, r in rows.items() if k != "Total")
    )


def unbalanced(seed=0):
    """The design of thesis table 4.1: 273 observations."""
    sizes = {
        ("OTM", "failure"): 42,
        ("OTM", "normal"): 36,
        ("OTO", "failure"): 7,
        ("OTO", "normal"): 6,
    }
    rng = np.random.default_rng(seed)
    rows = [
        {"source": source, "signal": signal, "condition": condition}
        for (source, condition), n in sizes.items()
        for signal in ("raw", "difference", "combined")
        for _ in range(n)
    ]
    frame = pd.DataFrame(rows)
    level = 0.5 * (frame.signal == "difference") + 0.4 * (frame.condition == "failure")
    frame["variation"] = np.exp(level) * rng.gamma(3.0, 1 / 3, len(frame))
    frame["lead"] = rng.poisson(np.exp(level))
    return frame


def deviations(frame, factor):
    """Columns that code a factor by deviations which sum to zero."""
    levels = sorted(frame[factor].unique())
    last = (frame[factor] == levels[-1]).to_numpy(float)
    return np.column_stack([(frame[factor] == one).to_numpy(float) - last for one in levels[:-1]])


def test_type_iii_sums_are_those_of_nested_least_squares():
    """Each term of the unbalanced design by leaving its columns out of the full regression."""
    frame = unbalanced()
    factors = ["source", "signal", "condition"]
    code = {factor: deviations(frame, factor) for factor in factors}

    def columns(source):
        out = np.ones((len(frame), 1))
        for factor in source.split("*"):
            out = np.einsum("ni,nj->nij", out, code[factor]).reshape(len(frame), -1)
        return out

    rows = anova(frame, "variation", factors)
    sources = [row["source"] for row in rows[:-2]]
    y = frame["variation"].to_numpy()

    def residual(kept):
        X = np.hstack([np.ones((len(frame), 1)), *(columns(source) for source in kept)])
        return np.sum((y - X @ np.linalg.lstsq(X, y)[0]) ** 2)

    full = residual(sources)
    assert [row["df"] for row in rows] == [1, 2, 1, 2, 1, 2, 2, 261, 272]
    for row in rows[:-2]:
        ss = residual([s for s in sources if s != row["source"]]) - full
        f = ss / row["df"] / (full / 261)
        assert row["ss"] == pytest.approx(ss)
        assert (row["f"], row["p"]) == (
            pytest.approx(f),
            pytest.approx(stats.f.sf(f, row["df"], 261)),
        )
    assert rows[-2]["ss"] == pytest.approx(full)
    assert rows[-1]["ss"] == pytest.approx(np.sum((y - y.mean()) ** 2))


def test_anova_needs_every_cell():
    frame = unbalanced()
    with pytest.raises(ValueError, match="every combination"):
        anova(
            frame[(frame.source != "OTO") | (frame.signal != "raw")], "lead", ["source", "signal"]
        )


def test_tukey_of_groups_of_different_size():
    """Tukey and Kramer's statistic by hand."""
    groups = {"a": np.array(A), "b": np.array(B + [31.0]), "c": np.array(C[:4])}
    found = tukey(groups)
    arrays = list(groups.values())
    df = sum(len(x) - 1 for x in arrays)
    error = sum(np.sum((x - x.mean()) ** 2) for x in arrays) / df
    q = abs(arrays[0].mean() - arrays[1].mean()) / np.sqrt(error / 2 * (1 / 5 + 1 / 6))
    assert found["a", "b"] == pytest.approx(stats.studentized_range.sf(q, 3, df))


def maximum_likelihood(X, y, family):
    """Deviance and Pearson's dispersion by Newton's method, log link, written out."""
    beta = np.zeros(X.shape[1])
    beta[0] = np.log(y.mean())
    for _ in range(100):
        mu = np.exp(X @ beta)
        if family == "poisson":
            gradient, weight = X.T @ (y - mu), mu
        else:
            gradient, weight = X.T @ (y / mu - 1), y / mu
        beta += np.linalg.solve(X.T @ (X * weight[:, None]), gradient)
    mu = np.exp(X @ beta)
    if family == "poisson":
        deviance = 2 * np.sum(np.where(y > 0, y * np.log(np.maximum(y, 1) / mu), 0.0) - (y - mu))
        return deviance, 1.0
    deviance = 2 * np.sum((y - mu) / mu - np.log(y / mu))
    return deviance, np.sum(((y - mu) / mu) ** 2) / (len(y) - X.shape[1])


@pytest.mark.parametrize(("response", "family"), [("variation", "gamma"), ("lead", "poisson")])
def test_models_are_those_of_an_own_maximum_likelihood(response, family):
    """Deviances and p of the nested models, on the design of table 4.1."""
    frame = unbalanced(1)
    y = frame[response].to_numpy(float)
    code = {name: deviations(frame, name) for name in ("source", "signal", "condition")}
    parts = {
        "1": np.ones((len(y), 1)),
        **code,
        "source:signal": np.einsum("ni,nj->nij", code["source"], code["signal"]).reshape(
            len(y), -1
        ),
    }
    rows = sequence(frame, response, ("source", "signal", "condition"), family)
    assert [row["residual_df"] for row in rows] == [272, 271, 269, 268, 266, 266, 264, 261]
    assert [row["df"] for row in rows[1:]] == [1, 2, 1, 2, 2, 2, 3]
    names = list(parts)
    own = [
        maximum_likelihood(np.hstack([parts[n] for n in names[:k]]), y, family) for k in range(1, 6)
    ]
    for k in range(1, 5):
        (before, _), (after, dispersion) = own[k - 1], own[k]
        assert rows[k]["residual_deviance"] == pytest.approx(after)
        p = stats.chi2.sf((before - after) / dispersion, rows[k]["df"])
        assert rows[k]["p"] == pytest.approx(p, rel=1e-6)
    by_term = terms(frame, response, ("source", "signal", "condition"), family, main_only=True)
    assert [row["residual_df"] for row in by_term] == [272, 271, 269, 268]
    scale = own[3][1]  # of the last model, for all terms
    expected = stats.chi2.sf((own[1][0] - own[2][0]) / scale, 2)
    assert by_term[2]["p"] == pytest.approx(expected, rel=1e-6)


def test_counts_of_r_example():
    """R's example of glm (Dobson 1990): deviances 10.5814 and 5.1291, outcome 5.4523, p 0.06547."""
    frame = pd.DataFrame(
        {
            "count": [18, 17, 15, 20, 10, 20, 25, 13, 12],
            "outcome": [1, 2, 3] * 3,
            "treatment": np.repeat([1, 2, 3], 3),
            "one": [0, 1, 0, 1, 0, 1, 0, 1, 1],
        }
    )
    frame[["outcome", "treatment"]] = frame[["outcome", "treatment"]].astype(str)
    rows = terms(frame, "count", ("outcome", "treatment", "one"), "poisson", main_only=True)
    assert rows[0]["residual_deviance"] == pytest.approx(10.5814, abs=5e-5)
    assert rows[1]["deviance"] == pytest.approx(5.4523, abs=5e-5)
    assert rows[1]["p"] == pytest.approx(0.06547, abs=5e-6)
    assert rows[2]["residual_deviance"] == pytest.approx(5.1291, abs=5e-5)
    assert rows[2]["p"] == pytest.approx(1.0)


def test_gamma_deviance_of_r_example():
    """R's example of glm (McCullagh and Nelder 1989): null deviance 3.51283, whatever the link."""
    frame = pd.DataFrame({"time": [118.0, 58, 42, 35, 27, 25, 21, 19, 18]})
    frame["half"], frame["third"] = np.arange(9) % 2, np.arange(9) // 3 % 2
    frame["odd"] = np.arange(9) > 6
    rows = terms(frame, "time", ("half", "third", "odd"), "gamma", main_only=True)
    assert rows[0]["residual_deviance"] == pytest.approx(3.51283, abs=5e-6)


def test_responses_that_do_not_fit_are_told():
    frame = unbalanced()
    names = ("source", "signal", "condition")
    with pytest.raises(ValueError, match="needs counts"):
        sequence(frame, "variation", names, "poisson")
    with pytest.raises(ValueError, match="needs positive"):
        sequence(frame.assign(variation=0.0), "variation", names, "gamma")
    assert len(formulas(names)) == 8


def test_interval_over_robots_is_as_wide_as_robots_differ():
    """Where rows differ only by robot, the interval is that of means of robots, not of pairs."""
    rng = np.random.default_rng(0)
    failing = rng.standard_normal((40, 1))
    other = np.broadcast_to(failing, (40, 40))
    found = difference_over_robots(np.zeros((40, 40)), other, seed=1)
    wide = 2 * 1.96 * failing.std() / np.sqrt(40)
    assert found.mean == pytest.approx(failing.mean())
    assert found.high - found.low == pytest.approx(wide, rel=0.1)
    assert found == difference_over_robots(np.zeros((40, 40)), other, seed=1)
    with pytest.raises(ValueError, match="shapes must be"):
        difference_over_robots(np.zeros((2, 3)), np.zeros((3, 2)), seed=0)

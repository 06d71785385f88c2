"""Preprocessing of thesis 5.3.2 against cases counted by hand."""

from types import SimpleNamespace

import numpy as np
import pytest
from fake_fleet import fake_fleet
from faultgen.analysis.daily import daily
from faultgen.analysis.preprocessing import (
    COMBINATIONS,
    SMOOTHING,
    Combination,
    DailyPCA,
    measurements,
    prepare,
    windows,
)
from scipy.stats import entropy
from sklearn.decomposition import PCA


def record(production, torque, day, histograms=None):
    """A robot of one axis with three bins."""
    production, torque = np.array(production, float), np.array(torque, float)[:, None]
    if histograms is None:
        histograms = np.tile([0.2, 0.3, 0.5], (len(production), 1, 1))
    return SimpleNamespace(
        day=np.array(day, float),
        production=production,
        torque_histogram=histograms,
        speed_histogram=histograms,
        angle_histogram=histograms,
        torque_indicator=torque * production[:, None] ** 0.3,
        speed_indicator=7.0 * production[:, None],
    )


def test_estimates_invert_the_indicators():
    """Estimated torque and speed are those that made the indicators, whatever the production."""
    series = daily(record([0.9, 0.1, 0.4], [3, 4, 5], [1, 2, 3]))
    assert series.values["estimated torque"].ravel() == pytest.approx([3, 4, 5])
    assert series.values["estimated speed"].ravel() == pytest.approx([7, 7, 7])
    assert series.values["speed indicator"].ravel() == pytest.approx([6.3, 0.7, 2.8])


def test_one_row_a_day_by_the_maximum():
    """A sample at midnight belongs to the day that ends; a day without samples is left out."""
    series = daily(record([1, 1, 1, 1, 1], [3, 5, 4, 9, 2], [0.5, 1.0, 1.5, 2.0, 3.5]))
    assert series.day.tolist() == [0, 1, 3]
    assert series.values["torque indicator"].ravel().tolist() == [5, 9, 2]


def test_a_day_of_standstill_takes_the_estimates_of_the_day_before():
    """Indicators are zero then, estimates and histograms do not exist."""
    shares = np.array([[[0.2, 0.3, 0.5]], [[0.0, 0.0, 0.0]], [[0.6, 0.3, 0.1]]])
    series = daily(record([0.5, 0.0, 0.5], [3, 8, 4], [1, 2, 3], shares))
    assert series.values["estimated torque"].ravel() == pytest.approx([3, 3, 4])
    assert series.values["torque indicator"][1] == 0
    assert series.histograms["KL torque"][1] == pytest.approx(series.histograms["KL torque"][0])
    with pytest.raises(ValueError, match="ran in no sample"):
        daily(record([0.0, 0.0], [3, 8], [1, 2]))


def test_divergences_are_from_the_first_day_or_the_day_before():
    """Divergences in bits, against scipy on histograms smoothed by hand."""
    p = np.array([[[0.2, 0.3, 0.5]], [[0.6, 0.3, 0.1]], [[0.6, 0.4, 0.0]]])
    series = daily(record([1, 1, 1], [3, 5, 4], [1, 2, 3], p))
    smooth = (p[:, 0] + SMOOTHING) / (1 + 3 * SMOOTHING)
    _, raw = measurements(series, estimates=False, difference=False)
    assert raw[:, -1] == pytest.approx([entropy(q, smooth[0], base=2) for q in smooth])
    day, difference = measurements(series, estimates=False, difference=True)
    assert day.tolist() == [1, 2]
    successive = [entropy(smooth[k + 1], smooth[k], base=2) for k in range(2)]
    assert difference[:, -1] == pytest.approx(successive)
    assert difference[:, 1] == pytest.approx([2, 1])  # torque indicator 3, 5, 4


def test_windows_hold_the_newest_day_last():
    """Rows are [X_{k-n+1}, ..., X_k]."""
    rows = windows(np.arange(8.0).reshape(4, 2), 3)
    assert rows.tolist() == [[0, 1, 2, 3, 4, 5], [2, 3, 4, 5, 6, 7]]
    with pytest.raises(ValueError, match="windows of 5"):
        windows(np.zeros((4, 2)), 5)


def test_names_say_what_is_done():
    """Table 5.2 has 15 combinations; the order of names is the order of steps."""
    assert len({Combination.of(name) for name in COMBINATIONS}) == 15
    both = Combination.of("+estM+diff+var3+pca")
    assert (both.estimates, both.difference, both.days, both.pca) == (True, True, 3, True)
    assert not both.pca_before_days
    assert Combination.of("+diff+pca+var3").pca_before_days
    assert not Combination.of("control").pca
    for wrong, told in (
        ("+difff", "unknown step"),
        ("+diff+estM", "come first"),
        ("+pca+diff", "differences must come before"),
        ("+var3+var5", "one window"),
    ):
        with pytest.raises(ValueError, match=told):
            Combination.of(wrong)


@pytest.mark.parametrize("name", [*COMBINATIONS, "+estM+diff+var5+pca"])
def test_columns_are_where_they_are_said_to_be(name):
    """A column that is changed at one axis and day moves in the columns of that axis only."""
    combination = Combination.of(name)
    robot = fake_fleet(failed=0, normal=1, days=12, n_axes=3).robots[0]
    day, before = prepare(robot, combination)
    first = combination.days - 1 + combination.difference
    assert day.tolist() == list(range(first, 12))
    per_axis = 7 if combination.estimates else 5
    assert before.shape[1] == per_axis * 3 * combination.days
    robot.torque_indicator[5, 1] *= 2
    _, after = prepare(robot, combination)
    moved = set(np.flatnonzero((before != after).any(axis=0)))
    columns = combination.columns(3)
    expected = {"torque indicator", "estimated torque"} & set(combination.measurements)
    assert moved == {c for key in expected for c in columns[key, 2]}


def test_components_of_days_are_those_of_single_rows():
    """Put side by side, they are the components of each day by itself; alone, plain PCA."""
    rng = np.random.default_rng(1)
    single = rng.standard_normal((40, 5)) @ rng.standard_normal((5, 5))
    wide = windows(single, 3)
    reduced = DailyPCA(days=3).fit(wide)
    plain = PCA(n_components=0.9, svd_solver="full").fit(single[2:])
    assert reduced.transform(wide) == pytest.approx(windows(plain.transform(single), 3))
    assert np.sum(plain.explained_variance_ratio_) > 0.9
    whole = PCA(n_components=0.9, svd_solver="full").fit_transform(wide)
    assert DailyPCA().fit_transform(wide) == pytest.approx(whole)

"""Study `classifiers`: its parts against cases counted by hand, and as a whole on a small fleet."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from fake_fleet import fake_fleet
from faultgen.analysis.preprocessing import COMBINATIONS, Combination, prepare

import faultgen.studies.chapter5_classifiers.study as classifiers_study
from faultgen.errors import InputError
from faultgen.evaluation.markdown import stars
from faultgen.studies.chapter5_classifiers.findings import FULL_CHAIN
from faultgen.studies.chapter5_classifiers.study import Size, horizon_rows, run_classifiers
from faultgen.studies.chapter5_classifiers.tables import supported, tables
from faultgen.studies.chapter5_classifiers.thesis import AUC, HEADLINE, MEAN_P, PAIRS, VARIANCE_P
from faultgen.studies.classifiers_ahead import OWN, OWN_EVENTS, UNTRAINED, days_ahead
from faultgen.studies.runner import run_study

SMALL = Size(
    combinations=("control", "+estM+var3+pca", FULL_CHAIN),
    others=("control",),
    classifiers=("LR",),
    horizons=(1, 3),
    robots=3,
    importance=("LR",),
)


@pytest.fixture(scope="module")
def result():
    return run_classifiers(fake_fleet(days=45, n_axes=2, worst=1.0), size=SMALL, seed=4)


def test_ten_days_that_end_so_many_days_before_the_last():
    """With 45 days, 3 days ahead are days 33 to 42, counted from 1; a window looks further back."""
    fleet = fake_fleet(failed=1, normal=0, days=45, n_axes=2)
    (rows,) = horizon_rows(fleet, "+diff+var3+pca", 3)
    day, every = prepare(fleet.robots[0], Combination.of("+diff+var3+pca"))
    assert np.array_equal(rows, every[(day >= 32) & (day <= 41)])
    assert len(rows) == 10
    with pytest.raises(InputError, match="no data 45 to 55 days ahead"):
        horizon_rows(fleet, "control", 45)


def test_the_thesis_numbers_are_typed_whole():
    """Cells picked here and there, and each pair differs by its step."""
    assert AUC["+estM+diff+var3+pca", "LR"] == (0.75, 0.30)
    assert AUC["+diff+pca+var3", "RF"] == (0.68, 0.36)
    assert {step: len(pairs) for step, pairs in PAIRS.items()} == {
        "diff": 6,
        "var3": 6,
        "estM": 7,
        "pca": 6,
    }
    for step, pairs in PAIRS.items():
        for pair in pairs:
            without, with_step = (Combination.of(name) for name in pair)
            assert set(pair) <= {*COMBINATIONS}
            gained = set(with_step.name.split("+")) - set(without.name.split("+"))
            assert gained - {""} == {step}
        assert HEADLINE[step] in pairs
    assert MEAN_P["+estM+pca", "+estM+diff+pca"]["RF"] == 0.852
    assert VARIANCE_P["+diff", "+estM+diff"]["LR"] is None


def test_study_tells_pairs_and_means(result):
    """Cells have the mean of their pairs; the table of pairs has what was run."""
    cells = {(c["horizon"], c["combination"]): c for c in result["cells"]}
    assert set(cells) == {
        *((3, name) for name in SMALL.combinations),
        (1, "control"),
        *((days, name) for days in (1, 3, 10) for name in (OWN, OWN_EVENTS)),
    }
    for cell in cells.values():
        assert np.shape(cell["auc"]) == (3, 3)
        assert cell["mean"] == pytest.approx(np.mean(cell["auc"]))
    assert cells[3, OWN]["mean"] > 0.9
    (pair,) = result["pairs"]
    assert (pair["step"], pair["without"], pair["with"]) == ("diff", "+estM+var3+pca", FULL_CHAIN)
    change = cells[3, FULL_CHAIN]["mean"] - cells[3, "+estM+var3+pca"]["mean"]
    assert pair["mean_change"] == pytest.approx(change)
    assert result["headlines"][0]["mean"] == pytest.approx(change)
    assert [row["combination"] for row in result["over_control"]] == [*SMALL.combinations[1:]]
    gain = cells[3, FULL_CHAIN]["mean"] - cells[3, "control"]["mean"]
    assert result["over_control"][-1]["change"] == pytest.approx(gain)
    by_robot = result["invariance"][1]["auc"]
    assert result["invariance"][1]["combination"] == FULL_CHAIN
    expected = np.array(cells[3, FULL_CHAIN]["auc"])
    assert by_robot == pytest.approx([*expected.mean(axis=1), *expected.mean(axis=0)])
    assert len(result["importance"]) == 7 * 2 + 7


def test_columns_are_told_beside_the_method(result):
    """Each column without training, at every horizon for which the record is long enough.

    In the small fleet only failing robots grow, and only in their last 20 days.
    """
    untrained = {(row["column"], row["horizon"]): row["auc"] for row in result["untrained"]}
    assert set(untrained) == {(name, days) for name in UNTRAINED for days in (1, 3, 10)}
    assert untrained["unsteadiness", 1] > 0.8
    assert re.search(r"\| 1 d +\| 3 d +\| 10 d +\|", tables({**result, "goals": []}))


@pytest.mark.slow
def test_nothing_is_known_before_it_shows():
    """25 days ahead the small fleet's robots are as they always were: all is chance."""
    fleet = fake_fleet(failed=6, normal=6, days=60, n_axes=2, worst=1.0, seed=3)
    trained, untrained = days_ahead(fleet, (3,), seed=1)
    assert trained[3, OWN].auc.mean() > 0.9
    assert 0.15 < trained[25, OWN].auc.mean() < 0.85
    early = [row["auc"] for row in untrained if row["horizon"] == 25]
    assert len(early) == len(UNTRAINED) and 0.3 < np.mean(early) < 0.7


def test_verdict_on_a_hypothesis():
    """Yes if a pair rises and none falls, mixed if both do; chance does not count."""
    rises, falls, neither = (
        {"mean_p": p, "mean_change": change}
        for p, change in ((0.01, 0.2), (0.01, -0.2), (0.3, 0.2))
    )
    assert supported([rises, neither]) == "yes"
    assert supported([rises, falls]) == "mixed"
    assert supported([neither, falls]) == "no"


def test_marks_of_significance():
    assert [stars(p) for p in (0.05, 0.04, 0.009, 0.0009, 0.00009)] == [
        "",
        "*",
        "**",
        "***",
        "****",
    ]


def test_fleets_that_do_not_do():
    """Too few robots of a kind; axes that differ."""
    with pytest.raises(InputError, match="three normal"):
        run_classifiers(fake_fleet(failed=3, normal=2, days=30, n_axes=2), size=SMALL)
    odd = fake_fleet(failed=3, normal=3, days=30, n_axes=2)
    other = fake_fleet(failed=1, normal=0, days=30, n_axes=3)
    mixed = replace(odd, robots=(*other.robots, *odd.robots[1:]))
    with pytest.raises(InputError, match="same number of axes"):
        run_classifiers(mixed, size=SMALL)


def test_files_of_the_study(result, monkeypatch, tmp_path):
    """results.json, tables and figures; a fleet is taken by these studies only."""
    monkeypatch.setattr("faultgen.studies.runner.open_fleet", lambda folder: folder)
    monkeypatch.setattr(classifiers_study, "run_classifiers", lambda fleet, **options: dict(result))
    told = run_study("classifiers", tmp_path, quick=True, fleet=tmp_path)
    stored = json.loads((tmp_path / "results.json").read_text())
    assert [goal["reached"] for goal in stored["goals"]] == [g["reached"] for g in told["goals"]]
    assert stored["goals"][0]["reached"]
    text = (tmp_path / "tables.md").read_text()
    assert text == tables(stored)
    assert f"{stored['cells'][0]['mean']:.2f}" in text and "0.47 (0.34)" in text
    assert len(list((tmp_path / "figures").glob("*.png"))) == 4
    with pytest.raises(InputError, match="is not a fleet"):
        monkeypatch.undo()
        run_study("classifiers", tmp_path, fleet=tmp_path)
    with pytest.raises(InputError, match="takes no --fleet"):
        run_study("isolation", tmp_path, fleet=tmp_path)

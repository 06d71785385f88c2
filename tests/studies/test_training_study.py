"""Study `training-data`: its design, descriptors counted by hand, the whole on a small fleet."""

import json
from dataclasses import replace

import numpy as np
import pytest
from fake_fleet import fake_fleet

import faultgen.studies.chapter4_training_data.study as training_study
from faultgen.errors import InputError
from faultgen.studies.chapter4_training_data.signals import SIGNALS, training_sets
from faultgen.studies.chapter4_training_data.study import describe, run_training
from faultgen.studies.chapter4_training_data.tables import tables
from faultgen.studies.chapter4_training_data.thesis import (
    ANOVA,
    ERROR,
    FACTORS,
    MODELS,
    NULL,
    TERM_BY_TERM,
)
from faultgen.studies.runner import run_study

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def fleet():
    return fake_fleet(failed=7, normal=3, days=125, n_axes=2, a_day=1, worst=3.0, seed=2)


@pytest.fixture(scope="module")
def result(fleet):
    return run_training(fleet, quick=True)


def test_sets_are_those_of_the_thesis(fleet):
    """Seven last sets, and first and last of three; 40 days and 15, differences a row less."""
    sets = training_sets(fleet)
    assert [one.failed for one in sets] == [True] * 7 + [False] * 6
    assert [one.first for one in sets] == [65] * 7 + [0, 65] * 3
    for one in sets:
        columns = 7 * 2 + 2 + 13
        assert one.train["raw"].shape == (40, columns)
        assert one.test["difference"].shape == (14, columns)
        assert one.train["combined"].shape == (39, 2 * columns)
        assert one.test_day["raw"].tolist() == list(range(15))
        assert one.test_day["combined"].tolist() == list(range(1, 15))
        for signal in SIGNALS:
            trend = np.polyfit(np.arange(len(one.train["raw"])), one.train["raw"], 1)
            assert np.abs(trend).max() < 1e-9
            assert np.isfinite(one.test[signal]).all()


def test_the_last_five_days_are_not_seen(fleet):
    """What happens on them changes no signal."""
    robot = fleet.robots[0]
    robot_after = replace(robot, torque_indicator=robot.torque_indicator.copy())
    robot_after.torque_indicator[robot.day > 120] *= 7
    other = replace(fleet, robots=(robot_after, *fleet.robots[1:]))
    before, after = training_sets(fleet)[0], training_sets(other)[0]
    for signal in SIGNALS:
        assert np.array_equal(before.test[signal], after.test[signal])
    robot_after.torque_indicator[robot.day == 120] *= 7
    assert not np.array_equal(before.test["raw"], training_sets(other)[0].test["raw"])


def test_descriptors_by_hand():
    """Days above the limit, and days left when the first of them is seen."""
    q, day = np.array([1.0, 1, 5, 1, 4]), np.array([0, 1, 3, 4, 5])
    found = describe(q, day, 3.0, 8)
    assert (found["above"], found["lead"]) == (2, 4)
    assert found["variation"] == pytest.approx(np.std(q, ddof=1) / 2.4)
    cut = describe(q, day, 3.0, 5)
    assert (cut["above"], cut["lead"]) == (1, 1)
    assert describe(q, day, 9.0, 8)["lead"] == 0
    with pytest.raises(InputError, match="does not vary"):
        describe(np.ones(5), day, 3.0, 8)


def test_cases_are_those_of_table_4_1(result):
    """42, 36, 7 and 6 cases a signal; no failing robot by its own data, one to many."""
    counts = {tuple(row[name] for name in FACTORS): row["cases"] for row in result["groups"]}
    for signal in SIGNALS:
        assert counts["OTM", signal, "failure"] == 42
        assert counts["OTM", signal, "normal"] == 36
        assert counts["OTO", signal, "failure"] == 7
        assert counts["OTO", signal, "normal"] == 6
    for case in result["cases"]:
        assert (case["source"] == "OTO") <= (case["trained"] == case["tested"])
    same = [c for c in result["cases"] if c["source"] == "OTM" and c["same_robot"]]
    assert len(same) == 12 * 3 and all(c["condition"] == "normal" for c in same)


def test_a_drift_that_is_planted_is_found(result):
    """By its own data, a robot whose torque drifts has days above the limit, others have few."""
    mean = {tuple(row[name] for name in FACTORS): row for row in result["groups"]}
    for signal in ("raw", "difference"):
        ill, well = (mean["OTO", signal, kind]["above"] for kind in ("failure", "normal"))
        assert ill > 5 > 3 > well
    assert any(
        row["found"]
        for row in result["cuts"]
        if (row["source"], row["descriptor"], row["days"]) == ("OTO", "above", 15)
    )


def test_thesis_tables_are_typed_right():
    """What its columns must fulfil: F from sums of squares, deviances from those before them."""
    for name, rows in ANOVA.items():
        for source, row in rows.items():
            df = 2 if "signal" in source else 1
            assert row["f"] == pytest.approx(row["ss"] / df / (ERROR[name] / 261), abs=0.011)
    against = (1, 2, 3, 4, 4, 6, 7)
    for name, rows in MODELS.items():
        residual = [NULL[name], *(row["residual_deviance"] for row in rows)]
        for row, before in zip(rows, against, strict=True):
            change = residual[before - 1] - row["residual_deviance"]
            assert row["deviance"] == pytest.approx(change, abs=0.021)
    for name, rows in TERM_BY_TERM.items():
        residual = [NULL[name], *(row["residual_deviance"] for row in rows)]
        for row, before in zip(rows, residual, strict=False):
            change = before - row["residual_deviance"]
            assert row["deviance"] == pytest.approx(change, abs=0.021)


def test_fleets_that_do_not_do():
    with pytest.raises(InputError, match="7 failing and 3 normal"):
        training_sets(fake_fleet(failed=6, normal=3, days=120, n_axes=1))
    with pytest.raises(InputError, match="need 120 days, got 100"):
        training_sets(fake_fleet(failed=7, normal=3, days=100, n_axes=1))


def test_files_of_the_study(fleet, result, monkeypatch, tmp_path):
    """results.json, tables with the thesis' numbers, and figures."""
    monkeypatch.setattr("faultgen.studies.runner.open_fleet", lambda folder: fleet)
    monkeypatch.setattr(training_study, "run_training", lambda fleet, **options: dict(result))
    run_study("training-data", tmp_path, quick=True, fleet=tmp_path)
    stored = json.loads((tmp_path / "results.json").read_text())
    text = (tmp_path / "tables.md").read_text()
    assert text == tables(stored)
    error = result["anova"]["variation"][7]
    assert f"{error['ss']:.3f} / 222.833" in text
    assert "/ 13.8 " in text
    assert len(list((tmp_path / "figures").glob("*.png"))) == 4

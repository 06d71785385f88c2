"""The study of event logs, on counts of which it is known what they hold."""

from dataclasses import replace

import numpy as np
import pytest

from faultgen.errors import InputError
from faultgen.fleet import Fleet, FleetRobot
from faultgen.fleet.events import event_names
from faultgen.studies.chapter2_events.study import NEVER, days_of_warning, run_events
from faultgen.studies.chapter2_events.tables import goals, tables
from faultgen.studies.runner import run_study

DAYS = 210
NAMES = event_names()


def fleet(rise):
    """Ten robots of which five fail; supervisions of these rise in the last 50 days."""
    rng = np.random.default_rng(3)
    robots = []
    for k in range(10):
        rate = np.full((DAYS, len(NAMES)), 1.0)
        if k < 5:
            rate[-50:, NAMES.index("motion_supervision_2")] *= rise
        none = np.zeros((0, 6))
        robots.append(
            FleetRobot(
                name=f"robot{k}",
                robot="irb6700",
                failed=k < 5,
                axis=2 if k < 5 else 0,
                day=np.zeros(0),
                production=np.zeros(0),
                torque_histogram=none,
                speed_histogram=none,
                angle_histogram=none,
                torque_indicator=none,
                speed_indicator=none,
                temperature=np.zeros(0),
                events=rng.poisson(rate),
            )
        )
    return Fleet(tuple(robots), NAMES, DAYS, 3)


def test_a_pattern_is_found_where_there_is_one():
    result = run_events(fleet(rise=30.0))
    assert result["rise"]["Q"]["auc"] == 1.0 and result["rise"]["Q"]["p"] < 0.01
    ours = result["warnings"]["supervision, charted"]
    assert ours["warned"]["right"] == 5 and ours["healthy_warned"]["right"] <= 1
    assert abs(np.median(ours["lead"]) - 50) <= 3
    assert result["example"]["names"][int(np.argmax(result["example"]["q_contributions"]))] == (
        "motion_supervision_2"
    )


def test_no_pattern_is_found_where_there_is_none():
    result = run_events(fleet(rise=1.0))
    assert 0.1 < result["rise"]["Q"]["auc"] < 0.9 and result["rise"]["Q"]["p"] > 0.05
    result["goals"] = goals(result)
    assert not any(goal["reached"] for goal in result["goals"])
    assert "| T2: " in tables(result)


def test_days_of_warning_count_from_the_alarm_that_lasts():
    alarm = np.zeros(100, bool)
    assert days_of_warning(alarm) == NEVER
    alarm[10:20] = True  # over again
    alarm[60:70] = True
    alarm[74:100] = True  # four days' break
    assert days_of_warning(alarm) == 40
    alarm[72:90] = False
    assert days_of_warning(alarm) == NEVER


def test_a_fleet_that_does_not_do_leaves_no_folder(monkeypatch, tmp_path):
    short = replace(fleet(rise=1.0), days=60)
    monkeypatch.setattr("faultgen.studies.runner.open_fleet", lambda folder: short)
    with pytest.raises(InputError, match="more than 88 days, not 60"):
        run_study("events", tmp_path / "out", fleet=tmp_path)
    assert not (tmp_path / "out").exists()

"""The answer of a detector whose model is known in closed form, near each of its limits."""

from dataclasses import replace

import numpy as np
import pytest

from faultgen.twin.alignment import KnownMotion
from faultgen.twin.classes import GRID, Classes, believe
from faultgen.twin.detector import Detector, Fault, Memory

FAULT = 10.0
"""How far the largest severity moves a robot, in standard deviations of healthy recordings."""


def detector(**limits):
    """Three features, the mean |torque| of three axes; a fault moves the first of them.

    Features are already in units of their healthy spread, so what no fault explains is the sum of
    the squares of the second and third feature.
    """
    basis = np.array([[1.0, 0.0, 0.0]])
    return Detector(
        robot="none",
        task="none",
        motion=KnownMotion(np.zeros((4, 3)), ((0, 4),), 0.004, np.ones(3)),
        kind="mean |torque|",
        faults=(Fault(effect="friction_wear", axes=(2,), largest=0.3, unit="1"),),
        classes=Classes(
            centre=np.full(3, 50.0),  # so that no torque changes its sign
            whitener=np.eye(3),
            basis=basis,
            curves=np.array([[[FAULT], [0.0]]]),
            rest=np.array([2.0, 4.0]),
        ),
        baselines=0,
        false_alarms=0.01,
        limits={"single": 9.0, "running": 9.0, "rest": 16.0} | limits,
        constants=None,
        torque_gain=np.ones(3),
        made={},
    )


def judge(one, *features):
    """Answer to a first recording whose features are so far from their healthy mean."""
    cycle = np.tile(50.0 + np.array(features), (4, 1))
    return one.judge([cycle], Memory.empty())[0]


@pytest.mark.parametrize(("over", "verdict"), [(0.99, "healthy"), (1.01, "unknown change")])
def test_a_change_that_no_fault_makes_is_unknown_above_its_limit(over, verdict):
    """The squared distance counts, here 3^2 + y^2, over the limit of 16."""
    answer = judge(detector(), 0.0, 3.0, np.sqrt(16 * over - 9))
    assert answer["verdict"] == verdict
    assert answer["alarm"] == (verdict != "healthy")
    assert answer["over_limit"]["rest"] == pytest.approx(over)
    assert answer["effect"] is None and answer["alternatives"] == []


@pytest.mark.parametrize(("share", "verdict"), [(1.49, "fault"), (1.51, "unknown change")])
def test_a_fault_may_leave_half_more_than_it_explains(share, verdict):
    """It explains the square of its distance, if this is exactly that of a severity.

    What is left counts as far as it exceeds its limit.
    """
    distance = FAULT * GRID[20]
    answer = judge(detector(), distance, np.sqrt(16 + share * distance**2), 0.0)
    assert answer["verdict"] == verdict and answer["alarm"]
    if verdict == "fault":
        assert (answer["effect"], answer["axes"]) == ("friction_wear", [2])
        assert answer["severity"] == pytest.approx(0.3 * GRID[20], rel=0.1)
    else:  # the fault is named beside it
        assert [other["effect"] for other in answer["alternatives"]] == ["friction_wear"]


@pytest.mark.parametrize(("factor", "verdict"), [(1.01, "healthy"), (0.99, "fault")])
def test_a_fault_is_named_above_the_limit_of_one_recording(factor, verdict):
    """The gain is that of the model; the running mean of one recording is the recording."""
    gain = believe(detector().classes, np.array([4.0]), 1.0).gain
    one = detector(single=factor * gain, running=2 * gain)
    answer = judge(one, 4.0, 0.0, 0.0)
    assert answer["verdict"] == verdict and answer["based_on"] == "single"
    assert answer["over_limit"]["single"] == pytest.approx(1 / factor)
    assert answer["over_limit"]["running"] == pytest.approx(0.5)


def test_a_small_fault_is_named_from_the_mean_of_several_recordings():
    """Each recording is below its limit; their mean is as far, and four times as certain."""
    classes = detector().classes
    once, four = (believe(classes, np.array([2.0]), v).gain for v in (1.0, 0.25))
    one = detector(single=1.1 * once, running=0.9 * four)
    memory = Memory.empty()
    cycle = np.tile([52.0, 50.0, 50.0], (4, 1))
    answers = []
    for _ in range(4):
        answer, memory = one.judge([cycle], memory)
        answers.append(answer)
    assert answers[0]["verdict"] == "healthy" and answers[3]["verdict"] == "fault"
    assert answers[3]["based_on"] == "running" and answers[3]["recordings"] == 4
    assert answers[3]["over_limit"]["running"] == pytest.approx(1 / 0.9)


def test_only_likely_faults_are_named_beside_the_first():
    """Of two others, one moves the robot almost alike, and one the other way."""
    one = detector()
    curves = np.concatenate([factor * one.classes.curves for factor in (1.0, 0.9, -1.0)])
    faults = [Fault(effect=name, axes=(1,), largest=0.1, unit="1") for name in ("a", "b", "c")]
    answer = judge(
        replace(one, faults=tuple(faults), classes=replace(one.classes, curves=curves)),
        *(6.0, 0.0, 0.0),
    )
    (other,) = answer["alternatives"]
    assert {answer["effect"], other["effect"]} == {"a", "b"}
    assert answer["probability"] >= other["probability"] > 0.1
    assert answer["probability"] + other["probability"] <= 1

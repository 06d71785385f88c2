"""The ablation of discovery: true torques, answers of the steps, the table."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from discovery.ablation import outcomes, summary, text
from laboratories.ablation_steps import LIMIT, STEPS, Steps, decided
from laboratories.draw import BASE, Laboratory
from laboratories.effects import Effect
from laboratories.known import Known, know, on_another_day
from laboratories.make import draw_session, model_for, record
from laboratories.recorded import as_recorded, number_products, true_scales
from laboratories.setup import Setup, set_up

from faultgen.inference.hypotheses import Hypothesis
from faultgen.inference.model import Group, Model
from faultgen.inference.products import Products

WEAR = Effect("friction_wear", 1, 0.2)
SECONDS = 3.0


@pytest.fixture(scope="module")
def setup() -> Setup:
    """A slide whose friction differs by 5 % from day to day."""
    factors = {"robot": "lift1", "seconds": SECONDS, "segments": 1, "repeat": 0.05}
    return set_up(Laboratory("development", 100, BASE | factors, ("all",)))


@pytest.fixture(scope="module")
def known(setup: Setup) -> Known:
    """The truth about a healthy recording of the slide."""
    return know(setup, draw_session(setup, np.random.default_rng(1)), [WEAR])


def test_what_is_left_of_a_healthy_recording_is_its_noise(setup: Setup, known: Known) -> None:
    """Torque of the recording less the true one is white with variance 1, on either day."""
    for seed in (1, 2):
        rng = np.random.default_rng(seed)
        session = draw_session(setup, rng)
        here = known if seed == 1 else on_another_day(known, session)
        measured, _ = record(setup, [], session, range(1), rng)
        rounded = np.abs(measured["motor_position"] - here.position)
        assert rounded.max() <= 1.01 * np.pi / (4 * setup.lab.machine.counts)  # half a count
        white = here.white(measured["motor_torque"] - here.clean)
        assert np.mean(white**2) == pytest.approx(1.0, abs=0.15)
        # the model differs by a few standard deviations of its numbers, and by nothing else
        numbers = here.white(here.numbers).reshape(len(here.numbers), -1).astype(float)
        left = here.white(measured["motor_torque"] - here.base).ravel().astype(float)
        value = np.linalg.solve(numbers @ numbers.T + np.eye(len(numbers)), numbers @ left)
        assert np.mean(left**2) > 2.0
        assert np.mean((left - value @ numbers) ** 2) == pytest.approx(1.0, abs=0.15)
        assert np.mean(value**2) < 1.5


def test_a_change_is_what_a_worn_robot_needs_on_the_same_motion(setup: Setup, known: Known) -> None:
    """More friction takes a torque against the motion, by the severity times Coulomb friction."""
    (change,) = known.changes[..., 0]
    coulomb = float(setup.lab.machine.coulomb[0])
    assert np.quantile(np.abs(change), 0.7) == pytest.approx(0.2 * coulomb, rel=0.3)
    again = know(setup, draw_session(setup, np.random.default_rng(1)), [Effect("delay", 1, 1e-3)])
    assert not again.changes.any()  # prescribed rotors do not wait


@pytest.mark.slow
def test_every_step_decides_on_a_worn_robot(setup: Setup, known: Known, tmp_path: Path) -> None:
    """The truth names the wear, and discovery's signature is that of the simulator."""
    rng = np.random.default_rng(1)
    measured, _ = record(setup, [], draw_session(setup, rng), range(1), rng)
    one = as_recorded(known, measured, model_for(setup.lab, tmp_path), tmp_path / "cases" / "h0")
    assert not np.array_equal(one.arrays.speed, one.exact.speed)
    steps = Steps(one, true_scales([number_products(one)]))
    healthy, worn = steps.decide(None), steps.decide(0)
    assert list(worn) == list(STEPS)
    assert worn["A"].best == ("friction_wear", 1)
    assert worn["A"].odds > 3.0 > healthy["A"].odds
    seen = steps.seen(0)
    assert seen["r_raw"] > 0.98
    assert seen["d_E"] < seen["d_used"]  # discovery knows less of a healthy robot


def laboratory(*answers: tuple[float, str, int]) -> dict[str, Any]:
    """A laboratory with wear of axis 1 in every case; all steps have the same answer."""
    cases = [
        {
            "effect": "friction_wear",
            "axis": 1,
            "answers": {step: list(answer) for step in STEPS},
            "r_C": 0.9,
            "r_raw": 0.99,
            "d_used": 19.0,
            "d_C": 10.0,
            "d_E": 9.0,
            "rival_C": ["coulomb_friction", 1, 0.8],
        }
        for answer in answers
    ]
    healthy = {step: [1.0, 5.0, -2.0] for step in STEPS}
    return {
        "laboratory": "lift1_a",
        "cases": cases,
        "healthy": healthy,
        "usable": 0.9,
        "usable_of_moving": 0.95,
        "variance": [[1.0, 1.4]],
    }


def test_a_right_answer_is_above_every_healthy_recording() -> None:
    """The threshold is the largest healthy odds; discovery's own limit is another one."""
    wear, play = ("friction_wear", 1), ("backlash", 1)
    found = laboratory((6.0, *wear), (4.0, *wear), (9.0, *play), (LIMIT + 1, *wear))
    judged = outcomes(found)
    assert [row["A"] for row in judged] == ["right", "none", "wrong", "right"]
    assert [row["E own"] for row in judged] == ["none", "none", "none", "right"]


def test_the_summary_counts_what_a_step_loses() -> None:
    """Points between steps, lost effects, and goals that are reached."""
    found = laboratory((9.0, "friction_wear", 1), (9.0, "friction_wear", 1))
    found["cases"][0]["answers"]["E"] = [0.0, "friction_wear", 1]
    found["cases"][1]["answers"] |= {step: [9.0, "backlash", 1] for step in "CDE"}
    told = summary([found])
    assert (told["lost_by_signatures"], told["lost_by_priors"]) == (50.0, 50.0)
    assert told["lost_by_noise"] == 0.0
    assert (told["false_alarms"], told["healthy"]) == (0, 3)
    found["healthy"]["E"][0] = LIMIT
    assert summary([found])["false_alarms"] == 1
    assert told["effects_lost_by_signatures"] == {"friction_wear": 1}
    assert told["effects_lost_by_priors"] == {"friction_wear": 1}
    assert (told["variance_reached"], told["usable_reached"]) == (0.0, 1.0)
    assert "lift1_a friction_wear 1: correlation 0.900" in text([found], told)


def test_the_effect_with_the_largest_bayes_factor_is_the_answer() -> None:
    """Two columns beside a number; the difference is three times the second column."""
    rng = np.random.default_rng(3)
    columns = rng.normal(size=(3, 200, 1))
    target = 3 * columns[2] + rng.normal(size=(200, 1))
    one = (Group("number", 2.0),)
    products = Products.of(columns, target, 200)
    model = Model(products, np.ones(3), np.zeros(3), np.zeros(1, int), one)
    hypotheses = [
        Hypothesis(("friction_wear", axis), "friction_wear", ((axis - 1,),)) for axis in (1, 2)
    ]
    found = decided(model, hypotheses, np.zeros(1))
    assert found.best == ("friction_wear", 2)
    assert found.odds > 100.0

"""Effects are told from the gap between a robot and its healthy twin."""

import numpy as np
import pytest

from faultgen.discovery import candidates, replay, screen, sensitivities, settled
from faultgen.effects import EFFECTS

NOISE = 0.01  # of the mean torque, as `measured` adds it


@pytest.fixture(scope="module")
def twin(measured, tiny_robot):
    """The healthy recording, and sensitivities of every candidate on its motion."""
    healthy = measured([], 1)
    names = candidates(tiny_robot)
    return healthy, names, sensitivities(healthy, tiny_robot, names)


def ranked(measured, twin, robot, effects, seed=2):
    healthy, names, changes = twin
    gap = measured(effects, seed).torque - healthy.torque
    noise = np.sqrt(2) * NOISE * np.abs(healthy.torque).mean(axis=0)
    return screen(gap, changes, names, noise, settled(healthy, robot))


def test_candidates_are_the_catalogue_by_axis(tiny_robot):
    names = candidates(tiny_robot)
    assert {name for name, _ in names} == set(EFFECTS)
    assert len(names) == 2 * len(EFFECTS) - 3  # payload effects and coupling on the last axis only


@pytest.mark.parametrize(
    "effect",
    [
        ("friction_wear", 1, 0.1),
        ("viscous_friction", 2, 0.2),
        ("quadratic_viscous_friction", 1, 0.2),
        ("friction_asymmetry", 2, 0.2),
        ("torque_offset", 1, 0.01),
        ("backlash", 1, 3e-4),
        ("rotor_inertia", 2, 0.2),
        ("payload_mass", 2, 0.2),
        ("gravity_spring", 2, 1.0),
    ],
)
def test_the_effect_is_first_or_alike(measured, twin, tiny_robot, effect):
    """The true effect and axis is the first, or one that the first says it is alike with."""
    name, axis, severity = effect
    ranks = ranked(measured, twin, tiny_robot, [effect])
    first = ranks[0]
    assert (name, axis) in [(first.effect, first.axis), *first.alike]
    own = next(rank for rank in ranks if (rank.effect, rank.axis) == (name, axis))
    assert own.severity == pytest.approx(severity, abs=max(5 * own.error, 0.1 * severity))
    assert own.explained > 0.95 * first.explained


def test_without_an_effect_little_is_explained(measured, twin, tiny_robot):
    """Of noise alone the best candidate explains next to nothing."""
    ranks = ranked(measured, twin, tiny_robot, [], seed=3)
    assert ranks[0].explained < 0.02
    assert abs(ranks[0].severity) < 5 * ranks[0].error


def test_errors_are_those_of_least_squares(measured, twin, tiny_robot):
    """The severity of friction wear scatters by its stated error from recording to recording."""
    estimates = []
    for seed in range(10, 40):
        ranks = ranked(measured, twin, tiny_robot, [("friction_wear", 1, 0.05)], seed)
        own = next(rank for rank in ranks if (rank.effect, rank.axis) == ("friction_wear", 1))
        estimates.append(own.severity)
    # the healthy recording is the same: half of the noise's variance is common to all
    scatter = np.std(estimates, ddof=1)
    assert scatter == pytest.approx(own.error / np.sqrt(2), rel=0.4)


def test_coulomb_friction_and_brake_drag_are_alike(twin, measured, tiny_robot):
    """A recording cannot tell them apart, and it says so."""
    ranks = ranked(measured, twin, tiny_robot, [("brake_drag", 1, 0.01)])
    own = next(rank for rank in ranks if (rank.effect, rank.axis) == ("brake_drag", 1))
    assert ("coulomb_friction", 1) in own.alike and ("coulomb_friction", 2) not in own.alike


def test_a_replay_with_the_named_effect_closes_the_gap(measured, twin, tiny_robot):
    """Re-simulated with the severity found, the gap is down to the noise."""
    healthy, *_ = twin
    worn = measured([("viscous_friction", 2, 0.3)], 4)
    first = ranked(measured, twin, tiny_robot, [("viscous_friction", 2, 0.3)], seed=4)[0]
    change = replay(healthy, tiny_robot, [(first.effect, first.axis, first.severity)])
    change -= replay(healthy, tiny_robot)
    inside = settled(healthy, tiny_robot)
    before = np.where(inside, worn.torque - healthy.torque, 0)[:, 1].std()
    after = np.where(inside, worn.torque - healthy.torque - change, 0)[:, 1].std()
    floor = np.sqrt(2) * NOISE * np.abs(healthy.torque).mean(axis=0)[1]
    assert before > 1.3 * floor and after < 1.1 * floor

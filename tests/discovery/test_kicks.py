"""Effects that kick the rotor are computed with the answer of the servo."""

from dataclasses import replace

import numpy as np
import pytest

from faultgen.discovery import Discovery
from faultgen.discovery.terms.candidates import Term


@pytest.fixture(scope="module")
def found(measured, tiny_robot):
    """A play of axis 1, where commanded and measured positions explain the torque alike."""
    worn = measured([("backlash", 1, 1.3e-3)], 3)
    return Discovery(tiny_robot, laws=False).fit(worn, measured([], 1))


def test_a_play_of_any_size_is_found(found):
    (one,) = found.answer_.effects
    assert (one.effect, one.axis) == ("backlash", 1)
    assert one.severity == pytest.approx(1.3e-3, rel=0.03)
    assert found.answer_.after < 1.1 * found.answer_.floor


def test_its_change_is_that_of_one_simulation(found):
    """Whatever the motion is on which other columns are taken."""
    problem = found.problem_
    term = Term("backlash", 1, 1e-3, 1.0, commanded=problem.replay.measured)
    replay = problem.commanded if problem.replay.measured else problem.replay
    wanted = replay.torque([(term, 1e-3)]) - replay.torque()
    np.testing.assert_allclose(problem.change([(term, 1e-3)]), wanted, atol=1e-12)
    friction = Term("viscous_friction", 1, 0.1, 1.0)
    both = problem.change([(term, 1e-3), (friction, 0.1)])
    if problem.replay.measured:
        np.testing.assert_allclose(both, wanted + problem.change([(friction, 0.1)]), atol=1e-12)


@pytest.mark.slow
def test_commands_are_not_used_where_there_are_none(measured, tiny_robot):
    worn = replace(measured([("backlash", 1, 1.3e-3)], 3), reference_position=None)
    healthy = replace(measured([], 1), reference_position=None)
    found = Discovery(tiny_robot, laws=False).fit(worn, healthy)
    assert found.problem_.commanded is None
    assert not any(term.commanded for term in found.problem_.terms)

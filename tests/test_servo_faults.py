"""Delays of single axes, from what the servo makes of the tracking error."""

import numpy as np
import pytest
from recorded import record_cycle

from faultgen.applied import Applied
from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.replay.servo_faults import find_servo_faults


@pytest.fixture(scope="module")
def record(puma):
    """Function that records one cycle of a robot."""

    def run(*effects, seed=1, robot=puma):
        return record_cycle(robot, effects, seed)

    return run


HEAVIER = (Applied("coulomb_friction", 2, 0.4), Applied("payload_mass", 6, 0.5))
"""Changes that a comparison of torques would take for much more than a delay."""


@pytest.mark.parametrize("baseline", [True, False])
def test_a_delay_is_found_whatever_else_has_changed(puma, record, baseline):
    """0.5 ms of axis 3, with 40 % more friction of axis 2 and 50 % more payload."""
    late = Applied("delay", 3, 5e-4)
    measured = record(late, *HEAVIER)
    found = find_servo_faults(measured, puma, [record(seed=2)] if baseline else [])
    (fault,) = found.faults
    assert (fault.effect, fault.axis) == ("delay", 3)
    assert fault.severity == pytest.approx(5e-4, rel=0.1)
    assert fault.interval[0] < fault.severity < fault.interval[1]
    change = Replay(measured, puma.with_effects([late]), measured=False).torque()
    change -= Replay(measured, puma, measured=False).torque()
    assert np.abs(found.change - change).max() < 0.1 * np.abs(change).max()


@pytest.mark.parametrize("baseline", [True, False])
def test_what_is_no_delay_of_one_axis_is_not_named(puma, record, baseline):
    """Other faults, and all axes late together without a baseline: this is the clock of the log."""
    runs = [record(seed=2)] if baseline else []
    assert not find_servo_faults(record(*HEAVIER), puma, runs).faults
    together = [Applied("delay", axis, 2e-3) for axis in range(1, 7)]
    assert len(find_servo_faults(record(*together), puma, runs).faults) == (6 if baseline else 0)


def test_a_delay_that_the_model_has_is_not_found_again(puma, record):
    late = Applied("delay", 3, 5e-4)
    assert not find_servo_faults(record(late), puma.with_effects([late])).faults


def test_another_servo_is_not_judged(puma, record):
    """Without feed-forward, its torque is not what the model's servo would make of the motion."""
    spec = puma.spec()
    spec.add_numeric(name="servo_set_points", data=[1, 0, 0], size=3)
    spec.compile()
    found = find_servo_faults(record(Applied("delay", 3, 2e-3), robot=puma.edited(spec)), puma)
    assert not found.faults and not found.change.any()

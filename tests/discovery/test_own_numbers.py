"""Masses and friction of a robot, fitted before effects are simulated on its model."""

from dataclasses import replace

import numpy as np
import pytest
from recorded import record_cycle

from faultgen.applied import Applied
from faultgen.discovery.calibration.own_numbers import with_own_numbers
from faultgen.discovery.replay.replay import Replay, settled
from faultgen.discovery.replay.torque_error import relative_error


@pytest.fixture(scope="module")
def other(puma):
    """A robot with heavier links, whose centres of mass are elsewhere, and with more friction."""
    spec = puma.spec()
    for axis in range(1, puma.n_axes + 1):
        link = spec.joint(f"joint{axis}").parent
        link.mass *= 1.05
        link.ipos = np.asarray(link.ipos) * 1.04
    spec.compile()
    worn = [Applied("coulomb_friction", axis, 0.05) for axis in (2, 3)]
    return puma.edited(spec).with_effects(worn)


def error(recording, robot):
    torque = Replay(recording, robot).torque()
    square = (recording.torque - torque) ** 2
    return relative_error(square, recording, settled(recording, robot))


def test_a_model_is_fitted_to_the_healthy_robot(puma, other):
    recording = record_cycle(other)
    made, told = with_own_numbers(recording, puma)
    left = error(recording, other)  # noise, and friction at rest
    assert error(recording, puma) > 1.15 * left
    assert error(recording, made) < 1.02 * left
    assert "fitted to the healthy recording" in told


def test_a_model_that_is_right_stays(puma):
    recording = record_cycle(puma)
    assert with_own_numbers(recording, puma) == (puma, "")


def test_a_current_without_a_constant_tells_no_masses(puma, other):
    recording = replace(record_cycle(other), constants=object())
    assert with_own_numbers(recording, puma) == (puma, "")

"""Waves that hardly change the simulated torque: on torques that are written down.

The noise is white with deviation 1 N m, and the torque of the robot 10 N m.
"""

import numpy as np
import pytest
from linear import COUNT, PARTS, written_down

from faultgen.discovery.decision.small_waves import WAVE, without_small_waves
from faultgen.discovery.fit.fit import fit
from faultgen.discovery.terms.candidates import Term

INSIDE = np.zeros((COUNT, 2), bool)
INSIDE[PARTS[-1]] = True
SHAPES = [np.tile(signs, COUNT // 4) for signs in ([1.0, 1, -1, -1], [1.0, -1, 1, -1])]


def wave(order):
    """A periodic effect of axis 1 whose phase is known."""
    return Term("torque_ripple", 1, 0.1, 1e-3, (("order", order), ("phase", 0.0)))


def left_of(sizes, rest, evident=(), terms=None):
    """What is left of a set of waves with these RMS torques, beside another error."""
    columns = np.zeros((2, COUNT, 2))
    columns[:, :, 0] = SHAPES
    residual = np.tensordot(np.append(sizes, 0)[:2], columns, axes=1)
    residual[:, 0] += rest
    problem = written_down(terms or [wave(1.0), wave(2.0)], columns, residual, torque=100.0)
    groups = [(k,) for k in range(len(sizes))]
    best = fit(problem, groups)
    solution = np.zeros(2)
    return without_small_waves(problem, problem, best, solution, INSIDE, evident).groups


@pytest.mark.parametrize(("share", "stays"), [(0.9 * WAVE, False), (1.1 * WAVE, True)])
def test_a_wave_must_explain_a_part_of_what_differs_on_its_axis(share, stays):
    """Beyond noise, whose square is 1."""
    size, rest = 5.0, np.sqrt(1 + 25 * (1 - share) / share)
    assert len(left_of([size], rest)) == stays


def test_an_evident_wave_stays():
    """Although other errors are far larger."""
    assert left_of([1.0], 50.0) == ()
    assert left_of([1.0], 50.0, evident={(0,)}) == ((0,),)


@pytest.mark.parametrize(("second", "stays"), [(2.0, False), (8.0, True)])
def test_a_second_wave_is_compared_with_all_waves_of_its_axis(second, stays):
    """So that a harmonic of a large wave is no effect of its own, however clear it is."""
    kept = left_of([10.0, second], 1.0, evident={(0,), (1,)})
    assert kept == ((0,), (1,))[: 1 + stays]


def test_other_effects_are_not_judged():
    """A Coulomb friction may be as small as it likes."""
    terms = [Term("coulomb_friction", 1, 0.1, 1e-3), wave(2.0)]
    assert left_of([0.1], 50.0, terms=terms) == ((0,),)

"""When learned laws join an answer; the gaps are written down, nothing is simulated."""

from types import SimpleNamespace

import numpy as np
import pytest
from linear import COUNT, written_down

from faultgen.discovery.decision.with_laws import if_smaller
from faultgen.discovery.fit.gap import gap
from faultgen.discovery.terms.candidates import Term


@pytest.fixture
def problem():
    columns = np.zeros((1, COUNT, 2))
    return written_down([Term("torque_offset", 1, 0.1, 1.0)], columns, np.zeros((COUNT, 2)))


def answers(problem, *sizes):
    """Answers whose errors have these sizes on axis 1, 5 on axis 2, and a floor of 3."""
    for size in sizes:
        left = np.full((COUNT, 2), 5.0)
        left[:, 0] = size
        after, per_axis = gap(problem, left)
        rows = [{"axis": k + 1, "after": one, "floor": 3.0 / 10} for k, one in enumerate(per_axis)]
        yield SimpleNamespace(left_torque=left, after=after, per_axis=rows)


@pytest.mark.parametrize(("size", "kept"), [(4.99, True), (5.0, False), (6.0, False)])
def test_laws_that_make_the_gap_larger_are_left_out(problem, size, kept):
    told, whole = answers(problem, 5.0, size)
    laws = [object()]
    assert if_smaller(problem, told, whole, laws) == ((whole, laws) if kept else (told, []))
    assert if_smaller(problem, told, whole, []) == (told, [])

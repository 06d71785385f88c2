"""Discovery on recordings in which an axis rests, as those of single axes."""

import numpy as np
import pytest
from recorded import record

from faultgen.discovery import Discovery
from faultgen.discovery.replay.samples import FEWEST, enough

ONE_AXIS = """
description = "moves the second axis only"
[start]
joints = [-40, -60]
[[move]]
joints = [-40, 40]
dwell = 0.1
[[move]]
joints = [-40, -90]
speed = 0.3
[[move]]
joints = [-40, 80]
speed = 0.6
[[move]]
joints = [-40, -60]
"""


@pytest.mark.slow
@pytest.mark.parametrize(("baseline", "severity"), [(False, 1.6), (True, 0.8)])
def test_the_axis_that_moves_is_judged(tiny_robot, tmp_path, baseline, severity):
    """The other one is not compared; its numbers are written all the same.

    Against a model alone, calibration takes up friction that differs.
    """
    task = tmp_path / "one.toml"
    task.write_text(ONE_AXIS)
    worn = record(tiny_robot, str(task), 1, [("viscous_friction", 2, severity)], spread=0.0)
    healthy = record(tiny_robot, str(task), 2, spread=0.0) if baseline else None
    answer = Discovery(tiny_robot, laws=False).fit(worn, healthy).answer_
    if baseline:
        assert [(one.effect, one.axis) for one in answer.effects] == [("viscous_friction", 2)]
        found = answer.effects[0].severity
    else:
        assert answer.effects == ()
        found = answer.calibration["viscous_friction"]["2"]
    assert found == pytest.approx(severity, rel=0.1)
    assert all(np.isfinite(list(one.values())).all() for one in answer.per_axis)
    assert answer.after < answer.before


def test_samples_for_the_noise():
    """An axis with too few samples in a row is not compared."""
    inside = np.zeros((400, 2), bool)
    inside[:, 0] = True
    inside[::5, 1] = True
    found = enough(inside, [slice(0, 200), slice(200, 400)])
    assert found[:, 0].all() and not found[:, 1].any()
    short = np.zeros((400, 1), bool)
    short[: FEWEST + 8] = True
    assert enough(short, [slice(0, 400)]).any()
    assert not enough(short[1:], [slice(0, 399)]).any()

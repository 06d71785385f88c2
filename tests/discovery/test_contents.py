"""The content of ``discovery.json``."""

import pytest

from faultgen.discovery.contents import add_log_faults
from faultgen.recordings.recording import LogFault


def effect(name, axis, severity, interval):
    return {
        "effect": name,
        "axis": axis,
        "parameters": {"severity": severity, "unit": "N m"},
        "interval": {"severity": list(interval)},
        "confidence": 1.0,
        "gap_after": 0.01,
    }


@pytest.mark.parametrize(("axis", "count"), [(3, 1), (2, 2)])
def test_an_offset_of_which_the_log_shows_a_part_is_listed_once(axis, count):
    """Its severity is that of both parts; offsets of two axes are two effects."""
    result = {
        "verdict": "named",
        "effects": [effect("torque_offset", axis, 0.1, (0.09, 0.12))],
        "gap": {"calibrated": 0.02, "after": 0.01},
    }
    warnings = add_log_faults(result, [LogFault("torque_offset", 3, -0.01, (-0.012, -0.008))])
    assert len(result["effects"]) == count and warnings == []
    last = result["effects"][-1]
    own = 0.09 if axis == 3 else 0.1
    assert last["parameters"]["severity"] == pytest.approx(own)
    if axis == 3:
        assert last["interval"]["severity"] == pytest.approx([0.078, 0.112])

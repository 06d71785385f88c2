"""Presets of robots: a small log in the documented form of each becomes the recording it came from.

None of these files was written by a controller; docs/logging.md says which presets were tried on
real ones. The presets ur_rtde, abb, kuka, mat, ros1 and ros2 are tested beside their readers.
"""

import json

import numpy as np
import pytest
from test_bags_and_arrow import Message, states, write_bag
from test_importing import COUNT, PERIOD, RUN, check, columns, in_degrees, write_csv

from faultgen.errors import InputError
from faultgen.importing import load_map, map_of
from faultgen.recordings.import_log import import_log

GEARED = {"axes": {"gear_ratio": [100, -80]}}
MOTOR = RUN.torque / [100, -80]


def test_kuka_rsi(tmp_path):
    """One element for each cycle of 4 ms; IPOC counts ms."""
    rob = (
        '<Rob Type="KUKA"><RIst X="1445.0" Y="0.0" Z="1900.0" A="0.0" B="90.0" C="0.0"/>'
        '<AIPos A1="{0!r}" A2="{1!r}"/><ASPos A1="{2!r}" A2="{3!r}"/>'
        '<MACur A1="{4!r}" A2="{5!r}"/><Delay D="0"/><IPOC>{6}</IPOC></Rob>'
    )
    degrees = np.hstack([in_degrees(RUN.position), in_degrees(RUN.reference), MOTOR]).tolist()
    lines = [rob.format(*row, 4208163634 + 4 * k) for k, row in enumerate(degrees)]
    (tmp_path / "rsi.xml").write_text("\n".join(lines))
    constants = {"axes": {**GEARED["axes"], "torque_constant": [1.0, 1.0]}}
    made = import_log(tmp_path / "rsi.xml", map_of(constants, "kuka_rsi"))
    check(made.recording)
    np.testing.assert_allclose(made.recording.reference_position, RUN.reference, rtol=1e-12)
    kept = import_log(tmp_path / "rsi.xml", load_map(None, "kuka_rsi")).recording
    assert kept.current  # without constants


def test_abb_egm(tmp_path):
    """Messages as protobuf writes them in JSON; test signals carry the torques."""
    values = zip(*(a.tolist() for a in map(in_degrees, (RUN.position, RUN.reference))), strict=True)
    lines = [
        {
            "header": {"seqno": k, "tm": 90_000 + 4 * k, "mtype": "MSGTYPE_DATA"},
            "feedBack": {"joints": {"joints": position}, "time": {"sec": "17", "usec": "0"}},
            "planned": {"joints": {"joints": planned}},
            "motorState": {"state": "MOTORS_ON"},
            "testSignals": {"signals": RUN.torque[k].tolist()},
        }
        for k, (position, planned) in enumerate(values)
    ]
    (tmp_path / "egm.jsonl").write_text("\n".join(map(json.dumps, lines)))
    made = import_log(tmp_path / "egm.jsonl", load_map(None, "abb_egm"))
    check(made.recording)
    np.testing.assert_allclose(made.recording.reference_position, RUN.reference, rtol=1e-12)


def test_fanuc(tmp_path):
    """Shares of a rated torque that the user must state."""
    rated = np.array([6.5, 4.0])
    named = columns(
        time=1000 * RUN.time, JAXIS=in_degrees(RUN.position), TRQAXIS=100 * MOTOR / rated
    )
    log = write_csv(tmp_path / "log.csv", named)
    with pytest.raises(InputError, match="'TRQ1' is in percent; state torque.rated in the map"):
        import_log(log, map_of(GEARED, "fanuc"))
    made = import_log(log, map_of({**GEARED, "torque": {"rated": rated.tolist()}}, "fanuc"))
    check(made.recording)


def test_franka(tmp_path):
    """Names as src/log.cpp of libfranka writes them, with blanks behind some commas."""
    blocks = {"state.q": RUN.position, "state.q_d": RUN.reference, "state.dq": RUN.velocity}
    blocks["state.tau_J"] = RUN.torque
    blocks["cmd.tau_J_d"] = 0 * RUN.torque
    header = ",".join(f"{name}[0], {name}[1]" for name in blocks)
    rows = np.hstack(list(blocks.values())).tolist()
    lines = [f"{4 * k},1,{','.join(map(repr, row))}" for k, row in enumerate(rows)]
    (tmp_path / "log.csv").write_text("\n".join([f"time, success_rate, {header}", *lines]))
    recording = import_log(tmp_path / "log.csv", load_map(None, "franka")).recording
    check(recording, exact=True)
    assert recording.link  # the torque was measured behind the gearbox


@pytest.mark.parametrize(("preset", "link"), [("franka_ros", True), ("dvrk", False)])
def test_robots_with_ros(tmp_path, preset, link):
    """Joint states of the arm; those of a gripper are left out."""
    gripper = [Message(one.received, one.stamp, ("finger",), (0.04,), (0.0,)) for one in states()]
    messages = sorted([*gripper, *states()], key=lambda one: one.received)
    bag = write_bag(tmp_path / "run.bag", messages)
    recording = import_log(bag, load_map(None, preset)).recording
    check(recording, exact=True)
    assert recording.link == link


@pytest.mark.parametrize("raw", [False, True])
def test_lerobot(tmp_path, raw):
    """Episodes of one file; loads in 0.1 %, as numbers with a sign or as words with a sign bit."""
    pytest.importorskip("pyarrow", reason="the package pyarrow (extra data) is not installed")
    import pandas as pd

    rated = 25.0
    load = np.round(1000 * RUN.torque / rated)
    words = np.where(load < 0, 1024 - load, load)
    count = COUNT // 2
    degrees = in_degrees(RUN.position)
    pd.DataFrame(
        {
            "observation.state": list(degrees.astype(np.float32)),
            "action": list(degrees.astype(np.float32)),
            "observation.load": list(words if raw else load),
            "timestamp": (np.arange(COUNT) % count * PERIOD).astype(np.float32),
            "frame_index": np.arange(COUNT) % count,
            "episode_index": np.arange(COUNT) // count,
        }
    ).to_parquet(tmp_path / "file-000.parquet")
    content = map_of({"torque": {"rated": rated}}, "lerobot")
    recording = import_log(tmp_path / "file-000.parquet", content).recording
    assert recording.segments == (0, count)
    np.testing.assert_allclose(recording.position, RUN.position, atol=1e-6)
    np.testing.assert_allclose(recording.torque, RUN.torque, atol=0.51 * rated / 1000)

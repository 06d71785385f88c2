"""ROS 1 and ROS 2 bags with several publishers and two clocks; Parquet and Feather files."""

import json
from dataclasses import dataclass

import numpy as np
import pytest
from conftest import faultgen_here
from test_importing import GENERIC, PERIOD, RUN, changed, check, generic, imported

from faultgen.discovery import read_recording
from faultgen.errors import InputError
from faultgen.importing import map_of
from faultgen.recordings.import_log import import_log

START = 1_700_000_000 * 10**9
ARM = ("shoulder", "elbow")
STEP = round(1e9 * PERIOD)


@dataclass(frozen=True)
class Message:
    """A joint state: when it was received and stamped [ns], its joints and their values."""

    received: int
    stamp: int
    names: tuple[str, ...]
    position: tuple[float, ...]
    effort: tuple[float, ...] = ()
    publisher: str = "/driver"


def states(late=0):
    """Messages of the robot itself, received some time after their stamp [ns]."""
    for k in range(len(RUN.time)):
        at = START + STEP * k
        values = tuple(RUN.position[k]), tuple(RUN.torque[k])
        yield Message(at + late, at, ARM, *values)


def write_bag(path, messages):
    """A bag of ROS 1 if the name ends with .bag, else of ROS 2."""
    pytest.importorskip("rosbags", reason="the package rosbags (extra ros2) is not installed")
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_typestore

    one = path.suffix == ".bag"
    store = get_typestore(Stores.ROS1_NOETIC if one else Stores.ROS2_HUMBLE)
    kinds = ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    state, header, time = (store.types[kind] for kind in kinds)
    links = {}
    with rosbag1.Writer(path) if one else rosbag2.Writer(path, version=9) as writer:
        for message in messages:
            if one and message.publisher not in links:
                links[message.publisher] = writer.add_connection(
                    "/joint_states", kinds[0], typestore=store, callerid=message.publisher
                )
            elif not one and "" not in links:
                links[""] = writer.add_connection("/joint_states", kinds[0], typestore=store)
            at = time(message.stamp // 10**9, message.stamp % 10**9)
            made = state(
                header=header(seq=0, stamp=at, frame_id="") if one else header(at, ""),
                name=list(message.names),
                position=np.array(message.position, float),
                velocity=np.zeros(0),
                effort=np.array(message.effort, float),
            )
            raw = (store.serialize_ros1 if one else store.serialize_cdr)(made, kinds[0])
            writer.write(links[message.publisher if one else ""], message.received, raw)
    return path


@pytest.fixture(params=["run.bag", "run"])
def bag(request, tmp_path):
    """Path of a bag of ROS 1, and of one of ROS 2."""
    return tmp_path / request.param


def of_bag(path, content=None):
    return import_log(path, map_of(content or {}, "ros1" if path.suffix == ".bag" else "ros2"))


def test_bags_of_both_kinds(bag):
    made = of_bag(write_bag(bag, states()))
    check(made.recording, exact=True)
    assert [row.column for row in made.rows[:2]] == ["position/shoulder", "position/elbow"]


def test_a_gripper_that_publishes_first_and_more_often_is_not_the_robot(bag):
    """The robot is the largest set of joints with efforts that is published all the time."""
    gripper = [
        Message(at, at, ("finger",), (0.04,), (), "/gripper")
        for at in range(START - STEP, START + 300 * STEP, STEP // 2)
    ]
    at = START + 100 * STEP + STEP // 2
    whole = Message(at, at, (*ARM, "finger"), (3.0, 3.0, 0.0), (9.0,) * 3, "/other")
    messages = sorted([*gripper, *states(), whole], key=lambda one: one.received)
    made = of_bag(write_bag(bag, messages))
    check(made.recording, exact=True)
    assert any("messages with other joints were left out" in note for note in made.notes)
    named = of_bag(bag, {"axes": {"names": ["elbow"]}})
    np.testing.assert_array_equal(named.recording.position[:, 0], RUN.position[:, 1])
    with pytest.raises(InputError, match="no message has all of the joints 'finger', 'wrist'; its"):
        of_bag(bag, {"axes": {"names": ["finger", "wrist"]}})


def test_a_program_that_repeats_the_messages(bag):
    """Each time is there twice: such a second publisher adds nothing."""
    twice = [
        message
        for one in states()
        for message in (
            one,
            Message(one.received + 1000, one.stamp, ARM, one.position, one.effort, "/relay"),
        )
    ]
    if bag.suffix != ".bag":  # ROS 2 does not say who published
        twice = [
            Message(m.received, m.stamp, m.names[::-1], m.position[::-1], m.effort[::-1])
            if m.publisher == "/relay"
            else m
            for m in twice
        ]
    made = of_bag(write_bag(bag, twice))
    check(made.recording, exact=True)
    assert any("have the times of other messages" in note for note in made.notes)


def test_publishers_of_ros_1_are_told_apart_by_their_names(tmp_path):
    """Their messages have the same form, and say other positions."""
    ghosts = [
        Message(one.received + 999, one.stamp + 999, ARM, (1.0, -1.0), (5.0, 5.0), "/simulator")
        for one in list(states())[::3]
    ]
    messages = sorted([*states(), *ghosts], key=lambda one: one.received)
    made = of_bag(write_bag(tmp_path / "run.bag", messages))
    check(made.recording, exact=True)
    assert any("/simulator); 100 of 400 messages" in note for note in made.notes)


def test_messages_without_efforts(bag):
    """Messages of another program, or of the same one while it starts, lack them."""
    others = [Message(one.received + 999, one.stamp + 999, ARM, one.position) for one in states()][
        ::4
    ]
    made = of_bag(write_bag(bag, sorted([*states(), *others], key=lambda one: one.received)))
    check(made.recording, exact=True)
    assert any("75 of 375 messages have no effort" in note for note in made.notes)


def test_the_clock_is_chosen(bag, tmp_path):
    """--time receive takes the times of receipt; --time header refuses headers without times."""
    slow = [
        Message(START + 2 * STEP * k, one.stamp, one.names, one.position, one.effort)
        for k, one in enumerate(states())
    ]
    write_bag(bag, slow)
    preset = "ros1" if bag.suffix == ".bag" else "ros2"
    for asked, period in (("header", PERIOD), ("receive", 2 * PERIOD)):
        options = ("--preset", preset, "--time", asked, "-o", tmp_path / "m.h5")
        done = faultgen_here("import", bag, *options)
        assert done.returncode == 0, done.stderr
        assert read_recording(tmp_path / "m.h5").sample_period == pytest.approx(period)
    unset = [Message(m.received, 0, m.names, m.position, m.effort) for m in states()]
    other = write_bag(bag.with_stem("unset"), unset)
    done = faultgen_here("import", other, *options[:2], "--time", "header")
    assert done.returncode == 2 and "header.stamp is 0 in 300 of 300 messages" in done.stderr
    check(of_bag(other).recording)  # without the option, the times of receipt are used


@pytest.mark.parametrize(
    ("time", "message"), [("receive", "only ROS bags have both"), ("gps", "give header or receive")]
)
def test_other_logs_have_one_clock(tmp_path, time, message):
    (tmp_path / "log.csv").write_text("t,q1,u1\n1,2,3\n")
    done = faultgen_here("import", "log.csv", "--preset", "mat", "--time", time, cwd=tmp_path)
    # the preset reads arrays only, but the option is refused before
    assert done.returncode == 2 and message in done.stderr


# Parquet and Feather


def frame(**columns):
    return pytest.importorskip("pandas").DataFrame(columns)


@pytest.fixture(autouse=True, scope="module")
def _arrow():
    pytest.importorskip("pyarrow", reason="the package pyarrow (extra data) is not installed")


@pytest.mark.parametrize("kind", ["parquet", "feather"])
def test_plain_tables(tmp_path, kind):
    table = frame(**generic(), picture=[b"\xff" * 9] * len(RUN.time))
    log = tmp_path / f"log.{kind}"
    getattr(table, f"to_{kind}")(log)
    check(imported(log, GENERIC).recording, exact=True)


def test_times_are_dates_and_cells_are_blank(tmp_path):
    import pandas as pd

    table = frame(**generic())
    table["t"] = pd.Timestamp("2026-03-01", tz="Europe/Berlin") + pd.to_timedelta(table["t"], "s")
    table.loc[100, "u1"] = np.nan
    table.to_parquet(tmp_path / "log.parquet")
    made = imported(tmp_path / "log.parquet", changed(time={"unit": "iso"}))
    assert made.recording.sample_period == pytest.approx(PERIOD)
    assert any("rows with blank cells were left out: 1" in note for note in made.notes)


def lerobot(folder, episodes=2):
    """A dataset as LeRobot writes it, version 2.1: a file for each episode."""
    count = len(RUN.time) // episodes
    (folder / "meta").mkdir(parents=True)
    (folder / "meta" / "info.json").write_text(json.dumps({"codebase_version": "v2.1"}))
    for episode in range(episodes):
        rows = slice(episode * count, (episode + 1) * count)
        path = folder / "data" / "chunk-000" / f"episode_{episode:06d}.parquet"
        path.parent.mkdir(parents=True, exist_ok=True)
        degrees = np.degrees(RUN.position[rows]).astype(np.float32)
        frame(
            **{
                "observation.state": list(degrees),
                "action": list(degrees),
                "observation.effort": list(RUN.torque[rows]),
                "timestamp": (PERIOD * np.arange(count)).astype(np.float32),
                "episode_index": np.full(count, episode),
            }
        ).to_parquet(path)
    return folder


LEROBOT = {
    "side": "joint",
    "program": "episode_index",
    "time": {"column": "timestamp", "unit": "s"},
    "position": {"columns": "observation.state_{axis}", "unit": "deg"},
    "torque": {"columns": "observation.effort_{axis}", "unit": "Nm"},
}


def test_lists_in_cells_and_folders_of_episodes(tmp_path):
    made = imported(lerobot(tmp_path / "set"), LEROBOT)
    assert made.recording.segments == (0, 150)
    np.testing.assert_allclose(made.recording.position, RUN.position, atol=1e-6)
    np.testing.assert_allclose(made.recording.torque, RUN.torque, atol=1e-5)
    one = import_log(tmp_path / "set", map_of(LEROBOT), "1").recording
    np.testing.assert_allclose(one.torque, RUN.torque[150:], atol=1e-5)


def test_lists_of_different_length_are_refused(tmp_path):
    frame(t=[0.0, 0.1], q=[[0.1, 0.2], [0.1]]).to_parquet(tmp_path / "log.parquet")
    with pytest.raises(InputError, match="column 'q' holds lists of 1 to 2 numbers"):
        imported(tmp_path / "log.parquet", GENERIC)


@pytest.mark.parametrize("begin", [b"PAR1", b"ARROW1\0\0", b"FEA1", b"no such table"])
def test_damaged_tables_are_refused(tmp_path, begin):
    (tmp_path / "log.parquet").write_bytes(begin + bytes(range(200)) + begin)
    with pytest.raises(InputError, match="cannot be read|neither a Parquet nor a Feather") as error:
        imported(tmp_path / "log.parquet", GENERIC)
    assert "\n" not in str(error.value)


def test_the_package_for_tables_is_optional(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    (tmp_path / "log.parquet").write_bytes(b"PAR1")
    with pytest.raises(InputError, match=r"\(the extra data\); install it: pip install pyarrow"):
        imported(tmp_path / "log.parquet", GENERIC)


def test_large_tables_are_refused_before_they_are_unpacked(tmp_path):
    """A compressed file of a few kB may hold many GB."""
    import pyarrow as pa
    import pyarrow.parquet as parquet

    zeros = pa.table({"t": np.zeros(40_000_000)})
    parquet.write_table(zeros, tmp_path / "log.parquet", use_dictionary=False, compression="zstd")
    assert (tmp_path / "log.parquet").stat().st_size < 2e6
    with pytest.raises(InputError, match="its arrays take more than 240 MB in memory"):
        imported(tmp_path / "log.parquet", GENERIC)

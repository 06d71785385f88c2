"""Logs of controllers become recordings: layouts, units, signs, gears, times and bad input."""

import gzip
import re
import sqlite3
import subprocess
import sys
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest
from conftest import faultgen
from scipy.io import savemat

from faultgen.cli import app
from faultgen.discovery import Recording, read_recording, write_recording
from faultgen.errors import InputError
from faultgen.importing import load_map, map_of, preset_names, trace
from faultgen.importing.sizes import check_size
from faultgen.recordings.import_log import import_log

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / "shared" / "data" / "measured"
PERIOD = 0.004
COUNT = 300
AXES = 2


@dataclass(frozen=True)
class Run:
    """What a robot with two joints did, in SI units on the joint side."""

    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    torque: np.ndarray
    reference: np.ndarray
    temperature: np.ndarray


def run_at(time):
    """The motion as a function of time."""
    rate = np.array([2.0, 3.0])
    angle = rate * time[:, None]
    return Run(
        time=time,
        position=np.sin(angle),
        velocity=rate * np.cos(angle),
        torque=np.array([20.0, -8.0]) * np.cos(angle) + np.array([1.0, 2.0]),
        reference=np.sin(angle) + 1e-3,
        temperature=np.stack([30 + time, 40 + 2 * time], axis=1),
    )


RUN = run_at(np.arange(COUNT) * PERIOD)


def columns(**named):
    """Columns of a log: of each axis where an array has two, from a pattern with a {}."""
    out = {}
    for name, values in named.items():
        first, values = values if isinstance(values, tuple) else (1, values)
        if values.ndim == 1:
            out[name] = values
        else:
            out.update({name.replace("AXIS", str(first + k)): values[:, k] for k in range(AXES)})
    return out


def write_csv(path, named, separator=",", decimal=".", before="", encoding="utf-8", end=""):
    """Write columns with 17 digits, so that reading them gives the same numbers."""
    rows = zip(*(np.asarray(one).tolist() for one in named.values()), strict=True)
    cells = [[c if isinstance(c, str) else repr(c).replace(".", decimal) for c in r] for r in rows]
    lines = [separator.join(row) + end for row in ([*named], *cells)]
    path.write_bytes((before + "\n".join(lines) + "\n").encode(encoding))
    return path


GENERIC = {
    "side": "joint",
    "time": {"column": "t", "unit": "s"},
    "position": {"columns": "q{axis}", "unit": "rad"},
    "torque": {"columns": "u{axis}", "unit": "Nm"},
}


def generic(run=RUN):
    return columns(t=run.time, qAXIS=run.position, uAXIS=run.torque)


def changed(**entries):
    """The generic map with some entries of its tables changed."""
    out = dict(GENERIC)
    for name, value in entries.items():
        both = isinstance(value, dict) and isinstance(out.get(name), dict)
        out[name] = {**out[name], **value} if both else value
    return out


def imported(path, content):
    return import_log(path, map_of(content))


def check(recording, run=RUN, exact=False):
    """The recording is the run; to all digits, or to the rounding of conversions."""
    compare = np.testing.assert_array_equal if exact else np.testing.assert_allclose
    options = {} if exact else {"rtol": 1e-12, "atol": 1e-12}
    assert recording.side == "joint"
    assert recording.sample_period == pytest.approx(PERIOD, rel=1e-9)
    compare(recording.position, run.position, **options)
    compare(recording.torque, run.torque, **options)


def test_a_plain_log_is_read_to_the_last_digit_and_written(tmp_path):
    """The file that the command writes is the recording that a user reads back."""
    log = write_csv(tmp_path / "log.csv", generic())
    made = imported(log, GENERIC)
    check(made.recording, exact=True)
    write_recording(made.recording, tmp_path / "measured.h5")
    back = read_recording(tmp_path / "measured.h5")
    check(back, exact=True)
    assert made.gaps == () and made.jitter < 1e-12 and back.segments == (0,)


# presets: each layout as the controller writes it


def in_degrees(values):
    return np.degrees(values)


def test_preset_ur_rtde(tmp_path):
    """Blanks between columns, axes from 0, currents without torque constants."""
    named = columns(
        timestamp=1000.0 + RUN.time,
        target_q_AXIS=(0, RUN.reference),
        actual_q_AXIS=(0, RUN.position),
        actual_qd_AXIS=(0, RUN.velocity),
        actual_current_AXIS=(0, RUN.torque),
        joint_temperatures_AXIS=(0, RUN.temperature),
        robot_mode=np.full(COUNT, 7),
    )
    log = write_csv(tmp_path / "robot_data.csv", named, separator=" ")
    recording = import_log(log, load_map(None, "ur_rtde")).recording
    check(recording, exact=True)  # the currents in [A] are the numbers of the torque
    assert recording.current
    np.testing.assert_array_equal(recording.velocity, RUN.velocity)
    np.testing.assert_array_equal(recording.reference_position, RUN.reference)
    np.testing.assert_array_equal(recording.temperature, RUN.temperature)
    # newer controllers log the torque too: it is preferred
    named |= columns(actual_current_as_torque_AXIS=(0, 3 * RUN.torque))
    made = import_log(write_csv(log, named, separator=","), load_map(None, "ur_rtde"))
    np.testing.assert_array_equal(made.recording.torque, 3 * RUN.torque)
    assert not made.recording.current
    assert "the torque was read; currents were left out" in made.notes


def test_preset_abb(tmp_path):
    """Degrees and milliseconds, as RAPID programs write test signals."""
    named = columns(
        time=1e3 * RUN.time,
        position_AXIS=in_degrees(RUN.position),
        speed_AXIS=in_degrees(RUN.velocity),
        torque_AXIS=RUN.torque,
    )
    log = write_csv(tmp_path / "signals.txt", named, separator="\t")
    recording = import_log(log, load_map(None, "abb")).recording
    check(recording)
    np.testing.assert_allclose(recording.velocity, RUN.velocity, atol=1e-12)
    assert recording.reference_position is None


KUKA = {
    "Sollposition": 1e6 * in_degrees(RUN.reference),
    "Istposition": 1e6 * in_degrees(RUN.position),
    "Istmoment": RUN.torque / np.array([100.0, -80.0]),
    "Motortemperatur": RUN.temperature + 273.15,
}
GEARED = {"axes": {"gear_ratio": [100.0, -80.0]}}


def write_trace(folder, axis, short=0):
    """The files of one drive: a header in cp1252, and blocks of doubles."""
    stem = f"run_NextGenDrive#{axis}"
    head = [
        "DIAEHEADERFILE#00000000001",
        *("#BEGINCHANNELHEADER", "200,Zeit", "202,s", "210,IMPLICIT", f"220,{COUNT - short}"),
        *("240,0", f"241,{PERIOD}", "#ENDCHANNELHEADER"),
    ]
    for k, name in enumerate(KUKA):
        head += ["#BEGINCHANNELHEADER", f"200,{name}", "202,°" if "position" in name else "202,"]
        head += ["210,EXPLIZIT", f"211,C:\\KRC\\TRACE\\{stem}.R64", "213,BLOCK", "214,REAL64"]
        head += [f"220,{COUNT - short}", f"221,{k + 1}", "240,0", "241,1", "#ENDCHANNELHEADER"]
    (folder / f"{stem}.dat").write_bytes("\r\n".join(head).encode("cp1252"))
    values = np.stack([one[: COUNT - short, axis - 1] for one in KUKA.values()], axis=1)
    (folder / f"{stem}.r64").write_bytes(values.astype("<f8").tobytes())
    return folder / f"{stem}.dat"


def test_preset_kuka(tmp_path):
    """Traces of all drives are read with the first; the torque of the motor needs gear ratios."""
    log = write_trace(tmp_path, 1)
    write_trace(tmp_path, 2)
    made = import_log(log, map_of(GEARED, "kuka"))
    check(made.recording)
    np.testing.assert_allclose(made.recording.reference_position, RUN.reference, atol=1e-12)
    np.testing.assert_allclose(made.recording.temperature, RUN.temperature, atol=1e-9)
    assert any("states °; it was read as udeg" in note for note in made.notes)
    with pytest.raises(InputError, match=r"torque is on the motor side.*state axes.gear_ratio"):
        import_log(log, load_map(None, "kuka"))
    # the same channels as text
    text = {"Zeit": RUN.time}
    for name, values in KUKA.items():
        text |= {f"{name}#{k + 1}": values[:, k] for k in range(AXES)}
    path = write_csv(tmp_path / "trace.txt", text, separator="\t", decimal=",")
    check(import_log(path, map_of(GEARED, "kuka")).recording)


def test_traces_of_different_length_are_cut(tmp_path):
    """The drives may have stopped recording at different times; the shortest counts."""
    write_trace(tmp_path, 1)
    log = write_trace(tmp_path, 2, short=5)
    made = import_log(log, map_of(GEARED, "kuka"))
    assert len(made.recording.position) == COUNT - 5
    assert "the files have 295 to 300 rows; all were cut to 295" in made.notes


def test_channels_of_a_trace_are_limited_together(tmp_path, monkeypatch):
    """Of all data files of a header, and of all headers; each channel counts once."""
    log = write_trace(tmp_path, 1)
    text = log.read_text(encoding="cp1252").replace("213,BLOCK", "213,CHANNEL")
    for k, values in enumerate(KUKA.values(), start=1):  # a data file for each channel
        text = text.replace(".R64", f"_{k}.data", 1).replace(f"221,{k}", "221,1", 1)
        (tmp_path / f"run_NextGenDrive#1_{k}.data").write_bytes(values[:, 0].tobytes())
    log.write_text(text, encoding="cp1252")
    size = 8 * COUNT * len(KUKA)
    for limit, message in ((size + 8 * COUNT, ""), (size - 1, "take more than")):
        monkeypatch.setattr(trace, "check_size", partial(check_size, limit=limit))
        with pytest.raises(InputError, match=message) if message else nullcontext():
            assert len(trace.read_trace(log)) == COUNT
    write_trace(tmp_path, 2)
    monkeypatch.setattr(trace, "check_size", partial(check_size, limit=1.5 * size))
    with pytest.raises(InputError, match="take more than"):
        trace.read_trace(log)


@pytest.mark.parametrize(
    ("harm", "message"),
    [
        (lambda text: text.replace("REAL64", "ASCII"), "has type ASCII; known are REAL64"),
        (lambda text: text.replace("R64", "X64").replace("#1.", "#9."), "is not beside it"),
        (lambda text: text.replace("220,300", "220,many"), "line 220 holds 'many'"),
        (lambda text: text.replace("221,1", "221,-5"), "line 221 holds -5"),
        (lambda text: text.replace("EXPLIZIT", "IMPLICIT"), "lists no channel with data"),
        (lambda text: text.replace("200,Istmoment", "200,"), "a channel has no name"),
    ],
)
def test_damaged_traces_are_refused(tmp_path, harm, message):
    log = write_trace(tmp_path, 1)
    text = harm(log.read_text(encoding="cp1252"))
    log.write_text(text, encoding="cp1252")
    if "X64" in text:
        (tmp_path / "run_NextGenDrive#1.r64").unlink()
    with pytest.raises(InputError, match=message):
        import_log(log, map_of(GEARED, "kuka"))


MATRICES = {"t": RUN.time, "q": RUN.position, "tau": RUN.torque, "qd": RUN.velocity.T}


@pytest.mark.parametrize("kind", ["5", "4", "7.3", "npz"])
def test_preset_mat(tmp_path, kind):
    """All versions of MATLAB's files, and NumPy's; matrices may lie in either way."""
    path = tmp_path / ("log.npz" if kind == "npz" else "log.mat")
    if kind == "npz":
        np.savez(path, **MATRICES)
    elif kind == "7.3":
        with h5py.File(path, "w", userblock_size=512) as file:
            for name, values in MATRICES.items():
                file[name] = np.atleast_2d(values.T)  # MATLAB stores matrices transposed
        with path.open("r+b") as file:
            file.write(b"MATLAB 7.3 MAT-file")
    else:
        savemat(path, MATRICES | {"note": "a text", "gain": 3.0}, format=kind)
    recording = import_log(path, load_map(None, "mat")).recording
    check(recording, exact=True)
    np.testing.assert_array_equal(recording.velocity, RUN.velocity)


def test_structs_of_matlab(tmp_path):
    """Fields of structs have names with a dot."""
    savemat(tmp_path / "log.mat", {"log": {"arm": {"q": RUN.position}, "tau": RUN.torque}})
    own = {
        "time": {"sample_period": PERIOD},
        "position": {"columns": "log.arm.q_{axis}"},
        "torque": {"columns": "log.tau_{axis}"},
    }
    check(import_log(tmp_path / "log.mat", map_of(own, "mat")).recording, exact=True)


@pytest.mark.parametrize("content", [b"", b"PK\3\4 no zip", b"MATLAB 5.0 MAT-file" + bytes(200)])
def test_damaged_array_files_are_refused(tmp_path, content):
    (tmp_path / "log.mat").write_bytes(content)
    with pytest.raises(InputError, match=r"log\.mat: (cannot be read|has no arrays of numbers)"):
        import_log(tmp_path / "log.mat", load_map(None, "mat"))


JOINTS = ("shoulder", "elbow")


def write_bag(folder, storage, topics=("/joint_states",), stranger=False):
    """A bag whose messages name the elbow first, and arrive late by different times."""
    pytest.importorskip("rosbags", reason="the package rosbags (extra ros2) is not installed")
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    types = store.types
    time, header = types["builtin_interfaces/msg/Time"], types["std_msgs/msg/Header"]
    state = types["sensor_msgs/msg/JointState"]
    rng = np.random.default_rng(0)
    with Writer(folder, version=9, storage_plugin=StoragePlugin[storage]) as writer:
        for topic in topics:
            connection = writer.add_connection(topic, state.__msgtype__, typestore=store)
            for k in range(COUNT):
                stamp = 1_767_225_600_000_000_000 + 4_000_000 * k
                at = header(time(stamp // 10**9, stamp % 10**9), "")
                values = (RUN.position[k, ::-1], RUN.velocity[k, ::-1], RUN.torque[k, ::-1])
                message = state(at, list(JOINTS[::-1]), *(one.copy() for one in values))
                late = stamp + int(rng.integers(3_000_000))
                writer.write(connection, late, store.serialize_cdr(message, state.__msgtype__))
                if stranger and k % 10 == 0:
                    other = state(at, ["gripper"], *(np.zeros(1) for _ in range(3)))
                    writer.write(connection, late, store.serialize_cdr(other, state.__msgtype__))
    return folder


@pytest.mark.parametrize("storage", ["SQLITE3", "MCAP"])
def test_preset_ros2(tmp_path, storage):
    """The stamps of the messages count, and the order of axes that the map states."""
    bag = write_bag(tmp_path / "bag", storage, stranger=True)
    named = {"axes": {"names": list(JOINTS)}}
    made = import_log(bag, map_of(named, "ros2"))
    check(made.recording, exact=True)
    np.testing.assert_array_equal(made.recording.velocity, RUN.velocity)
    assert made.jitter == pytest.approx(0, abs=1e-9)
    assert "30 messages with other joints were left out" in made.notes
    # without names, the order is that of the messages, and the command says so
    (file,) = [one for one in bag.iterdir() if one.suffix in (".db3", ".mcap")]
    made = import_log(file, load_map(None, "ros2"))
    np.testing.assert_array_equal(made.recording.position, RUN.position[:, ::-1])
    assert any("in the order of its first message, elbow, shoulder" in one for one in made.notes)


def test_bags_that_cannot_be_read(tmp_path):
    """Several topics, a wrong one, and a folder that is no bag."""
    bag = write_bag(tmp_path / "bag", "SQLITE3", topics=("/left", "/right"))
    with pytest.raises(InputError, match="several topics have joint states; state file.topic: /l"):
        import_log(bag, load_map(None, "ros2"))
    topic = {"file": {"topic": "/middle"}}
    with pytest.raises(InputError, match="no topic '/middle' with joint states; there are /left,"):
        import_log(bag, map_of(topic, "ros2"))
    named = {"file": {"topic": "/left"}, "axes": {"names": list(JOINTS)}}
    check(import_log(bag, map_of(named, "ros2")).recording, exact=True)
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="cannot be read as a ROS bag"):
        import_log(tmp_path / "empty", load_map(None, "ros2"))
    with sqlite3.connect(next(bag.glob("*.db3"))) as connection:
        connection.execute("drop table messages")
    with pytest.raises(InputError, match="cannot be read as a ROS bag"):
        import_log(bag, map_of(named, "ros2"))


def test_bags_need_a_package_that_is_optional(tmp_path, monkeypatch):
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information:\n")
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    with pytest.raises(InputError, match=r"\(the extra ros2\); install it: pip install rosbags"):
        import_log(tmp_path, load_map(None, "ros2"))


def test_every_preset_says_where_it_comes_from_and_what_is_assumed():
    arms = ["abb", "abb_egm", "dvrk", "fanuc", "franka", "franka_ros", "kuka", "kuka_rsi"]
    assert preset_names() == [*arms, "lerobot", "mat", "ros1", "ros2", "ur_rtde"]
    for name in preset_names():
        preset = load_map(None, name)
        assert preset.description and preset.source.strip() and preset.assumed.strip()


# how text is written


@pytest.mark.parametrize("separator", [",", ";", "\t", " ", "  "])
@pytest.mark.parametrize("decimal", [".", ","])
@pytest.mark.parametrize("first", [0, 1])
def test_separators_and_decimal_signs_are_found_out(tmp_path, separator, decimal, first):
    """Every pair that is not ambiguous, without a word in the map."""
    if separator == decimal:
        pytest.skip("a comma cannot be both")
    named = columns(t=RUN.time, qAXIS=(first, RUN.position), uAXIS=(first, RUN.torque))
    log = write_csv(tmp_path / "log.txt", named, separator=separator, decimal=decimal)
    check(imported(log, GENERIC).recording, exact=True)


@pytest.mark.parametrize(
    "before",
    [
        "# robot: arm\n# date: 2026-03-01, 09:30\n",
        "Trace of robot 7\nOperator;nobody\n\n",
        "% 1, 2, 3\n// 4, 5, 6\n",
    ],
)
def test_lines_before_the_names_are_left_out(tmp_path, before):
    log = write_csv(tmp_path / "log.csv", generic(), before=before)
    check(imported(log, GENERIC).recording, exact=True)


def test_names_in_a_comment_and_comments_between_rows(tmp_path):
    """numpy.savetxt writes the names behind a #; a controller may write remarks among the rows."""
    log = write_csv(tmp_path / "log.csv", generic(), before="# arm\n# ")
    text = log.read_text().splitlines()
    text.insert(50, "# stopped, and went on")
    log.write_text("\n".join(text))
    check(imported(log, GENERIC).recording, exact=True)


def test_names_and_header_lines_that_the_map_states(tmp_path):
    """Without names in the log, or with names in a certain line."""
    log = write_csv(tmp_path / "log.csv", generic())
    rows = log.read_text().splitlines()
    log.write_text("\n".join(rows[1:]))
    with pytest.raises(InputError, match=r"line 1 has 5 numbers, but there is no line above"):
        imported(log, GENERIC)
    names = ["t", "q1", "q2", "u1", "u2"]
    check(imported(log, changed(file={"names": names})).recording, exact=True)
    with pytest.raises(InputError, match="lists 2 names, but line 1 has 5 columns"):
        imported(log, changed(file={"names": names[:2]}))
    log.write_text("\n".join([rows[0], "a,b,c,d,e", *rows[1:]]))
    check(imported(log, changed(file={"header": 1})).recording, exact=True)
    with pytest.raises(InputError, match="no column 'q{axis}' for \\[position\\]"):
        imported(log, GENERIC)


def test_units_may_stand_with_the_names_or_below(tmp_path):
    """In brackets, or in a line of their own; the map then need not state them."""
    bare = {
        name: one if name == "side" else {k: v for k, v in one.items() if k != "unit"}
        for name, one in GENERIC.items()
    }
    named = {
        "t [ms]": 1e3 * RUN.time,
        **{f"q{k + 1} (°)": in_degrees(RUN.position[:, k]) for k in range(AXES)},
        **{f"u{k + 1} [N·m]": RUN.torque[:, k] for k in range(AXES)},
    }
    for encoding in ("utf-8", "cp1252", "utf-16"):
        log = write_csv(tmp_path / "log.csv", named, separator=";", encoding=encoding)
        made = imported(log, bare)
        check(made.recording)
        repeated = {**bare, "position": {"columns": "q{axis} (°)"}}
        check(imported(log, repeated).recording)
        assert any("not UTF-8" in note for note in made.notes) == (encoding == "cp1252")
    plain = dict(zip(generic(), named.values(), strict=True))
    log = write_csv(tmp_path / "log.csv", plain, separator=";")
    names, *rows = log.read_text().splitlines()
    log.write_text("\n".join([names, "ms;deg;deg;Nm;Nm", *rows]))
    check(imported(log, bare).recording)
    log.write_text("\n".join([names, *rows]))
    with pytest.raises(InputError, match="the unit of column 'q1' is not known; state position.un"):
        imported(log, bare)


def test_compressed_logs_and_lines_that_end_with_a_separator(tmp_path):
    log = write_csv(tmp_path / "log.csv", generic(), separator=";", end=";")
    check(imported(log, GENERIC).recording, exact=True)
    (tmp_path / "log.csv.gz").write_bytes(gzip.compress(log.read_bytes()))
    check(imported(tmp_path / "log.csv.gz", GENERIC).recording, exact=True)
    (tmp_path / "log.csv.gz").write_bytes(gzip.compress(log.read_bytes())[:-100])
    with pytest.raises(InputError, match="cannot be read"):
        imported(tmp_path / "log.csv.gz", GENERIC)


@pytest.mark.filterwarnings("error")
def test_tabs_behind_the_last_value_are_no_columns(tmp_path):
    """Neither where all rows end with some, nor where the last cell of a row is blank."""
    log = write_csv(tmp_path / "log.csv", generic(), separator="\t", end="\t\t")
    names, *rows = log.read_text().splitlines()
    log.write_text("\n".join([names.rstrip(), *rows]))
    check(imported(log, GENERIC).recording, exact=True)
    rows[4] = rows[4].rstrip().rpartition("\t")[0] + "\t"
    log.write_text("\n".join([names.rstrip(), *rows]))
    made = imported(log, GENERIC)
    assert any("blank" in note for note in made.notes)


# units, signs, sides


@pytest.mark.parametrize(
    ("entries", "factor"),
    [
        ({"position": {"unit": "deg"}}, np.pi / 180),
        ({"position": {"unit": "mrad"}}, 1e-3),
        ({"position": {"unit": "rev"}}, 2 * np.pi),
        ({"position": {"unit": "mm"}}, 1e-3),
        ({"position": {"unit": 0.25}}, 0.25),
        ({"position": {"sign": -1}}, -1),
        ({"position": {"sign": [1, -1]}}, [1, -1]),
        ({"position": {"unit": ["deg", "mm"]}}, [np.pi / 180, 1e-3]),
        ({"torque": {"unit": "mNm"}}, 1e-3),
        ({"torque": {"unit": "kN"}}, 1e3),
        ({"torque": {"unit": "%", "rated": [50.0, 20.0]}}, [0.5, 0.2]),
        ({"torque": {"side": "motor"}, "axes": {"gear_ratio": [100, -80]}}, [100, -80]),
        ({"position": {"side": "joint"}, "torque": {"sign": -1}}, -1),
    ],
)
def test_units_signs_and_gears_are_factors(tmp_path, entries, factor):
    """Each entry multiplies the quantity that it belongs to by what it says, and nothing else."""
    log = write_csv(tmp_path / "log.csv", generic())
    recording = imported(log, changed(**entries)).recording
    last = list(entries)[0] if "torque" not in entries else "torque"
    for name in ("position", "torque"):
        wanted = getattr(RUN, name) * (np.array(factor) if name == last else 1)
        np.testing.assert_allclose(getattr(recording, name), wanted, rtol=1e-12, err_msg=name)


def test_motor_side_positions_with_joint_torque_and_reference(tmp_path):
    """The side is that of the positions; the rest is converted, the reference to joints."""
    ratio = np.array([100.0, -80.0])
    named = columns(
        t=RUN.time, qAXIS=RUN.position * ratio, uAXIS=RUN.torque, rAXIS=RUN.reference * ratio
    )
    log = write_csv(tmp_path / "log.csv", named)
    content = changed(
        side="motor",
        axes={"gear_ratio": ratio.tolist()},
        torque={"side": "joint"},
        reference_position={"columns": "r{axis}", "unit": "rad"},
    )
    recording = imported(log, content).recording
    assert recording.side == "motor"
    np.testing.assert_allclose(recording.position, RUN.position * ratio, rtol=1e-12)
    np.testing.assert_allclose(recording.torque, RUN.torque / ratio, rtol=1e-12)
    np.testing.assert_allclose(recording.reference_position, RUN.reference, rtol=1e-12)


def test_signs_of_axes_hold_for_all_their_quantities(tmp_path):
    named = columns(t=RUN.time, qAXIS=RUN.position, uAXIS=RUN.torque, vAXIS=RUN.velocity)
    log = write_csv(tmp_path / "log.csv", named)
    velocity = {"columns": "v{axis}", "unit": "rad/s"}
    recording = imported(log, changed(axes={"sign": [1, -1]}, velocity=velocity)).recording
    for name in ("position", "torque", "velocity"):
        np.testing.assert_array_equal(getattr(recording, name), getattr(RUN, name) * [1, -1])


def test_currents_become_torques_where_the_constants_are_known(tmp_path):
    """On the side of the current; a zero of the sensor is subtracted before."""
    log = write_csv(tmp_path / "log.csv", generic())
    content = {k: v for k, v in GENERIC.items() if k != "torque"}
    current = {"columns": "u{axis}", "unit": "mA", "zero": 5.0, "side": "motor"}
    made = imported(log, {**content, "current": current})
    assert made.recording.current
    np.testing.assert_allclose(made.recording.torque, 1e-3 * (RUN.torque - 5), rtol=1e-12)
    axes = {"torque_constant": [0.5, 2.0], "gear_ratio": [100.0, 50.0]}
    made = imported(log, {**content, "current": current, "axes": axes})
    assert not made.recording.current
    wanted = 1e-3 * (RUN.torque - 5) * [50.0, 100.0]
    np.testing.assert_allclose(made.recording.torque, wanted, rtol=1e-12)
    assert [row.factor for row in made.rows if row.quantity == "joint_torque"] == pytest.approx(
        [0.05, 0.1]
    )
    of_joint = {**content, "current": {**current, "side": "joint"}}
    made = imported(log, {**of_joint, "axes": {"torque_constant": 3}})
    np.testing.assert_allclose(made.recording.torque, 3e-3 * (RUN.torque - 5), rtol=1e-12)


def test_the_report_states_what_was_read(tmp_path):
    """Column, unit, factor and range of each axis."""
    log = write_csv(tmp_path / "log.csv", generic())
    first = imported(log, changed(position={"unit": "deg"})).rows[0]
    assert (first.quantity, first.axis, first.column) == ("joint_position", 1, "q1")
    assert (first.unit, first.si) == ("deg", "rad")
    assert first.factor == pytest.approx(np.pi / 180)
    assert first.lowest == pytest.approx(np.radians(RUN.position[:, 0].min()))
    assert first.highest == pytest.approx(np.radians(RUN.position[:, 0].max()))


def test_doubtful_numbers_are_warned_of(tmp_path):
    """A wrong unit of time, degrees taken for rad, and a torque that never changes."""
    named = generic() | {"q1": 90 * RUN.position[:, 0], "u2": np.full(COUNT, 0.5)}
    log = write_csv(tmp_path / "log.csv", named)
    notes = imported(log, changed(time={"unit": 100.0})).notes
    told = [note for note in notes if note.startswith("warning")]
    assert len(told) == 2
    assert any("2.5 Hz is too slow" in n and "correct time.unit in the map" in n for n in notes)
    assert "axis 1 reaches" in told[0] and "check position.unit" in told[0]
    assert "the torque of axis 2 never changes" in told[1]
    notes = imported(log, changed(time={"unit": 1e-2})).notes
    assert any("2.5e+04 Hz is an unusual sample rate; check time.unit" in note for note in notes)
    log = write_csv(log, generic())
    assert not [note for note in imported(log, GENERIC).notes if note.startswith("warning")]


# time


@pytest.mark.parametrize(
    ("unit", "values"),
    [
        ("ms", 1e3 * RUN.time),
        ("us", (1e6 * RUN.time).round().astype(int)),
        ("ns", 1_767_225_600_000_000_000 + (1e9 * RUN.time).round().astype(int)),
        ("min", RUN.time / 60),
        ("s", [f"{1_767_225_600 + one:.3f}" for one in RUN.time]),
        (0.004, np.arange(COUNT) + 17),
        (
            "iso",
            pd.date_range("2026-03-01T09:30:00", periods=COUNT, freq="4ms").map(
                lambda time: time.isoformat(timespec="milliseconds")
            ),
        ),
        (
            "iso",
            pd.date_range("2026-03-01T09:30:00", periods=COUNT, freq="4ms").map(
                lambda time: time.isoformat(sep=" ", timespec="microseconds") + "+01:00"
            ),
        ),
    ],
)
def test_times_in_any_unit(tmp_path, unit, values):
    """Numbers, also those with more digits than a float has, and dates."""
    log = write_csv(tmp_path / "log.csv", generic() | {"t": values}, separator=";")
    made = imported(log, changed(time={"unit": unit}))
    check(made.recording, exact=True)
    assert made.jitter < 1e-7 and made.gaps == ()


def test_a_sample_period_instead_of_times(tmp_path):
    log = write_csv(tmp_path / "log.csv", generic())
    check(imported(log, changed(time={"column": None, "sample_period": PERIOD})).recording)


def test_jitter_is_measured_and_interpolated(tmp_path):
    """As the reader of recordings does it: the same function, the same result."""
    rng = np.random.default_rng(3)
    run = run_at(5.0 + PERIOD * (np.arange(COUNT) + 0.3 * rng.uniform(-1, 1, COUNT)))
    made = imported(write_csv(tmp_path / "log.csv", generic(run)), GENERIC)
    recording = made.recording
    assert recording.sample_period == PERIOD
    right = run_at(run.time[0] + PERIOD * np.arange(len(recording.position)))
    np.testing.assert_allclose(recording.position, right.position, atol=1e-6)
    assert made.jitter == pytest.approx(np.abs(np.diff(run.time) - PERIOD).max())
    assert any("not evenly spaced" in note for note in made.notes)


def test_gaps_divide_the_recording(tmp_path):
    """Lost samples are interpolated up to three periods; after that, a new segment begins."""
    kept = np.delete(np.arange(COUNT), [*range(60, 62), *range(150, 180)])
    run = run_at(RUN.time[kept])
    made = imported(write_csv(tmp_path / "log.csv", generic(run)), GENERIC)
    assert made.recording.segments == (0, 150)
    assert made.gaps == pytest.approx((31 * PERIOD,))
    inner = np.r_[0:60, 62:150]
    np.testing.assert_allclose(made.recording.position[inner], RUN.position[inner], atol=1e-9)
    np.testing.assert_allclose(made.recording.torque[150:], RUN.torque[180:], atol=1e-9)


def test_a_column_may_divide_the_recording(tmp_path):
    """Where its value changes, the clock may go back a little."""
    run = run_at(np.concatenate([RUN.time[:100], RUN.time[90:290]]))
    named = generic(run) | {"run": np.repeat([4, 9], [100, 200])}
    log = write_csv(tmp_path / "log.csv", named)
    with pytest.raises(InputError, match="the time goes back in line 102; sort the log, or name a"):
        imported(log, GENERIC)
    assert imported(log, changed(segment="run")).recording.segments == (0, 100)


def test_blank_cells_and_equal_times_are_left_out_and_told(tmp_path):
    """A row that is not complete is missing; so is one with the time of the row before."""
    log = write_csv(tmp_path / "log.csv", generic())
    rows = log.read_text().splitlines()
    rows[11] = re.sub(r"[^,]*$", "", rows[11], count=1)
    rows[21] = re.sub(r"[^,]*$", "NaN", rows[21], count=1)
    rows.insert(31, rows[30])
    log.write_text("\n".join(rows))
    made = imported(log, GENERIC)
    np.testing.assert_allclose(made.recording.position, RUN.position, atol=1e-6)
    assert "rows with blank cells were left out: 2, the first is line 12" in made.notes
    assert (
        "rows with the time of the row before were left out: 1, the first is line 32" in made.notes
    )


# bad input


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ({"position": {"columns": "Q{axis}"}}, r"no column 'Q\{axis\}' for \[position\]; similar"),
        ({"torque": {"columns": "M_{axis}"}}, r"no column 'M_1' for \[torque\]; the log has 5 col"),
        ({"torque": {"columns": ["u1", "u3"]}}, r"no column 'u3' for \[torque\]; similar columns "),
        ({"torque": {"columns": ["u1"]}}, "torque.columns lists 1 columns, but there are 2 axes"),
        (
            {"time": {"column": "T"}},
            r"no column 'T' for \[time\]; similar columns are 't'; the log has 5 columns: 't', ",
        ),
        ({"segment": "run"}, r"no column 'run' for \[segment\]"),
        ({"position": {"unit": "Nm"}}, "column 'q1', position.unit 'Nm' is none of position; give"),
        ({"position": {"unit": 0}}, "position.unit 0: a number of rad must not be 0"),
        ({"position": {"unit": ["deg"]}}, "position.unit: lists 1 values for 2 axes"),
        (
            {"time": {"unit": "hours"}},
            "column 't', time.unit 'hours' is none of time; give",
        ),
        (
            {"time": {"unit": "iso"}},
            "column 't' holds '0.0' in line 2, which is no time",
        ),
        ({"torque": {"unit": "%"}}, "column 'u1' is in percent; state torque.rated in the map"),
        ({"torque": {"side": "motor"}}, "torque is on the motor side, but the recording needs it"),
        ({"position": {"columns": "q"}}, "position.columns: 'q' lacks {axis}"),
        ({"positon": {"columns": "q"}}, "positon: unknown; did you mean 'position'?"),
        ({"position": {"colunms": "q"}}, "position.colunms: unknown; did you mean 'columns'?"),
        ({"axes": {"sign": 2}}, "axes.sign: input should be 1 or -1"),
        ({"side": "left"}, "side: input should be 'motor' or 'joint', not 'left'"),
        ({"time": {"sample_period": 0.1}}, "time: give either column or sample_period"),
        ({"axes": {"names": [1, 2, 3]}}, r"no column 'q3' for \[position\]; similar columns are"),
        ({"file": {"separator": ";"}}, "no line with two or more numbers among the first 301"),
        ({"file": {"encoding": "klingon"}}, "file.encoding: 'klingon' is unknown"),
        ({"file": {"header": 900}}, "file.header is 900, but it has 301 lines"),
        (
            {"torque_sensor": "link", "side": "motor"},
            "torque_sensor is 'link', but it has motor",
        ),
    ],
)
def test_wrong_maps_are_refused_in_one_line(tmp_path, entries, message):
    """The line names the column or the entry, and the remedy."""
    log = write_csv(tmp_path / "log.csv", generic())
    with pytest.raises(InputError, match=message) as caught:
        imported(log, changed(**entries))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["side", "time", "position"])
def test_entries_that_must_be_there(name):
    with pytest.raises(InputError, match=f"^map: {name}: missing; state "):
        map_of({key: value for key, value in GENERIC.items() if key != name})


def replaced(row, old, new):
    def harm(text):
        lines = text.splitlines()
        lines[row - 1] = re.sub(old, new, lines[row - 1])
        return "\n".join(lines)

    return harm


@pytest.mark.parametrize(
    ("harm", "message"),
    [
        (lambda text: "", "log.csv: is empty"),
        (lambda text: "a,b\nc,d\n", "no line with two or more numbers"),
        (
            lambda text: text.replace("q2", "q1"),
            r"no column 'q\{axis\}' for .*: 't', 'q1 \(1\)', 'q1",
        ),
        (
            lambda text: re.sub(r"(q\d)", r"\1 [furlong]", text),
            "'q1 .furlong.', whose unit is not known",
        ),
        (
            lambda text: text.replace("q2", "q4"),
            "have the numbers 1, 4; they must begin",
        ),
        (replaced(9, "$", ",1,2"), "line 9 has 7 columns, but there are 5 names; remove the line"),
        (lambda text: text.replace("\n", ",7\n").replace(",7", "", 1), "line 2 has 6 numbers, but"),
        (
            replaced(9, ",.*", ",broken,1,1,1"),
            "column 'q1' holds 'broken' in line 9, which",
        ),
        (lambda text: re.sub(r",[^,]*$", ",", text, flags=re.M), "column 'u2'"),
        (
            lambda text: re.sub(r"^[\d.e-]+", "0.1", text, flags=re.M),
            "have the time of the",
        ),
        (lambda text: "\0\1" + text, "is not text; state file.format"),
        (lambda text: "\n".join(text.splitlines()[:4]), "5 samples without a gap|needs at least 5"),
    ],
)
def test_wrong_logs_are_refused_in_one_line(tmp_path, harm, message):
    log = write_csv(tmp_path / "log.csv", generic())
    log.write_text(harm(log.read_text()))
    with pytest.raises(InputError, match=message) as caught:
        imported(log, GENERIC)
    assert "\n" not in str(caught.value) and "log.csv" in str(caught.value)


def test_neither_torque_nor_current(tmp_path):
    log = write_csv(tmp_path / "log.csv", generic())
    with pytest.raises(InputError, match="has neither torque nor current; name the columns"):
        imported(log, {key: value for key, value in GENERIC.items() if key != "torque"})


# data frames


def test_data_frames_are_described_by_the_same_maps(tmp_path):
    """A map as a dictionary or a file; the times may be the index, as dates."""
    frame = pd.DataFrame(generic())
    recording = Recording.from_dataframe(frame, GENERIC)
    check(recording, exact=True)
    times = pd.date_range("2026-03-01", periods=COUNT, freq="4ms", name="t")
    dated = frame.drop(columns="t").set_index(times)
    check(Recording.from_dataframe(dated, GENERIC, source="mine"), exact=True)
    text = "\n".join(
        [
            'side = "joint"\ntime = {column = "t", unit = "s"}',
            'position = {columns = "q{axis}", unit = "rad"}',
            'torque = {columns = "u{axis}", unit = "Nm"}',
        ]
    )
    (tmp_path / "columns.toml").write_text(text)
    check(Recording.from_dataframe(frame, tmp_path / "columns.toml"), exact=True)
    named = {f"position_{k + 1}": in_degrees(RUN.position[:, k]) for k in range(AXES)}
    named |= {f"torque_{k + 1}": RUN.torque[:, k] for k in range(AXES)}
    abb = pd.DataFrame({"time": 1e3 * RUN.time} | named)
    check(Recording.from_dataframe(abb, {"preset": "abb"}))
    with pytest.raises(InputError, match=r"^mine: no column 'q\{axis\}' for \[position\]"):
        Recording.from_dataframe(abb, GENERIC, source="mine")


# the command


MAP = """
[axes]
gear_ratio = [100, -80]
"""


def test_the_command_writes_a_recording_and_a_picture(tmp_path):
    write_trace(tmp_path, 1)
    write_trace(tmp_path, 2)
    (tmp_path / "mine.toml").write_text(MAP)
    options = ["--preset", "kuka", "--map", "mine.toml", "-o", "out/arm.h5", "--figure"]
    done = faultgen("import", "run_NextGenDrive#1.dat", *options, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[0].split() == ["quantity", "axis", "column", "unit", "factor", "from", "to", "in"]
    (row,) = [line for line in lines if line.startswith("joint_torque") and "#2" in line]
    assert row.split()[1:5] == ["2", "Istmoment#2", "Nm", "-80"]
    assert any(
        "300 samples of 2 axes, joint side, every 0.004 s (250 Hz)" in line
        and line.endswith("no gaps; 1 segment")
        for line in lines
    )
    check(read_recording(tmp_path / "out" / "arm.h5"))
    assert (tmp_path / "out" / "arm.png").read_bytes().startswith(b"\x89PNG")
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"arm.h5", "arm.png"}


def test_the_command_refuses_and_leaves_nothing(tmp_path):
    """One line, exit status 2, and neither file is there."""
    log = write_csv(tmp_path / "log.csv", generic())
    for arguments, message in (
        ([log], "give --map FILE"),
        ([], "give the log"),
        ([log, "--preset", "nope"], "preset 'nope': unknown; there are abb, abb_egm, dvrk"),
        ([tmp_path / "no.csv", "--preset", "abb"], "no such file"),
        ([tmp_path, "--preset", "abb"], "is a folder"),
        ([log, "--preset", "abb", "-o", "measured.csv"], "give a name that ends with .h5"),
        (["--show-preset", "x"], "preset 'x': unknown"),
    ):
        with pytest.raises(InputError, match=message):
            app(["import", *map(str, arguments)], standalone_mode=False)
    done = faultgen("import", log, "--preset", "abb", cwd=tmp_path)
    assert done.returncode == 2
    assert "no column 'position_{axis}' for [position]; the log has 5 columns" in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert {path.name for path in tmp_path.iterdir()} == {"log.csv"}


def test_a_preset_that_is_printed_is_a_map(tmp_path, capsys):
    """It can be edited and given as --map."""
    app(["import", "--show-preset", "ur_rtde"], standalone_mode=False)
    path = tmp_path / "columns.toml"
    path.write_text(capsys.readouterr().out)
    assert load_map(path) == load_map(None, "ur_rtde")


def test_the_example_of_the_docs(tmp_path):
    """The log, the map, the command and the table in docs/importing.md are as they are there."""
    text = (ROOT / "docs" / "importing.md").read_text()
    makes_log, uses_frame = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    (content,) = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    (printed,) = re.findall(r"```text\n(.*?)```", text, re.DOTALL)
    (command,) = re.findall(r"^    faultgen (import cell7.*)$", text, re.MULTILINE)
    (tmp_path / "cell7.toml").write_text(content)
    python = [sys.executable, "-W", "error", "-c"]
    subprocess.run([*python, makes_log], cwd=tmp_path, check=True)
    for line in (tmp_path / "cell7.txt").read_text(encoding="cp1252").splitlines()[:4]:
        assert f"\n    {line}\n" in text
    done = faultgen(*command.split(), cwd=tmp_path)
    assert done.stdout == printed
    made = subprocess.run(
        [*python, uses_frame], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert made.stdout == "(940, 2) (0, 500)\n"
    one, other = (read_recording(tmp_path / name) for name in ("cell7.h5", "cell7_again.h5"))
    np.testing.assert_array_equal(one.torque, other.torque)
    time = np.delete(np.arange(1000) * PERIOD, slice(500, 560))
    wanted = np.radians([30, -45]) * np.stack([np.sin(2 * time), np.cos(3 * time)], axis=1)
    np.testing.assert_allclose(one.position, wanted, atol=1e-5)
    wanted = 101 * 0.31 * (0.02 + 3.8 * np.cos(2 * time))
    np.testing.assert_allclose(one.torque[:, 0], wanted, atol=5e-3)


# real logs


REAL = {
    "gen3/RunTrajectory1.csv.gz": {
        "time": {"column": "Time", "unit": "ms"},
        "position": {"columns": "Position{axis}", "unit": "rad"},
        "torque": {"columns": "TorqueCur{axis}", "unit": "Nm"},
        "temperature": {"columns": "Temp{axis}", "unit": "degC"},
    },
    "emps/emps_identification.csv": {
        "time": {"column": "t_s", "unit": "s"},
        "position": {"columns": ["q_m"], "unit": "m"},
        "torque": {"columns": ["motor_force_N"], "unit": "N"},
        "reference_position": {"columns": ["q_ref_m"], "unit": "m"},
    },
    "bam_xl330/xl330_kp100_sin_sin.csv": {
        "time": {"column": "t_s", "unit": "s"},
        "position": {"columns": ["q_rad"], "unit": "rad"},
        "torque": {"columns": ["pwm_duty"], "unit": "%", "rated": 100.0},
        "temperature": {"columns": "temp_C", "unit": "degC"},
    },
    "ur10e/train_40s_feb12.npz": {
        "time": {"column": "t", "unit": "s"},
        "position": {"columns": "q_{axis}", "unit": "rad"},
        "current": {"columns": "i_{axis}", "unit": "A"},
    },
}


@pytest.mark.parametrize(
    ("name", "axes", "rate", "seconds"),
    [
        ("gen3/RunTrajectory1.csv.gz", 7, 1000, 1.94),
        ("emps/emps_identification.csv", 1, 1000, 24.84),
        ("bam_xl330/xl330_kp100_sin_sin.csv", 1, 189, 6.0),
        ("ur10e/train_40s_feb12.npz", 6, 94.3, 49.4),
    ],
)
def test_public_logs_of_real_machines(name, axes, rate, seconds):
    """Their originals are read as they are; rates and lengths are those that their READMEs give."""
    if not DATA.is_dir():
        pytest.skip("the public recordings are not here")
    recording = imported(DATA / name, {"side": "joint", **REAL[name]}).recording
    assert recording.n_axes == axes
    assert 1 / recording.sample_period == pytest.approx(rate, rel=2e-3)
    assert len(recording.position) * recording.sample_period == pytest.approx(seconds, rel=0.01)
    if not name.startswith("ur10e"):
        raw = pd.read_csv(DATA / name)
        first = REAL[name]["position"]["columns"]
        column = first[0] if isinstance(first, list) else first.format(axis=1)
        lowest, highest = raw[column].min(), raw[column].max()
        assert recording.position[:, 0].min() == pytest.approx(lowest, abs=1e-3)
        assert recording.position[:, 0].max() == pytest.approx(highest, abs=1e-3)

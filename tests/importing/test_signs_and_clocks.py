"""Logs of other people: words with a sign, several clocks, several publishers, structured text."""

import json
from dataclasses import replace

import numpy as np
import pytest

from faultgen.discovery import check_recording
from faultgen.errors import InputError
from faultgen.importing import map_of
from faultgen.recordings.import_log import import_log
from faultgen.recordings.torque_doubts import torque_doubts, weight_share
from faultgen.simulation.arm import Arm

TIME = 0.01 * np.arange(600)
POSITION = np.stack([0.4 * np.sin(2 * TIME), 0.3 * np.cos(3 * TIME)], axis=1)


def map_with(**entries):
    """A map of two axes with currents in counts."""
    return map_of(
        {
            "side": "joint",
            "time": {"column": "time", "unit": "s"},
            "axes": {"torque_constant": 1.0},
            "position": {"columns": "q_{axis}", "unit": "rad"},
            "current": {"columns": "i_{axis}", "unit": 1.0, **entries},
        }
    )


def counts(amplitude):
    """True currents of both axes."""
    waves = np.stack([np.cos(2 * TIME), -0.8 * np.sin(3 * TIME)], axis=1)
    return np.round(amplitude * waves)


def log_of(path, words):
    rows = np.column_stack([TIME, POSITION, words])
    np.savetxt(path, rows, "%.10g", ",", header="time,q_1,q_2,i_1,i_2", comments="")
    return path


@pytest.mark.parametrize(
    ("bits", "amplitude"), [(8, 20), (8, 100), (12, 300), (16, 6), (16, 9000), (32, 70_000)]
)
def test_negative_words_are_decoded(tmp_path, bits, amplitude):
    """65535 is -1 in 16 bits, and likewise in words of other lengths; a note says so."""
    true = counts(amplitude)
    made = import_log(log_of(tmp_path / "log.csv", true % 2**bits), map_with())
    np.testing.assert_allclose(made.recording.torque, true)
    assert sum(f"words of {bits} bits: {2**bits - 1} is -1" in note for note in made.notes) == 2


@pytest.mark.parametrize("bit", [7, 10, 15])
def test_a_sign_bit_is_decoded(tmp_path, bit):
    """In sign and magnitude, 2 to the power of the sign bit + n is -n."""
    true = counts(0.3 * 2**bit)
    words = np.abs(true) + 2**bit * (true < 0)
    made = import_log(log_of(tmp_path / "log.csv", words), map_with())
    np.testing.assert_allclose(made.recording.torque, true)
    assert sum(f"sign bit {bit}:" in note for note in made.notes) == 2


def test_a_map_may_state_how_the_sign_is_written(tmp_path):
    """Also where the numbers do not show it, and that they are what they are."""
    noise = np.random.default_rng(0).integers(-30_000, 30_000, (600, 2)).astype(float)
    log = log_of(tmp_path / "log.csv", noise % 2**16)
    np.testing.assert_allclose(import_log(log, map_with(bits=16)).recording.torque, noise)
    log = log_of(tmp_path / "log.csv", np.abs(noise) + 2**15 * (noise < 0))
    np.testing.assert_allclose(import_log(log, map_with(sign_bit=15)).recording.torque, noise)
    words = counts(6) % 2**16
    plain = map_of({**map_with(bits=0).model_dump(exclude_none=True), "file": {"missing": []}})
    log = log_of(tmp_path / "log.csv", words)
    np.testing.assert_allclose(import_log(log, plain).recording.torque, words)
    with pytest.raises(InputError, match="current: give bits or sign_bit, not both"):
        map_with(bits=16, sign_bit=10)


def test_numbers_that_only_pass_a_power_of_two_are_left_alone(tmp_path):
    """Smooth numbers without a sign, a switch between two of them, and large steps."""
    smooth = 1024 + counts(900)
    steps = np.where(np.sin(9 * TIME) > 0, 1500.0, 200.0)[:, None] * [1, 1]
    for words in (smooth, steps, np.abs(counts(300))):
        made = import_log(log_of(tmp_path / "log.csv", words), map_with())
        np.testing.assert_allclose(made.recording.torque, words)
        assert not any("negative" in note for note in made.notes)


def test_an_axis_that_is_always_negative_is_decoded_like_the_others(tmp_path):
    true = counts(50)
    true[:, 1] = -20 - np.abs(true[:, 1])
    made = import_log(log_of(tmp_path / "log.csv", true % 2**16), map_with())
    np.testing.assert_allclose(made.recording.torque, true)


CLOCKS = {
    "side": "joint",
    "time": {"column": "t_pos", "unit": "ms"},
    "position": {"columns": ["pos"], "unit": "rad"},
    "torque": {"columns": ["trq"], "unit": "Nm"},
}


def two_clocks(path):
    """Position every 10 ms; torque from 0.3 s on, every 15 ms."""
    rows = ["t_pos;pos;t_trq;trq"]
    for k in range(600):
        t, late = 0.01 * k, 0.3 + 0.015 * k
        torque = f"{1000 * late:.0f};{2 * np.cos(2 * late):.6f}" if late <= 6 else ";"
        rows.append(f"{1000 * t:.0f};{0.4 * np.sin(2 * t):.6f};{torque}")
    path.write_text("\n".join(rows) + "\n")
    return path


def test_a_channel_with_a_clock_of_its_own_is_interpolated(tmp_path):
    """The torque is 2 cos(2 t) at the times of the position, as far as both were recorded."""
    log = two_clocks(tmp_path / "log.csv")
    column_map = map_of({**CLOCKS, "time": {**CLOCKS["time"], "columns": {"torque": "t_trq"}}})
    made = import_log(log, column_map).recording
    time = 0.3 + 0.01 * np.arange(570)
    assert made.sample_period == pytest.approx(0.01)
    np.testing.assert_allclose(made.position[:, 0], 0.4 * np.sin(2 * time), atol=1e-5)
    # an error of linear interpolation is at most h^2 / 8 times the second derivative
    np.testing.assert_allclose(made.torque[:, 0], 2 * np.cos(2 * time), atol=0.015**2 / 8 * 8.1)


def test_several_clocks_are_refused_until_the_map_names_them(tmp_path):
    log = two_clocks(tmp_path / "log.csv")
    with pytest.raises(
        InputError, match="the times 't_pos' and 't_trq', which differ.*time.columns"
    ):
        import_log(log, map_of(CLOCKS))
    stated = map_of({**CLOCKS, "time": {**CLOCKS["time"], "columns": {}}})
    assert import_log(log, stated).recording.n_axes == 1
    with pytest.raises(InputError, match="no column 't_torque' for .time.columns."):
        wrong = {**CLOCKS["time"], "columns": {"torque": "t_torque"}}
        import_log(log, map_of({**CLOCKS, "time": wrong}))
    with pytest.raises(InputError, match="time.columns: also give time.column"):
        map_of({**CLOCKS, "time": {"sample_period": 0.01, "columns": {"torque": "t_trq"}}})


@pytest.mark.parametrize("second", [lambda t: t, lambda t: t / 1000, lambda t: 1.7e12 + t])
def test_one_clock_may_be_written_twice(tmp_path, second):
    """The same times again, in another unit, or counted from another moment."""
    time = 10.0 * np.arange(100)
    rows = np.column_stack([time, np.sin(time / 500), second(time), np.cos(time / 500)])
    log = tmp_path / "log.csv"
    np.savetxt(log, rows, "%.10f", ";", header="t_pos;pos;t_trq;trq", comments="")
    assert len(import_log(log, map_of(CLOCKS)).recording.torque) == 100


PLAIN = {
    "side": "joint",
    "time": {"column": "time", "unit": "s"},
    "position": {"columns": "q_{axis}", "unit": "rad"},
    "torque": {"columns": "tau_{axis}", "unit": "Nm"},
}
TORQUE = np.stack([np.cos(2 * TIME), 3 + np.sin(5 * TIME)], axis=1)


def records():
    for k in range(len(TIME)):
        yield {"time": TIME[k], "q": POSITION[k].tolist(), "tau": TORQUE[k].tolist()}


def as_cells(separator, between):
    rows = [separator.join(["time", "q", "tau"])]
    for one in records():
        lists = [f"[{between.join(map(repr, one[name]))}]" for name in ("q", "tau")]
        if separator in between:
            lists = [f'"{text}"' for text in lists]
        rows.append(separator.join([repr(float(one["time"])), *lists]))
    return "\n".join(rows)


def as_columns():
    named = {"time": TIME.tolist(), "q": POSITION.tolist(), "tau": TORQUE.tolist()}
    return json.dumps({"robot": "arm", "log": named})


@pytest.mark.parametrize(
    "text",
    [
        "\n".join(map(json.dumps, records())),
        json.dumps(list(records()), indent=1),
        json.dumps({"samples": list(records())}),
        as_columns(),
        as_cells(",", ", "),
        as_cells(",", " "),
        as_cells(";", ","),
    ],
    ids=["lines", "list", "within", "columns", "commas", "blanks", "semicolons"],
)
def test_structured_text_is_read(tmp_path, text):
    """JSON in lines, in one list or in columns, and tables whose cells hold lists."""
    log = tmp_path / "log.txt"
    log.write_text(text)
    made = import_log(log, map_of(PLAIN)).recording
    np.testing.assert_allclose(made.position, POSITION)
    np.testing.assert_allclose(made.torque, TORQUE)


@pytest.mark.parametrize("around", [("", ""), ('<?xml version="1.0"?>\n<Log>', "</Log>")])
def test_xml_is_read(tmp_path, around):
    """One element for each sample, with numbers as attributes and as text."""
    rows = [
        f'<Rob Type="X"><Pos A1="{q[0]!r}" A2="{q[1]!r}"/><Tau A1="{m[0]!r}" A2="{m[1]!r}"/>'
        f"<IPOC>{4000 + 10 * k}</IPOC></Rob>"
        for k, (q, m) in enumerate(zip(POSITION.tolist(), TORQUE.tolist(), strict=True))
    ]
    log = tmp_path / "rsi.xml"
    log.write_text(around[0] + "\n".join(rows) + around[1])
    column_map = map_of(
        {
            "side": "joint",
            "time": {"column": "IPOC", "unit": "ms"},
            "position": {"columns": "Pos.A{axis}", "unit": "rad"},
            "torque": {"columns": "Tau.A{axis}", "unit": "Nm"},
        }
    )
    made = import_log(log, column_map).recording
    np.testing.assert_allclose(made.position, POSITION)
    np.testing.assert_allclose(made.torque, TORQUE)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<Rob><A/></Rob>\n<Rob><A></Rob>", "XML that is not well formed in line 2"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>', "DOCTYPE"),
        ("<Rob>1</Rob>", "XML without records"),
        ('{"a": 1}\n{"a": 2', "line 2 is not JSON"),
        ('{"a": 1}', "JSON without records"),
        ('{"time": 1e999, "q": [1, 2], "tau": [1, 2]}\n' * 9, "blank in 9 of 9 rows"),
        ("[" * 100_000, "nested too deeply"),
        ("t;q;tau\n0;[1, 2];[1]\n1;[1, 2, 3];[1]\n", "line 3 has lists of other lengths"),
    ],
)
def test_damaged_structured_text_is_refused_in_one_line(tmp_path, text, message):
    log = tmp_path / "log.txt"
    log.write_text(text)
    with pytest.raises(InputError, match=message) as error:
        import_log(log, map_of(PLAIN))
    assert "\n" not in str(error.value)


def bag_of(folder, messages):
    """A bag of messages: received [ns], stamp [ns], names, positions, efforts."""
    pytest.importorskip("rosbags", reason="the package rosbags (extra ros2) is not installed")
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kinds = ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    state, header, time = (store.types[kind] for kind in kinds)
    with Writer(folder, version=9) as writer:
        link = writer.add_connection("/joint_states", kinds[0], typestore=store)
        for received, stamp, names, *values in messages:
            at = header(time(stamp // 10**9, stamp % 10**9), "")
            position, effort = (np.array(one, float) for one in values)
            one = state(at, list(names), position, np.zeros(0), effort)
            writer.write(link, received, store.serialize_cdr(one, kinds[0]))
    return folder


START = 1_700_000_000 * 10**9


def states():
    """Messages of the robot itself."""
    for k in range(len(TIME)):
        at = START + 10_000_000 * k
        yield at, at, "ab", POSITION[k], TORQUE[k]


@pytest.mark.parametrize("names", ["ab", "ba"])
@pytest.mark.parametrize("every", [1, 3, 40])
def test_zeros_of_another_publisher_are_no_samples(tmp_path, names, every):
    """Messages of another program that says 0 for all joints are left out, however many."""
    zeros = [
        (at + 3_000_000, at + 3_000_000, names, [0, 0], [0, 0])
        for at, *_ in list(states())[::every]
    ]
    bag = bag_of(tmp_path / "bag", [*states(), *zeros])
    made = import_log(bag, map_of({}, "ros2"))
    np.testing.assert_allclose(made.recording.position, POSITION, atol=1e-12)
    np.testing.assert_allclose(made.recording.torque, TORQUE, atol=1e-12)
    assert any("left out" in note for note in made.notes)


def test_messages_without_effort_are_left_out(tmp_path):
    others = [(at + 3_000_000, at + 3_000_000, "ba", [0, 0], []) for at, *_ in states()][::3]
    made = import_log(bag_of(tmp_path / "bag", [*states(), *others]), map_of({}, "ros2"))
    np.testing.assert_allclose(made.recording.torque, TORQUE, atol=1e-12)
    assert "200 of 800 messages have no effort, and were left out" in made.notes


@pytest.mark.parametrize("stamp", [0, 5_000_000_000])
def test_times_of_receipt_replace_stamps_that_are_none(tmp_path, stamp):
    """Some drivers leave the stamp of the header at 0, or at the time of their start."""
    bag = bag_of(tmp_path / "bag", [(at, stamp, *rest) for at, _, *rest in states()])
    made = import_log(bag, map_of({}, "ros2"))
    assert made.recording.sample_period == pytest.approx(0.01)
    np.testing.assert_allclose(made.recording.position, POSITION, atol=1e-12)
    assert any("the times of receipt are used" in note for note in made.notes)


def test_times_of_receipt_may_be_asked_for(tmp_path):
    """The column `received` has them."""
    bag = bag_of(tmp_path / "bag", [(at, 2 * at - START, *rest) for at, _, *rest in states()])
    period = import_log(bag, map_of({}, "ros2")).recording.sample_period
    assert period == pytest.approx(0.02)
    asked = map_of({"time": {"column": "received", "unit": "ns"}}, "ros2")
    assert import_log(bag, asked).recording.sample_period == pytest.approx(0.01)


def test_a_torque_that_is_a_position_is_told(measured, tiny_robot):
    """A copy, or a line in it, of the same or another axis."""
    recording = measured([], 1)
    assert torque_doubts(recording) == []
    torque = recording.torque.copy()
    torque[:, 1] = 0.02 * recording.position[:, 0] - 3
    wrong = replace(recording, torque=torque)
    assert torque_doubts(wrong) == [
        (2, "the torque is the position of axis 1 times 0.02: name the column of the torque", False)
    ]
    assert any(
        "is the position of axis 1" in str(one) for one in check_recording(wrong, tiny_robot)
    )


@pytest.mark.parametrize("held", [2, 4])
def test_a_torque_that_was_held_is_told(measured, held):
    """With the number of samples; a torque in coarse steps is another thing."""
    recording = measured([], 1)
    rows = np.arange(len(recording.torque)) // held * held
    told = torque_doubts(replace(recording, torque=recording.torque[rows]))
    assert [(axis, is_torque) for axis, _, is_torque in told] == [(1, True), (2, True)]
    assert all(f"is held for {held} samples" in text for _, text, _ in told)
    assert torque_doubts(replace(recording, torque=np.round(recording.torque, 2))) == []


def gravity_of(recording, robot):
    """Torque that holds the arm, motor side."""
    joint = recording.joint_position(robot)
    still = np.zeros_like(joint)
    return Arm(robot).inverse_dynamics(joint, still, still) / robot.gear_ratio


def test_a_torque_without_the_weight_of_the_arm_is_told(measured, tiny_robot):
    """Axis 1 is vertical and never accused; axis 2 has no weight left, or half of it."""
    recording = measured([], 1)
    gravity = gravity_of(recording, tiny_robot)
    assert not gravity[:, 0].any() and gravity[:, 1].any()

    def told(share):
        part = replace(recording, torque=recording.torque - (1 - share) * gravity)
        return [str(one) for one in check_recording(part, tiny_robot) if "weight" in str(one)]

    (line,) = told(0.0)
    assert line.startswith("warn: the torque of axis 2 has no weight in it (share of the model's: ")
    assert "log the measured torque" in line and "a spring that the model lacks" in line
    for share in (0.5, 1.0, 1.5):  # a balancer, the arm, a heavier one
        assert told(share) == []


def test_the_share_of_the_weight_has_an_error():
    """It is found beside friction and inertia; an unknown offset hides a constant weight."""
    rng = np.random.default_rng(0)
    time = 0.01 * np.arange(2000)
    angle, speed = np.sin(time), np.cos(time)
    gravity, inertia = 5 * np.cos(angle), -0.3 * np.sin(time)
    for share in (0.0, 0.7, 1.0):
        torque = share * gravity + 1.2 * inertia + 0.8 * np.sign(speed) + rng.normal(0, 0.1, 2000)
        others = [inertia, np.sign(speed), speed]
        found, error = weight_share(torque, gravity, others, 0.01)
        assert abs(found - share) < 4 * error < 0.1
    constant = np.full(2000, 5.0)
    _, error = weight_share(torque, constant, others, 2.5)
    assert error > 0.4
    assert weight_share(torque, 0 * gravity, others, 0.01)[1] == np.inf

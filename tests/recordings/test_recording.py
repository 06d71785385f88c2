"""Measured files: what is read and refused, and what a check makes of wrong units and signs."""

import re
from copy import copy
from dataclasses import replace

import h5py
import numpy as np
import pytest

from faultgen.discovery import Recording, check_recording, read_recording, write_recording
from faultgen.discovery.accept import accepted
from faultgen.discovery.inputs import read_together
from faultgen.discovery.replay.samples import counted
from faultgen.errors import InputError
from faultgen.robot import COULOMB, STICTION
from faultgen.simulation.motion import plan
from faultgen.simulation.servo import control_signal
from faultgen.simulation.stepping import simulate
from faultgen.tasks import load_task

PERIOD = 0.004


@pytest.fixture(scope="module")
def recording(tiny_robot, tiny_task_path):
    """Three cycles of the small robot, motor side, with 1 % of torque noise."""
    motion = plan(load_task("tiny", tiny_task_path), tiny_robot)
    control = control_signal(motion, tiny_robot.model.opt.timestep)
    models = [tiny_robot.model] * 3
    cycles = list(simulate(tiny_robot, control, models, sample_period=PERIOD))

    def joined(name):
        return np.vstack([getattr(cycle, name) for cycle in cycles])

    torque = joined("motor_torque")
    noise = np.random.default_rng(0).standard_normal(torque.shape)
    times = np.arange(len(torque)) * PERIOD % motion.period
    return Recording(
        source="simulated",
        robot="tiny",
        side="motor",
        sample_period=PERIOD,
        position=joined("motor_position"),
        velocity=joined("motor_velocity"),
        torque=torque + 0.01 * np.abs(torque).mean(axis=0) * noise,
        reference_position=motion(times)[0],
    )


def joint_side(recording, robot):
    return replace(
        recording,
        side="joint",
        position=recording.position / robot.gear_ratio,
        velocity=recording.velocity / robot.gear_ratio,
        torque=recording.torque * robot.gear_ratio,
    )


def test_a_good_recording_passes(recording, tiny_robot):
    """No finding, on either side, with or without the optional channels."""
    assert check_recording(recording, tiny_robot) == []
    assert check_recording(joint_side(recording, tiny_robot), tiny_robot) == []
    bare = replace(recording, velocity=None, reference_position=None, robot="")
    assert check_recording(bare, tiny_robot) == []


def changed(recording, name, axis, change):
    values = getattr(recording, name).copy()
    values[:, axis] = change(values[:, axis])
    return replace(recording, **{name: values})


def late(x, samples):
    return np.concatenate([np.full(samples, x[0]), x[:-samples]])


def jump(x):
    return np.where(np.arange(len(x)) >= 200, x + 40.0, x)


def stuck(x):
    out = x.copy()
    out[100:250] = out[100]
    return out


@pytest.mark.parametrize(
    ("name", "change", "level", "message"),
    [
        ("torque", lambda x: -x, "corrected", "opposite sign .* multiplied by -1"),
        ("torque", lambda x: 50 * x, "corrected", "is that of the joint.* divided by 50"),
        ("torque", lambda x: 1000 * x, "corrected", "thousandths of its unit.* divided by 1000"),
        ("torque", lambda x: 7 * x, "warn", "seems to be .* times what the model needs"),
        ("torque", lambda x: late(x, 9), "warn", r"torque is 9 samples \(36 ms\) late"),
        ("torque", np.random.default_rng(1).permutation, "left out", "free parameters .* 100 %"),
        ("torque", lambda x: np.full_like(x, 0.3), "left out", "never changes"),
        ("velocity", lambda x: -x, "corrected", "velocity has the opposite sign.* by -1"),
        ("velocity", lambda x: x / 50, "corrected", "velocity is 0.02 times .* multiplied by 50"),
        ("velocity", np.random.default_rng(1).permutation, "corrected", "no velocity is used"),
        ("velocity", lambda x: late(x, 4), "warn", "velocity is 4 samples late"),
        ("position", lambda x: np.degrees(x), "corrected", "are in degrees"),
        ("position", lambda x: 50 * x, "corrected", "multiplied by the gear ratio"),
        ("position", jump, "corrected", "jumps by .* at sample 200.* a new segment begins"),
        ("position", stuck, "corrected", "jumps by"),
    ],
)
def test_what_is_wrong_is_named(recording, tiny_robot, name, change, level, message):
    """One wrong channel of axis 2 gives findings of axis 2 alone, and the first says what it is."""
    findings = check_recording(changed(recording, name, 1, change), tiny_robot)
    assert findings and {finding.axis for finding in findings} == {2}
    assert any(one.level == level and re.search(message, one.message) for one in findings), findings
    assert "\n" not in str(findings[0])


def test_much_more_friction_is_no_wrong_unit(recording, tiny_robot):
    """Assumed friction may be a fraction of the real one: nothing is doubtful then."""
    speed = recording.velocity[:, 1]
    rubs = changed(recording, "torque", 1, lambda x: x + 6 * x.std() * np.sign(speed))
    assert check_recording(rubs, tiny_robot) == []


@pytest.mark.parametrize("side", ["motor", "joint"])
@pytest.mark.parametrize(
    ("factors", "level"),
    [([-1, 1], "corrected"), ([1, 1000], "corrected"), ([-1, -1000], "corrected"), ([1, 1], "")],
)
def test_what_is_corrected_is_the_recording_again(recording, tiny_robot, side, factors, level):
    """Signs and units in any combination, on either side of the gearbox."""
    given = recording if side == "motor" else joint_side(recording, tiny_robot)
    wrong = replace(given, torque=given.torque * factors)
    (made,), (found,) = accepted([wrong], tiny_robot)
    np.testing.assert_allclose(made.torque, given.torque, rtol=1e-9)
    np.testing.assert_allclose(np.array(made.torque_factor) * factors, 1)
    assert {one.level for one in found} == ({level} if level else set())


def test_a_log_that_is_trusted_stays_as_it_is(recording, tiny_robot):
    wrong = replace(recording, torque=-1000 * recording.torque)
    (made,), (found,) = accepted([wrong], tiny_robot, trust_log=True)
    assert np.array_equal(made.torque, wrong.torque) and found == []


def test_every_finding_is_told_at_once(recording, tiny_robot, tmp_path):
    """Three faults of two axes; the axis without a torque is left out, and none is a dead end."""
    torque = recording.torque * [-1, 1]
    torque[:, 1] = 0.02 * recording.position[:, 0]
    wrong = replace(recording, torque=torque, velocity=recording.velocity * [1, -1])
    path = tmp_path / "wrong.h5"
    write_recording(wrong, path)
    given = read_together([path], tiny_robot)
    levels = [line.removeprefix(f"{path}: ").split(": ")[:2] for line in given.findings]
    assert levels == [["left out", "axis 2"], ["corrected", "axis 1"], ["corrected", "axis 2"]]
    assert set(given.findings) <= set(given.warnings)
    assert all("--trust-log" in line for line in given.findings)
    assert given.recording.left_out == (2,)
    assert given.recording.lost[:, 1].all() and not given.recording.lost[:, 0].any()
    inside = counted(given.recording, tiny_robot, baseline=False)
    assert inside[:, 0].any() and not inside[:, 1].any()


def test_without_any_torque_the_file_is_refused_in_one_line(recording, tiny_robot):
    nothing = replace(recording, torque=np.ones_like(recording.torque))
    with pytest.raises(InputError, match="no axis can be used: axis 1: .*axis 2: .*--trust-log"):
        accepted([nothing], tiny_robot)


def test_a_recording_that_cannot_tell_takes_the_sign_of_the_others(recording, tiny_robot):
    """A robot that stands still has the sensors that it has in motion."""
    wrong = replace(recording, torque=recording.torque * [-1, 1])
    still = {
        name: np.repeat(getattr(wrong, name)[:1], len(wrong.position), axis=0)
        for name in ("position", "velocity", "reference_position")
    }
    at_rest = replace(wrong, **still)
    alone, _ = accepted([at_rest], tiny_robot)
    together, _ = accepted([at_rest, wrong], tiny_robot)
    after, _ = accepted([at_rest], tiny_robot, known=together[1])
    assert alone[0].torque_factor == (1, 1)
    for one in (*together, *after):
        assert one.torque_factor == (-1, 1)


def test_wrong_masses_and_a_payload_off_its_centre_turn_no_sign(recording, tiny_robot):
    """The model has no friction, masses that are a third off, and its payload elsewhere."""
    spec = tiny_robot.spec()
    for name, factor in (("link1", 1.3), ("link2", 0.7)):
        spec.body(name).mass *= factor
    spec.body("payload").ipos = [-0.4, 0.1, 0.1]
    for axis in (1, 2):
        friction = spec.actuator(f"friction{axis}")
        friction.biasprm[COULOMB] = friction.biasprm[STICTION] = friction.damping[0] = 0.0
    spec.compile()
    other = tiny_robot.edited(spec)
    for sign in (1, -1):
        for axis in (0, 1):
            factors = np.ones(2)
            factors[axis] = sign
            (made,), _ = accepted([replace(recording, torque=recording.torque * factors)], other)
            assert made.torque_factor == tuple(factors)


def test_late_samples_are_no_gap(recording, tiny_robot):
    """A sample that repeats the last one, and a step that catches up, are told and accepted."""
    steps = np.abs(np.diff(recording.position[:, 1]))
    at = int(np.argmax(steps))
    slow = copy(tiny_robot)
    limit = 1.05 * steps[at] / recording.sample_period  # motor side, as the recording
    object.__setattr__(slow, "motor_velocity_limit", np.array([np.inf, limit]))

    def hold(x):
        out = x.copy()
        out[at] = out[at - 1]  # and from there two steps at once
        return out

    def lose(x):
        return np.concatenate([x[:at], x[at + 8 :], x[-1:].repeat(8)])

    for change, level in ((hold, "warn"), (lose, "corrected")):
        found = check_recording(changed(recording, "position", 1, change), slow)
        jumps = [one for one in found if "jumps by" in one.message]
        assert [(one.axis, one.level) for one in jumps] == [(2, level)], found


def test_axes_that_tell_nothing(recording, tiny_robot):
    """An axis that stands still, and a robot with another number of axes."""
    still = changed(recording, "position", 0, lambda x: np.full_like(x, x[0]))
    still = replace(still, velocity=None, reference_position=None)
    messages = [finding.message for finding in check_recording(still, tiny_robot)]
    assert any("does not move" in message for message in messages)
    one = replace(
        recording,
        position=recording.position[:, :1],
        torque=recording.torque[:, :1],
        velocity=None,
        reference_position=None,
    )
    (finding,) = check_recording(one, tiny_robot)
    assert finding.level == "refuse" and "1 axes, but tiny has 2" in finding.message
    (finding,) = check_recording(replace(recording, robot="other"), tiny_robot)
    assert finding.level == "warn" and "robot 'other'" in finding.message


def test_hdf5_written_and_read(recording, tmp_path):
    """Every field comes back."""
    path = tmp_path / "r.h5"
    full = replace(
        recording,
        temperature=np.linspace(30, 40, len(recording.torque)),
        segments=(0, 100),
        payload_mass=1.5,
    )
    write_recording(full, path)
    again = read_recording(path)
    for name in ("position", "torque", "velocity", "reference_position", "temperature"):
        np.testing.assert_array_equal(getattr(again, name), getattr(full, name))
    assert (again.segments, again.payload_mass, again.side) == ((0, 100), 1.5, "motor")
    assert again.robot == "tiny" and again.sample_period == PERIOD
    assert again.parts == [slice(0, 100), slice(100, len(full.torque))]


def csv(path, rows, header="time,segment,joint_position_1,joint_torque_1"):
    np.savetxt(path, rows, delimiter=",", header=header, comments="")
    return path


def test_csv_with_segments(tmp_path):
    """Columns by name; a new segment may begin at any time."""
    time = np.concatenate([np.arange(10) * 0.01, 5 + np.arange(8) * 0.01])
    segment = np.repeat([1, 2], [10, 8])
    rows = np.stack([time, segment, np.sin(time), np.cos(time)], axis=1)
    recording = read_recording(csv(tmp_path / "r.csv", rows))
    assert recording.side == "joint" and recording.segments == (0, 10)
    assert recording.sample_period == pytest.approx(0.01)
    np.testing.assert_allclose(recording.torque[:, 0], np.cos(time))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda f: f.__delitem__("motor_torque"), "has motor_position, but no motor_torque"),
        (lambda f: f.__delitem__("motor_position"), "needs motor_position or joint_position"),
        (lambda f: f.__setitem__("joint_position", np.zeros((9, 2))), "has both"),
        (lambda f: f.attrs.__delitem__("sample_period"), "sample_period must be a positive"),
        (lambda f: f.attrs.__setitem__("sample_period", -1.0), "sample_period must be a positive"),
        (lambda f: f.attrs.__setitem__("segments", [0, 10**9]), "segments must ascend from 0"),
        (lambda f: f.attrs.__setitem__("segments", [5]), "segments must ascend from 0"),
        (
            lambda f: f["motor_torque"].__setitem__((7, 1), np.nan),
            "torque is not finite in sample 7",
        ),
        (lambda f: f.__setitem__("temperature", np.zeros(3)), "temperature has shape"),
    ],
)
def test_bad_files_are_refused_in_one_line(recording, tmp_path, change, message):
    path = tmp_path / "bad.h5"
    write_recording(recording, path)
    with h5py.File(path, "r+") as file:
        change(file)
    with pytest.raises(InputError, match=message) as error:
        read_recording(path)
    assert "\n" not in str(error.value) and str(path) in str(error.value)


def _external_link(file, tmp_path):
    other = tmp_path / "other.h5"
    with h5py.File(other, "w") as out:
        out["motor_torque"] = np.zeros(file["motor_torque"].shape)
    del file["motor_torque"]
    file["motor_torque"] = h5py.ExternalLink(str(other), "/motor_torque")


def _soft_link_out(file, tmp_path):
    file["far"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "/")
    del file["motor_torque"]
    file["motor_torque"] = h5py.SoftLink("/far/motor_torque")


def _circle(file, tmp_path):
    del file["motor_torque"]
    file["motor_torque"] = h5py.SoftLink("/again")
    file["again"] = h5py.SoftLink("/motor_torque")


def _external_storage(file, tmp_path):
    shape = file["motor_torque"].shape
    (tmp_path / "raw").write_bytes(bytes(8 * shape[0] * shape[1]))
    del file["motor_torque"]
    file.create_dataset("motor_torque", shape, float, external=[(str(tmp_path / "raw"), 0, 2**40)])


def _virtual(file, tmp_path):
    shape = file["motor_torque"].shape
    del file["motor_torque"]
    layout = h5py.VirtualLayout(shape, float)
    layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "motor_torque", shape)
    file.create_virtual_dataset("motor_torque", layout)


def _claims(shape, chunks):
    def change(file, tmp_path):
        del file["motor_torque"]
        file.create_dataset("motor_torque", shape, float, chunks=chunks, maxshape=(None, None))

    return change


def _set(name, value):
    def change(file, tmp_path):
        del file[name]
        file[name] = value

    return change


def _attribute(name, value):
    return lambda file, tmp_path: file.attrs.__setitem__(name, value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (_attribute("sample_period", "4 ms"), "sample_period must be a positive time in s"),
        (_attribute("sample_period", [0.004, 0.004]), "sample_period must be a positive"),
        (_attribute("sample_period", 1e12), "sample_period .* from 1e-05 to 1, not 1000000000000"),
        (_attribute("sample_period", np.nan), "sample_period must be a positive"),
        (_attribute("sample_period", True), "sample_period must be a positive"),
        (_attribute("sample_period", h5py.Empty("f")), "attribute sample_period is empty"),
        (_attribute("segments", []), "segments must ascend from 0"),
        (_attribute("segments", [0, np.nan]), "segments must ascend from 0"),
        (_attribute("segments", [[0, 100]]), "segments must ascend from 0"),
        (_attribute("segments", "0"), "segments must ascend from 0"),
        (_attribute("segments", [0, 100.5]), "segments must ascend from 0"),
        (_attribute("segments", [0, 1, 100]), "from sample 0 has 1 samples; it needs at least 5"),
        (_attribute("payload_mass", "heavy"), "payload_mass must be one number in kg"),
        (_attribute("payload_mass", -1.0), "payload_mass must be one number in kg"),
        (_attribute("robot", [1, 2]), "robot must be a name"),
        (_attribute("robot", "a\nb"), "robot must be a name"),
        (_set("motor_torque", h5py.Empty("f")), "motor_torque is empty"),
        (_set("motor_torque", "text"), "motor_torque must hold numbers"),
        (_set("motor_torque", np.full((3, 2), 1e300)), "expected"),
        (
            lambda f, _: f["motor_torque"].__setitem__((3, 0), 1e300),
            "torque is larger than 1e\\+09 in sample 3",
        ),
        (_claims((10**9, 10**6), (1000, 2)), "claims shape .* more than 100,000,000 values"),
        (_claims((100, 2), (10**8, 3)), "claims shape"),
        (_claims((1000, 2), (1000, 2)), "no values were written"),
        (_external_link, "link to another file; copy its data"),
        (_soft_link_out, "link to another file; copy its data"),
        (_circle, "leads in a circle"),
        (_external_storage, "data of motor_torque are in other files"),
        (_virtual, "data of motor_torque are in other files"),
        (lambda f, _: f.create_group("motor_velocity"), "motor_velocity is not an array"),
    ],
)
def test_what_a_file_claims_is_checked_before_it_is_read(recording, tmp_path, change, message):
    path = tmp_path / "bad.h5"
    write_recording(replace(recording, velocity=None), path)
    with h5py.File(path, "r+") as file:
        change(file, tmp_path)
    with pytest.raises(InputError, match=message) as error:
        read_recording(path)
    text = str(error.value)
    assert "\n" not in text and text.startswith(str(path)) and len(text) < len(str(path)) + 300


def test_links_within_a_file_and_arrays_of_one_are_read(recording, tmp_path):
    """A soft link, a period in an array of one, as other programs write it, and foreign arrays."""
    path = tmp_path / "linked.h5"
    write_recording(recording, path)
    with h5py.File(path, "r+") as file:
        file.move("motor_torque", "raw/torque")
        file["alias"] = h5py.SoftLink("raw")
        file["motor_torque"] = h5py.SoftLink("alias/torque")
        file.attrs["sample_period"] = np.array([PERIOD])
        file.attrs["robot"] = np.bytes_(b"tiny")
        file["notes"] = "not of interest"
        file["elsewhere"] = h5py.ExternalLink("/nowhere.h5", "/x")
        del file.attrs["content_sha256"]  # as in a file of another program
    again = read_recording(path)
    np.testing.assert_array_equal(again.torque, recording.torque)
    assert (again.sample_period, again.robot) == (PERIOD, "tiny")


TABLE = "time,joint_position_1,joint_torque_1\n" + "\n".join(f"{k / 100},{k},1" for k in range(9))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (TABLE.encode("utf-16"), "perhaps UTF-16; save it as UTF-8"),
        (TABLE.encode("utf-16-le"), "perhaps UTF-16; save it as UTF-8"),
        (("Zeit,µ\n" + TABLE).encode("latin-1"), "row 1 is not UTF-8 text, perhaps Latin-1"),
        (TABLE.replace(",", ";").encode(), "separated by ';'; give names .* commas between"),
        (TABLE.replace("_1", "_0").encode(), "end in _0; number the axes from 1"),
        (TABLE.replace("joint_torque_1", "joint_torque_2").encode(), "end in _2; number the axes"),
        (TABLE.replace("4,1", "4,").encode(), "row 6 of column 'joint_torque_1' is blank; fill"),
        (TABLE.replace("4,1", '4,"1,5"').encode(), "row 6 of column .* holds '1,5'; write numbers"),
        (TABLE.replace("4,1", "4,inf").encode(), "row 6 of column 'joint_torque_1' holds 'inf'"),
        (TABLE.replace("4,1", "4,1,2").encode(), "header has 3 names, but not every row"),
        (TABLE.replace("joint_torque_1", "time").encode(), "column 'time' appears more than once"),
        (b"", "first row names no columns"),
        (b"time,joint_position_1,joint_torque_1\n", "header has 3 names|must have shape"),
    ],
)
def test_what_is_wrong_with_a_csv_file_is_named_with_what_would_do(tmp_path, content, message):
    path = tmp_path / "bad.csv"
    path.write_bytes(content)
    with pytest.raises(InputError, match=message) as error:
        read_recording(path)
    assert "\n" not in str(error.value)


def test_csv_as_spreadsheets_write_it(tmp_path):
    """A byte order mark, quoted names, blanks after commas, and columns in any order."""
    path = tmp_path / "r.CSV"
    rows = "\r\n".join(f"{k}, 1, {k / 100}, {-k}" for k in range(9))
    text = '"joint_position_1","joint_torque_1","time","joint_position_2",joint_torque_2\r\n'
    rows = "\r\n".join(f"{line}, 7" for line in rows.split("\r\n"))
    path.write_bytes(b"\xef\xbb\xbf" + (text + rows).encode())
    recording = read_recording(path)
    np.testing.assert_array_equal(recording.position[:, 1], -np.arange(9.0))
    np.testing.assert_array_equal(recording.torque, np.tile([1.0, 7.0], (9, 1)))


def test_bad_csv(tmp_path):
    """A missing column, words instead of numbers, no file."""
    rows = np.stack([np.arange(9) * 0.01, np.ones(9), np.zeros(9), np.zeros(9)], axis=1)
    message = "no column 'time'; it has 't', 'segment', 'joint_position_1', .*'faultgen import'"
    with pytest.raises(InputError, match=message):
        read_recording(csv(tmp_path / "t.csv", rows, "t,segment,joint_position_1,joint_torque_1"))
    with pytest.raises(
        InputError, match="'motor_position_1' or 'joint_position_1'; it has 'time', 'q"
    ):
        read_recording(csv(tmp_path / "q.csv", rows, "time,q1,q2,tau1"))
    (tmp_path / "w.csv").write_text("time,a\n0,x\n")
    with pytest.raises(InputError, match="not a table of numbers"):
        read_recording(tmp_path / "w.csv")
    with pytest.raises(InputError, match="no such file"):
        read_recording(tmp_path / "none.h5")
    with pytest.raises(InputError, match="is not a file"):
        read_recording(tmp_path)
    (tmp_path / "n.h5").write_text("not HDF5")
    with pytest.raises(InputError, match="is no recording"):
        read_recording(tmp_path / "n.h5")

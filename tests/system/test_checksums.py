"""Files that carry a checksum: no changed bit of them is used, and one line says what to do."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from faultgen.discovery import Recording, read_recording, write_recording
from faultgen.errors import InputError
from faultgen.monitoring.sensors import get_sensors
from faultgen.robot import load_robot
from faultgen.system.arrays import is_as_written
from faultgen.system.sealed_json import sealed, unsealed
from faultgen.system.sums import SUMS, add_sums
from faultgen.tasks import load_task

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples" / "twin"
CONTENT = {"count": 3, "mean": [0.25, -1e-3], "limits": {"rest": 2.5, "single": 1.0}, "odd": None}


@pytest.fixture
def recording(tmp_path):
    """A small recording, and the file that it was written to."""
    values = np.random.default_rng(0).normal(size=(2, 30, 2))
    one = Recording(
        source="small", robot="arm", side="joint", sample_period=0.01, position=values[0],
        torque=values[1].astype(np.float32), payload_mass=2.0,
    )  # fmt: skip
    path = tmp_path / "small.h5"
    write_recording(one, path)
    return one, path


def flipped(content, at, bit):
    """Bytes with one bit changed."""
    changed = bytearray(content)
    changed[at] ^= bit
    return bytes(changed)


def same(one, other):
    """Whether two recordings hold the same numbers and attributes."""
    arrays = ("position", "torque", "velocity", "reference_position", "temperature")
    plain = ("robot", "side", "sample_period", "segments", "payload_mass", "link", "current")
    return all(
        np.array_equal(getattr(one, name), getattr(other, name))
        for name in arrays
        if getattr(one, name) is not None or getattr(other, name) is not None
    ) and all(getattr(one, name) == getattr(other, name) for name in plain)


def trial(content, path, whole, places):
    """How many of the changed files were refused, and how many were read; none differs."""
    refused = 0
    for at, bit in places:
        path.write_bytes(flipped(content, at, bit))
        try:
            assert same(read_recording(path), whole), (at, bit)
        except InputError as error:
            assert str(path) in str(error) and "\n" not in str(error)
            refused += 1
    return refused


def test_no_changed_bit_of_an_example_is_used(tmp_path):
    """Of 100 random bits of a recording most are refused; what is read has the right numbers."""
    source = EXAMPLES / "new5.h5"
    content, whole = source.read_bytes(), read_recording(source)
    rng = np.random.default_rng(0)
    places = [(int(rng.integers(len(content))), 1 << int(rng.integers(8))) for _ in range(100)]
    places.append((49906, 2))  # this one changed a verdict
    assert trial(content, tmp_path / "flipped.h5", whole, places) > 90


@pytest.mark.slow
def test_no_bit_of_a_recording_can_change_unnoticed(recording, tmp_path):
    """Every single bit of a small recording."""
    _, path = recording
    content, whole = path.read_bytes(), read_recording(path)
    places = [(at, 1 << k) for at in range(len(content)) for k in range(8)]
    assert trial(content, tmp_path / "flipped.h5", whole, places) > len(places) / 4


def test_a_damaged_recording_says_what_to_do(recording):
    """The line names the file and the ways out, and one of them works."""
    _, path = recording
    with h5py.File(path, "r+") as file:
        file["joint_torque"][3, 1] = 7.5
    with pytest.raises(InputError, match=r"small.h5: damaged: .*copy, import or export it again"):
        read_recording(path)
    with h5py.File(path, "r+") as file:
        del file.attrs["content_sha256"]  # changed on purpose
    assert read_recording(path).torque[3, 1] == 7.5


def test_recordings_of_other_programs_need_no_checksum(recording, tmp_path):
    """A file without the attribute is read as before."""
    one, _ = recording
    path = tmp_path / "own.h5"
    with h5py.File(path, "w") as file:
        file.attrs["sample_period"] = 0.01
        file["joint_position"], file["joint_torque"] = one.position, one.torque
        assert is_as_written(file) is None
    np.testing.assert_array_equal(read_recording(path).torque, one.torque)


def test_the_shipped_recordings_carry_checksums():
    """Otherwise nothing could be compared."""
    files = sorted(EXAMPLES.glob("*.h5"))
    assert len(files) == 11
    for path in files:
        with h5py.File(path) as file:
            assert is_as_written(file) is True


def test_large_arrays_are_summed_up_in_parts(recording, tmp_path):
    """An array of several parts has the same checksum as one that is summed up at once."""
    one, _ = recording
    long = np.random.default_rng(1).normal(size=(700_000, 2))
    path = tmp_path / "long.h5"
    write_recording(replace(one, position=long, torque=long), path)
    np.testing.assert_array_equal(read_recording(path).torque, long)


def test_no_changed_bit_of_a_sealed_file_is_used():
    """Every bit: the content is refused, or the same."""
    text = sealed(CONTENT).encode()
    assert unsealed(text) == CONTENT
    refused = 0
    for at in range(len(text)):
        for k in range(8):
            changed = flipped(text, at, 1 << k)
            try:
                assert unsealed(changed) == CONTENT, changed
            except ValueError:
                refused += 1
    assert refused > 0.9 * 8 * len(text)
    for wrong in (json.dumps(CONTENT), "[1]"):
        with pytest.raises(ValueError, match="checksum|JSON object"):
            unsealed(wrong)


@pytest.fixture
def folder(tiny_robot, tmp_path):
    """A robot's folder with an own task, as twin, discover and calibrate write it."""
    replace(tiny_robot, tasks={"own": "# a task\n"}).write(tmp_path / "robot")
    return tmp_path / "robot"


@pytest.mark.parametrize("name", ["model.xml", "robot.json", "tasks/own.toml", SUMS])
def test_no_changed_bit_of_a_robot_is_used(folder, name):
    """Bits at random places of a file of the folder: one line refuses it, or nothing differs."""
    whole = load_robot(folder)
    path = folder / name
    content = path.read_bytes()
    rng = np.random.default_rng(3)
    refused = 0
    for _ in range(40):
        path.write_bytes(flipped(content, int(rng.integers(len(content))), 1 << rng.integers(8)))
        try:
            again = load_robot(folder)
            assert (again.sha256, again.name, again.tasks) == (
                whole.sha256,
                whole.name,
                whole.tasks,
            )
        except InputError as error:
            assert str(folder) in str(error) and "\n" not in str(error)
            refused += 1
    assert refused == 40 or name == SUMS and refused > 20


def test_files_changed_on_purpose_can_be_read(folder):
    """The line names the list; without the line of the file in it, the file is read."""
    path = folder / "model.xml"
    path.write_text(path.read_text().replace("</mujoco>", "<!-- mine --></mujoco>"))
    with pytest.raises(InputError, match=f"model.xml: damaged .*{SUMS}.*on purpose"):
        load_robot(folder)
    lines = (folder / SUMS).read_text().splitlines(keepends=True)
    (folder / SUMS).write_text("".join(line for line in lines if "model.xml" not in line))
    assert "mine" in load_robot(folder).xml
    (folder / SUMS).unlink()
    assert "mine" in load_robot(folder).xml


def test_checksums_of_other_programs_are_not_looked_at(folder):
    """Many downloads have a file of this name, with checksums of another kind."""
    for text in ("d41d8cd98f00b204e9800998ecf8427e  robot/model.xml\n", "MD5 of all files\n", ""):
        (folder.parent / SUMS).write_text(text)
        assert load_robot(folder).name == "tiny"
    (folder / SUMS).write_text((folder / SUMS).read_text() + "and more\n")
    with pytest.raises(InputError, match=f"{SUMS}: damaged .line 4 is no checksum"):
        load_robot(folder)


def test_a_robot_is_written_over_a_damaged_one(folder, tiny_robot):
    """Making the folder again restores it, and keeps the checksums of other files."""
    add_sums(folder, {"sensors.toml": b"x"})
    (folder / "model.xml").write_bytes(b"<mujoco/>")
    tiny_robot.write(folder)
    assert load_robot(folder).xml == tiny_robot.xml
    assert "sensors.toml" in (folder / SUMS).read_text()


def test_checksums_can_be_compared_with_the_usual_program(folder):
    """sha256sum -c reads the list."""
    program = shutil.which("sha256sum")
    if program is None:
        pytest.skip("there is no sha256sum")
    import subprocess

    done = subprocess.run([program, "-c", SUMS], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0 and done.stdout.count(": OK") == 3


def test_sensors_and_tasks_given_by_path_are_compared(folder, tiny_robot):
    """A listed file that has changed is refused, whatever it is."""
    for name, read in (
        ("sensors.toml", lambda path: get_sensors(str(path))),
        ("next.toml", lambda path: load_task(tiny_robot.name, str(path))),
    ):
        (folder / name).write_text("torque_noise = 0.02\n")
        add_sums(folder, {name: b"torque_noise = 0.01\n"})
        with pytest.raises(InputError, match=f"{name}: damaged"):
            read(folder / name)

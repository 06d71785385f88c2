"""From generated data to a detector, and its answers to recordings."""

import os
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
from conftest import faultgen_here
from recorded import record

from faultgen.dataset.experiment import make_experiment
from faultgen.dataset.reader import open_dataset
from faultgen.dataset.sweep import generate
from faultgen.errors import InputError
from faultgen.recordings.rates import slow
from faultgen.recordings.read import read_recording
from faultgen.recordings.recording import write_recording
from faultgen.system.dates import date_of
from faultgen.system.sealed_json import sealed, unsealed
from faultgen.twin.detector import load_detector
from faultgen.twin.folder import TASK
from faultgen.twin.judge import Judge, line, watch
from faultgen.twin.train import train


def test_recordings_are_judged(twin, tmp_path, tiny_robot):
    """Healthy is healthy; wear gets its axis and severity, and so does a payload."""
    folder, files = twin
    answers = {}
    for name, path in files.items():
        answers[name] = Judge(folder / "detector", tmp_path / f"{name}.sqlite").judge(path)
    assert answers["healthy"]["verdict"] == "healthy" and not answers["healthy"]["alarm"]
    worn = answers["worn"]
    assert (worn["verdict"], worn["effect"], worn["axes"]) == ("fault", "friction_wear", [2])
    assert worn["severity"] == pytest.approx(0.15, rel=0.3) and worn["probability"] > 0.9
    assert "friction_wear on axis 2" in line(worn)
    heavy = answers["heavy"]
    assert (heavy["verdict"], heavy["effect"], heavy["axes"]) == ("fault", "payload_mass", [2])
    more = 2 * float(tiny_robot.model.body("payload").mass[0])  # three times the payload
    # its place is not known, so that a heavier one that is nearer to the joint looks alike
    assert more / 2.5 < heavy["severity"] < 2.5 * more and heavy["unit"] == "kg"


def test_a_change_that_no_fault_explains_is_unknown(twin, tmp_path, tiny_robot, tiny_task_path):
    """A torque over the angle of one axis: the axis is named, and no effect."""
    folder, _ = twin
    recording = record(tiny_robot, tiny_task_path, 60)
    size = np.sqrt(np.mean(recording.torque[:, 0] ** 2))
    torque = recording.torque.copy()
    torque[:, 0] += size * np.sin(2 * recording.position[:, 0] / tiny_robot.gear_ratio[0])
    write_recording(replace(recording, torque=torque), tmp_path / "new.h5")
    told = Judge(folder / "detector", tmp_path / "state.sqlite").judge(tmp_path / "new.h5")
    assert (told["verdict"], told["axes"], told["effect"]) == ("unknown change", [1], None)
    assert told["alarm"] and "unknown change of axis 1" in line(told)


def dated(tiny_robot, task, folder, days, effects=()):
    """Recordings of some days of March, each with its date."""
    paths = []
    for day in days:
        one = record(tiny_robot, task, 100 + day, effects)
        paths.append(folder / f"day{day:02d}.h5")
        date = date_of(f"2026-03-{day:02d}T08:00")
        write_recording(replace(one, date=date), paths[-1])
    return paths


def test_a_sequence_tells_since_when(twin, tmp_path, tiny_robot, tiny_task_path):
    """In the order of dates, whatever the order of files; a repair begins anew."""
    folder, _ = twin
    before = dated(tiny_robot, tiny_task_path, tmp_path, range(1, 5))
    wear = [("friction_wear", 1, 0.15)]
    after = dated(tiny_robot, tiny_task_path, tmp_path, range(5, 8), wear)
    one = Judge(folder / "detector", tmp_path / "state.sqlite")
    for path in (after[0], *before[::-1], after[1]):
        one.judge(path)
    last = one.judge(after[2])
    assert (last["effect"], last["axes"], last["recordings"]) == ("friction_wear", [1], 7)
    assert last["since"] == "2026-03-05T08:00:00+00:00"
    assert "since 2026-03-05" in line(last)
    assert [a["alarm"] for a in one.answers[:4]] == [False] * 4
    one.repaired(date_of("2026-03-07T12:00"))
    healthy = dated(tiny_robot, tiny_task_path, tmp_path, [8])
    told = one.judge(healthy[0])
    assert not told["alarm"] and told["recordings"] == 1
    again = one.judge(after[2])
    assert again["again"] and again["severity"] == last["severity"]


def test_files_without_dates_count_in_the_order_of_the_call(twin, tmp_path):
    """Also if a copy has changed their times."""
    folder, files = twin
    for age, name in enumerate(("healthy", "worn")):
        path = tmp_path / f"{name}.h5"
        path.write_bytes(files[name].read_bytes())
        os.utime(path, (1e9 - age * 1e6,) * 2)
    one = Judge(folder / "detector", tmp_path / "state.sqlite")
    for name in ("healthy", "worn"):
        told = one.judge(tmp_path / f"{name}.h5")
    assert told["recordings"] == 2 and told["effect"] == "friction_wear"


def test_recordings_with_fewer_samples_are_refused(twin, tmp_path):
    """The samples that are missing would look like a fault, and raised false alarms."""
    folder, files = twin
    whole = read_recording(files["healthy"])
    for every in (2, 25):
        less = {
            name: getattr(whole, name)[::every]
            for name in ("position", "torque", "reference_position")
        }
        period = every * whole.sample_period
        write_recording(replace(whole, sample_period=period, **less), tmp_path / "less.h5")
        with pytest.raises(InputError, match=f"{250 / every:g} Hz, but the detector was made at"):
            Judge(folder / "detector", tmp_path / "state.sqlite").judge(tmp_path / "less.h5")


@pytest.mark.parametrize(
    ("rate", "what"), [(250, None), (20, "is slow: .* monitoring .* works"), (4, "is too slow")]
)
def test_what_slow_recordings_can_be_used_for(rate, what):
    told = slow(1 / rate)
    assert told is None if what is None else re.search(what, told)


def test_a_memory_of_another_detector_is_refused(twin, tmp_path):
    folder, files = twin
    state = tmp_path / "state.sqlite"
    Judge(folder / "detector", state).judge(files["healthy"])
    shutil.copytree(folder / "detector", tmp_path / "detector")
    other = load_detector(folder / "detector")
    replace(other, recordings_per_month=10.0).save(tmp_path / "detector")
    with pytest.raises(InputError, match="belongs to another detector"):
        Judge(tmp_path / "detector", state)
    state.write_text("{}")
    with pytest.raises(InputError, match="damaged"):
        Judge(folder / "detector", state)


def test_a_folder_is_watched(twin, tmp_path):
    """New files are judged once they stop growing; a bad one is one line, and the rest goes on."""
    folder, files = twin
    inbox = tmp_path / "inbox"
    inbox.mkdir()
    (inbox / "notes.txt").write_text("no recording")
    (inbox / "bad.h5").write_text("no recording either")
    told, complaints, looks = [], [], []

    def pause(seconds):
        looks.append(seconds)
        if len(looks) == 2:
            (inbox / "new.h5").write_bytes(files["worn"].read_bytes())
        return len(looks) < 5

    one = Judge(folder / "detector", tmp_path / "state.sqlite")
    watch(one, inbox, told.append, complaints.append, pause)
    assert [answer["verdict"] for answer in told] == ["fault"]
    assert len(complaints) == 1 and "bad.h5" in complaints[0]
    with pytest.raises(InputError, match="no such folder to watch"):
        watch(one, tmp_path / "missing", told.append, complaints.append, pause)


def test_a_stored_detector_answers_the_same(twin, tiny_robot):
    """Saving and loading changes no answer; a damaged file is refused."""
    folder, _ = twin
    first = load_detector(folder / "detector")
    first.save(folder / "copy")
    second = load_detector(folder / "copy")
    rng = np.random.default_rng(0)
    cycle = rng.standard_normal(first.motion.path.shape)
    one, other = (d.judge(d.scores([cycle])[None]) for d in (first, second))
    assert one["log_odds"] == pytest.approx(other["log_odds"])
    assert one["limit"] == other["limit"]
    (folder / "copy" / "arrays.npz").write_bytes(b"PK nothing")
    with pytest.raises(InputError, match="differs from its checksum"):
        load_detector(folder / "copy")
    with pytest.raises(InputError, match="holds no detector.json"):
        load_detector(folder / "data")


def test_no_changed_bit_of_a_detector_is_used(twin, tmp_path):
    """Bits at random places of both files: one line, or no change."""
    folder, _ = twin
    shutil.copytree(folder / "detector", tmp_path / "detector")
    whole, refused = load_detector(tmp_path / "detector"), 0
    rng = np.random.default_rng(0)
    for name in ("detector.json", "arrays.npz"):
        path = tmp_path / "detector" / name
        content = path.read_bytes()
        for at in rng.integers(len(content), size=150).tolist():
            changed = bytearray(content)
            changed[at] ^= 1 << int(rng.integers(8))
            path.write_bytes(changed)
            try:
                again = load_detector(tmp_path / "detector")
                assert again.made == whole.made
                assert again.posterior.limit_ == whole.posterior.limit_
            except InputError as error:
                assert re.fullmatch(rf".*{name}: (damaged .*train again|has format .*)", str(error))
                refused += 1
        path.write_bytes(content)
    assert refused > 290


def test_detectors_of_another_format_say_what_to_do(twin, tmp_path):
    folder, _ = twin
    shutil.copytree(folder / "detector", tmp_path / "detector")
    path = tmp_path / "detector" / "detector.json"
    told = {**unsealed(path.read_text()), "format": 1}
    path.write_text(sealed(told))
    with pytest.raises(InputError, match=r"has format 1, .* train again on the same dataset"):
        load_detector(tmp_path / "detector")


def test_a_name_forges_no_verdict(twin, tmp_path):
    """A recording whose name has a line break and colours is one line."""
    folder, files = twin
    path = tmp_path / "a\nb.h5: healthy, probability 1.00\x1b[2K.h5"
    path.write_bytes(files["worn"].read_bytes())
    done = faultgen_here("judge", folder / "detector", path, "--state", tmp_path / "state.sqlite")
    assert done.returncode == 0 and done.stdout.count("\n") == 1
    assert "friction_wear" in done.stdout and "\x1b" not in done.stdout


def test_datasets_that_do_not_suit_are_refused(twin, tmp_path):
    """A missing healthy run, or an impossible rate, is one clear line."""
    folder, _ = twin
    data = open_dataset(folder / "data")
    with pytest.raises(InputError, match="false-alarms: must be from"):
        train(data, false_alarms=20.0)
    experiment = make_experiment(
        {"robot": str(folder / "robot"), "task": TASK, "axis": 1, "cycles": 2}
    )
    generate(experiment, tmp_path / "one", progress=False)
    train(open_dataset(tmp_path / "one"))  # one repetition is enough
    only = make_experiment(
        {**experiment.model_dump(exclude={"severity"}, exclude_none=True), "healthy": False}
    )
    generate(only, tmp_path / "only", progress=False)
    with pytest.raises(InputError, match="has no healthy run"):
        train(open_dataset(tmp_path / "only"))


def test_recordings_of_currents_or_links_are_refused(twin, tmp_path):
    """A detector that was made from torques judges torques only."""
    folder, files = twin
    detector = folder / "detector"
    recording = read_recording(files["healthy"])
    write_recording(replace(recording, current=True), tmp_path / "current.h5")
    with pytest.raises(InputError, match="has motor_current, but the detector was made from"):
        Judge(detector, tmp_path / "s.sqlite").judge(tmp_path / "current.h5")


def test_commands_explain_themselves_and_refuse_bad_input(tmp_path):
    """Help teaches with an example; nonsense is exit status 2 and one line."""
    for name, word in (("twin", "my_robot"), ("train", "payload"), ("judge", "--repaired")):
        done = faultgen_here(name, "--help")
        assert done.returncode == 0 and word in done.stdout
    for call in (
        ("judge", tmp_path),
        ("judge", tmp_path, "new.h5"),
        ("train", tmp_path),
        ("twin", tmp_path / "no.h5", "--robot", "puma560"),
    ):
        done = faultgen_here(*call)
        assert done.returncode == 2, call
        assert done.stderr.startswith("faultgen: ") and done.stderr.count("\n") == 1

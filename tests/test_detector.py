"""From generated data to a detector, and its answers to recordings."""

import json
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
from faultgen.recordings.recording import write_recording
from faultgen.twin.alarm_limits import find_limits
from faultgen.twin.classes import SCALE, believe, fit_classes, gains
from faultgen.twin.detector import (
    Memory,
    baseline_variance,
    load_detector,
    memory_variance,
    newest_weight,
)
from faultgen.twin.folder import RESULT, TASK
from faultgen.twin.judge import Judge, line, watch
from faultgen.twin.make import furnish
from faultgen.twin.train import train

FEATURES = 12


def drawn(rng, fault, severity):
    """Features that two faults move along fixed directions, with correlated deviations."""
    mix = np.eye(FEATURES) + 0.5 * np.eye(FEATURES, k=1)
    x = rng.standard_normal((len(fault), FEATURES)) @ mix
    for number, direction in enumerate(np.eye(FEATURES)[[2, 7]]):
        own = fault == number
        x[own] += (12 * severity[own] - 2 * severity[own] ** 2)[:, None] * direction
    return x


@pytest.fixture(scope="module")
def fitted():
    rng = np.random.default_rng(0)
    fault = np.repeat([-1, 0, 1], 60)
    severity = np.where(fault < 0, 0.0, rng.uniform(0, 1, len(fault)))
    return fit_classes(drawn(rng, fault, severity), fault, severity, 2)


def test_fault_and_severity_are_found(fitted):
    """Fresh examples get the right name, and the interval holds the severity as often as stated."""
    rng = np.random.default_rng(1)
    fault = np.repeat([0, 1], 200)
    severity = rng.uniform(0.5, 1, len(fault))
    places, _ = fitted.place(drawn(rng, fault, severity))
    told = [believe(fitted, place, 1.0) for place in places]
    named = np.array([np.argmax(one.faults) for one in told])
    assert np.mean(named == fault) > 0.97
    inside = [
        one.interval[k, 0] <= s <= one.interval[k, 1]
        for one, k, s in zip(told, fault, severity, strict=True)
    ]
    assert np.mean(inside) > 0.9
    for one in told:
        assert one.healthy + one.faults.sum() == pytest.approx(1)
    exact = fitted.means[1, 40]
    assert believe(fitted, exact, 1.0).explained == pytest.approx((exact**2).sum(), rel=0.01)


def test_intervals_allow_for_a_model_whose_faults_are_too_weak_or_strong(fitted):
    """The real robot may be changed by 30 % more or less than the model, as is assumed."""
    rng = np.random.default_rng(2)
    fault = np.repeat([0, 1], 200)
    severity = rng.uniform(0.4, 0.8, len(fault))
    as_seen = severity * np.exp(SCALE * rng.standard_normal(len(fault)))
    places, _ = fitted.place(drawn(rng, fault, as_seen))
    told = [believe(fitted, place, 1.0).interval[k] for place, k in zip(places, fault, strict=True)]
    low, high = np.transpose(told)
    share = np.mean((low <= severity) & (severity <= high))
    assert 0.9 < share < 0.99
    assert np.all(low > 0)


@pytest.mark.parametrize(("baselines", "least"), [(0, 0.005), (5, 0.0)])
def test_false_alarms_are_as_rare_as_stated(baselines, least):
    """Limits for 3 % in all let 0.5 to 2 % pass each, or less if the healthy mean was measured.

    That mean is uncertain, which running means of many recordings do not average out.
    """
    nothing, length = np.zeros(0), 30
    rates = []
    for seed in range(3):
        rng = np.random.default_rng([seed, baselines])
        fault = np.repeat([-1, 0, 1], 600)
        severity = np.where(fault < 0, 0.0, rng.uniform(0, 1, len(fault)))
        classes = fit_classes(drawn(rng, fault, severity), fault, severity, 2)
        classes = classes.fitted_to(drawn(rng, np.full(baselines, -1), np.zeros(baselines)))
        limits = find_limits(classes, baselines, 0.03, nothing, nothing, rng)
        count = 150 * length
        places, rest = classes.place(drawn(rng, np.full(count, -1), np.zeros(count)))
        extra = baseline_variance(baselines)
        series = places.reshape(-1, length, places.shape[1])
        running = np.zeros_like(series[:, 0])
        alarms = []
        for k in range(length):
            running += newest_weight(k + 1) * (series[:, k] - running)
            found = gains(classes, running, memory_variance(k + 1) + extra)
            alarms.append(found > limits["running"])
        single = gains(classes, places, 1 + extra) > limits["single"]
        rates.append([np.mean(single), np.mean(alarms), np.mean(rest > limits["rest"])])
    assert np.all((np.mean(rates, axis=0) > least) & (np.mean(rates, axis=0) < 0.02)), rates


@pytest.mark.parametrize("recordings", [3, 5, 20])
def test_few_cycles_and_recordings_raise_no_more_alarms(recordings):
    """With 70 features, 60 cycles and a robot that varies twice as much as generated data."""
    alarms: list[bool] = []
    for seed in range(30):
        rng = np.random.default_rng([recordings, seed])
        fault = np.repeat([-1, 0], 30)
        severity = np.where(fault < 0, 0.0, rng.uniform(0, 1, 60))
        x = rng.standard_normal((60, 70))
        x[:, 0] += 5 * severity
        fitted = fit_classes(x, fault, severity, 1)
        fitted = fitted.fitted_to(2 * rng.standard_normal((recordings, 70)))
        limits = find_limits(fitted, recordings, 0.03, np.zeros(0), np.zeros(0), rng)
        places, rest = fitted.place(2 * rng.standard_normal((100, 70)))
        variance = 1 + 1 / recordings
        alarms += (rest > limits["rest"]).tolist()
        alarms += (gains(fitted, places, variance) > limits["single"]).tolist()
    assert np.mean(alarms) < 0.015  # each limit stands for 1 %


def test_faults_that_span_all_features_leave_no_rest():
    """Rounding is no unknown change."""
    rng = np.random.default_rng(3)
    fault = np.repeat([-1, 0], 40)
    severity = np.where(fault < 0, 0.0, rng.uniform(0, 1, 80))
    x = rng.standard_normal((80, 2)) + np.outer(severity, [3, 1]) + np.outer(severity**2, [1, 4])
    fitted = fit_classes(x, fault, severity, 1)
    limits = find_limits(fitted, 5, 0.01, np.zeros(0), np.zeros(0), rng)
    _, rest = fitted.place(rng.standard_normal((1000, 2)))
    assert not (rest > limits["rest"]).any()


def test_the_memory_averages():
    """The first recordings have equal weights; later ones are forgotten slowly."""
    memory = Memory.empty()
    for value in (1.0, 2.0, 3.0):
        memory = memory.after(np.array([value]))
    assert memory.mean == pytest.approx((2.0,))
    assert memory_variance(1) == 1 and memory_variance(4) == pytest.approx(0.25)
    # w^2 / (1 - (1 - w)^2) = w / (2 - w) of a long series with weight w
    assert memory_variance(60) == pytest.approx(0.2 / 1.8, rel=1e-3)


@pytest.fixture(scope="module")
def twin(tiny_robot, tiny_task_path, tmp_path_factory):
    """A furnished robot, a dataset of it and a detector."""
    folder = tmp_path_factory.mktemp("twin")
    healthy = [record(tiny_robot, tiny_task_path, seed) for seed in (1, 2, 3)]
    furnish(tiny_robot, healthy, folder / "robot", compare=False)
    told = {"recordings": ["a", "b", "c"], "torque_constants": None}
    (folder / "robot" / RESULT).write_text(json.dumps(told))
    experiment = make_experiment(
        {
            "robot": str(folder / "robot"),
            "task": TASK,
            "severity": [0.3],
            "schedule": "linear",
            "cycles": 12,
            "repetitions": 2,
        }
    )
    generate(experiment, folder / "data", progress=False)
    train(open_dataset(folder / "data")).save(folder / "detector")
    files = {}
    cases = {"healthy": (), "worn": [("friction_wear", 2, 0.15)], "heavy": [("payload_mass", 2, 2)]}
    for name, effects in cases.items():
        recording = record(tiny_robot, tiny_task_path, 50 + len(files), effects)
        files[name] = folder / f"{name}.h5"
        write_recording(recording, files[name])
    return folder, files


def test_recordings_are_judged(twin, tmp_path):
    """Healthy is healthy, wear gets its axis and severity, and another fault is unknown."""
    folder, files = twin
    answers = {}
    for name, path in files.items():
        answers[name] = Judge(folder / "detector", tmp_path / f"{name}.json").judge(path)
    assert answers["healthy"]["verdict"] == "healthy" and not answers["healthy"]["alarm"]
    worn = answers["worn"]
    assert (worn["verdict"], worn["effect"], worn["axes"]) == ("fault", "friction_wear", [2])
    assert worn["severity"] == pytest.approx(0.15, rel=0.3) and worn["probability"] > 0.9
    assert "friction_wear on axis 2" in line(worn)
    heavy = answers["heavy"]
    assert heavy["verdict"] == "unknown change" and heavy["alarm"] and heavy["probability"] is None
    over = max(heavy["over_limit"].values())
    assert over > 1 and f"unknown change, {over:.2g} times the limit" in line(heavy)


def test_what_was_judged_is_remembered(twin, tmp_path):
    """State goes on in the next call, and the same recording does not count twice."""
    folder, files = twin
    state = tmp_path / "state.json"
    one = Judge(folder / "detector", state)
    together = [one.judge(files[name]) for name in ("healthy", "worn")]
    assert Judge(folder / "detector", state).memory.count == 2
    assert together[1]["based_on"] == "single" or "mean of 2 recordings" in line(together[1])
    mean = {**together[1], "based_on": "running", "recordings": 2}
    assert line(mean).endswith("(running mean of 2 recordings)")
    again = Judge(folder / "detector", state).judge(files["worn"])
    assert again["again"] and again["severity"] == together[1]["severity"]
    assert Judge(folder / "detector", state).memory.count == 2
    told = json.loads(state.read_text())
    state.write_text(json.dumps({**told, "detector_sha256": "other"}))
    with pytest.raises(InputError, match="belongs to another detector"):
        Judge(folder / "detector", state)
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

    one = Judge(folder / "detector", tmp_path / "state.json")
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
    one, other = (d.judge([cycle], Memory.empty())[0] for d in (first, second))
    assert one["over_limit"] == pytest.approx(other["over_limit"])
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
                assert (again.limits, again.made) == (whole.limits, whole.made)
            except InputError as error:
                assert re.fullmatch(rf".*{name}: (damaged .*train again|has format .*)", str(error))
                refused += 1
        path.write_bytes(content)
    assert refused > 290 and load_detector(tmp_path / "detector").is_sealed


def test_detectors_of_older_versions_are_used_and_told(twin, tmp_path):
    """Without checksum, but with all entries; the command says so on stderr, also with --json."""
    folder, files = twin
    shutil.copytree(folder / "detector", tmp_path / "detector")
    path = tmp_path / "detector" / "detector.json"
    told = json.loads(path.read_text())
    del told["sha256"]
    path.write_text(json.dumps(told))
    done = faultgen_here("judge", tmp_path / "detector", files["healthy"], "--json")
    assert done.returncode == 0 and json.loads(done.stdout)[0]["verdict"] == "healthy"
    assert re.fullmatch(r"faultgen: \S+detector.json: an older .* train again[^\n]*\n", done.stderr)
    told["limits"] = {"single": 1.0, "running": 1.0}  # an entry is lost
    path.write_text(json.dumps(told))
    with pytest.raises(InputError, match=r"detector.json: damaged \(it has no 'rest'\)"):
        load_detector(tmp_path / "detector")


def test_a_name_forges_no_verdict(twin, tmp_path):
    """A recording whose name has a line break and colours is one line."""
    folder, files = twin
    path = tmp_path / "a\nb.h5: healthy, probability 1.00\x1b[2K.h5"
    path.write_bytes(files["worn"].read_bytes())
    done = faultgen_here("judge", folder / "detector", path, "--state", tmp_path / "state.json")
    assert done.returncode == 0 and done.stdout.count("\n") == 1
    assert "friction_wear" in done.stdout and "\x1b" not in done.stdout


def test_datasets_that_do_not_suit_are_refused(twin, tmp_path):
    """One repetition, a missing healthy run, or an impossible rate are one clear line."""
    folder, _ = twin
    data = open_dataset(folder / "data")
    with pytest.raises(InputError, match="false-alarms: must be from"):
        train(data, false_alarms=2.0)
    experiment = make_experiment(
        {"robot": str(folder / "robot"), "task": TASK, "axis": 1, "cycles": 2}
    )
    generate(experiment, tmp_path / "one", progress=False)
    with pytest.raises(InputError, match="at least two runs"):
        train(open_dataset(tmp_path / "one"))
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
    from faultgen.recordings.read import read_recording

    recording = read_recording(files["healthy"])
    write_recording(replace(recording, current=True), tmp_path / "current.h5")
    with pytest.raises(InputError, match="has motor_current, but the detector was made from"):
        Judge(detector, tmp_path / "s.json").judge(tmp_path / "current.h5")


def test_commands_explain_themselves_and_refuse_bad_input(tmp_path):
    """Help teaches with an example; nonsense is exit status 2 and one line."""
    for name, word in (("twin", "my_robot"), ("train", "repetitions"), ("judge", "running mean")):
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

"""Methods that take part by --method, without being installed."""

import json
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import faultgen
from sklearn.dummy import DummyClassifier

from faultgen import plugins
from faultgen.dataset.experiment import make_experiment
from faultgen.dataset.reader import open_dataset
from faultgen.dataset.sweep import generate
from faultgen.errors import InputError
from faultgen.evaluation import Classifier, Detector, Isolator, LabelledRun, Setting
from faultgen.evaluation.detect import detect
from faultgen.evaluation.isolate import isolate
from faultgen.evaluation.isolators import ISOLATORS
from faultgen.evaluation.methods import with_methods

MODULE = """
import numpy as np
from faultgen.evaluation import Detector, Isolator

class Second(Isolator):
    name = "always the second"
    features = ("motor_torque", "speed_histogram")
    learns = False

    def fit(self, *healthy):
        pass

    def isolate(self, torque, histogram):
        assert torque.ndim == 3 and histogram.shape[1:] == (2, 12)
        return 1

class Always(Detector):
    name = "always"
    features = ("torque_indicator",)

    def fit(self, torque):
        self.limit_ = 0.0

    def score(self, torque):
        return np.ones(len(torque))
"""


@pytest.fixture(scope="module")
def made(tiny_robot_path, tiny_task_path, tmp_path_factory):
    """Both axes wear, with noise, four times; not to be changed."""
    folder = tmp_path_factory.mktemp("own") / "out"
    given = {"robot": tiny_robot_path, "task": tiny_task_path, "cycles": 12, "repetitions": 4}
    given |= {"sensors": "thesis", "severity": 0.4, "schedule": "linear"}
    generate(make_experiment(given), folder, progress=False)
    return folder


@pytest.mark.slow
def test_a_class_of_a_file_is_a_row_of_the_table(made, tmp_path):
    """Raw signals and histograms reach it; its code is part of the version of the result."""
    (tmp_path / "their_method.py").write_text(MODULE)
    keys = []
    for text in (MODULE, MODULE.replace("return 1", "return 0")):
        (tmp_path / "their_method.py").write_text(text)
        done = faultgen(
            "isolate", made, "--method", "./their_method.py:Second", "--json", cwd=tmp_path
        )
        assert done.returncode == 0, done.stderr
        told = json.loads(done.stdout)
        rows = [row for row in told["results"] if row["method"] == "always the second"]
        assert (
            told["split"] == "" and sum(row["total"] for row in rows if row["level"] == 0.15) == 8
        )
        assert [row["accuracy"] for row in rows if row["level"] == 0.15] == [0.5]
        keys.append(told["made_by"])
    assert keys[0] != keys[1]
    done = faultgen(
        "detect", made, "--method", "their_method:Always", "--split", "run", "--json",
        cwd=tmp_path, variables={"PYTHONPATH": str(tmp_path)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    rows = [row for row in json.loads(done.stdout)["results"] if row["method"] == "always"]
    assert rows and all(row["alarms"] == row["total"] for row in rows)
    parts = open_dataset(made).part_of("run")
    healthy = [run for run in open_dataset(made).runs if not run["axis"]]
    tested = sum(parts[run.id] == "test" for run in healthy)
    assert [row["total"] for row in rows if row["level"] == 0] == [tested]


@pytest.mark.slow
def test_a_method_of_ones_own_is_in_the_report(made, tmp_path):
    folder = Path(shutil.copytree(made, tmp_path / "out"))
    (tmp_path / "their_report_method.py").write_text(MODULE)
    done = faultgen("report", folder, "--method", "their_report_method.py:Second", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "always the second" in (folder / "report.html").read_text()


class Recorder(Classifier):
    """Remembers what it was given, and says the most frequent label."""

    name = "recorder"
    features = ("mean_abs_torque",)
    given: list = []

    def model(self):  # noqa: D102
        return DummyClassifier(strategy="most_frequent")

    def learn(self, runs):  # noqa: D102
        Recorder.given.append(runs)
        super().learn(runs)


def test_a_classifier_never_sees_a_test_run(made):
    """It gets exactly the training and validation runs; all methods are asked about the others."""
    Recorder.given.clear()
    dataset = open_dataset(made)
    result = isolate(dataset, methods=[Recorder], progress=False)
    parts = dataset.part_of("run")
    wanted = [run for run in dataset.runs if parts[run.id] in ("train", "validation")]
    for runs in Recorder.given:
        assert len(runs) == len(wanted)
        for one, run in zip(runs, wanted, strict=True):
            stored = run.read("monitoring/mean_abs_torque")
            np.testing.assert_array_equal(one.features["mean_abs_torque"], stored)
            np.testing.assert_array_equal(one.severity, run.read("cycle/severity"))
            assert one.axes == tuple(axis - 1 for axis in run["axes"])
    assert Recorder.given and result.split == "run"
    totals = {one.method: one.total for one in result.outcomes if one.level == 0.15}
    tested = sum(part == "test" and dataset.planned[i]["axes"] != [] for i, part in parts.items())
    assert set(totals.values()) == {tested} and "recorder" in totals


def test_a_classifier_learns_axes_from_labels():
    """Cycles with small faults are left out; the last cycles decide; 0: nothing is worn."""

    class Mine(Classifier):
        name = "mine"
        features = ("mean_abs_torque",)

        def model(self):
            from sklearn.neighbors import KNeighborsClassifier

            return KNeighborsClassifier(1)

    ramp = np.linspace(0, 1, 9)
    runs = [
        LabelledRun(
            features={"mean_abs_torque": np.outer(ramp * worn, np.eye(3)[axis])},
            severity=ramp * worn,
            axes=(axis,) if worn else (),
            effect="friction_wear" if worn else "healthy",
        )
        for axis in range(3)
        for worn in (0, 1)
    ]
    one = Mine(Setting(n_axes=3))
    one.learn(runs)
    assert one.model_.n_samples_fit_ == 3 * 9 + 3 * (1 + 7)
    for axis in range(3):
        grown = np.vstack([np.zeros((9, 3)), np.tile(0.8 * np.eye(3)[axis], (5, 1))])
        assert one.isolate(grown) == axis
    assert one.isolate(np.full((9, 3), np.nan)) == -1
    with pytest.raises(ValueError, match="the same label"):
        Mine(Setting(n_axes=3)).learn(runs[::2])


def test_a_division_that_does_not_exist_is_refused(made):
    with pytest.raises(InputError, match="has no division by robot"):
        isolate(open_dataset(made), split="robot", progress=False)
    with pytest.raises(InputError, match="no division by 'cycle'"):
        detect(open_dataset(made), split="cycle", progress=False)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("mine", "method 'mine': give my_package:MyClass or ./my_file.py:MyClass"),
        ("no_such_package:Mine", "no_such_package cannot be loaded .ModuleNotFoundError"),
        ("other_method:Mine", "other_method has no 'Mine'"),
        ("./missing.py:Mine", "there is no file .*missing.py"),
        ("broken_method.py:Mine", "broken_method.py cannot be loaded .ZeroDivisionError"),
        ("good_method.py:Mine", "good_method.py has no 'Mine'"),
        ("json.py:Mine", "rename .*json.py, because another module is called json"),
    ],
)
def test_what_cannot_be_loaded_is_told_in_one_line(tmp_path, monkeypatch, name, message):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    Path("broken_method.py").write_text("1 / 0")
    Path("good_method.py").write_text("")
    Path("other_method.py").write_text("")
    Path("json.py").write_text("")
    with pytest.raises(InputError, match=message) as error:
        plugins.load(name)
    assert "\n" not in str(error.value)


def test_what_is_no_method_is_refused():
    class Unlearned(Recorder):
        name = "unlearned"
        learn = Isolator.learn

    for one, message in (
        (dict, "method dict: must be a subclass of faultgen.evaluation.Isolator"),
        (Detector, "must be a subclass of faultgen.evaluation.Isolator"),
        (ISOLATORS["CC"], "the name 'CC' exists"),
        (Unlearned, "has no method 'learn'"),
    ):
        with pytest.raises(InputError, match=message):
            with_methods(ISOLATORS, Isolator, [one])


@pytest.mark.parametrize(
    ("study", "method", "message"),
    [
        pytest.param(
            "events",
            "Second",
            "study 'events' compares no methods of this kind",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            "isolation",
            "Always",
            "must be a subclass of faultgen.evaluation.Isolator",
            marks=pytest.mark.slow,
        ),
        ("isolation", "Labels", "learns from labelled runs, which a study does not have"),
    ],
)
def test_studies_refuse_what_they_cannot_compare(tmp_path, study, method, message):
    labels = "\nclass Labels(Second):\n    supervised = True\n"
    (tmp_path / "their_study_method.py").write_text(MODULE + labels)
    done = faultgen("study", study, "--method", f"their_study_method.py:{method}", cwd=tmp_path)
    assert done.returncode == 2 and message in done.stderr
    assert not (tmp_path / "study-out").exists()


@pytest.mark.slow
def test_worker_processes_know_the_methods_of_a_study(tmp_path):
    """`use` passes the classes on: a new process lists them, and finds their module by name."""
    import subprocess
    import sys

    (tmp_path / "their_worker_method.py").write_text(MODULE)
    code = (
        "import subprocess, sys\n"
        "from faultgen import plugins\n"
        "plugins.use(['their_worker_method.py:Second'])\n"
        "inner = 'from faultgen.evaluation.isolators import ISOLATORS;'\\\n"
        "    'import their_worker_method; print(list(ISOLATORS)[-1])'\n"
        "print(subprocess.run([sys.executable, '-c', inner], capture_output=True, text=True, "
        "cwd='/').stdout)\n"
        "from faultgen.evaluation.isolators import ISOLATORS\n"
        "print(list(ISOLATORS)[-1])\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.stdout.split("\n")[0] == "always the second", done.stderr
    assert done.stdout.split("\n")[-2] == "always the second"


FAILING = """
from faultgen.evaluation import Isolator

class Failing(Isolator):
    name = "failing"
    features = ("mean_abs_torque",)

    def __init__(self, setting):
        super().__init__(setting)
        setting.n_axes / 1

    def fit(self, torque):
        len(torque) / 1

    def isolate(self, torque):
        return int(
            -len(torque) / len(torque)
        )
"""


@pytest.mark.parametrize(
    ("function", "change", "line"),
    [
        ("__init__", ("n_axes / 1", "n_axes / 0"), 10),
        pytest.param("fit", ("len(torque) / 1", "len(torque) / 0"), 13, marks=pytest.mark.slow),
        pytest.param("isolate", ("/ len(torque)\n", "/ 0\n"), 17, marks=pytest.mark.slow),
    ],
)
def test_a_method_whose_code_fails_is_named_in_one_line(made, tmp_path, function, change, line):
    """With the error, the file and the line, and exit status 1: the input is right."""
    assert change[0] in FAILING
    (tmp_path / "failing_method.py").write_text(FAILING.replace(*change))
    done = faultgen("isolate", made, "--method", "failing_method.py:Failing", cwd=tmp_path)
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1] == (
        f"faultgen: failing_method.Failing: {function} raised ZeroDivisionError: division by zero "
        f"({tmp_path / 'failing_method.py'}, line {line})"
    )
    assert "Traceback" not in done.stderr

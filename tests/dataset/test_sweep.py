import json
import os
import shutil
import signal
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from conftest import contents
from filelock import FileLock

import faultgen.dataset.making as making
from faultgen.dataset.experiment import make_experiment, to_toml
from faultgen.dataset.manifest import Manifest
from faultgen.dataset.planning import plan_runs
from faultgen.dataset.reader import open_dataset
from faultgen.dataset.run import make_run
from faultgen.dataset.sweep import generate
from faultgen.effects import EFFECTS, get_effect
from faultgen.errors import InputError
from faultgen.system.files import file_sha256


@pytest.fixture(scope="session")
def small(tiny_robot_path, tiny_task_path):
    """Function that makes a cheap experiment."""

    def make(**changes):
        base = {"robot": tiny_robot_path, "task": tiny_task_path, "axis": [1, 2], "cycles": 6}
        if not isinstance(changes.get("schedule"), list):
            base["severity"] = 0.3
        return make_experiment(base | changes)

    return make


@pytest.fixture(scope="session")
def made(small, tmp_path_factory):
    """A finished dataset, not to be changed."""
    folder = tmp_path_factory.mktemp("dataset") / "out"
    generate(small(sensors="realistic", paired=True), folder, progress=False)
    return folder


def test_workers_do_not_change_a_byte(small, made, tmp_path):
    """One worker and two give the same folder, file by file, byte by byte."""
    generate(small(sensors="realistic", paired=True), tmp_path / "two", workers=2, progress=False)
    assert contents(tmp_path / "two") == contents(made)


def test_the_contract_of_run_files(made):
    """Attributes and arrays are those of the design, with units, names and scales."""
    attributes = "schema_version robot task effect axis severity schedule seed sample_period"
    attributes += " faultgen_version mujoco_version model_sha256"
    dataset = open_dataset(made)
    assert len(dataset.runs) == 3
    for run in dataset.runs:
        with h5py.File(run.path) as file:
            assert set(attributes.split()) <= set(file.attrs)
            assert file["model"][()].decode().startswith("\n<mujoco")
            samples = file["signals/motor_torque"].shape[1]
            for name in ("motor_position", "motor_velocity", "motor_torque"):
                assert file[f"signals/{name}"].shape == (6, samples, 2)
            for name in ("friction_torque", "gear_torque", "joint_position"):
                assert file[f"truth/{name}"].shape == (6, samples, 2)
            for name in ("mean_abs_torque", "torque_indicator", "speed_indicator"):
                assert file[f"monitoring/{name}"].shape == (6, 2)
            for name in ("torque", "speed", "angle"):
                shares = file[f"monitoring/{name}_histogram"][()]
                assert shares.shape == (6, 2, 12)
                np.testing.assert_allclose(shares.sum(axis=2), 1, atol=1e-12)
            np.testing.assert_array_equal(file["cycle/index"], np.arange(1, 7))

            def check(name, item):
                if isinstance(item, h5py.Dataset) and name != "model":
                    assert item.attrs["units"], name
                    assert item.attrs["long_name"], name
                    if not item.is_scale:
                        assert all(len(dimension) for dimension in item.dims), name

            file.visititems(check)


def test_labels_are_true(made):
    """The label of each cycle is the wear that its friction torque shows."""
    healthy, first, second = open_dataset(made).runs
    assert [run["axis"] for run in (healthy, first, second)] == [0, 1, 2]
    assert [run["effect"] for run in (healthy, first)] == ["healthy", "friction_wear"]
    assert not healthy.read("cycle/severity").any()
    severity = first.read("cycle/severity")
    assert severity[-1] == first["severity"] == 0.3
    np.testing.assert_array_equal(
        first.read("cycle/fault_severity/friction_wear"),
        np.stack([severity, 0 * severity], axis=1),
    )
    speed = np.abs(first.read("truth/motor_velocity"))
    fast = np.abs(speed - 60) < 3
    for axis, ratio in ((0, 1 + severity), (1, np.ones(6))):
        for cycle in range(6):
            at = fast[cycle, :, axis]
            friction = [
                np.abs(run.read("truth/friction_torque")[cycle, at, axis]).mean()
                for run in (first, healthy)
            ]
            # viscous friction at 60 rad/s, which does not wear, at this cycle's temperature
            viscous = friction[1] - (0.2, 0.1)[axis]
            assert friction[0] - viscous == pytest.approx(ratio[cycle] * (0.2, 0.1)[axis], rel=0.03)


def test_healthy_twin_differs_by_wear_only(made):
    """The healthy run of the same seed has the same temperatures, loads and noise."""
    healthy, first, _ = open_dataset(made).runs
    for name in ("cycle/temperature", "truth/gearbox_temperature", "truth/payload_mass"):
        np.testing.assert_array_equal(healthy.read(name), first.read(name))
    noise = [
        run.read("signals/motor_torque") - run.read("truth/motor_torque")
        for run in (healthy, first)
    ]
    np.testing.assert_allclose(noise[0], noise[1], atol=1e-6)


def test_unpaired_runs_have_seeds_of_their_own(small):
    """Unless paired = true no two runs share a seed, and the seeds are stable."""
    runs = plan_runs(small(repetitions=3))
    seeds = [run.seed for run in runs]
    assert len(set(seeds)) == len(seeds) == 9
    assert seeds == [run.seed for run in plan_runs(small(paired=False, repetitions=3))]


def test_severity_zero_is_the_healthy_run(small, tmp_path):
    """A sweep with severity 0 has one healthy run, under its true label."""
    runs = plan_runs(small(severity=[0.0, 0.1]))
    assert [(run.effect, run.axes) for run in runs] == [
        ("healthy", ()),
        ("friction_wear", (1,)),
        ("friction_wear", (2,)),
    ]


def test_several_axes_wear_at_once(small, tmp_path):
    """[[1, 2]] is one run in which both axes wear."""
    generate(small(axis=[[1, 2]], healthy=False), tmp_path, progress=False)
    (run,) = open_dataset(tmp_path).runs
    assert list(run["axes"]) == [1, 2]
    severity = run.read("cycle/severity")
    labels = run.read("cycle/fault_severity/friction_wear")
    np.testing.assert_array_equal(labels, severity[:, None] * [1, 1])


def test_schedules_may_be_arrays(small, tmp_path):
    """The severity of each cycle is that of the array."""
    wear = [0, 0.1, 0.05, 0.2, 0.2, 0.4]
    generate(small(axis=1, schedule=wear, healthy=False), tmp_path, progress=False)
    (run,) = open_dataset(tmp_path).runs
    np.testing.assert_array_equal(run.read("cycle/severity"), wear)
    assert run["severity"] == 0.4


def test_signals_may_be_thinned_or_left_out(small, tmp_path):
    """Reductions are the same, whatever is kept of the signals."""
    generate(small(axis=1, healthy=False), tmp_path / "all", progress=False)
    kept = small(axis=1, healthy=False, signals=["signals/motor_torque"], thin=5)
    generate(kept, tmp_path / "thin", progress=False)
    (whole,), (thin,) = (open_dataset(tmp_path / name).runs for name in ("all", "thin"))
    np.testing.assert_array_equal(
        thin.read("signals/motor_torque"), whole.read("signals/motor_torque")[:, ::5]
    )
    assert "signals/motor_velocity" not in thin
    name = "monitoring/torque_histogram"
    np.testing.assert_array_equal(thin.read(name), whole.read(name))


def test_merged_file_holds_every_run(made):
    """dataset.h5 has the arrays, attributes and scales of each run file, and is not virtual."""
    dataset = open_dataset(made)
    with h5py.File(made / "dataset.h5") as merged:
        assert merged.attrs["complete"]
        assert len(merged["runs"]) == merged.attrs["n_runs"] == 3
        for run in dataset.runs:
            group = merged["runs"][run.id]
            assert group.attrs["severity"] == run["severity"]
            torque = group["signals/motor_torque"]
            np.testing.assert_array_equal(torque, run.read("signals/motor_torque"))
            assert not torque.is_virtual
            assert torque.dims[2][0].name == f"/runs/{run.id}/axis"


def test_finished_datasets_are_left_alone(small, made):
    """Generating again makes nothing and changes nothing."""
    before = contents(made)
    summary = generate(small(sensors="realistic", paired=True), made, progress=False)
    assert (summary.done, summary.kept, summary.failed) == (0, 3, {})
    assert contents(made) == before


def test_missing_and_damaged_runs_are_made_again(small, tmp_path):
    """What is lost, cut short or flipped in one bit is noticed and made again, byte for byte."""
    generate(small(), tmp_path, progress=False)
    before = contents(tmp_path)
    lost, cut, flipped = (run.path for run in open_dataset(tmp_path).runs)
    lost.unlink()
    cut.write_bytes(cut.read_bytes()[:-10])
    content = bytearray(flipped.read_bytes())
    content[len(content) // 2] ^= 1
    flipped.write_bytes(content)
    assert set(open_dataset(tmp_path).damaged()) == {f"runs/{p.name}" for p in (cut, flipped)}
    assert open_dataset(tmp_path).missing == [lost.stem]
    summary = generate(small(), tmp_path, progress=False)
    assert summary.done == 3
    assert contents(tmp_path) == before


def test_killed_sweeps_are_finished_by_running_again(small, made, tmp_path):
    """After SIGKILL in the middle, running again gives the very bytes of an unbroken sweep."""
    toml = tmp_path / "experiment.toml"
    toml.write_text(to_toml(small(sensors="realistic", paired=True)))
    code = (
        "import sys, pathlib, faultgen.dataset.run as r, faultgen.dataset.sweep as s\n"
        "real = r.simulate\n"
        "def halting(*a, **k):\n"
        "    for number, cycle in enumerate(real(*a, **k)):\n"
        "        yield cycle\n"
        "        if number == 2 and list(pathlib.Path(sys.argv[2], 'runs').glob('*.h5')):\n"
        "            print('halted', flush=True); sys.stdin.read()\n"
        "r.simulate = halting\n"
        "s.generate(sys.argv[1], sys.argv[2], progress=False)"
    )
    out = tmp_path / "out"
    command = [sys.executable, "-c", code, str(toml), str(out)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout.readline() == "halted\n"  # in the middle of the second run
        process.send_signal(signal.SIGKILL)
    assert len(open_dataset(out).missing) == 2
    assert list(out.glob("runs/.*.tmp"))
    generate(toml, out, progress=False)
    assert contents(out) == contents(made)


BESIDE_THE_MODEL = {  # and a severity that shows
    "torque_ripple": 0.02,
    "transmission_error": 1e-4,
    "load_friction": 0.1,
    "temperature_friction": 1.0,
    "wrist_coupling_friction": 2.0,
    "torque_constant": 0.1,
    "encoder_offset": 0.02,
    "delay": 0.01,
}


@pytest.mark.parametrize("effect", BESIDE_THE_MODEL)
def test_every_effect_grows_in_a_dataset(small, tmp_path, effect):
    """At severity 0 the run is the healthy one, bit for bit, and after that it is not."""
    severity = BESIDE_THE_MODEL[effect]
    experiment = small(
        effect=effect,
        axis=[2],
        severity=severity,
        schedule="step",
        sensors="realistic",
        paired=True,
    )
    generate(experiment, tmp_path, progress=False)
    healthy, worn = open_dataset(tmp_path).runs
    torque = worn.read("truth/motor_torque") - healthy.read("truth/motor_torque")
    severities = worn.read("cycle/severity")
    assert (torque[severities == 0] == 0).all()
    assert severities[-1] == severity
    assert np.abs(torque[-1, :, 1]).max() > 1e-4


def test_temperature_effects_need_a_temperature(small):
    """Where it is always that of the friction parameters, a fault would be none."""
    with pytest.raises(InputError, match="temperature_friction needs a temperature that changes"):
        small(effect="temperature_friction", sensors="none")


def test_failed_runs_are_recorded_and_do_not_stop_the_sweep(small, tmp_path, monkeypatch):
    """The others are made; the reason is kept, and the run is tried again the next time."""
    real = get_effect("friction_wear")
    broken = {"on": True}

    def fragile(spec, axis, severity):
        real.edit(spec, axis, severity)
        if broken["on"] and axis == 1 and severity > 0.2:
            spec.tendon("gearbox1").stiffness[0] = 1e12

    monkeypatch.setitem(EFFECTS, "friction_wear", replace(real, edit=fragile))
    summary = generate(small(), tmp_path, progress=False)
    assert (summary.done, len(summary.failed)) == (2, 1)
    (reason,) = open_dataset(tmp_path).failed.values()
    assert reason.startswith("cycle 6: the simulation diverged")
    with h5py.File(tmp_path / "dataset.h5") as merged:
        assert not merged.attrs["complete"]
    broken["on"] = False
    summary = generate(small(), tmp_path, progress=False)
    assert (summary.done, summary.failed) == (1, {})
    assert open_dataset(tmp_path).failed == {}


@pytest.mark.slow
@pytest.mark.parametrize("call", ["fsync", "replace"])
def test_no_failing_system_call_leaves_a_half_written_file(small, tmp_path, monkeypatch, call):
    """Whichever sync or rename fails, what is there is whole, and a second try completes it."""
    real = getattr(os, call)
    experiment = small(axis=1, cycles=1, signals="none")
    counter = {"left": 0}

    def fail(*arguments):
        counter["left"] -= 1
        if counter["left"] == 0:
            raise OSError(28, "No space left on device")
        return real(*arguments)

    for number in range(1, 30):
        folder = tmp_path / str(number)
        counter["left"] = number
        monkeypatch.setattr(os, call, fail)
        try:
            summary = generate(experiment, folder, progress=False)
            finished = not summary.failed
        except OSError:
            finished = False
        monkeypatch.setattr(os, call, real)
        for path in folder.glob("runs/*.h5"):
            with h5py.File(path) as file:
                assert file["monitoring/mean_abs_torque"].shape == (1, 2)
        generate(experiment, folder, progress=False)
        dataset = open_dataset(folder)
        assert (dataset.missing, dataset.damaged()) == ([], {})
        assert not list(folder.rglob("*.tmp"))
        if finished and counter["left"] > 0:
            break
    else:
        pytest.fail("the calls never ran out")
    assert number > 4


def test_a_device_needs_its_package_and_stands_alone(small, tmp_path, monkeypatch):
    """Both are told before anything is written."""
    monkeypatch.setitem(sys.modules, "mujoco_warp", None)
    monkeypatch.delitem(sys.modules, "faultgen.dataset.on_device", raising=False)
    monkeypatch.delitem(sys.modules, "faultgen.simulation.worlds", raising=False)
    with pytest.raises(InputError, match=r"pip install 'faultgen\[gpu\]'"):
        generate(small(), tmp_path / "out", device="cuda", progress=False)
    with pytest.raises(InputError, match="cannot be combined with a scheduler"):
        generate(small(), tmp_path / "out", device="cuda", scheduler="tcp://x:1", progress=False)
    assert not (tmp_path / "out").exists()


def test_folders_of_other_experiments_are_refused(small, made):
    """Another experiment never mixes into a dataset."""
    with pytest.raises(InputError, match="holds another dataset"):
        generate(small(cycles=7), made, progress=False)


@pytest.mark.slow
@pytest.mark.parametrize("times", [1, 2])
def test_runs_of_killed_workers_are_made_again(small, made, tmp_path, monkeypatch, times):
    """The run is tried once more; if that kills the worker too, it is listed and resumed later."""
    experiment = small(sensors="realistic", paired=True)
    monkeypatch.setattr(making, "make_run", _die)
    out = tmp_path / "out"
    (tmp_path / "deaths").write_text("x" * times)  # worker processes may be older than this test
    summary = generate(experiment, out, workers=2, progress=False)
    monkeypatch.undo()
    assert (summary.done, len(summary.failed)) == ((3, 0) if times == 1 else (2, 1))
    assert not list(out.rglob("*.tmp"))
    if times == 2:
        (reason,) = open_dataset(out).failed.values()
        assert "its worker process was killed twice" in reason
        assert generate(experiment, out, progress=False).done == 1
    assert contents(out) == contents(made)


def _die(run, folder, on_cycle=None, stepped=None, made_by=None):
    """Make a run; while that of axis 2 is written, its process is killed some times."""
    deaths = folder.parents[1] / "deaths"

    def kill(cycles):
        left = deaths.read_text()
        if run.axes == (2,) and left:
            deaths.write_text(left[1:])
            os.kill(os.getpid(), signal.SIGKILL)

    return make_run(run, folder, kill)


def test_impossible_tasks_are_refused_before_anything_is_written(small, tmp_path):
    """A task that the robot cannot do is bad input, not a row of failed runs."""
    task = tmp_path / "far.toml"
    task.write_text(
        'description = "x"\n[start]\nposition = [9, 9, 9]\nrpy = [0, 0, 0]\n'
        "[[move]]\njoints = [0, 0]\n"
    )
    with pytest.raises(InputError, match="task far, start: .* cannot be reached"):
        generate(small(task=str(task)), tmp_path / "out", progress=False)
    assert not (tmp_path / "out").exists()


def test_files_of_others_are_not_overwritten(small, tmp_path):
    """A folder with an experiment.toml that is not of a dataset is refused."""
    mine = tmp_path / "experiment.toml"
    mine.write_text("# mine\n")
    with pytest.raises(InputError, match="holds the experiment.toml of another dataset"):
        generate(small(), tmp_path, progress=False)
    assert mine.read_text() == "# mine\n"


def test_damaged_manifests_are_told(tmp_path):
    """runs.json of another form gives one line."""
    for content in ("[]", '{"runs": []}', '{"runs": {"x": {}}}', "{"):
        (tmp_path / "runs.json").write_text(content)
        with pytest.raises(InputError, match="runs.json: damaged"):
            open_dataset(tmp_path)


def test_two_generators_do_not_share_a_folder(small, tmp_path):
    """The second one is refused as long as the first one writes."""
    with (
        FileLock(tmp_path / ".lock"),
        pytest.raises(InputError, match="another process is writing there"),
    ):
        generate(small(), tmp_path, progress=False)


def test_experiments_survive_being_written_out(small, made):
    """experiment.toml gives the same runs again, and runs.json names them."""
    from faultgen.dataset.experiment import load_experiment

    experiment = load_experiment(made / "experiment.toml")
    assert experiment == small(sensors="realistic", paired=True)
    planned = json.loads((made / "runs.json").read_text())["runs"]
    assert list(planned) == [run.id for run in plan_runs(experiment)]


@pytest.mark.parametrize(
    "changes",
    [
        {"robot": ['tab\t "quote" \\ line\n \x7f Käse/x.xml', "puma560"]},
        {"schedule": [0.1 + 0.2, 1e-300, 5e-324, 1.0], "cycles": 4},
        {"severity": {"friction_wear": [1 / 3], "backlash": [1e-9]}, "axis": [[1], [2, 3]]}
        | {"effect": ["friction_wear", "backlash"], "speed_window": [[0.0, 1.5], [0.1, 2.0]]},
        {"seed": 2**63 - 1, "signals": [], "parameters": {}, "beside": []},
        {"effect": "torque_ripple", "parameters": {"torque_ripple": {"order": 4}}}
        | {"beside": [{"effect": "backlash", "severity": 1e-3, "axis": 1}]},
    ],
)
def test_every_entry_survives_being_written_out(small, changes):
    """Strings, numbers, lists and tables are read back exactly as they were."""
    experiment = small(**changes)
    content = experiment.model_dump()
    again = make_experiment(tomllib.loads(to_toml(experiment)))
    assert again == experiment and again.model_dump() == content


def test_the_way_in_which_an_experiment_is_written_does_not_matter(small, made, tmp_path):
    """A dataset whose experiment.toml has other line breaks is intact, and its runs are kept."""
    folder = Path(shutil.copytree(made, tmp_path / "out"))
    written = folder / "experiment.toml"
    text = written.read_text()
    written.write_text(text.replace("\n    ", " ").replace(",\n]", "]"))
    assert written.read_text() != text
    manifest = Manifest.read(folder)
    replace(manifest, experiment_sha256=file_sha256(written)).write(folder)
    assert open_dataset(folder).damaged() == {}
    summary = generate(small(sensors="realistic", paired=True), folder, progress=False)
    assert (summary.done, summary.kept) == (0, 3)
    assert contents(folder) == contents(made)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"axis": 7}, "axis 7: robot tiny has axes 1 to 2"),
        ({"axis": 0}, "axis 0: robot tiny has axes 1 to 2"),
        ({"axis": [[1, 1]]}, "the same axis is given twice"),
        ({"severity": -5}, "severity: input should be greater than or equal to 0, not -5"),
        ({"severity": "much"}, "severity: input should be a valid number"),
        ({"severity": 20.0}, "severity: friction_wear must be at most 10 .* not 20"),
        ({"severity": 1.0, "effect": "gear_stiffness"}, "gear_stiffness must be at most 0.95"),
        ({"axis": True}, "axis: input should be a valid integer, not True"),
        ({"axis": [[]]}, "axis: list should have at least 1 item"),
        ({"schedule": [0.1, -0.2]}, "schedule: input should be greater than or equal to 0"),
        (
            {"schedule": [0.1], "severity": 0.2, "cycles": 1},
            "severity: leave it out, because the schedule is an array",
        ),
        ({"sample_period": float("inf")}, "sample_period: input should be a finite number"),
        ({"sample_period": 100.0}, "sample_period: must be well below the cycle"),
        ({"signals": ["signals/motor_torque"] * 2}, "signals: the same name is given twice"),
        ({"cycles": 0}, "cycles: input should be greater than or equal to 1, not 0"),
        ({"effect": "rust"}, "unknown effect 'rust': choose healthy, friction_wear"),
        ({"schedule": "sudden"}, "unknown schedule 'sudden'"),
        ({"schedule": [0.1, 0.2]}, "schedule has 2 severities, but cycles = 6"),
        ({"sensors": "loud"}, "unknown sensors 'loud'"),
        ({"task": "dance"}, "unknown task 'dance' for robot tiny"),
        ({"robot": "r2d2"}, "unknown robot 'r2d2'"),
        ({"sample_period": 0.0035}, "sample period 0.0035 s must be a whole number of steps"),
        ({"signals": ["signals/noise"]}, "signals: unknown 'signals/noise'"),
        ({"color": "red"}, "unknown entry 'color': choose robot, task"),
    ],
)
def test_bad_experiments_are_refused_in_one_line(small, tmp_path, changes, message):
    """The message names the entry, what it is and what it could be; nothing is written."""
    with pytest.raises(InputError, match=message) as error:
        generate(small(**changes), tmp_path / "out", progress=False)
    assert "\n" not in str(error.value)
    assert not (tmp_path / "out").exists()

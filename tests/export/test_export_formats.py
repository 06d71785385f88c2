"""Datasets in the formats of other programs, each read back by the library that people use.

A library that is not installed skips its test: pip install '.[export]' installs all but lerobot.
"""

import json
import shutil

import h5py
import numpy as np
import pytest
from typer.testing import CliRunner

import faultgen
from faultgen.cli.app import app
from faultgen.dataset.experiment import Experiment
from faultgen.errors import InputError, StorageFailed
from faultgen.export.gearing import Gearing
from faultgen.export.statistics import Statistics

# the libraries of others warn of each other
pytestmark = pytest.mark.filterwarnings("ignore")
CYCLES, AXES = 3, 6


def library(name):
    """A library that reads a format, or the reason why its test is left out."""
    return pytest.importorskip(name, reason=f"{name} is not installed; see '.[export]'")


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """A dataset with a validation part, whose runs get worn in their second cycle."""
    folder = tmp_path_factory.mktemp("export") / "data"
    experiment = Experiment(
        robot=["puma560"],
        task=["spot_weld"],
        axis=[[2]],
        schedule=[0.0, 0.1, 0.2],
        cycles=CYCLES,
        thin=20,
        repetitions=3,
        sensors="realistic",
    )
    faultgen.generate(experiment, folder, workers=1, progress=False)
    return folder


@pytest.fixture(scope="module")
def dataset(data):
    return faultgen.open_dataset(data)


def export(*arguments):
    told = CliRunner().invoke(app, ["export", *map(str, arguments), "--json"])
    if told.exit_code:
        raise told.exception
    return json.loads(told.stdout)


def logged(dataset, run, name, number):
    """A signal of one cycle, read with h5py alone."""
    (path,) = [one.path for one in dataset.runs if one.id == run]
    with h5py.File(path) as file:
        return file[name][number - 1]


def worn(dataset, run, number):
    """Whether a cycle is worn, from the schedule."""
    (one,) = [one for one in dataset.runs if one.id == run]
    return one["effect"] != "healthy" and number > 1


@pytest.mark.parametrize(("episode", "count"), [("cycle", 18), ("run", 6)])
def test_lerobot_reads_the_episodes(data, dataset, tmp_path, monkeypatch, episode, count):
    """States are the logged signals of the motors, and actions what the motors should do."""
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    lerobot = library("lerobot.datasets.lerobot_dataset")
    told = export(data, "--format", "lerobot", "-o", tmp_path / "out", "--episode", episode)
    found = lerobot.LeRobotDataset("faultgen/test", root=tmp_path / "out")
    assert found.num_episodes == told["episodes"] == count and found.fps == 12.5
    for place in (0, len(found) - 1, 400):
        item = found[place]
        row = found.meta.episodes[int(item["episode_index"])]
        number = row["cycle"]
        within = int(item["frame_index"])
        length = len(found) // 18
        number, within = number + within // length, within % length
        for part, name in enumerate(("position", "velocity", "torque")):
            wanted = logged(dataset, row["run"], f"signals/motor_{name}", number)[within]
            state = item["observation.state"][part * AXES : (part + 1) * AXES]
            np.testing.assert_array_equal(state, wanted)
        is_worn = worn(dataset, row["run"], number)
        assert item["label.effect"] == ("friction_wear" if is_worn else "healthy")
        assert bool(item["label.healthy"]) != is_worn
        assert item["task"].startswith("puma560 performs spot_weld; ")
        assert ("friction wear on axis 2" in item["task"]) == is_worn
    # the servo follows its commands to within some degrees of the motor
    states = np.stack([found[k]["observation.state"][:AXES] for k in range(0, len(found), 97)])
    actions = np.stack([found[k]["action"] for k in range(0, len(found), 97)])
    assert 1e-6 < np.abs(states - actions).max() < 0.5 < np.abs(actions).max()
    assert found.meta.features["observation.state"]["names"][7] == "motor2.velocity"


def test_lerobot_statistics_are_those_of_all_frames(data, tmp_path):
    """Read with pyarrow: the whole columns give what stats.json says."""
    parquet = library("pyarrow.parquet")
    export(data, "--format", "lerobot", "-o", tmp_path / "out", "--side", "joint")
    stats = json.loads((tmp_path / "out/meta/stats.json").read_text())
    table = parquet.read_table(tmp_path / "out/data/chunk-000/file-000.parquet")
    for name in ("observation.state", "action", "label.severity"):
        values = np.array(table[name].to_pylist(), float).reshape(len(table), -1)
        for kind in ("mean", "std", "min", "max"):
            wanted = getattr(values, kind)(axis=0)
            np.testing.assert_allclose(stats[name][kind], wanted, rtol=1e-9, atol=1e-12)
    info = json.loads((tmp_path / "out/meta/info.json").read_text())
    assert info["codebase_version"] == "v3.0" and info["total_frames"] == len(table)
    assert set(info["features"]) == set(table.column_names)
    tasks = parquet.read_table(tmp_path / "out/meta/tasks.parquet")
    assert sorted(tasks["task_index"].to_pylist()) == list(range(info["total_tasks"]))
    # on the joint side, state and action are the same angle but for the error of the servo
    states = np.array(table["observation.state"].to_pylist())[:, :AXES]
    assert np.abs(states - np.array(table["action"].to_pylist())).max() < 0.01


@pytest.mark.parametrize("by", ["run", "axis"])
def test_datasets_reads_the_folder_and_its_divisions(data, dataset, tmp_path, by):
    """The splits are the fixed division, and a row has the signals of its cycle."""
    datasets = library("datasets")
    if by == "axis":
        with pytest.raises(InputError, match="no division by axis, only run"):
            export(data, "--format", "huggingface", "-o", tmp_path / "out", "--split", by)
        assert list(tmp_path.iterdir()) == []
        return
    export(data, "--format", "huggingface", "-o", tmp_path / "out", "--split", by)
    found = datasets.load_dataset(str(tmp_path / "out"), cache_dir=str(tmp_path / "cache"))
    for part in ("train", "validation", "test"):
        ids = dataset.manifest.splits["run"][part]
        assert found[part]["run"][:] == [i for i in ids for _ in range(CYCLES)]
    rows = found["test"].with_format("numpy")
    for row in rows:
        wanted = logged(dataset, row["run"], "signals/motor_torque", row["cycle"])
        np.testing.assert_array_equal(row["motor_torque_2"], wanted[:, 1])
        is_worn = worn(dataset, row["run"], row["cycle"])
        assert (row["effect"] == "friction_wear") == is_worn == (not row["healthy"])
        assert row["axis"] == 2 * is_worn and row["remaining_cycles"] == CYCLES - row["cycle"]
    tables = datasets.load_dataset(
        str(tmp_path / "out"), "features", cache_dir=str(tmp_path / "cache")
    )
    frame = dataset.to_dataframe()
    wanted = frame.loc[frame["split_run"] == "test", "mean_abs_torque_2"]
    np.testing.assert_array_equal(tables["test"]["mean_abs_torque_2"][:], wanted)
    card = (tmp_path / "out/README.md").read_text()
    assert "license: cc-by-4.0" in card and "| `severity` " in card


def test_mlcroissant_reads_the_records(data, dataset, tmp_path):
    """croissant.json is valid, and leads to the records of all files."""
    croissant = library("mlcroissant")
    export(data, "--format", "huggingface", "-o", tmp_path / "out")
    found = croissant.Dataset(str(tmp_path / "out/croissant.json"))
    issues = found.metadata.ctx.issues
    # the date is that of whoever publishes the data
    assert not issues.errors and all("datePublished" in one for one in issues.warnings)
    names = {one.uuid for one in found.metadata.record_sets}
    assert names == {f"{c}_{s}" for c in ("signals", "features") for s in PARTS}
    for part in PARTS:
        records = list(found.records(f"signals_{part}"))
        assert len(records) == CYCLES * len(dataset.manifest.splits["run"][part])
        first = {name.partition("/")[2]: value for name, value in records[-1].items()}
        run = first["run"].decode()
        wanted = logged(dataset, run, "signals/motor_position", first["cycle"])
        np.testing.assert_array_equal(np.array(first["motor_position_5"], "f4"), wanted[:, 4])


PARTS = ("train", "validation", "test")


def test_robots_with_other_tasks_have_lists_of_other_lengths(tmp_path):
    """Columns of one dataset then have lists of any length, and the libraries read them."""
    datasets, croissant = library("datasets"), library("mlcroissant")
    experiment = Experiment(
        robot=["puma560"],
        task=["spot_weld", "pick_and_place"],
        axis=[[2]],
        schedule=[0.1],
        cycles=1,
        thin=50,
    )
    faultgen.generate(experiment, tmp_path / "data", workers=1, progress=False)
    export(tmp_path / "data", "--format", "huggingface", "-o", tmp_path / "out", "--split", "task")
    found = datasets.load_dataset(str(tmp_path / "out"), cache_dir=str(tmp_path / "cache"))
    lengths = {part: {len(x) for x in rows["motor_torque_1"]} for part, rows in found.items()}
    assert len(set.union(*lengths.values())) == 2 and all(len(x) == 1 for x in lengths.values())
    records = croissant.Dataset(str(tmp_path / "out/croissant.json")).records("signals_test")
    assert len(next(iter(records))["signals_test/motor_torque_1"]) in lengths["test"]


def test_factorynet_has_set_points_effort_feedback_and_context(data, dataset, tmp_path):
    """Feedback and set points are angles of the joints, within the error of the servo."""
    datasets = library("datasets")
    told = export(data, "--format", "factorynet", "-o", tmp_path / "out")
    found = datasets.load_dataset(
        str(tmp_path / "out"), "default", split="train", cache_dir=str(tmp_path / "cache")
    ).to_pandas()
    assert len(found) == told["rows"] and found["episode_id"].nunique() == told["episodes"] == 18
    for episode, rows in found.groupby("episode_id"):
        run, number = episode.split("_")
        number = int(number)
        motor = logged(dataset, run, "signals/motor_position", number)
        joint = logged(dataset, run, "truth/joint_position", number)
        ratio = next(one for one in dataset.runs if one.id == run)["gear_ratio"]
        torque = logged(dataset, run, "signals/motor_torque", number)
        for axis in range(AXES):
            feedback = rows[f"feedback_pos_{axis}"]
            np.testing.assert_allclose(feedback, motor[:, axis] / ratio[axis], rtol=1e-6, atol=1e-6)
            np.testing.assert_allclose(feedback, joint[:, axis], atol=0.005)
            np.testing.assert_allclose(feedback, rows[f"setpoint_pos_{axis}"], atol=0.01)
            np.testing.assert_array_equal(rows[f"effort_motor_torque_{axis}"], torque[:, axis])
        assert set(rows["ctx_anomaly_label"]) == {worn(dataset, run, number)}
    episodes = datasets.load_dataset(
        str(tmp_path / "out"), "episodes", split="train", cache_dir=str(tmp_path / "cache")
    )
    assert set(episodes["episode_id"]) == set(found["episode_id"])


def read_mcap(path):
    """Times [s] and messages by topic."""
    reader = library("mcap.reader")
    found = {}
    with path.open("rb") as file:
        for schema, channel, message in reader.make_reader(file).iter_messages():
            assert schema.encoding == "jsonschema" and channel.message_encoding == "json"
            told = (schema.name, message.log_time / 1e9, json.loads(message.data))
            found.setdefault(channel.topic, []).append(told)
    return found


def test_mcap_plays_a_run_back(data, dataset, tmp_path):
    """Each run has a file; the time goes on from cycle to cycle."""
    library("mcap")
    told = export(data, "--format", "mcap", "-o", tmp_path / "out")
    assert told["files"] == len(dataset.runs) == len(list((tmp_path / "out").iterdir()))
    run = next(one for one in dataset.runs if one["effect"] != "healthy")
    found = read_mcap(tmp_path / f"out/{run.id}.mcap")
    assert set(found) == {"/motors", "/command", "/label"}
    position = run.read("signals/motor_position").reshape(-1, AXES)
    torque = run.read("signals/motor_torque").reshape(-1, AXES)
    assert len(found["/motors"]) == len(found["/command"]) == len(torque)
    for number, (schema, time, message) in enumerate(found["/motors"]):
        assert schema == "foxglove.JointStates" and time == pytest.approx(0.08 * number)
        stamp = message["timestamp"]
        assert stamp["sec"] + 1e-9 * stamp["nsec"] == pytest.approx(time)
        assert [one["name"] for one in message["joints"]] == [f"motor{k + 1}" for k in range(AXES)]
        efforts = np.array([one["effort"] for one in message["joints"]], "f4")
        np.testing.assert_array_equal(efforts, torque[number])
        places = np.array([one["position"] for one in message["joints"]], "f4")
        np.testing.assert_array_equal(places, position[number])
    labels = [message for _, _, message in found["/label"]]
    assert [one["healthy"] for one in labels] == [True, False, False]
    assert [one["severity"] for one in labels] == [0.0, 0.1, 0.2]
    assert [one["remaining_life"] for one in labels] == [2, 1, 0]


def test_mcap_can_be_one_file(data, dataset, tmp_path):
    """Then the topics begin with the id of the run; a single run needs no such prefix."""
    library("mcap")
    first, second = dataset.runs[:2]
    export(first.path, second.path, "--format", "mcap", "-o", tmp_path / "two.mcap")
    topics = set(read_mcap(tmp_path / "two.mcap"))
    assert topics == {
        f"/{r.id}/{t}" for r in (first, second) for t in ("motors", "command", "label")
    }
    export(first.path, "--format", "mcap", "-o", tmp_path / "one.mcap")
    found = read_mcap(tmp_path / "one.mcap")
    # a healthy run has no life that ends, and JSON knows no nan
    assert first["effect"] == "healthy"
    assert not any("remaining_life" in message for _, _, message in found["/label"])


def test_rerun_queries_the_recording(data, dataset, tmp_path):
    """Rerun's own server gives the series back as a table."""
    rerun, _ = library("rerun"), library("datafusion")
    run = next(one for one in dataset.runs if one["effect"] != "healthy")
    export(run.path, "--format", "rerun", "-o", tmp_path / "run.rrd")
    recordings = {"data": [tmp_path / "run.rrd"]}
    local = "127.0.0.1"
    with rerun.server.Server(host=local, addr=local, datasets=recordings) as server:
        stored = server.client().get_dataset("data")
        series = stored.filter_contents("/motor3/torque").reader(index="time").to_pandas()
        labels = stored.filter_contents("/label").reader(index="cycle").to_pandas()
    values = np.concatenate(series["/motor3/torque:Scalars:scalars"].to_list())
    np.testing.assert_array_equal(values, run.read("signals/motor_torque")[..., 2].reshape(-1))
    seconds = series["time"].dt.total_seconds()
    np.testing.assert_allclose(seconds, 0.08 * np.arange(len(values)), atol=1e-6)
    texts = [one[0] for one in labels["/label:TextLog:text"]]
    assert texts[0] == "cycle 1: healthy"
    assert texts[2] == "cycle 3: friction wear on axis 2, severity 0.2 of nominal"


def test_sources_may_be_the_merged_file_or_runs(data, dataset, tmp_path):
    """All ways to name the same runs write the same rows."""
    library("pyarrow")
    ways = {"folder": [data], "file": [data / "dataset.h5"], "runs": [r.path for r in dataset.runs]}
    for name, sources in ways.items():
        export(*sources, "--format", "lerobot", "-o", tmp_path / name)
    contents = {
        (tmp_path / f"{name}/data/chunk-000/file-000.parquet").read_bytes() for name in ways
    }
    assert len(contents) == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--format", "csv"), "format: unknown 'csv': choose recording, parquet"),
        ((), "is a folder; .* choose a format with --format: parquet, ncmapss, lerobot"),
        (("--format", "lerobot", "--episode", "day"), "episode: must be cycle or run, not 'day'"),
        (("--format", "lerobot", "--side", "left"), "side: must be motor or joint, not 'left'"),
        (("--format", "mcap", "--side", "joint"), "--side: belongs to --format lerobot, not to"),
        (("--format", "parquet", "--split", "run"), "--split: belongs to --format huggingface"),
        (("--format", "mcap", "--cycle", "1"), "cycle: leave it out, because all cycles are"),
        (("--format", "rerun", "-o", "{data}"), "holds a dataset; give another folder"),
        (("--format", "factorynet", "-o", "{full}"), "is not empty; give another folder"),
    ],
)
def test_bad_input_is_told_in_one_line(data, tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "full").mkdir()
    (tmp_path / "full/note.txt").write_text("mine")
    given = [one.format(data=data, full=tmp_path / "full") for one in arguments]
    with pytest.raises(InputError, match=message) as error:
        export(data, *given)
    assert "\n" not in str(error.value)
    assert [one.name for one in tmp_path.iterdir()] == ["full"]


@pytest.mark.parametrize("name", ["lerobot", "mcap"])
def test_a_damaged_run_leaves_nothing_behind(data, tmp_path, name):
    """An export that fails halfway removes what it has written."""
    library("pyarrow"), library("mcap")
    shutil.copytree(data, tmp_path / "data")
    path = faultgen.open_dataset(tmp_path / "data").runs[-1].path
    labels = export(tmp_path / "data", "--format", name, "-o", tmp_path / "whole")
    assert labels and (tmp_path / "whole").is_dir()
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    with pytest.raises(InputError, match=f"{path.name}: damaged"):
        export(tmp_path / "data", "--format", name, "-o", tmp_path / "broken")
    assert sorted(one.name for one in tmp_path.iterdir()) == ["data", "whole"]


@pytest.mark.parametrize("name", ["huggingface", "rerun"])
def test_a_full_disk_leaves_nothing_behind(data, tmp_path, monkeypatch, name):
    """So does one whose last step cannot be done."""
    library("pyarrow"), library("rerun")

    def refuse(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pathlib.Path.rename", refuse)
    with pytest.raises(StorageFailed, match="out: cannot be written .No space left on device"):
        export(data, "--format", name, "-o", tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


def test_robots_that_differ_need_formats_that_allow_it(tmp_path):
    """A format with one shape of states names what differs; runs without signals are told."""
    library("pyarrow")
    experiment = Experiment(
        robot=["puma560"], task=["spot_weld"], axis=[[2]], schedule=[0.1], cycles=1, signals=[]
    )
    faultgen.generate(experiment, tmp_path / "data", workers=1, progress=False)
    with pytest.raises(InputError, match="no sampled signal in common.*--format parquet"):
        export(tmp_path / "data", "--format", "lerobot", "-o", tmp_path / "out")
    told = export(tmp_path / "data", "--format", "huggingface", "-o", tmp_path / "hub")
    assert set(told["rows"]) == {"features"}


def test_gearing_of_a_coupled_wrist():
    """Joint 2 turns with motor 1 too: worked out by hand."""
    model = """<mujoco><tendon>
      <fixed name="gearbox1"><joint joint="motor1" coef="0.01"/><joint joint="joint1" coef="-1"/>
      </fixed>
      <fixed name="gearbox2"><joint joint="motor2" coef="0.02"/><joint joint="joint2" coef="-1"/>
        <joint joint="joint1" coef="0.5"/></fixed></tendon></mujoco>"""
    gearing = Gearing.of(model)
    # 0.01 m1 = q1 and 0.02 m2 = q2 - 0.5 q1
    np.testing.assert_allclose(gearing.motor_positions(np.array([[1.0, 2.0]])), [[100, 75]])
    np.testing.assert_allclose(gearing.joint_positions(np.array([[100.0, 75.0]])), [[1, 2]])
    # the power of both sides is the same
    torque, speed = np.array([[3.0, 4.0]]), np.array([[0.2, -0.7]])
    joint = gearing.joint_torques(torque)
    assert np.sum(joint * speed) == pytest.approx(np.sum(torque * gearing.motor_positions(speed)))


def test_joined_statistics_are_those_of_the_whole():
    """Pieces of different lengths: all but the quantiles are exact."""
    rng = np.random.default_rng(0)
    pieces = [rng.normal(k, 1 + k, (50 + 30 * k, 2)) for k in range(4)]
    together, whole = Statistics(), Statistics()
    for piece in pieces:
        one = Statistics()
        one.add("x", piece)
        together.join(one)
    whole.add("x", np.concatenate(pieces))
    for kind in ("min", "max", "mean", "std", "count"):
        np.testing.assert_allclose(together.told()["x"][kind], whole.told()["x"][kind])


def test_zarr_holds_all_arrays_and_attributes_of_the_runs(data, dataset, tmp_path):
    zarr = library("zarr")
    told = export(data, "--format", "zarr", "-o", tmp_path / "data.zarr")
    store = zarr.open_group(tmp_path / "data.zarr", mode="r")
    assert store.metadata.zarr_format == 3
    assert told["runs"] == len(dataset) == len(list(store["runs"].group_keys()))
    for run in dataset:
        copy = store["runs"][run.id]
        with run.open() as group:
            paths = []
            group.visit(paths.append)
            assert set(copy.attrs) >= set(group.attrs)
            for path in paths:
                if not getattr(group[path], "shape", ()):
                    continue
                values = group[path]
                if values.dtype.kind in "fiub":
                    assert np.array_equal(copy[path][...], values[...], equal_nan=True), path
                    assert copy[path].attrs.get("units") == values.attrs.get("units")
        torque = copy["signals/motor_torque"]
        assert torque.shape[0] == CYCLES and torque.attrs["units"] == "N m"
        assert copy.attrs["effect"] == run["effect"]

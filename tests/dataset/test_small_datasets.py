"""The small datasets that are part of the package."""

import hashlib
import shutil
import subprocess
import sys

import numpy as np
import pytest
from data.example_data import DATA, EXPERIMENTS, FLEET

import faultgen
from faultgen import datasets
from faultgen.dataset.planning import plan_runs
from faultgen.dataset.run import make_run
from faultgen.dataset.stored_run import StoredRun
from faultgen.errors import InputError
from faultgen.fleet import load_fleet as load_plan

LOADERS = {
    "wear": (datasets.load_wear, 120, 12, {0, 1, 2, 3}),
    "faults": (
        datasets.load_faults,
        108,
        18,
        {"healthy", *EXPERIMENTS["faults"].effect},
    ),
    "run_to_failure": (datasets.load_run_to_failure, 360, 9, set(range(40))),
    "fleet": (datasets.load_fleet, 320, 8, {False, True}),
}


@pytest.mark.parametrize("name", LOADERS)
def test_arrays_fit_together(name):
    """Rows, groups and targets are those that the description states."""
    load, rows, groups, targets = LOADERS[name]
    found = load()
    assert found.data.shape == (rows, len(found.feature_names)) and len(found.frame) == rows
    assert len(set(found.groups)) == groups
    assert set(found.target.tolist()) == targets
    assert found.data.dtype == float
    column = found.feature_names.index("torque_indicator_2")
    np.testing.assert_array_equal(found.data[:, column], found.frame["torque_indicator_2"])
    for group in set(found.groups):  # a division never divides a run or robot
        assert len(set(found.split[found.groups == group])) == 1
    assert {"train", "test"} <= set(found.split) <= {"train", "validation", "test"}
    assert repr(found) == (
        f"<{name}: {rows} rows, {len(found.feature_names)} features, target {found.target_name}>"
    )


@pytest.mark.parametrize("name", LOADERS)
def test_each_states_licence_and_version_and_opens_as_a_dataset(name):
    """Its folder is intact, and is that of a dataset or a fleet."""
    found = LOADERS[name][0]()
    assert found.licence == "CC BY 4.0" and "(CC BY 4.0, " in found.DESCR and found.version == "1"
    if name == "fleet":
        assert len(faultgen.open_fleet(found.path).robots) == 8
        return
    dataset = faultgen.open_dataset(found.path)
    assert dataset.missing == [] and dataset.damaged() == {}
    assert len(dataset) == LOADERS[name][2]
    checksum = hashlib.sha256((found.path / "dataset.h5").read_bytes()).hexdigest()
    assert (found.path / "dataset.h5.sha256").read_text().strip() == checksum


def test_all_are_small():
    """Together they have at most 8 MB."""
    assert sum(path.stat().st_size for path in DATA.rglob("*") if path.is_file()) <= 8e6


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_the_script_made_them(name):
    """The runs are those of the script's experiment. Ids are hashes of all parameters."""
    plans = {run.id for run in plan_runs(EXPERIMENTS[name])}
    assert set(faultgen.open_dataset(DATA / name).planned) == plans


def test_a_run_can_be_simulated_again(tmp_path):
    """It has the same labels, and torques that differ at most by the rounding of the processor."""
    stored = faultgen.open_dataset(DATA / "faults")[4]
    (run,) = [one for one in plan_runs(EXPERIMENTS["faults"]) if one.id == stored.id]
    assert make_run(run, tmp_path)[1] is None
    again = StoredRun.at(tmp_path / f"{run.id}.h5")
    for name in ("cycle/severity", "cycle/temperature"):
        np.testing.assert_array_equal(again.read(name), stored.read(name))
    torque, wanted = (one.read("signals/motor_torque") for one in (again, stored))
    np.testing.assert_allclose(torque, wanted, atol=1e-6 * np.abs(wanted).max())


def test_the_fleet_is_that_of_the_script(tmp_path):
    """Its robots, days and seed are those of the plan in the script."""
    (tmp_path / "fleet.toml").write_text(FLEET)
    plan, fleet = load_plan(tmp_path / "fleet.toml"), faultgen.open_fleet(DATA / "fleet")
    assert (len(fleet.robots), fleet.days, fleet.seed) == (plan.robots, plan.days, plan.seed)


def test_a_classifier_finds_the_worn_axis():
    """Ridge regression on the change from the first cycle finds most worn axes of unseen runs."""
    from sklearn.linear_model import RidgeClassifier
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    wear = datasets.load_wear()
    x = np.nan_to_num(wear.data)
    first = {group: x[np.flatnonzero(wear.groups == group)[0]] for group in set(wear.groups)}
    x = x - np.stack([first[group] for group in wear.groups])
    late = (wear.frame["cycle"] >= 9).to_numpy()
    train, test = late & (wear.split != "test"), late & (wear.split == "test")
    model = make_pipeline(StandardScaler(), RidgeClassifier(alpha=10.0))
    score = model.fit(x[train], wear.target[train]).score(x[test], wear.target[test])
    assert score >= 0.75


def test_damaged_data_are_told(tmp_path, monkeypatch):
    """A changed byte is noticed before anything is read."""
    shutil.copytree(DATA / "wear", tmp_path / "wear")
    path = tmp_path / "wear/dataset.h5"
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    monkeypatch.setattr("faultgen.datasets.load.FOLDER", tmp_path)
    with pytest.raises(InputError, match="dataset.h5: damaged"):
        datasets.load_wear()


def test_the_datasets_do_not_need_the_simulator():
    """Loading runs imports no MuJoCo."""
    code = (
        "import sys; from faultgen.datasets import load_wear; load_wear(); "
        "assert 'mujoco' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)

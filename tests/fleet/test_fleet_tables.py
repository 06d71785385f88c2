"""Fleets as tables, their fixed parts, and the layout of N-CMAPSS."""

import json

import h5py
import numpy as np
import pandas as pd
import pytest
from conftest import faultgen_here
from fake_fleet import fake_fleet
from typer.testing import CliRunner

from faultgen.cli.app import app
from faultgen.errors import InputError
from faultgen.fleet import FleetPlan, generate_fleet, open_fleet
from faultgen.fleet.tables import FLEET_ARRAYS, HEALTHY_BELOW, divide, ncmapss_arrays
from faultgen.system.arrays import read_arrays

PLAN = {
    "robots": 4,
    "failing": 2,
    "days": 3,
    "models": ["puma560"],
    "programs": {"tasks": ["pick_and_place"], "number": [1, 1], "speed": [0.9, 1.0]},
    "production": {"samples_a_day": [2, 2]},
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A fleet of four robots, two of which fail; not to be changed."""
    out = tmp_path_factory.mktemp("fleet") / "out"
    generate_fleet(FleetPlan(**PLAN), out)
    return out


def invoke(*arguments):
    return CliRunner().invoke(app, [str(one) for one in arguments])


def test_every_array_has_its_unit(folder):
    """Each of them says what it is; a changed unit is noticed as damage."""
    path = folder / "robots" / "robot001.h5"
    with h5py.File(path) as file:
        names = []
        file.visititems(lambda n, item: names.append(n) if isinstance(item, h5py.Dataset) else None)
        assert set(names) == FLEET_ARRAYS.keys()
        for name in names:
            assert file[name].attrs["units"] and file[name].attrs["long_name"]
        assert file["torque_indicator"].attrs["units"] == "N m"
    content = path.read_bytes()
    try:
        with h5py.File(path, "r+") as file:
            file["torque_indicator"].attrs["units"] = "kN"
        with pytest.raises(InputError, match="differs from its checksum"):
            read_arrays(path)
        told = faultgen_here("info", folder, "--json")
        assert told.returncode == 1
        states = [row["state"] for row in json.loads(told.stdout)["robots"]]
        assert "differs from its checksum" in states[0] and states[1:] == ["ok"] * 3
    finally:
        path.write_bytes(content)
    told = faultgen_here("info", folder)
    assert told.returncode == 0 and "the fleet is complete and intact" in told.stdout


def test_a_row_is_a_sample(folder, tmp_path):
    """The table has what the files hold, also after a way through Parquet."""
    fleet = open_fleet(folder)
    frame = fleet.to_dataframe()
    assert len(frame) == sum(len(one.day) for one in fleet.robots)
    for one in fleet.robots:
        rows = frame[frame["unit"] == one.name]
        np.testing.assert_array_equal(rows["torque_indicator_3"], one.torque_indicator[:, 2])
        np.testing.assert_array_equal(rows["torque_histogram_2_12"], one.torque_histogram[:, 1, 11])
        np.testing.assert_array_equal(rows["remaining_life"], one.truth["remaining_life"])
        assert set(rows["split"]) == {one.split}
    assert frame.attrs["units"]["remaining_life"] == "d"
    told = invoke("export", folder, "--parquet", tmp_path / "fleet.parquet", "--json")
    assert told.exit_code == 0, told.output
    pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / "fleet.parquet"), frame)
    x, y, groups = fleet.to_xy(split="train")
    x_test, _, groups_test = fleet.to_xy(split="test", label="failed")
    assert not set(groups) & set(groups_test) and len(x) + len(x_test) == len(frame)
    assert not {"damage", "remaining_life", "shown_damage"} & set(x) and np.isfinite(y).all()
    with pytest.raises(InputError, match="label: there is no 'age': choose unit, robot"):
        fleet.to_xy(label="age")
    with pytest.raises(InputError, match="split: must be 'train' or 'test'"):
        fleet.to_xy(split="half")


def test_robots_are_divided_once_and_for_all():
    """Both parts have robots that fail and robots that do not; the seed decides."""
    fails = [True] * 10 + [False] * 20
    parts = divide(fails, 1)
    assert parts == divide(fails, 1) != divide(fails, 2)
    tested = [fail for fail, part in zip(fails, parts, strict=True) if part == "test"]
    assert sum(tested) == 3 and len(tested) == 9
    assert divide([True, False], 0) == ["train", "train"], "a single one is needed to learn from"


def test_run_to_failure_data_have_the_layout_of_ncmapss(folder, tmp_path):
    """Groups, endings and names of columns; each unit is in one part, and its life runs out."""
    path = tmp_path / "out" / "data.h5"
    told = invoke("export", folder, "--layout", "ncmapss", "-o", path, "--json")
    assert told.exit_code == 0, told.output
    assert json.loads(told.stdout)["units"] == {"dev": 1, "test": 1}
    assert path.with_name("data.h5.sha256").is_file()
    fleet = open_fleet(folder)
    with h5py.File(path) as file:
        groups = ("W", "X_s", "X_v", "T", "A")
        assert set(file) == {
            *(f"{g}_{e}" for g in groups for e in ("dev", "test", "var")),
            *("Y_dev", "Y_test"),
        }
        names = {g: [one.decode() for one in file[f"{g}_var"][()]] for g in groups}
        assert names["A"] == ["unit", "cycle", "Fc", "hs"]
        units = {}
        for ending in ("dev", "test"):
            for group in groups:
                count = len(file[f"Y_{ending}"])
                assert file[f"{group}_{ending}"].shape == (count, len(names[group]))
            (number,) = set(file[f"A_{ending}"][:, 0].tolist())
            units[ending] = number
            one = fleet.robots[int(number) - 1]
            assert one.failed and one.split == {"dev": "train", "test": "test"}[ending]
            life = file[f"Y_{ending}"][:, 0]
            np.testing.assert_array_equal(life, one.truth["remaining_life"])
            assert np.all(np.diff(life) < 0) and 0 <= life[-1] < 1
            column = names["X_s"].index("torque_histogram_2_12")
            stored = file[f"X_s_{ending}"][:, column]
            np.testing.assert_array_equal(stored, one.torque_histogram[:, 1, 11])
            damage = file[f"T_{ending}"][()]
            np.testing.assert_array_equal(damage[:, one.axis - 1], one.truth["damage"])
            assert not np.delete(damage, one.axis - 1, axis=1).any()
            healthy = file[f"A_{ending}"][:, 3]
            np.testing.assert_array_equal(healthy == 1, one.truth["damage"] < HEALTHY_BELOW)
            assert set(file[f"A_{ending}"][:, 1]) == {1.0, 2.0, 3.0}
        assert units["dev"] != units["test"]


def test_a_fleet_without_failures_is_refused(tmp_path):
    fleet = fake_fleet(failed=0)
    with pytest.raises(InputError, match="no robot of its train part fails"):
        ncmapss_arrays(fleet.robots)
    with pytest.raises(InputError, match="no robot of its train part fails"):
        fleet.to_ncmapss(tmp_path / "fleet.h5")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--layout", "cwru"), "layout: must be ncmapss, not 'cwru'"),
        (("--layout", "ncmapss", "elsewhere"), "give one fleet with --layout, not 2"),
    ],
)
def test_other_layouts_are_refused(folder, arguments, message):
    told = invoke("export", folder, *arguments)
    assert isinstance(told.exception, InputError) and message in str(told.exception)


def test_the_report_of_a_fleet_shows_its_robots(folder):
    told = invoke("report", folder, "--json")
    assert told.exit_code == 0, told.output
    text = (folder / "report.html").read_text()
    for one in open_fleet(folder).robots:
        assert one.name in text
    assert "2 of 4 robots fail at the end of 3 days: " in text
    assert "data:image/png;base64" in text and "http" not in text.replace("http://www.w3.org", "")

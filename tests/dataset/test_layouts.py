"""Files of every layout (`schema_version`) are read or refused by name.

tests/data/layouts holds a dataset of each: two runs of the small robot of these tests, healthy and
with 20 % of friction wear of axis 1, three cycles each, without sampled signals. They were made
once by the version of the code that had the layout, and are not to be made again.
"""

import hashlib
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from conftest import contents, faultgen_here

from faultgen import open_dataset
from faultgen.dataset.manifest import SCHEMA_VERSION
from faultgen.errors import InputError

LAYOUTS = Path(__file__).parents[1] / "data" / "layouts"
OLD = LAYOUTS / "1"
RUN = "2d911c4d3fb758ec"
"""The healthy run of the first layout; the worn one is missing there."""


def test_there_is_a_file_of_each_layout():
    assert {path.name for path in LAYOUTS.iterdir()} == {
        str(version + 1) for version in range(SCHEMA_VERSION)
    }


def test_the_present_layout_is_read():
    dataset = open_dataset(LAYOUTS / str(SCHEMA_VERSION) / "dataset.h5")
    healthy, worn = dataset.runs
    assert (healthy["effect"], worn["effect"], worn["axis"]) == ("healthy", "friction_wear", 1)
    severity = worn.read("cycle/fault_severity/friction_wear")
    assert severity[:, 0] == pytest.approx([0.00225342, 0.0366705, 0.2], rel=1e-5)
    assert not severity[:, 1].any()
    torque = [one.read("monitoring/mean_abs_torque")[-1] for one in (healthy, worn)]
    assert np.allclose(torque, [[1.06148062, 0.18695703], [1.06059057, 0.18695438]], atol=1e-7)
    rows = dataset.to_dataframe()
    assert len(rows) == 6


@pytest.mark.parametrize("command", ["info", "isolate", "export", "generate"])
def test_an_older_layout_is_refused_by_name(command, tiny_robot_path, tiny_task_path, tmp_path):
    folder = tmp_path / "old"
    shutil.copytree(OLD, folder)
    words = {
        "info": [folder],
        "isolate": [folder],
        "export": [folder / "runs" / f"{RUN}.h5", "-o", tmp_path / "run.h5"],
        "generate": ["--robot", tiny_robot_path, "--task", tiny_task_path, "-o", folder],
    }
    done = faultgen_here(command, *words[command], cwd=tmp_path)
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert "has the layout (schema_version) 1, and this version of faultgen reads" in done.stderr
    assert contents(folder) == contents(OLD) and [*tmp_path.iterdir()] == [folder]


def test_a_newer_layout_asks_for_a_newer_version(tmp_path):
    content = json.loads((OLD / "runs.json").read_text())
    for run in content["runs"].values():
        run["schema_version"] = 99
    del content["sha256"]
    text = json.dumps(content, sort_keys=True).encode()
    content = {"sha256": hashlib.sha256(text).hexdigest(), **content}
    (tmp_path / "runs.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match="99, and .* install a newer version"):
        open_dataset(tmp_path)

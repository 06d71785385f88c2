"""The script for SLURM, as the page shows it, under a stand-in for its scheduler."""

import os
import re
import stat
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import HANG, contents, faultgen

from faultgen.dataset.experiment import make_experiment, to_toml

ROOT = Path(__file__).parents[2]
PARTS = 3

# It starts the jobs of an array in another order, ends the first one early and starts it again.
SBATCH = """#!{python}
import os, re, subprocess, sys
assert sys.argv[1] == "--wait"
script = open(sys.argv[2]).read()
first, last = map(int, re.search(r"#SBATCH --array=(\\d+)-(\\d+)", script).groups())
cores = re.search(r"#SBATCH --cpus-per-task=(\\d+)", script).group(1)
for task in [last, *range(first, last + 1)]:
    shared = {{"SLURM_ARRAY_TASK_COUNT": str(last), "SLURM_CPUS_PER_TASK": cores}}
    own = os.environ | shared | {{"SLURM_ARRAY_TASK_ID": str(task)}}
    job = subprocess.Popen(["bash", sys.argv[2]], env=own, start_new_session=True)
    if task == last and not os.path.exists("started"):
        open("started", "w").close()
        os.killpg(job.pid, 9)
        job.wait()
    elif job.wait():
        sys.exit(job.returncode)
"""


@pytest.fixture
def folder(tmp_path):
    """A folder with an experiment, the script of the page, and the commands of a cluster."""
    page = (ROOT / "docs" / "datasets.md").read_text()
    (script,) = re.findall(r"```bash\n(#!/bin/bash\n#SBATCH.*?)```", page, re.DOTALL)
    script = script.replace("1-10", f"1-{PARTS}").replace("cpus-per-task=8", "cpus-per-task=1")
    (tmp_path / "make.sh").write_text(script)
    tools = {"sbatch": SBATCH.format(python=sys.executable)}
    tools["faultgen"] = f'#!/bin/sh\nexec "{sys.executable}" -m faultgen.cli "$@"\n'
    (tmp_path / "bin").mkdir()
    for name, content in tools.items():
        tool = tmp_path / "bin" / name
        tool.write_text(content)
        tool.chmod(tool.stat().st_mode | stat.S_IXUSR)
    return tmp_path


@pytest.mark.slow
def test_an_array_of_jobs_makes_the_dataset_of_one_call(folder, tiny_robot_path, tiny_task_path):
    given = {"robot": tiny_robot_path, "task": tiny_task_path, "axis": [1, 2], "cycles": 2}
    experiment = make_experiment(given | {"repetitions": 2, "signals": "none"})
    (folder / "experiment.toml").write_text(to_toml(experiment))
    done = subprocess.run(
        ["bash", "-ec", "sbatch --wait make.sh && faultgen merge out"],
        cwd=folder,
        env=os.environ | {"PATH": f"{folder / 'bin'}:{os.environ['PATH']}"},
        capture_output=True,
        text=True,
        timeout=HANG,
    )
    assert done.returncode == 0, done.stderr
    assert (folder / "started").exists()
    assert faultgen("generate", "experiment.toml", "-o", "whole", cwd=folder).returncode == 0
    made, whole = (
        {name: sum_ for name, sum_ in contents(folder / one).items() if ".lock" not in name}
        for one in ("out", "whole")
    )
    assert made == whole

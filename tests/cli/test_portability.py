"""The package does without what only some systems have."""

import subprocess
import sys

import h5py
import numpy as np
import pytest
from conftest import faultgen

from faultgen.dataset.reader import open_dataset

# what Windows and macOS lack, taken away before anything is imported
WITHOUT = """
import os, sys
for name in ("fcntl", "resource"):
    sys.modules[name] = None
for name in ("sched_getaffinity", "posix_fadvise", "getppid"):
    if hasattr(os, name):
        delattr(os, name)
sys.argv = ["faultgen", *sys.argv[1:]]
import faultgen.cli
faultgen.cli.main()
"""


@pytest.mark.slow
def test_a_dataset_is_made_without_modules_of_linux(tiny_robot_path, tiny_task_path, tmp_path):
    """Without fcntl, resource, posix_fadvise and the like, generating and reading work."""
    out = str(tmp_path / "out")
    robot = ["--robot", tiny_robot_path, "--task", tiny_task_path, "--axis", "1", "--cycles", "2"]
    for arguments in (["generate", *robot, "-o", out], ["info", out]):
        command = [sys.executable, "-W", "ignore", "-c", WITHOUT, *arguments]
        done = subprocess.run(command, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
    assert "complete and intact" in done.stdout


# other instructions of the libraries that choose them by the processor
PROCESSORS = (
    {"OPENBLAS_CORETYPE": "Prescott"},
    {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX512F"},
)
EXACT = ("cycle/severity", "cycle/temperature", "cycle/index")


@pytest.fixture(scope="module")
def generated(tiny_robot_path, tiny_task_path, tmp_path_factory):
    """Generates the same dataset with further environment variables."""

    def generate(variables):
        folder = tmp_path_factory.mktemp("processors") / "out"
        command = ["--robot", tiny_robot_path, "--task", tiny_task_path, "--axis", 1, "--cycles", 2]
        command += ["--sensors", "realistic", "--seed", 4, "--workers", 1]
        done = faultgen("generate", *command, "-o", folder, variables=variables)
        assert done.returncode == 0, done.stderr
        return open_dataset(folder).runs

    return generate


@pytest.fixture(scope="module")
def here(generated):
    """The runs with the instructions of this processor."""
    return generated({})


@pytest.mark.slow
@pytest.mark.parametrize("variables", PROCESSORS, ids=lambda one: next(iter(one)))
def test_another_processor_changes_the_last_digits_only(variables, generated, here):
    """Labels are the same bits, and everything else within a millionth of its largest value."""
    there = generated(variables)
    assert [run.id for run in here] == [run.id for run in there]
    compared = []

    def compare(name, stored):
        if isinstance(stored, h5py.Dataset) and stored.dtype.kind == "f" and stored.size:
            values, others = stored[()], other[name][()]
            tolerance = 0 if name in EXACT else 1e-6 * np.nanmax(np.abs(values))
            np.testing.assert_allclose(others, values, rtol=0, atol=tolerance, err_msg=name)
            compared.append(name)

    for one, same in zip(here, there, strict=True):
        with one.open() as group, same.open() as other:
            group.visititems(compare)
    assert {"signals/motor_torque", "cycle/severity"} <= set(compared)

"""The package does without what only some systems have."""

import subprocess
import sys

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


def test_a_dataset_is_made_without_modules_of_linux(tiny_robot_path, tiny_task_path, tmp_path):
    """Without fcntl, resource, posix_fadvise and the like, generating and reading work."""
    out = str(tmp_path / "out")
    robot = ["--robot", tiny_robot_path, "--task", tiny_task_path, "--axis", "1", "--cycles", "2"]
    for arguments in (["generate", *robot, "-o", out], ["info", out]):
        command = [sys.executable, "-W", "ignore", "-c", WITHOUT, *arguments]
        done = subprocess.run(command, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
    assert "complete and intact" in done.stdout

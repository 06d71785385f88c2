"""MuJoCo's warnings: none of them reaches the terminal or a log file in the user's folder.

MuJoCo writes warnings to stderr and into a file MUJOCO_LOG.TXT in the working folder, unless a
function takes them; its compiler raises them as warnings of Python. From its import on, this module
takes all of them. Whoever needs them collects them:

    with mujoco_warnings() as warned:
        spec = mujoco.MjSpec.from_string(text)
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import mujoco


@contextmanager
def mujoco_warnings() -> Iterator[list[str]]:
    """Collect MuJoCo's warnings in a list.

    Yields:
        The list, to which the warnings are added.
    """
    caught: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(caught.append)
    try:
        with warnings.catch_warnings(record=True) as raised:
            warnings.simplefilter("always", UserWarning)
            yield caught
        caught += [str(one.message) for one in raised]
    finally:
        mujoco.set_mju_user_warning(before)


def _drop(warning: str) -> None:
    """Take a warning that nobody collects: what it says is found by the checks of faultgen."""


if mujoco.get_mju_user_warning() is None:  # a program that imports faultgen may have its own
    mujoco.set_mju_user_warning(_drop)
# the compiler of MuJoCo raises them where it is called; these modules raise none themselves
warnings.filterwarnings(
    "ignore",
    category=UserWarning,
    module=r"faultgen\.(mjcf|building|robot|simulation|discovery|viewing)\b",
)

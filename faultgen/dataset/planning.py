"""Checks of the runs of a dataset before anything is simulated or written."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from faultgen.dataset.experiment import Run
from faultgen.errors import InputError
from faultgen.monitoring.reductions import SPEED_WINDOW
from faultgen.simulation.nominal import Nominal, nominal
from faultgen.simulation.plant import assemble


def check_runs(runs: Sequence[Run]) -> list[str]:
    """Check runs by planning their motions and putting their faults into the robot.

    Args:
        runs: All runs of a dataset.

    Returns:
        Lines for the user, at most one for each robot and task. A line names the axes that never
        turn within the speed window, and states what is done about them.

    Raises:
        InputError: The robot cannot do a task, a fault cannot be put into the robot, or no more
            than one sample of a cycle would be kept.
    """
    notes = []
    for run in {(r.robot, r.task, r.sample_period): r for r in runs}.values():
        shared = nominal(run.robot, run.task, run.sample_period)
        if run.thin > 1 and run.thin >= shared.samples:
            raise InputError(
                f"thin: must be smaller than the number of samples in a cycle, which is "
                f"{shared.samples}, not {run.thin}"
            )
        note = _window_note(shared, run)
        if note:
            notes.append(f"{shared.robot.name}, {Path(run.task).stem}: {note}")
    faulty = {(r.robot, r.effect, r.axes, r.parameters, r.beside): r for r in runs if r.axes}
    for run in faulty.values():
        shared = nominal(run.robot, run.task, run.sample_period)
        try:
            assemble(shared.robot, run.faults)
        except ValueError as error:
            reason = " ".join(str(error).split())
            raise InputError(f"{run.label}: cannot be simulated ({reason})") from None
    return notes


def _window_note(shared: Nominal, run: Run) -> str:
    """State which axes never turn within the speed window, and what is done about them."""
    low, high = shared.speed_window(run.speed_window).T
    inside = ((shared.speed >= low) & (shared.speed <= high)).any(axis=0)
    thesis = (low == SPEED_WINDOW[0]) & (high == SPEED_WINDOW[1])
    own = np.flatnonzero(~thesis) + 1 if not run.speed_window else np.empty(0, int)
    parts = []
    if len(own):
        used = ", ".join(f"{low[a - 1]:.3g} to {high[a - 1]:.3g} (axis {a})" for a in own.tolist())
        window = "{:g} to {:g} rad/s".format(*SPEED_WINDOW)
        parts.append(f"{_never(own)} at {window}; mean_abs_torque uses {used} rad/s")
    if not inside.all():
        never = _never(np.flatnonzero(~inside) + 1)
        parts.append(f"{never} within the speed window; mean_abs_torque is nan there")
    return "; ".join(parts)


def _never(axes: np.ndarray) -> str:
    listed = ", ".join(map(str, axes.tolist()))
    return f"axis {listed} never turns" if len(axes) == 1 else f"axes {listed} never turn"

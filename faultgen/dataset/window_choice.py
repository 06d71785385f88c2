"""Which windows of a dataset are read, and with which label."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypedDict

from faultgen.dataset.labels import SeverityLimit


class WindowChoice(TypedDict, total=False):
    """Arguments of `Dataset.to_torch` and `Dataset.batches`. All of them may be left out."""

    window: int | None
    """Number of samples of a window. Default: whole cycles, which must be equally long."""
    stride: int | None
    """Number of samples from one window to the next. Default: windows lie side by side. No window
    goes beyond its cycle; samples at the end of a cycle that fill no window are left out."""
    signals: str | Sequence[str] | None
    """Names of logged signals, such as "motor_torque", "reference_position", or paths in a run file
    such as "truth/friction_torque". Default: position, velocity and torque of the motors, as far as
    they are stored."""
    label: str | None
    """What is to be predicted: "axis" (default), "effect", "worn", "severity", "remaining_life" or
    another label of `Dataset.to_xy`; None for windows without label. Texts become the numbers of
    classes, with "healthy" first. Cycles whose remaining life is not known are left out."""
    split: str | None
    """The part of a division: "train", "validation" or "test". Default: all cycles."""
    by: str
    """Name of the division: "run" (default), "axis", "robot" or "task"."""
    smallest_severity: SeverityLimit
    """Severity from which a cycle counts as worn; see `Dataset.to_xy`."""
    failure_severity: SeverityLimit
    """Severity at which a robot counts as failed; see `Dataset.to_xy`."""
    groups: str
    """What the attribute ``groups`` of the windows names: "seed" (default) or "robot"."""

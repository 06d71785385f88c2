"""Warnings of a build that the model of a robot keeps, so that a later check can repeat them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import count, takewhile

import mujoco

from faultgen.mjcf.elements import text_of

_NAME = "build_warning"  # of the ``text`` elements, with a number from 1


def keep_warnings(spec: mujoco.MjSpec, warnings: Sequence[str]) -> None:
    """Let a model keep warnings, in place.

    Args:
        spec: The model.
        warnings: The warnings, one line each.
    """
    for number, warning in enumerate(warnings, start=1):
        spec.add_text(name=f"{_NAME}{number}", data=warning)


def kept_warnings(model: mujoco.MjModel) -> list[str]:
    """Return the warnings that a model keeps.

    Args:
        model: The compiled model.
    """
    return list(takewhile(bool, (text_of(model, f"{_NAME}{number}") for number in count(1))))

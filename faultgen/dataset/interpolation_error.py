"""How far the interpolated cycles of a run are from simulated ones."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np


def interpolation_error(told: Mapping[str, Any]) -> float:
    """Compute how large the error of interpolated torque is.

    Args:
        told: Attributes of a run.

    Returns:
        The largest error of an axis, over its noise; 0 if every cycle was simulated.
    """
    if "interpolation_error" not in told:
        return 0.0
    error, noise = (np.asarray(told[f"interpolation_{what}"]) for what in ("error", "noise"))
    return float(np.max(error / np.maximum(noise, 1e-300)))

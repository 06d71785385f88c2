"""Temperature of gearboxes, which friction heats and the air of the hall cools.

Each axis is one thermal mass:

    C dT/dt = duty P(T) - (T - T_ambient) / R

P is the friction loss of the programs that run. It falls while the oil gets warm. R is chosen so
that the axis gets warmer than the hall by `RISE` if its robot runs all the time, and
R C = `TIME_CONSTANT`. Both numbers are assumed, because the manufacturers' values are not public.
"""

from __future__ import annotations

import numpy as np

RISE = 25.0
"""Temperature rise of an axis that runs all the time, mean over robots [K]."""

TIME_CONSTANT = 1.5
"""Thermal time constant of a gearbox [h]."""


def temperatures(
    ambient: np.ndarray,
    duty: np.ndarray,
    loss: np.ndarray,
    nodes: np.ndarray,
    resistance: np.ndarray,
    step: float,
) -> np.ndarray:
    """Compute the temperatures of the gearboxes of one robot.

    Each step is solved exactly for the friction loss at its start.

    Args:
        ambient: Temperature of the hall, shape (times,), in [deg C].
        duty: Share of time in which the robot runs, shape (times,).
        loss: Friction loss of the running programs at each node, shape (times, nodes, n_axes), in
            [W].
        nodes: Temperatures at which the loss is given, ascending, shape (nodes,), in [deg C].
        resistance: Thermal resistance, shape (n_axes,), in [K/W].
        step: Time between rows [h].

    Returns:
        Temperatures, shape (times, n_axes), in [deg C].
    """
    keep = np.exp(-step / TIME_CONSTANT)
    now = np.full(loss.shape[2], ambient[0])
    out = np.empty((len(ambient), loss.shape[2]))
    axes = np.arange(loss.shape[2])
    for k in range(len(ambient)):
        out[k] = now
        at = np.clip(np.searchsorted(nodes, now) - 1, 0, len(nodes) - 2)
        part = np.clip((now - nodes[at]) / (nodes[at + 1] - nodes[at]), 0.0, 1.0)
        heat = (1 - part) * loss[k, at, axes] + part * loss[k, at + 1, axes]
        end = ambient[k] + duty[k] * heat * resistance
        now = end + (now - end) * keep
    return out

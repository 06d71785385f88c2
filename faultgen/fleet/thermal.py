"""Temperature of gearboxes: heated by friction, cooled by the hall.

    C dT/dt = duty P(T) - (T - T_ambient) / R

one thermal mass an axis. P is the friction loss of the programs that run, which falls as the oil
gets warm. R is such that the axis gets `RISE` warmer than the hall where its robot runs all the
time, and R C = `TIME_CONSTANT`; both are assumed: figures of makers are not public.
"""

from __future__ import annotations

import numpy as np

RISE = 25.0
"""Temperature rise of an axis that runs all the time, mean of robots [K]."""

TIME_CONSTANT = 1.5
"""Of a gearbox [h]."""


def temperatures(
    ambient: np.ndarray,
    duty: np.ndarray,
    loss: np.ndarray,
    nodes: np.ndarray,
    resistance: np.ndarray,
    step: float,
) -> np.ndarray:
    """Temperatures of the gearboxes of one robot.

    Args:
        ambient: Temperature of the hall, shape (times,), in [deg C].
        duty: Share of time in which the robot runs, shape (times,).
        loss: Friction loss of what runs then at each node, shape (times, nodes, n_axes), in [W].
        nodes: Temperatures at which the loss is given, ascending, shape (nodes,), in [deg C].
        resistance: Thermal resistance, shape (n_axes,), in [K/W].
        step: Time between rows [h].

    Returns:
        Shape (times, n_axes), in [deg C]; the exact solution of each step with the loss of its
        start.
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

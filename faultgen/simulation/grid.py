"""A grid of conditions, and the weights with which its nodes give any other condition.

    y(T, m, w) = base(T) + load(m, T) + sum_ways wear_way(w, T)

T is the temperature, m the payload, and w how far each way of wear has come. `base` is the
polynomial through its nodes in temperature. `load` and `wear` are differences from it; they are
polynomials in temperature and in the payload or the wear, and zero where the payload is nominal or
nothing is worn. Interactions such as wear x payload, or one way of wear x another, are ignored.

    weights = grid.weights(temperature, payload_factor, wear)  # (cycles, nodes)
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

_EVERY = 2  # every so many-th node in temperature has nodes in payload and wear too


@dataclass(frozen=True)
class Node:
    """One condition of a grid."""

    temperature: float
    """Gearbox temperature [deg C]."""
    payload_factor: float = 1.0
    """Payload mass over its nominal value."""
    way: int | None = None
    """Way of wear, from 0; None: nothing is worn."""
    wear: float = 0.0
    """How far it has come, in the unit of the grid."""


@dataclass(frozen=True)
class Grid:
    """Nodes in temperature, payload and wear."""

    temperatures: tuple[float, ...]
    """Nodes of the base, ascending [deg C]; one, or an odd number."""
    loads: tuple[float, ...]
    """Nodes of the payload: its mass over the nominal one, less 1, without 0."""
    wear: tuple[tuple[float, ...], ...]
    """Nodes of each way of wear, without 0."""

    @property
    def nodes(self) -> list[Node]:
        """All nodes, in the order of the weights."""
        coarse = self.temperatures[::_EVERY]
        nodes = [Node(t) for t in self.temperatures]
        nodes += [Node(t, 1 + load) for t in coarse for load in self.loads]
        nodes += [
            Node(t, 1.0, way, level)
            for t in coarse
            for way, levels in enumerate(self.wear)
            for level in levels
        ]
        return nodes

    def weights(
        self, temperature: np.ndarray, payload_factor: np.ndarray, wear: np.ndarray
    ) -> np.ndarray:
        """Compute the weight of each node in each cycle. Nothing is refused: see the bounds.

        Args:
            temperature: Gearbox temperature of each cycle, shape (cycles,), in [deg C].
            payload_factor: Payload mass divided by its nominal value, shape (cycles,).
            wear: How far each way of wear has come, shape (cycles, ways).

        Returns:
            Weights, shape (cycles, nodes), without unit.
        """
        base = lagrange(self.temperatures, temperature)
        slope = lagrange(self.temperatures[::_EVERY], temperature)
        load = lagrange((0.0, *self.loads), payload_factor - 1)[:, 1:]
        by_load = slope[:, :, None] * load[:, None, :]
        levels = [lagrange((0.0, *own), w)[:, 1:] for own, w in zip(self.wear, wear.T, strict=True)]
        worn = np.hstack([np.empty((len(base), 0)), *levels])
        by_wear = slope[:, :, None] * worn[:, None, :]
        # differences from the base at the same temperature
        base[:, ::_EVERY] -= by_load.sum(axis=2) + by_wear.sum(axis=2)
        cycles = len(base)
        return np.hstack([base, by_load.reshape(cycles, -1), by_wear.reshape(cycles, -1)])


def lagrange(nodes: Iterable[float], x: Iterable[float]) -> np.ndarray:
    """Evaluate the Lagrange polynomials of some nodes.

    Args:
        nodes: The nodes, in the unit of `x`.
        x: Where the polynomials are evaluated.

    Returns:
        Value of each polynomial, shape (len(x), nodes), without unit.
    """
    at = np.asarray(list(nodes), float)
    x = np.asarray(x, float)
    value = np.ones((len(x), len(at)))
    for k in range(len(at)):
        for j in range(len(at)):
            if j != k:
                value[:, k] *= (x - at[j]) / (at[k] - at[j])
    return value


def chebyshev(low: float, high: float, count: int) -> tuple[float, ...]:
    """Return the Chebyshev-Lobatto nodes of an interval, which include its ends.

    Args:
        low: Lower end.
        high: Upper end.
        count: Number of nodes, at least 2.

    Returns:
        The nodes, ascending, in the unit of the ends.
    """
    around = np.cos(np.pi * np.arange(count) / (count - 1))[::-1]
    return tuple(((low + high) / 2 + (high - low) / 2 * around).tolist())

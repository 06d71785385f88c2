"""Which effects could make the gap? Sensitivities by re-simulation, and what they explain of it.

names = candidates(robot)
changes = sensitivities(recording, robot, names, workers=2)
for rank in screen(gap, changes, names, noise, settled(recording, robot))[:5]:
print(rank.effect, rank.axis, rank.severity, rank.explained)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from joblib import Parallel, delayed
from tqdm import tqdm

from faultgen.discovery.recording import Recording
from faultgen.discovery.replay import replay
from faultgen.effects import EFFECTS, get_effect
from faultgen.robot import Robot

Candidate = tuple[str, int]
"""Name of an effect, and axis from 1."""

ALIKE = 0.9
"""|cosine| of two sensitivities from which on a recording hardly tells their effects apart."""


@dataclass(frozen=True)
class Rank:
    """What one candidate alone explains of a gap."""

    effect: str
    """Name."""
    axis: int
    """From 1."""
    severity: float
    """Best severity, to first order."""
    error: float
    """Its standard error from the noise alone."""
    explained: float
    """Share of the squared gap, weighted by the noise."""
    alike: tuple[Candidate, ...]
    """Candidates that this recording hardly tells from it."""


def candidates(robot: Robot) -> list[Candidate]:
    """Every effect of the catalogue on the axes that it can act on.

    An effect that cannot be put into the robot (no payload) is left out.
    """
    payload = robot.spec().body("payload") is not None
    found: list[Candidate] = []
    for name in EFFECTS:
        if payload or not name.startswith("payload"):
            found += [(name, axis) for axis in EFFECTS[name].axes(robot.n_axes)]
    return found


def sensitivities(
    recording: Recording, robot: Robot, names: Sequence[Candidate], *, workers: int = 1
) -> np.ndarray:
    """Change of the replayed torque with the severity of each candidate.

    By re-simulation, closed loop, and not by regression on measured signals: the servo answers to
    an effect, and that answer is part of what is measured.

    Args:
        recording: The measured motion.
        robot: The model.
        names: Candidates.
        workers: Processes; no effect on the result.

    Returns:
        Shape (candidates, samples, n_axes), in torque a unit of severity.

    Raises:
        SimulationFailed: A simulation diverged.
    """
    steps = [get_effect(name).step for name, _ in names]
    runs: list[list[tuple[str, int, float]]] = [[]]
    runs += [[(name, axis, step)] for (name, axis), step in zip(names, steps, strict=True)]
    done = Parallel(n_jobs=workers, return_as="generator")(
        delayed(replay)(recording, robot, run) for run in runs
    )
    torque = list(tqdm(done, total=len(runs), unit="replay", desc="probing", disable=None))
    return np.stack([(t - torque[0]) / step for t, step in zip(torque[1:], steps, strict=True)])


def screen(
    gap: np.ndarray,
    changes: np.ndarray,
    names: Sequence[Candidate],
    noise: np.ndarray,
    inside: np.ndarray,
) -> list[Rank]:
    """Rank candidates by what each alone explains of a gap, to first order.

    Args:
        gap: Torque that is not explained, shape (samples, n_axes).
        changes: Of `sensitivities`.
        names: Candidates.
        noise: Standard deviation of the gap's noise, shape (n_axes,); taken as white.
        inside: Samples that count, shape (samples, n_axes).

    Returns:
        All candidates that change the torque, best first.
    """
    weight = inside / noise
    target = (gap * weight).ravel()
    vectors = (changes * weight).reshape(len(names), -1)
    size = np.sqrt(np.einsum("cs,cs->c", vectors, vectors))
    seen = size > 1e-9 * max(size.max(), 1e-300)
    unit = vectors[seen] / size[seen, None]
    cosine = unit @ unit.T
    along = unit @ target
    total = float(target @ target)
    kept = [name for name, told in zip(names, seen, strict=True) if told]
    ranks = [
        Rank(
            effect=name,
            axis=axis,
            severity=float(along[k] / size[seen][k]),
            error=float(1 / size[seen][k]),
            explained=float(along[k] ** 2 / total) if total > 0 else 0.0,
            alike=tuple(
                kept[j] for j in np.flatnonzero(np.abs(cosine[k]) > ALIKE).tolist() if j != k
            ),
        )
        for k, (name, axis) in enumerate(kept)
    ]
    return sorted(ranks, key=lambda rank: -rank.explained)

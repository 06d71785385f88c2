"""Where right answers without a baseline are lost, in one laboratory, on arrays.

A case is a healthy recording plus the change of torque by one effect in this simulator, scaled to a
d' of 20. Each step decides with more of what `faultgen discover` really knows; see `STEPS`.

    found = measure("scara4_a", recordings=6, folder=Path("/tmp/x"))
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from laboratories.ablation_steps import STEPS, Steps
from laboratories.dump import laboratory
from laboratories.effects import Effect
from laboratories.known import know, on_another_day
from laboratories.make import draw_session, model_for, record
from laboratories.recorded import as_recorded, number_products, true_scales
from laboratories.setup import Setup, set_up

from faultgen.discovery.decision.arrays import REST, Arrays
from faultgen.discovery.decision.difference import model_of
from faultgen.discovery.decision.numbers import KINDS
from faultgen.discovery.decision.whitening import whitened

_STREAM = 97  # of random numbers, apart from those of the cases
_BLOCK, _FOLDS = 1.0, 4  # of held-out samples [s], and in how many turns they are held out


def measure(name: str, recordings: int, folder: Path, effect_recordings: int = 1) -> dict[str, Any]:
    """Measure one laboratory.

    Args:
        name: Of `dump.LABORATORIES`.
        recordings: Healthy recordings for the thresholds.
        folder: Where recordings are written.
        effect_recordings: How many of them have effects added.

    Returns:
        For JSON: `healthy` odds by step, `cases` with the answers; `usable`, the share of
        samples that discovery uses, and `usable_of_moving`, of those of moving axes; `variance` of
        the whitened residual on held-out blocks by recording and axis; and the true `scales`.
    """
    setup = set_up(laboratory(name))
    own = folder / name
    robot, known, made = model_for(setup.lab, own), None, []
    for number in range(recordings):
        rng = np.random.default_rng([setup.lab.seed, _STREAM, number])
        session = draw_session(setup, rng)
        measured, _ = record(setup, [], session, range(setup.n_measured), rng)
        here = know(setup, session) if known is None else on_another_day(known, session)
        known = known or here
        made.append(as_recorded(here, measured, robot, own / "cases" / f"h{number}"))
    assert known is not None
    scales = true_scales([number_products(one) for one in made])
    healthy: dict[str, list[float]] = {step: [] for step in STEPS}
    cases: list[dict[str, Any]] = []
    usable, of_moving, variance = [], [], []
    for number, one in enumerate(made):
        usable.append(one.arrays.comparable.mean())
        speed = np.abs(one.arrays.speed)
        of_moving.append(one.arrays.comparable.sum() / (speed > REST * speed.max(axis=0)).sum())
        variance.append(held_out(one.arrays).tolist())
        steps = Steps(one, scales)
        for step, decision in steps.decide(None).items():
            healthy[step].append(decision.odds)
        if number >= effect_recordings:
            continue
        for k in _chosen(known.effects, setup):
            effect = known.effects[k]
            row = {"recording": number, "effect": effect.name, "axis": effect.axis}
            row |= {"severity": effect.severity, "order": effect.details.get("order")}
            row["answers"] = {s: [d.odds, *d.best] for s, d in steps.decide(k).items()}
            cases.append(row | steps.seen(k))
    return {
        "laboratory": name,
        "factors": setup.lab.factors,
        "axes": setup.lab.machine.n_axes,
        "healthy": healthy,
        "usable": float(np.mean(usable)),
        "usable_of_moving": float(np.mean(of_moving)),
        "variance": variance,
        "scales": dict(zip(KINDS, np.exp(scales).round(3).tolist(), strict=True)),
        "cases": cases,
    }


def _chosen(effects: Sequence[Effect], setup: Setup) -> list[int]:
    """One row of each effect and axis: waves have one order and phase, drawn."""
    rng = np.random.default_rng([setup.lab.seed, _STREAM, 10**6])
    rows: dict[tuple, list[int]] = {}
    for k, effect in enumerate(effects):
        rows.setdefault((effect.name, effect.axis), []).append(k)
    return [int(rng.choice(own)) for own in rows.values()]


def held_out(arrays: Arrays) -> np.ndarray:
    """Mean square of the whitened residual on blocks that were not fitted, shape (n_axes,).

    Args:
        arrays: Of a healthy recording.
    """
    length = round(_BLOCK / arrays.posed.replay.recording.sample_period)
    turn = np.arange(len(arrays.residual)) // length % _FOLDS
    total, count = np.zeros(arrays.residual.shape[1]), np.zeros(arrays.residual.shape[1])
    for fold in range(_FOLDS):
        beyond = arrays.inside & (turn == fold)[:, None]
        part = replace(arrays, inside=arrays.inside & (turn != fold)[:, None])
        white = whitened(part)
        values = model_of(part, white.products).healthy.values
        fitted = np.tensordot(values, arrays.columns[: len(values)], axes=1)
        left = white.noise.whiten(arrays.residual - fitted, arrays.parts)
        total += (left**2 * beyond).sum(axis=0)
        count += beyond.sum(axis=0)
    return np.asarray(total / np.maximum(count, 1))

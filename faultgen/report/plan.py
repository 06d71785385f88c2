"""A plan of motions as files: a task for each motion, and what to expect in ``plan.json``.

result = plan_motions("puma560", out="out")
result["motions"], result["mean_rate"]
"""

from __future__ import annotations

import time
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from faultgen.discovery.discover import dump
from faultgen.discovery.planning.information import NOISE
from faultgen.discovery.planning.motion_library import task_toml
from faultgen.discovery.planning.motion_plan import MotionPlan, make_plan
from faultgen.discovery.terms.candidates import check_names, names_by_use
from faultgen.effects import get_effect
from faultgen.robot import load_robot
from faultgen.system.files import write_text

SEED = 0
"""Seed of the motions that are drawn and of the rates."""


def plan_motions(
    robot: str | Path,
    *,
    out: str | Path | None = None,
    workers: int = 1,
    include: Collection[str] = (),
    cache: str | Path | None = None,
) -> dict[str, Any]:
    """Choose the motions that should be recorded for a discovery.

    Args:
        robot: Name of the robot, or path of its MJCF file or folder.
        out: Folder for ``plan.json`` and one task file for each motion. With None, no files are
            written.
        workers: Number of processes. The result does not depend on it.
        include: Names of effects that are considered only on request.
        cache: Folder that keeps simulations, so that the same call is faster.

    Returns:
        The content of ``plan.json``.

    Raises:
        InputError: An option is wrong, or the robot can do none of the motions.
        SimulationFailed: The model diverges on a motion.
    """
    started = time.monotonic()
    check_names("include", include, names_by_use("on request"))
    with threadpool_limits(limits=1):
        made = make_plan(
            load_robot(str(robot)),
            include=include,
            workers=workers,
            cache=None if cache is None else Path(cache),
            rng=np.random.default_rng(SEED),
        )
    result = contents(made)
    result["seconds"] = round(time.monotonic() - started, 1)
    if out is not None:
        folder = Path(out)
        folder.mkdir(parents=True, exist_ok=True)
        write_text(folder / "plan.json", dump(result))
        for told, motion in zip(result["motions"], made.motions, strict=True):
            write_text(folder / told["file"], task_toml(motion.task))
    return result


def contents(made: MotionPlan) -> dict[str, Any]:
    """Return a plan as the content of ``plan.json``."""
    faults: dict[tuple[str, int], list[int]] = {}
    for index, fault in enumerate(made.faults):
        faults.setdefault((fault.effect, fault.axis), []).append(index)

    def told(which: str, members: list[int]) -> dict[str, Any]:
        rates = [made.rates[which][k] for k in members]
        worst = max(rates, key=lambda rate: rate.wrong)
        return {
            "right": float(np.mean([rate.right for rate in rates])),
            "wrong": float(np.mean([rate.wrong for rate in rates])),
            "smallest": _finite(
                max(made.faults[k].severity * made.clear[which].smallest[k] for k in members)
            ),
            "instead": None
            if worst.instead is None
            else {"effect": worst.instead[0], "axis": worst.instead[1]},
        }

    return {
        "robot": made.robot.name,
        "model_sha256": made.robot.sha256,
        "motions": [
            {
                "file": f"motion_{k + 1}.toml",
                "description": motion.task.description,
                "duration": motion.period,
            }
            for k, motion in enumerate(made.motions)
        ],
        "duration": made.duration,
        "reference": made.reference_name,
        "noise": NOISE,
        "seed": SEED,
        "smaller": made.smaller,
        "mean_rate": {which: made.mean(which) for which in made.rates},
        "false_alarms": made.false_alarms,
        "rates": [
            {
                "effect": effect,
                "axis": axis,
                "severity": made.faults[members[0]].severity,
                "unit": get_effect(effect).unit,
                **{which: told(which, members) for which in made.rates},
            }
            for (effect, axis), members in faults.items()
        ],
    }


def _finite(value: float) -> float | None:
    """A number for JSON: None if it is infinite."""
    return float(value) if np.isfinite(value) else None


def table(result: dict[str, Any]) -> str:
    """Show the rates of a plan: a row for each effect, a column for each axis.

    Args:
        result: From `plan_motions`.

    Returns:
        The table. Each cell has the rate of right answers with the reference and with the plan [%].
        Effects with a rate of at least 99 % everywhere are listed in the last line instead.
    """
    from tabulate import tabulate

    axes = sorted({one["axis"] for one in result["rates"]})
    rows: dict[str, dict[int, dict[str, Any]]] = {}
    for one in result["rates"]:
        rows.setdefault(one["effect"], {})[one["axis"]] = one

    def is_sure(of: dict[int, dict[str, Any]]) -> bool:
        return all(one[which]["right"] >= _SURE for one in of.values() for which in _SETS)

    def cell(one: dict[str, Any] | None) -> str:
        return "" if one is None else " -> ".join(f"{100 * one[s]['right']:.0f}" for s in _SETS)

    def severity(of: dict[int, dict[str, Any]]) -> str:
        values = sorted({float(f"{one['severity']:.2g}") for one in of.values()})
        return f"{values[0]:g}" if len(values) == 1 else f"{values[0]:g} to {values[-1]:g}"

    body = [
        [effect, severity(of), *(cell(of.get(axis)) for axis in axes)]
        for effect, of in rows.items()
        if not is_sure(of)
    ]
    head = ["effect", "severity", *(f"axis {axis}" for axis in axes)]
    sure = ", ".join(effect for effect, of in rows.items() if is_sure(of)) or "none"
    shown = tabulate(body, head, tablefmt="plain", disable_numparse=True)
    return f"{shown}\nat least {100 * _SURE:.0f} % with either, on every axis: {sure}"


_SETS = ("reference", "plan")
_SURE = 0.99

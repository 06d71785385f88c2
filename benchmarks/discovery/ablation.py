"""How many right answers of discovery without a baseline are lost by signatures, forms and priors.

    python -m benchmarks.discovery.ablation [--only scara4_a] [--workers 2]
        [--parts DIR] [--save FILE]

Prints a table and writes JSON. `laboratories.ablation_steps.STEPS` says what the steps are. With
--parts, the result of each laboratory is kept there and not measured again by the same version.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import tempfile
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco
from joblib import Parallel, delayed
from laboratories.ablation import measure
from laboratories.ablation_steps import LIMIT, STEPS
from laboratories.dump import LABORATORIES
from scoring.answering import version

from faultgen.system.files import write_text

FIRST = ("lift1_a", "scara4_a", "puma560_a", "arm7_a")
"""Laboratories that are measured if none is named: one, four, six and seven axes."""
RESULT = Path(__file__).parents[1] / "results" / "discovery_ablation.json"
WORST_VARIANCE, LEAST_USABLE = 1.3, 0.8
"""Goals: of the whitened residual variance, and of the share of samples that are used."""
_ALIKE = 0.95  # correlation below which a column is listed
_PARTS = (("signatures", "A", "C"), ("noise", "C", "D"), ("priors", "D", "E"))
_OUTCOMES = ("right", "wrong", "none")
_OWN_LIMIT = "E own"  # step E with the limit of discovery itself


def outcomes(laboratory: Mapping[str, Any]) -> list[dict[str, str]]:
    """Judge the answers of one laboratory.

    Args:
        laboratory: From `laboratories.ablation.measure`.

    Returns:
        For each case 'right', 'wrong' (another effect or axis is above the threshold) or 'none', by
        step. The threshold is the largest odds of a healthy recording, and for 'E own' discovery's.
    """
    limits = {step: (step, max(odds)) for step, odds in laboratory["healthy"].items()}
    limits[_OWN_LIMIT] = ("E", LIMIT)
    out = []
    for case in laboratory["cases"]:
        row = {}
        for name, (step, limit) in limits.items():
            odds, *best = case["answers"][step]
            right = best == [case["effect"], case["axis"]]
            row[name] = "none" if odds <= limit else "right" if right else "wrong"
        out.append(row)
    return out


def lost(laboratory: Mapping[str, Any], before: str, after: str) -> Counter[str]:
    """Count cases by effect that are right in one step and no longer in a later one."""
    rows = zip(laboratory["cases"], outcomes(laboratory), strict=True)
    return Counter(
        case["effect"] for case, row in rows if row[before] == "right" and row[after] != "right"
    )


def shares(rows: Sequence[Mapping[str, str]]) -> dict[str, dict[str, float]]:
    """Share of each outcome by step [%]."""
    return {
        step: {
            outcome: round(100 * sum(row[step] == outcome for row in rows) / len(rows), 1)
            for outcome in _OUTCOMES
        }
        for step in (*STEPS, _OWN_LIMIT)
    }


def summary(found: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Summarise all laboratories.

    Args:
        found: From `laboratories.ablation.measure`.

    Returns:
        Shares by laboratory and in total, points that signatures, noise and priors cost, effects
        that are lost, healthy recordings above discovery's limit, and the shares of laboratories
        that reach the goals.
    """
    judged = {one["laboratory"]: outcomes(one) for one in found}
    total = shares([row for rows in judged.values() for row in rows])
    right = {step: values["right"] for step, values in total.items()}
    worst = [max(max(axes) for axes in one["variance"]) for one in found]
    parts: dict[str, Any] = {}
    for label, before, after in _PARTS:
        effects = sum((lost(one, before, after) for one in found), Counter[str]())
        parts[f"lost_by_{label}"] = round(right[before] - right[after], 1)
        parts[f"effects_lost_by_{label}"] = dict(effects.most_common())
    return {
        "cases": sum(map(len, judged.values())),
        "by_laboratory": {name: shares(rows) for name, rows in judged.items()},
        "total": total,
        **parts,
        "false_alarms": sum(odds >= LIMIT for one in found for odds in one["healthy"]["E"]),
        "healthy": sum(len(one["healthy"]["E"]) for one in found),
        "variance_reached": sum(x <= WORST_VARIANCE for x in worst) / len(worst),
        "usable_reached": sum(one["usable"] >= LEAST_USABLE for one in found) / len(found),
    }


def text(found: Sequence[Mapping[str, Any]], told: Mapping[str, Any]) -> str:
    """Lay out the table."""
    names = [one["laboratory"] for one in found]
    lines = [f"{'right (wrong) %':<18}" + "".join(f"{name:>16}" for name in (*names, "all"))]
    for step in (*STEPS, _OWN_LIMIT):
        columns = [told["by_laboratory"][name][step] for name in names] + [told["total"][step]]
        cells = [f"{c['right']:.0f} ({c['wrong']:.0f})" for c in columns]
        lines.append(f"{step:<18}" + "".join(f"{cell:>16}" for cell in cells))
    of = {
        "cases": [len(one["cases"]) for one in found],
        "samples used %": [round(100 * one["usable"]) for one in found],
        "of moving axes %": [round(100 * one["usable_of_moving"]) for one in found],
        "variance": [
            f"{min(map(min, one['variance'])):.2f} to {max(map(max, one['variance'])):.2f}"
            for one in found
        ],
    }
    for label, values in of.items():
        lines.append(f"{label:<18}" + "".join(f"{value:>16}" for value in values))
    alarms = [sum(odds >= LIMIT for odds in one["healthy"]["E"]) for one in found]
    cells = [f"{n} of {len(one['healthy']['E'])}" for n, one in zip(alarms, found, strict=True)]
    cells.append(f"{told['false_alarms']} of {told['healthy']}")
    lines.append(f"{'false alarms':<18}" + "".join(f"{cell:>16}" for cell in cells))
    lines += [f"{step}: {meaning}" for step, meaning in STEPS.items()]
    lines.append(f"{_OWN_LIMIT}: as E, with the limit of discovery itself, log odds of {LIMIT:.1f}")
    for label, before, after in _PARTS:
        points, effects = told[f"lost_by_{label}"], told[f"effects_lost_by_{label}"]
        lines.append(f"lost by {label} ({before} to {after}): {points} points, {effects}")
    for one in found:
        for case in one["cases"]:
            if case["r_C"] < _ALIKE:
                rival = "{} {} {:.3f}".format(*case["rival_C"])
                lines.append(
                    f"{one['laboratory']} {case['effect']} {case['axis']}: correlation "
                    f"{case['r_C']:.3f} (without numbers {case['r_raw']:.3f}), d' left "
                    f"{case['d_used']:.1f}, beside discovery's numbers {case['d_C']:.1f}, with its "
                    f"scales {case['d_E']:.1f}; next {rival}"
                )
    return "\n".join(lines)


def measured(
    name: str, healthy: int, recordings: int, folder: Path, parts: Path | None
) -> dict[str, Any]:
    """Measure a laboratory, or read its result.

    Args:
        name: Of the laboratory.
        healthy: Recordings for the thresholds.
        recordings: Of them that get effects.
        folder: Where recordings are written.
        parts: Folder of results; None: nothing is kept.
    """
    head = {"version": version(), "healthy_recordings": healthy, "recordings": recordings}
    path = parts / f"{name}.json" if parts else None
    if path and path.is_file():
        found: dict[str, Any] = json.loads(path.read_text())
        if found.items() >= head.items():
            return found
    found = head | measure(name, healthy, folder, recordings)
    if path:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, json.dumps(found, indent=1) + "\n")
    return found


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    even = [name for name, factors in LABORATORIES.items() if not factors.get("jitter")]
    parser.add_argument("--only", nargs="*", choices=even, default=FIRST)
    parser.add_argument("--healthy", type=int, default=6, help="recordings for the thresholds")
    parser.add_argument("--recordings", type=int, default=1, help="of them that get effects")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--parts", type=Path, help="folder of the results by laboratory")
    parser.add_argument("--save", type=Path, default=RESULT)
    told = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = Parallel(n_jobs=told.workers)(
            delayed(measured)(name, told.healthy, told.recordings, Path(folder), told.parts)
            for name in sorted(told.only, key=list(LABORATORIES).index, reverse=True)
        )
    found = sorted(found, key=lambda one: list(LABORATORIES).index(one["laboratory"]))
    result = {
        "machine": f"{platform.machine()}, {os.cpu_count()} cores",
        "mujoco": mujoco.__version__,
        "version": version(),
        "arguments": {"healthy": told.healthy, "recordings": told.recordings},
        "steps": STEPS,
        "summary": summary(found),
        "laboratories": found,
    }
    write_text(told.save, json.dumps(result, indent=1) + "\n")
    print(text(found, result["summary"]))


if __name__ == "__main__":
    main()

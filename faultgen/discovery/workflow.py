"""From two recordings to a named effect, a model with it, and a report.

result = discover("measured.h5", "puma560", healthy="healthy.h5", out="out")
result["verdict"], result["effects"]
"""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from faultgen.discovery.check import check_recording
from faultgen.discovery.naming import Naming, name_effects, to_probe
from faultgen.discovery.recording import Recording, read_recording
from faultgen.discovery.replay import relative_error, replay, settled
from faultgen.discovery.screen import candidates
from faultgen.effects import get_effect
from faultgen.errors import InputError
from faultgen.robot import Robot, load_robot
from faultgen.storage import write_text

MEASURE = (
    "RMS torque error over RMS torque, root mean square over the axes, healthy twin subtracted"
)


def discover(
    measured: str | Path,
    robot: str | Path,
    healthy: str | Path | None = None,
    validate: str | Path | None = None,
    *,
    out: str | Path | None = None,
    workers: int = 1,
) -> dict[str, Any]:
    """Find the effect that a measured robot has and its healthy twin lacks.

    Args:
        measured: Recording of the robot, see docs/measured.md.
        robot: Name of the robot, or path of its MJCF.
        healthy: Recording of the same motions before the change. Needed: naming without it is not
            there yet.
        validate: Recording of other motions with the effect, for scoring only.
        out: Folder for ``discovery.json``, ``model.xml`` and ``report.html``; None: none written.
        workers: Processes; no effect on the result.

    Returns:
        The content of ``discovery.json``.

    Raises:
        InputError: A recording cannot be used, or the two are not of the same motions.
        SimulationFailed: A simulation diverged.
    """
    started = time.monotonic()
    if healthy is None:
        raise InputError(
            "healthy: give a recording of the same motions before the change (--healthy); "
            "discovery without one is not there yet"
        )
    model = load_robot(str(robot))
    worn, warnings = _usable(measured, model)
    twin, more = _usable(healthy, model)
    _check_same_motion(worn, twin)
    try:
        naming = name_effects(
            worn.torque - twin.torque, twin, model, to_probe(candidates(model)), workers=workers
        )
    except ValueError as error:
        raise InputError(f"{twin.source}: {error}") from None
    result = _result(naming)
    result["warnings"] = [*warnings, *more]
    if validate is not None:
        other, _ = _usable(validate, model)
        result["gap"]["validation"] = _validation(other, model, naming)
    result["seconds"] = round(time.monotonic() - started, 1)
    if out is not None:
        from faultgen.report.discovery_report import write_discovery_report

        folder = Path(out)
        folder.mkdir(parents=True, exist_ok=True)
        write_text(folder / "model.xml", _model_xml(model, result))
        change = naming.change if result["effects"] else np.zeros_like(worn.torque)
        write_discovery_report(
            folder / "report.html", result, worn.torque - twin.torque, change, worn.sample_period
        )
        write_text(folder / "discovery.json", json.dumps(result, indent=1, allow_nan=False) + "\n")
    return result


def _usable(path: str | Path, robot: Robot) -> tuple[Recording, list[str]]:
    """A recording that no check refuses, and what it is warned of."""
    recording = read_recording(path)
    findings = check_recording(recording, robot)
    for finding in findings:
        if finding.level == "refuse":
            where = f"axis {finding.axis}: " if finding.axis else ""
            raise InputError(f"{path}: {where}{finding.message}")
    return recording, [f"{path}: {finding}" for finding in findings]


def _check_same_motion(worn: Recording, twin: Recording) -> None:
    same = (
        worn.position.shape == twin.position.shape
        and worn.side == twin.side
        and worn.segments == twin.segments
        and abs(worn.sample_period - twin.sample_period) < 1e-9
    )
    if same:
        moved = np.ptp(twin.position, axis=0)
        apart = np.abs(worn.position - twin.position).max(axis=0)
        same = bool(np.all(apart <= 0.05 * moved + 1e-3 * moved.max()))
    if not same:
        raise InputError(
            f"{worn.source} and {twin.source}: not the same motions, sample by sample; record the "
            "same program from the same start, with the same sample period"
        )


def _result(naming: Naming) -> dict[str, Any]:
    """The contract of discovery.json."""
    ambiguous = [one for one in naming.effects if one.alternatives]
    if naming.effects and naming.explained:
        verdict = "ambiguous" if ambiguous else "named"
    elif naming.significant or naming.effects:
        verdict = "unknown effect"
    else:
        verdict = "no missing effect"
    known = verdict in ("named", "ambiguous")
    parts = [
        {
            "effect": one.effect,
            "axis": one.axis,
            "parameters": {"severity": one.severity, "unit": get_effect(one.effect).unit},
            "interval": {
                "severity": [one.severity - 1.96 * one.error, one.severity + 1.96 * one.error]
            },
            "confidence": one.confidence,
            "gap_after": one.gap_after,
        }
        for one in naming.effects
    ]
    others = [
        {"effect": name, "axis": axis, "confidence": odds}
        for one in naming.effects
        for (name, axis), odds in one.alternatives
    ]
    unexplained = ""
    if verdict == "unknown effect":
        worst = int(np.argmax(naming.by_axis)) + 1
        left = 100 * max(naming.excess_after, 0) / max(naming.excess_before, 1e-9)
        unexplained = (
            f"the catalogue leaves {left:.0f} % of the gap's excess over the noise; most of it is "
            f"on axis {worst}"
        )
    return {
        "verdict": verdict,
        "effects": parts if known else [],
        "alternatives": others if known else parts,
        "gap": {
            "before": naming.gap_before,
            "calibrated": naming.gap_before,
            "after": naming.gap_after if known else naming.gap_before,
            "floor": naming.floor,
            "measure": MEASURE + ", on the last third of the motions, on which effects are chosen",
            "per_axis": list(naming.by_axis),
        },
        "where": [
            {"axis": axis, "regime": "all", "share": share}
            for axis, share in enumerate(naming.by_axis, start=1)
            if share > 0.05
        ],
        "calibration": {},
        "next_experiment": None,
        "unexplained": unexplained,
    }


def _validation(recording: Recording, robot: Robot, naming: Naming) -> dict[str, float]:
    """Gap on motions that played no part, against the model alone: no healthy twin of them."""
    effects = [(one.effect, one.axis, one.severity) for one in naming.effects]
    inside = settled(recording, robot)

    def gap(chosen: list[tuple[str, int, float]]) -> float:
        error = recording.torque - replay(recording, robot, chosen)
        return relative_error(error**2, recording, inside)

    return {"before": gap([]), "after": gap(effects)}


def _model_xml(robot: Robot, result: dict[str, Any]) -> str:
    """The robot's MJCF with the effects in it."""
    if not result["effects"]:
        return robot.xml
    spec = robot.spec()
    for one in result["effects"]:
        get_effect(one["effect"]).apply(spec, one["axis"], one["parameters"]["severity"])
    spec.compile()
    return spec.to_xml()

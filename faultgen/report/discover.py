"""Discovery with all of its files: the result, the model, the next experiment and the report.

result = discover("measured.h5", "puma560", healthy="healthy.h5", out="out")
result["verdict"], result["effects"]
"""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any

from faultgen.discovery.workflow import discover_from_files


def discover(
    measured: str | Path,
    robot: str | Path,
    healthy: str | Path | None = None,
    validate: str | Path | None = None,
    *,
    out: str | Path | None = None,
    workers: int = 1,
    exclude: Collection[str] = (),
    include: Collection[str] = (),
    width: float = 1.0,
    steady: bool = False,
    low_pass: float | None = None,
    cache: str | Path | None = None,
) -> dict[str, Any]:
    """Find the effect that a measured robot has and its model, or its healthy twin, lacks.

    Args:
        measured: Recording of the robot, see docs/measured.md.
        robot: Name of the robot, or path of its MJCF.
        healthy: Recording of the same motions before the change; None: the model is calibrated on
            the recording itself, and an effect has to be larger than the tolerances of the model.
        validate: Recording of other motions with the effect, for scoring only.
        out: Folder for ``discovery.json``, ``model.xml`` and ``report.html``; None: none written.
        workers: Processes; no effect on the result.
        exclude: Effects that are not considered.
        include: Effects beyond the usual ones that are, of `terms.OPTIONAL`.
        width: Tolerance of the model's own numbers (`terms.NUMBERS`) over the usual one: above 1
            for a model that is only roughly known. `calibrate` finds it.
        steady: Whether errors that last count in full, see `problem.plain`; else a part of them is
            taken for noise that drifts. For recordings that were filtered.
        low_pass: Cut-off [Hz] of a filter on recordings without a reference, whose measured
            position is followed, see `low_passed`; None: as they are.
        cache: Folder that keeps sensitivities for other recordings of the same program.

    Returns:
        The content of ``discovery.json``.

    Raises:
        InputError: A recording or an option cannot be used, or the two recordings are not of the
            same motions.
        SimulationFailed: The model diverges on the recorded motion.
    """
    result, found = discover_from_files(
        measured,
        robot,
        healthy,
        validate,
        workers=workers,
        exclude=exclude,
        include=include,
        width=width,
        steady=steady,
        low_pass=low_pass,
        cache=cache,
    )
    if out is not None:
        from faultgen.report.discovery_report import write_discovery

        write_discovery(Path(out), result, found)
    return result

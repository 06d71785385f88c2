"""Discovery from files to files: the result, the model, the next experiment and the report.

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
    """Find the physical effect that a measured robot has and its model lacks.

    Args:
        measured: Recording of the robot; docs/measured.md describes the format.
        robot: Name of the robot, or path of its MJCF file.
        healthy: Recording of the same motions from before the change. Without it, the model is
            first calibrated on the recording itself, and an effect is reported only if it is larger
            than the usual errors of a model.
        validate: Recording of other motions with the effect. It is used only to score the result.
        out: Folder for ``discovery.json``, ``model.xml``, ``report.html`` and, if there is one, the
            next experiment. With None, no files are written.
        workers: Number of processes. The result does not depend on it.
        exclude: Names of effects that are not considered.
        include: Names of effects that are considered only on request, of `candidates.OPTIONAL`.
        width: How uncertain the model's parameters (`candidates.NUMBERS`) are, as a multiple of the
            default. It is above 1 for a model that is only roughly known. `calibrate` finds it.
        steady: Whether long-lasting errors get full weight. Otherwise part of them is treated as
            drifting noise. Use it for recordings that were filtered; see `regression.plain`.
        low_pass: Cut-off frequency [Hz] of a low-pass filter for recordings without a reference
            position, in which the simulation follows the measured position. With None, they are
            not filtered.
        cache: Folder that keeps simulated sensitivities, so that later calls with recordings of the
            same program are faster.

    Returns:
        The content of ``discovery.json``.

    Raises:
        InputError: A recording or an option cannot be used, or `measured` and `healthy` are not
            recordings of the same motions.
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

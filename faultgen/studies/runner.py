"""Whole studies, one per chapter of the thesis: from simulation to tables and figures."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

from faultgen import plugins
from faultgen.dataset.experiment import check_seed
from faultgen.dataset.manifest import refuse_data
from faultgen.errors import InputError
from faultgen.fleet import Fleet, generate_fleet, open_fleet
from faultgen.monitoring.sensors import get_sensors, sensors_of
from faultgen.provenance import provenance
from faultgen.studies.figures import Figures, draw
from faultgen.studies.fleets import study_fleet
from faultgen.studies.names import STUDIES as STUDIES
from faultgen.system.files import write_text
from faultgen.system.parallel import check_workers

_MODULES = {
    "events": "faultgen.studies.chapter2_events.study",
    "classifiers": "faultgen.studies.chapter5_classifiers.study",
    "detection": "faultgen.studies.chapter3_detection.study",
    "detectability": "faultgen.studies.detectability.study",
    "isolation": "faultgen.studies.chapter6_isolation.study",
    "training-data": "faultgen.studies.chapter4_training_data.study",
}

REPORT_SEED = 2026
"""Root seed of the results in docs/. Methods were developed with other seeds."""


Parts = tuple[
    Callable[..., dict[str, Any]],
    Callable[[dict[str, Any]], list[dict[str, Any]]],
    Callable[[dict[str, Any]], str],
    Figures,
]
"""Functions of a study: run, goals, tables, figures."""


def run_study(
    name: str,
    out: Path,
    *,
    quick: bool = False,
    seed: int = REPORT_SEED,
    workers: int = 1,
    fleet: Path | None = None,
    robots: Sequence[str] = (),
    tasks: Sequence[str] = (),
    sensors: str | None = None,
    effects: Sequence[str] = (),
) -> dict[str, Any]:
    """Run a study and write ``results.json``, ``tables.md`` and ``figures/``.

    Args:
        name: Name of the study.
        out: Folder for the results. Intermediate files that it already contains are used again.
        quick: Whether to use fewer seeds.
        seed: Root seed of all random draws.
        workers: Number of processes. It has no effect on the results.
        fleet: Folder of a fleet, for the studies that use one. Default: a fleet is simulated.
        robots: Names of robots, or paths of MJCF files. Default: those of the thesis.
        tasks: Names of tasks, or paths of task files. Default: those of the thesis.
        sensors: Preset of sensors, or path of a sensors file; only for the study detectability.
            Default: realistic, or the sensors in the folder of the robot.
        effects: Names of effects; only for the study detectability. Default: all.

    Returns:
        The results.

    Raises:
        InputError: There is no such study, a fleet, robot or task is not suitable, or the study
            does not use a fleet.
    """
    if name not in STUDIES:
        raise InputError(f"unknown study '{name}': choose {', '.join(STUDIES)}")
    check_workers(workers)
    check_seed(seed)
    plan = study_fleet(name, seed, quick, robots, tasks)
    if fleet is not None and plan is None:
        raise InputError(f"study {name}: simulates its own data and takes no --fleet")
    if fleet is not None and (robots or tasks):
        raise InputError("give either --fleet, or --robot and --task for a new fleet")
    chosen: dict[str, Any] = {}
    if plan is None:
        chosen |= {"robots": tuple(robots)} if robots else {}
        chosen |= {"tasks": tuple(tasks)} if tasks else {}
    if sensors is not None and name != "detectability":
        raise InputError(f"study {name}: has its own noise and takes no --sensors")
    if effects and name != "detectability":
        raise InputError(f"study {name}: has its own effects and takes no --effect")
    if name == "detectability":
        chosen["effects"] = tuple(effects)
        chosen["sensors"] = get_sensors(sensors or sensors_of(robots) or "realistic")
    recorded = None if fleet is None else open_fleet(fleet)
    started = time.monotonic()
    refuse_data(out)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{out}: cannot be used as a folder ({error.strerror})") from None
    run, goals, tables, figures = PARTS[name](quick)
    of: Path | Fleet = out
    if plan is not None:
        of = recorded or generate_fleet(plan, out / "fleet", workers=workers, progress=True)
    try:
        found = run(of, seed=seed, workers=workers, **chosen)
    except InputError:
        if not any(out.iterdir()):
            out.rmdir()
        raise
    result = {
        "study": name,
        "faultgen_version": version("faultgen"),
        "made_by": str(provenance(_MODULES[name], plugins.ISOLATORS, plugins.DETECTORS)),
        "quick": quick,
        "goals": goals(found),
        **found,
    }
    write_text(out / "tables.md", tables(result))
    draw(figures, result, out / "figures")
    result["seconds"] = round(time.monotonic() - started, 1)
    write_text(out / "results.json", json.dumps(result, indent=1, allow_nan=False) + "\n")
    return result


def _detection(quick: bool) -> Parts:
    import faultgen.studies.chapter3_detection.study as study
    from faultgen.studies.chapter3_detection.figures import FIGURES
    from faultgen.studies.chapter3_detection.tables import goals, tables

    size = study.QUICK if quick else study.FULL
    return partial(study.run_detection, size=size), goals, tables, FIGURES


def _detectability(quick: bool) -> Parts:
    from faultgen.studies.detectability import place, study
    from faultgen.studies.detectability.figures import FIGURES
    from faultgen.studies.detectability.tables import goals, tables

    size = place.QUICK if quick else place.FULL
    return partial(study.run_detectability, size=size), goals, tables, FIGURES


def _isolation(quick: bool) -> Parts:
    import faultgen.studies.chapter6_isolation.study as study
    from faultgen.studies.chapter6_isolation.figures import FIGURES
    from faultgen.studies.chapter6_isolation.tables import goals, tables

    size = study.QUICK if quick else study.FULL
    return partial(study.run_isolation, size=size), goals, tables, FIGURES


def _events(quick: bool) -> Parts:
    import faultgen.studies.chapter2_events.study as study
    from faultgen.studies.chapter2_events.figures import FIGURES
    from faultgen.studies.chapter2_events.tables import goals, tables

    return study.run_events, goals, tables, FIGURES


def _classifiers(quick: bool) -> Parts:
    import faultgen.studies.chapter5_classifiers.study as study
    from faultgen.studies.chapter5_classifiers.figures import FIGURES
    from faultgen.studies.chapter5_classifiers.tables import goals, tables

    size = study.QUICK if quick else study.FULL
    return partial(study.run_classifiers, size=size), goals, tables, FIGURES


def _training(quick: bool) -> Parts:
    from faultgen.studies.chapter4_training_data.figures import FIGURES
    from faultgen.studies.chapter4_training_data.study import run_training
    from faultgen.studies.chapter4_training_data.tables import goals, tables

    return partial(run_training, quick=quick), goals, tables, FIGURES


PARTS = {
    "classifiers": _classifiers,
    "detectability": _detectability,
    "detection": _detection,
    "events": _events,
    "isolation": _isolation,
    "training-data": _training,
}

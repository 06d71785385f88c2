"""Making a fleet. Each robot has a file of its own, so that an interrupted call can be resumed."""

from __future__ import annotations

import tempfile
import time
from dataclasses import asdict
from pathlib import Path

from joblib import delayed
from threadpoolctl import threadpool_limits

from faultgen.dataset.manifest import FILE as MANIFEST
from faultgen.errors import InputError, SimulationFailed
from faultgen.fleet.data import PLAN, STORED, Fleet, open_fleet, read_robot
from faultgen.fleet.events import event_names
from faultgen.fleet.plan import FleetPlan
from faultgen.fleet.record import record_robot
from faultgen.fleet.robot_instance import draw_instance
from faultgen.fleet.tables import FLEET_ARRAYS, divide
from faultgen.provenance import Provenance, provenance
from faultgen.system.arrays import write_arrays
from faultgen.system.files import write_text
from faultgen.system.parallel import check_workers, in_parallel
from faultgen.system.progress import follow


def generate_fleet(
    plan: FleetPlan, out: str | Path, *, workers: int = 1, progress: bool = False
) -> Fleet:
    """Make a fleet, or the robots that are missing in it.

    Args:
        plan: The plan of the fleet.
        out: Folder for the fleet. Existing robots of the same plan are kept.
        workers: Number of processes. The result does not depend on it.
        progress: Whether to show a progress bar on stderr.

    Returns:
        The fleet.

    Raises:
        InputError: The folder cannot be written, or it holds another fleet or robots that another
            version of the code has made.
        StorageFailed: A file could not be written.
        SimulationFailed: A robot could not be simulated. The files of the others are kept.
    """
    out = Path(out)
    check_workers(workers)
    if (out / MANIFEST).is_file():
        raise InputError(f"{out}: holds a dataset; give another folder")
    try:
        (out / "robots").mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{out}: cannot be used as a folder ({error.strerror})") from None
    told = out / PLAN
    text = plan.model_dump_json(indent=1) + "\n"
    if told.is_file() and told.read_bytes() != text.encode():
        raise InputError(f"{out}: holds a fleet with another plan; give another folder")
    write_text(told, text)
    parts = divide([draw_instance(plan, k).fails for k in range(plan.robots)], plan.seed)
    left = [k for k in range(plan.robots) if not _is_done(_path(out, k), plan)]
    done = in_parallel(
        [delayed(_make)(plan, k, _path(out, k), parts[k]) for k in left],
        min(workers, max(len(left), 1)),
        ordered=False,
    )
    shown = follow(done, "simulating the fleet", len(left), "robot", progress)
    failed = [reason for reason in shown if reason]
    if failed:
        raise SimulationFailed(f"{len(failed)} of {plan.robots} robots failed: {failed[0]}")
    return open_fleet(out)


def estimate_fleet(plan: FleetPlan, *, workers: int = 1) -> tuple[float, int]:
    """Estimate what a fleet will take. The first robot is made in a temporary folder and measured.

    Args:
        plan: The plan of the fleet.
        workers: Number of processes that would simulate.

    Returns:
        Time [s] on this machine, if each worker has a processor core of its own, and size [bytes].

    Raises:
        SimulationFailed: The robot could not be simulated.
    """
    check_workers(workers)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.h5"
        start = time.perf_counter()
        reason = _make(plan, 0, path, "train")
        seconds = time.perf_counter() - start
        if reason:
            raise SimulationFailed(reason)
        size = path.stat().st_size
    rounds = -(-plan.robots // min(workers, plan.robots))
    return rounds * seconds, plan.robots * size


def _path(out: Path, number: int) -> Path:
    return out / "robots" / f"robot{number + 1:03d}.h5"


def _is_done(path: Path, plan: FleetPlan) -> bool:
    if not path.is_file():
        return False
    try:
        attributes = read_robot(path)[1]
    except InputError:
        path.unlink()
        return False
    made_by = Provenance.of(attributes)
    if made_by != _made_by():
        raise InputError(
            f"{path}: was made by {made_by}, but this is {_made_by()}; finish the fleet with that "
            "version, or give another folder"
        )
    return bool(attributes["plan_sha256"] == plan.sha256)


def _made_by() -> Provenance:
    return provenance("faultgen.fleet.record")


def _make(plan: FleetPlan, number: int, path: Path, split: str) -> str | None:
    """Simulate a robot and write its file. Return None, or the reason why that failed."""
    try:
        with threadpool_limits(1):  # sums in another order would differ in their last digits
            one = record_robot(plan, number)
    except (SimulationFailed, InputError) as error:
        return f"robot {number + 1}: {error}"
    arrays = {name: getattr(one, name) for name in STORED}
    arrays |= {f"truth/{name}": values for name, values in one.truth.items()}
    write_arrays(
        path,
        arrays,
        {
            "name": one.name,
            "robot": one.robot,
            "failed": one.failed,
            "axis": one.axis,
            "split": split,
            "robots": plan.robots,
            "days": plan.days,
            "seed": plan.seed,
            "event_names": " ".join(event_names(one.torque_indicator.shape[1])),
            "plan_sha256": plan.sha256,
            **asdict(_made_by()),
        },
        described=FLEET_ARRAYS,
    )
    return None

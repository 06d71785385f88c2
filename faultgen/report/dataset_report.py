"""The report of a dataset: its content, its signals, how they change with wear, and the isolators.

path = write_report("out")  # out/report.html
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from faultgen.analysis.plots import marker
from faultgen.analysis.transfer_entropy import net_transfer_entropy
from faultgen.dataset.reader import Dataset, open_dataset
from faultgen.dataset.stored_run import StoredRun
from faultgen.evaluation.isolate import TooFewCycles, isolate
from faultgen.evaluation.measurement_noise import one_series
from faultgen.evaluation.methods import Isolator
from faultgen.evaluation.outcomes import Isolation, table
from faultgen.evaluation.summary import Worst, summary, worst_runs
from faultgen.report.chart import SYMBOLS, Chart, axes, library, line, square_map
from faultgen.report.heat_map import severity_maps
from faultgen.report.page import markdown, page
from faultgen.report.robot_picture import RobotPicture, robot_picture, shapes_of
from faultgen.report.signals import (
    Place,
    in_words,
    joint_positions,
    signal_charts,
    stored_period,
)
from faultgen.report.terms import explained
from faultgen.simulation.operation import Operation
from faultgen.system.files import write_text
from faultgen.system.progress import Progress

_LINES = 4  # worn runs drawn for an axis
_MOST_CYCLES = 1000  # points of a line over cycles
_ROOM = 2_500_000  # characters of charts of signals; the page then has less than 5 MB


def write_report(
    folder: str | Path,
    result: Isolation | None = None,
    *,
    methods: Sequence[type[Isolator]] = (),
) -> Path:
    """Write ``report.html`` into a dataset's folder.

    Args:
        folder: Folder of the dataset.
        result: Results of the isolators. By default the isolators are run. If the runs are too
            short for them, the page says so and has all other charts.
        methods: Further isolators, if they are run.

    Returns:
        Path of the page.

    Raises:
        InputError: The dataset has no runs, or a file is damaged.
        StorageFailed: The page cannot be written.
    """
    dataset = open_dataset(folder)
    why_none = ""
    if result is None:
        try:
            result = isolate(dataset, methods=methods)
        except TooFewCycles as error:
            why_none = f"There are no results of isolators. {error}."
    toml = dataset.path / "experiment.toml"
    with Progress("drawing charts", None):
        places = list(_shown(dataset, result))
    pictures = [place["picture"] for place in places]
    text = page(
        "dataset.html",
        summary=summary(_worst(places), result),
        scenes=shapes_of(pictures),
        name=dataset.path.resolve().name,
        found=len(dataset.runs),
        planned=len(dataset.planned),
        cycles=sum(int(run["cycles"]) for run in dataset.runs),
        failed=list(dataset.failed.values()),
        places=places,
        answers=why_none if result is None else explained(markdown(table(result))),
        experiment=toml.read_text(encoding="utf-8") if toml.is_file() else None,
        library=library(),
    )
    path = dataset.path / "report.html"
    write_text(path, text)
    return path


def _shown(dataset: Dataset, result: Isolation | None) -> Iterator[dict[str, Any]]:
    """What the page shows of each robot and task."""
    room = _ROOM
    for robot, task, operation, runs in _places(dataset):
        place = Place.of(runs, dataset.input_of(runs[0], "robot"))
        charts, notes = signal_charts(place)
        worst = worst_runs(runs, place.robot)
        picture = _picture(place, worst)
        room -= sum(len(chart.json) for chart in charts) + len(picture.motion if picture else "")
        if room < 0:
            charts, picture, room = [], None, 0
            notes = ["The charts of signals are left out, because the page would become too large."]
        worn = [axis for axis in range(1, place.n_axes + 1) if place.worn(axis)]
        yield {
            "robot": robot,
            "worst": worst,
            "picture": picture,
            "maps": severity_maps(place, worst),
            "task": ", ".join(filter(None, [task, operation])),
            "axes": [
                (axis, f"{axis}" if axis in worn else f"{axis} (never worn)")
                for axis in range(1, place.n_axes + 1)
            ],
            "first": worn[0] if worn else 1,
            "charts": [*charts, _wear(place), *_isolation(runs, result, robot, task)],
            "notes": notes,
        }


def _worst(places: Sequence[dict[str, Any]]) -> dict[str, list[Worst]]:
    """The strongest effects of each robot, over all of its tasks."""
    found: dict[str, dict[tuple[str, int], Worst]] = {}
    for place in places:
        own = found.setdefault(place["robot"], {})
        for one in place["worst"]:
            known = own.get((one.effect, one.axis))
            if known is None or abs(one.severity) > abs(known.severity):
                own[one.effect, one.axis] = one
    return {robot: [own[key] for key in sorted(own)] for robot, own in found.items()}


def _picture(place: Place, worst: Sequence[Worst]) -> RobotPicture | None:
    """The robot in the healthy run, or in the first one; each axis has its strongest effect."""
    if place.robot is None:
        return None
    run = place.healthy or place.runs[0]
    position = joint_positions(run, place.robot)
    if position is None:
        position = run.read("command/reference_position").astype(float)
    shares = {
        axis: max(one.share for one in worst if one.axis == axis)
        for axis in {one.axis for one in worst}
    }
    texts = {
        axis: "up to " + ", ".join(one.text for one in worst if one.axis == axis) for axis in shares
    }
    return robot_picture(
        place.robot,
        position,
        stored_period(run),
        shares=shares,
        texts=texts,
        marked=sorted(shares)[:1],
    )


def _places(dataset: Dataset) -> Iterator[tuple[str, str, str, list[StoredRun]]]:
    """Each robot, task and operation with its runs."""

    def place_of(run: StoredRun) -> tuple[str, str, str]:
        return run["robot"], run["task"], str(Operation.of(dataset.planned[run.id]))

    for place in dict.fromkeys(map(place_of, dataset.runs)):
        yield *place, [run for run in dataset.runs if place_of(run) == place]


def _wear(place: Place) -> Chart:
    """Mean |torque| of each axis, in the healthy run and in runs in which that axis wears."""
    traces, told = [], []
    for axis in range(1, place.n_axes + 1):
        healthy = [run for run in place.runs if run["axis"] == 0][:1]
        worn = [run for run in place.runs if axis in run["axes"]][:_LINES]
        names = [in_words(run) for run in [*healthy, *worn]]
        for number, (name, run) in enumerate(zip(names, [*healthy, *worn], strict=True)):
            values = run.read("monitoring/mean_abs_torque")[:, axis - 1]
            every = -(-len(values) // _MOST_CYCLES)
            told_apart = name if names.count(name) == 1 else f"{name}, seed {run['seed']}"
            place_of_colour = number + 1 - len(healthy)  # that of the healthy run stays free
            traces.append(
                line(told_apart, values[::every], place_of_colour, start=1, step=every, axis=axis)
            )
            if worn and run is worn[0]:
                told.append(f"axis {axis} {values[0]:.3g} to {values[-1]:.3g}")
    return Chart(
        title="Mean torque of each cycle",
        traces=traces,
        layout=axes("cycle", "mean |motor torque| [N m]"),
        caption=f"Mean |motor torque| as stored: the healthy robot and up to {_LINES} runs in "
        "which the axis wears. Only samples within the speed window of the dataset count, by "
        "default motor speeds of 50 to 120 rad/s. The chart is empty if no sample is within it.",
        description="Lines of the mean absolute motor torque over cycles, healthy and worn. From "
        f"the first to the last cycle of a worn run, in N m: {', '.join(told) or 'no worn run'}.",
    )


def _isolation(
    runs: Sequence[StoredRun], result: Isolation | None, robot: str, task: str
) -> Iterator[Chart]:
    """Accuracy by severity, and net transfer entropy of a healthy and of a worn run."""
    outcomes = [] if result is None else result.outcomes
    here = [t for t in outcomes if (t.robot, t.task) == (robot, task) and t.level > 0]
    first = min((t.effect for t in here), default="")
    traces, told = [], []
    for number, method in enumerate(dict.fromkeys(t.method for t in here)):
        cells = [t for t in here if (t.effect, t.method) == (first, method)]
        if not cells:
            continue
        share = 100 * np.array([t.accuracy for t in cells])
        low, high = 100 * np.array([t.interval for t in cells]).T
        traces.append(
            line(
                method,
                share,
                number,
                x=100 * np.array([t.level for t in cells]) + 0.08 * number,
                mode="lines+markers",
                marker={"symbol": SYMBOLS[marker(number)], "size": 9},
                error_y={
                    "type": "data",
                    "array": np.maximum(high - share, 0).tolist(),
                    "arrayminus": np.maximum(share - low, 0).tolist(),
                    "thickness": 1,
                    "width": 3,
                },
            )
        )
        told.append(f"{method} {share[-1]:.0f} %")
    if traces:
        yield Chart(
            title="How often isolators name the worn axis",
            traces=traces,
            layout=axes("wear [%]", "right axis named [%]", range=[-3, 105]),
            caption=f"Share of runs with {first} in which the worn axis is named, with 95 % "
            "intervals. Methods are shifted sideways a little, so that no interval covers another.",
            description="Lines of the share of right answers over the wear, one for each method. "
            f"At the highest wear: {', '.join(told)}.",
        )
    for run, which in (
        (next((run for run in runs if run["axis"] == 0), None), "healthy"),
        (next((run for run in runs if run["axis"] > 0), None), "worn"),
    ):
        x = None if run is None else np.nan_to_num(one_series(run))
        if run is None or x is None or len(x) < 3 or x.shape[1] < 2:  # of one axis to itself
            continue
        net = net_transfer_entropy(x)
        if not net.any():  # too few cycles to tell anything
            continue
        largest = int(np.argmax(net.sum(axis=1))) + 1
        yield Chart(
            title=f"Net transfer entropy, {which} robot",
            traces=[square_map(net, "bit")],
            layout={
                "xaxis": {"title": {"text": "to axis"}, "type": "category"},
                "yaxis": {
                    "title": {"text": "from axis"},
                    "type": "category",
                    "autorange": "reversed",
                },
                "showlegend": False,
            },
            caption=f"Over all cycles of a run ({in_words(run)}), for one draw of the noise. The "
            "axis with the largest row is named as worn; a healthy robot, too, has such an axis.",
            description=f"Map of the net transfer entropy between the axes. Axis {largest} has "
            "the largest row.",
        )

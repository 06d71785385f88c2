"""Robots that are monitored for a long time: docs/twin.md."""

from __future__ import annotations

from typing import Any

from parts.part import Inputs, Part, table

_PAGE = "twin.md"
_MAKES = ("faultgen.twin.make", "faultgen.twin.train", "faultgen.dataset.sweep")

YEAR = Inputs(
    name="year",
    commands=(
        "python -m benchmarks.monitoring.monitored_year -o .",
        "faultgen twin healthy/h?.h5 --robot arm.xml -o my_robot",
        "faultgen generate --robot my_robot --task-from healthy/h0.h5 --axis 1,2,3,4 "
        "--effect friction_wear,backlash --severity friction_wear=0.4,backlash=0.0015 "
        "--cycles 12 --repetitions 2 -o data",
        "faultgen train data -o detector --false-alarms 0.1 --recordings-per-month 10",
    ),
    code=("monitoring.monitored_year", "laboratories.make", *_MAKES),
    minutes=15,
)
"""Recordings of a simulated year, and the detector of its robots."""

_LIVES = (
    "faultgen generate --robot $INPUTS/my_robot --task-from $INPUTS/healthy/h0.h5 --axis 1,2,3,4 "
    "--effect friction_wear --severity 0.4 --schedule {0} --cycles 40 --repetitions 5 "
    "--seed {1} -o {0}"
)


def growth(told: dict[str, Any]) -> str:
    """Time and memory for many robots, as a sentence."""
    return (
        f"With {told['robots']} robots and {told['recordings']} recordings of each, reading one "
        f"takes {told['ms_reading']:.0f} ms, judging it with all before it "
        f"{told['ms_judging']:.0f} ms, and all of them {told['hours_for_all']:.1f} h on one core. "
        f"The file of the memory has {told['memory_file_MiB']:.0f} MiB."
    )


def lives(told: dict[str, Any]) -> str:
    """Forecasts by the share of the life that is over."""
    ages = {name: one for name, one in told.items() if name.endswith("of the life")}
    columns = []
    for one in ages.values():
        own = one["as monitor"]
        count = own["forecasts"]
        columns.append(
            [
                f"{one['alarm']}; {one['right name']}",
                f"{own['coverage of 80 % intervals'] * count:.0f} of {count}",
                f"{100 * own['median error over the true time']:.0f} %",
            ]
        )
    names = [
        "robots with an alarm; the alarm names the fault",
        "true time within the interval of 80 %",
        "error of the median, over the true time",
    ]
    runs = next(iter(ages.values()))["runs"]
    first, *others = (name.replace("%", " %") for name in ages)
    head = [f"{runs} runs to failure, at", first, *(name.partition(" of")[0] for name in others)]
    return table(head, [list(row) for row in zip(names, *columns, strict=True)])


PARTS = (
    Part(
        name="monitor_lives",
        commands=(
            _LIVES.format("exponential", 77),
            _LIVES.format("sigmoid", 78),
            "python -m benchmarks.monitoring.monitor_lives $INPUTS/detector exponential sigmoid "
            "--limit 0.3 --out monitor_lives.json",
        ),
        code=("monitoring.monitor_lives", *_MAKES),
        inputs=YEAR,
        page=_PAGE,
        table=lives,
        minutes=8,
    ),
    Part(
        name="monitor_growth",
        commands=(
            "python -m benchmarks.monitoring.monitor_growth $INPUTS/detector "
            "$INPUTS/healthy/h0.h5 --robots 1000 --out monitor_growth.json",
        ),
        code=("monitoring.monitor_growth",),
        inputs=YEAR,
        page=_PAGE,
        table=growth,
        minutes=2,
    ),
)

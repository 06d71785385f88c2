"""The page of a monitor: robots by axis, alarms as sentences, and the course of each fault."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from faultgen.errors import InputError
from faultgen.recordings.read import read_recording
from faultgen.report.chart import Chart, axes, library, line
from faultgen.report.page import page
from faultgen.twin.alignment import find_cycles
from faultgen.twin.followed import Course, Followed, ProgramPlan, RobotPlan, State
from faultgen.twin.judge import Judge
from faultgen.twin.together import RobotState, robot_states
from faultgen.twin.warming import temperature_of

_SHADES = (  # from none to the limit; on a light and on a dark background
    [[0, "#f4f4f4"], [0.5, "#f6b26b"], [1, "#b3261e"]],
    [[0, "#23262b"], [0.5, "#a86418"], [1, "#ff6b5e"]],
)
_DOTTED = {"width": 0.8, "dash": "dot"}
_DETAILS = 20
"""Alarms whose charts are drawn; the others are sentences."""
_ROW, _LEAST = 22, 120  # height of a row of the map, and of the map without them [px]


def monitor_page(robots: Sequence[RobotState]) -> str:
    """Make the page.

    Args:
        robots: What is known of each robot.

    Returns:
        The HTML of the page.
    """
    alarms = sorted((one for one in robots if one.alarm), key=_since, reverse=True)
    programs = [one for robot in robots for one in robot.programs]
    silent = [one.sentence() for one in programs if one.answer is None]
    return page(
        "monitor.html",
        robots=len(robots),
        alarms=[
            {
                "sentence": one.sentence(),
                "programs": _programs(one),
                "charts": list(_charts(one)) if k < _DETAILS else [],
            }
            for k, one in enumerate(alarms)
        ],
        silent=silent,
        map=_map(robots),
        newest=max((one.answer["date"] for one in programs if one.answer), default="never")
        .replace("T", " ")
        .replace("+00:00", " UTC"),
        library=library(),
    )


def judge_page(judge: Judge) -> str:
    """Make the page of one program of one robot.

    Args:
        judge: Its detector with its memory.

    Returns:
        The HTML of the page.
    """
    detector = judge.detector
    name, task = detector.robot, detector.task
    program = ProgramPlan(name=task, detector=Path(), folder=Path())
    of = Followed(RobotPlan(name=name, program=[program]), program, judge)
    return monitor_page(robot_states([State(of, judge.latest())]))


def _since(one: RobotState) -> str:
    assert one.answer is not None
    return str(one.answer["since"])


def _programs(one: RobotState) -> list[str]:
    """A sentence for each program of a robot with several."""
    return [each.sentence() for each in one.programs] if len(one.programs) > 1 else []


def _map(robots: Sequence[RobotState]) -> Chart:
    """Severity over its limit, by robot and axis."""
    names = [one.robot.name for one in robots]
    n_axes = max(len(each.of.detector.torque_gain) for one in robots for each in one.programs)
    shares = np.zeros((len(names), n_axes))
    text = [["" for _ in range(n_axes)] for _ in names]
    for row, one in enumerate(robots):
        answer = one.answer
        if answer is None or not one.alarm:
            continue
        course = one.course
        share = min(abs(answer["severity"]) / course.limit, 1.0) if course else 1.0
        for axis in answer["axes"]:
            if share >= shares[row, axis - 1]:
                shares[row, axis - 1] = share
                text[row][axis - 1] = str(answer["effect"] or "unknown change")
    trace: dict[str, Any] = {
        "type": "heatmap",
        "x": [f"axis {k + 1}" for k in range(n_axes)],
        "y": names,
        "z": [[float(f"{x:.3g}") for x in row] for row in shares],
        "text": text,
        "texttemplate": "%{text}",
        "hovertemplate": "%{y}, %{x}: %{text} %{z:.0%} of the limit<extra></extra>",
        "zmin": 0,
        "zmax": 1,
        "xgap": 1,
        "ygap": 1,
        "colorbar": {"title": {"text": "of the limit"}, "tickformat": ".0%", "thickness": 12},
        "meta": {"scale": _SHADES, "axis": 0},
    }
    worst = [one.sentence() for one in robots if one.alarm]
    return Chart(
        title="Robots and axes",
        traces=[trace],
        caption="Severity of the fault that is named, over the limit of this robot. An unknown "
        "change is drawn as if it were at the limit.",
        description="; ".join(worst[:5]) or "No robot has an alarm.",
        layout={
            "xaxis": {"title": {"text": ""}, "side": "top"},
            "yaxis": {"autorange": "reversed", "title": {"text": ""}, "type": "category"},
            "height": _LEAST + _ROW * len(names),
            "showlegend": False,
        },
    )


def _charts(one: RobotState) -> Iterator[Chart]:
    """Charts of an alarm: the course of the fault, and the torque of the newest recording."""
    leading = one.leading or next(each for each in one.programs if each.alarm)
    if leading.course is not None:
        yield _course(leading, leading.course)
    torque = _torque(leading)
    if torque is not None:
        yield torque


def _course(one: State, course: Course) -> Chart:
    answer = one.answer
    assert answer is not None
    percent = answer["unit"] == "1"
    factor, unit = (100.0, "%") if percent else (1.0, answer["unit"])
    low, middle, high = factor * course.severities.T
    traces = [
        line(
            "each recording, with 95 % interval",
            middle,
            0,
            x=course.days,
            mode="markers",
            marker={"size": 5},
            error_y={
                "type": "data",
                "array": (high - middle).tolist(),
                "arrayminus": (middle - low).tolist(),
                "thickness": 0.8,
                "width": 0,
            },
        )
    ]
    end = 0.0
    if len(course.ahead):
        early, usual, late = factor * course.forecast
        seen = early <= 3 * factor * course.limit
        end = float(course.ahead[seen][-1]) if seen.any() else 0.0
        traces += [
            line("forecast, median", usual[seen], 1, x=course.ahead[seen]),
            line(
                "forecast, 80 %",
                early[seen],
                1,
                x=course.ahead[seen],
                line=_DOTTED,
            ),
            line(
                "forecast, 80 %",
                np.minimum(late[seen], 4 * factor * course.limit),
                1,
                x=course.ahead[seen],
                line=_DOTTED,
                showlegend=False,
            ),
        ]
    limit = factor * course.limit
    span = [float(course.days[0]), end]
    traces.append(line("limit", [limit, limit], 3, x=span, line={"width": 1.2, "dash": "dash"}))
    return Chart(
        title=f"{answer['effect']} of axis {' and '.join(map(str, answer['axes']))}",
        traces=traces,
        caption="Severity by the time from the newest recording. The scale of all severities of a "
        "robot may be wrong by the error of its model. The points do not show it; the forecast "
        "allows for it.",
        description=one.sentence(),
        layout=axes("time [days]", f"severity [{unit}]"),
    )


def _torque(one: State) -> Chart | None:
    """Torque of the newest recording over the healthy band, of the axis of the alarm."""
    answer, detector = one.answer, one.of.detector
    assert answer is not None
    try:
        recording = one.of.judge.in_torque(read_recording(Path(answer["recording"])))
        cycles = find_cycles(recording, detector.motion)
    except (InputError, OSError):  # it was moved since
        return None
    torque = detector.torque(cycles, temperature_of(recording))
    mean, deviation = detector.healthy
    axis = int(answer["axes"][0])
    period = detector.motion.sample_period
    own, usual, wide = torque[:, axis - 1], mean[:, axis - 1], 2 * deviation[:, axis - 1]
    return Chart(
        title=f"Torque of axis {axis} in {Path(answer['recording']).name}",
        traces=[
            line("healthy, 95 % of recordings", usual + wide, 2, step=period, line={"width": 0.6}),
            line(
                "healthy, 95 % of recordings",
                usual - wide,
                2,
                step=period,
                line={"width": 0.6},
                fill="tonexty",
                showlegend=False,
            ),
            line("this recording", own, 3, step=period),
        ],
        caption="Mean cycle of the newest recording, and the band of healthy recordings.",
        description=f"RMS torque {np.sqrt(np.mean(own**2)):.3g} N m; healthy "
        f"{np.sqrt(np.mean(usual**2)):.3g} N m.",
        layout=axes("time in the program [s]", "motor torque [N m]"),
    )

"""Draws the figures of docs/discovery_story.md from the files that its commands write.

    python -m benchmarks.discovery.story story real-arms docs/figures

story holds the two cases, and real-arms the results of benchmarks/real_robots/real_arms.py.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import matplotlib

matplotlib.use("Agg")  # no display needed

import matplotlib.pyplot as plt
import numpy as np
from faultgen.analysis.plots import COLOURS, legend_beside, style

from faultgen.discovery import Discovery, read_recording
from faultgen.robot import load_robot

SHOWN = 1.6  # time of the scoring motion that is shown [s]


def overlay(case: Path, axis: int, cache: Path, file: Path) -> None:
    """Draw what an answer explains of the gap of one axis, on the motion kept for scoring.

    Args:
        case: Folder of the case, with a healthy twin.
        axis: Axis, from 1.
        cache: Folder with the sensitivities.
        file: Figure to write.
    """
    recordings = [read_recording(case / f"{name}.h5") for name in ("measured", "healthy")]
    found = Discovery(load_robot("puma560"), cache=cache).fit(recordings[0], recordings[1])
    told, laws = found.answer_, found.laws_
    problem, k = found.problem_, axis - 1
    part = problem.parts[problem.scoring[0]]
    rows = slice(part.start, part.start + round(SHOWN / problem.recording.sample_period))
    time = np.arange(rows.stop - rows.start) * problem.recording.sample_period
    gap = problem.residual[rows, k]
    with style():
        figure, columns = plt.subplots(
            1, 1 + bool(laws), figsize=(9, 3), squeeze=False, width_ratios=[2, 1][: 1 + bool(laws)]
        )
        axes = columns[0, 0]
        axes.plot(time, gap, color="0.7", lw=0.6, label="recording minus baseline")
        explained = gap - told.left_torque[rows, k]
        axes.plot(time, explained, color=COLOURS[1], lw=1.2, label="explained")
        axes.set(xlabel="time [s]", ylabel=f"torque of motor {axis} [N m]")
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, frameon=False)
        if laws:
            term = laws[0].terms[0]
            columns[0, 1].plot(term["knots"], term["values"], color=COLOURS[1])
            columns[0, 1].set(xlabel="motor angle in a turn [rad]", ylabel="friction [N m]")
        figure.savefig(file)
        plt.close(figure)


def bars(errors: dict[str, list[float]], file: Path) -> None:
    """Draw the errors of an arm by axis and model.

    Args:
        errors: Relative RMS torque error of each axis [%], by model.
        file: Figure to write.
    """
    with style():
        figure, axes = plt.subplots(figsize=(9, 3))
        width = 0.8 / len(errors)
        for number, (label, values) in enumerate(errors.items()):
            place = np.arange(1, len(values) + 1) + (number - (len(errors) - 1) / 2) * width
            axes.bar(place, np.minimum(values, 110), width, label=label, color=COLOURS[number])
            for x, value in zip(place, values, strict=True):
                if value > 110:
                    axes.text(x, 111, f"{value:.0f}", ha="center", fontsize=7)
        axes.set(xlabel="axis", ylabel="RMS torque error [%]", ylim=(0, 122))
        legend_beside(axes)
        figure.savefig(file)
        plt.close(figure)


def main() -> None:
    """Write the three figures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    for name in ("story", "arms", "out"):
        parser.add_argument(name, type=Path)
    given = parser.parse_args()
    cache = given.story / "cache"
    overlay(given.story / "cases/case_19", 4, cache, given.out / "story_ripple.png")
    overlay(given.story / "cases/case_03", 3, cache, given.out / "story_law.png")
    errors = json.loads((given.arms / "errors.json").read_text())
    bars(errors["tx40"], given.out / "story_tx40.png")


if __name__ == "__main__":
    main()

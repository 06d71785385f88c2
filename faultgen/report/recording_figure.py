"""A picture of a recording: position and torque of each axis over time."""

from __future__ import annotations

import io

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from faultgen.analysis.plots import COLOURS, style
from faultgen.recordings.recording import Recording

_MOST_POINTS = 4000  # of a line; more are not visible


def recording_png(recording: Recording) -> bytes:
    """Draw a recording.

    Args:
        recording: The recording.

    Returns:
        The picture as PNG. The reference is dashed; dotted lines are the starts of segments.
    """
    count = len(recording.position)
    time = recording.sample_period * np.arange(count)
    every = max(1, count // _MOST_POINTS)
    shown = slice(None, None, every)
    for start in recording.segments[1:]:  # no line from the end of one recording to the next
        time[start // every * every] = np.nan
    what = "current [A]" if recording.current else "torque [N m or N]"
    with style():
        # without pyplot, which takes longer to import and looks for a display
        figure = Figure(figsize=(9, 0.6 + 1.3 * recording.n_axes))
        FigureCanvasAgg(figure)
        places = figure.subplots(recording.n_axes, 2, sharex=True, squeeze=False)
        for axis, (left, right) in enumerate(places):
            left.plot(time[shown], recording.position[shown, axis], lw=0.8)
            reference = recording.reference_position
            if reference is not None and recording.side == "joint":
                left.plot(time[shown], reference[shown, axis], "--", lw=0.8, color=COLOURS[1])
            right.plot(time[shown], recording.torque[shown, axis], lw=0.6, color=COLOURS[2])
            left.set_ylabel(f"axis {axis + 1}")
            for place in (left, right):
                for start in recording.segments[1:]:
                    place.axvline(recording.sample_period * start, color="0.4", lw=0.6, ls=":")
        places[0, 0].set_title(f"{recording.side} position [rad or m]")
        places[0, 1].set_title(f"{recording.side} {what}".replace("joint current", "current"))
        for place in places[-1]:
            place.set_xlabel("time without gaps [s]")
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png")
    return buffer.getvalue()

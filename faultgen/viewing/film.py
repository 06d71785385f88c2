"""Films and pictures of a robot that does its task, healthy and worn side by side.

Below the robots, the motor torque of the worn axis runs along with the motion, and beside it the
difference between the worn and the healthy robot.

    save_film(play("puma560", "spot_weld", axis=2, severity=0.5), Path("worn.gif"))
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any

import matplotlib

matplotlib.use("Agg")  # no display needed

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image, ImageDraw

from faultgen.errors import InputError
from faultgen.system.files import write_bytes
from faultgen.system.progress import follow
from faultgen.viewing.canvas import open_canvas
from faultgen.viewing.playback import Playback
from faultgen.viewing.stage import Stage

FILMS = (".gif", ".mp4")
"""Endings of the files that `save_film` writes."""

PICTURES = (".png",)
"""Endings of the files that `save_picture` writes."""

_LINES = {"healthy": {"color": "#5f6368", "lw": 1.6}, "worn": {"color": "#c1121f", "lw": 1.1}}
_CURSOR = (60, 60, 60)  # colour of the line that shows the time
_SIZE = {".gif": 320, ".mp4": 480, ".png": 640}  # of each robot's square picture [pixels]
_RATE = {".gif": 10.0, ".mp4": 25.0}  # pictures in a second; GIF counts hundredths of a second
_COLOURS = 64  # of a GIF
_DPI = 100
_IN_A_ROW = 4  # entries of the legend of one robot


def save_film(shown: Sequence[Playback], path: Path, *, progress: bool = False) -> str:
    """Write a film of one cycle. A GIF repeats without end.

    Args:
        shown: From `play`.
        path: File to write; its ending is one of `FILMS`.
        progress: Whether to show on stderr how far the drawing is.

    Returns:
        How the robots were drawn: 'egl', 'osmesa' or 'software'.

    Raises:
        InputError: The ending is another one, or what it needs is not installed.
        StorageFailed: The file cannot be written.
    """
    kind = _ending(path, FILMS)
    encode = _gif if kind == ".gif" else _mp4()
    times = np.arange(0, shown[0].times[-1], 1 / _RATE[kind]).tolist()
    with _Sheet(shown, _SIZE[kind]) as sheet:
        drawn = (sheet.draw(time, time) for time in times)
        content = encode(follow(drawn, "drawing", len(times), "picture", progress), _RATE[kind])
    write_bytes(path, content)
    return sheet.method


def save_picture(shown: Sequence[Playback], path: Path) -> str:
    """Write one picture: the robots in the middle of the cycle, and the torque of all of it.

    Args:
        shown: From `play`.
        path: File to write; its ending is one of `PICTURES`.

    Returns:
        How the robots were drawn: 'egl', 'osmesa' or 'software'.

    Raises:
        InputError: The ending is another one.
        StorageFailed: The file cannot be written.
    """
    size, times = _SIZE[_ending(path, PICTURES)], shown[0].times
    buffer = io.BytesIO()
    with _Sheet(shown, size) as sheet:
        sheet.draw(times[len(times) // 2], times[-1]).save(buffer, "png", optimize=True)
    write_bytes(path, buffer.getvalue())
    return sheet.method


def _ending(path: Path, known: Sequence[str]) -> str:
    kind = path.suffix.lower()
    if kind not in known:
        raise InputError(f"{path}: the name must end in {' or '.join(known)}")
    return kind


class _Sheet:
    """What all pictures of a film have in common: titles, axes, and the whole curves.

    The curves are drawn once. Each picture uncovers them up to its time.
    """

    method: str

    def __init__(self, shown: Sequence[Playback], size: int) -> None:
        self._shown = shown
        self._size = size
        self._stage = Stage(shown[0].robot, shown[0].position)
        self._opened = ExitStack()
        self._empty = self._layout(curves=False)
        self._full = self._layout(curves=True)

    def __enter__(self) -> _Sheet:
        canvas = open_canvas(self._stage, width=self._size, height=self._size)
        self._canvas = self._opened.enter_context(canvas)
        self.method = self._canvas.name
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._opened.close()

    def draw(self, time: float, until: float) -> Image.Image:
        """Draw one picture.

        Args:
            time: Time of the pose [s].
            until: Time up to which the curves are drawn [s].

        Returns:
            The picture.
        """
        picture = self._empty.copy()
        row = int(np.searchsorted(self._shown[0].times, time))
        for number, one in enumerate(self._shown):
            self._stage.pose(one.position[min(row, len(one.position) - 1)])
            self._stage.paint(one.axis)
            image = Image.fromarray(np.ascontiguousarray(self._canvas.draw()))
            picture.paste(image, (number * self._size, self._title))
        pen = ImageDraw.Draw(picture)
        for left, right, top, bottom in self._panels:
            column = round(left + (right - left) * until / self._shown[0].times[-1])
            part = (left, top, column, bottom)
            picture.paste(self._full.crop(part), part[:2])
            if column < right:
                pen.line([(column, top), (column, bottom)], fill=_CURSOR)
        return picture

    def _layout(self, *, curves: bool) -> Image.Image:
        """The picture without the robots; the places of the panels with curves are stored."""
        self._title = 2 * (self._size // 22)
        bottom = 2 * (self._size // (4 if len(self._shown) > 1 else 3))
        width, height = self._size * len(self._shown), self._title + self._size + bottom
        font = max(7.0, self._size / 46)
        with plt.rc_context(
            {"font.size": font, "axes.spines.top": False, "axes.spines.right": False}
        ):
            figure = plt.figure(figsize=(width / _DPI, height / _DPI), dpi=_DPI)
            for number, one in enumerate(self._shown):
                figure.text(
                    (number + 0.5) / len(self._shown),
                    1 - 0.5 * self._title / height,
                    one.name,
                    ha="center",
                    va="center",
                    size=1.1 * font,
                    color=_line(number)["color"],
                )
            place = (0.0, 0.0, 1.0, bottom / height)
            panels = self._draw_panels(figure, place, curves)
            figure.canvas.draw()
            buffer = np.asarray(figure.canvas.buffer_rgba())[..., :3].copy()  # type: ignore[attr-defined]
            self._panels = [self._inside(axes, height) for axes in panels]
            plt.close(figure)
        return Image.fromarray(buffer)

    def _draw_panels(
        self, figure: Figure, place: tuple[float, float, float, float], curves: bool
    ) -> list[Axes]:
        healthy, times = self._shown[0], self._shown[0].times
        left, bottom, width, height = place
        columns = len(self._shown)
        found = []
        for column in range(columns):
            box = (
                left + width * (column + 0.17) / columns,
                bottom + 0.27 * height,
                0.79 * width / columns,
                0.55 * height,
            )
            axes = figure.add_axes(box)
            found.append(axes)
            axes.set(xlabel="time [s]", xlim=(0, times[-1]))
            axes.grid(alpha=0.3)
        if columns == 1:
            found[0].set_title("motor torque of all axes [N m]", size="medium")
            lines = found[0].plot(times, healthy.torque, lw=1.1)
            figure.legend(
                lines,
                [f"axis {axis}" for axis in range(1, len(lines) + 1)],
                loc="lower center",
                bbox_to_anchor=(left + width / 2, bottom),
                ncols=min(len(lines), _IN_A_ROW),
                handlelength=1.2,
                columnspacing=1.2,
                fontsize="small",
                frameon=False,
            )
        else:
            worn = self._shown[1]
            column = worn.axis - 1
            torque = [healthy.torque[:, column], worn.torque[:, column]]
            found[0].set_title(f"motor torque of axis {worn.axis} [N m]", size="medium")
            found[1].set_title("worn minus healthy [N m]", size="medium")
            lines = [
                *(found[0].plot(times, one, **_line(k))[0] for k, one in enumerate(torque)),
                *found[1].plot(times, torque[1] - torque[0], **_line(1)),
            ]
        for axes in found:
            axes.margins(y=0.08)
        if not curves:
            for line in lines:
                line.set_visible(False)  # the ranges stay those of the whole curves
        return found

    def _inside(self, axes: Axes, height: int) -> tuple[int, int, int, int]:
        """Left, right, top and bottom of the inside of axes, in pixels of the picture."""
        box = axes.get_window_extent()
        return round(box.x0), round(box.x1), round(height - box.y1), round(height - box.y0)


def _line(number: int) -> dict[str, Any]:
    return _LINES["worn" if number else "healthy"]


def _gif(pictures: Iterator[Image.Image], rate: float) -> bytes:
    """Encode pictures as a GIF that repeats. All pictures share one table of colours."""
    first = next(pictures)
    kept = [first, *pictures]
    # the colours of a few pictures, side by side
    few = kept[:: max(1, len(kept) // 4)]
    strip = Image.new("RGB", (first.width * len(few), first.height))
    for number, one in enumerate(few):
        strip.paste(one, (number * first.width, 0))
    table = strip.quantize(_COLOURS, dither=Image.Dither.NONE)
    few_colours = [one.quantize(palette=table, dither=Image.Dither.NONE) for one in kept]
    buffer = io.BytesIO()
    few_colours[0].save(
        buffer,
        "gif",
        save_all=True,
        append_images=few_colours[1:],
        duration=round(1000 / rate),
        loop=0,
        optimize=False,
    )
    return buffer.getvalue()


def _mp4() -> Callable[[Iterator[Image.Image], float], bytes]:
    """The function that encodes MP4; looked up before hours of drawing.

    Raises:
        InputError: The package that encodes is not installed.
    """
    try:
        import av
    except ImportError:
        raise InputError("MP4 needs the package av: pip install av, or write a .gif") from None

    def encode(pictures: Iterator[Image.Image], rate: float) -> bytes:
        buffer = io.BytesIO()
        with av.open(buffer, "w", format="mp4") as film:
            stream = None
            for picture in pictures:
                if stream is None:
                    stream = film.add_stream("libx264", rate=round(rate))
                    stream.width, stream.height = picture.size
                    stream.pix_fmt = "yuv420p"
                film.mux(stream.encode(av.VideoFrame.from_image(picture)))
            if stream is not None:
                film.mux(stream.encode())
        return buffer.getvalue()

    return encode

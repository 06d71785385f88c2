"""Figures of analysis results in one style that is readable in print and for colour-blind people.

with style():
    figure, axes = plt.subplots()
    plot_net_transfer_entropy(axes, net_transfer_entropy(x))
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import matplotlib as mpl
import numpy as np
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.colors import hsv_to_rgb, to_hex
from numpy.typing import ArrayLike

# Okabe and Ito (2008), a palette that colour-blind people can tell apart, then brown, grey, violet
COLOURS = (
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#CC79A7",
    "#E69F00",
    "#56B4E9",
    "#000000",
    "#8C510A",
    "#8A8A8A",
    "#6A3D9A",
)
# the same hues, light enough for a dark background
DARK_COLOURS = (
    "#4C9FE0",
    "#FF8A3D",
    "#2FC79A",
    "#E39CC4",
    "#F2C445",
    "#9AD8FF",
    "#F4F4F4",
    "#B8803C",
    "#A3A3A3",
    "#B48AE8",
)
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*", "<", ">", "p", "h")


def marker(number: int) -> str:
    """Return the marker of a line by its number. The first twelve numbers have different markers.

    Args:
        number: From 0.

    Returns:
        The marker, as Matplotlib names it.
    """
    return MARKERS[number % len(MARKERS)]


def colour(number: int, *, dark: bool = False) -> str:
    """Return the colour of a line by its number. No two numbers have the same colour.

    Args:
        number: From 0.
        dark: Whether the background is dark. Colours are then lighter.

    Returns:
        The colour as #RRGGBB: one of the palette or, beyond it, one of a hue between those used so
        far, in one of three degrees of brightness.
    """
    palette = DARK_COLOURS if dark else COLOURS
    if number < len(palette):
        return palette[number]
    beyond = number - len(palette)
    hue = (0.5 + beyond * (np.sqrt(5) - 1) / 2) % 1  # golden section: never the same hue again
    bright = ((0.75, 0.85, 0.95) if dark else (0.55, 0.75, 0.95))[beyond % 3]
    red, green, blue = hsv_to_rgb((hue, 0.5 if dark else 0.9, bright)).tolist()
    return to_hex((red, green, blue))


@contextmanager
def style() -> Iterator[None]:
    """Apply the settings of all figures within a `with` block."""
    settings: Any = {
        "axes.prop_cycle": cycler(color=COLOURS),
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.grid": True,
        "grid.alpha": 0.3,
        "font.size": 9,
        "figure.dpi": 110,
        "legend.frameon": False,
        "legend.loc": "upper left",  # "best" searches for seconds among many points
        "figure.constrained_layout.use": True,
    }
    with mpl.rc_context(settings):
        yield


def legend_beside(axes: Axes) -> None:
    """Put the legend to the right of the axes, where it covers nothing.

    Args:
        axes: Axes with labelled lines or bars.
    """
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8)


def plot_net_transfer_entropy(
    axes: Axes, net: ArrayLike, title: str = "", largest: float | None = None
) -> None:
    """Plot net transfer entropy as a heat map; row i, column j is i -> j.

    Args:
        axes: Axes of the figure.
        net: Shape (n_axes, n_axes), in [bit].
        title: Title of the map.
        largest: Value of the darkest colour, so that maps can be compared. Default: the largest of
            this map.
    """
    net = np.asarray(net)
    largest = max(float(np.abs(net).max()) if largest is None else largest, 1e-12)
    axes.imshow(net, cmap="PuOr_r", vmin=-largest, vmax=largest)
    for (i, j), value in np.ndenumerate(net):
        if i != j:
            dark = abs(value) > 0.6 * largest
            axes.text(j, i, f"{value:.2f}", ha="center", va="center", color="w" if dark else "k")
    numbers = np.arange(1, len(net) + 1)
    axes.set_xticks(numbers - 1, [str(n) for n in numbers])
    axes.set_yticks(numbers - 1, [str(n) for n in numbers])
    axes.grid(False)
    axes.set(xlabel="to axis", ylabel="from axis", title=title)


def plot_series(axes: Axes, cycles: ArrayLike, values: ArrayLike, label: str, number: int) -> None:
    """Plot a line over cycles.

    Args:
        axes: Axes of the figure.
        cycles: Shape (cycles,).
        values: Shape (cycles,), in any unit.
        label: Name of the line.
        number: Number of the colour.
    """
    axes.plot(np.asarray(cycles), np.asarray(values), color=colour(number), label=label, lw=1.3)
    axes.set(xlabel="cycle")


def plot_accuracy(
    axes: Axes,
    levels: ArrayLike,
    shares: ArrayLike,
    intervals: ArrayLike,
    label: str,
    number: int,
) -> None:
    """Plot accuracy over wear, with its intervals.

    Args:
        axes: Axes of the figure.
        levels: Wear, shape (levels,), as a fraction.
        shares: Accuracy, shape (levels,), as a fraction.
        intervals: Lower and upper bound, shape (levels, 2).
        label: Name of the method.
        number: Number of the colour and marker.
    """
    wear, share = 100 * np.asarray(levels), 100 * np.asarray(shares)
    bounds = 100 * np.asarray(intervals).T
    errors = np.abs(bounds - share)
    axes.errorbar(
        wear + 0.12 * (number - 1),
        share,
        yerr=errors,
        label=label,
        color=colour(number),
        marker=marker(number),
        capsize=2,
        lw=1.2,
    )
    axes.set(xlabel="wear [%]", ylabel="right axis named [%]", ylim=(-3, 103))

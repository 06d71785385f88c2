"""Figures of monitoring: control charts, contributions, scores, divergence, detection delay.

with style():
    figure, axes = plt.subplots()
    plot_control_chart(axes, t2, {"95 %": limit_95, "99 %": limit_99}, "T²")
"""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import ArrayLike
from scipy.stats import f

from .plots import COLOURS, colour, marker

_LINES = ("--", "-", "-.", ":")
_DECADES = 1.5  # between the highest and the usual value; from here on the scale is logarithmic
_LEVELS = (0.95, 0.99)


def plot_control_chart(
    axes: Axes,
    values: ArrayLike,
    limits: Mapping[str, float],
    name: str,
    samples: ArrayLike | None = None,
) -> None:
    """Plot a statistic over samples with its limits. Samples above the highest limit are marked.

    The scale is logarithmic if the largest value, or a limit, is more than 30 times the median. On
    a linear scale the healthy values would look like 0.

    Args:
        axes: Axes of the figure.
        values: Statistic that raises an alarm when high, such as T² or Q. Shape (samples,).
        limits: Labels and values of the control limits.
        name: Name of the statistic.
        samples: Numbers of the samples, shape (samples,), or None for 1, 2, and so on.
    """
    statistic = np.asarray(values, dtype=float)
    numbers = np.arange(1, len(statistic) + 1) if samples is None else np.asarray(samples)
    axes.plot(numbers, statistic, color=COLOURS[0], marker=".", ms=3, lw=0.8)
    for k, (label, limit) in enumerate(sorted(limits.items(), key=lambda item: item[1])):
        line = _LINES[k % len(_LINES)]
        axes.axhline(limit, color="0.15", lw=1.1, ls=line, label=f"{label} limit")
    alarm = statistic > max(limits.values(), default=np.inf)
    if alarm.any():
        axes.plot(
            numbers[alarm],
            statistic[alarm],
            ls="",
            marker="o",
            ms=5,
            mfc="none",
            mec=COLOURS[1],
            label="alarm",
        )
    usual, highest = np.median(statistic), max([statistic.max(), *limits.values()])
    if usual > 0 and highest > 10**_DECADES * usual:
        # A single value near 0 must not take all the room.
        bottom = max(float(statistic[statistic > 0].min()), usual / 100)
        axes.set_yscale("log")
        axes.set_ylim(0.7 * bottom, 3 * highest)
    else:
        top = 1.2 * highest if highest > 0 else 1.0  # a statistic may be 0 throughout
        axes.set_ylim(min(0.0, 1.1 * statistic.min()), top)
    axes.legend(loc="upper left", ncols=3, fontsize=8, handlelength=2.5)
    axes.set(xlabel="sample", ylabel=name)


def plot_contributions(axes: Axes, contributions: ArrayLike, names: Sequence[str]) -> None:
    """Plot the contributions of variables to a statistic as bars, the largest on top.

    Args:
        axes: Axes of the figure.
        contributions: Shape (variables,). May be negative.
        names: Names of the variables.
    """
    share = np.asarray(contributions, dtype=float)
    order = np.argsort(share, kind="stable")
    places = np.arange(len(share))
    axes.barh(places, share[order], color=COLOURS[0], height=0.7)
    axes.set_yticks(places, [names[i] for i in order])
    axes.axvline(0, color="0.15", lw=0.8)
    axes.grid(False, axis="y")
    axes.set_axisbelow(True)
    axes.set(xlabel="contribution")


def plot_scores(
    axes: Axes,
    scores: ArrayLike,
    eigenvalues: ArrayLike,
    n_samples: int,
    groups: Sequence[str] | None = None,
) -> None:
    """Plot scores on two components with the 95 and 99 % ellipses of Hotelling's T².

        t1² / eigenvalue1 + t2² / eigenvalue2 = 2 (n² - 1) / (n (n - 2)) F(2, n - 2)

    Source: Tracy, Young and Mason (1992), Multivariate control charts for individual observations;
    the limit for samples that were not used in the fit.

    Args:
        axes: Axes of the figure.
        scores: Shape (samples, 2).
        eigenvalues: Variances of the two components in the fitted samples. Shape (2,).
        n_samples: Number of fitted samples, above 2.
        groups: Name of the group of each sample, or None for a single group.
    """
    points, variances = np.asarray(scores, dtype=float), np.asarray(eigenvalues, dtype=float)
    members = np.asarray([""] * len(points) if groups is None else groups)
    # Groups in the order in which they come
    for k, group in enumerate(dict.fromkeys(members.tolist())):
        own = points[members == group]
        axes.plot(
            own[:, 0],
            own[:, 1],
            ls="",
            marker=marker(k),
            ms=4,
            mfc="none",
            mec=colour(k),
            label=group or None,
        )
    angle = np.linspace(0, 2 * np.pi, 361)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    factor = 2 * (n_samples**2 - 1) / (n_samples * (n_samples - 2))
    for line, level in zip(_LINES, _LEVELS, strict=False):
        radius = np.sqrt(factor * f.ppf(level, 2, n_samples - 2) * variances)
        ellipse = radius[:, None] * circle
        axes.plot(*ellipse, color="0.15", lw=1.1, ls=line, label=f"{100 * level:.0f} % limit")
    # Room for the legend above all points
    bottom, top = axes.get_ylim()
    axes.set_ylim(bottom, top + 0.3 * (top - bottom))
    axes.legend(loc="upper left", ncols=2, fontsize=8, handlelength=2.5)
    axes.set(xlabel="component 1", ylabel="component 2")


def plot_divergence(
    axes: Axes, hours: ArrayLike, divergence: ArrayLike, names: Sequence[str] | None = None
) -> None:
    """Plot the divergence from the healthy distribution over time, one line per axis of the robot.

    Args:
        axes: Axes of the figure.
        hours: Time. Shape (times,), in [h].
        divergence: Shape (times, axes), in [bit].
        names: Names of the lines, or None for axis 1, axis 2, and so on.
    """
    times, lines = np.asarray(hours, dtype=float), np.asarray(divergence, dtype=float)
    if names is None:
        names = [f"axis {i + 1}" for i in range(lines.shape[1])]
    for k, (name, line) in enumerate(zip(names, lines.T, strict=True)):
        # Few markers, at other places on each line, so that lines in grey can be told apart
        every = max(1, len(times) // 8)
        axes.plot(
            times,
            line,
            color=colour(k),
            ls=_LINES[(k + 1) % len(_LINES)],
            marker=marker(k),
            markevery=(k * every // len(lines.T), every),
            ms=5,
            lw=1.3,
            label=name,
        )
    axes.legend(loc="upper left", fontsize=8, ncols=2, handlelength=3.5)
    axes.set(xlabel="time [h]", ylabel="KL divergence [bit]", ylim=(0, None))


def plot_detection_delay(
    axes: Axes, false_alarms_per_month: ArrayLike, delay: ArrayLike, label: str, number: int
) -> None:
    """Plot the delay of the alarm over the rate of false alarms. Low and to the left is good.

    Args:
        axes: Axes of the figure.
        false_alarms_per_month: Shape (points,), above 0.
        delay: Time from the fault to the alarm. Shape (points,), in [h].
        label: Name of the method.
        number: Number of the colour, line and marker.
    """
    delay = np.asarray(delay, dtype=float)
    # From 0 to above the highest line so far
    top = max([1.1 * delay.max()] + [axes.get_ylim()[1]] * len(axes.lines))
    axes.plot(
        np.asarray(false_alarms_per_month),
        delay,
        color=colour(number),
        ls=_LINES[(number + 1) % len(_LINES)],
        marker=marker(number),
        ms=4.5,
        lw=1.3,
        label=label,
    )
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set(xlabel="false alarms a month", ylabel="delay of detection [h]")
    axes.set_ylim(0, top if top > 0 else 1.0)

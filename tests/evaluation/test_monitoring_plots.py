"""The figures of monitoring carry the data they were given."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from faultgen.analysis.monitoring_plots import (
    plot_contributions,
    plot_control_chart,
    plot_detection_delay,
    plot_divergence,
    plot_scores,
)
from faultgen.analysis.plots import (
    COLOURS,
    colour,
    legend_beside,
    marker,
    plot_accuracy,
    style,
)
from matplotlib.colors import to_rgb, to_rgba

from faultgen.evaluation.detectors import DETECTORS
from faultgen.evaluation.isolators import ISOLATORS


@pytest.fixture
def axes():
    """Axes in the style of all figures."""
    with style():
        figure, axes = plt.subplots()
        yield axes
        figure.canvas.draw()
    plt.close(figure)


def line(axes, label):
    """Data of the line of that label. Shape (points, 2)."""
    return next(one.get_xydata() for one in axes.lines if one.get_label() == label)


def test_control_chart_marks_alarms(axes):
    """Values, limits and the samples above the highest limit are drawn; the scale is linear."""
    values = [1.0, 4.0, 6.0, 2.0, 7.0]
    plot_control_chart(axes, values, {"99 %": 5.0, "95 %": 3.0}, "T²", samples=[10, 11, 12, 13, 14])
    np.testing.assert_array_equal(axes.lines[0].get_xydata().T, [[10, 11, 12, 13, 14], values])
    np.testing.assert_array_equal(line(axes, "alarm"), [[12, 6], [14, 7]])
    assert np.all(line(axes, "95 % limit")[:, 1] == 3)
    assert np.all(line(axes, "99 % limit")[:, 1] == 5)
    assert axes.get_yscale() == "linear"
    assert axes.get_ylim()[1] > 7


@pytest.mark.parametrize("values", [[1.0, 2.0, 1.0, 500.0], [1.0, 2.0, 0.0, 500.0]])
def test_control_chart_turns_logarithmic(axes, values):
    """Where a fault dwarfs the healthy values, the scale is logarithmic; zeros do not harm."""
    plot_control_chart(axes, values, {"99 %": 5.0}, "Q")
    assert axes.get_yscale() == "log"
    low, high = axes.get_ylim()
    assert 0 < low < 1 < 500 < high


def test_control_chart_of_healthy_constant_values(axes):
    """Without alarms none is marked, and values of 0 are drawn on a linear scale."""
    plot_control_chart(axes, np.zeros(5), {"99 %": 5.0}, "Q")
    assert "alarm" not in [one.get_label() for one in axes.lines]
    assert axes.get_yscale() == "linear"


def test_contributions_are_sorted_with_their_names(axes):
    """The largest contribution is on top, each beside its own name."""
    plot_contributions(axes, [0.5, -1.0, 3.0], ["a", "b", "c"])
    assert [bar.get_width() for bar in axes.patches] == [-1.0, 0.5, 3.0]
    assert [text.get_text() for text in axes.get_yticklabels()] == ["b", "a", "c"]


def test_ellipses_are_the_limits_of_hotelling(axes):
    """Every point of an ellipse has the same T², which new samples exceed as often as it says."""
    rng = np.random.default_rng(0)
    plot_scores(axes, rng.normal(size=(30, 2)), [4.0, 0.25], 30)
    # The mean and covariance of 30 samples, and a new one, again and again
    fitted = rng.normal(size=(20_000, 30, 2))
    centred = fitted - fitted.mean(axis=1, keepdims=True)
    covariance = np.swapaxes(centred, 1, 2) @ centred / 29
    new = rng.normal(size=(20_000, 2)) - fitted.mean(axis=1)
    t2 = np.einsum("ij,ij->i", new, np.linalg.solve(covariance, new[..., None])[..., 0])
    for level in (0.95, 0.99):
        ellipse = line(axes, f"{100 * level:.0f} % limit")
        on_it = (ellipse**2 / [4.0, 0.25]).sum(axis=1)
        np.testing.assert_allclose(on_it, on_it[0])
        # Standard error at most 0.0015
        assert np.mean(t2 < on_it[0]) == pytest.approx(level, abs=0.006)


def test_scores_keep_their_groups(axes):
    """Each group has its points and a marker of its own."""
    scores = np.arange(8.0).reshape(4, 2)
    plot_scores(axes, scores, [1.0, 1.0], 30, ["worn", "healthy", "worn", "healthy"])
    np.testing.assert_array_equal(line(axes, "worn"), scores[::2])
    np.testing.assert_array_equal(line(axes, "healthy"), scores[1::2])
    assert len({one.get_marker() for one in axes.lines[:2]}) == 2


def test_divergence_has_a_line_an_axis(axes):
    """Six lines that differ in marker and, three by three, in dashes."""
    divergence = np.random.default_rng(1).uniform(size=(40, 6))
    plot_divergence(axes, np.arange(40) * 24, divergence)
    np.testing.assert_array_equal(line(axes, "axis 4")[:, 1], divergence[:, 3])
    assert len({one.get_marker() for one in axes.lines}) == 6
    assert len({one.get_linestyle() for one in axes.lines}) == 4


def test_delays_share_a_scale_that_holds_all(axes):
    """A later and higher curve is not cut off."""
    plot_detection_delay(axes, [0.1, 1, 10], [9, 5, 3], "EWMA", 0)
    plot_detection_delay(axes, [0.1, 1, 10], [90, 50, 30], "Q", 1)
    plot_detection_delay(axes, [0.1, 1, 10], [8, 4, 2], "CUSUM", 2)
    np.testing.assert_array_equal(line(axes, "Q"), [[0.1, 90], [1, 50], [10, 30]])
    assert axes.get_ylim()[0] == 0
    assert 90 < axes.get_ylim()[1] < 110
    assert to_rgba(axes.lines[1].get_color()) == to_rgba(COLOURS[1])


def test_legends_beside_cover_no_data(axes):
    """The legend is drawn outside the axes, and inside the figure."""
    axes.plot([0, 1], [0, 1], label="a line")
    legend_beside(axes)
    axes.figure.canvas.draw()
    legend, inside = axes.get_legend().get_window_extent(), axes.get_window_extent()
    assert legend.x0 >= inside.x1
    assert legend.x1 <= axes.figure.bbox.x1


def test_legends_without_a_place_do_not_search_for_one(axes):
    """A search takes longer the more points there are; the style puts legends into a corner."""
    axes.plot([0, 1], [0, 1], label="a line")
    axes.legend()
    axes.figure.canvas.draw()
    legend, inside = axes.get_legend().get_window_extent(), axes.get_window_extent()
    assert legend.x0 - inside.x0 < 0.1 * inside.width
    assert inside.y1 - legend.y1 < 0.1 * inside.height


def test_seven_methods_can_be_told_apart(axes):
    """As many methods as a dataset's report shows: each has its own colour and its own marker."""
    for number in range(7):
        plot_accuracy(axes, [0.01], [0.5], [(0.4, 0.6)], f"method {number}", number)
    assert len({bar.lines[0].get_color() for bar in axes.containers}) == 7
    assert len({bar.lines[0].get_marker() for bar in axes.containers}) == 7


@pytest.mark.parametrize("dark", [False, True])
def test_no_two_lines_have_the_same_colour(dark):
    """Also far beyond the palette, and on a dark background."""
    colours = np.array([to_rgb(colour(number, dark=dark)) for number in range(40)])
    distance = np.abs(colours[:, None] - colours[None]).max(axis=2) + np.eye(40)
    assert distance.min() > (0.02 if dark else 0.04)


@pytest.mark.parametrize("methods", [ISOLATORS, DETECTORS])
@pytest.mark.parametrize("dark", [False, True])
def test_no_two_methods_share_a_colour_or_a_marker(methods, dark):
    """Those of `faultgen isolate` and `detect`, and three more that a user may add."""
    count = len(methods) + 3
    colours = np.array([to_rgb(colour(number, dark=dark)) for number in range(count)])
    distance = np.abs(colours[:, None] - colours[None]).max(axis=2) + np.eye(count)
    assert distance.min() > 0.1
    assert len({marker(number) for number in range(count)}) == count


@pytest.mark.parametrize(("dark", "background"), [(False, 1.0), (True, 0.01)])
def test_colours_stand_out_from_the_background(dark, background):
    """Contrast as WCAG defines it, from relative luminance; the palette's lightest has 2."""
    for number in range(10):
        rgb = np.array(to_rgb(colour(number, dark=dark)))
        linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
        luminance = linear @ [0.2126, 0.7152, 0.0722]
        lighter, darker = max(luminance, background), min(luminance, background)
        assert (lighter + 0.05) / (darker + 0.05) > (4.5 if dark else 2), number

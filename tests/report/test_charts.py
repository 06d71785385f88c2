"""The charts of a dataset's report: they show what the dataset holds, and can be read by all."""

import base64
import gzip
import json
import re

import numpy as np
import pytest
from faultgen.analysis.plots import MARKERS

from faultgen.dataset.experiment import make_experiment
from faultgen.dataset.reader import open_dataset
from faultgen.dataset.sweep import generate
from faultgen.evaluation.isolate import isolate
from faultgen.report.chart import SYMBOLS, library
from faultgen.report.dataset_report import write_report
from faultgen.report.signals import Place, signal_charts
from faultgen.robot import load_robot
from faultgen.simulation.arm import Arm


@pytest.fixture(scope="module")
def dataset(tiny_robot_path, tiny_task_path, tmp_path_factory):
    out = tmp_path_factory.mktemp("charts") / "out"
    entries = {"robot": tiny_robot_path, "task": tiny_task_path, "cycles": 12, "severity": 0.5}
    generate(make_experiment(entries), out, progress=False)
    return open_dataset(out)


@pytest.fixture(scope="module")
def place(dataset, tiny_robot_path):
    return Place.of(dataset.runs, tiny_robot_path)


@pytest.fixture(scope="module")
def charts(place):
    found, notes = signal_charts(place)
    assert notes == []
    return {chart.title: chart for chart in found}


@pytest.fixture(scope="module")
def page(dataset):
    return write_report(dataset.path, isolate(dataset, seeds=2, progress=False)).read_text()


def numbers(values):
    """The array that plotly.js reads."""
    return np.frombuffer(base64.b64decode(values["bdata"]), "<f4")


def traces(chart, axis):
    """Traces that the browser shows for an axis, by name."""
    return {one["name"]: one for one in chart.traces if one["meta"]["axis"] in (0, axis)}


def test_torque_is_that_of_the_last_cycle(charts, place):
    """Of the healthy run and of the run in which the axis is worn, and their difference."""
    shown = traces(charts["Motor torque over a cycle"], 2)
    assert list(shown) == ["healthy", "axis 2: friction_wear 50 %", "worn minus healthy"]
    healthy = place.healthy.read("signals/motor_torque")[-1, :, 1]
    worn = place.worn(2).read("signals/motor_torque")[-1, :, 1]
    np.testing.assert_allclose(numbers(shown["healthy"]["y"]), healthy)
    np.testing.assert_allclose(numbers(shown["worn minus healthy"]["y"]), worn - healthy, atol=1e-6)
    assert shown["healthy"]["dx"] == pytest.approx(0.004)


def test_the_models_friction_goes_through_the_points(charts):
    """In steady sliding, for the healthy and for the worn robot."""
    shown = traces(charts["Friction against speed"], 1)
    for name in ("healthy", "axis 1: friction_wear 50 %"):
        speed, friction = (numbers(shown[name][key]) for key in "xy")
        curve = [numbers(shown[f"model, {name}"][key]) for key in "xy"]
        fast = np.abs(speed) > 0.5 * np.abs(speed).max()
        expected = np.interp(speed[fast], *curve)
        np.testing.assert_allclose(friction[fast], expected, rtol=0.02)
    low = numbers(shown["model, healthy"]["y"])
    high = numbers(shown["model, axis 1: friction_wear 50 %"]["y"])
    assert np.all(np.abs(high) > 1.05 * np.abs(low))


def test_the_path_is_that_of_the_tool(charts, place, tiny_robot_path):
    """Forward kinematics of the positions in the file."""
    shown = traces(charts["Path of the tool"], 1)
    assert list(shown) == ["commanded", "healthy", "axis 1: friction_wear 50 %"]
    position = place.healthy.read("truth/joint_position")[-1]
    found = np.stack([numbers(shown["healthy"][key]) for key in "xyz"], axis=1)
    point, _ = Arm(load_robot(tiny_robot_path)).tool_pose(position[0].astype(float))
    np.testing.assert_allclose(found[0], point, atol=1e-5)
    assert len(found) <= 400


def test_spectra_have_the_amplitude_of_a_wave(charts, place):
    """The largest amplitude of the last cycles, at its frequency."""
    shown = traces(charts["Spectrum of the motor torque"], 1)["healthy"]
    torque = place.healthy.read("signals/motor_torque")[-1, :, 0].astype(float)
    times = np.arange(len(torque)) * 0.004
    amplitude = numbers(shown["y"])
    at = int(np.argmax(amplitude))
    frequency = shown["x0"] + at * shown["dx"]
    wave = np.exp(-2j * np.pi * frequency * times)
    assert amplitude[at] == pytest.approx(2 * abs(np.mean(torque * wave)), rel=0.01)


def test_what_is_not_stored_is_named(tiny_robot_path, tiny_task_path, tmp_path):
    """Charts without their signals are left out, and the page says why."""
    entries = {"robot": tiny_robot_path, "task": tiny_task_path, "cycles": 2, "signals": "none"}
    generate(make_experiment(entries), tmp_path / "out", progress=False)
    runs = open_dataset(tmp_path / "out").runs
    found, notes = signal_charts(Place.of(runs, tiny_robot_path))
    assert [chart.title for chart in found] == ["Path of the tool"]
    assert "commanded" in {one["name"] for one in found[0].traces}
    assert len(notes) == 3 and "holds no signals/motor_torque" in notes[0]
    found, notes = signal_charts(Place.of(runs, "gone.xml"))
    assert found == [] and "the robot that made the dataset is not found" in notes[2]


def test_the_page_is_whole_and_small(page):
    """plotly.js is in it once, and nothing is loaded from elsewhere."""
    assert len(page) < 5_000_000
    (code,) = re.findall(r'id="library">([^<]*)<', page)
    assert b"plotly.js" in gzip.decompress(base64.b64decode(code))[:100]
    rest = page.replace(code, "")
    addresses = re.findall(r"(?:src|href)\s*=\s*(\S{15})", rest)
    assert addresses and set(addresses) == {'"data:image/png'}
    assert "fetch(" not in rest and "import(" not in rest


def test_every_chart_is_described(page):
    """A caption for everybody, and a text for those who cannot see it."""
    charts = re.findall(r'<figure class="chart"[^>]*>(.*?)</figure>', page, re.DOTALL)
    assert len(charts) == 7  # one map of transfer entropy is all zeros, and left out
    for chart in charts:
        (described,) = re.findall('role="img" aria-label="(.*?)"', chart)
        (caption,) = re.findall("<figcaption>(.*?)</figcaption>", chart, re.DOTALL)
        assert len(described) > 40 and len(caption) > 40 and described != caption


def test_legends_cover_no_data_and_colours_differ(page):
    """Legends stand below the axes; lines that are shown together have different looks."""
    pattern = r'class="chart"[^>]*>.*?type="application/json">(.*?)</script>'
    texts = re.findall(pattern, page, re.DOTALL)
    assert len(texts) == 7
    for text in texts:
        chart = json.loads(text)
        legend = chart["layout"]["legend"]
        assert legend["y"] < 0 and legend["yanchor"] == "top"
        for axis in (1, 2):
            shown = [one for one in chart["traces"] if one["meta"]["axis"] in (0, axis)]
            looks = [
                (*one["meta"]["colour"], one["mode"]) for one in shown if "colour" in one["meta"]
            ]
            assert len(set(looks)) == len(looks)


def test_every_marker_has_its_symbol():
    assert list(SYMBOLS) == list(MARKERS)
    assert len(set(SYMBOLS.values())) == len(MARKERS)


def test_the_library_is_the_same_every_time():
    """Reports of the same dataset are the same, byte for byte."""
    first = library()
    library.cache_clear()
    assert library() == first


def test_runs_that_are_too_short_for_isolators_are_shown(tiny_robot_path, tiny_task_path, tmp_path):
    experiment = make_experiment(
        {"robot": tiny_robot_path, "task": tiny_task_path, "axis": [1], "cycles": 2}
    )
    generate(experiment, tmp_path, progress=False)
    text = write_report(tmp_path).read_text()
    assert "There are no results of isolators." in text
    assert "an answer needs at least 5 cycles" in text
    assert "Motor torque over a cycle" in text

"""Pages of reports: every part is there, and texts from outside are shown, not interpreted."""

import re
from pathlib import Path
from types import SimpleNamespace

import jinja2
import matplotlib.pyplot as plt
import pytest

from faultgen.dataset.experiment import make_experiment
from faultgen.dataset.sweep import generate
from faultgen.evaluation.markdown import table
from faultgen.report import discovery_report, write_report
from faultgen.report.page import image, markdown, page

EFFECT = {
    "effect": "torque_ripple",
    "axis": 2,
    "confidence": 0.987,
    "gap_after": 0.01,
    "parameters": {"severity": 0.123456, "unit": "N m", "order": 4.0},
    "interval": {"severity": [0.1, 0.2]},
    "also": [{"value": 12.34, "interval": [10.0, 20.0], "unit": "N m at the joint"}],
}
FULL = {
    "verdict": "<b>ambiguous</b>",
    "summary": "Axis 2 has <i>ripple</i>.",
    "unexplained": "much & more",
    "effects": [EFFECT],
    "alternatives": [{"effect": "backlash", "axis": 3, "confidence": 0.5}],
    "next_experiment": {
        "task": "poses",
        "file": "next_experiment.toml",
        "separates": [{"effect": "backlash", "axis": 1}, {"effect": "brake_drag", "axis": 2}],
        "distance": 12.3,
        "now": 1.23,
    },
    "gap": {"before": 0.1, "calibrated": 0.09, "after": 0.01, "floor": 0.009, "measure": "RMS"}
    | {"per_axis": [{"axis": 1, "before": 0.1, "calibrated": 0.08, "after": 0.02, "floor": 0.03}]},
    "where": [{"axis": 1, "regime": "load", "share": 0.4, "intensity": 1.2, "p_value": 1e-5}],
    "calibration": {"Coulomb": {"1": 0.123456}},
    "warnings": ["<script>alert(1)</script>"],
    "seconds": 12.5,
}
EMPTY = {"effects": [], "alternatives": [], "next_experiment": None, "where": []}
EMPTY |= {"calibration": {}, "warnings": []}


@pytest.fixture
def seen():
    """What is said of the axes in the picture of the robot, of each page."""
    return []


@pytest.fixture
def shown(monkeypatch, seen):
    """Function that makes the page of a result and returns its text, one space between words."""
    for name in ("_steps", "_maps"):
        monkeypatch.setattr(discovery_report, name, lambda _: plt.figure(figsize=(1, 1)))
    monkeypatch.setattr(discovery_report, "robot_picture", lambda *_, **given: seen.append(given))
    monkeypatch.setattr(discovery_report, "torque_charts", lambda found: [])

    def make(result, baseline=False, beside=()):
        effects = [SimpleNamespace(effect=name) for name in beside]
        gearing = SimpleNamespace(joints=lambda position: position)
        robot = SimpleNamespace(effects=effects, name="arm", gearing=gearing)
        answer = SimpleNamespace(p_value=0.00123, robot=robot, left=((4, "joint angle"),))
        recording = SimpleNamespace(motor_position=lambda of: None, sample_period=0.004)
        problem = SimpleNamespace(baseline=baseline, robot=robot, recording=recording)
        found = SimpleNamespace(problem_=problem, answer_=answer, laws_=())
        return " ".join(discovery_report.discovery_page(result, found).split())

    return make


def test_a_page_shows_every_part_of_a_result(shown):
    text = shown(FULL, baseline=True, beside=["delay"])
    cells = "<td>torque_ripple</td><td>2</td><td>0.1235 [0.1, 0.2], N m; order 4</td>"
    cells += "<td>12.3 N m at the joint (10 to 20)</td><td>0.99</td>"
    assert cells in text
    assert "<td>backlash</td><td>3</td><td></td><td></td><td>0.50</td>" in text
    assert "Other effects that the data do not exclude" in text
    assert "MJCF cannot express delay. model.xml" in text
    assert "separates backlash of axis 1 and brake_drag of axis 2 by 12 standard" in text
    assert "<td>with torque_ripple of axis 2</td><td>0.0100</td>" in text
    row = ["1", "0.1000", "0.0800", "0.0200", "0.0300"]
    assert f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" in text
    assert re.search("<td>load</td><td>0.40</td> <td>1.20</td><td>1e-05</td>", text)
    assert "<td>Coulomb</td><td>1</td><td>0.1235</td>" in text
    assert "p = 0.0012. The discovery took 12.5 s." in text
    assert text.count("data:image/png;base64,") == 2


def test_a_page_begins_with_what_was_found(shown, seen):
    """One sentence, and a picture in which the axes that are meant are marked and described."""
    text = shown(FULL)
    first = re.search("<h1>.*?</h1> <p class=.lead.>(.*?)</p>", text)
    assert first and first[1] == "Axis 2 has &lt;i&gt;ripple&lt;/i&gt;."
    (picture,) = seen
    assert picture["marked"] == [2, 4]
    assert picture["shares"][2] == picture["shares"][4] == 1 > picture["shares"][3] > 0
    assert picture["texts"][4] == "a torque of no known form over the joint angle"
    assert picture["texts"][3] == "possibly backlash"


def test_a_page_leaves_out_the_parts_that_a_result_lacks(shown):
    text = shown(FULL | EMPTY)
    for title in ("Effects", "Next experiment", "Where the gap is", "Calibration", "MJCF"):
        assert title not in text
    rivals = shown(FULL | EMPTY | {"alternatives": FULL["alternatives"]})
    assert "Effects that explain the gap best" in rivals


def test_texts_are_not_interpreted_as_html(shown):
    """Names of files come into warnings and tables; the browser must show them as they are."""
    text = shown(FULL)
    assert "&lt;b&gt;ambiguous&lt;/b&gt;" in text and "Much &amp; more." in text
    assert "<script>alert" not in text and "&lt;script&gt;alert" in text
    assert markdown("<i>x</i>") == "<p>&lt;i&gt;x&lt;/i&gt;</p>\n"


def test_markdown_tables_become_html():
    html = markdown("One\nTwo\n\n| a | b |\n| --- | --- |\n| 1 | x < y |\n")
    assert "<p>One<br>\nTwo</p>" in html
    assert "<th>a</th>" in html and "<td>x &lt; y</td>" in html


def test_a_forgotten_value_is_an_error():
    with pytest.raises(jinja2.UndefinedError, match="'robot_name' is undefined"):
        page("discovery.html")


def test_figures_are_closed():
    figure = plt.figure(figsize=(1, 1))
    assert image(figure).startswith("data:image/png;base64,")
    assert not plt.fignum_exists(figure.number)


def test_tables_of_results_are_aligned_markdown():
    """Cells are shown as they are: no number is rounded or read again."""
    text = table(["name", "p"], [["a", "0.50"], ["longer", 1e-9]])
    lines = text.splitlines()
    assert len({len(line) for line in lines}) == 1
    assert [re.split(r"\s*\|\s*", line)[1:3] for line in lines[2:]] == [
        ["a", "0.50"],
        ["longer", "1e-09"],
    ]
    assert markdown(text).count("<tr>") == 3


def test_a_robot_of_one_axis_has_a_report(tmp_path):
    """It has no transfer entropy, which goes from one axis to another."""
    emps = Path(__file__).parents[2] / "docs" / "examples" / "emps" / "emps.xml"
    task = tmp_path / "move.toml"
    task.write_text(
        'description = "a move"\n[start]\njoints = [0.0]\n[[move]]\njoints = [0.02]\n'
        "[[move]]\njoints = [0.0]\n"
    )
    experiment = make_experiment(
        {"robot": str(emps), "task": str(task), "axis": [1], "severity": 0.3, "cycles": 4}
    )
    generate(experiment, tmp_path / "out", progress=False)
    page = write_report(tmp_path / "out").read_text()
    assert "Mean torque of each cycle" in page and "Net transfer entropy" not in page

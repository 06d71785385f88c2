"""What a reader of a report sees first: a sentence, the robot, and severity by axis and cycle."""

import base64
import html
import io
import json
import re
from types import SimpleNamespace

import numpy as np
import pytest
from fake_fleet import fake_fleet
from PIL import Image

from faultgen.dataset.experiment import make_experiment
from faultgen.dataset.reader import open_dataset
from faultgen.dataset.sweep import generate
from faultgen.discovery.summary import summary
from faultgen.evaluation.isolate import isolate
from faultgen.evaluation.summary import listed_axes
from faultgen.evaluation.summary import summary as of_dataset
from faultgen.report.dataset_report import write_report
from faultgen.report.discovery_charts import torque_charts
from faultgen.report.fleet_report import summary as of_fleet
from faultgen.report.heat_map import heat_map
from faultgen.report.page import page as make_page
from faultgen.report.robot_picture import colour_of, robot_picture
from faultgen.report.terms import explained
from faultgen.twin.likeness import summary as of_twin
from faultgen.viewing.stage import FAULTY, NO_FAULT


@pytest.fixture(scope="module")
def dataset(tiny_robot_path, tiny_task_path, tmp_path_factory):
    """Axis 2 of the tiny robot wears by 40 %; axis 1 never does."""
    out = tmp_path_factory.mktemp("pictures") / "out"
    entries = {"robot": tiny_robot_path, "task": tiny_task_path, "cycles": 12, "severity": 0.4}
    generate(make_experiment({**entries, "axis": [2]}), out, progress=False)
    return open_dataset(out)


@pytest.fixture(scope="module")
def result(dataset):
    return isolate(dataset, seeds=2, progress=False)


@pytest.fixture(scope="module")
def text(dataset, result):
    return write_report(dataset.path, result).read_text()


def test_a_dataset_begins_with_what_is_in_it(text):
    """Before anything else that is not a heading."""
    lead = re.search(r"<h1>[^<]*</h1>\s*<p[^>]*>([^<]*)</p>", text)
    assert lead and lead[1].startswith("Axis 2 of tiny has up to 40 % more friction; ")
    assert re.search(r"names? the worn axis in \d+ % of the runs with most wear\.$", lead[1])


def test_there_is_one_picture_of_the_robot(text):
    """It is seen without JavaScript, and says in words what its colours say."""
    without = re.sub(r"<script.*?</script>", "", text, flags=re.DOTALL)
    (picture,) = re.findall(r'<figure class="robot">(.*?)</figure>', without, re.DOTALL)
    (described,) = re.findall(r'<img alt="([^"]*)"', picture)
    expected = "axis 1 nothing, axis 2 up to 40 % more friction."
    assert html.unescape(described).endswith(expected)
    rows = re.findall(r'background: (#\w+)"></i>(axis \d: [^<]*)</li>', picture)
    assert rows == [
        (colour_of(0), "axis 1: nothing"),
        (colour_of(1), "axis 2: up to 40 % more friction"),
    ]
    assert re.findall(r"<text[^>]*>(\d)</text>", picture) == ["2"]
    assert "<canvas hidden" in picture and "The tables do not." not in picture


def test_the_motion_is_that_of_the_healthy_run(text, dataset):
    """As long as the chart of the torque, in which a line shows its time."""
    pattern = r'class="robot">.*?<script type="application/json">(.*?)</script>'
    motion = json.loads(re.search(pattern, text, re.DOTALL)[1])
    run = next(run for run in dataset.runs if run["axis"] == 0)
    duration = run.read("signals/motor_torque").shape[1] * run["sample_period"]
    assert motion["poses"]["duration"] == pytest.approx(duration)
    assert motion["shares"] == {"1": 0.0, "2": 1.0}
    (chart,) = re.findall(r'<figure class="chart" data-over-time>\s*<h4>(.*?)</h4>', text)
    assert chart == "Motor torque over a cycle"
    assert text.count(f'id="{motion["scene"]}"') == 1


def test_the_heat_map_shows_the_true_severity(text, dataset):
    """In per cent, of each cycle; the axis without a fault has no cells."""
    (part,) = re.findall(r'<figure class="heat">(.*?)</figure>', text, re.DOTALL)
    run = next(run for run in dataset.runs if run["axis"] == 2)
    truth = 100 * run.read("cycle/fault_severity/friction_wear")[:, 1]
    found = re.findall(r'background: (#\w+)" title="axis (\d), cycle (\d+): (\S+) %"', part)
    assert [(int(axis), int(cycle)) for _, axis, cycle, _ in found] == [
        (2, k) for k in range(1, 13)
    ]
    np.testing.assert_allclose([float(one[3]) for one in found], truth, rtol=0.01)
    assert found[-1][0] == colour_of(1) and found[0][0] == colour_of(truth[0] / truth[-1])
    assert '<th class="end">40 %</th>' in part


def test_terms_are_explained_where_they_appear(text):
    """In the table of the isolators, and in a list below it."""
    assert re.search(r'<td[^>]*><abbr title="[^"]*transfer entropy[^"]*">TE 10 bins</abbr>', text)
    assert re.search(r'<abbr title="[^"]*">Wilson interval</abbr>', text)
    for term in ("TE 10 bins", "CC", "Wilson interval"):
        assert re.search(rf"<dt>{term}</dt><dd>[A-Z][^<]{{20,}}\.</dd>", text)


def test_only_whole_terms_of_the_text_are_marked():
    """Neither parts of words, nor attributes of tags."""
    marked = explained('<td title="CC">CC</td><td>ACC</td>', {"CC": "a < b", "TE": "unused"})
    assert marked.startswith('<td title="CC"><abbr title="a &lt; b">CC</abbr></td><td>ACC</td>')
    assert marked.endswith('<dl class="terms"><dt>CC</dt><dd>A &lt; b.</dd></dl>')


def test_cycles_of_long_datasets_share_cells():
    """The largest severity counts, whichever its sign; gaps stay empty."""
    values = np.zeros((2, 150))
    values[0, 4], values[1] = -3.0, np.nan
    shown = heat_map(values, "mm")
    first, second = (row["cells"] for row in shown["rows"])
    assert len(first) == 50 and first[1] == {
        "colour": colour_of(1),
        "text": "axis 1, cycles 4 to 6: -3 mm",
    }
    assert {cell["text"] for cell in second} == {""} and shown["largest"] == "3 mm"


def test_colours_go_from_grey_to_red():
    assert colour_of(0) == "#" + "".join(f"{round(255 * one):02x}" for one in NO_FAULT)
    assert colour_of(1) == "#" + "".join(f"{round(255 * one):02x}" for one in FAULTY)


def test_the_marked_axis_is_red_in_the_picture(puma):
    """Red where its link is and nowhere else; its number stands beside its joint."""
    position = np.tile([0.4, 0.3, -1.5, 0, 0.5, 0], (3, 1))
    found = {}
    for share in (0.0, 1.0):
        drawn = robot_picture(
            puma, position, 0.1, shares={2: share}, texts={2: "x"}, marked=[2], moves=False
        )
        picture = Image.open(io.BytesIO(base64.b64decode(drawn.still.partition(",")[2])))
        rgb = np.asarray(picture.convert("RGB"), float)
        found[share] = (rgb[..., 0] > 1.8 * rgb[..., 1]) & (rgb[..., 0] > 60)
    assert not found[0.0].any()
    rows, columns = np.nonzero(found[1.0])
    (mark,) = drawn.marks
    joint = np.array([mark["x"], mark["y"]]) / 100 * len(rgb)
    assert len(rows) > 1000 and np.hypot(columns - joint[0], rows - joint[1]).min() < 15
    assert 5 < np.hypot(mark["u"] - mark["x"], mark["v"] - mark["y"]) < 15
    assert drawn.motion == "" and drawn.description.endswith("axis 6 nothing.")


def effect(axis, sentence):
    return {"effect": "friction_wear", "axis": axis, "sentence": sentence, "parameters": {}}


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, "Axis 2 has more friction."),
        ({"verdict": "no missing effect", "effects": []}, "No effect is missing: the model "),
        (
            {"verdict": "model not good enough", "effects": [], "model": {"reasons": ["a", "b"]}},
            "The model explains the recording too badly for an answer: a.",
        ),
        (
            {"verdict": "ambiguous", "alternatives": [{"effect": "brake_drag", "axis": 3}]},
            "Most likely axis 2 has more friction; the recording does not exclude brake drag of "
            "axis 3.",
        ),
        (
            {
                "verdict": "ambiguous",
                "effects": [],
                "alternatives": [{"effect": "delay", "axis": k} for k in (1, 2)],
            },
            "The recording does not decide between delay of axis 1 and delay of axis 2.",
        ),
        (
            {"verdict": "partly named", "unexplained": "30% of the gap remains"},
            "Axis 2 has more friction; 30% of the gap remains.",
        ),
        (
            {"verdict": "unknown effect", "effects": [], "unexplained": "an effect without a name"},
            "An effect without a name.",
        ),
        (
            {
                "verdict": "ambiguous",
                "effects": [effect(2, "axis 2 has more friction") | {"confidence": 0.93}],
            },
            "Most likely axis 2 has more friction, with a probability of 93 %.",
        ),
        (
            {"effects": [effect(k, f"axis {k} is worn") for k in range(1, 7)]},
            "Axis 1 is worn; axis 2 is worn; axis 3 is worn; and 3 more effects.",
        ),
    ],
)
def test_each_verdict_has_a_sentence(changes, expected):
    named = {"verdict": "named", "effects": [effect(2, "axis 2 has more friction")]}
    given = {**named, "alternatives": [], "unexplained": "", **changes}
    told = summary(given, baseline=False)
    assert told.startswith(expected) and told.endswith(".") and told.count(".") == 1


def test_nothing_found_beside_a_healthy_recording():
    given = {"verdict": "no missing effect", "effects": [], "alternatives": [], "unexplained": ""}
    assert summary(given, baseline=True).startswith("Nothing has changed since the healthy")
    day = [{"effect": "coulomb_friction", "axis": 4, "sentence": "axis 4 has more friction"}]
    assert summary({**given, "usual_differences": day}, baseline=True) == (
        "No effect is certain: axis 4 has more friction, which may be a difference between days. "
        "Further healthy recordings would tell."
    )


def test_axes_in_words():
    assert listed_axes([2]) == "axis 2"
    assert listed_axes({3, 1, 2}) == "axes 1 to 3"
    assert listed_axes([1, 2]) == "axes 1 and 2"
    assert listed_axes([1, 3, 4]) == "axes 1, 3 and 4"


def test_a_dataset_without_faults_or_answers_has_a_sentence():
    assert of_dataset({"tiny": []}, None) == "No axis of tiny has a fault."


def test_a_twin_is_told_in_one_sentence():
    told = of_twin("arm", {"auc": 0.514, "standard_error": 0.1}, [0.05, 0.119])
    assert told == (
        "A classifier tells generated from measured cycles of arm with an AUC of 0.51 ± 0.10 "
        "(0.5: not at all; 1: always); the model lacks most on axis 2, 11.9 % of RMS torque."
    )
    assert "was not tested" in of_twin("arm", {"auc": None}, [0.05, 0.119])


def test_a_fleet_is_told_in_one_sentence():
    fleet = fake_fleet(failed=3, normal=2, days=10)
    axes = {one.axis for one in fleet.robots if one.failed}
    told = of_fleet(fleet)
    assert told.startswith("3 of 5 robots fail at the end of 10 days: axis ")
    assert all(f"axis {axis} of puma560" in told for axis in axes)
    assert of_fleet(fake_fleet(failed=0, normal=1, days=10)).startswith("None of the 1 robot fails")


def test_torque_of_a_discovery_is_measured_less_what_is_missing():
    """The model's torque is the measured one less the gap; what was found explains a part of it."""
    times = np.arange(50)[:, None] * 0.01
    measured, gap, left = np.sin(times) + [[0.0, 1.0]], 0.1 + 0 * times + [[0.0, 0.1]], 0.01
    problem = SimpleNamespace(
        recording=SimpleNamespace(torque=measured, side="motor", sample_period=0.01),
        residual=gap,
        inside=np.ones((50, 2), bool),
        baseline=False,
    )
    answer = SimpleNamespace(left_torque=np.full((50, 2), left))
    torque, gaps = torque_charts(SimpleNamespace(problem_=problem, answer_=answer))

    def shown(chart, name, axis):
        (one,) = [t for t in chart.traces if t["name"] == name and t["meta"]["axis"] == axis]
        return np.frombuffer(base64.b64decode(one["y"]["bdata"]), "<f4")

    np.testing.assert_allclose(shown(torque, "measured", 2), measured[:, 1], atol=1e-6)
    given = shown(torque, "model as given", 2)
    np.testing.assert_allclose(given, measured[:, 1] - gap[:, 1], atol=1e-6)
    after = shown(torque, "with what was found", 2)
    np.testing.assert_allclose(after, measured[:, 1] - left, atol=1e-6)
    explained_part = shown(gaps, "explained by what was found", 1)
    np.testing.assert_allclose(explained_part, gap[:, 0] - left, atol=1e-6)
    assert torque.over_time and "axis 2 0.2 before and 0.01 after" in torque.description


def test_scripts_of_pages_are_whole():
    """They come from the package, and cannot end the element in which they stand."""
    text = make_page("robots.html", scenes={"robot-1": "{}"})
    assert "class RobotPicture" in text and "class Motion" in text and "moveCursor" in text
    assert text.count("</script>") == 2
    assert make_page("robots.html", scenes={}).strip() == ""

"""The gallery of effects: every effect, with what its simulation shows, in one file."""

import json
import re
from dataclasses import replace
from importlib import resources

import numpy as np
import pytest
from conftest import faultgen_here
from pages.effect_cases import CASES

from faultgen.effects import EFFECTS
from faultgen.report.gallery import gallery_page, picture


@pytest.fixture(scope="module")
def stored():
    """The curves that come with the package."""
    text = resources.files("faultgen.report").joinpath("gallery.json").read_text("utf-8")
    return json.loads(text)


def test_every_effect_has_curves_of_the_case_that_its_picture_shows(stored):
    assert list(stored) == list(EFFECTS)
    for name, told in stored.items():
        assert (told["severity"], told["axis"]) == (CASES[name].severity, CASES[name].axis), name
        for chart in told["charts"]:
            assert {len(one) for one in chart["y"]} == {len(chart["x"])}, name
            assert 20 < len(chart["x"]) <= 240, name


def test_curves_agree_with_formulas(stored):
    """A gain of the current sensor shows s times the torque; an offset shows itself everywhere."""
    gain = stored["torque_sensor_gain"]
    _, change = gain["charts"]
    x, y = np.array(change["x"]), np.array(change["y"][0])
    np.testing.assert_allclose(y, gain["severity"] * x, atol=np.ptp(y) / 200)
    offset = stored["torque_offset"]
    _, change = offset["charts"]
    np.testing.assert_allclose(np.abs(np.median(change["y"])), offset["severity"], rtol=0.02)


def test_a_picture_has_its_values_where_they_belong():
    """Larger values are higher up, the first is left, and the zero line is at 0."""
    drawn = picture(x=[0, 1, 2], y=[[-1.0, 0.0, 1.0]], lines=True, x_title="a", y_title="<b>")
    (path,) = re.findall(r'class="faulty" d="M([^"]+)"', drawn)
    points = np.array([[float(n) for n in pair.split()] for pair in path.split("L")])
    np.testing.assert_array_equal(points, [[5, 105], [120, 55], [235, 5]])
    assert 'class="zero" d="M0 55.0H240"' in drawn
    assert "&lt;b&gt; over a: -1 to 1" in drawn


def test_the_command_writes_one_file_that_needs_no_other(tmp_path):
    done = faultgen_here("effects", "--gallery", "-o", tmp_path / "new", "--json")
    assert done.returncode == 0, done.stderr
    (path,) = (tmp_path / "new").iterdir()
    assert json.loads(done.stdout) == {"gallery": str(path)}
    text = path.read_text()
    assert len(text) < 500_000
    assert not re.search(r"(?:src|href)=|url\(|@import", text)
    articles = re.findall(r'<article id="(\w+)">(.*?)</article>', text, re.DOTALL)
    assert [name for name, _ in articles] == list(EFFECTS)
    for name, article in articles:
        assert article.count("<svg") == 2, name


def test_an_effect_of_a_package_has_no_picture(monkeypatch):
    """It is listed all the same, and its text is not taken for HTML."""
    effect = replace(EFFECTS["friction_wear"], name="rust", description="<b>rust</b> grows")
    monkeypatch.setitem(EFFECTS, "rust", effect)
    article = gallery_page().split('<article id="rust">')[1]
    assert "<svg" not in article
    assert "there is no picture of it" in article
    assert "&lt;b&gt;rust&lt;/b&gt; grows." in article

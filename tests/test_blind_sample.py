"""Forty sealed cases, drawn as the 560 are: what holds of all of them holds of these."""

import json

import blind_discovery
import pytest
from sealed.score import score
from typer.testing import CliRunner


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["twin", "alone"])
def test_forty_cases(tmp_path, mode):
    """Healthy robots are called healthy, nothing fails, clear effects are right as often as usual.

    There are five effects at five times the limit. Without a twin, about half of all such effects
    are named (docs/results/blind.md), so that fewer than half of five say little.
    """

    def command(*words):
        done = CliRunner().invoke(blind_discovery.app, [*map(str, words)])
        assert done.exit_code == 0, done.output

    command("generate", "--mode", mode, "--count", 40, "--workers", 2, "-o", tmp_path)
    command("run", tmp_path, "--workers", 2)
    command("score", tmp_path)
    answers = blind_discovery.read_answers(tmp_path)
    truth = blind_discovery.read_truth(tmp_path / "sealed")
    assert len(answers) == 40
    rows = {row.measure: row.value for row in score(truth, answers)}
    assert rows["failed"] == 0
    assert rows["clean robots given an effect"] == 0
    assert rows["clean robots called unknown"] == 0
    assert rows["effect and axis right, 5 x limit"] >= (0.5 if mode == "twin" else 0.2)
    assert rows["wrong name, and sure of it, >= 2 x limit"] <= 0.2
    told = json.loads((tmp_path / "score.json").read_text())
    assert {row["measure"]: row["value"] for row in told if row["count"]} == {
        name: value for name, value in rows.items() if value == value
    }

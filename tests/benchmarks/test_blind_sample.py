"""Ten sealed cases, drawn as the 560 are, from making them to their score."""

import json

import pytest
from discovery import blind as blind_discovery
from discovery import score as score_discovery
from typer.testing import CliRunner


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["twin", "alone"])
def test_ten_cases(tmp_path, mode):
    """Every case gets an answer, and no healthy robot gets an effect."""

    def command(app, *words):
        done = CliRunner().invoke(app, [*map(str, words)])
        assert done.exit_code == 0, done.output
        return done.output

    words = ("generate", "--mode", mode, "--count", 10, "--workers", 2, "-o", tmp_path)
    digest = (command(blind_discovery.app, *words)).split()[-1]
    assert (tmp_path / "sealed" / "truth.sha256").read_text().strip() == digest
    command(score_discovery.app, "--trial", tmp_path, "--workers", 2)
    told = json.loads((tmp_path / "answers" / "score_all.json").read_text())
    (group,) = (name for name in told["groups"] if name != "all")
    assert group == ("with baseline" if mode == "twin" else "alone")
    assert told["groups"]["all"]["failed"]["hits"] == 0
    assert told["groups"]["all"]["false_alarm"] | {"low": 0, "high": 0} == {
        "hits": 0,
        "count": 2,
        "value": 0.0,
        "low": 0,
        "high": 0,
    }
    assert len(told["cases"]) == told["planned"]

"""The command that scores discovery: judgements, table and page, answers, frozen versions."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from discovery import score as score_discovery
from laboratories.files import write_truth
from scoring import answering, real, trials
from scoring.judging import REFUSED, judge
from scoring.table import by_factor, by_group, page, reliability, scores, share
from typer.testing import CliRunner

TRUTH: dict[str, Any] = {
    "name": "a",
    "group": "alone",
    "kind": "single",
    "effects": [{"name": "backlash", "axis": 2, "severity": 1e-3}],
    "factors": {"noise": "constant"},
    "stressed": ["noise"],
    "d_prime": 20.0,
    "separation": 9.0,
    "floor": 0.1,
}
HEALTHY = TRUTH | {"kind": "healthy", "effects": [], "d_prime": None, "separation": None}
BACKLASH = {"effect": "backlash", "axis": 2, "parameters": {"severity": 1.2e-3}}
DELAY = {"effect": "delay", "axis": 2, "parameters": {"severity": 1e-3}}


def said(verdict: str, *effects: dict[str, Any], **rest: Any) -> dict[str, Any]:
    """An answer."""
    return {"verdict": verdict, "effects": list(effects), "processor_seconds": 3.0, **rest}


def test_an_effect_by_hand() -> None:
    """First, named, sure and wrong, severity and gap of answers whose score is known."""
    gap = {"validation": {"before": 0.5, "after": 0.3}}
    row = judge(TRUTH, said("named", BACKLASH, gap=gap))
    assert (row.first, row.named, row.wrong, row.false_alarm) == (True, True, False, None)
    assert row.severity_error == pytest.approx(0.2)
    assert row.closed == pytest.approx((0.25 - 0.09) / (0.25 - 0.01)) and row.held_out == 0.3
    row = judge(TRUTH, said("ambiguous", BACKLASH, DELAY))
    assert (row.first, row.named, row.wrong) == (True, False, False)
    row = judge(TRUTH, said("named", DELAY, BACKLASH))
    assert (row.first, row.named, row.wrong, row.severity_error) == (False, False, True, None)
    row = judge(TRUTH, said("no missing effect"))
    assert (row.first, row.wrong, row.detectable, row.nameable) == (False, False, True, True)


def test_only_effects_that_can_be_told_count() -> None:
    """Faint effects, and those that look like another one, count for no share of right answers."""
    faint = judge(TRUTH | {"d_prime": 5.0}, said("named", DELAY))
    assert (faint.first, faint.wrong, faint.detectable, faint.nameable) == (None, True, True, True)
    assert judge(TRUTH | {"d_prime": 5.0}, said("named", BACKLASH)).severity_error is None
    hidden = judge(TRUTH | {"d_prime": 3.0}, said("no missing effect"))
    assert (hidden.first, hidden.detectable, hidden.nameable) == (None, False, False)
    alike = judge(TRUTH | {"separation": 3.0}, said("named", BACKLASH))
    assert (alike.first, alike.detectable, alike.nameable) == (None, True, False)
    unknown = judge(TRUTH | {"d_prime": None, "separation": None}, said("named", BACKLASH))
    assert (unknown.first, unknown.detectable, unknown.nameable) == (True, None, None)


def test_no_answer_is_not_a_wrong_one() -> None:
    """Abstaining and refusing are counted apart, and are no false alarm of a healthy robot."""
    for verdict, column in (
        ("model not good enough", "abstained"),
        ("refused", "refused"),
        ("failed", "failed"),
    ):
        row = judge(TRUTH, said(verdict))
        assert row.first is False and not row.wrong and getattr(row, column)
        row = judge(HEALTHY, said(verdict))
        assert row.false_alarm is False and getattr(row, column)
    assert judge(HEALTHY, said("ambiguous", DELAY)).false_alarm
    assert judge(HEALTHY, said("unknown effect")).false_alarm
    assert judge(HEALTHY, said("named", DELAY)).wrong
    assert judge(HEALTHY, said("no missing effect")).false_alarm is False


def test_what_is_beside_the_effect_counts_for_nothing() -> None:
    """A wrong gain of the log may be named as a torque constant, in healthy robots as well."""
    gain = {"effect": "torque_constant", "axis": 1, "parameters": {}}
    beside = {"beside": [{"name": "torque_constant", "axis": 1, "severity": 0.1}]}
    healthy = judge(HEALTHY | beside, said("named", gain))
    assert healthy.false_alarm is False and not healthy.wrong
    assert judge(TRUTH | beside, said("named", gain, BACKLASH)).named
    assert judge(HEALTHY | beside, said("named", gain, DELAY)).wrong
    elsewhere = {"effect": "torque_constant", "axis": 2, "parameters": {}}
    assert judge(HEALTHY | beside, said("named", elsewhere)).wrong


def test_unlisted_effects() -> None:
    """They are recognised as unknown, or by a learned law on their axis and nothing else."""
    odd = TRUTH | {"kind": "unlisted", "separation": None}
    law = {"effect": "learned", "axis": 2, "parameters": {}}
    assert judge(odd, said("unknown effect")).recognised
    learned = judge(odd, said("named", law))
    assert learned.recognised and not learned.wrong
    wrong = judge(odd, said("named", law | {"axis": 1}))
    assert wrong.recognised is False and wrong.wrong
    named = judge(odd, said("partly named", DELAY))
    assert named.recognised is False and named.wrong
    assert judge(odd | {"d_prime": 5.0}, said("unknown effect")).recognised is None


def test_stated_probabilities_are_compared_with_the_truth() -> None:
    """Rivals count, what is beside the effect and learned laws do not; Brier's score by hand."""
    gain = {"effect": "torque_constant", "axis": 1, "parameters": {}, "confidence": 1.0}
    law = {"effect": "learned", "axis": 2, "parameters": {}, "confidence": 1.0}
    answer = said(
        "ambiguous",
        gain,
        law,
        BACKLASH | {"confidence": 0.8},
        alternatives=[{"effect": "delay", "axis": 2, "confidence": 0.2}],
    )
    beside = {"beside": [{"name": "torque_constant", "axis": 1, "severity": 0.1}]}
    row = judge(TRUTH | beside, answer)
    assert row.stated == ((0.8, True), (0.2, False))
    wrong = judge(HEALTHY, said("named", DELAY | {"confidence": 1.0}))
    bins, brier = reliability([row, wrong])
    told = [
        (one["low"], one["stated"], one["share"]["hits"], one["share"]["count"]) for one in bins
    ]
    assert told == [(0.0, 0.2, 0, 1), (0.5, 0.8, 1, 1), (0.99, 1.0, 0, 1)]
    assert brier == pytest.approx((0.04 + 0.04 + 1.0) / 3)
    assert judge(TRUTH, said("model not good enough", alternatives=[DELAY])).stated == ()


def test_shares_and_page() -> None:
    """Counts, Wilson's interval, groups and factors; the page says set, plan and version."""
    rows = [
        judge(TRUTH, said("named", BACKLASH)),
        judge(TRUTH | {"name": "b"}, said("named", DELAY)),
        judge(HEALTHY | {"name": "c", "group": "with baseline"}, said("refused")),
        judge(HEALTHY | {"name": "d", "group": "with baseline"}, said("unknown effect")),
    ]
    one = share(rows, "first")
    assert (one["hits"], one["count"]) == (1, 2)
    assert one["low"] == pytest.approx(0.0945, abs=1e-3)  # Wilson, 1 of 2
    assert list(by_group(rows)) == ["alone", "with baseline", "all"]
    assert "alone, noise = constant" in by_factor(rows)
    assert "1/2 (50 %, 9–91)" in scores(by_group(rows))
    about = {"set": "report", "plan_sha256": "abc", "version": "v", "planned": 4, "skipped": {}}
    text = page(rows, about)
    for part in (
        "report set",
        "`abc`",
        "source v",
        "4 of 4",
        "**sure and wrong**",
        "no answer",
        "false alarm",
    ):
        assert part in text, part


def trial(folder: Path) -> Path:
    """A trial of two cases that are answered."""
    case = {
        "name": "case_1",
        "mode": "twin",
        "kind": "healthy",
        "robot": "puma560",
        "effects": [],
        "factors": {"noise": "by_motion", "robot": "puma560"},
    }
    write_truth([case, case | {"name": "case_2", "mode": "alone"}], folder / "truth.json")
    (folder / "mine").mkdir(parents=True)
    for name, verdict in (("case_1", "no missing effect"), ("case_2", "unknown effect")):
        (folder / "mine" / f"{name}.json").write_text(json.dumps(said(verdict)))
    return folder


def test_command_scores_what_is_answered(tmp_path: Path) -> None:
    """With all answers there, it makes none, and writes the table, the page and the file."""
    saved = tmp_path / "saved.json"
    words = ["--trial", str(trial(tmp_path)), "--answers", "mine", "--save", str(saved)]
    done = CliRunner().invoke(score_discovery.app, words)
    assert done.exit_code == 0, done.output
    told = json.loads(saved.read_text())
    assert told["groups"]["with baseline"]["false_alarm"]["hits"] == 0
    assert told["groups"]["alone"]["false_alarm"]["hits"] == 1
    assert told["planned"] == 2 and told["version"] == answering.version()
    assert "unknown effect" in (tmp_path / "mine" / "score.md").read_text()


def test_a_score_is_that_of_one_version(tmp_path: Path) -> None:
    """Answers of another version are refused, with what to do, and so is no folder."""
    folder = trial(tmp_path)
    (folder / "mine" / "version.txt").write_text("before\n")
    done = CliRunner().invoke(score_discovery.app, ["--trial", str(folder), "--answers", "mine"])
    assert done.exit_code == 2
    assert "is of version before" in " ".join(done.output.replace("│", " ").split())
    assert CliRunner().invoke(score_discovery.app, []).exit_code == 2


def test_arguments_of_the_public_command(tmp_path: Path) -> None:
    """Recordings that are there are named; a robot of the benchmark is its file."""
    folder = trial(tmp_path)
    (folder / "cases" / "case_1").mkdir(parents=True)
    (folder / "cases" / "case_1" / "validate.h5").touch()
    with_baseline, alone = trials.entries(folder)
    start = ["./cases/case_1/measured.h5", "--robot", "puma560"]
    others = ["--healthy", "./cases/case_1/healthy.h5", "--validate", "./cases/case_1/validate.h5"]
    assert with_baseline["discover"] == start + others
    assert alone["discover"] == ["./cases/case_2/measured.h5", "--robot", "puma560"]


def test_a_refusal_is_an_answer(tmp_path: Path) -> None:
    """Exit status 2 is kept with its message and processor time, and is not asked again."""
    entry = {"name": "x", "discover": ["./missing.h5", "--robot", "puma560"]}
    answering.answer(entry, tmp_path / "answers", tmp_path)
    path = tmp_path / "answers" / "x.json"
    told = json.loads(path.read_text())
    assert told["verdict"] == REFUSED and "missing.h5" in told["error"]
    assert 0 < told["processor_seconds"] < 60
    path.write_text("{}")
    answering.answer(entry, tmp_path / "answers", tmp_path)
    assert path.read_text() == "{}"


def test_absent_machines_say_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without its recordings, a real machine is left out with a reason."""
    monkeypatch.setattr(real, "DATA", tmp_path)
    with pytest.raises(FileNotFoundError, match="emps needs the recordings in"):
        real.make("emps", tmp_path)

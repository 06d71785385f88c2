"""Scores of discoveries on sealed cases, with Wilson intervals.

rows = score(truth, answers)
print(markdown(rows))
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from statsmodels.stats.proportion import proportion_confint

from faultgen.evaluation.markdown import table

Answer = dict[str, Any]
"""Content of a discovery.json, with ``seconds``; verdict 'failed' where it raised."""
Truth = dict[str, Any]
"""A case of truth.json."""
Key = tuple[str, int]
"""Effect and axis."""

SAME = {"brake_drag": "coulomb_friction"}
"""Names that are one effect in other units."""
NAMED, AMBIGUOUS, UNKNOWN, NOTHING = (
    "named",
    "ambiguous",
    "unknown effect",
    "no missing effect",
)
FAILED = "failed"
CLEAR = 2.0
"""Multiple of the limit from which a case counts as detectable."""


@dataclass(frozen=True)
class Row:
    """One measure. Shares have counts and an interval; medians have not."""

    measure: str
    value: float
    count: int
    low: float = float("nan")
    high: float = float("nan")
    share: bool = True

    def shown(self) -> str:
        """The value for people."""
        if not self.count:
            return "–"
        if not self.share:
            return f"{self.value:.3g}"
        return f"{100 * self.value:.1f} % ({100 * self.low:.1f} to {100 * self.high:.1f})"


def key(part: Mapping[str, Any]) -> Key:
    """Effect and axis of an entry of a result or of the truth."""
    name = str(part.get("effect", part.get("name")))
    return SAME.get(name, name), int(part["axis"])


def true_keys(truth: Truth) -> list[Key]:
    """What is in a case."""
    return [key(effect) for effect in truth["effects"]]


def answered(answer: Answer) -> list[Key]:
    """What an answer adds to the model, in its order; empty if it commits to nothing."""
    if answer["verdict"] not in (NAMED, AMBIGUOUS):
        return []
    return [key(part) for part in answer.get("effects", ())]


def answer_set(answer: Answer) -> set[Key]:
    """Effects and alternatives of an answer that commits to something."""
    if answer["verdict"] not in (NAMED, AMBIGUOUS):
        return set()
    return set(answered(answer)) | {key(part) for part in answer.get("alternatives", ())}


def _share(measure: str, hits: Iterable[bool]) -> Row:
    seen = list(hits)
    if not seen:
        return Row(measure, float("nan"), 0)
    low, high = proportion_confint(sum(seen), len(seen), method="wilson")
    return Row(measure, sum(seen) / len(seen), len(seen), float(low), float(high))


def _median(measure: str, values: Iterable[float]) -> Row:
    seen = np.array([value for value in values if np.isfinite(value)])
    middle = float(np.median(seen)) if len(seen) else float("nan")
    return Row(measure, middle, len(seen), share=False)


def gap_closed(answer: Answer) -> float:
    """(before - after) / (before - floor) of the answer's own gap."""
    gap = answer.get("gap") or {}
    before, after, floor = (gap.get(name) for name in ("before", "after", "floor"))
    if before is None or after is None or floor is None or before <= floor:
        return float("nan")
    return float((before - after) / (before - floor))


def gap_closed_by_refit(answer: Answer) -> float:
    """The same for calibration alone: what refitting the model's own numbers would do."""
    gap = answer.get("gap") or {}
    return gap_closed({"gap": {**gap, "after": gap.get("calibrated")}})


def severity_error(truth: Truth, answer: Answer) -> float:
    """Compute |estimate - severity| / severity of a single effect that was named correctly.

    Args:
        truth: The true effect.
        answer: The answer, which names this effect.

    Returns:
        The relative error.
    """
    (effect,) = truth["effects"]
    for part in answer.get("effects", ()):
        if key(part) == key(effect):
            estimate = part["parameters"].get("severity")
            if estimate is not None and part.get("effect") == effect["name"]:
                return float(abs(estimate - effect["severity"]) / effect["severity"])
    return float("nan")


def score(truth: Mapping[str, Truth], answers: Mapping[str, Answer]) -> list[Row]:
    """All measures over the cases that were answered.

    Args:
        truth: By the name of the case.
        answers: By the name of the case.

    Returns:
        One row a measure.
    """
    pairs = [(truth[name], answer) for name, answer in answers.items()]

    def of(kind: str, least: float = 0.0, most: float = np.inf) -> list[tuple[Truth, Answer]]:
        return [
            (t, a)
            for t, a in pairs
            if t["kind"] == kind and (kind == "clean" or least <= min(t["multiples"]) <= most)
        ]

    def right(t: Truth, a: Answer) -> bool:
        return answered(a)[:1] == true_keys(t)

    def effect_right(t: Truth, a: Answer) -> bool:
        return [name for name, _ in answered(a)[:1]] == [name for name, _ in true_keys(t)]

    clear = of("single", CLEAR)
    rows = [
        _share(f"effect and axis right, first answer, >= {CLEAR:g} x limit", _all(right, clear)),
        _share(f"effect right, first answer, >= {CLEAR:g} x limit", _all(effect_right, clear)),
    ]
    for multiple in sorted({m for t, _ in of("single") for m in t["multiples"]}):
        some = of("single", multiple, multiple)
        rows.append(_share(f"effect and axis right, {multiple:g} x limit", _all(right, some)))
    for multiple in sorted({m for t, _ in of("single") for m in t["multiples"]}):
        some = of("single", multiple, multiple)
        found = [a["verdict"] not in (NOTHING, FAILED) for _, a in some]
        rows.append(_share(f"something found, {multiple:g} x limit", found))
    committed = [(t, a) for t, a in clear if answer_set(a)]
    rows += [
        _share(
            f"true effect in the set, >= {CLEAR:g} x limit",
            (set(true_keys(t)) <= answer_set(a) for t, a in clear),
        ),
        _mean(
            "mean size of the set, where there is one", [len(answer_set(a)) for _, a in committed]
        ),
        _share(
            f"wrong name, and sure of it, >= {CLEAR:g} x limit",
            (a["verdict"] == NAMED and not right(t, a) for t, a in clear),
        ),
        _share("clean robots given an effect", (bool(answered(a)) for _, a in of("clean"))),
        _share("clean robots called unknown", (a["verdict"] == UNKNOWN for _, a in of("clean"))),
        _share("unknown called unknown", (a["verdict"] == UNKNOWN for _, a in of("unknown"))),
        _share(
            "unknown given a wrong name, and sure of it",
            (a["verdict"] == NAMED for _, a in of("unknown")),
        ),
        _share(
            "pairs: both exactly",
            (sorted(answered(a)) == sorted(true_keys(t)) for t, a in of("pair")),
        ),
        _share(
            "pairs: first answer is one of them",
            (
                set(answered(a)[:1]) <= set(true_keys(t)) and bool(answered(a))
                for t, a in of("pair")
            ),
        ),
        _median("gap closed, median", (gap_closed(a) for t, a in clear if right(t, a))),
        _median(
            "error of severity, median", (severity_error(t, a) for t, a in clear if right(t, a))
        ),
        _median("seconds a case, median", (a.get("seconds", np.nan) for _, a in pairs)),
        _share("failed", (a["verdict"] == FAILED for _, a in pairs)),
    ]
    refit = _median(
        "baseline, calibration only: gap closed, median",
        (gap_closed_by_refit(a) for t, a in clear if right(t, a)),
    )
    return [*rows, refit, *baselines([t for t, _ in pairs])]


def _all(
    test: Callable[[Truth, Answer], bool], pairs: Iterable[tuple[Truth, Answer]]
) -> list[bool]:
    return [test(t, a) for t, a in pairs]


def _mean(measure: str, values: list[int]) -> Row:
    return Row(
        measure, float(np.mean(values)) if values else float("nan"), len(values), share=False
    )


def baselines(truth: list[Truth]) -> list[Row]:
    """What answering always the same would score: the commonest effect, or 'unknown effect'."""
    singles = [t for t in truth if t["kind"] == "single" and min(t["multiples"]) >= CLEAR]
    common = Counter(k for t in singles for k in true_keys(t)).most_common(1)
    always = common[0][0] if common else None
    clean = [t for t in truth if t["kind"] == "clean"]
    unknown = [t for t in truth if t["kind"] == "unknown"]
    said = f"always {always[0]} on axis {always[1]}" if always else "always one effect"
    return [
        _share(
            f"baseline, {said}: effect and axis right", (true_keys(t) == [always] for t in singles)
        ),
        _share(f"baseline, {said}: clean robots given an effect", (True for _ in clean)),
        _share("baseline, always unknown: effect and axis right", (False for _ in singles)),
        _share("baseline, always unknown: unknown called unknown", (True for _ in unknown)),
        _share("baseline, always unknown: clean robots called unknown", (True for _ in clean)),
    ]


def confusion(
    truth: Mapping[str, Truth], answers: Mapping[str, Answer]
) -> tuple[list[str], list[str], np.ndarray]:
    """Count first answers by true effect, for clear single effects, unknown and clean cases.

    Args:
        truth: The truth by case.
        answers: The answers by case.

    Returns:
        Names of rows, names of columns, counts of shape (rows, columns).
    """
    counts: Counter[tuple[str, str]] = Counter()
    for name, answer in answers.items():
        case = truth[name]
        if case["kind"] == "pair" or (case["kind"] == "single" and min(case["multiples"]) < CLEAR):
            continue
        row = true_keys(case)[0][0] if case["kind"] == "single" else case["kind"]
        first = answered(answer)[:1]
        counts[row, first[0][0] if first else str(answer["verdict"])] += 1
    others = ("clean", "unknown")
    verdicts = (NOTHING, UNKNOWN, FAILED)
    rows = sorted({r for r, _ in counts} - set(others))
    columns = sorted(({c for _, c in counts} | set(rows)) - set(verdicts))
    rows, columns = [*rows, *others], [*columns, *verdicts]
    return rows, columns, np.array([[counts[r, c] for c in columns] for r in rows])


def markdown(rows: Iterable[Row]) -> str:
    """The rows as a table."""
    cells = [[row.measure, row.shown(), row.count] for row in rows]
    head = ["measure", "value (95 % interval)", "cases"]
    return table(head, cells) + "\n"

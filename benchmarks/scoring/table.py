"""Tables of scores with Wilson intervals (95 %), and the page.

text = page(rows, {"set": "development", ...})
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from scoring.judging import CLEAR, DETECTED, Row
from statsmodels.stats.proportion import proportion_confint

from faultgen.evaluation.markdown import table as markdown

SHARES = {
    "first": "clear effect first",
    "named": "clear effect named",
    "false_alarm": "healthy given an effect",
    "abstained": "abstained",
    "refused": "refused",
    "failed": "failed",
    "wrong": "sure and wrong",
    "recognised": "unlisted recognised",
}
"""Measures that are shares, with their columns."""
SHORT = ("first", "false_alarm", "abstained", "wrong", "recognised")
"""Those of `SHARES` that the documentation shows."""
MEDIANS = {
    "severity_error": "severity error, median",
    "closed": "gap closed, median",
    "seconds": "processor time [s], median",
}


def share(rows: Iterable[Row], measure: str) -> dict[str, Any]:
    """A share with its Wilson interval (95 %).

    Args:
        rows: The cases; those to which the measure does not apply are left out.
        measure: Of `SHARES`, or `detectable` or `nameable`.

    Returns:
        `hits`, `count`, `value`, `low` and `high`.
    """
    seen = [value for value in (getattr(row, measure) for row in rows) if value is not None]
    if not seen:
        return {"hits": 0, "count": 0, "value": None, "low": None, "high": None}
    low, high = proportion_confint(sum(seen), len(seen), method="wilson")
    return {
        "hits": int(sum(seen)),
        "count": len(seen),
        "value": sum(seen) / len(seen),
        "low": float(low),
        "high": float(high),
    }


def median(rows: Iterable[Row], measure: str) -> float | None:
    """Median of a measure over the cases that have it; None if there is none."""
    values = (getattr(row, measure) for row in rows)
    seen = [value for value in values if value is not None and math.isfinite(value)]
    return float(statistics.median(seen)) if seen else None


def by_group(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Rows by group, in the order in which groups appear, then all of them."""
    found: dict[str, list[Row]] = {}
    for row in rows:
        found.setdefault(row.group, []).append(row)
    return found | {"all": list(rows)}


def by_factor(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Rows of the laboratories by group and by the factor that was stressed, with its level."""
    found: dict[str, list[Row]] = {}
    for row in rows:
        for name in row.stressed:
            level = "all factors random" if name == "all" else f"{name} = {row.factors[name]}"
            found.setdefault(f"{row.group}, {level}", []).append(row)
    return dict(sorted(found.items()))


def _shown(one: Mapping[str, Any]) -> str:
    if not one["count"]:
        return "–"
    return (
        f"{one['hits']}/{one['count']} ({100 * one['value']:.0f} %, "
        f"{100 * one['low']:.0f}–{100 * one['high']:.0f})"
    )


def _number(value: float | None, factor: float = 1.0, unit: str = "") -> str:
    return "–" if value is None or not math.isfinite(value) else f"{factor * value:.3g}{unit}"


def short(groups: Mapping[str, Sequence[Row]]) -> str:
    """The measures that a reader looks for first, as a narrow Markdown table."""
    heads = ["answers", *(SHARES[measure] for measure in SHORT), MEDIANS["severity_error"]]
    lines = []
    for name, rows in groups.items():
        cells = [_shown(share(rows, measure)) for measure in SHORT]
        cells.append(_number(median(rows, "severity_error"), 100, " %"))
        lines.append([f"{name} ({len(rows)})", *cells])
    return markdown(heads, lines)


def scores(groups: Mapping[str, Sequence[Row]]) -> str:
    """All measures of all groups as a Markdown table."""
    heads = ["cases", *SHARES.values(), *MEDIANS.values(), "oracle: detectable", "nameable"]
    lines = []
    for name, rows in groups.items():
        cells = [_shown(share(rows, measure)) for measure in SHARES]
        cells.append(_number(median(rows, "severity_error"), 100, " %"))
        cells += [_number(median(rows, name)) for name in ("closed", "seconds")]
        cells += [_shown(share(rows, measure)) for measure in ("detectable", "nameable")]
        lines.append([f"{name} ({len(rows)})", *cells])
    return markdown(heads, lines)


def _verdict(row: Row) -> str:
    """Right, wrong, or what else an answer is."""
    if row.kind == "healthy":
        right = row.false_alarm is False
    else:
        right = bool(row.first if row.kind == "single" else row.recognised)
    if row.abstained or row.refused or row.failed:
        return "no answer"
    if right:
        return "right"
    if row.wrong:
        return "**sure and wrong**"
    if row.kind == "healthy":
        return "false alarm"
    counts = (row.first, row.recognised) != (None, None)
    return "missed" if counts else "too faint to count"


def cases(rows: Sequence[Row]) -> str:
    """Every case as a Markdown table, with the oracle beside it."""
    heads = ["case", "truth", "d′", "separation", "oracle", "answer", "", "severity error"]
    heads += ["held-out error", "processor time [s]"]
    lines = []
    for row in rows:
        oracle = {True: "nameable", False: "hidden" if row.detectable is False else "detectable"}
        lines.append(
            [
                row.name,
                row.truth,
                _number(row.d_prime),
                _number(row.separation),
                "–" if row.detectable is None else oracle[bool(row.nameable)],
                row.said,
                _verdict(row),
                _number(row.severity_error, 100, " %"),
                _number(row.held_out, 100, " %"),
                _number(row.seconds),
            ]
        )
    return markdown(heads, lines)


BINS = (0.0, 0.5, 0.9, 0.99, 1.0)
"""Borders of stated probabilities."""


def reliability(rows: Iterable[Row]) -> tuple[list[dict[str, Any]], float | None]:
    """Compare stated probabilities of effects with how often these are there.

    Args:
        rows: The cases.

    Returns:
        For each of `BINS` with any, `low`, `high`, the mean `stated` probability, and `share`, the
        share that is there as from `share`; and the Brier score, the mean squared difference of
        probability and truth (Brier 1950), None if nothing was stated.
    """
    every = [pair for row in rows for pair in row.stated]
    bins = []
    for low, high in zip(BINS[:-1], BINS[1:], strict=True):
        own = [pair for pair in every if low <= pair[0] < high or pair[0] == high == 1.0]
        if own:
            hits = sum(there for _, there in own)
            first, last = proportion_confint(hits, len(own), method="wilson")
            share_of = {"hits": hits, "count": len(own), "value": hits / len(own)}
            mean = statistics.mean(p for p, _ in own)
            seen = share_of | {"low": float(first), "high": float(last)}
            bins.append({"low": low, "high": high, "stated": mean, "share": seen})
    brier = statistics.mean((p - there) ** 2 for p, there in every) if every else None
    return bins, brier


def _stated(groups: Mapping[str, Sequence[Row]]) -> str:
    """Stated probabilities by group as a Markdown table."""
    heads = ["effects", *(f"{a:g} to {b:g}" for a, b in zip(BINS[:-1], BINS[1:], strict=True))]
    lines = []
    for name, rows in groups.items():
        bins, brier = reliability(rows)
        told = {one["low"]: f"{one['stated']:.2f}: {_shown(one['share'])}" for one in bins}
        lines.append([name, *(told.get(low, "–") for low in BINS[:-1]), _number(brier)])
    return markdown([*heads, "Brier score"], lines)


def results(rows: Sequence[Row]) -> str:
    """Scores and stated probabilities by set, in Markdown."""
    return f"""## By set

{scores(by_group(rows))}

## Stated probabilities

Of effects that were listed or alternatives, by the probability that the answer stated: its mean,
and how many of them are there.

{_stated(by_group(rows))}"""


def summary(rows: Sequence[Row]) -> str:
    """The results that the documentation shows, in Markdown."""
    return f"""{short(by_group(rows))}

Effects that were listed or alternatives, by the probability that the answer stated: its mean, and
how many of them are there.

{_stated({"all": rows})}"""


def shown(rows: Sequence[Row], about: Mapping[str, Any]) -> str:
    """Return the results of one version as the documentation shows them, in Markdown.

    Args:
        rows: All cases that were answered.
        about: As for `page`.
    """
    told = (
        f"{len(rows)} of {about['planned']} answers of the {about['set']} set, by source "
        f"{about['version']}; the SHA-256 of the drawn plan is `{about['plan_sha256']}`."
    )
    return f"{told}\n\n{summary(rows)}"


def page(rows: Sequence[Row], about: Mapping[str, Any]) -> str:
    """The page of a set.

    Args:
        rows: All cases that were answered.
        about: `set`, `plan_sha256`, `version`, `planned` (number of answers of the whole set) and
            `skipped` (reasons by batch).
    """
    skipped = "".join(f"- {name} was left out: {why}\n" for name, why in about["skipped"].items())
    return f"""# Score of discovery: the {about["set"]} set

`benchmarks/discovery/score.py` wrote this page: {len(rows)} of {about["planned"]} answers of one
version (source {about["version"]}), each by the public command `faultgen discover … --json` in a
process of its own, without a cache. The SHA-256 of the drawn plan is
`{about["plan_sha256"]}`.

- An effect is *clear* from d′ = {CLEAR:g} on. It counts if its separation from every other effect
  of its axis is at least {DETECTED:g}. The oracle calls it detectable from d′ = {DETECTED:g} on,
  and nameable if its separation is at least {DETECTED:g}, too. Where there is no oracle (own data,
  real machines, logs), every effect counts.
- *Abstained* is the verdict "model not good enough", *refused* an exit status of 2. Both count as
  not right for a clear effect, and as no false alarm for a healthy robot.
- *Sure and wrong* is a verdict "named" or "partly named" whose first effect is not there.
- Intervals are Wilson's (95 %). Cases of one laboratory share robot, motions and sensors, so that
  they are too narrow.
{skipped}
{results(rows)}

## Laboratories by factor

{scores(by_factor(rows))}

## All cases

{cases(rows)}
"""

"""Scores of answers on the cases of many laboratories, by mode and by factor.

row = judge(truth, answer)
print(table(rows, "noise"))
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from statsmodels.stats.proportion import proportion_confint

SAME = {"brake_drag": "coulomb_friction"}
"""Names that are one effect in other units."""
COMMITTED = ("named", "partly named", "ambiguous")
"""Verdicts that list effects as found."""
CERTAIN = ("named", "partly named")
NOTHING, UNKNOWN, FAILED, LEARNED = "no missing effect", "unknown effect", "failed", "learned"
MEASURES = {
    "first": "first answer right",
    "listed": "true effect in the listed set",
    "wrong": "sure and wrong",
    "healthy": "healthy called healthy",
    "unknown": "unlisted called unknown, or learned on the right axis",
    "failed": "failed",
}
"""Shares, with the columns of a table."""

Json = Mapping[str, Any]


@dataclass(frozen=True)
class Row:
    """One case with its answer. None where a measure does not apply to the case."""

    name: str
    mode: str
    kind: str
    truth: str
    said: str
    factors: dict[str, Any]
    first: bool | None
    listed: bool | None
    wrong: bool
    healthy: bool | None
    unknown: bool | None
    failed: bool
    closed: float
    """Share of the squared gap on the validation motions that the answer closes; may be nan."""
    seconds: float


def key(part: Json) -> tuple[str, int]:
    """Effect and axis of an entry of an answer or of the truth."""
    name = str(part.get("effect", part.get("name")))
    return SAME.get(name, name), int(part.get("axis") or 0)


def gap_closed(truth: Json, answer: Json) -> float:
    """Share of the squared gap on the validation motions that is closed.

    Args:
        truth: The case; `floor` is the gap that its noise alone leaves there.
        answer: Content of discovery.json.

    Returns:
        (before^2 - after^2) / (before^2 - floor^2); nan without figures, or without a gap to close.
    """
    gap = (answer.get("gap") or {}).get("validation") or {}
    before, after = gap.get("before"), gap.get("after")
    floor = truth.get("floor")
    if floor is None:
        floor = (answer.get("gap") or {}).get("floor")
    if before is None or after is None or floor is None or before <= 1.02 * floor:
        return math.nan
    return float((before**2 - after**2) / (before**2 - floor**2))


def judge(truth: Json, answer: Json) -> Row:
    """Compare an answer with the truth.

    Args:
        truth: An entry of truth.json.
        answer: Content of discovery.json; the verdict is 'failed' where discovery raised an error.
    """
    verdict = answer["verdict"]
    true = [key(effect) for effect in truth["effects"]]
    given = [key(effect) for effect in answer.get("effects", ())] if verdict in COMMITTED else []
    listed = set(given)
    if verdict in COMMITTED:
        listed |= {key(part) for part in answer.get("alternatives", ())}
    kind = truth["kind"]
    learned = [axis for name, axis in given if name == LEARNED]
    unknown = None
    if kind == "unlisted":
        named = [name for name, _ in given if name != LEARNED]
        unknown = verdict == UNKNOWN or (not named and learned == [true[0][1]])
    certain = verdict in CERTAIN
    wrong = certain and given[:1] != true
    if kind == "unlisted":
        wrong = certain and not unknown
    said = verdict
    if given:
        said += ": " + ", ".join(f"{name} {axis}" for name, axis in given)
    return Row(
        name=truth["name"],
        mode=truth["mode"],
        kind=kind,
        truth=", ".join(f"{e['name']} {e['axis']} ({e['severity']:.3g})" for e in truth["effects"])
        or "healthy",
        said=said,
        factors=dict(truth["factors"]),
        first=given[:1] == true if kind == "single" else None,
        listed=set(true) <= listed if kind == "single" else None,
        wrong=wrong,
        healthy=verdict == NOTHING if kind == "healthy" else None,
        unknown=unknown,
        failed=verdict == FAILED,
        closed=gap_closed(truth, answer) if kind != "healthy" else math.nan,
        seconds=float(answer.get("seconds", math.nan)),
    )


def share(rows: Iterable[Row], measure: str) -> dict[str, Any]:
    """A share with its Wilson interval (95 %).

    Args:
        rows: The cases; those to which the measure does not apply are left out.
        measure: Of `MEASURES`.

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


def _shown(one: Json) -> str:
    if not one["count"]:
        return "–"
    return (
        f"{one['hits']}/{one['count']} {100 * one['value']:.0f} % "
        f"({100 * one['low']:.0f}–{100 * one['high']:.0f})"
    )


def _median(values: Iterable[float]) -> float | None:
    seen = sorted(value for value in values if math.isfinite(value))
    if not seen:
        return None
    middle = len(seen) // 2
    return seen[middle] if len(seen) % 2 else (seen[middle - 1] + seen[middle]) / 2


def groups(rows: Sequence[Row], factors: Sequence[str]) -> dict[str, list[Row]]:
    """Rows by mode, and by mode and level of each factor.

    Args:
        rows: The cases.
        factors: Names of the factors.

    Returns:
        Rows by a name such as 'twin, noise = by_motion'.
    """
    found: dict[str, list[Row]] = {}
    for mode in ("twin", "alone"):
        some = [row for row in rows if row.mode == mode]
        if some:
            found[mode] = some
        for factor in factors:
            for level in sorted({str(row.factors.get(factor)) for row in some}):
                these = [row for row in some if str(row.factors.get(factor)) == level]
                found[f"{mode}, {factor} = {level}"] = these
    return found


def summary(rows: Sequence[Row], factors: Sequence[str]) -> dict[str, Any]:
    """All measures of all groups, for JSON."""
    out: dict[str, Any] = {}
    for name, some in groups(rows, factors).items():
        out[name] = {measure: share(some, measure) for measure in MEASURES}
        out[name]["gap_closed_median"] = _median(row.closed for row in some)
        out[name]["seconds_median"] = _median(row.seconds for row in some)
    return {"groups": out, "cases": [asdict(row) for row in rows]}


def table(rows: Sequence[Row], factors: Sequence[str] = ()) -> str:
    """The measures of all groups as a Markdown table."""
    heads = [*MEASURES.values(), "gap closed, median", "seconds, median"]
    lines = ["| cases | " + " | ".join(heads) + " |", "| --- " * (len(heads) + 1) + "|"]
    for name, some in groups(rows, factors).items():
        cells = [_shown(share(some, measure)) for measure in MEASURES]
        for value in (_median(r.closed for r in some), _median(r.seconds for r in some)):
            cells.append("–" if value is None else f"{value:.2g}")
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"

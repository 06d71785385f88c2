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
    "nameable": "first answer right, where the oracle could name it",
    "axis": "axis of the first answer right",
    "wrong": "sure and wrong",
    "healthy": "healthy called healthy",
    "unknown": "unlisted called unknown, or learned on the right axis",
    "found": "effect found",
    "oracle": "oracle would find it",
    "oracle_names": "oracle would name it, where clear",
    "failed": "failed",
}
"""Shares, with the columns of a table. The first four and `unknown` count clear effects only."""
CLEAR = 7.0
"""d' of the oracle from which an effect counts as clear: about twice the limit."""
DETECTED = 4.0
"""d' of the limit."""

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
    stressed: list[str]
    d_prime: float | None
    first: bool | None
    listed: bool | None
    nameable: bool | None
    axis: bool | None
    wrong: bool
    healthy: bool | None
    unknown: bool | None
    found: bool | None
    oracle: bool | None
    oracle_names: bool | None
    failed: bool
    closed: float | None
    """Share of the squared gap on the validation motions that the answer closes."""
    own_closed: float | None
    """The same on the part of the recording that the answer says it did not fit."""
    seconds: float


def key(part: Json) -> tuple[str, int]:
    """Effect and axis of an entry of an answer or of the truth."""
    name = str(part.get("effect", part.get("name")))
    return SAME.get(name, name), int(part.get("axis") or 0)


def gap_closed(gap: Json, floor: float | None) -> float | None:
    """Share of a squared gap that is closed.

    Args:
        gap: `before` and `after`.
        floor: The gap that noise alone leaves.

    Returns:
        (before^2 - after^2) / (before^2 - floor^2); None without figures or a gap to close.
    """
    before, after = gap.get("before"), gap.get("after")
    if before is None or after is None or floor is None or before <= 1.02 * floor:
        return None
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
    d_prime = truth.get("d_prime")
    clear = d_prime is None or d_prime >= CLEAR
    unknown = None
    if kind == "unlisted":
        named = [name for name, _ in given if name != LEARNED]
        unknown = verdict == UNKNOWN or (not named and learned == [true[0][1]])
    certain = verdict in CERTAIN
    wrong = certain and given[:1] != true
    if kind == "unlisted":
        wrong = certain and not unknown
        unknown = unknown if clear else None
    single = kind == "single" and clear
    apart = truth.get("separation")
    distinct = apart is None or apart >= DETECTED
    gap = answer.get("gap") or {}
    validation = gap.get("validation") or {}
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
        stressed=list(truth.get("stressed", ())),
        d_prime=d_prime,
        first=given[:1] == true if single else None,
        listed=set(true) <= listed if single else None,
        nameable=given[:1] == true if single and distinct else None,
        axis=[axis for _, axis in given[:1]] == [true[0][1]] if single else None,
        wrong=wrong,
        healthy=verdict == NOTHING if kind == "healthy" else None,
        unknown=unknown,
        found=verdict not in (NOTHING, FAILED) if kind == "single" else None,
        oracle=d_prime >= DETECTED if kind == "single" and d_prime is not None else None,
        oracle_names=distinct if single and apart is not None else None,
        failed=verdict == FAILED,
        closed=gap_closed(validation, truth.get("floor")) if kind != "healthy" else None,
        own_closed=gap_closed(gap, gap.get("floor")) if kind != "healthy" else None,
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


def _median(values: Iterable[float | None]) -> float | None:
    seen = sorted(value for value in values if value is not None and math.isfinite(value))
    if not seen:
        return None
    middle = len(seen) // 2
    return seen[middle] if len(seen) % 2 else (seen[middle - 1] + seen[middle]) / 2


def _labels(row: Row, factors: Sequence[str]) -> list[str]:
    """Groups of a case: levels of the factors asked for, and what was stressed."""
    labels = [f"{name} = {row.factors.get(name)}" for name in factors]
    labels += [
        "all factors random" if name == "all" else f"stressed: {name} = {row.factors.get(name)}"
        for name in row.stressed
    ]
    return labels


def groups(rows: Sequence[Row], factors: Sequence[str] = ()) -> dict[str, list[Row]]:
    """Rows by mode, by level of each factor asked for, and by what was stressed.

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
        for label in sorted({label for row in some for label in _labels(row, factors)}):
            found[f"{mode}, {label}"] = [row for row in some if label in _labels(row, factors)]
    return found


_MEDIANS = {
    "closed": "gap closed, validation",
    "own_closed": "gap closed, own figures",
    "seconds": "seconds",
}


def summary(rows: Sequence[Row], factors: Sequence[str] = ()) -> dict[str, Any]:
    """All measures of all groups, and all cases, for JSON."""
    out: dict[str, Any] = {}
    for name, some in groups(rows, factors).items():
        out[name] = {measure: share(some, measure) for measure in MEASURES}
        for column in _MEDIANS:
            out[name][f"{column}_median"] = _median(getattr(row, column) for row in some)
    return {"groups": out, "cases": [asdict(row) for row in rows]}


def table(rows: Sequence[Row], factors: Sequence[str] = ()) -> str:
    """The measures of all groups as a Markdown table."""
    heads = [*MEASURES.values(), *(f"{name}, median" for name in _MEDIANS.values())]
    lines = ["| cases | " + " | ".join(heads) + " |", "| --- " * (len(heads) + 1) + "|"]
    for name, some in groups(rows, factors).items():
        cells = [_shown(share(some, measure)) for measure in MEASURES]
        for column in _MEDIANS:
            value = _median(getattr(row, column) for row in some)
            cells.append("–" if value is None else f"{value:.2g}")
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"

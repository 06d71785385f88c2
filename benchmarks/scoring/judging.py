"""What one answer of discovery is worth, given the truth: the only place that says so.

row = judge(entry, answer)
row.first, row.wrong, row.severity_error
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from typing import Any

SAME = {"brake_drag": "coulomb_friction"}
"""Names that are one effect in other units."""
CERTAIN = ("named", "partly named")
"""Verdicts that are sure of their first effect."""
COMMITTED = (*CERTAIN, "ambiguous")
"""Verdicts that list effects as found."""
NOTHING, UNKNOWN, ABSTAINED = "no missing effect", "unknown effect", "model not good enough"
REFUSED, FAILED = "refused", "failed"
"""Written by `answering`: exit status 2, and any other failure."""
LEARNED = "learned"
DETECTED = 4.0
"""d' at which an ideal search of 120 candidates with 1 % false alarms finds half of all effects."""
CLEAR = 7.0
"""d' from which an effect is clear: an ideal search misses fewer than 1 of 500 (3 sigma more)."""

Json = Mapping[str, Any]
Key = tuple[str, int]
"""Effect and axis."""


@dataclass(frozen=True)
class Row:
    """One case with its answer. None where a measure does not apply to the case."""

    name: str
    group: str
    kind: str
    """'healthy', 'single' or 'unlisted'."""
    truth: str
    said: str
    factors: dict[str, Any]
    stressed: list[str]
    d_prime: float | None
    separation: float | None
    detectable: bool | None
    """Whether the oracle sees that there is an effect."""
    nameable: bool | None
    """Whether the oracle can also tell the effect from all others of its axis."""
    first: bool | None
    """Of clear effects that can be told: whether the first effect listed is the true one."""
    named: bool | None
    """The same, and the verdict is sure."""
    false_alarm: bool | None
    """Of healthy robots: whether an effect is listed, or an unknown one claimed."""
    abstained: bool
    refused: bool
    failed: bool
    wrong: bool
    """Whether the verdict is sure of an effect that is not there."""
    recognised: bool | None
    """Of clear effects of no catalogue: called unknown, or learned on the right axis."""
    severity_error: float | None
    """Relative, where `first` is true and the answer has a severity."""
    closed: float | None
    """Share of the squared gap to the noise that the answer closes, on motions for the score."""
    held_out: float | None
    """Relative torque error on motions for the score, with the effects of the answer."""
    seconds: float
    """Processor time [s]."""
    stated: tuple[tuple[float, bool], ...] = ()
    """Stated probability of each effect that is listed or an alternative, and whether it is
    there."""


def key(part: Json) -> Key:
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


def severity_error(truth: Json, answer: Json) -> float | None:
    """Relative error of the severity of the true effect, if the answer lists it in its unit."""
    severity = truth.get("severity")
    for part in answer.get("effects", ()):
        estimate = part.get("parameters", {}).get("severity")
        if key(part) == key(truth) and estimate is not None and severity:
            return float(abs(estimate - severity) / abs(severity))
    return None


def stated(answer: Json, true: Sequence[Key], beside: Set[Key]) -> tuple[tuple[float, bool], ...]:
    """Stated probabilities of effects of the catalogue, and whether each is there.

    Args:
        answer: Content of discovery.json.
        true: What is there.
        beside: What may be there, and does not count.
    """
    parts = [*answer.get("effects", ()), *answer.get("alternatives", ())]
    told = [one for one in parts if one.get("confidence") is not None]
    counted = [one for one in told if key(one) not in beside and key(one)[0] != LEARNED]
    return tuple((float(one["confidence"]), key(one) in true) for one in counted)


def judge(entry: Json, answer: Json) -> Row:
    """Compare an answer with the truth.

    Args:
        entry: Of a case: `name`, `group`, `kind`, `effects` (any of which is right as the first
            one) and, if known, `beside` (what is there in any case, and counts for nothing),
            `d_prime`, `separation`, `floor`, `factors`, `stressed`.
        answer: Content of discovery.json, or what `answering` wrote instead.

    Returns:
        The row.
    """
    verdict, kind = answer["verdict"], entry["kind"]
    beside = {key(part) for part in entry.get("beside", ())}
    true = [key(effect) for effect in entry["effects"]]
    given = [key(effect) for effect in answer.get("effects", ())] if verdict in COMMITTED else []
    given = [one for one in given if one not in beside or one in true]
    right = bool(given) and given[0] in true
    d_prime, apart = entry.get("d_prime"), entry.get("separation")
    distinct = apart is None or apart >= DETECTED
    clear = d_prime is None or d_prime >= CLEAR
    recognised = None
    if kind == "unlisted":
        laws = [axis for name, axis in given if name == LEARNED]
        only_laws = len(laws) == len(given)
        recognised = verdict == UNKNOWN or (only_laws and laws == [true[0][1]])
    counts = kind == "single" and clear and distinct
    silent = verdict in (ABSTAINED, REFUSED, FAILED)
    gap = answer.get("gap") or {}
    validation = gap.get("validation") or {}
    floor = entry.get("floor")
    scored = validation if validation.get("after") is not None else gap
    errors = [severity_error(e, answer) for e in entry["effects"]] if right and counts else []
    said = verdict + (": " + ", ".join(f"{name} {axis}" for name, axis in given) if given else "")
    return Row(
        name=entry["name"],
        group=entry["group"],
        kind=kind,
        truth=", ".join(
            f"{e['name']} {e['axis']}" + (f" ({e['severity']:.3g})" if e.get("severity") else "")
            for e in entry["effects"]
        )
        or "healthy",
        said=said,
        factors=dict(entry.get("factors", {})),
        stressed=list(entry.get("stressed", ())),
        d_prime=d_prime,
        separation=apart,
        detectable=d_prime >= DETECTED if d_prime is not None else None,
        nameable=d_prime >= DETECTED and apart >= DETECTED
        if d_prime is not None and apart is not None
        else None,
        first=right if counts else None,
        named=right and verdict in CERTAIN if counts else None,
        false_alarm=(bool(given) or verdict == UNKNOWN) if kind == "healthy" else None,
        abstained=verdict == ABSTAINED,
        refused=verdict == REFUSED,
        failed=verdict == FAILED,
        wrong=verdict in CERTAIN and bool(given) and not (recognised or right),
        recognised=recognised if clear else None,
        severity_error=next((error for error in errors if error is not None), None),
        closed=gap_closed(scored, floor if floor is not None else gap.get("floor"))
        if kind != "healthy" and not silent
        else None,
        held_out=scored.get("after"),
        seconds=float(answer.get("processor_seconds", math.nan)),
        stated=stated(answer, true, beside) if verdict in COMMITTED else (),
    )

"""What a discovery found, in one sentence: that of the command and of the report.

summary(result, baseline=False)  # "Axis 2 has 20 % more friction than its model (19.7 to 20.3 %)."
"""

from __future__ import annotations

from typing import Any

from faultgen.discovery.result import AMBIGUOUS, MODEL, NONE, PARTLY
from faultgen.system.words import in_series

_MOST = 3  # effects that the sentence names


def summary(result: dict[str, Any], baseline: bool) -> str:
    """Say in one sentence what was found.

    Args:
        result: Content of ``discovery.json``, with the words of its effects.
        baseline: Whether the recording was compared with a healthy one.

    Returns:
        The sentence, with its full stop. Intervals in it contain the severity with 95 %
        probability.
    """
    found, verdict = [words_of(one) for one in result["effects"]], result["verdict"]
    if verdict == NONE and result.get("usual_differences"):
        (first, *_) = result["usual_differences"]
        may = "which may be a difference between days. Further healthy recordings would tell."
        if not baseline:
            may = "which a healthy robot may have. A healthy recording (--healthy) would tell."
        return f"No effect is certain: {words_of(first)}, {may}"
    if verdict == NONE:
        return (
            "Nothing has changed since the healthy recording, as far as the noise lets see."
            if baseline
            else "No effect is missing: the model explains the recording within its noise."
        )
    if verdict == MODEL:
        why = result["model"]["reasons"][0]
        return f"The model explains the recording too badly for an answer: {why}."
    if verdict == AMBIGUOUS and found and not result["alternatives"]:
        likely = min(one["confidence"] for one in result["effects"])
        return f"Most likely {_few(found)}, with a probability of {100 * likely:.0f} %."
    if verdict == AMBIGUOUS and result["alternatives"]:
        rivals = list(dict.fromkeys(_plain(one) for one in result["alternatives"]))
        if not found:
            return f"The recording does not decide between {_listed(rivals, 'and')}."
        shown = _listed(rivals, "or")
        return f"Most likely {_few(found)}; the recording does not exclude {shown}."
    unexplained = result["unexplained"] if not found or verdict == PARTLY else ""
    return f"{_capital('; '.join(filter(None, [_few(found), unexplained])))}."


def words_of(effect: dict[str, Any]) -> str:
    """Say what one effect of ``discovery.json`` is.

    Args:
        effect: An entry of its ``effects``.

    Returns:
        A sentence without a full stop.
    """
    told = effect.get("sentence") or effect["parameters"].get("sentence")
    return str(told or f"axis {effect['axis']} has {effect['effect']}")


def _few(sentences: list[str]) -> str:
    more = len(sentences) - _MOST
    shown = "; ".join(sentences[:_MOST])
    return f"{shown}; and {more} more effects" if more > 1 else "; ".join(sentences)


def _plain(effect: dict[str, Any]) -> str:
    return f"{effect['effect'].replace('_', ' ')} of axis {effect['axis']}"


def _listed(names: list[str], last: str) -> str:
    if len(names) > _MOST + 1:
        names = [*names[:_MOST], f"{len(names) - _MOST} others"]
    return in_series(names, last)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]

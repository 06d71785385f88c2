"""Terms that a report explains where they appear: as a note at the term, and in a list below."""

from __future__ import annotations

import re
from collections.abc import Mapping

from markupsafe import Markup, escape

TERMS = {
    "TE 10 bins": "transfer entropy, estimated with 10 bins: how much knowing one axis' torque "
    "series helps to predict that of another; the axis that gives most is named as worn",
    "TE 5 bins": "the same with 5 bins",
    "CC": "cross-correlation: the axis whose torque series runs ahead of all others is named as "
    "worn",
    "CC, eq. 3.5": "the same with the opposite sign of the lags, as equation 3.5 of the thesis "
    "prints it",
    "own torque": "the axis whose mean |torque| has changed by most, compared with how much it "
    "changes while the robot is healthy",
    "all torques": "the same of all axes together: what they have in common, such as temperature, "
    "does not count",
    "friction residual": "the axis whose friction has grown, where friction is what a model "
    "without it leaves of the torque",
    "Wilson interval": "the range in which the true share of right answers lies with 95 % "
    "probability, given this number of answers (E. B. Wilson, 1927)",
    "isolator": "a method that names the worn axis",
    "net transfer entropy": "transfer entropy from one axis to another, less that in the opposite "
    "direction, in bit",
    "speed window": "motor speeds at which torque is averaged, because friction hardly depends on "
    "speed there",
    "AUC": "area under the ROC curve: the probability that the classifier gives a generated cycle "
    "a higher score than a measured one; 0.5 is chance",
    "RMS": "root mean square: the square root of the mean of the squares",
    "noise floor": "the error that would remain if the model were perfect and only noise were left",
    "confidence": "the probability of the effect, compared with no effect and with the other "
    "effects that the data do not exclude",
    "PSD": "power spectral density: how much of the variance lies at each frequency",
}
"""Each term with its meaning."""

_TAGS = re.compile(r"(<[^>]*>)")


def explained(html: str, terms: Mapping[str, str] = TERMS) -> Markup:
    """Mark the terms of a text, and list their meanings below it.

    Args:
        html: HTML of a part of a page.
        terms: Meanings.

    Returns:
        The HTML, in which each term has its meaning as a note, followed by the list.
    """
    longest = sorted(terms, key=len, reverse=True)
    pattern = re.compile(rf"(?<!\w)({'|'.join(map(re.escape, longest))})(?!\w)")
    found: dict[str, None] = {}

    def marked(match: re.Match[str]) -> str:
        term = match[1]
        found.setdefault(term)
        return f'<abbr title="{escape(terms[term])}">{term}</abbr>'

    parts = [
        part if part.startswith("<") else pattern.sub(marked, part) for part in _TAGS.split(html)
    ]
    return Markup("".join(parts)) + definitions([term for term in terms if term in found], terms)


def definitions(names: list[str], terms: Mapping[str, str] = TERMS) -> Markup:
    """List meanings of terms.

    Args:
        names: The terms, in the order of the list.
        terms: Meanings.

    Returns:
        HTML; empty without terms.
    """
    if not names:
        return Markup()
    rows = Markup("").join(
        Markup("<dt>{}</dt><dd>{}.</dd>").format(name, terms[name][:1].upper() + terms[name][1:])
        for name in names
    )
    return Markup('<dl class="terms">{}</dl>').format(rows)

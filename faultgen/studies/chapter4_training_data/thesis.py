"""Numbers of thesis chapter 4, for comparison with ours."""

from __future__ import annotations

from typing import Any

FACTORS = ("source", "signal", "condition")
"""Training source, signal type and robot condition."""

TERMS = (
    "source",
    "signal",
    "condition",
    "source*signal",
    "source*condition",
    "signal*condition",
    "source*signal*condition",
)
"""Rows of tables 4.2 to 4.4."""


def _rows(text: str, names: tuple[str, ...]) -> list[dict[str, float]]:
    return [
        dict(zip(names, map(float, line.split()), strict=True)) for line in text.strip().split("\n")
    ]


def _anova(text: str) -> dict[str, dict[str, float]]:
    return dict(zip(TERMS, _rows(text, ("ss", "f", "p")), strict=True))


ANOVA: dict[str, dict[str, dict[str, float]]] = {
    "variation": _anova("""
0.02 0.02 0.88
7.376 4.32 0.014
20.306 23.78 0
1.056 0.62 0.539
3.073 3.6 0.059
5.817 3.41 0.035
0.965 0.56 0.569
"""),
    "above": _anova("""
278.35 28.89 0
319.6 16.59 0
114.94 11.93 0.001
160.95 8.35 0
55.39 5.75 0.017
276.69 14.36 0
134.21 6.97 0.001
"""),
    "lead": _anova("""
44.52 10.39 0.001
174.5 20.37 0
87.25 20.37 0
89.03 10.39 0
44.52 10.39 0.001
174.5 20.37 0
89.03 10.39 0
"""),
}
"""Sum of squares, F and p by descriptor and term, tables 4.2, 4.3 and 4.4."""

ERROR = {"variation": 222.833, "above": 2514.6, "lead": 1117.89}
"""Sum of squares of the error, 261 degrees of freedom."""

_GLM = ("residual_deviance", "deviance", "p")

MODELS: dict[str, list[dict[str, float]]] = {
    "variation": _rows(
        """
142.52 0.04 0.7788
135.99 6.52 0.0009
126.87 9.12 0.0000
126.23 0.64 0.5039
121.94 4.93 0.0051
121.38 0.56 0.5504
119.13 2.25 0.1859
""",
        _GLM,
    ),
    "lead": _rows(
        """
157.75 2.08 0.1496
153.79 3.96 0.1382
151.50 2.30 0.1297
146.88 4.61 0.0995
146.60 4.90 0.0865
141.99 4.61 0.0995
131.92 10.07 0.0180
""",
        _GLM,
    ),
    "above": _rows(
        """
287.79 14.23 0.0002
280.50 7.29 0.0261
277.36 3.14 0.0765
267.70 9.66 0.0080
269.25 8.11 0.0174
259.59 9.66 0.0080
241.66 17.93 0.0005
""",
        _GLM,
    ),
}
"""Models 2 to 8 by descriptor, tables 4.6, 4.8 and 4.10."""

NULL = {"variation": 142.55, "lead": 159.83, "above": 302.02}
"""Deviance of model 1."""

TERM_BY_TERM: dict[str, list[dict[str, float]]] = {
    "variation": _rows(
        """
142.52 0.04 0.7768
135.98 6.53 0.0008
125.13 10.85 0.0000
""",
        _GLM,
    ),
    "lead": _rows(
        """
157.75 2.08 0.1496
153.79 3.96 0.1382
151.50 2.30 0.1297
146.88 4.61 0.0995
141.99 4.90 0.0865
139.16 2.83 0.0924
131.92 7.24 0.0268
""",
        _GLM,
    ),
    "above": _rows(
        """
287.79 14.23 0.0002
280.50 7.29 0.0261
277.36 3.14 0.0765
267.70 9.66 0.0080
259.59 8.11 0.0174
255.46 4.13 0.0421
241.66 13.80 0.0010
""",
        _GLM,
    ),
}
"""Terms of the model chosen, one by one, tables 4.7, 4.9 and 4.11."""

FOUND: dict[str, Any] = {
    "variation": ("OTM", "difference", 13),
    "above": ("OTO", "difference", 10),
    "lead": ("OTO", "difference", 10),
}
"""Where failing and normal robots differ by Tukey's test, and the least test days, section 4.4."""

"""Numbers of thesis chapter 5 and its appendix, for comparison with ours."""

from __future__ import annotations

from faultgen.analysis.classification import CLASSIFIERS
from faultgen.analysis.preprocessing import COMBINATIONS

# Table 5.2: mean and standard deviation of AUC; LR, SVM, RF, ES
_TABLE_5_2 = """
0.47 0.34 0.61 0.48 0.66 0.45 0.64 0.42
0.45 0.33 0.59 0.47 0.69 0.42 0.58 0.38
0.51 0.23 0.48 0.30 0.71 0.28 0.48 0.30
0.69 0.42 0.49 0.50 0.63 0.47 0.44 0.49
0.47 0.34 0.55 0.49 0.66 0.44 0.54 0.49
0.54 0.24 0.61 0.29 0.77 0.27 0.60 0.30
0.50 0.41 0.66 0.44 0.61 0.43 0.67 0.44
0.45 0.33 0.55 0.45 0.69 0.43 0.51 0.46
0.61 0.33 0.60 0.35 0.63 0.27 0.61 0.34
0.69 0.42 0.49 0.50 0.65 0.46 0.48 0.48
0.72 0.31 0.65 0.27 0.69 0.28 0.64 0.27
0.45 0.33 0.55 0.45 0.61 0.44 0.51 0.46
0.67 0.37 0.62 0.37 0.68 0.36 0.67 0.37
0.67 0.38 0.61 0.36 0.64 0.33 0.62 0.37
0.75 0.30 0.76 0.27 0.77 0.29 0.76 0.27
"""

AUC: dict[tuple[str, str], tuple[float, float]] = {
    (combination, classifier): (float(line.split()[2 * k]), float(line.split()[2 * k + 1]))
    for combination, line in zip(COMBINATIONS, _TABLE_5_2.strip().split("\n"), strict=True)
    for k, classifier in enumerate(CLASSIFIERS)
}
"""Mean and standard deviation by combination and classifier, table 5.2."""

MINUTES: dict[str, tuple[float, float, float]] = {
    "control": (13, 92, 120),
    "+diff": (12, 90, 120),
    "+diff+pca": (3, 49, 70),
    "+estM+diff+var3": (17, 143, 213),
    "+estM+diff+var3+pca": (4, 76, 78),
}
"""Execution time [min] of LR, SVM and RF, table A.1; that of ES is LR's and SVM's together."""

Quadruple = tuple[float, float, float, float]

# Without, with, p of variances (table A.2), p of means (table A.3); LR, SVM, RF, ES each.
# Where table A.2 has no row of a pair (it tells those of +var3 twice, and none of +estM): -
_PAIRS = {
    "diff": """
control +diff 0.00 0.00 0.01 0.00 0.99 0.15 0.99 0.01
+pca +diff+pca 0.44 0.00 0.00 0.00 0.14 0.06 0.44 0.05
+estM +estM+diff 0.02 0.00 0.01 0.00 0.25 1.00 0.69 1.00
+var3+pca +diff+var3+pca 0.97 0.00 0.10 0.00 1.00 0.42 1.00 0.17
+estM+pca +estM+diff+pca 0.00 0.00 0.00 0.00 0.00 1.00 0.852 1.00
+estM+var3+pca +estM+diff+var3+pca 0.83 0.00 0.00 0.00 0.00 0.00 0.00 0.00
""",
    "var3": """
control +var3 1.00 0.26 0.96 0.05 1.00 1.00 0.99 0.25
+pca +var3+pca 1.00 1.00 0.71 0.71 1.00 1.00 1.00 1.00
+estM +estM+var3 1.00 0.87 0.93 0.00 1.00 1.00 1.00 0.95
+diff+pca +diff+var3+pca 0.33 0.42 0.00 0.27 0.97 1.00 1.00 1.00
+estM+pca +estM+var3+pca 0.00 0.03 0.87 0.00 0.99 0.61 1.00 0.05
+estM+diff+pca +estM+diff+var3+pca 0.59 0.38 0.65 0.44 1.00 0.01 0.24 0.00
""",
    "estM": """
control +estM - - - - 1.00 0.15 1.00 0.82
+diff +estM+diff - - - - 1.00 0.00 0.67 0.03
+pca +estM+pca - - - - 0.00 0.08 1.00 0.00
+var3 +estM+var3 - - - - 1.00 1.00 1.00 1.00
+diff+pca +estM+diff+pca - - - - 0.08 0.97 0.88 0.99
+var3+pca +estM+var3+pca - - - - 0.00 0.99 1.00 1.00
+diff+var3+pca +estM+diff+var3+pca - - - - 0.66 0.00 0.01 0.01
""",
    "pca": """
control +pca 0.03 0.05 0.58 0.10 0.00 0.99 0.26 1.00
+diff +diff+pca 0.00 0.00 0.62 0.04 0.14 0.06 0.44 0.05
+var3 +var3+pca 0.03 0.42 0.89 1.00 0.00 0.99 1.00 0.99
+estM +estM+pca 0.00 0.15 0.07 0.72 0.99 0.98 0.93 0.75
+estM+diff +estM+diff+pca 0.00 0.49 0.36 0.15 0.00 0.99 0.19 0.99
+estM+var3 +estM+var3+pca 1.00 1.00 0.076 1.00 1.00 1.00 0.926 1.00
""",
}


def _numbers(cells: list[str]) -> dict[str, float | None]:
    values = [None if cell == "-" else float(cell) for cell in cells]
    return dict(zip(CLASSIFIERS, values, strict=True))


PAIRS: dict[str, list[tuple[str, str]]] = {}
"""Combinations without and with each step, tables A.2 and A.3."""

VARIANCE_P: dict[tuple[str, str], dict[str, float | None]] = {}
"""P of equal variances of a pair, by classifier, table A.2."""

MEAN_P: dict[tuple[str, str], dict[str, float | None]] = {}
"""P of equal means of a pair, by classifier, table A.3."""

for _step, _text in _PAIRS.items():
    for _line in _text.strip().split("\n"):
        _without, _with, *_cells = _line.split()
        PAIRS.setdefault(_step, []).append((_without, _with))
        VARIANCE_P[_without, _with] = _numbers(_cells[:4])
        MEAN_P[_without, _with] = _numbers(_cells[4:])

HYPOTHESES: dict[str, tuple[str, str]] = {
    "diff": ("H1", "differences improve detection"),
    "var3": ("H2", "local variation improves detection"),
    "estM": ("H3", "estimated torque and speed improve detection"),
    "pca": ("H4", "principal components improve detection"),
}
"""Number and wording of the hypothesis about each step, thesis 5.1."""

HEADLINE: dict[str, tuple[str, str]] = {
    "diff": ("+estM+var3+pca", "+estM+diff+var3+pca"),
    "var3": ("+estM+diff+pca", "+estM+diff+var3+pca"),
    "estM": ("+diff+var3+pca", "+estM+diff+var3+pca"),
    "pca": ("+estM+diff", "+estM+diff+pca"),
}
"""Pair from which the thesis states how much each step improves, 5.4.1 to 5.4.4."""

WINDOWS_P = {"LR": 0.957, "SVM": 0.217, "RF": 0.667, "ES": 0.124}
"""P of equal means with windows of three and of five days, 5.4.2."""

INVARIANCE = {"p": 0.04, "r2": 0.13, "slope": -0.21}
"""LR without differences: mean AUC of a robot against its mean speed, 5.4.1. With them p > 0.78."""

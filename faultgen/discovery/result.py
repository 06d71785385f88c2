"""The answer of a discovery, and its content in ``discovery.json``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from faultgen.discovery.fit.diagnostics import Share
from faultgen.discovery.terms.candidates import Term
from faultgen.effects import get_effect
from faultgen.robot import Robot

NONE, NAMED, PARTLY, AMBIGUOUS, UNKNOWN, MODEL = (
    "no missing effect",
    "named",
    "partly named",
    "ambiguous",
    "unknown effect",
    "model not good enough",
)

MEANINGS = {
    NONE: "the model explains the recording",
    NAMED: "the effects below explain the gap",
    PARTLY: "the effects below are certain, but something else is missing besides",
    AMBIGUOUS: "several answers fit about equally well",
    UNKNOWN: "a torque that no effect of the catalogue explains acts on an axis",
    MODEL: "the model explains even the healthy robot too badly for an answer",
}
"""What each verdict means."""

MEASURE = "RMS torque error over RMS torque, on motions used neither for fitting nor for choosing"


@dataclass(frozen=True)
class Named:
    """One effect of the answer."""

    effect: str
    """Name."""
    axis: int
    """From 1."""
    severity: float
    """In the unit of the effect."""
    error: float
    """Standard error, to first order."""
    interval: tuple[float, float]
    """Interval that contains the severity with 95 % probability."""
    parameters: dict[str, float]
    """Further parameters of the effect."""
    confidence: float
    """Probability of the effect against no effect, and against the alternatives that are not
    excluded."""
    gap_after: float
    """Relative torque error on the scoring motions, of the model with this effect and those before
    it."""


@dataclass(frozen=True, eq=False)
class Answer:
    """The answer and the numbers on which it is based."""

    verdict: str
    """One of the six verdicts."""
    effects: tuple[Named, ...]
    """The effects that were found, in the order in which they were added."""
    alternatives: tuple[tuple[str, int, float], ...]
    """Effect, axis and probability of each alternative that is not excluded."""
    before: float
    """Relative torque error of the unchanged model on the scoring motions."""
    calibrated: float
    """The same of the model with its own numbers calibrated, simulated."""
    after: float
    """The same of the model with all changes, simulated."""
    floor: float
    """Relative torque error of noise alone. On each axis it is at most the smallest of the errors
    above."""
    per_axis: tuple[dict[str, float], ...]
    """The same errors for each axis."""
    p_value: float
    """Probability that noise alone causes the gap that remains after calibration."""
    where: tuple[Share, ...]
    """Shares of the gap by axis and regime."""
    left: tuple[tuple[int, str], ...]
    """Axis and variable of torques of no known form in what remains, the surest first."""
    changes: list[tuple[Term, float]]
    """All changes of the model: effects and calibration."""
    robot: Robot
    """The changed model, which can replay the recording."""
    lacks: tuple[str, ...]
    """One line for each found change that this model does not contain."""
    calibration: dict[str, dict[str, float]]
    """Differences of the robot's own numbers from the model, by name and axis; empty with a
    baseline."""
    usual: tuple[tuple[str, int, float, float], ...]
    """Effect, axis, severity and standard error of clear differences from the model, or from the
    baseline, that a healthy robot may have."""
    left_torque: np.ndarray
    """Torque of the gap that the model does not explain, shape (samples, n_axes)."""
    reasons: tuple[str, ...]
    """Why the model is not good enough for an answer, one line for each reason; none if it is."""
    residual_variance: np.ndarray
    """Mean square of the whitened error of each axis on the scoring motions, over its expectation,
    shape (n_axes,); nan for an axis that is not compared."""
    strange_torque: np.ndarray
    """Torque that neither effects nor usual differences of a robot from its model explain, same
    shape. Without a baseline it is less than `left_torque`: friction of another form is usual, but
    cannot be put into the model."""

    def contract(self) -> dict[str, Any]:
        """The content of ``discovery.json``."""
        return {
            "verdict": self.verdict,
            "effects": [
                {
                    "effect": one.effect,
                    "axis": one.axis,
                    "parameters": {
                        "severity": one.severity,
                        "unit": get_effect(one.effect).unit_with(one.parameters),
                        **one.parameters,
                    },
                    "interval": {"severity": list(one.interval)},
                    "confidence": one.confidence,
                    "gap_after": one.gap_after,
                }
                for one in self.effects
            ],
            "alternatives": [
                {"effect": name, "axis": axis, "confidence": odds}
                for name, axis, odds in self.alternatives
            ],
            "gap": {
                "before": self.before,
                "calibrated": self.calibrated,
                "after": self.after,
                "floor": self.floor,
                "measure": MEASURE,
                "p_value": self.p_value,
                "per_axis": list(self.per_axis),
            },
            "where": [
                {
                    "axis": one.axis,
                    "regime": one.regime,
                    "share": one.share,
                    "intensity": one.intensity,
                    "p_value": one.p_value,
                }
                for one in self.where
            ],
            "calibration": self.calibration,
            "usual_differences": [
                {
                    "effect": name,
                    "axis": axis,
                    "parameters": {"severity": value, "unit": get_effect(name).unit},
                    "interval": {"severity": [value - 1.96 * error, value + 1.96 * error]},
                }
                for name, axis, value, error in self.usual
            ],
            "next_experiment": None,
            "unexplained": self.unexplained(),
            "model": {
                "is_good_enough": not self.reasons,
                "reasons": list(self.reasons),
                "residual_variance": [
                    float(one) if np.isfinite(one) else None for one in self.residual_variance
                ],
            },
        }

    def unexplained(self) -> str:
        """Describe the gap that remains, in words."""
        if self.verdict not in (UNKNOWN, PARTLY):
            return ""
        if self.verdict == PARTLY:
            could = self.before**2 - self.floor**2
            share = (self.before**2 - self.after**2) / could
            open_ = f"{max(1 - share, 0):.0%} of the gap beyond the noise remains"
        else:
            open_ = "an effect that is in no catalogue"
        told = [f"axis {axis} over the {variable}" for axis, variable in self.left[:3]]
        return open_ + (": a torque of no known form on " + "; ".join(told) if told else "")

"""What is answered, and how it is told in ``discovery.json``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from faultgen.discovery.candidates import Term
from faultgen.discovery.diagnostics import Pattern, Share
from faultgen.effects import get_effect
from faultgen.robot import Robot

NONE, NAMED, AMBIGUOUS, UNKNOWN = (
    "no missing effect",
    "named",
    "ambiguous",
    "unknown effect",
)

UNLIKELY = 1e-4
"""Probability of a pattern by noise below which it counts."""

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
    """Of the severity, with 95 % probability."""
    parameters: dict[str, float]
    """Further parameters of the effect."""
    confidence: float
    """Probability against nothing, and against what is not excluded, in its place."""
    gap_after: float
    """Relative torque error of the model with this effect and those before it, on the scoring
    motions."""


@dataclass(frozen=True, eq=False)
class Answer:
    """The answer and what it rests on."""

    verdict: str
    """One of the four."""
    effects: tuple[Named, ...]
    """In the order added."""
    alternatives: tuple[tuple[str, int, float], ...]
    """Effect, axis and probability of what is not excluded."""
    before: float
    """Relative torque error of the model as it is, on the scoring motions."""
    calibrated: float
    """With the model's own numbers calibrated, simulated."""
    after: float
    """Of the model with everything that was changed in it, simulated."""
    floor: float
    """Of noise alone; an axis has at most the smallest of the errors above."""
    per_axis: tuple[dict[str, float], ...]
    """The same by axis."""
    p_value: float
    """Probability of the gap after calibration by noise alone."""
    where: tuple[Share, ...]
    """Where the gap is."""
    left: tuple[Pattern, ...]
    """Patterns in what is left."""
    changes: list[tuple[Term, float]]
    """All that is changed in the model, effects and calibration."""
    robot: Robot
    """The model with the changes, which replays the recording."""
    lacks: tuple[str, ...]
    """What that model lacks of what was found, a line each."""
    calibration: dict[str, dict[str, float]]
    """Values of the model's own numbers, off by so much."""
    left_torque: np.ndarray
    """Torque that the model leaves of the gap, shape (samples, n_axes)."""

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
                        "unit": get_effect(one.effect).unit,
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
            "next_experiment": None,
            "unexplained": self.unexplained(),
        }

    def unexplained(self) -> str:
        """What is left, in words."""
        if self.verdict != UNKNOWN or not self.left:
            return ""
        units = {
            "joint angle": "rad",
            "motor turn": "rad of the motor's turn",
            "speed": "rad/s motor side",
            "acceleration": "rad/s^2 motor side",
            "time": "s",
            "motion": "rad/s motor side",
        }
        told = [
            f"axis {one.axis} along {one.along}, strongest at {one.place:.3g} {units[one.along]}"
            for one in self.left[:3]
            if one.p_value < UNLIKELY
        ]
        return "a pattern that no effect of the catalogue makes: " + (
            "; ".join(told) or f"most on axis {self.left[0].axis}"
        )

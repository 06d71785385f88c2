"""What a learned curve is, in words and as a short formula."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from faultgen.discovery.laws.law_curves import Curve
from faultgen.effects.law_course import UNITS

NAMES = {
    "speed": "speed",
    "abs_speed": "speed",
    "acceleration": "acceleration",
    "abs_acceleration": "acceleration",
    "push": "acceleration along the motion",
    "load": "load",
    "abs_load": "load",
    "joint_angle": "joint angle",
    "motor_turn": "motor angle",
    "temperature": "temperature",
    "since_rest": "time since rest",
    "hysteresis": "hysteresis of the angle",
    "speed_lag": "change of speed",
    "torque_lag": "change of torque",
}
"""Names of the variables of a law, for readers."""

_SYMBOLS = {
    "speed": "w",
    "abs_speed": "|w|",
    "acceleration": "a",
    "abs_acceleration": "|a|",
    "push": "a sign(w)",
    "load": "L",
    "abs_load": "|L|",
    "joint_angle": "q",
    "motor_turn": "th",
    "temperature": "T",
    "since_rest": "t",
    "hysteresis": "h",
    "speed_lag": "(w - lag(w))",
    "torque_lag": "(M - lag(M))",
}
_FACTORS = {"": "", "direction": " sign(w)", "load": " L"}
_DENSE = 41  # points at which a formula is stored as a curve
_TIMES = {1: "once", 2: "twice"}
_EVEN = 0.1  # mean of a curve over its largest size from which it opposes the motion
_MONOTONE = 0.9  # rank correlation from which a curve rises or falls
_FLAT = 0.2  # range of a curve over its largest size that counts as constant


@dataclass(frozen=True, eq=False)
class Formula:
    """A short formula for a curve, linear in its few coefficients."""

    text: str
    """The formula with {0}, {1}, ... for the coefficients and x for the variable."""
    shapes: np.ndarray
    """Value of each shape at the dense knots, shape (coefficients, knots)."""
    knots: np.ndarray
    """Dense knots in the unit of the variable, shape (knots,)."""

    def curve(self, curve: Curve) -> Curve:
        """Return the curve with the dense knots."""
        return Curve(curve.over, curve.of, curve.times, tuple(self.knots.tolist()), curve.scale)


def formulas(curve: Curve) -> Iterator[Formula]:
    """List short formulas for a curve, those with the fewest numbers first.

    Args:
        curve: The curve with its knots, which tell the range of the variable.

    Yields:
        The formulas.
    """
    low, high = curve.knots[0], curve.knots[-1]
    x = np.linspace(low, high, _DENSE)
    one = np.ones_like(x)
    if curve.repeats:
        for k in range(1, 7):
            turn = 2 * np.pi * k * x / curve.scale
            order = round(2 * np.pi * k / curve.scale)
            of = "x" if order == 1 else f"{order} x"
            text = "{0:.3g}" + f" cos({of}) + " + "{1:.3g}" + f" sin({of})"
            yield Formula(text, np.stack([np.cos(turn), np.sin(turn)]), x)
        return
    if curve.times:
        yield Formula("{0:.3g}", one[None], x)
    yield Formula("{0:.3g} x", x[None], x)
    reach = high - low
    if low >= -1e-9 * reach:
        for width in (0.05, 0.1, 0.2, 0.4):
            text = "{0:.3g} exp(-x / " + f"{width * reach:.3g})"
            yield Formula(text, np.exp(-x / (width * reach))[None], x)
    if low < 0 < high:
        for width in (0.03, 0.1, 0.3):
            text = "{0:.3g} tanh(x / " + f"{width * high:.3g})"
            yield Formula(text, np.tanh(x / (width * high))[None], x)
    for width in (0.1, 0.25):
        for centre in np.linspace(low, high, 9):
            bump = np.exp(-(((x - centre) / (width * reach)) ** 2))
            text = "{0:.3g} exp(-((x - " + f"{centre:.3g}) / {width * reach:.3g})^2)"
            yield Formula(text, bump[None], x)
    yield Formula("{0:.3g} + {1:.3g} x", np.stack([one, x]), x)
    if low >= -1e-9 * reach:
        for width in (0.05, 0.1, 0.2, 0.4):
            text = "{0:.3g} + {1:.3g} exp(-x / " + f"{width * reach:.3g})"
            yield Formula(text, np.stack([one, np.exp(-x / (width * reach))]), x)
    yield Formula("{0:.3g} + {1:.3g} x + {2:.3g} x^2", np.stack([one, x, x**2]), x)


@dataclass(frozen=True, eq=False)
class Part:
    """One curve of a law with its values, or with the formula that replaces it."""

    curve: Curve
    """The curve."""
    values: np.ndarray
    """Values of the curve at its knots, or coefficients of the formula, in [N m]."""
    formula: Formula | None = None
    """The formula."""

    def scaled(self, factor: float) -> Part:
        """Return the same curve multiplied by a factor."""
        return replace(self, values=factor * self.values)

    @property
    def shown(self) -> tuple[Curve, np.ndarray]:
        """The curve and its values at the knots, also of a formula.

        Returns:
            The curve, and its values in [N m], shape (size,).
        """
        if self.formula is None:
            return self.curve, self.values
        dense = self.formula.curve(self.curve)
        return dense, (self.values @ self.formula.shapes)[: dense.size]

    @property
    def term(self) -> dict[str, Any]:
        """The curve as a term of `effects.learned`."""
        curve, values = self.shown
        return curve.term(values)

    def name(self, axis: int) -> str:
        """Name of the variable in a law of an axis."""
        curve = self.curve
        return NAMES[curve.over] + (f" of axis {curve.of}" if curve.of != axis else "")

    def written(self, axis: int) -> str:
        """Return the formula as text; f(x) stands for a curve.

        Args:
            axis: Axis on which the law acts, from 1.
        """
        curve, values = self.curve, self.values
        symbol = _SYMBOLS[curve.over].replace("lag(", f"lag{1000 * curve.scale:.0f}ms(")
        symbol += f"{curve.of}" if curve.of != axis else ""
        if self.formula is None:
            return f"f({symbol}){_FACTORS[curve.times]}"
        body = self.formula.text.format(*values.tolist()).replace("+ -", "- ").replace("- -", "+ ")
        body = re.sub(r"\bx\b", symbol, body.replace("exp", "EXP")).replace("EXP", "exp")
        if len(values) > 1 and curve.times:
            body = f"({body})"
        return body + _FACTORS[curve.times]

    def described(self, axis: int) -> str:
        """Say in words what the curve is.

        Args:
            axis: Axis on which the law acts, from 1.
        """
        curve, values = self.shown
        kind = {"direction": "opposing the motion", "load": "in proportion to the load"}.get(
            curve.times, ""
        )
        if kind and curve.times == "direction" and np.mean(values) < _EVEN * np.abs(values).max():
            kind = "with the sign of the motion"
        return f"{kind} {_shape(curve, values, self.name(axis))}".strip()


def _shape(curve: Curve, values: np.ndarray, name: str) -> str:
    unit = UNITS[curve.over]
    size = np.abs(values).max()
    if curve.over == "hysteresis":
        return f"that follows the angle with hysteresis (reach {curve.scale:.3g} rad of the motor)"
    if curve.over.endswith("_lag"):
        return f"that follows the {name} over {1000 * curve.scale:.0f} ms"
    if curve.repeats:
        spectrum = np.abs(np.fft.rfft(values - values.mean()))
        waves = int(np.argmax(spectrum)) * round(2 * np.pi / curve.scale)
        often = _TIMES.get(waves, f"{waves} times")
        return f"that varies with the motor angle, mostly {often} a motor turn"
    if np.ptp(values) < _FLAT * size:
        return f"that is nearly constant along the {name}"
    # curves are compared by their size, which falls where a negative value rises to zero
    shown = np.abs(values) if np.all(values >= 0) or np.all(values <= 0) else values
    order = np.corrcoef(np.arange(len(shown)), np.argsort(np.argsort(shown)))[0, 1]
    if abs(order) > _MONOTONE:
        steep = np.abs(np.diff(shown)) / np.diff(curve.knots)
        word = "rises" if order > 0 else "falls"
        if len(shown) > 3 and steep[0] > 3 * np.median(steep) and curve.knots[0] >= 0:
            other = "falls" if order > 0 else "rises"
            return f"that {other} below {curve.knots[1]:.3g} {unit} of {name}"
        return f"that {word} with the {name}"
    k = int(np.argmax(np.abs(values - np.median(values))))
    return f"that is strongest at {curve.knots[k]:.3g} {unit} of {name}"

"""Units of logs, as factors to the SI units that recordings have.

conversion("position", "deg").factor  # 0.01745...
conversion("position", 1e-4).factor   # one unit of the log is 1e-4 rad
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from faultgen.errors import InputError

ISO = "iso"
"""Unit of times that are dates with clock times, such as 2026-03-01T09:30:00.004."""

PERCENT, PERMILLE = "%", "permille"
"""Units of torques and currents that are shares of a rated value."""

SHARES = {PERCENT: 0.01, PERMILLE: 0.001}
"""Rated values in one of these units."""

_DEGREE = math.pi / 180
_TURN = 2 * math.pi

_UNITS: dict[str, dict[str, float]] = {
    "position": {
        **{"rad": 1.0, "mrad": 1e-3, "urad": 1e-6},
        **{"deg": _DEGREE, "mdeg": 1e-3 * _DEGREE, "udeg": 1e-6 * _DEGREE, "rev": _TURN},
        **{"m": 1.0, "mm": 1e-3, "um": 1e-6},
    },
    "velocity": {
        **{"rad/s": 1.0, "mrad/s": 1e-3, "deg/s": _DEGREE, "rev/s": _TURN, "rpm": _TURN / 60},
        **{"m/s": 1.0, "mm/s": 1e-3, "m/min": 1 / 60},
    },
    "torque": {"Nm": 1.0, "mNm": 1e-3, "Ncm": 1e-2, "kNm": 1e3, "N": 1.0, "mN": 1e-3, "kN": 1e3},
    "current": {"A": 1.0, "mA": 1e-3},
    "temperature": {"degC": 1.0, "K": 1.0},
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, ISO: 1.0},
}
_LINEAR = {"m", "mm", "um", "m/s", "mm/s", "m/min", "N", "mN", "kN"}
_SI = {
    "position": ("rad", "m"),
    "velocity": ("rad/s", "m/s"),
    "torque": ("N m", "N"),
    "current": ("A", "A"),
    "temperature": ("degC", "degC"),
    "time": ("s", "s"),
}
_OTHER_NAMES = {
    **{"°": "deg", "degree": "deg", "degrees": "deg", "turn": "rev", "turns": "rev"},
    **{"grad": "deg", "radian": "rad", "radians": "rad", "n-m": "nm", "newton-m": "nm"},
    **{"newtonmeter": "nm", "newton-meter": "nm", "ampere": "a", "amp": "a", "amps": "a"},
    **{"grad/s": "deg/s", "degrees/s": "deg/s", "radians/s": "rad/s", "newton": "n"},
    **{"°/s": "deg/s", "1/min": "rpm", "rev/min": "rpm", "u/min": "rpm", "min-1": "rpm"},
    **{"°c": "degc", "c": "degc", "celsius": "degc", "kelvin": "k", "sec": "s", "seconds": "s"},
    **{"percent": PERCENT, "iso8601": ISO, "‰": PERMILLE},
    "01%": PERMILLE,  # 0.1 %; points are left out
}
_KELVIN = -273.15
_IN_BRACKETS = re.compile(r"\s*[\[(]([^\[\]()]*)[\])]\s*$")


@dataclass(frozen=True)
class Conversion:
    """How numbers of a log become numbers in SI units: factor times number, plus offset."""

    factor: float
    """SI units in one unit of the log."""
    offset: float
    """What is added after that, in the SI unit."""
    si: str
    """Name of the SI unit."""


def conversion(kind: str, unit: str | float) -> Conversion:
    """Find out how numbers of a unit are converted.

    Args:
        kind: 'position', 'velocity', 'torque', 'current', 'temperature' or 'time'.
        unit: Name of the unit, or the number of SI units that one unit of the log is.

    Returns:
        The conversion. That of a unit of `SHARES` gives rated values.

    Raises:
        InputError: The unit is unknown, or not one of this kind.
    """
    angular, linear = _SI[kind]
    if isinstance(unit, int | float):
        if not (math.isfinite(unit) and unit):
            raise InputError(f"unit {unit:g}: a number of {angular} must not be 0 or infinite")
        return Conversion(float(unit), 0.0, angular)
    name = known_unit(unit)
    if name in SHARES and kind in ("torque", "current"):
        return Conversion(SHARES[name], 0.0, angular)
    if name not in _UNITS[kind]:
        percent = list(SHARES) if kind in ("torque", "current") else []
        raise InputError(
            f"unit '{unit}' is none of {kind}; give one of {', '.join([*_UNITS[kind], *percent])}, "
            f"or the number of {angular} that one unit is"
        )
    si = linear if name in _LINEAR else angular
    return Conversion(_UNITS[kind][name], _KELVIN if name == "K" else 0.0, si)


def known_unit(text: str) -> str | None:
    """Return the usual name of a unit that is written in any way; None if it is no unit.

    Args:
        text: Such as "N·m", "°/s" or "µs".
    """
    plain = text.strip().lower().replace("µ", "u").replace("μ", "u")  # the sign and the letter
    for mark in (" ", "·", "*", "."):
        plain = plain.replace(mark, "")
    plain = _OTHER_NAMES.get(plain, plain)
    if plain in SHARES:
        return plain
    names = {name.lower(): name for units in _UNITS.values() for name in units}
    return names.get(plain)


def split_unit(name: str) -> tuple[str, str | None]:
    """Separate the name of a column from a unit that stands behind it in brackets.

    Args:
        name: Such as "AxisPos_Act1 [°]". Brackets without a unit remain part of the name.

    Returns:
        The name, and the usual name of the unit; None if there is none.
    """
    name = name.strip()
    found = _IN_BRACKETS.search(name)
    unit = known_unit(found[1]) if found else None
    if not found or not unit or not name[: found.start()]:
        return name, None
    return name[: found.start()], unit

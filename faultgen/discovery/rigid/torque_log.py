"""Sign and scale of each logged torque, tested against an arm that can exist.

    found = [evidence_of(LogFit(one, robot)) for one in recordings]
    signs(found)

A hypothesis is accepted if its likelihood is e^`LOG_CERTAIN` times that of the log as it is.
Otherwise the torque stays as it was logged.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from faultgen.discovery.rigid.log_fit import PARTS, LogFit
from faultgen.inference.limits import AGAINST, LOG_CERTAIN, LOG_GAIN
from faultgen.recordings.checks import LATEST
from faultgen.robot import Robot

_SMALL, _SMALL_AXES = 2.0, 3  # evidence for a common small unit, over the usual, and axes with it:
# an arm that swings nearly freely, such as a double pendulum, also needs little torque
_NEAR = 0.5  # standard deviation of the log of a gain about a known factor: model and constants
_ALONE = 300.0  # torque of the links over that of one axis, from which it may have a small unit
_WIDTHS = np.linspace(-1.0, 1.0, 9)  # of the log of a gain about a factor
_GRID = np.arange(-4.0, 4.1, 0.25)  # of the decimal log of any gain


@dataclass(frozen=True)
class Factor:
    """What a log may be in, other than the torque that is asked for."""

    unit: str
    """In words."""
    values: np.ndarray
    """Logged torque over the torque, shape (n_axes,)."""
    common: bool
    """Whether it only occurs on all axes together."""


@dataclass(frozen=True)
class Evidence:
    """What the torque of one axis of a recording says about its sign and gain."""

    sign: float
    """Log likelihood of the logged sign over that of the other; 0 if it cannot be judged."""
    factors: tuple[float, ...]
    """Log likelihood of each of `known_factors` over that of the log as it is."""
    is_shown: bool
    """Whether the links are seen in the torque at the best gain, so that it can be judged."""
    gain: float
    """The best gain of any, without sign."""
    spread: float
    """Standard deviation of its natural log."""
    any_gain: float
    """Log likelihood of this gain over that of the log as it is."""
    parts: float
    """Torque of the links before they cancel each other, over that measured."""
    error: float
    """Error of free parameters on blocks that were not fitted, over the torque's deviation."""
    late: int
    """Samples by which the torque is late."""


def known_factors(robot: Robot, side: str) -> list[Factor]:
    """List the units and sides that logs come in by mistake.

    Args:
        robot: The model.
        side: Side of the recording.

    Returns:
        The factors, the smaller ones of single axes and those of all axes.
    """
    every = np.ones(robot.n_axes)
    ratio = np.abs(robot.gear_ratio)
    at_motor = side == "motor"
    largest = robot.motor_torque_limit * (1.0 if at_motor else ratio)
    return [
        Factor("is in thousandths of its unit, such as mN m", 1e3 * every, False),
        Factor("is in thousands of its unit, such as kN m", 1e-3 * every, False),
        Factor("is that of the joint, not of the motor", ratio, False)
        if at_motor
        else Factor("is that of the motor, not of the joint", 1 / ratio, False),
        Factor("is in kgf m", every / 9.80665, True),
        Factor("was multiplied by 9.80665", 9.80665 * every, True),
        *(
            [Factor("is in per cent of the drive's largest torque", 100 / largest, True)]
            if np.isfinite(largest).all()
            else []
        ),
    ]


def evidence_of(fit: LogFit) -> list[Evidence | None]:
    """Judge sign and gain of each axis.

    Args:
        fit: The fit of a recording.

    Returns:
        The evidence by axis; None where an axis hardly moves or its torque is constant.
    """
    factors = known_factors(fit.robot, fit.recording.side)
    return [
        None if given is None else _of_axis(fit, axis, [one.values[axis] for one in factors])
        for axis, given in enumerate(fit.axes)
    ]


def _of_axis(fit: LogFit, axis: int, factors: Sequence[float]) -> Evidence:
    def about(gain: float, parts: bool) -> float:
        """Least misfit of the gains about one."""
        near = fit.misfit(axis, gain * np.exp(_WIDTHS), parts=parts)
        return float(np.min(near + (_WIDTHS / _NEAR) ** 2))

    sign = (about(-1.0, True) - about(1.0, True)) / 2
    forward = 1.0 if sign >= 0 else -1.0
    logged = about(forward, False)
    by_gain = fit.misfit(axis, forward * 10**_GRID, parts=False)
    weight = np.exp(-(by_gain - by_gain.min()) / 2)
    mean = float(weight @ _GRID / weight.sum())
    spread = float(np.sqrt(weight @ (_GRID - mean) ** 2 / weight.sum()) * np.log(10))
    rubbing = float(fit.misfit(axis, forward, links=False, parts=False)[0])
    parts = fit.parts(axis)
    if PARTS * parts >= 1:  # the torque is smaller than the errors of its parts
        sign = 0.0
    return Evidence(
        sign=sign,
        factors=tuple((logged - about(forward * value, False)) / 2 for value in factors),
        is_shown=bool((rubbing - by_gain.min()) / 2 >= LOG_CERTAIN),
        gain=10**mean,
        spread=spread,
        any_gain=(logged - float(by_gain.min())) / 2,
        parts=parts,
        error=fit.error(axis),
        late=_lateness(fit, axis, forward),
    )


def _lateness(fit: LogFit, axis: int, sign: float) -> int:
    """Samples by which the measured torque is behind the motion; 0 unless it is clear.

    A lag is clear if it explains half of what the model with friction leaves without it. Near its
    best value it explains so little that elasticity and smoothing shift it by some samples.
    """
    given = fit.axes[axis]
    assert given is not None
    rows = fit.rows[given.at]
    inside = (rows >= LATEST) & (rows < len(fit.measured) - LATEST)
    if inside.sum() < LATEST:
        return 0
    one, direction, speed, acceleration, model = given.columns[inside, -6:-1].T
    moved = model + (0.0 if fit.recording.link else fit.rotor[axis]) * acceleration
    columns = np.column_stack([moved, direction, speed, one, -one])

    def left(lag: int) -> float:
        torque = sign * fit.measured[rows[inside] + lag, axis]
        return float(nnls(columns, torque)[1] ** 2)

    by_lag = {lag: left(lag) for lag in range(-LATEST, LATEST + 1)}
    best = min(by_lag, key=lambda lag: by_lag[lag])
    return best if by_lag[best] < 0.5 * by_lag[0] else 0


def common_factor(found: Sequence[Evidence | None], factors: Sequence[Factor]) -> int | None:
    """Find the factor that all axes of a recording have in common.

    Args:
        found: The evidence by axis.
        factors: Those of `known_factors`.

    Returns:
        Its number, or None. At least two axes need it, and no axis that can be judged speaks
        against it.
    """
    able = [one for one in found if one is not None and one.is_shown]
    totals = [
        sum(one.factors[k] for one in able)
        if len(able) > 1 and min(one.factors[k] for one in able) >= AGAINST
        else 0.0
        for k in range(len(factors))
    ]
    best = int(np.argmax(totals))
    if factors[best].values.max() < 1:
        return best if totals[best] >= _SMALL * LOG_CERTAIN and len(able) >= _SMALL_AXES else None
    return best if totals[best] >= LOG_CERTAIN else None


def own_factor(one: Evidence, factors: Sequence[Factor]) -> tuple[int, int | None] | None:
    """Find the factor of a single axis.

    A torque that is much smaller than the parts of which it consists may also be that of an axis
    that swings nearly freely, so that small units are accepted only far beyond.

    Args:
        one: The evidence of the axis.
        factors: Those of `known_factors`.

    Returns:
        Its number, and that of another factor that explains the torque about as well or None; None
        if the torque is as it should be, or has no known factor.
    """
    if not one.is_shown:
        return None
    able = [
        k
        for k, factor in enumerate(factors)
        if not factor.common
        and one.factors[k] >= LOG_CERTAIN
        and (factor.values.min() > 1 or one.parts > _ALONE)
    ]
    able.sort(key=lambda k: -one.factors[k])
    if not able:
        return None
    close = len(able) > 1 and one.factors[able[0]] < one.factors[able[1]] + AGAINST
    return able[0], able[1] if close else None


def own_gain(one: Evidence) -> float | None:
    """Return the gain of an axis if it is large, certain and no known factor; otherwise None.

    Args:
        one: The evidence of the axis.
    """
    if not one.is_shown or one.any_gain < LOG_CERTAIN or abs(np.log(one.gain)) < np.log(LOG_GAIN):
        return None
    if one.gain < 1 and PARTS * one.parts >= 1:  # it may swing nearly freely
        return None
    return one.gain


def doubtful_gain(one: Evidence) -> float | None:
    """Return the gain of an axis if it seems large, although that is not certain; otherwise None.

    A small one is not doubtful, as it may be that of an axis that swings nearly freely.

    Args:
        one: The evidence of the axis.
    """
    is_large = np.log(one.gain) > max(np.log(LOG_GAIN), 2 * one.spread)
    return one.gain if one.is_shown and is_large else None


def signs(
    found: Sequence[Sequence[Evidence | None]], known: np.ndarray | None = None
) -> list[np.ndarray]:
    """Decide on the signs of recordings with the same sensors.

    A recording that cannot tell the sign of an axis gets that which all together tell.

    Args:
        found: The evidence of each recording by axis.
        known: Signs of an earlier recording, shape (n_axes,), for axes that none of these can tell.

    Returns:
        Factors 1 and -1 for each recording, shape (n_axes,).
    """
    ratios = np.array([[0.0 if one is None else one.sign for one in axes] for axes in found])
    together = ratios.sum(axis=0)
    if known is not None:
        together = np.where(np.abs(together) >= LOG_CERTAIN, together, LOG_CERTAIN * known)
    decided = np.where(np.abs(ratios) >= LOG_CERTAIN, ratios, together)
    return list(np.where(decided <= -LOG_CERTAIN, -1.0, 1.0))

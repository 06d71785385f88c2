"""Friction on a rotor, in numba: at which torque it slips, and what it does before.

Within a step friction is a closed function of the state: LuGre bristles relax exponentially at the
mean speed, elastic-plastic elements stretch with the angle and are clipped at their yield torque.
"""

from __future__ import annotations

import math

from numba import njit
from sealed.columns import (
    ASYMMETRY,
    ASYMMETRY_W,
    COULOMB,
    COULOMB_W,
    EXPONENT,
    FC,
    FS,
    LAG,
    LAG_W,
    LOAD,
    LOAD_EXP,
    MODE,
    PERIODIC,
    PERIODIC_ORDER,
    S0,
    S1,
    SPOT,
    SPOT_AT,
    SPOT_WIDTH,
    STATIC,
    STATIC_EXP,
    STRIBECK,
    STRIBECK_EXP,
    VS,
    W0,
)

_STIFF = (0.5, 0.3, 0.2)  # shares of the bristle stiffness of the elastic-plastic elements
_YIELD = (0.25, 0.35, 0.4)  # shares of the friction level at which they slip


@njit(cache=True)
def power(base, exponent):  # type: ignore[no-untyped-def]
    """Compute a power.

    Args:
        base: A number that is not negative.
        exponent: The exponent.

    Returns:
        The power.
    """
    return math.exp(exponent * math.log(base)) if base > 1e-12 else 0.0


@njit(cache=True)
def friction_level(p, slow, w, th, q, load, lagged):  # type: ignore[no-untyped-def]
    """Compute the torque at which the friction of one axis slips [N m].

    Args:
        p: Parameters of the axis.
        slow: Row of the table `SLOWLY`.
        w: Motor velocity [rad/s].
        th: Motor angle [rad].
        q: Joint angle [rad].
        load: Load of the gearbox.
        lagged: Motor velocity after a lag [rad/s].
    """
    speed = abs(w)
    sign = 1.0 if w >= 0 else -1.0
    level = p[FC] + (p[FS] - p[FC]) * slow[1] * math.exp(
        -power(speed / (p[VS] * slow[2]), p[EXPONENT])
    )
    if p[COULOMB] != 0:
        level += p[COULOMB] * speed / (speed + p[COULOMB_W])
    if p[STATIC] != 0:
        level += p[STATIC] * math.exp(-power(speed / p[VS], p[STATIC_EXP]))
    if p[STRIBECK] != 0:
        wider = math.exp(-power(speed / (p[VS] * (1 + p[STRIBECK])), p[STRIBECK_EXP]))
        narrow = math.exp(-power(speed / p[VS], p[STRIBECK_EXP]))
        level += (p[FS] - p[FC]) * (wider - narrow)
    if p[ASYMMETRY] != 0:
        level += p[ASYMMETRY] * 0.5 * (1 + math.tanh(w / p[ASYMMETRY_W]))
    if p[LOAD] != 0:
        level += p[LOAD] * power(abs(load), p[LOAD_EXP])
    if p[SPOT] != 0:
        level += p[SPOT] * math.exp(-(((q - p[SPOT_AT]) / p[SPOT_WIDTH]) ** 2))
    if p[PERIODIC] != 0:
        level += p[PERIODIC] * math.cos(p[PERIODIC_ORDER] * th)
    if p[LAG] != 0:
        level += p[LAG] * math.tanh(sign * (w - lagged) / p[LAG_W])
    level += slow[3]
    return max(level, 1e-2 * p[FC])


@njit(cache=True)
def bristles(p, level, w, mean_w, turned, time, z, out):  # type: ignore[no-untyped-def]
    """Compute the friction of the sliding kind [N m], after some time and motion.

    Args:
        p: Parameters of the axis.
        level: Torque at which friction slips [N m].
        w: Motor velocity [rad/s].
        mean_w: Mean motor velocity over the time [rad/s].
        turned: Angle of the motor over the time [rad].
        time: Time since the bristles had the state z [s].
        z: State of the bristles before.
        out: The new state is written here.
    """
    mode = int(p[MODE])
    if mode == 0:
        ends = level / p[S0]
        rate = abs(mean_w) / ends
        settled = ends if mean_w >= 0 else -ends
        out[0] = settled + (z[0] - settled) * math.exp(-rate * time)
        return p[S0] * out[0] + p[S1] * (w - abs(w) * out[0] / ends)
    if mode == 1:
        torque = 0.0
        for k in range(3):
            stiffness = _STIFF[k] * p[S0]
            ends = _YIELD[k] * level / stiffness
            out[k] = min(max(z[k] + turned, -ends), ends)
            torque += stiffness * out[k]
        return torque
    return level * math.tanh(w / p[W0])

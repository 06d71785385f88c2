"""Laws of a drivetrain in numba: gearbox and friction of an axis, with the effects that they have.

`p` is the row of an axis, with the columns of `parameters.NAMES`.
"""

from __future__ import annotations

import math

import numpy as np
from laboratories.parameters import (
    COULOMB,
    DAMP,
    RATIO,
    REST,
    RISE,
    SPEED,
    STIFF,
    U_LAG,
    U_PLACE,
    U_WARM,
    VISCOUS,
    X_COULOMB,
    X_HARD,
    X_LOAD,
    X_LOAD_REF,
    X_ONE_WAY,
    X_ORDER,
    X_PHASE,
    X_PLAY,
    X_QUADRATIC,
    X_REF,
    X_SOFT,
    X_STATIC,
    X_STRIBECK,
    X_TWIST_REF,
    X_VISCOUS,
    X_WAVE,
)
from numba import njit


@njit(cache=True)
def dead_zone(x, play):  # type: ignore[no-untyped-def]
    """Twist beyond a play with parabolic corners."""
    half, corner = 0.5 * play, 0.1 * play
    beyond = abs(x) - half + corner
    if beyond <= 0:
        return 0.0
    out = beyond * beyond / (4 * corner) if beyond < 2 * corner else beyond - corner
    return out if x > 0 else -out


@njit(cache=True)
def gear(p, q, qd, th, w):  # type: ignore[no-untyped-def]
    """Torque of the gearbox on its joint [N m]."""
    twist = th / p[RATIO] - q
    rate = w / p[RATIO] - qd
    if p[X_WAVE] != 0:
        phase = p[X_ORDER] * th + p[X_PHASE]
        twist -= p[X_WAVE] * (math.sin(phase) + 0.12 * math.sin(2 * phase + 1.0))
        rate -= p[X_WAVE] * p[X_ORDER] * w * (math.cos(phase) + 0.24 * math.cos(2 * phase + 1.0))
    damping = p[DAMP]
    if p[X_PLAY] > 0:
        left = dead_zone(twist, p[X_PLAY])
        damping *= 0.4 + 0.6 * min(abs(left) / (0.2 * p[X_PLAY]), 1.0)
        twist = left
    torque = p[STIFF] * twist
    if p[X_SOFT] != 0:
        torque *= 1 - p[X_SOFT] * (1.1 - 0.15 * math.tanh(abs(twist) / p[X_TWIST_REF]))
    if p[X_HARD] != 0:
        square = (twist / 1e-3) ** 2
        torque += (
            p[STIFF] * twist * p[X_HARD] * square / (1 + square * (1e-3 / 5 / p[X_TWIST_REF]) ** 2)
        )
    return torque + damping * rate


@njit(cache=True)
def level(p, w, lagged, q, load, factor, warm):  # type: ignore[no-untyped-def]
    """Friction level [N m]: what a slipping contact takes from the rotor.

    Args:
        p: The axis.
        w: Motor speed [rad/s].
        lagged: The speed a little earlier [rad/s].
        q: Joint angle.
        load: Torque of the gearbox over the ratio [N m].
        factor: Of Coulomb friction, rise and its speed: shape (>= 4,), entries 1 to 3.
        warm: Decay of the friction that warms away, from 1 to 0.
    """
    speed = abs(w)
    curve = math.exp(-speed / (p[SPEED] * factor[3] * (1 + p[X_STRIBECK])))
    out = p[COULOMB] * factor[1] + p[RISE] * factor[2] * curve
    if p[X_COULOMB] != 0:
        out += p[X_COULOMB] * (max(speed, 1e-3 * p[X_REF]) / p[X_REF]) ** 0.06
    if p[X_STATIC] != 0:
        out += p[X_STATIC] / (1 + (speed / p[SPEED]) ** 2)
    if p[X_QUADRATIC] != 0:
        out += p[X_QUADRATIC] * (speed / p[X_REF]) ** 2.2
    if p[X_ONE_WAY] != 0:
        out += p[X_ONE_WAY] * 0.5 * (1 + w / math.sqrt(w * w + (0.3 * p[SPEED]) ** 2))
    if p[X_LOAD] != 0:
        out += p[X_LOAD] * p[X_LOAD_REF] * (abs(load) / p[X_LOAD_REF]) ** 1.1
    if p[U_LAG] != 0:
        change = abs(w) - abs(lagged)
        out += p[U_LAG] * math.tanh(change / (0.1 * p[X_REF]))
    if p[U_PLACE] != 0:
        out += p[U_PLACE] * math.sin(3 * q) ** 2
    if p[U_WARM] != 0:
        out += p[U_WARM] * warm
    return max(out, 0.02 * p[COULOMB])


@njit(cache=True)
def viscous(p, w, factor):  # type: ignore[no-untyped-def]
    """Viscous friction of an axis at a speed [N m s/rad]; see `level` for the arguments."""
    out = p[VISCOUS] * factor[0]
    if p[X_VISCOUS] != 0:
        out += p[VISCOUS] * p[X_VISCOUS] * 1.15 / (1 + 0.15 * abs(w) / p[X_REF])
    return out


@njit(cache=True)
def steady_friction(p, w, q, load, slow):  # type: ignore[no-untyped-def]
    """Friction at steady speeds, smooth where the motor turns back: what a controller may know.

    Args:
        p: Shape (n_axes, columns).
        w: Motor speed, shape (times, n_axes), in [rad/s].
        q: Joint position, same shape.
        load: Torque of the gearbox over the ratio, same shape, in [N m].
        slow: See `integrate`.

    Returns:
        Same shape, in [N m].
    """
    out = np.zeros_like(w)
    for k in range(len(w)):
        for i in range(len(p)):
            top = level(p[i], w[k, i], w[k, i], q[k, i], load[k, i], slow[i], 0.0)
            out[k, i] = top * math.tanh(w[k, i] / (0.5 * p[i, SPEED]))
            out[k, i] += viscous(p[i], w[k, i], slow[i]) * w[k, i]
    return out


@njit(cache=True)
def dahl(p, top, turned, z):  # type: ignore[no-untyped-def]
    """Bristle torque after the motor turned by an angle, in closed form [N m].

    Args:
        p: The axis.
        top: Torque at which it slips [N m].
        turned: Angle [rad].
        z: Bristle torque before [N m].
    """
    if turned == 0.0:
        return z
    end = top if turned > 0 else -top
    return end + (z - end) * math.exp(-p[REST] * abs(turned) / max(top, 1e-9))

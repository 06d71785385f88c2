"""Rotors, gearboxes, friction and a sampled servo in time, in numba.

Position Verlet: angles drift half a step, all forces are taken in the middle with a velocity that
is predicted from the last acceleration, angles drift the other half. Second order, one evaluation
of the arm a step. Dahl's bristle follows the turned angle in closed form. The servo runs at its own
period and holds its torque in between.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from laboratories.arm import Body, forward, workspace
from laboratories.parameters import (
    COULOMB,
    DAMP,
    FORWARD,
    FORWARD_SPEED,
    KD,
    KI,
    KP,
    LIMIT,
    OFFSET,
    PERIOD,
    RATIO,
    REST,
    RISE,
    ROTOR,
    SMOOTH,
    SPEED,
    STIFF,
    TANH,
    TYPE,
    U_CLIP,
    U_GAIN,
    U_HOSE,
    U_HOSE_WIDTH,
    U_LAG,
    U_PLACE,
    U_WARM,
    VISCOUS,
    X_CONSTANT,
    X_COULOMB,
    X_DELAY,
    X_ENCODER,
    X_HARD,
    X_LOAD,
    X_LOAD_REF,
    X_ONE_WAY,
    X_ORDER,
    X_PHASE,
    X_PLAY,
    X_QUADRATIC,
    X_REF,
    X_RIPPLE,
    X_SOFT,
    X_SPRING,
    X_STATIC,
    X_STRIBECK,
    X_TORQUE,
    X_TWIST_REF,
    X_VISCOUS,
    X_WAVE,
    X_WRIST,
)

STEP = 1.25e-4
"""Step [s] of all simulations, recordings and oracle. It divides `DENSE` and every servo period.
Against a quarter of it, torques of the robots are off by less than 1e-4 (3e-4 at 2.5e-4), changes
by an effect by 0.03 % at 9 of 10 axes, and by 6 % at most (11 % at 2.5e-4)."""
DENSE = 5e-4
"""Time between the rows of a run [s]."""
GRID = 1e-3
"""Time between the rows of a motion [s]."""
CHANNELS = ("motor_position", "motor_velocity", "motor_torque", "gear_torque", "joint_position")
"""Of a run; the gear torque is joint side."""
_DENSER = round(GRID / DENSE)  # rows of a run for each row of a motion
_LAG = 0.03  # time over which speed is compared with itself [s]
_WARM = 20.0  # time constant of friction that decays [s]


def whole(time: float, part: float) -> int:
    """How often a time has room for a part of it, which must be a whole number.

    Rounding instead would make a run longer or shorter than its motion.

    Args:
        time: [s].
        part: [s].

    Returns:
        The quotient.

    Raises:
        ValueError: It is not a whole number of at least 1.
    """
    count = round(time / part)
    if count < 1 or abs(count * part - time) > 1e-6 * part:
        raise ValueError(f"{part:g} s does not divide {time:g} s")
    return count


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


@njit(cache=True)
def _set_point(table, t, row, axis):  # type: ignore[no-untyped-def]
    """Row of a table every `GRID` at a time, linear in between."""
    x = min(max(t / GRID, 0.0), len(table) - 1.0)
    k = min(int(x), len(table) - 2)
    f = x - k
    return table[k, row, axis] * (1 - f) + table[k + 1, row, axis] * f


@njit(cache=True)
def _servo(p, th, w, table, t, axis, state, holds):  # type: ignore[no-untyped-def]
    """Torque that the servo commands from now on [N m]; `state` is its integral."""
    late = t - p[X_DELAY]
    want = _set_point(table, late, 0, axis)
    rate = _set_point(table, late, 1, axis) * p[FORWARD_SPEED]
    ahead = _set_point(table, late, 2, axis) * p[FORWARD]
    gain = 1 - p[U_GAIN]
    angle = th - p[RATIO] * p[X_ENCODER]
    if p[TYPE] == 2:
        error = p[KP] * gain * (want - angle) + rate - w
    else:
        error = want - angle
    limit = p[LIMIT]
    if p[U_CLIP] > 0:
        limit *= 1 - (1 - p[U_CLIP]) * min(abs(w) / (2.5 * p[X_REF]), 1.0)
    if p[TYPE] == 2:
        torque = p[KD] * gain * error + p[KI] * gain * state[axis] + ahead
    else:
        torque = (p[KP] * error + p[KD] * (rate - w) + p[KI] * state[axis]) * gain + ahead
    if abs(torque) < limit and not holds:
        state[axis] += error * p[PERIOD]
    return min(max(torque, -limit), limit)


def integrate(
    body: Body,
    p: np.ndarray,
    table: np.ndarray,
    slow: np.ndarray,
    state: np.ndarray,
    step: float,
    lead: float,
    servo_on: bool,
    integral: np.ndarray,
    follow: np.ndarray | None = None,
) -> np.ndarray:
    """Run a robot along set points.

    Args:
        body: From `arm.body_arrays`.
        p: Shape (n_axes, columns), as in `parameters.NAMES`.
        table: Set points every `GRID`, shape (times, 3, n_axes): angle, speed, feed-forward torque.
        slow: Factors of viscous friction, Coulomb friction, rise and its speed, and the drift of
            the torque offset; shape (n_axes, 5); for the whole motion.
        state: Joint position, joint velocity, motor angle, motor velocity: shape (4, n_axes).
        step: [s].
        lead: Time at rest before the first row [s]; 0 for none.
        servo_on: Whether there is a servo; without one the motors give no torque.
        integral: Value of the servo's integral at the beginning, shape (n_axes,).
        follow: Motor speed at every step from the beginning of the lead, shape (steps, n_axes). The
            rotors then move like that, and the torque is what the motors need for it.

    Returns:
        Shape (rows, n_axes, channels), every `DENSE`, as in `CHANNELS`.

    Raises:
        ValueError: The step does not divide `DENSE`, the lead or the period of a servo.
    """
    every = whole(DENSE, step)
    before = whole(lead, step) if lead else 0
    ticks = np.array([whole(period, step) for period in p[:, PERIOD]], np.int64)
    track = np.zeros((0, len(p))) if follow is None else follow
    run: np.ndarray
    run, _ = _run(
        body, p, table, slow, state, step, every, before, ticks, servo_on, integral, track
    )
    return run


def motor_speeds(
    body: Body,
    p: np.ndarray,
    table: np.ndarray,
    slow: np.ndarray,
    state: np.ndarray,
    step: float,
    lead: float,
    integral: np.ndarray,
) -> np.ndarray:
    """Motor speeds of a run with its servo, for the `follow` of other runs.

    Args:
        body: As for `integrate`, like all others.
        p: Same.
        table: Same.
        slow: Same.
        state: Same.
        step: Same.
        lead: Same.
        integral: Same.

    Returns:
        Shape (steps, n_axes), from the beginning of the lead, in [rad/s].
    """
    before = whole(lead, step) if lead else 0
    ticks = np.array([whole(period, step) for period in p[:, PERIOD]], np.int64)
    every, none = whole(DENSE, step), np.zeros((0, len(p)))
    speeds: np.ndarray
    _, speeds = _run(body, p, table, slow, state, step, every, before, ticks, True, integral, none)
    return speeds


@njit(cache=True)
def _needed(p, given):  # type: ignore[no-untyped-def]
    """Torque that a motor must be commanded for a torque on its rotor [N m]."""
    drive = given
    if p[X_CONSTANT] != 0:
        for _ in range(8):  # contracts by 0.2 X_CONSTANT or less each time
            drive = given / (1 - p[X_CONSTANT] * (0.9 + 0.2 * abs(drive) / p[LIMIT]))
    return drive


@njit(cache=True)
def _run(body, p, table, slow, state, step, every, before, ticks, servo_on, integral, track):  # type: ignore[no-untyped-def]
    """Do what `integrate` says; `every`, `before` and `ticks` count steps."""
    n = len(p)
    rows = (len(table) - 1) * _DENSER + 1
    out = np.zeros((rows, n, 5))
    q, qd, th, w = state[0].copy(), state[1].copy(), state[2].copy(), state[3].copy()
    qm, qdm, thm = np.zeros(n), np.zeros(n), np.zeros(n)
    z, hose = np.zeros(n), np.zeros(n)
    lagged = w.copy()
    acc, qdd = np.zeros(n), np.zeros(n)
    joint, gears, drive = np.zeros(n), np.zeros(n), np.zeros(n)
    kept = integral.copy()
    work = workspace(n)
    total = before + (rows - 1) * every + 1
    followed = len(track) > 0
    speeds = np.zeros((total + 1, n))
    speeds[0] = w
    for k in range(total):
        t = (k - before) * step
        if servo_on and not followed:
            for i in range(n):
                if k % ticks[i] == 0:
                    drive[i] = _servo(p[i], th[i], w[i], table, t, i, kept, False)
        if k >= before and (k - before) % every == 0:
            row = (k - before) // every
            for i in range(n):
                out[row, i, 0] = th[i] - p[i, RATIO] * p[i, X_ENCODER]
                out[row, i, 1] = w[i]
                out[row, i, 2] = drive[i]
                out[row, i, 3] = gear(p[i], q[i], qd[i], th[i], w[i])
                out[row, i, 4] = q[i]
        warm = math.exp(-max(t, 0.0) / _WARM)
        for i in range(n):
            qm[i] = q[i] + 0.5 * step * qd[i]
            thm[i] = th[i] + 0.5 * step * w[i]
            qdm[i] = qd[i] + 0.5 * step * qdd[i]
            wm = w[i] + 0.5 * step * acc[i]
            torque = gear(p[i], qm[i], qdm[i], thm[i], wm)
            gears[i] = torque
            joint[i] = torque
            load = torque / p[i, RATIO]
            top = level(p[i], wm, lagged[i], qm[i], load, slow[i], warm)
            hard = top * (1 - p[i, SMOOTH])
            z[i] = dahl(p[i], hard, thm[i] - th[i], z[i])
            friction = z[i] + top * p[i, SMOOTH] * math.tanh(wm / p[i, TANH])
            friction += viscous(p[i], wm, slow[i]) * wm
            given = 0.0 if followed else drive[i]
            if not followed and p[i, X_CONSTANT] != 0:
                given *= 1 - p[i, X_CONSTANT] * (0.9 + 0.2 * abs(drive[i]) / p[i, LIMIT])
            given += p[i, OFFSET] + p[i, X_TORQUE] * slow[i, 4]
            if p[i, X_RIPPLE] != 0:
                phase = p[i, X_ORDER] * thm[i] + p[i, X_PHASE]
                given -= p[i, X_RIPPLE] * (math.sin(phase) + 0.12 * math.sin(3 * phase))
            if followed:
                acc[i] = (track[k + 1, i] - track[k, i]) / step
                # `given` still is what acts without a motor's torque
                drive[i] = _needed(p[i], acc[i] * p[i, ROTOR] + friction + load - given)
                if k >= before and (k - before) % every == 0:
                    out[(k - before) // every, i, 2] = drive[i]
            else:
                acc[i] = (given - friction - load) / p[i, ROTOR]
        for i in range(n):
            if p[i, X_SPRING] != 0:
                joint[i] -= p[i, X_SPRING] * qm[i] * (1 - 0.04 * qm[i] ** 2)
            if p[i, U_HOSE] != 0:
                joint[i] -= hose[i]
                turned = 0.5 * step * (qd[i] + qdm[i])
                end = p[i, U_HOSE] if turned > 0 else -p[i, U_HOSE]
                hose[i] = end + (hose[i] - end) * math.exp(-abs(turned) / p[i, U_HOSE_WIDTH] * 2)
            if p[i, X_WRIST] != 0 and i > 0:
                drag = p[i, X_WRIST] * math.tanh(
                    (qdm[i] - qdm[i - 1]) / (0.4 * p[i, SPEED] / abs(p[i, RATIO]))
                )
                joint[i] -= drag
                joint[i - 1] += drag
        forward(body, qm, qdm, joint, qdd, work)
        for i in range(n):
            qd[i] += step * qdd[i]
            q[i] = qm[i] + 0.5 * step * qd[i]
            w[i] += step * acc[i]
            after = thm[i] + 0.5 * step * w[i]
            top = level(p[i], w[i], lagged[i], q[i], gears[i] / p[i, RATIO], slow[i], warm)
            z[i] = dahl(p[i], top * (1 - p[i, SMOOTH]), after - thm[i], z[i])
            th[i] = after
            lagged[i] += (w[i] - lagged[i]) * step / _LAG
            speeds[k + 1, i] = w[i]
    return out, speeds

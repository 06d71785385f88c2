"""Rotors, gearboxes, friction and a sampled servo in time, in numba.

Position Verlet: angles drift half a step, all forces are taken in the middle with a velocity that
is predicted from the last acceleration, angles drift the other half. Second order, one evaluation
of the arm a step. Dahl's bristle follows the turned angle in closed form. The servo runs at its own
period and holds its torque in between.
"""

from __future__ import annotations

import math

import numpy as np
from laboratories.arm import Body, forward, workspace
from laboratories.laws import dahl, gear, level, viscous
from laboratories.parameters import (
    FORWARD,
    FORWARD_SPEED,
    KD,
    KI,
    KP,
    LIMIT,
    OFFSET,
    PERIOD,
    RATIO,
    ROTOR,
    SMOOTH,
    SPEED,
    TANH,
    TYPE,
    U_CLIP,
    U_GAIN,
    U_HOSE,
    U_HOSE_WIDTH,
    X_CONSTANT,
    X_DELAY,
    X_ENCODER,
    X_ORDER,
    X_PHASE,
    X_REF,
    X_RIPPLE,
    X_SPRING,
    X_TORQUE,
    X_WRIST,
)
from numba import njit

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
    track = np.zeros((0, len(p))) if follow is None else follow
    run, _ = _whole_run(body, p, table, slow, state, step, lead, servo_on, integral, track)
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
    none = np.zeros((0, len(p)))
    _, speeds = _whole_run(body, p, table, slow, state, step, lead, True, integral, none)
    return speeds


def _whole_run(
    body: Body,
    p: np.ndarray,
    table: np.ndarray,
    slow: np.ndarray,
    state: np.ndarray,
    step: float,
    lead: float,
    servo_on: bool,
    integral: np.ndarray,
    track: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Rows of a run, and motor speeds at all of its steps; no `track` stands for a servo."""
    every = whole(DENSE, step)
    before = whole(lead, step) if lead else 0
    ticks = np.array([whole(period, step) for period in p[:, PERIOD]], np.int64)
    run, speeds = _run(
        body, p, table, slow, state, step, every, before, ticks, servo_on, integral, track
    )
    return run, speeds


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

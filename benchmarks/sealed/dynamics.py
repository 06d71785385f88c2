"""A robot with rotors, gearboxes, friction and servo as differential equations, in numba.

Runge-Kutta of fourth order at 0.1 ms with continuous set points. Friction within a step is a
closed function of the stage's state: LuGre bristles relax exponentially at the mean speed,
elastic-plastic elements stretch with the angle and are clipped at their yield torque.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from sealed.columns import (
    CLIP,
    CLIP_W,
    CONSTANT,
    CONSTANT_SLOPE,
    COUPLING,
    COUPLING_W,
    DELAY,
    ENCODER,
    F0,
    FV,
    HARD,
    HARD_FROM,
    KD,
    KP,
    LAG,
    LAG_TIME,
    LIMIT,
    PLAY,
    PLAY_SOFT,
    QUADRATIC,
    QUADRATIC_EXP,
    RIPPLE,
    RIPPLE_ORDER,
    RIPPLE_PHASE,
    SOFT,
    SOFT_TWIST,
    SPRING,
    SPRING_RATE,
    TOOTH,
    TOOTH_AT,
    TOOTH_WIDTH,
    VISCOUS,
    VISCOUS_EXP,
    WAVE,
    WAVE_ORDER,
    WAVE_PHASE,
    D,
    J,
    K,
    N,
)
from sealed.friction import bristles, friction_level, power
from sealed.rigid import mass_and_bias, solve

STEP = 1e-4
"""Step [s]."""
CHANNELS = (
    "motor_position",
    "motor_velocity",
    "motor_torque",
    "friction_torque",
    "gear_torque",
    "joint_position",
    "joint_velocity",
)
"""What `integrate` returns, in this order; gear torque and joints are arm side."""
SLOWLY = ("viscous", "height", "stribeck", "drag", "offset")
"""What may change with time: three factors, a friction level [N m], a torque on the rotor [N m]."""


@njit(cache=True)
def gear_torque(p, q, qd, th, w):  # type: ignore[no-untyped-def]
    """Compute the torque of the gearbox on its joint [N m].

    Args:
        p: Parameters of the axis.
        q: Joint angle [rad].
        qd: Joint velocity [rad/s].
        th: Motor angle [rad].
        w: Motor velocity [rad/s].
    """
    twist = th / p[N] - q
    rate = w / p[N] - qd
    if p[WAVE] != 0:
        phase = p[WAVE_ORDER] * th + p[WAVE_PHASE]
        twist -= p[WAVE] * (math.sin(phase) - math.sin(3 * phase) / 9) / 1.05
        slope = p[WAVE_ORDER] * (math.cos(phase) - math.cos(3 * phase) / 3) / 1.05
        rate -= p[WAVE] * slope * w
    damping = p[D]
    if p[PLAY] > 0:
        soft, half = p[PLAY_SOFT], p[PLAY]
        right, left = (twist - half) / soft, (-twist - half) / soft
        touching = 1 / (1 + math.exp(min(-right, 50.0))) + 1 / (1 + math.exp(min(-left, 50.0)))
        right = right if right > 30 else math.log1p(math.exp(right))
        left = left if left > 30 else math.log1p(math.exp(left))
        twist = soft * (right - left)
        damping *= 0.5 + 0.5 * min(touching, 1.0)
    torque = p[K] * twist + damping * rate
    if p[SOFT] != 0:
        torque -= p[K] * p[SOFT] * twist / (1 + abs(twist) / p[SOFT_TWIST])
    if p[HARD] != 0:
        more = abs(twist) - p[HARD_FROM]
        if more > 0:
            torque += p[HARD] * (more if twist > 0 else -more)
    return torque


@njit(cache=True)
def drive_torque(p, position, velocity, forward, th, w):  # type: ignore[no-untyped-def]
    """Compute the torque that the servo commands and logs [N m]. It uses the angle of its encoder.

    Args:
        p: Parameters of the axis.
        position: Set point of the motor angle [rad].
        velocity: Set point of the motor velocity [rad/s].
        forward: Feed-forward torque [N m].
        th: Motor angle [rad].
        w: Motor velocity [rad/s].
    """
    torque = p[KP] * (position - th + p[N] * p[ENCODER]) + p[KD] * (velocity - w) + forward
    limit = p[LIMIT]
    if p[CLIP] != 0:
        limit *= max(0.02, 1 - p[CLIP] * abs(w) / p[CLIP_W])
    return min(max(torque, -limit), limit)


@njit(cache=True)
def _setpoints(table, period, t, p, out):  # type: ignore[no-untyped-def]
    """Cubic interpolation of position, velocity and feed-forward at time t, by axis."""
    last = len(table) - 1
    for i in range(table.shape[2]):
        x = (t - p[i, DELAY]) / period
        k = int(math.floor(x))
        f = x - k
        if x <= 0:
            k, f = 0, 0.0
        elif k >= last:
            k, f = last, 0.0
        before, after, beyond = max(k - 1, 0), min(k + 1, last), min(k + 2, last)
        for c in range(3):
            a, b, d, e = (
                table[before, c, i],
                table[k, c, i],
                table[after, c, i],
                table[beyond, c, i],
            )
            out[c, i] = b + 0.5 * f * (
                d - a + f * (2 * a - 5 * b + 4 * d - e + f * (3 * (b - d) + e - a))
            )


@njit(cache=True)
def _rates(body, p, slow, sp, y, base, z, znew, lagged, time, dy, matrix, bias, torque, work, seen):  # type: ignore[no-untyped-def] # noqa: E501
    """Rates of q, qd, th, w (rows of y); `base` is the state at the beginning of the step."""
    n = y.shape[1]
    for i in range(n):
        q, qd, th, w = y[0, i], y[1, i], y[2, i], y[3, i]
        gear = gear_torque(p[i], q, qd, th, w)
        load = gear / p[i, N]
        level = friction_level(p[i], slow[i], w, th, q, load, lagged[i])
        mean = 0.5 * (w + base[3, i])
        friction = bristles(p[i], level, w, mean, th - base[2, i], time, z[i], znew[i])
        friction += p[i, FV] * slow[i, 0] * w
        sign = 1.0 if w >= 0 else -1.0
        if p[i, VISCOUS] != 0:
            friction += p[i, VISCOUS] * sign * power(abs(w), p[i, VISCOUS_EXP])
        if p[i, QUADRATIC] != 0:
            friction += p[i, QUADRATIC] * sign * power(abs(w), p[i, QUADRATIC_EXP])
        friction -= p[i, F0] + slow[i, 4]
        if p[i, RIPPLE] != 0:
            phase = p[i, RIPPLE_ORDER] * th + p[i, RIPPLE_PHASE]
            friction += p[i, RIPPLE] * (math.sin(phase) + 0.15 * math.sin(2 * phase + 0.7))
        if p[i, TOOTH] != 0:
            angle = (th - p[i, TOOTH_AT]) / (2 * math.pi)
            x = (angle - math.floor(angle + 0.5)) * 2 * math.pi / p[i, TOOTH_WIDTH]
            if abs(x) < 6:
                friction += p[i, TOOTH] * x * math.exp(0.5 - 0.5 * x * x)
        drive = drive_torque(p[i], sp[0, i], sp[1, i], sp[2, i], th, w)
        given = drive
        if p[i, CONSTANT] != 0:
            slope = p[i, CONSTANT_SLOPE]
            given *= 1 - p[i, CONSTANT] * (1 - slope + slope * abs(drive) / p[i, LIMIT])
        dy[0, i] = qd
        dy[2, i] = w
        dy[3, i] = (given - friction - load) / p[i, J]
        torque[i] = gear
        seen[0, i], seen[1, i], seen[2, i] = drive, -friction, gear
    for i in range(n):
        if p[i, SPRING] != 0:
            torque[i] -= p[i, SPRING] * math.sin(p[i, SPRING_RATE] * y[0, i])
        if p[i, COUPLING] != 0 and i > 0:
            relative = y[1, i] - y[1, i - 1]
            drag = p[i, COUPLING] * relative / math.sqrt(relative**2 + p[i, COUPLING_W] ** 2)
            torque[i] -= drag
            torque[i - 1] += drag
    mass_and_bias(body, y[0], y[1], work, matrix, bias)
    for i in range(n):
        torque[i] -= bias[i]
    solve(matrix, torque, dy[1])


@njit(cache=True)
def integrate(body, p, table, period, slow, state, step, every, lead):  # type: ignore[no-untyped-def]
    """Integrate a robot along set points.

    Args:
        body: The arm, from `rigid.body_arrays`.
        p: Parameters, shape (n_axes, columns).
        table: Set points, shape (times, 3, n_axes): position, velocity, feed-forward, motor side.
        period: Time between the rows of `table` [s].
        slow: What changes with time, shape (samples, n_axes, 5), as in `SLOWLY`.
        state: Joint angle, joint velocity, motor angle, motor velocity: shape (4, n_axes).
        step: Step [s].
        every: Steps a sample.
        lead: Samples at rest before the first one that is kept.

    Returns:
        Shape (samples, n_axes, channels), as in `CHANNELS`.
    """
    n = p.shape[0]
    samples = slow.shape[0]
    out = np.empty((samples, n, 7))
    y, trial, total, dy = state.copy(), state.copy(), np.zeros((4, n)), np.zeros((4, n))
    z, znew, lagged = np.zeros((n, 3)), np.zeros((n, 3)), state[3].copy()
    matrix, bias, torque = np.zeros((n, n)), np.zeros(n), np.zeros(n)
    work, seen = np.zeros((n, 48)), np.zeros((3, n))
    now, middle, end = np.zeros((3, n)), np.zeros((3, n)), np.zeros((3, n))
    _setpoints(table, period, -lead * every * step, p, now)
    for sample in range(-lead, samples):
        s = slow[max(sample, 0)]
        for k in range(every):
            t = (sample * every + k) * step
            _setpoints(table, period, t + step / 2, p, middle)
            _setpoints(table, period, t + step, p, end)
            _rates(
                body, p, s, now, y, y, z, znew, lagged, 0.0, dy, matrix, bias, torque, work, seen
            )
            if k == 0 and sample >= 0:
                for i in range(n):
                    out[sample, i, 0] = y[2, i] - p[i, N] * p[i, ENCODER]
                    out[sample, i, 1] = y[3, i]
                    out[sample, i, 2], out[sample, i, 3], out[sample, i, 4] = (
                        seen[0, i],
                        seen[1, i],
                        seen[2, i],
                    )
                    out[sample, i, 5], out[sample, i, 6] = y[0, i], y[1, i]
            total[:] = dy
            trial[:] = y + 0.5 * step * dy
            _rates(
                body,
                p,
                s,
                middle,
                trial,
                y,
                z,
                znew,
                lagged,
                0.5 * step,
                dy,
                matrix,
                bias,
                torque,
                work,
                seen,
            )  # noqa: E501
            total += 2 * dy
            trial[:] = y + 0.5 * step * dy
            _rates(
                body,
                p,
                s,
                middle,
                trial,
                y,
                z,
                znew,
                lagged,
                0.5 * step,
                dy,
                matrix,
                bias,
                torque,
                work,
                seen,
            )  # noqa: E501
            total += 2 * dy
            trial[:] = y + step * dy
            _rates(
                body,
                p,
                s,
                end,
                trial,
                y,
                z,
                znew,
                lagged,
                step,
                dy,
                matrix,
                bias,
                torque,
                work,
                seen,
            )  # noqa: E501
            total += dy
            trial[:] = y + step / 6 * total
            # bristles at the new state
            for i in range(n):
                load = seen[2, i] / p[i, N]
                level = friction_level(
                    p[i], s[i], trial[3, i], trial[2, i], trial[0, i], load, lagged[i]
                )  # noqa: E501
                mean = 0.5 * (trial[3, i] + y[3, i])
                bristles(p[i], level, trial[3, i], mean, trial[2, i] - y[2, i], step, z[i], znew[i])
                for c in range(3):
                    z[i, c] = znew[i, c]
                if p[i, LAG] != 0:
                    keep = math.exp(-step / p[i, LAG_TIME])
                    lagged[i] = mean + (lagged[i] - mean) * keep
            y[:] = trial
            now[:] = end
    return out

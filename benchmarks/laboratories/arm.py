"""The rigid arm: articulated-body forward dynamics and Newton-Euler, in link frames, in numba.

Spatial vectors are (angular, linear) about the origin of the link's own frame
(Featherstone 2008, chapters 5 and 7). Slides and hinges; springs between two points of the arm.
"""

from __future__ import annotations

import math

import numpy as np
from laboratories.mjcf import Machine
from numba import njit

Body = tuple[np.ndarray, ...]
"""Arrays of an arm in the order that the functions below take them."""


def body_arrays(machine: Machine) -> Body:
    """The arrays of an arm for the functions below."""
    mass, com, about = machine.loaded()
    spatial = np.zeros((machine.n_axes, 6, 6))
    for i in range(machine.n_axes):
        c = com[i]
        cross = np.array([[0, -c[2], c[1]], [c[2], 0, -c[0]], [-c[1], c[0], 0]])
        spatial[i, :3, :3] = about[i] + mass[i] * cross @ cross.T
        spatial[i, :3, 3:] = mass[i] * cross
        spatial[i, 3:, :3] = mass[i] * cross.T
        spatial[i, 3:, 3:] = mass[i] * np.eye(3)
    own = np.zeros((machine.n_axes, 6))
    for i in range(machine.n_axes):
        own[i, 3 * int(machine.kind[i]) : 3 * int(machine.kind[i]) + 3] = machine.axis[i]
    return (
        machine.kind.astype(np.int64),
        np.ascontiguousarray(machine.turn),
        np.ascontiguousarray(machine.place),
        np.ascontiguousarray(machine.axis),
        own,
        spatial,
        np.ascontiguousarray(machine.spring),
        np.ascontiguousarray(machine.gravity),
    )


@njit(cache=True)
def _frame(kind, turn, place, axis, q, e, r):  # type: ignore[no-untyped-def]
    """Rotation from parent to link (e) and the link's origin in the parent's frame (r)."""
    if kind == 1:
        for a in range(3):
            r[a] = place[a]
            for b in range(3):
                e[b, a] = turn[a, b]
                r[a] += turn[a, b] * axis[b] * q
        return
    c, s = math.cos(q), math.sin(q)
    x, y, z = axis
    t = 1 - c
    # rotation about the axis, columns are the link's directions in the unturned frame
    m00, m01, m02 = c + t * x * x, t * x * y - s * z, t * x * z + s * y
    m10, m11, m12 = t * x * y + s * z, c + t * y * y, t * y * z - s * x
    m20, m21, m22 = t * x * z - s * y, t * y * z + s * x, c + t * z * z
    for a in range(3):
        r[a] = place[a]
        t0, t1, t2 = turn[a, 0], turn[a, 1], turn[a, 2]
        e[0, a] = t0 * m00 + t1 * m10 + t2 * m20
        e[1, a] = t0 * m01 + t1 * m11 + t2 * m21
        e[2, a] = t0 * m02 + t1 * m12 + t2 * m22


@njit(cache=True)
def _down(e, r, v, out):  # type: ignore[no-untyped-def]
    """Motion vector of the parent in the link's frame."""
    w0, w1, w2 = v[0], v[1], v[2]
    u0 = v[3] + w1 * r[2] - w2 * r[1]
    u1 = v[4] + w2 * r[0] - w0 * r[2]
    u2 = v[5] + w0 * r[1] - w1 * r[0]
    for a in range(3):
        out[a] = e[a, 0] * w0 + e[a, 1] * w1 + e[a, 2] * w2
        out[3 + a] = e[a, 0] * u0 + e[a, 1] * u1 + e[a, 2] * u2


@njit(cache=True)
def _up(e, r, f, out):  # type: ignore[no-untyped-def]
    """Add a force vector of the link to that of its parent."""
    n0 = e[0, 0] * f[0] + e[1, 0] * f[1] + e[2, 0] * f[2]
    n1 = e[0, 1] * f[0] + e[1, 1] * f[1] + e[2, 1] * f[2]
    n2 = e[0, 2] * f[0] + e[1, 2] * f[1] + e[2, 2] * f[2]
    f0 = e[0, 0] * f[3] + e[1, 0] * f[4] + e[2, 0] * f[5]
    f1 = e[0, 1] * f[3] + e[1, 1] * f[4] + e[2, 1] * f[5]
    f2 = e[0, 2] * f[3] + e[1, 2] * f[4] + e[2, 2] * f[5]
    out[0] += n0 + r[1] * f2 - r[2] * f1
    out[1] += n1 + r[2] * f0 - r[0] * f2
    out[2] += n2 + r[0] * f1 - r[1] * f0
    out[3] += f0
    out[4] += f1
    out[5] += f2


@njit(cache=True)
def _moving(v, m, out):  # type: ignore[no-untyped-def]
    """Cross product of two motion vectors."""
    out[0] = v[1] * m[2] - v[2] * m[1]
    out[1] = v[2] * m[0] - v[0] * m[2]
    out[2] = v[0] * m[1] - v[1] * m[0]
    out[3] = v[1] * m[5] - v[2] * m[4] + v[4] * m[2] - v[5] * m[1]
    out[4] = v[2] * m[3] - v[0] * m[5] + v[5] * m[0] - v[3] * m[2]
    out[5] = v[0] * m[4] - v[1] * m[3] + v[3] * m[1] - v[4] * m[0]


@njit(cache=True)
def _momentum_rate(v, h, out):  # type: ignore[no-untyped-def]
    """Cross product of a motion vector with a force vector (here a momentum)."""
    out[0] = v[1] * h[2] - v[2] * h[1] + v[4] * h[5] - v[5] * h[4]
    out[1] = v[2] * h[0] - v[0] * h[2] + v[5] * h[3] - v[3] * h[5]
    out[2] = v[0] * h[1] - v[1] * h[0] + v[3] * h[4] - v[4] * h[3]
    out[3] = v[1] * h[5] - v[2] * h[4]
    out[4] = v[2] * h[3] - v[0] * h[5]
    out[5] = v[0] * h[4] - v[1] * h[3]


@njit(cache=True)
def spring_torques(body, frames, origins, torque):  # type: ignore[no-untyped-def]
    """Add the torques of the springs between two points to the joints.

    Args:
        body: From `body_arrays`.
        frames: Rotation from parent to link, shape (n_axes, 3, 3).
        origins: Origin of each link in its parent's frame, shape (n_axes, 3).
        torque: Of the joints; shape (n_axes,). Changed.
    """
    kind, _, _, axis, _, _, spring, _ = body
    for s in range(len(spring)):
        a, b = int(spring[s, 0]), int(spring[s, 4])
        # everything in the frame of link a: R is the orientation of the link reached, o its origin
        rot, at = np.eye(3), np.zeros(3)
        axes, points = np.zeros((len(kind), 3)), np.zeros((len(kind), 3))
        for j in range(a + 1, b + 1):
            at = at + rot @ origins[j]
            rot = rot @ frames[j].T
            axes[j], points[j] = rot @ axis[j], at
        end = at + rot @ spring[s, 5:8]
        line = end - spring[s, 1:4]
        length = math.sqrt(line @ line)
        force = -spring[s, 8] * (length - spring[s, 9]) / length * line
        for j in range(a + 1, b + 1):
            if kind[j] == 1:
                torque[j] += force @ axes[j]
            else:
                torque[j] += np.cross(axes[j], end - points[j]) @ force


@njit(cache=True)
def forward(body, q, qd, torque, qdd, work):  # type: ignore[no-untyped-def]
    """Accelerations of the joints under torques (articulated bodies).

    Args:
        body: From `body_arrays`.
        q: Shape (n_axes,), in [rad].
        qd: Shape (n_axes,), in [rad/s].
        torque: Shape (n_axes,), in [N m]. Springs of the arm are added to it.
        qdd: The result, shape (n_axes,), in [rad/s^2].
        work: From `workspace`.
    """
    kind, turn, place, axis, own, spatial, spring, gravity = body
    frames, origins, v, c, inertia, bias, force, scalar, acc, temp = work
    n = len(q)
    for i in range(n):
        _frame(kind[i], turn[i], place[i], axis[i], q[i], frames[i], origins[i])
        if i == 0:
            for k in range(6):
                v[0, k] = own[0, k] * qd[0]
                c[0, k] = 0.0
        else:
            _down(frames[i], origins[i], v[i - 1], v[i])
            for k in range(6):
                temp[0, k] = own[i, k] * qd[i]
                v[i, k] += temp[0, k]
            _moving(v[i], temp[0], c[i])
        for k in range(6):
            h = 0.0
            for m in range(6):
                inertia[i, k, m] = spatial[i, k, m]
                h += spatial[i, k, m] * v[i, m]
            temp[1, k] = h
        _momentum_rate(v[i], temp[1], bias[i])
    if len(spring):
        spring_torques(body, frames, origins, torque)
    for i in range(n - 1, -1, -1):
        d, u = 0.0, torque[i]
        for k in range(6):
            f = 0.0
            for m in range(6):
                f += inertia[i, k, m] * own[i, m]
            force[i, k] = f
        for k in range(6):
            d += own[i, k] * force[i, k]
            u -= own[i, k] * bias[i, k]
        scalar[i, 0], scalar[i, 1] = d, u
        if i > 0:
            e, r = frames[i], origins[i]
            for k in range(6):
                p = bias[i, k] + force[i, k] * u / d
                for m in range(6):
                    inertia[i, k, m] -= force[i, k] * force[i, m] / d
                    p += inertia[i, k, m] * c[i, m]
                temp[0, k] = p
            _up(e, r, temp[0], bias[i - 1])
            # X' I X with X of the frame: first columns I X by motion vectors, then rows by forces
            for m in range(6):
                for k in range(6):
                    temp[2, k] = 0.0
                temp[2, m] = 1.0
                _down(e, r, temp[2], temp[3])
                for k in range(6):
                    f = 0.0
                    for g in range(6):
                        f += inertia[i, k, g] * temp[3, g]
                    temp[4, k] = f
                    temp[5, k] = 0.0
                _up(e, r, temp[4], temp[5])
                for k in range(6):
                    inertia[i - 1, k, m] += temp[5, k]
    for i in range(n):
        if i == 0:
            for k in range(3):
                temp[0, k] = 0.0
                temp[0, 3 + k] = -gravity[k]
            _down(frames[0], origins[0], temp[0], acc[0])
        else:
            _down(frames[i], origins[i], acc[i - 1], acc[i])
            for k in range(6):
                acc[i, k] += c[i, k]
        f = 0.0
        for k in range(6):
            f += force[i, k] * acc[i, k]
        qdd[i] = (scalar[i, 1] - f) / scalar[i, 0]
        for k in range(6):
            acc[i, k] += own[i, k] * qdd[i]


@njit(cache=True)
def workspace(n):  # type: ignore[no-untyped-def]
    """Scratch memory of `forward` for an arm with n axes."""
    return (
        np.zeros((n, 3, 3)),
        np.zeros((n, 3)),
        np.zeros((n, 6)),
        np.zeros((n, 6)),
        np.zeros((n, 6, 6)),
        np.zeros((n, 6)),
        np.zeros((n, 6)),
        np.zeros((n, 2)),
        np.zeros((n, 6)),
        np.zeros((6, 6)),
    )


@njit(cache=True)
def inverse(body, q, qd, qdd):  # type: ignore[no-untyped-def]
    """Torques of the joints along a motion (Newton-Euler).

    Args:
        body: From `body_arrays`.
        q: Shape (times, n_axes), in [rad].
        qd: Same shape, in [rad/s].
        qdd: Same shape, in [rad/s^2].

    Returns:
        Same shape, in [N m]: what the motors must give beside the springs of the arm.
    """
    kind, turn, place, axis, own, spatial, spring, gravity = body
    times, n = q.shape
    frames, origins = np.zeros((n, 3, 3)), np.zeros((n, 3))
    v, a, f = np.zeros((n, 6)), np.zeros((n, 6)), np.zeros((n, 6))
    temp, still = np.zeros((3, 6)), np.zeros(6)
    out = np.zeros((times, n))
    help_ = np.zeros(n)
    for t in range(times):
        for k in range(3):
            still[3 + k] = -gravity[k]
        for i in range(n):
            _frame(kind[i], turn[i], place[i], axis[i], q[t, i], frames[i], origins[i])
            if i == 0:
                v[0] = 0.0
                _down(frames[0], origins[0], still, a[0])
            else:
                _down(frames[i], origins[i], v[i - 1], v[i])
                _down(frames[i], origins[i], a[i - 1], a[i])
            for k in range(6):
                temp[0, k] = own[i, k] * qd[t, i]
                v[i, k] += temp[0, k]
            _moving(v[i], temp[0], temp[1])
            for k in range(6):
                a[i, k] += temp[1, k] + own[i, k] * qdd[t, i]
            for k in range(6):
                h, g = 0.0, 0.0
                for m in range(6):
                    h += spatial[i, k, m] * v[i, m]
                    g += spatial[i, k, m] * a[i, m]
                temp[1, k] = h
                temp[2, k] = g
            _momentum_rate(v[i], temp[1], f[i])
            for k in range(6):
                f[i, k] += temp[2, k]
        help_[:] = 0.0
        if len(spring):
            spring_torques(body, frames, origins, help_)
        for i in range(n - 1, -1, -1):
            total = -help_[i]
            for k in range(6):
                total += own[i, k] * f[i, k]
            out[t, i] = total
            if i > 0:
                _up(frames[i], origins[i], f[i], f[i - 1])
    return out

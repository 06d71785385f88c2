"""The rigid arm in numba: inertia matrix and bias torque by recursion in the base frame.

Spatial vectors are taken about the base's origin, so that inertias of links add up plainly:
composite rigid bodies for M, Newton-Euler for the bias (Featherstone 2008, chapters 5 and 6).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from sealed.chain import Chain

Body = tuple[np.ndarray, ...]
"""Arrays of a chain in the order that `mass_and_bias` takes them."""


def body_arrays(chain: Chain) -> Body:
    """The arrays of a chain for the functions below."""
    mass, moment, inertia = chain.bodies()
    return (
        np.ascontiguousarray(chain.rotation),
        np.ascontiguousarray(chain.origin),
        mass,
        moment,
        inertia,
        np.ascontiguousarray(chain.spring),
        np.ascontiguousarray(chain.gravity),
    )


def workspace(n_axes: int) -> np.ndarray:
    """Scratch memory for one arm, shape (n_axes, 48)."""
    return np.zeros((n_axes, 48))


@njit(cache=True, fastmath=False)
def mass_and_bias(body, q, qd, work, matrix, bias):  # type: ignore[no-untyped-def]
    """Inertia matrix M and bias torque c: M qdd + c = torque at the joints.

    Args:
        body: From `body_arrays`.
        q: Joint angle, shape (n_axes,), in [rad].
        qd: Joint velocity, shape (n_axes,), in [rad/s].
        work: From `workspace`.
        matrix: Result M, shape (n_axes, n_axes), in [kg m^2].
        bias: Result c, gravity, Coriolis and springs; shape (n_axes,), in [N m].
    """
    rotation, origin, mass, moment, inertia, spring, gravity = body
    n = len(q)
    # columns of work: R 0-8, p 9-11, S 12-17, inertia m 18, mc 19-21, I 22-27, force 28-33
    vx = vy = vz = ux = uy = uz = 0.0  # angular and linear velocity, about the base's origin
    ax = ay = az = 0.0
    bx, by, bz = -gravity[0], -gravity[1], -gravity[2]
    for i in range(n):
        w = work[i]
        c, s = math.cos(q[i]), math.sin(q[i])
        if i == 0:
            for r in range(3):
                x, y = rotation[0, r, 0], rotation[0, r, 1]
                w[3 * r] = c * x + s * y
                w[3 * r + 1] = c * y - s * x
                w[3 * r + 2] = rotation[0, r, 2]
                w[9 + r] = origin[0, r]
        else:
            b = work[i - 1]
            for r in range(3):
                b0, b1, b2 = b[3 * r], b[3 * r + 1], b[3 * r + 2]
                x = b0 * rotation[i, 0, 0] + b1 * rotation[i, 1, 0] + b2 * rotation[i, 2, 0]
                y = b0 * rotation[i, 0, 1] + b1 * rotation[i, 1, 1] + b2 * rotation[i, 2, 1]
                w[3 * r] = c * x + s * y
                w[3 * r + 1] = c * y - s * x
                w[3 * r + 2] = (
                    b0 * rotation[i, 0, 2] + b1 * rotation[i, 1, 2] + b2 * rotation[i, 2, 2]
                )
                w[9 + r] = b[9 + r] + b0 * origin[i, 0] + b1 * origin[i, 1] + b2 * origin[i, 2]
        px, py, pz = w[9], w[10], w[11]
        sx, sy, sz = w[2], w[5], w[8]
        tx, ty, tz = py * sz - pz * sy, pz * sx - px * sz, px * sy - py * sx
        w[12], w[13], w[14], w[15], w[16], w[17] = sx, sy, sz, tx, ty, tz
        # velocity, acceleration without qdd
        rate = qd[i]
        vx += sx * rate
        vy += sy * rate
        vz += sz * rate
        ux += tx * rate
        uy += ty * rate
        uz += tz * rate
        ax += (vy * sz - vz * sy) * rate
        ay += (vz * sx - vx * sz) * rate
        az += (vx * sy - vy * sx) * rate
        bx += (vy * tz - vz * ty + uy * sz - uz * sy) * rate
        by += (vz * tx - vx * tz + uz * sx - ux * sz) * rate
        bz += (vx * ty - vy * tx + ux * sy - uy * sx) * rate
        # inertia of the link about the base's origin
        m = mass[i]
        h0, h1, h2 = moment[i, 0], moment[i, 1], moment[i, 2]
        hx = w[0] * h0 + w[1] * h1 + w[2] * h2
        hy = w[3] * h0 + w[4] * h1 + w[5] * h2
        hz = w[6] * h0 + w[7] * h1 + w[8] * h2
        t = inertia[i]
        e00 = w[0] * t[0, 0] + w[1] * t[0, 1] + w[2] * t[0, 2]
        e01 = w[0] * t[0, 1] + w[1] * t[1, 1] + w[2] * t[1, 2]
        e02 = w[0] * t[0, 2] + w[1] * t[1, 2] + w[2] * t[2, 2]
        e10 = w[3] * t[0, 0] + w[4] * t[0, 1] + w[5] * t[0, 2]
        e11 = w[3] * t[0, 1] + w[4] * t[1, 1] + w[5] * t[1, 2]
        e12 = w[3] * t[0, 2] + w[4] * t[1, 2] + w[5] * t[2, 2]
        e20 = w[6] * t[0, 0] + w[7] * t[0, 1] + w[8] * t[0, 2]
        e21 = w[6] * t[0, 1] + w[7] * t[1, 1] + w[8] * t[1, 2]
        e22 = w[6] * t[0, 2] + w[7] * t[1, 2] + w[8] * t[2, 2]
        ixx = e00 * w[0] + e01 * w[1] + e02 * w[2]
        iyy = e10 * w[3] + e11 * w[4] + e12 * w[5]
        izz = e20 * w[6] + e21 * w[7] + e22 * w[8]
        ixy = e00 * w[3] + e01 * w[4] + e02 * w[5]
        ixz = e00 * w[6] + e01 * w[7] + e02 * w[8]
        iyz = e10 * w[6] + e11 * w[7] + e12 * w[8]
        # shift from the link's origin p: with h = m c, I + 2 (h.p) + m p.p - ...
        hp = 2.0 * (hx * px + hy * py + hz * pz) + m * (px * px + py * py + pz * pz)
        ixx += hp - 2.0 * hx * px - m * px * px
        iyy += hp - 2.0 * hy * py - m * py * py
        izz += hp - 2.0 * hz * pz - m * pz * pz
        ixy -= hx * py + hy * px + m * px * py
        ixz -= hx * pz + hz * px + m * px * pz
        iyz -= hy * pz + hz * py + m * py * pz
        hx += m * px
        hy += m * py
        hz += m * pz
        w[18], w[19], w[20], w[21] = m, hx, hy, hz
        w[22], w[23], w[24], w[25], w[26], w[27] = ixx, iyy, izz, ixy, ixz, iyz
        # momentum (l angular, k linear), then force = I a + v x* I v
        lx = ixx * vx + ixy * vy + ixz * vz + hy * uz - hz * uy
        ly = ixy * vx + iyy * vy + iyz * vz + hz * ux - hx * uz
        lz = ixz * vx + iyz * vy + izz * vz + hx * uy - hy * ux
        kx = m * ux + vy * hz - vz * hy
        ky = m * uy + vz * hx - vx * hz
        kz = m * uz + vx * hy - vy * hx
        w[28] = ixx * ax + ixy * ay + ixz * az + hy * bz - hz * by
        w[29] = ixy * ax + iyy * ay + iyz * az + hz * bx - hx * bz
        w[30] = ixz * ax + iyz * ay + izz * az + hx * by - hy * bx
        w[28] += vy * lz - vz * ly + uy * kz - uz * ky
        w[29] += vz * lx - vx * lz + uz * kx - ux * kz
        w[30] += vx * ly - vy * lx + ux * ky - uy * kx
        w[31] = m * bx + ay * hz - az * hy + vy * kz - vz * ky
        w[32] = m * by + az * hx - ax * hz + vz * kx - vx * kz
        w[33] = m * bz + ax * hy - ay * hx + vx * ky - vy * kx
    for i in range(n - 1, -1, -1):
        w = work[i]
        if i < n - 1:
            for k in range(18, 34):
                w[k] += work[i + 1, k]
        sx, sy, sz, tx, ty, tz = w[12], w[13], w[14], w[15], w[16], w[17]
        bias[i] = sx * w[28] + sy * w[29] + sz * w[30] + tx * w[31] + ty * w[32] + tz * w[33]
        m, hx, hy, hz = w[18], w[19], w[20], w[21]
        fx = w[22] * sx + w[25] * sy + w[26] * sz + hy * tz - hz * ty
        fy = w[25] * sx + w[23] * sy + w[27] * sz + hz * tx - hx * tz
        fz = w[26] * sx + w[27] * sy + w[24] * sz + hx * ty - hy * tx
        gx = m * tx + sy * hz - sz * hy
        gy = m * ty + sz * hx - sx * hz
        gz = m * tz + sx * hy - sy * hx
        for j in range(i + 1):
            v = work[j]
            value = v[12] * fx + v[13] * fy + v[14] * fz + v[15] * gx + v[16] * gy + v[17] * gz
            matrix[i, j] = value
            matrix[j, i] = value
    for k in range(len(spring)):
        first, second = int(spring[k, 0]), int(spring[k, 4])
        x1, y1, z1 = _point(work, first, spring[k, 1], spring[k, 2], spring[k, 3])
        x2, y2, z2 = _point(work, second, spring[k, 5], spring[k, 6], spring[k, 7])
        dx, dy, dz = x1 - x2, y1 - y2, z1 - z2
        length = math.sqrt(dx * dx + dy * dy + dz * dz)
        pull = spring[k, 8] * (length - spring[k, 9]) / length
        dx, dy, dz = pull * dx, pull * dy, pull * dz
        lx, ly, lz = y2 * dz - z2 * dy, z2 * dx - x2 * dz, x2 * dy - y2 * dx
        for i in range(first + 1, second + 1):
            w = work[i]
            bias[i] -= w[12] * lx + w[13] * ly + w[14] * lz + w[15] * dx + w[16] * dy + w[17] * dz


@njit(cache=True)
def _point(work, link, x, y, z):  # type: ignore[no-untyped-def]
    """A point of a link in the base frame."""
    if link < 0:
        return x, y, z
    w = work[link]
    return (
        w[9] + w[0] * x + w[1] * y + w[2] * z,
        w[10] + w[3] * x + w[4] * y + w[5] * z,
        w[11] + w[6] * x + w[7] * y + w[8] * z,
    )


@njit(cache=True)
def solve(matrix, vector, out):  # type: ignore[no-untyped-def]
    """Solve matrix x = vector by Cholesky.

    Args:
        matrix: Positive definite, shape (n, n). It is overwritten.
        vector: Right-hand side, shape (n,).
        out: The solution x, shape (n,), is written here.
    """
    n = len(vector)
    for i in range(n):
        for j in range(i + 1):
            value = matrix[i, j]
            for k in range(j):
                value -= matrix[i, k] * matrix[j, k]
            if i == j:
                matrix[i, i] = math.sqrt(value)
            else:
                matrix[i, j] = value / matrix[j, j]
    for i in range(n):
        value = vector[i]
        for k in range(i):
            value -= matrix[i, k] * out[k]
        out[i] = value / matrix[i, i]
    for i in range(n - 1, -1, -1):
        value = out[i]
        for k in range(i + 1, n):
            value -= matrix[k, i] * out[k]
        out[i] = value / matrix[i, i]


@njit(cache=True)
def inverse_dynamics(body, q, qd, qdd):  # type: ignore[no-untyped-def]
    """Compute the joint torque of a motion.

    Args:
        body: Parameters of the links.
        q: Joint angles [rad], shape (samples, n_axes).
        qd: Velocities [rad/s], same shape.
        qdd: Accelerations [rad/s^2], same shape.

    Returns:
        Torque [N m], shape (samples, n_axes).
    """
    samples, n = q.shape
    work, matrix, bias = np.zeros((n, 48)), np.zeros((n, n)), np.zeros(n)
    torque = np.empty((samples, n))
    for k in range(samples):
        mass_and_bias(body, q[k], qd[k], work, matrix, bias)
        for i in range(n):
            value = bias[i]
            for j in range(n):
                value += matrix[i, j] * qdd[k, j]
            torque[k, i] = value
    return torque

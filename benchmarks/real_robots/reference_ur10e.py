"""What the UR10e's recordings say: rigid-body regression, independent of MuJoCo.

    python -m benchmarks.real_robots.reference_ur10e --data ../shared/data/measured [--pair 14harm]

Drive gains from the published link masses; friction terms by their gain on held-out runs; mass of
the payload from a loaded and an unloaded run of the same reference. Weighted least squares, all
signals low-passed at 10 Hz, joint side.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from real_robots.measured_data import UR10E_PERIOD, read_ur10e

GRAVITY = 9.81
MASS = (7.369, 13.051, 3.989, 2.1, 1.98, 0.615)
CENTRE: tuple[tuple[float, float, float], ...] = (
    (0.021, 0, 0.027),
    (0.38, 0, 0.158),
    (0.24, 0, 0.068),
)
CENTRE += ((0, 0.007, 0.018), (0, 0.007, 0.018), (0, 0, -0.026))
"""Masses [kg] and centres in the frame at each link's far end [m]: Universal Robots."""
SMOOTH = 0.01
"""Speed over which the sign of friction changes [rad/s]."""
MOVING = 0.02
"""Speed from which an axis counts as moving [rad/s]."""


def skew(x: np.ndarray) -> np.ndarray:
    """Matrices of the cross product, shape (n, 3, 3)."""
    o = np.zeros(len(x))
    a, b, c = x.T
    return np.stack([o, -c, b, c, o, -a, -b, a, o], axis=1).reshape(-1, 3, 3)


def inertia_columns(x: np.ndarray) -> np.ndarray:
    """I x as a matrix times (Ixx, Ixy, Ixz, Iyy, Iyz, Izz), shape (n, 3, 6)."""
    o = np.zeros(len(x))
    a, b, c = x.T
    rows = [a, b, c, o, o, o, o, a, o, b, c, o, o, o, a, o, b, c]
    return np.stack(rows, axis=1).reshape(-1, 3, 6)


def turn_x(angle: float) -> np.ndarray:
    """Return the rotation about x.

    Args:
        angle: Angle [rad].

    Returns:
        Rotation matrix, shape (3, 3), without unit.
    """
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def regressor(
    dh: dict[str, list[float]], q: np.ndarray, qd: np.ndarray, qdd: np.ndarray
) -> np.ndarray:
    """Joint torque is this times the parameters of six links and of what is at the flange.

    Args:
        dh: Standard Denavit-Hartenberg parameters d, a [m] and alpha [rad].
        q: Angle, shape (n, 6), in [rad].
        qd: Velocity [rad/s].
        qdd: Acceleration [rad/s^2].

    Returns:
        Shape (n, 6, 70); for each body mass, mass times centre, and inertia about the frame's
        origin. The frame of a link is that of its joint.
    """
    n = len(q)
    rotation = np.broadcast_to(np.eye(3), (n, 3, 3))
    place, w, dw = np.zeros((3, n, 3))
    dv = np.tile([0.0, 0.0, GRAVITY], (n, 1))
    axes, places, bodies = [], [], []
    for j in range(6):
        z = rotation[:, :, 2]
        axes.append(z)
        places.append(place)
        speed = z * qd[:, j : j + 1]
        dw = dw + z * qdd[:, j : j + 1] + np.cross(w, speed)
        w = w + speed
        c, s, o = np.cos(q[:, j]), np.sin(q[:, j]), np.zeros(n)
        about_z = np.stack([c, -s, o, s, c, o, o, o, o + 1], axis=1).reshape(-1, 3, 3)
        rotation = rotation @ about_z
        bodies.append((rotation, place, w, dw, dv))
        arm = rotation @ np.array([dh["a"][j], 0.0, dh["d"][j]])
        dv = dv + np.cross(dw, arm) + np.cross(w, np.cross(w, arm))
        place = place + arm
        rotation = rotation @ turn_x(dh["alpha"][j])
    bodies.append((rotation, place, w, dw, dv))
    columns = np.zeros((n, 6, 70))
    for body, (rotation, place, w, dw, dv) in enumerate(bodies):
        back = np.swapaxes(rotation, 1, 2)
        w, dw, dv = (np.einsum("nij,nj->ni", back, x) for x in (w, dw, dv))
        force, moment = np.zeros((2, n, 3, 10))
        force[:, :, 0] = dv
        force[:, :, 1:4] = skew(dw) + skew(w) @ skew(w)
        moment[:, :, 1:4] = -skew(dv)
        moment[:, :, 4:] = inertia_columns(dw) + skew(w) @ inertia_columns(w)
        force, moment = rotation @ force, rotation @ moment
        for j in range(min(body, 5) + 1):
            about = moment + np.cross((place - places[j])[:, :, None], force, axis=1)
            part = np.einsum("ni,nik->nk", axes[j], about)
            columns[:, j, 10 * body : 10 * body + 10] = part
    return columns


UNLOADED = (
    "train_40s_feb12",
    "train_30s_feb10",
    "test_50s_feb12",
    "unloaded_14harm_feb19",
    "unloaded_15harm_feb19",
)
"""Recordings of all axes without payload, from ten days."""


@dataclass(frozen=True)
class Run:
    """One recording, and what the regressions need of it."""

    folder: Path
    name: str
    payload: np.ndarray | None = None
    """Mass and mass times centre at the flange, for the load of the friction; shape (4,)."""

    @cached_property
    def published(self) -> dict:
        """The published parameters."""
        return json.loads((self.folder / "published_parameters.json").read_text())

    @cached_property
    def signals(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Angle, velocity, acceleration and current.

        Returns:
            Four arrays of shape (samples, 6), in [rad], [rad/s], [rad/s^2] and [A].
        """
        recording = read_ur10e(self.folder, self.name)
        assert recording.velocity is not None
        acceleration = np.gradient(recording.velocity, UR10E_PERIOD, axis=0)
        return recording.position, recording.velocity, acceleration, recording.torque / self.gain

    @cached_property
    def gain(self) -> np.ndarray:
        """Published drive gains [N m/A], shape (6,)."""
        return np.array(self.published["drive_gain_Nm_per_A"])

    @cached_property
    def body(self) -> np.ndarray:
        """`regressor` of the motion, shape (samples, 6, columns)."""
        return regressor(self.published["dh_standard"], *self.signals[:3])

    @cached_property
    def weight(self) -> np.ndarray:
        """Gravity torque by published masses, and of the payload [N m], shape (samples, 6)."""
        q = self.signals[0]
        columns = regressor(self.published["dh_standard"], q, 0 * q, 0 * q)
        dh = self.published["dh_standard"]
        total = np.zeros(q.shape)
        for j in range(6):
            far = np.array([dh["a"][j], 0.0, dh["d"][j]])
            centre = turn_x(dh["alpha"][j]) @ np.array(CENTRE[j], float) + far
            total += columns[:, :, 10 * j : 10 * j + 4] @ (MASS[j] * np.r_[1.0, centre])
        if self.payload is not None:
            total += columns[:, :, 60:64] @ self.payload
        return total


def diagonal(values: np.ndarray, axes: Sequence[int] = range(6)) -> np.ndarray:
    """Make one column for each axis.

    Args:
        values: Shape (n, 6).
        axes: Axes with a column, from 0.

    Returns:
        Shape (n, 6, axes), in the unit of the values.
    """
    columns = np.zeros((*values.shape, len(axes)))
    for k, axis in enumerate(axes):
        columns[:, axis, k] = values[:, axis]
    return columns


def direction(run: Run) -> np.ndarray:
    """Compute the smoothed sign of the velocities.

    Args:
        run: The run.

    Returns:
        Shape (samples, 6), without unit.
    """
    return np.tanh(run.signals[1] / SMOOTH)


Term = Callable[[Run], np.ndarray]
TERMS: dict[str, Term] = {
    "rotor": lambda r: diagonal(r.signals[2]),
    "offset": lambda r: diagonal(np.ones_like(r.signals[1])),
    "viscous": lambda r: diagonal(r.signals[1]),
    "Coulomb": lambda r: diagonal(np.sign(r.signals[1])),
    "smooth Coulomb": lambda r: diagonal(direction(r)),
    "quadratic": lambda r: diagonal(r.signals[1] * np.abs(r.signals[1])),
    "asymmetry": lambda r: diagonal(np.abs(r.signals[1])),
    "Stribeck": lambda r: diagonal(direction(r) * np.exp(-((r.signals[1] / 0.03) ** 2))),
    "load friction 2, 3": lambda r: diagonal(direction(r) * np.abs(r.weight), (1, 2)),
    "load friction 2 to 4": lambda r: diagonal(direction(r) * np.abs(r.weight), (1, 2, 3)),
    "ripple of the rotor": lambda r: np.concatenate(
        [diagonal(f(k * r.signals[0])) for k in (101, 202) for f in (np.sin, np.cos)], axis=2
    ),
}
BASE = ("rotor", "offset", "viscous", "smooth Coulomb", "quadratic")


def design(run: Run, terms: Sequence[str]) -> np.ndarray:
    """Compute all columns of a run, links first.

    Args:
        run: The run.
        terms: Names of the terms.

    Returns:
        Shape (samples, 6, columns).
    """
    return np.concatenate([run.body[:, :, :60], *(TERMS[name](run) for name in terms)], axis=2)


def solve(matrix: np.ndarray, target: np.ndarray, axes: Sequence[int] = range(6)) -> np.ndarray:
    """Solve least squares with each axis weighted by its residual; the smallest solution is used.

    Args:
        matrix: Columns, shape (samples, 6, columns).
        target: Torque or current, shape (samples, 6).
        axes: Axes that are used, from 0.

    Returns:
        Coefficients, shape (columns,), in the unit of the target over that of the column.
    """
    used = np.isin(np.arange(6), list(axes))
    weight = used / target.std(axis=0)
    values = np.zeros(matrix.shape[2])
    for _ in range(4):
        rows = (matrix * weight[:, None])[:, used].reshape(-1, matrix.shape[2])
        size = np.linalg.norm(rows, axis=0)
        size[size < 1e-9 * size.max()] = np.inf
        values = np.linalg.lstsq(rows / size, (target * weight)[:, used].ravel(), rcond=1e-6)[0]
        values = values / size
        weight = used / (target - matrix @ values).std(axis=0)
    return values


def errors(run: Run, terms: Sequence[str], values: np.ndarray, moving: bool) -> np.ndarray:
    """Compute the torque error of each axis.

    Args:
        run: The run.
        terms: Names of the terms.
        values: Coefficients, shape (columns,).
        moving: Whether only samples are used in which the axis moves.

    Returns:
        Relative errors [%], shape (6,).
    """
    torque = run.signals[3] * run.gain
    inside = (np.abs(run.signals[1]) > MOVING) | (not moving)
    left = (torque - design(run, terms) @ values) * inside
    return 100 * np.sqrt((left**2).sum(axis=0) / ((torque * inside) ** 2).sum(axis=0))


def drive_gains(run: Run) -> np.ndarray:
    """Find the drive gains of axes 2 to 4 at which the arm has its published weight.

    Args:
        run: The run.

    Returns:
        Gains [N m/A], shape (6,); fitted for axes 2 to 4.
    """
    q, qd, qdd, current = run.signals
    inertial = run.body[:, :, :60].copy()
    found = []
    for axis in (1, 2, 3):
        v, load = qd[:, axis], run.weight[:, axis]
        still = regressor(run.published["dh_standard"], q, 0 * q, 0 * q)[:, axis, :60]
        moved = inertial[:, axis] - still
        moved = moved[:, np.linalg.norm(moved, axis=0) > 1e-9]
        sign = direction(run)[:, axis]
        friction = [np.ones_like(v), v, v * np.abs(v), sign, sign * np.abs(load), qdd[:, axis]]
        columns = np.column_stack([load, *friction, moved])
        size = np.linalg.norm(columns, axis=0)
        values = np.linalg.lstsq(columns / size, current[:, axis], rcond=1e-6)[0] / size
        found.append(1 / values[0])
    return np.array(found)


def payload(
    unloaded: Run,
    loaded: Run,
    gain: np.ndarray,
    terms: Sequence[str],
    size: int,
    axes: Sequence[int],
) -> np.ndarray:
    """Fit the payload together with all other terms.

    Args:
        unloaded: Run without payload.
        loaded: Run with payload.
        gain: Drive gains [N m/A], shape (6,).
        terms: Names of the terms.
        size: Number of payload parameters: 4, or 10 with inertia.
        axes: Axes that are used, from 0.

    Returns:
        Mass [kg], mass times centre [kg m] and, with size 10, inertia [kg m^2] at the flange; shape
        (size,).
    """
    rows = []
    for run, there in ((unloaded, 0.0), (loaded, 1.0)):
        rows.append(np.concatenate([run.body[:, :, 60 : 60 + size] * there, design(run, terms)], 2))
    target = np.concatenate([run.signals[3] * gain for run in (unloaded, loaded)])
    return solve(np.concatenate(rows), target, axes)[:size]


def print_friction(folder: Path) -> None:
    """Friction terms by held-out errors."""
    train, *tests = (
        Run(folder, name) for name in ("train_40s_feb12", "test_50s_feb12", "validation_ptp_jan17")
    )
    print("\n| friction terms | run | rms | axis 1 | 2 | 3 | 4 | 5 | 6 |\n" + "|---" * 9 + "|")
    plain = ("rotor", "offset", "viscous")
    ladder: list[tuple[str, ...]] = [(*plain, "Coulomb"), (*plain, "smooth Coulomb"), BASE]
    ladder += [(*BASE, "load friction 2, 3"), (*BASE, "load friction 2 to 4")]
    best = ladder[-2]
    ladder += [(*best, extra) for extra in ("asymmetry", "Stribeck", "ripple of the rotor")]
    for terms in ladder:
        values = solve(design(train, terms), train.signals[3] * train.gain)
        for run, moving in ((train, False), (tests[0], False), (tests[1], True), (tests[1], False)):
            axis = errors(run, terms, values, moving)
            name = run.name.rpartition("_")[0] + (" moving" if moving else "")
            shown = " | ".join(f"{e:.1f}" for e in [np.sqrt(np.mean(axis**2)), *axis])
            print(f"| {', '.join(terms[2:])} | {name} | {shown} |")


def print_payload(folder: Path, pairs: Sequence[str]) -> None:
    """Print the payload for each choice of gains, terms and axes.

    Args:
        folder: Folder with the runs.
        pairs: Names of the pairs of runs.
    """
    train = Run(folder, "train_40s_feb12")
    scaled = drive_gains(train) / train.gain[1:4]
    factor = np.r_[scaled.mean(), scaled, scaled.mean(), scaled.mean()]
    print(
        "\n| pair | gains | terms | axes | parameters | mass [kg] | centre [m] |\n"
        + "|---" * 7
        + "|"
    )
    for pair in pairs:
        unloaded = Run(folder, f"unloaded_{pair}_feb19")
        first = payload(
            unloaded, Run(folder, f"loaded_{pair}_feb19"), train.gain, BASE, 4, range(6)
        )
        loaded = Run(folder, f"loaded_{pair}_feb19", first * factor.mean())
        for gains, scale in (("published", np.ones(6)), ("by link masses", factor)):
            for terms in (BASE, (*BASE, "load friction 2, 3")):
                for size, axes in ((10, range(6)), (4, range(6)), (4, (1, 2, 3))):
                    if terms is BASE and len(axes) < 6:
                        continue
                    found = payload(unloaded, loaded, train.gain * scale, terms, size, axes)
                    centre = ", ".join(f"{c / found[0]:.3f}" for c in found[1:4])
                    which = ", ".join(str(axis + 1) for axis in axes)
                    extra = ", ".join(terms[len(BASE) :]) or "–"
                    row = f"{pair} | {gains} | {extra} | {which} | {size} | {found[0]:.3f}"
                    print(f"| {row} | {centre} |")


def print_ripple(folder: Path) -> None:
    """Largest waves of what the model leaves, against the angle, at the raw samples.

    Every sample has its own angle, so that waves above half the sample rate are seen too.
    """
    train = Run(folder, "train_40s_feb12")
    terms = (*BASE, "load friction 2, 3")
    values = solve(design(train, terms), train.signals[3] * train.gain)
    print(
        "\n| run | axis | rms left [N m] | periods a joint turn: amplitude [N m] |\n"
        + "|---" * 4
        + "|"
    )
    for name in (train.name, "test_50s_feb12"):
        run = Run(folder, name)
        model = design(run, terms) @ values
        with np.load(folder / f"{name}.npz") as raw:
            first, last = run.published["cut_idx"][name]
            inside = slice(first + 5, last - 5)
            time, q, qd, current = (raw[key][inside] for key in ("t", "q", "qd", "i"))
            even = np.arange(raw["t"][0], raw["t"][-1], UR10E_PERIOD)
            even = even[even >= raw["t"][first]][: len(model)]
        orders = np.arange(20.0, 640.0, 0.25)
        for axis in range(6):
            moving = np.abs(qd[:, axis]) > 0.1
            left = current[:, axis] * run.gain[axis] - np.interp(time, even, model[:, axis])
            left = left[moving] - left[moving].mean()
            waves = np.exp(-1j * np.outer(orders, q[moving, axis]))
            amplitude = 2 * np.abs(waves @ left) / len(left)
            top = np.argsort(-amplitude)[:1]
            shown = ", ".join(f"{orders[k]:g}: {amplitude[k]:.2f}" for k in top)
            print(f"| {name} | {axis + 1} | {left.std():.2f} | {shown} |")


def print_repeats(folder: Path) -> None:
    """Friction at usual speed of each recording without payload, over its mean.

    All recordings have the same links and rotors in one regression, and each its own friction.
    """
    runs = [Run(folder, name) for name in UNLOADED]
    own = ("smooth Coulomb", "viscous", "offset")
    rows = []
    for k, run in enumerate(runs):
        columns = np.concatenate([TERMS[name](run) for name in own], axis=2)
        parts = [columns if j == k else np.zeros_like(columns) for j in range(len(runs))]
        rows.append(np.concatenate([run.body[:, :, :60], TERMS["rotor"](run), *parts], axis=2))
    target = np.concatenate([run.signals[3] for run in runs])
    values = solve(np.concatenate(rows), target)[66:].reshape(len(runs), len(own), 6)
    speed = np.mean([np.sqrt(np.mean(run.signals[1] ** 2, axis=0)) for run in runs], axis=0)
    friction = values[:, 0] + speed * values[:, 1]
    friction /= friction.mean(axis=0)
    print("\n| friction at usual speed | axis 1 | 2 | 3 | 4 | 5 | 6 |\n" + "|---" * 7 + "|")
    deviation = 100 * friction.std(axis=0, ddof=1)
    for name, row in (*zip(UNLOADED, friction, strict=True), ("deviation [%]", deviation)):
        print(f"| {name} | " + " | ".join(f"{x:.3f}" for x in row) + " |")


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--pair", choices=("14harm", "15harm"), help="this payload table only")
    parser.add_argument("--ripple", action="store_true", help="the ripple only")
    parser.add_argument("--repeats", action="store_true", help="friction of each recording only")
    args = parser.parse_args()
    folder = args.data / "ur10e"
    if args.ripple:
        print_ripple(folder)
        return
    if args.repeats:
        print_repeats(folder)
        return
    if args.pair:
        print_payload(folder, (args.pair,))
        return
    print("| run | drive gain of axes 2, 3, 4 over the published one |\n|---|---|")
    for name in UNLOADED:
        run = Run(folder, name)
        shown = ", ".join(f"{g:.3f}" for g in drive_gains(run) / run.gain[1:4])
        print(f"| {name} | {shown} |")
    print_friction(folder)
    print_repeats(folder)
    print_payload(folder, ("14harm", "15harm"))


if __name__ == "__main__":
    main()

"""Which terms the EMPS needs: least squares on the equation of motion, independent of MuJoCo.

    python -m benchmarks.real_robots.reference_emps --data ../shared/data/measured

Fitted on the identification recording, chosen by blocked cross-validation on it, scored on the
validation recording. Filters as in the published reference: Butterworth, 4th order, 100 Hz, forward
and back on the position, central differences, decimation by 10.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from real_robots.measured_data import EMPS_FILES
from scipy.signal import butter, decimate, filtfilt

PERIOD = 1e-3
BORDER = 50  # samples left out at the start, as published
EDGE = 5  # decimated samples left out at both ends, where the filters ring
BLOCKS = 16  # of 1.5 s, for cross-validation
DELAYS = np.arange(0.0, 1.3e-3, 1e-4)
PITCH = 2.5e-3
"""Distance between two ripples of the force [m]."""

Term = Callable[["Signals"], np.ndarray]


class Signals:
    """Filtered position, velocity, acceleration and raw force of a recording."""

    def __init__(self, path: Path) -> None:
        table = np.loadtxt(path, delimiter=",", skiprows=1)
        q = filtfilt(*butter(4, 100 * 2 * PERIOD), table[:, 2])
        v = np.gradient(q, PERIOD)
        inside = slice(BORDER - 1, None)
        self.q, self.v = q[inside], v[inside]
        self.a = np.gradient(v, PERIOD)[inside]
        self.force = table[inside, 4]
        self.matrices: dict[str, np.ndarray] = {}

    def target(self, delay: float) -> np.ndarray:
        """Return the decimated force after a delay.

        Args:
            delay: Delay [s].

        Returns:
            Force [N], shape (samples,).
        """
        times = np.arange(len(self.force)) * PERIOD
        late = np.interp(times - delay, times, self.force)
        return decimate(late, 10, zero_phase=True)[EDGE:-EDGE]

    def matrix(self, names: Sequence[str]) -> np.ndarray:
        """Decimated regressors, shape (samples, terms)."""
        for name in names:
            if name not in self.matrices:
                columns = np.stack([term(self) for term in TERMS[name]], axis=1)
                thin = decimate(columns, 10, axis=0, zero_phase=True)
                self.matrices[name] = thin[EDGE:-EDGE]
        return np.hstack([self.matrices[name] for name in names])


TERMS: dict[str, tuple[Term, ...]] = {
    "linear": (lambda s: s.a, lambda s: s.v, lambda s: np.ones_like(s.v)),
    "Coulomb": (lambda s: np.sign(s.v),),
    "viscous asymmetry": (lambda s: np.abs(s.v),),
    "acceleration asymmetry": (lambda s: s.a * (s.v > 0),),
    "quadratic": (lambda s: s.v * np.abs(s.v),),
    "cubic": (lambda s: s.v**3,),
    "low-speed friction": (lambda s: np.sign(s.v) * np.exp(-((s.v / 0.02) ** 2)),),
    "low-speed friction, 5 mm/s": (lambda s: np.sign(s.v) * np.exp(-((s.v / 0.005) ** 2)),),
    "load friction": (lambda s: np.sign(s.v) * np.abs(s.a),),
    "spring": (lambda s: s.q - 0.12,),
    "friction by place": (lambda s: np.sign(s.v) * (s.q - 0.12),),
    "ripple": (
        lambda s: np.sin(2 * np.pi * s.q / PITCH),
        lambda s: np.cos(2 * np.pi * s.q / PITCH),
    ),
    "ripple, half pitch": (
        lambda s: np.sin(4 * np.pi * s.q / PITCH),
        lambda s: np.cos(4 * np.pi * s.q / PITCH),
    ),
}


def solve(matrix: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Solve a least-squares problem.

    Args:
        matrix: Columns, shape (samples, columns).
        target: Force [N], shape (samples,).

    Returns:
        Coefficients, shape (columns,), in [N] over the unit of the column.
    """
    return np.linalg.lstsq(matrix, target, rcond=None)[0]


def error(matrix: np.ndarray, target: np.ndarray, values: np.ndarray) -> float:
    """Compute the relative error of the force.

    Args:
        matrix: Columns, shape (samples, columns).
        target: Force [N], shape (samples,).
        values: Coefficients, shape (columns,).

    Returns:
        The relative error [%].
    """
    return float(100 * np.linalg.norm(target - matrix @ values) / np.linalg.norm(target))


def cross_validated(train: Signals, names: Sequence[str], delay: float) -> float:
    """Compute the error of blocks that were left out of the fit.

    Args:
        train: Signals of the training run.
        names: Names of the columns.
        delay: Delay of the force [s].

    Returns:
        The relative error [%].
    """
    matrix, target = train.matrix(names), train.target(delay)
    block = np.arange(len(target)) * BLOCKS // len(target)
    left = np.empty_like(target)
    for k in range(BLOCKS):
        inside = block == k
        left[inside] = target[inside] - matrix[inside] @ solve(matrix[~inside], target[~inside])
    return float(100 * np.linalg.norm(left) / np.linalg.norm(target))


def row(train: Signals, test: Signals, names: Sequence[str], delays: np.ndarray) -> None:
    """Print one model. Its delay is chosen by cross-validation.

    Args:
        train: Signals of the training run.
        test: Signals of the test run.
        names: Names of the columns.
        delays: Delays to choose from [s], shape (delays,).
    """
    delay = min(delays, key=lambda d: cross_validated(train, names, float(d)))
    chosen = cross_validated(train, names, delay)
    values = solve(train.matrix(names), train.target(delay))
    errors = [error(s.matrix(names), s.target(delay), values) for s in (train, test)]
    shown = ", ".join(names[1:])
    print(f"| {shown} | {1e3 * delay:.1f} | {chosen:.2f} | {errors[0]:.2f} | {errors[1]:.2f} |")


def stepwise(train: Signals) -> list[str]:
    """Add terms as long as the cross-validated error falls by 5 % of itself."""
    names = ["linear", "Coulomb"]

    def score(chosen: list[str]) -> float:
        return min(cross_validated(train, chosen, float(d)) for d in DELAYS[::2])

    best = score(names)
    while True:
        left = [name for name in TERMS if name not in names]
        value, name = min((score([*names, name]), name) for name in left)
        if value > 0.95 * best:
            return names
        names, best = [*names, name], value


def main() -> None:
    """Print the table of models."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--data", type=Path, required=True)
    folder = parser.parse_args().data / "emps"
    train, test = (Signals(folder / EMPS_FILES[name]) for name in ("identification", "validation"))
    print("| terms beyond mass, viscous, offset | delay [ms] | cross-validated | train | test |")
    print("| --- | --- | --- | --- | --- |")
    ladder = [["Coulomb"], ["Coulomb", "viscous asymmetry"]]
    ladder += [["Coulomb", "viscous asymmetry", "quadratic"]]
    for names in ladder:
        for delays in (DELAYS[:1], DELAYS):
            row(train, test, ["linear", *names], delays)
    asymmetric = ["linear", "Coulomb", "viscous asymmetry"]
    row(train, test, [*asymmetric, "low-speed friction"], DELAYS)
    row(train, test, [*asymmetric, "low-speed friction", "quadratic"], DELAYS)
    row(train, test, [*asymmetric, "low-speed friction", "ripple"], DELAYS)
    chosen = stepwise(train)
    print("\nstepwise, chosen by cross-validation:")
    row(train, test, chosen, DELAYS)
    values = solve(train.matrix(asymmetric), train.target(0.0))
    moving = np.abs(train.v) > 0.02
    residual = (
        train.force - np.column_stack([t(train) for n in asymmetric for t in TERMS[n]]) @ values
    )
    orders = np.arange(20.0, 1200.0, 0.5)
    waves = np.exp(-2j * np.pi * np.outer(orders, train.q[moving][::4]))
    amplitude = 2 * np.abs(waves @ residual[moving][::4]) / waves.shape[1]
    top = int(np.argmax(amplitude))
    print(f"\nlargest ripple: {orders[top]:g} a metre, {amplitude[top]:.2f} N")


if __name__ == "__main__":
    main()

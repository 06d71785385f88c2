"""Detectability: the severity that an ideal detector sees every second time.

A matched filter on the torque, d' = severity sqrt(g' S^-1 g), with g the change of the nominal
robot's torque by a unit of severity. S is the noise (twin: of two recordings), and without a twin
also what the baseline's wrong parameters change. d' = 4 is the limit: searching some 120 candidates
at 1 % familywise false alarms takes z = 3.9.

    limits = Limits("puma560", cache)
    limits.limit("backlash", 3, level=0.01, mode="twin")
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed
from sealed.effects import (
    CATALOGUE,
    Context,
    Effect,
    Slow,
    apply_effect,
    axes_of,
    context,
    unchanging,
)
from sealed.physics import SAMPLE_PERIOD, Physics, simulate
from sealed.recording import BITS, LEVELS
from sealed.robots import OFF, baseline, other_forms, perturbed
from sealed.unlisted import UNLISTED, apply_unlisted, sensed

CACHE = Path.home() / ".cache" / "faultgen-sealed"
"""Where sensitivities are kept if nothing else is asked for."""
MODES = ("twin", "alone")
"""With a recording of the same robot before the change, or without."""
DETECTED = 4.0
"""d' of the limit."""
REPEATABILITY = 1e-3
"""Of two runs of a robot, white, over RMS torque: assumed."""
ORDERS = (1, 2, 4, 6)
"""Waves a motor turn of transmission errors and torque ripple."""
WAVES = ("transmission_error", "torque_ripple")
_STEP = 2e-4  # of the sensitivities' integration [s]; changes torques by 1e-3 of them at most
_TURN = 0.2  # angle that a motor has to turn before its torque counts [rad]
_EXPONENT_SPREAD = 0.4  # of the Stribeck exponent, about 2
_COLOUR = (0.5, 0.018)  # mean share and time constant [s] of the coloured noise
# one burst a motion; a sample
_LEAST = {"sensor_dropout": 0.01, "sensor_stuck": 0.01, "torque_lowpass": 0.004}
_DIFFERENCE = 0.02  # of parameters, for the baseline's sensitivities

Combo = tuple[str, int, int]
"""Effect, axis from 1, order (0 where there is none)."""


def combos(n_axes: int, names: Iterable[str] = (*CATALOGUE, *UNLISTED)) -> list[Combo]:
    """List every effect on every axis on which it can act, with every order.

    Args:
        n_axes: Number of axes.
        names: Names of the effects.

    Returns:
        The combinations.
    """
    return [
        (name, axis, order)
        for name in names
        for axis in axes_of(name, n_axes)
        for order in (ORDERS if name in WAVES else (0,))
    ]


def _scales(where: Context, name: str, axis: int) -> tuple[float, float]:
    """A severity to begin with, and the largest that is sensible."""
    x = where.axis(axis)
    moved = abs(x.N)
    table = {
        "temperature_friction": (0.03, 1.0),
        "load_friction": (0.002, 0.3),
        "backlash": (1e-5, 3e-3),
        "gear_stiffness": (0.02, 0.6),
        "stiffness_hardening": (0.03, 3.0),
        "transmission_error": (3e-6, 2e-3),
        "torque_ripple": (0.008 * x.FC, min(1.0 * x.FC, 0.2 * x.LIMIT)),
        "torque_offset": (0.008 * x.FC, 0.2 * x.LIMIT),
        "torque_constant": (0.005, 0.4),
        "rotor_inertia": (0.01, 2.0),
        "payload_mass": (0.002, 1.0),
        "payload_offset": (0.0005, 0.1),
        "gravity_spring": (0.001 * x.LIMIT * moved, 0.3 * x.LIMIT * moved),
        "wrist_coupling_friction": (0.008 * x.FC * moved, 2.0 * x.FC * moved),
        "delay": (1e-4, 0.02),
        "encoder_offset": (5e-4, 0.05),
        "servo_gain": (0.03, 0.8),
        "current_clipping": (0.05, 0.6),
        "sensor_dropout": (0.02, 0.3),
        "sensor_stuck": (0.02, 0.3),
        "torque_lowpass": (0.004, 0.05),
    }
    if name in table:
        return table[name]
    return (0.015 * x.FC, 2.0 * x.FC) if name in UNLISTED else (0.015, 2.0)


def torque_of(
    effects: Iterable[Effect],
    physics: Physics,
    where: Context,
    temperatures: list[np.ndarray],
    *,
    step: float,
    seed: int = 0,
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Run the protocol with effects.

    Args:
        effects: Of the catalogue, or unlisted.
        physics: The robot.
        where: The nominal robot.
        temperatures: By motion, shape (samples,), in [deg C].
        step: Step [s].
        seed: Of what a torque sensor's effect draws.

    Returns:
        Runs, and the torque that the sensor sees, by motion.
    """
    slow: Slow = unchanging(where)
    effects = list(effects)
    for effect in effects:
        if effect.name in UNLISTED:
            physics, slow = apply_unlisted(effect, physics, where, slow)
        else:
            physics, slow = apply_effect(effect, physics, where, slow, temperatures)
    runs = [
        simulate(physics, points, part, step=step)
        for points, part in zip(where.points, slow, strict=True)
    ]
    rng = np.random.default_rng(seed)
    seen = [run[:, :, 2] for run in runs]
    for effect in effects:
        seen = [sensed(effect, torque, rng) for torque in seen]
    return runs, seen


def typical_temperatures(where: Context) -> list[np.ndarray]:
    """Return temperatures over the whole range, for sensitivities.

    Args:
        where: The motions.

    Returns:
        Temperature of each motion [deg C], shape (samples,) each.
    """
    at = np.linspace(32, 53, len(where.runs))[[3, 0, 5, 2, 4, 1]]
    return [np.full(len(run), t) for run, t in zip(where.runs, at, strict=True)]


def _seen(robot: str, effects: list[Effect], physics: Physics | None = None) -> np.ndarray:
    """Torque of the protocol, shape (samples, n_axes), in [N m]."""
    where = context(robot)
    physics = where.nominal if physics is None else physics
    seen = torque_of(effects, physics, where, typical_temperatures(where), step=_STEP)[1]
    return np.concatenate(seen)


@dataclass(frozen=True)
class Limits:
    """Limits of one robot. Sensitivities are computed once and kept in `cache`."""

    robot: str
    cache: Path

    @cached_property
    def where(self) -> Context:
        """The nominal robot."""
        return context(self.robot)

    @cached_property
    def rms(self) -> np.ndarray:
        """RMS of the nominal torque over the protocol, shape (n_axes,), in [N m]."""
        return np.sqrt(np.mean(np.concatenate(self.where.runs)[:, :, 2] ** 2, axis=0))

    @cached_property
    def healthy(self) -> np.ndarray:
        """Nominal torque at the sensitivities' step, shape (samples, n_axes), in [N m]."""
        return _seen(self.robot, [])

    def _file(self, combo: Combo) -> Path:
        return self.cache / self.robot / ("_".join(str(part) for part in combo) + ".npz")

    @property
    def _nuisance_files(self) -> tuple[Path, Path]:
        """What wrong parameters change, and other forms of friction: rows of one sigma each."""
        folder = self.cache / self.robot
        return folder / "baseline.npy", folder / "forms.npy"

    def response(self, combo: Combo) -> tuple[float, np.ndarray]:
        """Find a severity near the limit, and the change of torque that it causes.

        The severity is about the limit at 1 % noise with a twin, found in two steps.

        Args:
            combo: Effect, axis and order.

        Returns:
            Severity in the effect's unit, and change of torque [N m], shape (samples, n_axes).
        """
        path = self._file(combo)
        if not path.is_file():
            name, axis, order = combo
            severity, largest = _scales(self.where, name, axis)
            for _ in range(2):
                details = {"order": float(order)} if order else {}
                effect = Effect(name, axis, severity, details)
                change = _seen(self.robot, [effect]) - self.healthy
                size = float(np.linalg.norm(self._whitened(change, LEVELS[1], "twin")))
                least = max(1e-3 * largest, _LEAST.get(name, 0.0))
                better = float(np.clip(DETECTED / max(size, 1e-9) * severity, least, largest))
                if 1 / 5 < better / severity < 5:
                    break
                severity = better
            path.parent.mkdir(parents=True, exist_ok=True)
            np.savez(path, severity=effect.severity, change=change.astype(np.float32))
        with np.load(path) as stored:
            return float(stored["severity"]), stored["change"].astype(float)

    def compute(self, jobs: int = 1) -> None:
        """Compute all sensitivities that the cache lacks."""
        self._compute_nuisance(jobs)
        _ = self.healthy  # goes to the processes with this object
        wanted = [c for c in combos(len(self.rms)) if not self._file(c).is_file()]
        Parallel(n_jobs=jobs)(delayed(_store)(self, combo) for combo in wanted)

    def _compute_nuisance(self, jobs: int = 1) -> None:
        """Compute what wrong parameters and other forms of friction change."""
        path, forms = self._nuisance_files
        nominal = self.where.nominal
        if not path.is_file():
            names = baseline(nominal)
            changed = Parallel(n_jobs=jobs)(
                delayed(_seen)(self.robot, [], perturbed(nominal, {name: _DIFFERENCE}))
                for name in names
            )
            spread = np.sqrt((OFF[1] ** 3 - OFF[0] ** 3) / (OFF[1] - OFF[0]) / 3)
            columns = [
                (torque - self.healthy)
                / _DIFFERENCE
                * (_EXPONENT_SPREAD if name[0] == "EXPONENT" else spread)
                for torque, name in zip(changed, names, strict=True)
            ]
            path.parent.mkdir(parents=True, exist_ok=True)
            np.save(path, np.array(columns, np.float32))
        if not forms.is_file():
            changed = Parallel(n_jobs=jobs)(
                delayed(_seen)(self.robot, [], physics) for physics in other_forms(nominal)
            )
            np.save(forms, np.array(changed, np.float32) - self.healthy.astype(np.float32))

    @cached_property
    def _counted(self) -> np.ndarray:
        """Samples that count, shape (samples, n_axes)."""
        turned = [np.abs(run[:, :, 0] - run[0, :, 0]) > _TURN for run in self.where.runs]
        return np.concatenate([np.maximum.accumulate(part, axis=0) for part in turned])

    def _whitened(self, change: np.ndarray, level: float, mode: str) -> np.ndarray:
        """A change of torque with the noise's spectrum made white, flat (Whittle)."""
        total = level * self.rms
        share, time = _COLOUR
        memory = np.exp(-SAMPLE_PERIOD / time)
        step = self.where.nominal.column("LIMIT") / 2 ** (BITS - 1)
        parts, start = [], 0
        for run in self.where.runs:
            part = (change * self._counted)[start : start + len(run)]
            start += len(run)
            angle = 2 * np.pi * np.fft.rfftfreq(len(part))
            colour = (1 - memory**2) / np.abs(1 - memory * np.exp(-1j * angle)) ** 2
            spectrum = total**2 * (1 - share + share * colour[:, None]) + step**2 / 12
            if mode == "twin":
                spectrum = 2 * spectrum + (REPEATABILITY * self.rms) ** 2
            flat = np.fft.rfft(part, axis=0) / np.sqrt(spectrum)
            parts.append(np.fft.irfft(flat, len(part), axis=0).ravel())
        return np.concatenate(parts)

    def d_prime(self, change: np.ndarray, level: float, mode: str) -> float:
        """Compute d' of a change of torque.

        Args:
            change: Change of torque [N m], shape (samples, n_axes).
            level: Level of the noise.
            mode: 'twin' or 'alone'.

        Returns:
            d'.
        """
        white = self._whitened(change, level, mode)
        if mode == "twin":
            return float(np.linalg.norm(white))
        columns, factor = self._nuisance(level)
        along = columns @ white
        return float(np.sqrt(max(white @ white - along @ np.linalg.solve(factor, along), 0.0)))

    def _nuisance(self, level: float) -> tuple[np.ndarray, np.ndarray]:
        if level not in self._nuisances:
            self._compute_nuisance()
            stored = np.concatenate([np.load(path) for path in self._nuisance_files]).astype(float)
            columns = np.array([self._whitened(column, level, "alone") for column in stored])
            self._nuisances[level] = columns, np.eye(len(columns)) + columns @ columns.T
        return self._nuisances[level]

    @cached_property
    def _nuisances(self) -> dict[float, tuple[np.ndarray, np.ndarray]]:
        return {}

    def limit(self, name: str, axis: int, *, level: float, mode: str, order: int = 0) -> float:
        """Find the severity at which d' = 4.

        Args:
            name: Name of the effect.
            axis: Axis, from 1.
            level: Level of the noise.
            mode: 'twin' or 'alone'.
            order: Order of a periodic effect.

        Returns:
            The severity, in the effect's unit.
        """
        key = (name, axis, order, level, mode)
        if key not in self._known:
            severity, change = self.response((name, axis, order))
            found = self.d_prime(change, level, mode)
            least = _LEAST.get(name, 0.0)
            self._known[key] = max(DETECTED * severity / max(found, 1e-12), least)
        return self._known[key]

    @cached_property
    def _known(self) -> dict[tuple[str, int, int, float, str], float]:
        return {}

    def largest(self, name: str, axis: int) -> float:
        """Return the largest severity that is physically sensible.

        Args:
            name: Name of the effect.
            axis: Axis, from 1.

        Returns:
            The severity, in the effect's unit.
        """
        return _scales(self.where, name, axis)[1]


def _store(limits: Limits, combo: Combo) -> None:
    limits.response(combo)

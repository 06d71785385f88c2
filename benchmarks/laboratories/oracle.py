"""What an ideal linear detector could see: a matched filter that knows the forms and the noise.

oracle = Oracle(ideal, robot, points, noise, period, lab)
oracle.d_prime(Effect("backlash", 3, 1e-3), "twin")
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from laboratories.draw import Laboratory
from laboratories.effects import (
    CATALOGUE,
    Effect,
    apply,
    axes_of,
    largest,
    logged_torque,
    temperature_factors,
    unit,
)
from laboratories.noise import TorqueNoise
from laboratories.robots import (
    STILL,
    Plant,
    parameters,
    perturbed,
    sample_times,
    sampled,
    simulate,
    with_worn_forward,
)

DETECTED = 4.0
"""d' at the limit: an ideal search of 120 candidates with 1 % false alarms finds half of them."""
_CURRENT_GAIN, _CURRENT_ZERO = 0.017, 0.003
"""Standard deviations of `setup.CURRENT`."""
_LOG_GAIN = 0.1
"""Standard deviation of a gain that is off by 3 to 20 %: its RMS."""
_DIFFERENCE = 0.05  # of parameters, for the sensitivities
_WARM = (32.0, 52.0, 38.0, 45.0)  # temperatures of the motions, in turn [deg C]


Runs = list[tuple[np.ndarray, np.ndarray]]
"""Torque and speed at the samples, by motion."""


@dataclass(frozen=True)
class Oracle:
    """The detector of one laboratory, on the motions of its recording."""

    ideal: Plant
    """The model with the laboratory's servo: what may differ is taken about it."""
    robot: Plant
    """The healthy robot: the change by an effect is taken about it."""
    points: Sequence[np.ndarray]
    noise: TorqueNoise
    period: float
    lab: Laboratory

    def _torque(
        self, plant: Plant, effects: Sequence[Effect] = (), friction: np.ndarray | None = None
    ) -> Runs:
        """Torque and speed at the samples, by motion."""
        out = []
        for motion, points in enumerate(self.points):
            slow = np.tile(STILL, (len(plant.table), 1))
            if friction is not None:
                slow[:, :3] *= friction[:, None]
            for effect in effects:
                if effect.name == "temperature_friction":
                    warm = _WARM[motion % len(_WARM)]
                    slow[effect.axis - 1, :4] *= temperature_factors(warm, effect.severity)
            if self.lab.factors["feed_forward"] == "worn":
                points = with_worn_forward(points, self.lab.machine, plant, slow)
            run = simulate(plant, points, slow)
            seen = sampled(run, sample_times(len(points), self.period))
            out.append((logged_torque(effects, seen[:, :, 2], self.period), seen[:, :, 1]))
        return out

    @cached_property
    def _base(self) -> Runs:
        return self._torque(self.ideal)

    @cached_property
    def healthy(self) -> Runs:
        """Torque and speed of the robot without an effect, on a day of average friction."""
        return self._torque(self.robot)

    def _white(self, seen: Runs, mode: str, base: Runs | None = None) -> np.ndarray:
        """Change of torque against the base in units of the noise, one long vector."""
        base = self._base if base is None else base
        twice = np.sqrt(2.0) if mode == "twin" else 1.0
        parts = []
        for motion, ((torque, _), (before, speed)) in enumerate(zip(seen, base, strict=True)):
            scale = twice * self.noise.scale(before, speed, motion)
            parts.append(self.noise.whitened(torque - before, scale).ravel())
        return np.concatenate(parts)

    @cached_property
    def _friction(self) -> list[Runs]:
        """Runs with more friction on each axis."""
        n = self.lab.machine.n_axes
        return [
            self._torque(self.ideal, friction=1 + _DIFFERENCE * np.eye(n)[axis])
            for axis in range(n)
        ]

    def _columns(self, mode: str) -> np.ndarray:
        """What may differ without an effect, by one standard deviation: (columns, samples)."""
        if mode in self._known:
            return self._known[mode]
        twice = np.sqrt(2.0) if mode == "twin" else 1.0
        own = np.array([self._white(run, mode) for run in self._friction]) / _DIFFERENCE
        own *= twice * float(self.lab.factors["repeat"])
        columns = [0.6 * own, 0.8 * own.sum(axis=0, keepdims=True)]
        if mode == "alone":
            error = float(self.lab.factors["model_error"])
            for name, index in parameters(self.lab.machine.n_axes):
                plant = perturbed(self.ideal, {(name, index): _DIFFERENCE})
                size = error / _DIFFERENCE * (2 if name in ("STIFF", "DAMP") else 1)
                columns.append(size * self._white(self._torque(plant), mode)[None])
            for axis in range(self.lab.machine.n_axes):
                rest = float(self.ideal.column("REST")[axis])
                stiffer = self.ideal.changed(axis + 1, REST=1.5 * rest)
                smooth = self.ideal.changed(
                    axis + 1, SMOOTH=0.4, TANH=0.15 * float(self.ideal.column("SPEED")[axis])
                )
                columns += [
                    self._white(self._torque(plant), mode)[None] for plant in (stiffer, smooth)
                ]
            if self.lab.factors["torque"] == "current":
                columns += self._of_log(_CURRENT_GAIN, _CURRENT_ZERO)
            if self.lab.factors["log_gain"] != "right":
                columns += self._of_log(_LOG_GAIN, 0.0)
        self._known[mode] = np.concatenate(columns)
        return self._known[mode]

    def _of_log(self, gain: float, zero: float) -> list[np.ndarray]:
        """Errors of the gain of a logged torque, and of its zero over the torque limit."""
        n, limit = self.lab.machine.n_axes, self.lab.machine.limit
        columns = []
        for one in np.eye(n):
            scaled = [(torque * (1 + gain * one), w) for torque, w in self._base]
            columns.append(self._white(scaled, "alone")[None])
            if zero:
                moved = [(torque + zero * limit * one, w) for torque, w in self._base]
                columns.append(self._white(moved, "alone")[None])
        return columns

    @cached_property
    def _known(self) -> dict[str, np.ndarray]:
        return {}

    def _decorrelated(self, columns: np.ndarray, mode: str) -> np.ndarray:
        """Inner products of columns, given that what may differ does; (columns, columns)."""
        known = self._columns(mode)
        along = known @ columns.T
        inner = np.eye(len(known)) + known @ known.T
        out: np.ndarray = columns @ columns.T - along.T @ np.linalg.solve(inner, along)
        return out

    def _signal(self, effect: Effect, mode: str) -> np.ndarray:
        """Change by an effect in the robot, in units of the noise."""
        plant = apply(effect, self.robot, self.lab.machine)
        return self._white(self._torque(plant, [effect]), mode, self.healthy)

    def d_prime(self, effect: Effect, mode: str) -> float:
        """Distance of the robot with the effect from healthy ones, in standard deviations.

        Args:
            effect: The effect, with its severity.
            mode: 'twin' or 'alone'.

        Returns:
            d'; an ideal detector finds the effect from about 4 on.
        """
        square = self._decorrelated(self._signal(effect, mode)[None], mode)[0, 0]
        return float(np.sqrt(max(square, 0.0)))

    def separation(self, effect: Effect, mode: str) -> float:
        """Distance from the nearest other effect of the catalogue on the same axis.

        Each of the others may have any severity; its change of torque is taken to be linear.

        Args:
            effect: The effect, with its severity.
            mode: 'twin' or 'alone'.

        Returns:
            d' that remains; an ideal judge tells the two apart from about 4 on.
        """
        rivals = [
            self._white(run, mode)
            for name, run in self._rivals(effect.axis).items()
            if name != effect.name
        ]
        inner = self._decorrelated(np.array([self._signal(effect, mode), *rivals]), mode)
        own, sizes = inner[0, 0], np.diag(inner)[1:]
        # what is invisible cannot be mistaken for the effect
        shares = np.where(sizes > 1e-6, inner[0, 1:] ** 2 / np.maximum(sizes, 1e-6), 0.0)
        return float(np.sqrt(max(own - shares.max(), 0.0)))

    def _rivals(self, axis: int) -> dict[str, Runs]:
        """Runs of the model with each effect of the catalogue on an axis."""
        if axis not in self._runs:
            machine = self.lab.machine
            effects = [
                Effect(name, axis, unit(name, axis, machine), {"order": 2.0})
                for name in CATALOGUE
                if axis in axes_of(name, machine.n_axes)
            ]
            self._runs[axis] = {
                effect.name: self._torque(apply(effect, self.ideal, machine), [effect])
                for effect in effects
            }
        return self._runs[axis]

    @cached_property
    def _runs(self) -> dict[int, dict[str, Runs]]:
        return {}

    def at_multiple(self, effect: Effect, multiple: float, mode: str) -> Effect:
        """The effect at a multiple of its limit, or as large as is sensible.

        Args:
            effect: The effect; its severity does not matter.
            multiple: Of the limit.
            mode: 'twin' or 'alone': whose limit.
        """
        machine = self.lab.machine
        most = largest(effect.name, effect.axis, machine)
        severity = unit(effect.name, effect.axis, machine)
        for _ in range(4):
            effect = replace(effect, severity=severity)
            found = self.d_prime(effect, mode)
            factor = multiple * DETECTED / max(found, 1e-6)
            if 0.9 < factor < 1.1:
                break
            # backlash and the like are not linear: not too far at once
            severity = float(min(severity * np.clip(factor, 0.02, 20), most))
        return replace(effect, severity=severity)

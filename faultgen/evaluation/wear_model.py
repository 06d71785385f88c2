"""How features change with wear according to the nominal model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from faultgen.analysis.friction_features import FrictionFeatures
from faultgen.analysis.isolation import ChangeIsolator
from faultgen.effects import Applied
from faultgen.effects.temperature import TEMPERATURE_RANGE
from faultgen.monitoring.reductions import SPEED_WINDOW, mean_abs_torque
from faultgen.robot import Robot
from faultgen.simulation.state import Condition

_STEP = 4.0  # as far as temperatures of the preset 'realistic' commonly wander [K]
_SEVERITY = 0.1
_HEAVIER = 1.03
_TURNING = 0.3  # share of the Stribeck velocity; a slower axis creeps


@dataclass(frozen=True, eq=False)
class Directions:
    """Change of a reduction with the severity of each axis."""

    value: np.ndarray
    """At reference temperature, shape (n_axes, features)."""
    spread: np.ndarray
    """Its variation with temperature and severity, shape (n_axes, vectors, features)."""

    def isolator(self, *, temperature_varies: bool, **options: Any) -> ChangeIsolator:
        """Make an isolator with these directions, not yet fitted.

        Args:
            temperature_varies: Whether the temperature is added as the last feature.
            options: Options of `ChangeIsolator`.

        Returns:
            The isolator.
        """
        extra = int(temperature_varies)
        return ChangeIsolator(
            directions=_widened(self.value, extra),
            spread=_widened(self.spread, extra),
            condition=self.value.shape[1] if temperature_varies else None,
            **options,
        )


@dataclass(frozen=True, eq=False)
class WearModel:
    """Friction terms of a robot's task, and how features change with wear."""

    friction_terms: FrictionFeatures
    """Friction terms of the nominal cycle."""
    directions: dict[str, Directions]
    """Directions of wear of the features "mean_abs_torque" and "friction_terms"."""
    turning: np.ndarray
    """Axes that turn in the nominal cycle, shape (n_axes,)."""


def _widened(vectors: np.ndarray, extra: int) -> np.ndarray:
    """Vectors with additional zeros for features that wear does not move."""
    return np.concatenate([vectors, np.zeros((*vectors.shape[:-1], extra))], axis=-1)


def _steps(reference: float) -> list[tuple[float, float]]:
    """(temperature, severity) of wear: nominal, colder, warmer, further."""
    return [
        (reference, _SEVERITY),
        (reference - _STEP, _SEVERITY),
        (reference + _STEP, _SEVERITY),
        (reference, 2 * _SEVERITY),
    ]


def wear_points(robot: Robot, effect: str, temperature: float | None = None) -> list[Condition]:
    """List the conditions whose cycles `wear_model` and `wear_slopes` need, in their order.

    The first one has a heavier payload. Then each step has the healthy robot and each worn axis.

    Args:
        robot: The healthy robot.
        effect: Effect that is considered as wear.
        temperature: Mean temperature of the gearboxes [deg C]. Default: that at which the friction
            of the model holds. All conditions stay within the range of the law of friction.

    Returns:
        The conditions.
    """
    reference = robot.friction_temperature
    if temperature is not None:
        low, high = TEMPERATURE_RANGE
        reference = min(max(temperature, low + _STEP), high - _STEP)
    conditions = [Condition(reference, _HEAVIER)]
    for temperature, severity in _steps(reference):
        conditions.append(Condition(temperature))
        conditions += [
            Condition(temperature, 1.0, (Applied(effect, axis, severity),))
            for axis in range(1, robot.n_axes + 1)
        ]
    return conditions


def wear_model(robot: Robot, cycles: np.ndarray, window: ArrayLike = SPEED_WINDOW) -> WearModel:
    """Compute friction terms and directions of wear from nominal cycles.

    Args:
        robot: The healthy robot.
        cycles: Noise-free cycles at `wear_points`, shape (points, 3, samples, n_axes): motor
            position [rad], velocity [rad/s] and torque [N m].
        window: Speed window of the mean torque, shape (2,) or (n_axes, 2), in [rad/s].

    Returns:
        The friction terms and directions.
    """
    heavy, nominal, *_ = cycles
    terms = FrictionFeatures(stribeck_velocity=robot.stribeck_velocity).fit(
        nominal[1], load=(heavy[2] - nominal[2]) / (_HEAVIER - 1)
    )
    torque = np.nan_to_num([mean_abs_torque(cycle[1], cycle[2], window) for cycle in cycles[1:]])
    directions = {
        "mean_abs_torque": wear_slopes(torque),
        "friction_terms": wear_slopes(terms.transform(cycles[1:, 2])),
    }
    return WearModel(terms, directions, turning_axes(robot, nominal[1]))


def turning_axes(robot: Robot, velocity: np.ndarray) -> np.ndarray:
    """Find the axes that turn at some sample. The friction of the others cannot be observed.

    Args:
        robot: The healthy robot.
        velocity: Motor velocity in the nominal cycle, shape (samples, n_axes), in [rad/s].

    Returns:
        Shape (n_axes,).
    """
    return np.abs(velocity).max(axis=0) > _TURNING * robot.stribeck_velocity


def wear_slopes(reduced: np.ndarray) -> Directions:
    """Compute the directions of a reduction.

    Args:
        reduced: Reduced cycles at all `wear_points` except the first, shape (cycles, features).

    Returns:
        The directions, with their spread.
    """
    steps = _steps(0.0)
    here, cold, warm, further = (
        (group[1:] - group[0]) / severity
        for group, (_, severity) in zip(np.split(reduced, len(steps)), steps, strict=True)
    )
    spread = np.stack([(warm - cold) / 2, warm + cold - 2 * here, further - here], axis=1)
    return Directions(here, spread)

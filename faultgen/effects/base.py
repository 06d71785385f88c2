"""What an effect is: facts about it, and hooks at the five places where a simulation can change.

==========  ==========================================================================
`edit`      the model, once
`command`   the control signal: what the controller sends to the drives
`log`       the channels: what the controller logs
`sense`     the channels as measured, after noise: what sensors and their lines make of them
`between`   friction parameters, between steps: what no element of MuJoCo expresses
==========  ==========================================================================

Severity 0 calls none of them, so it is the healthy robot bit for bit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from faultgen.applied import Applied as Applied
from faultgen.effects.hooks import Place, Update
from faultgen.effects.prior import Prior, check_prior
from faultgen.errors import InputError, what_it_says

if TYPE_CHECKING:
    from faultgen.monitoring.sensors import Measured
    from faultgen.robot import Robot
    from faultgen.simulation.cycle import Cycle

HEALTHY = "healthy"
"""Effect name of runs without a fault."""

DEFAULT_FRACTION = 0.2
"""Severity of effects that are fractions, if an experiment does not give one."""

MASSLESS = 1e-3
"""A payload below this mass only marks a place [kg]."""

FRACTION = "fraction of nominal (0.1 = 10 % more)"
"""Unit of effects that scale a nominal value."""


def _all_axes(n_axes: int) -> range:
    return range(1, n_axes + 1)


def last_axis(n_axes: int) -> range:
    """Return the axis that carries the payload, as a range."""
    return range(n_axes, n_axes + 1)


def is_loaded(robot: Robot, axis: int) -> bool:
    """Whether a link carries a payload of at least `MASSLESS` in the model; only the last one may.

    Args:
        robot: The robot.
        axis: Number of the joint that carries the link, from 1.
    """
    return axis == robot.n_axes and robot.payload_mass >= MASSLESS


@dataclass(frozen=True, kw_only=True)
class Effect:
    """One physical effect and how it changes a robot."""

    name: str
    """Name in commands and files."""
    description: str
    """What happens in the robot."""
    unit: str
    """What severity 1 means, in words."""
    units: str = "1"
    """SI unit of severity, as files state it; "1" for a fraction. See `units_on`."""
    slide_units: str = ""
    """SI unit on a joint that slides, if it differs."""
    point_units: str = ""
    """SI unit on a link on which the model has no payload with a mass, if it differs."""
    signature: str
    """Visible trace in the motor's torque."""
    element: str
    """The MuJoCo element, or the hook, that represents the effect."""
    source: str
    """Source of the law."""
    largest: float = 10.0
    """Largest severity that is sensible."""
    point_largest: float = 0.0
    """The same in `point_units`."""
    smallest: float = 0.0
    """Smallest severity that is sensible; negative if the effect has two directions."""
    prior: Prior = None  # type: ignore[assignment]  # required: refused with its name when made
    """What discovery assumes about the effect. It is required."""
    step: float = 0.1
    """Severity for sensitivities: its effect is clearly visible and still nearly linear."""
    parameters: Mapping[str, Any] = field(default_factory=dict)
    """Further numbers and choices, by name, with their defaults."""
    same_as: str = ""
    """Name of an effect that changes the robot in the same way, in another unit."""
    motor_torque: bool = False
    """Whether severity is a torque on the rotor, which stays below the motor's torque limit."""
    axes: Callable[[int], range] = _all_axes
    """Axes on which the effect can act, as a function of the number of axes. See `axes_on`."""
    usual_axes: Callable[[int], range] | None = None
    """Axes on which it acts if an experiment names none. Default: `axes`. See `usual_axes_on`."""
    payload: float | None = None
    """Smallest mass of the robot's payload [kg] with which the effect can act; None: no payload is
    needed."""
    edit: Callable[..., None] | None = None
    """Changes the spec in place: (spec, axis, severity, **parameters)."""
    last: bool = False
    """Whether the edit comes after those of other effects, because it depends on the edited
    gearbox."""
    command: Callable[[np.ndarray, Place, bool], np.ndarray] | None = None
    """Changes the control that reaches the drives: (control, place, whether it repeats); returns a
    new array."""
    log: Callable[[Cycle, Cycle, Place], Cycle] | None = None
    """Changes the channels that are logged: (cycle as simulated, as logged so far, place)."""
    sense: Callable[[Measured, Place, float, np.random.Generator], Measured] | None = None
    """Changes the channels that are stored: (as measured so far, place, sample period [s],
    randomness)."""
    between: Callable[[Sequence[Place]], Update | None] | None = None
    """Makes the function that is called between steps, for all places of the effect at once. It is
    None if nothing changes in time."""
    interval: float = 2e-3
    """Time between those calls [s]."""

    def __post_init__(self) -> None:
        """Refuse an effect without a complete prior.

        Raises:
            InputError: The prior is missing or incomplete. The message names the effect.
        """
        check_prior(self.name, self.prior)

    @property
    def in_mjcf(self) -> bool:
        """Whether the model file can hold everything that the effect does."""
        hooks = (self.command, self.log, self.sense, self.between)
        return self.edit is not None and all(hook is None for hook in hooks)

    @property
    def in_fractions(self) -> bool:
        """Whether severity is a fraction of a nominal value."""
        return self.unit == FRACTION

    @property
    def signed(self) -> bool:
        """Whether negative severities are meaningful."""
        return self.smallest < 0

    @property
    def default(self) -> float:
        """Severity if an experiment does not give one: 0.2 for fractions, otherwise `step`."""
        return DEFAULT_FRACTION if self.units == "1" else self.step

    def axes_on(self, robot: Robot) -> tuple[int, ...]:
        """Axes of a robot on which the effect can act, from 1; empty if the payload is light."""
        if self.payload is not None and not robot.payload_mass >= self.payload:
            return ()
        return tuple(self.axes(robot.n_axes))

    def usual_axes_on(self, robot: Robot) -> tuple[int, ...]:
        """Those of `axes_on` on which the effect acts if an experiment names none."""
        usual = self.usual_axes or self.axes
        return tuple(axis for axis in self.axes_on(robot) if axis in usual(robot.n_axes))

    def units_on(self, robot: Robot, axis: int) -> str:
        """Return the SI unit of the severity on an axis of a robot.

        Args:
            robot: The robot.
            axis: Axis, from 1.

        Returns:
            The unit, "1" for a fraction.
        """
        if self.point_units and not is_loaded(robot, axis):
            return self.point_units
        if self.slide_units and robot.slides[axis - 1]:
            return self.slide_units
        return self.units

    def unit_with(self, parameters: Mapping[str, Any]) -> str:
        """Return what severity 1 means, in words, where the parameters tell: a point has a place.

        Args:
            parameters: Parameters of one case.
        """
        return self.point_units if self.point_units and parameters else self.unit

    def largest_with(self, parameters: Mapping[str, Any]) -> float:
        """Return the largest sensible severity, in the unit of `unit_with`.

        Args:
            parameters: Parameters of one case.
        """
        return self.point_largest if self.point_units and parameters else self.largest

    def check_severity(self, severity: float, robot: Robot, axis: int) -> None:
        """Refuse a severity that is too large for its unit on an axis of a robot.

        Args:
            severity: Severity in the unit of the effect.
            robot: The robot.
            axis: Axis, from 1.

        Raises:
            InputError: The severity is too large. The message states the largest one.
        """
        limit = robot.motor_torque_limit[axis - 1] if self.motor_torque else np.inf
        units = self.units_on(robot, axis)
        point = bool(self.point_units) and units == self.point_units
        largest, unit = (self.point_largest, units) if point else (self.largest, self.unit)
        if severity > largest:
            where = f" on axis {axis} of robot {robot.name}" if self.point_units else ""
            raise InputError(f"severity: {self.name}{where} takes up to {largest:g} ({unit})")
        if severity > limit:
            raise InputError(
                f"severity: {self.name} on axis {axis} of robot {robot.name} takes up to the "
                f"motor's torque limit of {limit:g} N m, not {severity:g}"
            )

    def shown(self, severity: float, units: str = "") -> str:
        """Return a severity with its unit as text.

        Args:
            severity: The severity.
            units: SI unit on the axis, if it is known; slides have other units than hinges, and
                links without a payload other ones than links with one.
        """
        if units and units in (self.slide_units, self.point_units):
            return f"{severity:g} {units}"
        if self.in_fractions:
            return f"{100 * severity:g} %"
        return f"{severity:g} {self.unit.split(',')[0].split(' of ')[0]}"

    def complete(self, parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Add the defaults of all parameters that are not given.

        Raises:
            InputError: The effect has no such parameter.
        """
        for name in parameters:
            if name not in self.parameters:
                known = ", ".join(self.parameters) or "none"
                raise InputError(f"{self.name} has no parameter '{name}': choose {known}")
        return {**self.parameters, **parameters}

    def apply(self, spec: mujoco.MjSpec, axis: int, severity: float, **parameters: Any) -> None:
        """Put the effect's edit into a model. Severity 0 leaves the model exactly as it is.

        Effects that change more than the model need `faultgen.simulation.plant.assemble`.

        Args:
            spec: The robot, edited in place.
            axis: Axis, from 1.
            severity: Severity in the unit of the effect.
            parameters: Parameters that differ from the defaults.

        Raises:
            InputError: A parameter is unknown or has an impossible value, or the edit fails, as
                one of a user's own effect may.
        """
        values = self.complete(parameters)
        if severity != 0 and self.edit is not None:
            try:
                self.edit(spec, axis, severity, **values)
            except InputError:
                raise
            except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
                raise InputError(
                    f"effect {self.name}: its edit fails on axis {axis} with a severity of "
                    f"{severity:g}: {what_it_says(error)}"
                ) from error

"""How a robot is operated: at which speed, with which payload, and how warm it is.

operation = Operation(speed=0.5, payload=2.0)
nominal("puma560", "spot_weld", 0.004, operation)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from faultgen.errors import InputError

if TYPE_CHECKING:
    from faultgen.robot import Robot


@dataclass(frozen=True)
class Operation:
    """How a robot is operated. None stands for what task and model say."""

    speed: float | None = None
    """Speed override, above 0 and up to 1: all velocities of the task are multiplied by it. Its
    pauses last longer, too."""
    payload: float | None = None
    """Mass of the payload [kg]. The controller knows it."""
    temperature: float | None = None
    """Mean temperature of the gearboxes [deg C]."""

    @classmethod
    def of(cls, told: Mapping[str, Any]) -> Operation:
        """Read the operation from the parameters of a run, which may lack it.

        Args:
            told: Values by name.
        """
        return cls(told.get("speed"), told.get("payload"), told.get("temperature"))

    @property
    def given(self) -> dict[str, float]:
        """The values that are given, by name."""
        values = {"speed": self.speed, "payload": self.payload, "temperature": self.temperature}
        return {name: value for name, value in values.items() if value is not None}

    def __str__(self) -> str:
        """Such as "speed 0.5, payload 2 kg"; empty if nothing is given."""
        units = {"speed": "", "payload": " kg", "temperature": " °C"}
        return ", ".join(f"{name} {value:g}{units[name]}" for name, value in self.given.items())

    def loaded(self, robot: Robot) -> Robot:
        """Return the robot with the payload.

        Args:
            robot: The robot.

        Returns:
            A robot whose body `payload` has this mass, and an inertia in proportion.

        Raises:
            InputError: The model has no payload with a mass.
        """
        from faultgen.effects.structure import MASSLESS  # reading a dataset needs no simulator

        if self.payload is None:
            return robot
        spec = robot.spec()
        body = spec.body("payload")
        if body is None or body.mass < MASSLESS:
            raise InputError(
                f"payload: robot {robot.name} has no body 'payload' with a mass, whose mass could "
                "be changed; see docs/robots.md"
            )
        factor = self.payload / float(body.mass)
        body.mass *= factor
        body.inertia *= factor
        return robot.edited(spec)


AS_PROGRAMMED = Operation()
"""What task and model say."""

"""Robots of one type that differ: what `randomize` draws for each run.

Methods that are trained on one robot model fail on robots that differ from it. With `randomize`,
every run is made by a robot of its own, whose controller knows the nominal model only:

    parameters    Coulomb and static friction together, viscous friction, rotor inertia and gear
                  stiffness of each axis
    masses        mass and inertia of each link together; the payload counts as a link
    servo         gains of each servo
    noise         torque, position and velocity noise of the sensors
    payload       mass of the payload
    temperature   mean temperature of the gearboxes [K]

Each factor is exp(spread z) with z normal and cut at 3; the temperature is spread z about the mean.
The defaults of spreads are 0: they are assumptions of who generates, not measured.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from faultgen.dataset.experiment import SPREADS
from faultgen.effects import get_effect
from faultgen.effects.temperature import TEMPERATURE_RANGE
from faultgen.mjcf.dcmotor import INTEGRAL_GAIN, POSITION_GAIN, VELOCITY_GAIN
from faultgen.monitoring.sensors import Sensors
from faultgen.robot import Robot

_PARAMETERS = ("friction_wear", "viscous_friction", "rotor_inertia", "gear_stiffness")
_CUT = 3.0  # standard deviations, beyond which are 3 in 1000 draws


@dataclass(frozen=True, eq=False)
class Instance:
    """How one robot differs from its model. Factors of 1 and 0 K change nothing."""

    parameters: dict[str, list[float]]
    """Factor of each axis, by the effect that changes what it multiplies."""
    masses: dict[str, float]
    """Factor of mass and inertia, by the name of the body."""
    servo: list[float]
    """Factor of the gains of each servo."""
    noise: float
    """Factor of the noise of the sensors."""
    payload: float
    """Factor of the mass of the payload."""
    temperature: float
    """Difference of the mean temperature [K]."""

    def edit(self, spec: mujoco.MjSpec) -> mujoco.MjSpec:
        """Make the robot out of its model.

        Args:
            spec: The model, edited in place.

        Returns:
            The same.
        """
        for name, factors in self.parameters.items():
            # what an effect of stiffness states is the share that is lost
            sign = -1.0 if name == "gear_stiffness" else 1.0
            edit = get_effect(name).edit
            assert edit is not None  # all of these change the model
            for axis, factor in enumerate(factors, start=1):
                edit(spec, axis, sign * (factor - 1.0))
        for name, factor in self.masses.items():
            body = spec.body(name)
            body.mass *= factor
            body.inertia *= factor
            body.fullinertia *= factor  # nan where the other one is stated
        for axis, factor in enumerate(self.servo, start=1):
            spec.actuator(f"drive{axis}").gainprm[
                [POSITION_GAIN, INTEGRAL_GAIN, VELOCITY_GAIN]
            ] *= factor
        return spec

    def sensors(self, sensors: Sensors) -> Sensors:
        """Return sensors with the noise of this robot.

        Args:
            sensors: Those of all robots.
        """
        torque = np.asarray(sensors.torque_noise) * self.noise
        return replace(
            sensors,
            torque_noise=torque.tolist(),
            position_noise=sensors.position_noise * self.noise,
            velocity_noise=sensors.velocity_noise * self.noise,
        )

    def mean_temperature(self, mean: float) -> float:
        """Return the mean temperature of its gearboxes [deg C].

        Args:
            mean: That of all robots.
        """
        return float(np.clip(mean + self.temperature, *TEMPERATURE_RANGE))


def draw_instance(robot: Robot, spreads: Mapping[str, float], rng: np.random.Generator) -> Instance:
    """Draw a robot.

    Args:
        robot: The model.
        spreads: Spread of each of `SPREADS` that is given; the others do not vary. A further entry
            changes no draw of the others.
        rng: Source of randomness.

    Returns:
        The robot.
    """
    streams = dict(zip(SPREADS, rng.spawn(len(SPREADS)), strict=True))

    def factors(name: str, count: int) -> list[float]:
        z = np.clip(streams[name].standard_normal(count), -_CUT, _CUT)
        found: list[float] = np.exp(spreads.get(name, 0.0) * z).tolist()
        return found

    n = robot.n_axes
    spec = robot.spec()
    rotors = {spec.joint(f"motor{axis}").parent.name for axis in range(1, n + 1)}
    links = [body for body in spec.bodies if body.name and body.name not in rotors]
    bodies = [body.name for body in links if body.mass > 0]
    return Instance(
        parameters={name: factors("parameters", n) for name in _PARAMETERS},
        masses=dict(zip(bodies, factors("masses", len(bodies)), strict=True)),
        servo=factors("servo", n),
        noise=factors("noise", 1)[0],
        payload=factors("payload", 1)[0],
        temperature=float(
            spreads.get("temperature", 0.0)
            * np.clip(streams["temperature"].standard_normal(), -_CUT, _CUT)
        ),
    )

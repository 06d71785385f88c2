"""A monitored robot: as many series of cycles as a study needs.

Cycles come from a surrogate. They are disturbed and measured as in a run of `faultgen generate`:
the same seed draws the same temperature, payload and noise.

    monitored = Monitored.of(build_surrogate("irb6700", "spot_weld"))
    seen = monitored.observe(get_sensors("realistic"), severity, np.random.default_rng(1))
    seen.mean_torque, seen.friction
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from faultgen.evaluation.wear_model import Observed, WearModel, wear_model, wear_points
from faultgen.monitoring.environment import surroundings
from faultgen.monitoring.reductions import mean_abs_torque
from faultgen.monitoring.sensors import Sensors, measure
from faultgen.robot import load_robot
from faultgen.simulation.surrogate import Surrogate

_BLOCK = 25  # cycles put together at once; bounds the memory


@dataclass(frozen=True, eq=False)
class Monitored:
    """A robot and task, with the wear model."""

    surrogate: Surrogate
    """Cycles free of noise."""
    model: WearModel
    """Friction terms and directions of wear."""
    reference: float
    """Gearbox temperature at which the model's friction holds [deg C]."""

    @classmethod
    def of(cls, surrogate: Surrogate) -> Monitored:
        """Compute the wear model from the surrogate's own cycles."""
        robot = load_robot(surrogate.robot_path)
        model = wear_model(robot, surrogate.at(wear_points(robot, surrogate.effect)))
        return cls(surrogate, model, robot.friction_temperature)

    def observe(self, sensors: Sensors, severity: np.ndarray, rng: np.random.Generator) -> Observed:
        """Reduce consecutive cycles.

        Args:
            sensors: Noise and disturbance.
            severity: Severity of each cycle and axis, shape (cycles, n_axes).
            rng: Source of randomness, used in the same order as in a run of `faultgen generate`.

        Returns:
            The reductions.
        """
        cycles = len(severity)
        rng_surroundings, rng_sensors = rng.spawn(2)
        around = surroundings(sensors, cycles, self.reference, rng_surroundings)
        mean_torque, friction = [], []
        for start in range(0, cycles, _BLOCK):
            part = slice(start, start + _BLOCK)
            clean = self.surrogate.cycles(
                around.temperature[part], around.payload_factor[part], severity[part]
            )
            for position, velocity, torque in clean:
                seen = measure(
                    sensors,
                    position,
                    velocity,
                    torque,
                    gear_ratio=self.surrogate.gear_ratio,
                    encoder_counts=self.surrogate.encoder_counts,
                    mean_torque=self.surrogate.mean_torque,
                    sample_period=self.surrogate.sample_period,
                    rng=rng_sensors,
                )
                mean_torque.append(mean_abs_torque(seen.motor_velocity, seen.motor_torque))
                friction.append(self.model.features.transform(seen.motor_torque[None])[0])
        return Observed(np.array(mean_torque), np.array(friction), around.measured_temperature)

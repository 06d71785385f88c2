"""A monitored robot: as many series of cycles as a study needs.

Cycles come from a surrogate. They are disturbed and measured as in a run of `faultgen generate`:
the same seed draws the same temperature, payload and noise.

    monitored = Monitored.of(build_surrogate("irb6700", "spot_weld"))
    seen = monitored.observe(get_sensors("realistic"), severity, np.random.default_rng(1))
    seen["mean_abs_torque"], seen["friction_terms"]
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass

import numpy as np

from faultgen.evaluation.features import Features, features
from faultgen.evaluation.methods import Setting
from faultgen.evaluation.wear_model import WearModel, wear_model, wear_points
from faultgen.monitoring.environment import Surroundings, surroundings
from faultgen.monitoring.sensors import Sensors, measure
from faultgen.robot import load_robot
from faultgen.simulation.nominal import nominal
from faultgen.simulation.surrogate import Surrogate

STORED = ("mean_abs_torque", "friction_terms", "temperature")
"""Names of the features that the study keeps of every series."""

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

    def setting(self, *, temperature_varies: bool) -> Setting:
        """Return what methods may know before they see data.

        Args:
            temperature_varies: Whether the temperature varies from cycle to cycle.

        Returns:
            The setting.
        """
        return Setting(
            n_axes=self.surrogate.n_axes,
            samples=self.surrogate.nodes.shape[2],
            temperature_varies=temperature_varies,
            reference_temperature=self.reference,
            directions=self.model.directions,
            turning=self.model.turning,
        )

    def observe(
        self,
        sensors: Sensors,
        severity: np.ndarray,
        rng: np.random.Generator,
        names: Collection[str] = STORED,
        change: Callable[[Surroundings, slice], np.ndarray] | None = None,
    ) -> Features:
        """Observe consecutive cycles.

        Args:
            sensors: Noise and disturbance.
            severity: Severity of each cycle and axis, shape (cycles, n_axes).
            rng: Source of randomness, used in the same order as in a run of `faultgen generate`.
            names: Names of the features.
            change: Function from the surroundings of all cycles, and the cycles in question, to a
                further change of position [rad], velocity [rad/s] and torque [N m], shape (cycles
                in question, 3, samples, n_axes).

        Returns:
            The features by name; arrays have shape (cycles, ...).
        """
        cycles = len(severity)
        rng_surroundings, rng_sensors = rng.spawn(2)
        around = surroundings(sensors, cycles, self.reference, rng_surroundings)
        surrogate = self.surrogate
        limits = nominal(surrogate.robot_path, surrogate.task_path, surrogate.sample_period).limits
        parts: list[dict[str, np.ndarray]] = []
        for start in range(0, cycles, _BLOCK):
            part = slice(start, start + _BLOCK)
            clean = surrogate.cycles(
                around.temperature[part], around.payload_factor[part], severity[part]
            )
            if change is not None:
                clean += change(around, part)
            measured = [
                measure(
                    sensors,
                    position,
                    velocity,
                    torque,
                    gear_ratio=surrogate.gear_ratio,
                    encoder_counts=surrogate.encoder_counts,
                    mean_torque=surrogate.mean_torque,
                    sample_period=surrogate.sample_period,
                    rng=rng_sensors,
                )
                for position, velocity, torque in clean
            ]
            temperature = around.measured_temperature[part]
            parts.append(
                features(
                    measured, names, temperature, terms=self.model.friction_terms, limits=limits
                )
            )
        return {name: np.concatenate([part[name] for part in parts]) for name in names}

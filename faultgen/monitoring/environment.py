"""What disturbs a robot from cycle to cycle, apart from wear: its temperature and its payload.

They change the motion itself, so that every draw needs its own simulation. What sensors add to a
simulated cycle is in `faultgen.monitoring.sensors`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from faultgen.applied import Applied
from faultgen.monitoring.sensors import Sensors


@dataclass(frozen=True)
class Surroundings:
    """What changes from cycle to cycle, apart from wear. Arrays have shape (cycles,)."""

    temperature: np.ndarray
    """True gearbox temperature, the same in all gearboxes [deg C]."""
    measured_temperature: np.ndarray
    """Temperature that the sensor shows [deg C]."""
    payload_factor: np.ndarray
    """Mass of the payload divided by its nominal mass."""


def surroundings(
    sensors: Sensors, cycles: int, reference: float, rng: np.random.Generator
) -> Surroundings:
    """Draw temperature and payload for every cycle.

    The temperature is a first-order autoregressive process around the reference. The number of
    random draws is the same for every preset.

    Args:
        sensors: The preset.
        cycles: Number of cycles.
        reference: Mean temperature [deg C].
        rng: Random number generator.

    Returns:
        The surroundings in each cycle.
    """
    from scipy.signal import lfilter  # takes a second, so only when needed

    kicks, errors, loads = rng.standard_normal((3, cycles))
    memory = np.exp(-1 / sensors.temperature_memory)
    kicks[1:] *= np.sqrt(1 - memory**2)
    wander = lfilter([1.0], [1.0, -memory], kicks)
    temperature = reference + sensors.temperature_wander * wander
    return Surroundings(
        temperature=temperature,
        measured_temperature=temperature + sensors.temperature_error * errors,
        payload_factor=1 + sensors.payload_scatter * loads,
    )


def differences(
    sensors: Sensors, cycles: int, rng: np.random.Generator
) -> list[tuple[Applied, ...]]:
    """Draw how the healthy robot differs in every cycle.

    Args:
        sensors: The sensors.
        cycles: Number of cycles.
        rng: Random number generator.

    Returns:
        For each cycle, effects with the severity that was drawn, which may be negative.
    """
    drawn: list[list[Applied]] = [[] for _ in range(cycles)]
    for name, spread in sorted(sensors.run_to_run.items()):
        severities = np.asarray(spread) * rng.standard_normal((cycles, len(spread)))
        # no draw beyond three standard deviations turns the sign of what it changes
        severities = np.clip(severities, -3 * np.asarray(spread), 3 * np.asarray(spread))
        for row, effects in zip(severities, drawn, strict=True):
            effects += [
                Applied(name, axis, float(severity), {})
                for axis, severity in enumerate(row, start=1)
                if severity != 0
            ]
    return [tuple(effects) for effects in drawn]

"""What may be logged: the ways to log that the study compares."""

from __future__ import annotations

from faultgen.monitoring.sensors import SENSORS, Sensors
from faultgen.simulation.surrogate import SAMPLE_PERIOD
from faultgen.studies.detectability.ideal import View

REFERENCE = "torque"
"""Name of the view to which the others are compared."""


def views(sensors: Sensors) -> list[View]:
    """List what may be logged, the reference first.

    Args:
        sensors: Noise and disturbances.
    """
    period = sensors.sample_period or SAMPLE_PERIOD
    found = [View(name=REFERENCE, sensors=sensors, sample_period=period)]
    if sensors.temperature_wander > sensors.temperature_error:
        found.append(
            View(
                name="without thermometer",
                sensors=sensors,
                sample_period=period,
                thermometer=False,
            )
        )
    if not sensors.torque_colour:  # it holds for one sample period only
        found += [
            View(name=f"torque at {1 / p:g} Hz", sensors=sensors, sample_period=p)
            for p in (0.001, 0.04)
        ]
    if sensors.quantised or sensors.position_noise > 0:
        found.append(
            View(name="torque and encoder", sensors=sensors, sample_period=period, encoder=True)
        )
    if sensors.quantised:
        found.append(
            View(
                name="encoder with 10 times the counts",
                sensors=sensors,
                sample_period=period,
                encoder=True,
                finer=10.0,
            )
        )
    if sensors == SENSORS["realistic"]:
        found.append(View(name="noise of the thesis", sensors=SENSORS["thesis"]))
    return found

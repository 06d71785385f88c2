"""Event logs: kinds of events that follow from the simulation by rules, and random ones.

Some kinds (`AXIS_EVENTS`) belong to each axis. A rule compares a simulated value plus noise with a
limit on every cycle, or every hour for temperatures. The event occurs where the limit is exceeded.
The number of events on a day has a Poisson distribution with the mean

    m (1 - exp(-cycles P(value + noise > limit) / m)) + background

where m is the largest number of events on a day that operators accept before they take action
(assumed).

The limits are set for each robot from its first days, as a service engineer would do; their margins
and the noise are assumed. The other kinds belong to the robot's cell. They occur in bursts: the
rate of each of four groups (operators, mains and network, parts and tools, safety) varies from day
to day. Some events also follow from others; for example, a program stops after a motion
supervision. The rates are drawn for each robot, and one third of the kinds hardly ever occur. All
this is assumed, because no log of such a fleet is public.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from faultgen.fleet.calendar import Calendar
from faultgen.robot import Robot

AXIS_EVENTS = (
    "motor_torque_limit",
    "motion_supervision",
    "position_deviation",
    "speed_deviation",
    "gearbox_temperature",
    "motor_temperature",
)
"""Kinds of events that each axis has."""

_GROUPS = {
    "operators": (
        "emergency_stop",
        "program_stopped",
        "program_started",
        "program_changed",
        "mode_changed",
        "operator_login",
        "speed_override_changed",
        "program_error",
        "jogging",
        "parameter_changed",
    ),
    "mains": (
        "mains_voltage_low",
        "dc_link_voltage",
        "power_failure",
        "restart",
        "fieldbus_lost",
        "io_timeout",
        "network_lost",
        "time_synchronised",
    ),
    "parts": (
        "part_missing",
        "gripper_not_closed",
        "tool_change_failed",
        "process_fault",
        "collision",
        "path_corrected",
    ),
    "safety": ("protective_stop", "gate_opened", "safety_input_fault"),
    "none": ("cabinet_temperature", "fan_speed", "encoder_battery", "service_done"),
}

_FOLLOWS = {
    "motion_supervision": (("program_stopped", 0.9), ("emergency_stop", 0.2), ("restart", 0.05)),
    "motor_torque_limit": (("program_error", 0.3),),
    "position_deviation": (("path_corrected", 0.5), ("program_stopped", 0.2)),
    "collision": (("program_stopped", 0.9), ("emergency_stop", 0.5)),
    "emergency_stop": (("program_started", 0.9),),
    "power_failure": (("restart", 0.9), ("network_lost", 0.5)),
}
"""Events that follow from an event of a kind, each with its probability."""

_RATE = 0.4  # median background of a kind of the cell [1/d]
_RATE_SPREAD = 1.2  # of its logarithm
_RARE = 1 / 3  # share of kinds that hardly ever occur
_RARE_RATE = 0.005  # [1/d]
_AXIS_RATE = 0.02  # background of a kind of an axis [1/d]
_MOOD = 0.8  # spread of the logarithm of a group's mood
_MARGIN = {"torque": 0.06, "deviation": 0.06, "position_error": 0.25, "temperature": 6.0}
_NOISE = {"torque": 0.015, "deviation": 0.015, "position_error": 0.06, "temperature": 1.0}
_MOST = 20.0  # of a kind of an axis on a day
_FIRST_DAYS = 14  # from which limits are set
_HOT_CABINET = 38.0  # hall temperature at which the cabinet warns [deg C]


@dataclass(frozen=True, eq=False)
class Strain:
    """The values of one day that the rules compare with limits. Arrays have shape (n_axes,)."""

    torque: np.ndarray
    """Largest motor torque divided by the usual largest one."""
    deviation: np.ndarray
    """Largest difference of the torque from the usual torque, divided by the usual largest one."""
    position_error: np.ndarray
    """Largest position error of the motors [rad]."""
    temperature: np.ndarray
    """Highest temperature of each gearbox [deg C]."""
    hall: float
    """Highest temperature of the hall [deg C]."""
    cycles: float
    """Number of cycles on that day."""


def event_names(n_axes: int = 6) -> tuple[str, ...]:
    """Return the names of all kinds of events.

    Args:
        n_axes: Number of axes. The kinds of an axis end in its number, as in
            ``motion_supervision_3``.
    """
    own = [f"{kind}_{axis}" for kind in AXIS_EVENTS for axis in range(1, n_axes + 1)]
    return (*own, *(name for group in _GROUPS.values() for name in group))


def count_events(
    robot: Robot, strains: Sequence[Strain], calendar: Calendar, rng: np.random.Generator
) -> np.ndarray:
    """Draw the number of events of a robot on each day.

    Args:
        robot: The model of the robot.
        strains: The values of each day that the rules compare with limits.
        calendar: The calendar of the robot.
        rng: Random number generator.

    Returns:
        Counts, shape (days, events), with the events in the order of `event_names`.
    """
    names = event_names(robot.n_axes)
    column = {name: k for k, name in enumerate(names)}
    counts = np.zeros((len(strains), len(names)), np.int64)
    rates = np.exp(np.log(_RATE) + _RATE_SPREAD * rng.standard_normal(len(names)))
    rates[rng.random(len(names)) < _RARE] = _RARE_RATE
    for kind, expected in _by_rules(strains).items():
        for axis in range(robot.n_axes):
            k = column[f"{kind}_{axis + 1}"]
            counts[:, k] = rng.poisson(expected[:, axis] + _AXIS_RATE * rates[k] / _RATE)
    cycles = np.array([one.cycles for one in strains])
    busy = cycles / max(float(cycles.mean()), 1e-9)
    for group, members in _GROUPS.items():
        mood = np.exp(_MOOD * rng.standard_normal(len(strains)) - _MOOD**2 / 2)
        for name in members:
            level = rates[column[name]] * busy * (1.0 if group == "none" else mood)
            counts[:, column[name]] = rng.poisson(level)
    hot = np.array([one.hall for one in strains])
    counts[:, column["cabinet_temperature"]] += rng.poisson(np.maximum(hot - _HOT_CABINET, 0.0))
    counts[calendar.services, column["service_done"]] += 1
    counts[calendar.changes, column["program_changed"]] += 1
    for cause, effects in _FOLLOWS.items():
        caused = [k for name, k in column.items() if name == cause or _kind(name) == cause]
        total = counts[:, caused].sum(axis=1)
        for name, chance in effects:
            counts[:, column[name]] += rng.binomial(total, chance)
    return counts


def _kind(name: str) -> str:
    """Kind of an event of an axis."""
    return name.rpartition("_")[0]


def _by_rules(strains: Sequence[Strain]) -> dict[str, np.ndarray]:
    """Expected number of each kind by its rule, shape (days, n_axes)."""
    cycles = np.array([one.cycles for one in strains])[:, None]
    looked = {
        "motor_torque_limit": "torque",
        "motion_supervision": "deviation",
        "position_deviation": "position_error",
        "gearbox_temperature": "temperature",
    }
    expected = {}
    for kind, name in looked.items():
        value = np.array([getattr(one, name) for one in strains])
        worked = cycles[:_FIRST_DAYS, 0] > 0
        usual = value[:_FIRST_DAYS][worked].max(axis=0) if worked.any() else value.max(axis=0)
        relative = name == "position_error"
        margin = _MARGIN[name] * (usual if relative else 1.0)
        noise = _NOISE[name] * (usual if relative else 1.0)
        looks = np.full_like(cycles, 24.0) if name == "temperature" else cycles
        often = looks * ndtr(-(usual + margin - value) / np.maximum(noise, 1e-12))
        expected[kind] = _MOST * (1 - np.exp(-often / _MOST))
    # an axis that is late is also too slow, less often; a motor gets hot with its gearbox
    expected["speed_deviation"] = 0.3 * expected["position_deviation"]
    expected["motor_temperature"] = 0.5 * expected["gearbox_temperature"]
    return expected

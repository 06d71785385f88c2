"""Event logs: 67 kinds of events, by rules on what is simulated, and at random.

Six kinds belong to each axis: on every cycle (every hour for temperatures) noise is added to what
the rule looks at, and the rule fires where that is beyond its limit, so that a day's number is
Poisson with

    m (1 - exp(-cycles P(value + noise > limit) / m)) + background

where m is what operators put up with in a day before they help themselves (assumed).

Limits are set for each robot from its first days, as a service engineer would (margins and noise
assumed). The other 31 belong to the cell: they occur in bursts of their own (negative binomial by
way of a day's mood of four groups: operators, mains and network, parts and tools, safety), or
follow from others, as a stop follows a supervision. Rates are drawn for each robot; a third of the
kinds hardly ever occur (assumed: no log of such a fleet is public).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

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
"""Kinds that there are of each axis."""

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
"""What follows from an event of a kind, and how likely."""

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
    """What the rules look at on one day. Arrays have shape (n_axes,)."""

    torque: np.ndarray
    """Largest motor torque over the usual largest."""
    deviation: np.ndarray
    """Largest difference of the torque from the usual one, over the usual largest."""
    position_error: np.ndarray
    """Largest position error, motor side [rad]."""
    temperature: np.ndarray
    """Highest of each gearbox [deg C]."""
    hall: float
    """Highest temperature of the hall [deg C]."""
    cycles: float
    """Done on that day."""


def event_names(n_axes: int = 6) -> tuple[str, ...]:
    """Names of all kinds, as ``motion_supervision_3`` for those of an axis."""
    own = [f"{kind}_{axis}" for kind in AXIS_EVENTS for axis in range(1, n_axes + 1)]
    return (*own, *(name for group in _GROUPS.values() for name in group))


def count_events(
    robot: Robot, strains: Sequence[Strain], calendar: Calendar, rng: np.random.Generator
) -> np.ndarray:
    """Daily counts of a robot's events.

    Args:
        robot: The robot.
        strains: Of each day.
        calendar: What befalls the robot.
        rng: Source of randomness.

    Returns:
        Shape (days, events), in the order of `event_names`.
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
        often = looks * norm.sf((usual + margin - value) / np.maximum(noise, 1e-12))
        expected[kind] = _MOST * (1 - np.exp(-often / _MOST))
    # an axis that is late is also too slow, less often; a motor gets hot with its gearbox
    expected["speed_deviation"] = 0.3 * expected["position_deviation"]
    expected["motor_temperature"] = 0.5 * expected["gearbox_temperature"]
    return expected

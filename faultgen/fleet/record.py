"""The record of one robot: what its monitoring stores, sample by sample."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from faultgen.fleet.calendar import ROWS, STEP, Calendar, draw_calendar
from faultgen.fleet.cycles import TEMPERATURES, Cycles, simulate_program
from faultgen.fleet.data import FleetRobot
from faultgen.fleet.events import Strain, count_events
from faultgen.fleet.plan import FleetPlan
from faultgen.fleet.robot_instance import RobotInstance, draw_instance
from faultgen.fleet.thermal import RISE, temperatures
from faultgen.monitoring.reductions import LIFE_EXPONENT, histogram
from faultgen.robot import Robot

_MOMENTS = (1 / 6, 1 / 2, 5 / 6)  # of a sample's production time, at which cycles are looked at
_LEAST = 0.002  # share of production below which nothing is stored
_CABINET = 8.0  # warmer than the hall while the robot runs [K]: assumed
_CABINET_NOISE = 0.5  # [K]: assumed


def simulate_robot(plan: FleetPlan, number: int) -> list[Cycles]:
    """Simulate the programs of a robot.

    Args:
        plan: The plan of the fleet.
        number: Number of the robot, from 0.

    Returns:
        The simulated cycles of each of its programs.

    Raises:
        SimulationFailed: A program could not be simulated.
    """
    instance = draw_instance(plan, number)
    return [simulate_program(instance, program) for program in instance.programs]


def record_robot(
    plan: FleetPlan, number: int, cycles: Sequence[Cycles] | None = None
) -> FleetRobot:
    """Compute the record of a robot.

    Args:
        plan: The plan of the fleet.
        number: Number of the robot, from 0.
        cycles: Simulated cycles of its programs, from `simulate_robot`. By default they are
            simulated. Cycles of another plan can be used if both plans have the same robots and
            differ only in what happens to these robots.

    Returns:
        The record.

    Raises:
        SimulationFailed: A program could not be simulated.
    """
    instance = draw_instance(plan, number)
    robot = instance.robot()
    rng = np.random.default_rng([plan.seed, 2, number])
    rng_calendar, rng_damage, rng_noise, rng_events = rng.spawn(4)
    cycles = simulate_robot(plan, number) if cycles is None else cycles
    calendar = draw_calendar(plan, instance, robot.n_axes, rng_calendar)
    damage, shown = _damage(instance, plan.days, rng_damage)
    warm = _temperatures(instance, calendar, cycles, shown)
    watched = _Watched(robot, cycles, plan.torque_noise, rng_noise)
    samples: dict[str, list[np.ndarray | float]] = {}
    strains = []
    for day in range(plan.days):
        seen: list[_Reduced] = []
        for rows in _windows(instance, day):
            production = float(calendar.duty[rows].mean())
            if production < _LEAST:
                continue
            moments = _moments(calendar.duty[rows]) + rows.start
            reduced = watched.reduce(warm[moments], calendar, day, float(shown[day]))
            seen.append(reduced)
            hall = float(calendar.ambient[rows].mean())
            cabinet = hall + _CABINET * production + _CABINET_NOISE * rng_noise.standard_normal()
            for name, value in {
                "day": rows.stop / ROWS,
                "production": production,
                **reduced.stored(production),
                "temperature": cabinet,
                "gearbox_temperature": warm[moments].mean(axis=0),
                "damage": damage[day],
                "shown_damage": shown[day],
                "remaining_life": instance.life.failure - rows.stop / ROWS
                if instance.life
                else np.inf,
                "mix": calendar.mix[day],
                "payload": instance.payload * (1 + calendar.payload[day]),
                "friction": calendar.friction[day],
            }.items():
                samples.setdefault(name, []).append(value)
        strains.append(_strain(watched, seen, calendar, warm, day))
    arrays = {name: np.array(values) for name, values in samples.items()}
    truth = {
        **{name: arrays.pop(name) for name in list(arrays) if name in _TRUTH},
        "services": calendar.services,
        "changes": calendar.changes,
        "damaged_axis": np.array([instance.life.axis if instance.life else 0]),
        "severity_at_failure": _at_failure(instance),
    }
    return FleetRobot(
        name=f"robot{number + 1:03d}",
        robot=instance.model,
        failed=instance.fails,
        axis=instance.life.axis if instance.life and instance.fails else 0,
        split="train",  # the parts are drawn for the whole fleet when its files are written
        **arrays,
        events=count_events(robot, strains, calendar, rng_events),
        truth=truth,
    )


_TRUTH = (
    "gearbox_temperature",
    "damage",
    "shown_damage",
    "remaining_life",
    "mix",
    "payload",
    "friction",
)


@dataclass(frozen=True, eq=False)
class _Reduced:
    """Reductions of one sample. Histograms have shape (n_axes, 12), other arrays (n_axes,)."""

    torque_histogram: np.ndarray
    speed_histogram: np.ndarray
    angle_histogram: np.ndarray
    torque: np.ndarray
    speed: np.ndarray
    peak: np.ndarray
    deviation: np.ndarray
    position_error: np.ndarray

    def stored(self, production: float) -> dict[str, np.ndarray]:
        """Return the reductions that the monitoring stores.

        Args:
            production: Share of the time in which the robot ran.

        Returns:
            Histograms, shape (n_axes, 12), without unit, and indicators of torque [N m] and speed
            [rad/s], shape (n_axes,), by name.
        """
        return {
            "torque_histogram": self.torque_histogram,
            "speed_histogram": self.speed_histogram,
            "angle_histogram": self.angle_histogram,
            "torque_indicator": self.torque * production ** (1 / LIFE_EXPONENT),
            "speed_indicator": self.speed * production,
        }


class _Watched:
    """A robot whose cycles are interpolated and reduced."""

    def __init__(
        self, robot: Robot, cycles: Sequence[Cycles], noise: float, rng: np.random.Generator
    ) -> None:
        self.robot, self.cycles, self.noise, self.rng = robot, cycles, noise, rng
        low, high = robot.joint_range.T
        speed, torque = robot.motor_velocity_limit, robot.motor_torque_limit
        self._torque = -torque, torque
        self.fixed = [
            (
                histogram(one.velocity, -speed, speed),
                histogram(one.position / robot.gear_ratio, low, high),
                np.abs(one.velocity),
            )
            for one in cycles
        ]
        self.usual = [one.base[1, 0] for one in cycles]
        self.usual_peak = np.max([np.abs(usual).max(axis=0) for usual in self.usual], axis=0)
        self.mean = [np.abs(usual).mean(axis=0) for usual in self.usual]

    def reduce(
        self, temperature: np.ndarray, calendar: Calendar, day: int, damage: float
    ) -> _Reduced:
        """Compute the reductions over the production time of one sample.

        Args:
            temperature: Temperature of each gearbox at some moments of that time, shape
                (moments, n_axes), in [deg C].
            calendar: The calendar of the robot.
            day: Number of the day, from 0.
            damage: Visible damage on that day.
        """
        n = self.robot.n_axes
        by_torque = np.zeros((n, len(self.fixed[0][0][0])))
        by_speed, by_angle = np.zeros_like(by_torque), np.zeros_like(by_torque)
        weighted, speed = np.zeros(n), np.zeros(n)
        peak, deviation, error = np.zeros(n), np.zeros(n), np.zeros(n)
        for k, (one, share) in enumerate(zip(self.cycles, calendar.mix[day], strict=True)):
            of_speed, of_angle, rate = self.fixed[k]
            by_speed += share * of_speed
            by_angle += share * of_angle
            speed += share * rate.mean(axis=0)
            for warm in temperature:
                torque, gap = one.at(warm, calendar.payload[day], calendar.friction[day], damage)
                torque += self.noise * self.mean[k] * self.rng.standard_normal(torque.shape)
                part = share / len(temperature)
                by_torque += part * histogram(torque, *self._torque)
                weighted += part * (rate * np.abs(torque) ** LIFE_EXPONENT).mean(axis=0)
                peak = np.maximum(peak, np.abs(torque).max(axis=0))
                off = np.abs(torque - self.usual[k]).max(axis=0)
                deviation = np.maximum(deviation, off)
                error = np.maximum(error, np.abs(gap).max(axis=0))
        return _Reduced(
            torque_histogram=by_torque,
            speed_histogram=by_speed,
            angle_histogram=by_angle,
            torque=(weighted / np.maximum(speed, 1e-12)) ** (1 / LIFE_EXPONENT),
            speed=speed,
            peak=peak,
            deviation=deviation,
            position_error=error,
        )


def _windows(instance: RobotInstance, day: int) -> Iterator[slice]:
    """Rows of each sample of a day."""
    edges = (
        np.linspace(day * ROWS, (day + 1) * ROWS, instance.samples_a_day + 1).round().astype(int)
    )
    for start, stop in zip(edges[:-1], edges[1:], strict=True):
        yield slice(int(start), int(stop))


def _moments(duty: np.ndarray) -> np.ndarray:
    """Rows of the calendar at which cycles are computed."""
    done = np.cumsum(duty)
    return np.searchsorted(done, np.array(_MOMENTS) * done[-1])


def _damage(
    instance: RobotInstance, days: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """True and visible damage at the middle of each day, each of shape (days,)."""
    if instance.life is None:
        return np.zeros(days), np.zeros(days)
    damage = instance.life.damage(np.arange(days) + 0.5)
    return damage, damage * instance.life.shown(days, rng)


def _temperatures(
    instance: RobotInstance, calendar: Calendar, cycles: Sequence[Cycles], shown: np.ndarray
) -> np.ndarray:
    """Temperature of each gearbox at each row, shape (days * ROWS, n_axes), in [deg C]."""
    by_day = np.einsum("dp,pdna->dna", calendar.mix, [one.losses(shown) for one in cycles])
    usual = np.mean([one.loss for one in cycles], axis=(0, 1))
    resistance = RISE * instance.cooling / usual.clip(1e-9)
    return temperatures(
        calendar.ambient,
        calendar.duty,
        np.repeat(by_day, ROWS, axis=0),
        TEMPERATURES,
        resistance,
        STEP,
    )


def _strain(
    watched: _Watched, seen: Sequence[_Reduced], calendar: Calendar, warm: np.ndarray, day: int
) -> Strain:
    """The values of a day that the rules of the event log compare with limits."""
    rows = slice(day * ROWS, (day + 1) * ROWS)
    nothing = np.zeros(watched.robot.n_axes)
    period = sum(
        one.period * share for one, share in zip(watched.cycles, calendar.mix[day], strict=True)
    )

    def worst(name: str) -> np.ndarray:
        return np.max([getattr(one, name) for one in seen], axis=0) if seen else nothing

    return Strain(
        torque=worst("peak") / watched.usual_peak,
        deviation=worst("deviation") / watched.usual_peak,
        position_error=worst("position_error"),
        temperature=warm[rows].max(axis=0),
        hall=float(calendar.ambient[rows].max()),
        cycles=float(calendar.duty[rows].sum()) * STEP * 3600 / period,
    )


def _at_failure(instance: RobotInstance) -> np.ndarray:
    """Relative increase of friction, backlash [rad] and torque ripple [N m] at failure."""
    life = instance.life
    return np.zeros(3) if life is None else np.array([life.friction, life.backlash, life.ripple])

"""Curves that a learned law can be made of, and their columns in a regression.

A curve depends on one variable of the commanded motion (`effects.law_course`). It is a sum of hat
functions, which gives straight lines between knots, or a short formula.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np
from scipy.signal import lfilter

from faultgen.discovery.replay.replay import Replay
from faultgen.effects.law_course import Course
from faultgen.simulation.arm import loads

_TURNS = (1, 2, 3, 4, 6)  # parts of a motor turn after which a curve repeats
_REACHES = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0)  # of a bristle, motor angle [rad]
_LAGS = (0.01, 0.02, 0.05, 0.1)  # [s]
_TAPS = 12  # samples of the drive's response
_PUSH = 0.05  # of the torque with which the response is found, over the RMS torque
_MOVES = 0.01  # [rad or m] from which another axis moves, and does not only give way: assumed
_WARM = 5.0  # range of temperatures that makes them worth a look [K]


@dataclass(frozen=True)
class Curve:
    """One curve of a law, without its values."""

    over: str
    """Variable."""
    of: int
    """Axis of the variable, from 1."""
    times: str
    """Factor of the curve."""
    knots: tuple[float, ...]
    """Knots in the unit of the variable, ascending."""
    scale: float = 1.0
    """Further number of the variable."""

    @property
    def repeats(self) -> bool:
        """Whether the last value is the first one."""
        return self.over == "motor_turn"

    @property
    def size(self) -> int:
        """Number of free values."""
        return len(self.knots) - self.repeats

    def basis(self, x: np.ndarray) -> np.ndarray:
        """Compute the hat functions.

        Args:
            x: The variable, in its unit.

        Returns:
            Shape (size, *x.shape), without unit.
        """
        hats = np.stack([np.interp(x, self.knots, one) for one in np.eye(len(self.knots))])
        if self.repeats:
            hats[0] += hats[-1]
            return hats[:-1]
        return hats

    def term(self, values: Sequence[float] | np.ndarray) -> dict[str, Any]:
        """Return the curve with its values as a term of `effects.learned`.

        Args:
            values: Free values [N m], shape (size,).
        """
        told = [float(value) for value in values]
        term: dict[str, Any] = {"over": self.over, "of": self.of, "times": self.times}
        term["knots"] = list(self.knots)
        term["values"] = [*told, told[0]] if self.repeats else told
        term["scale"] = self.scale
        return term


class Courses:
    """The motions of a recording, and what the drives show of a torque on the rotors."""

    def __init__(self, replay: Replay, inside: np.ndarray) -> None:
        """Prepare the motions.

        Args:
            replay: The recording and the model.
            inside: Samples that are used, shape (samples, n_axes).
        """
        self.replay, self.inside = replay, inside
        recording, robot = replay.recording, replay.robot
        step = float(robot.model.opt.timestep)
        self.courses: list[Course] = []
        """Motion of each separate recording."""
        self._rows: list[np.ndarray] = []
        self._known: dict[tuple[str, int, float], np.ndarray] = {}  # curves share variables
        for part, rotors in zip(recording.parts, replay.rotors, strict=True):
            times = np.arange(part.stop - part.start) * recording.sample_period
            temperature = None
            if recording.temperature is not None:
                temperature = times, recording.temperature[part]
            self.courses.append(Course(robot, rotors, step, temperature, partial(loads, robot)))
            self._rows.append(np.minimum(np.round(times / step).astype(int), len(rotors) - 1))

    def variable(self, curve: Curve) -> np.ndarray:
        """Compute the variable of a curve at the samples of the recording.

        Args:
            curve: The curve.

        Returns:
            Shape (samples,), in the unit of the variable.
        """
        key = curve.over, curve.of, curve.scale
        if key not in self._known:
            told = [
                course.variable(*key)[rows]
                for course, rows in zip(self.courses, self._rows, strict=True)
            ]
            self._known[key] = np.concatenate(told)
        return self._known[key]

    def factor(self, curve: Curve) -> np.ndarray:
        """Compute the factor of a curve at the samples of the recording.

        Args:
            curve: The curve.

        Returns:
            Shape (samples,).
        """
        key = f"times {curve.times}", curve.of, 1.0
        if key not in self._known:
            told = [
                course.factor(curve.times, curve.of)[rows]
                for course, rows in zip(self.courses, self._rows, strict=True)
            ]
            self._known[key] = np.concatenate(told)
        return self._known[key]

    @cached_property
    def response(self) -> np.ndarray:
        """What the drives log of a unit pulse of torque that opposes the rotors.

        A random torque on all rotors is simulated once.

        Returns:
            Shape (taps, n_axes), without unit.
        """
        base = self.replay.torque()
        rms = np.sqrt(np.mean(base**2, axis=0)) / np.abs(self.side)
        rng = np.random.default_rng(0)
        push = lfilter([0.3], [1, -0.7], rng.standard_normal(base.shape), axis=0)
        push = push * _PUSH * rms
        shown = (self.replay.torque((), push) - base) / self.side
        taps = np.zeros((_TAPS, len(rms)))
        taps[0] = 1.0
        for axis in range(len(rms)):
            rows, targets = [], []
            for part in self.replay.recording.parts:
                x = -push[part, axis]
                late = [np.concatenate([np.zeros(k), x[: len(x) - k]]) for k in range(_TAPS)]
                use = self.inside[part, axis]
                rows.append(np.stack(late, axis=1)[use])
                targets.append(shown[part, axis][use])
            design = np.concatenate(rows)
            if len(design) > 10 * _TAPS and rms[axis] > 0:
                taps[:, axis], *_ = np.linalg.lstsq(design, np.concatenate(targets), rcond=None)
        return taps

    @property
    def side(self) -> np.ndarray:
        """Torque on the recording's side for one of the motor's, as it is logged.

        Returns:
            Shape (n_axes,), without unit.
        """
        robot = self.replay.robot
        ratio = robot.gear_ratio if self.replay.recording.side == "joint" else 1.0
        return np.asarray(ratio / robot.torque_gain)

    def shown(self, torque: np.ndarray, axis: int) -> np.ndarray:
        """What is logged of a torque that opposes a rotor.

        Args:
            torque: Shape (..., samples), in [N m].
            axis: Axis of the rotor, from 1.

        Returns:
            Same shape, in the unit of the recording's torque.
        """
        out = np.empty_like(torque)
        taps = self.response[:, axis - 1]
        for part in self.replay.recording.parts:
            own = torque[..., part]
            new = taps[0] * own
            for delay, weight in enumerate(taps[1:], start=1):
                new[..., delay:] += weight * own[..., :-delay]
            out[..., part] = new
        return out * self.side[axis - 1]

    def columns(self, curve: Curve, axis: int) -> np.ndarray:
        """What the drive of an axis logs for a value of 1 N m at each knot of a curve.

        Args:
            curve: The curve.
            axis: Axis on which the law acts, from 1.

        Returns:
            Shape (size, samples).
        """
        return self.shown(curve.basis(self.variable(curve)) * self.factor(curve), axis)

    def curves(self, axis: int) -> list[Curve]:
        """List the curves that are considered for an axis, simple ones first."""
        rows = self.inside[:, axis - 1]
        found: list[Curve] = []

        def add(over: str, times: str, counts: Sequence[int], of: int = axis, **more: Any) -> None:
            x = self.variable(Curve(over, of, times, (0.0,), **more))[rows]
            for count in counts:
                knots = _knots(x, count)
                if len(knots) > 1:
                    found.append(Curve(over, of, times, knots, **more))

        add("abs_speed", "direction", (2, 4, 9))
        add("abs_load", "direction", (2, 4, 9))
        for over in ("load", "acceleration", "speed"):
            add(over, "", (2, 5, 9))
        add("push", "direction", (2, 5, 9))
        add("abs_acceleration", "direction", (2, 5))
        for times in ("direction", "", "load"):
            add("joint_angle", times, (4, 12, 24))
        for times in ("direction", "", "load"):
            for part in _TURNS:
                period = 2 * np.pi / part
                knots = np.linspace(0.0, period, (16 if part == 1 else 8) + 1)
                found.append(Curve("motor_turn", axis, times, tuple(knots.tolist()), period))
        if np.ptp(self.variable(Curve("temperature", axis, "", (0.0,)))) > _WARM:
            add("temperature", "direction", (2, 4))
        add("since_rest", "direction", (3, 6))
        for reach in _REACHES:
            found.append(Curve("hysteresis", axis, "", (-1.0, 1.0), reach))
        for time in _LAGS:
            add("speed_lag", "", (2, 5), scale=time)
            add("torque_lag", "", (2,), scale=time)
        for other in range(1, self.replay.robot.n_axes + 1):
            if other != axis and self._moves(other, rows):
                add("speed", "", (2, 5), of=other)
                add("abs_speed", "direction", (2, 4), of=other)
                add("joint_angle", "", (4,), of=other)
        return found

    def _moves(self, axis: int, rows: np.ndarray) -> bool:
        """Whether an axis moves in some samples."""
        angle = self.variable(Curve("joint_angle", axis, "", (0.0,)))[rows]
        return bool(len(angle) and np.ptp(angle) > _MOVES)


def _knots(x: np.ndarray, count: int) -> tuple[float, ...]:
    """Knots with about as many samples between any two of them."""
    if len(x) < 10 * count or not np.ptp(x) > 0:
        return ()
    at = np.quantile(x, np.linspace(0.0, 1.0, count))
    apart = np.ptp(x) / (4 * count)
    kept = [at[0]]
    for value in at[1:]:
        if value - kept[-1] > apart:
            kept.append(value)
    return tuple(float(value) for value in kept)

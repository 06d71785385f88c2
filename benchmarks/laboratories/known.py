"""What the simulator itself knows about a healthy recording: its noise, numbers, and effects.

    known = know(setup, session)
    known.changes[3]        # change of the recorded torque by the effect `known.effects[3]`

The rotors move as they were recorded (a prescribed motion), so that effects add up with any noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from laboratories.dump import effects_of
from laboratories.effects import CATALOGUE, Effect, apply, largest, logged_torque
from laboratories.make import COMMON_SHARE, OWN_SHARE, Session, slow_rows
from laboratories.robots import (
    Plant,
    parameters,
    perturbed,
    rotor_motion,
    sample_times,
    sampled,
    simulate,
)
from laboratories.setup import CURRENT, Setup

_SLIGHT = 0.01  # of parameters: a derivative on both sides
_NEAR = 0.05  # of d', at which the search for a severity ends
_NOT_LINEAR = ("backlash",)  # in its size; of all others the slope at 0 is taken
_SLOPE = 0.1  # of the severities of `dump`
_OFF = 0.1  # of d', beyond which an effect cannot reach it
_REST, _TANH, _SMOOTH = 0.43, 0.07, 0.26
"""Standard deviations of friction at rest in `robots.random_robot`: of its stiffness over the
nominal one, of the speed of the smooth part over the Stribeck velocity, and of its share."""


@dataclass(frozen=True, eq=False)
class Known:
    """The truth about a healthy recording. Torque at the motor [N m], of shape (samples, axes)."""

    parts: list[slice]
    """Samples of each motion."""
    position: np.ndarray
    """Angles of the motors [rad], not rounded to the counts of an encoder."""
    clean: np.ndarray
    """Torque of the robot without noise."""
    base: np.ndarray
    """Torque of a model that differs by a draw of each number, and is linear in all of them."""
    scale: np.ndarray
    """Standard deviation of the noise."""
    numbers: np.ndarray
    """Change by one standard deviation of each number that differs in a healthy robot, shape
    (numbers, samples, axes)."""
    effects: list[Effect]
    """Effects with the severity that has the wanted d'."""
    changes: np.ndarray
    """Change by each, shape (effects, samples, axes)."""
    setup: Setup
    """The laboratory."""

    def white(self, torque: np.ndarray) -> np.ndarray:
        """Divide torques by the true noise, with its colour; shape (..., samples, axes)."""
        out = np.empty(torque.shape, np.float32)
        for place in np.ndindex(torque.shape[:-2]):
            for part in self.parts:
                own = torque[place][part]
                out[place][part] = self.setup.noise.whitened(own, self.scale[part])
        return out


@dataclass(frozen=True, eq=False)
class _Motion:
    """The recorded motion, on which robots are run."""

    setup: Setup
    follow: list[np.ndarray]
    slow: list[np.ndarray]

    def run(self, plant: Plant) -> np.ndarray:
        """Channels of `plant.CHANNELS` at even sample times."""
        out = []
        for motion, follow in enumerate(self.follow):
            points = self.setup.points[motion]
            run = simulate(plant, points, self.slow[motion], follow=follow)
            out.append(sampled(run, sample_times(len(points), self.setup.period)))
        return np.concatenate(out)

    def torque(self, plant: Plant) -> np.ndarray:
        """Motor torque [N m], shape (samples, axes)."""
        return self.setup.gain * self.run(plant)[:, :, 2]


def know(
    setup: Setup, session: Session, effects: Sequence[Effect] | None = None, wanted: float = 20.0
) -> Known:
    """Compute the truth about a healthy recording.

    Args:
        setup: The laboratory.
        session: The day of the recording.
        effects: Effects with their severities; None: those of `dump`, each at the wanted d' of a
            matched filter that knows noise and numbers. What cannot reach it is left out.
        wanted: This d'.

    Returns:
        The truth.
    """
    motion = _recorded(setup, session)
    numbers = _numbers(motion)
    first = _first(motion, numbers, session)
    none = np.zeros((0, *first["clean"].shape))
    lengths = [len(sample_times(len(p), setup.period)) for p in setup.points[: setup.n_measured]]
    ends = np.cumsum([0, *lengths]).tolist()
    parts = [slice(a, b) for a, b in zip(ends, ends[1:], strict=False)]
    known = Known(parts=parts, numbers=numbers, effects=[], changes=none, setup=setup, **first)
    if effects is not None:
        changes = [_change(motion, effect, known.clean) for effect in effects]
        return replace(known, effects=list(effects), changes=np.array(changes))
    return _scaled(known, motion, wanted)


def _recorded(setup: Setup, session: Session) -> _Motion:
    """The motion of a recording."""
    points = setup.points[: setup.n_measured]
    slow = [slow_rows(session, motion) for motion in range(len(points))]
    follow = [rotor_motion(setup.robot, p, row) for p, row in zip(points, slow, strict=True)]
    return _Motion(setup, follow, slow)


def _first(motion: _Motion, numbers: np.ndarray, session: Session) -> dict[str, Any]:
    """Motion and torque of the robot, torque of a model, and the scale of the noise."""
    setup = motion.setup
    run, scales, at = motion.run(setup.robot), [], 0
    for number in range(len(motion.follow)):
        part = run[at : at + len(sample_times(len(setup.points[number]), setup.period))]
        scales.append(setup.noise.scale(part[:, :, 2], part[:, :, 1], number))
        at += len(part)
    clean = setup.gain * run[:, :, 2] + setup.zero
    # its own draw for each recording: as if the model were another one
    seed = int.from_bytes(session.friction.tobytes()[:8], "little")
    draw = np.random.default_rng([setup.lab.seed, seed]).standard_normal(len(numbers))
    return {
        "position": run[:, :, 0],
        "clean": clean,
        "base": clean - np.tensordot(draw, numbers, axes=1),
        "scale": setup.gain * np.concatenate(scales),
    }


def on_another_day(known: Known, session: Session) -> Known:
    """The truth about another healthy recording of the same motions.

    Numbers and effects are those of the first recording: the motion is nearly the same.

    Args:
        known: The truth about the first one.
        session: The day of the other one.
    """
    motion = _recorded(known.setup, session)
    return replace(known, **_first(motion, known.numbers, session))


def _change(motion: _Motion, effect: Effect, clean: np.ndarray) -> np.ndarray:
    """Change of the torque by an effect."""
    setup = motion.setup
    torque = motion.torque(apply(effect, setup.robot, setup.lab.machine))
    return np.asarray(logged_torque([effect], torque, setup.period) + setup.zero - clean)


def _scaled(known: Known, motion: _Motion, wanted: float) -> Known:
    """Find the severity of every effect of the catalogue that has the wanted d'.

    The numbers of the filter are linear. The change by an effect is so as well: otherwise what is
    quadratic in a mass would tell it from the mass of a link.
    """
    numbers = known.white(known.numbers).reshape(len(known.numbers), -1).astype(float)
    inner = np.eye(len(numbers)) + numbers @ numbers.T
    machine = motion.setup.lab.machine

    def distance(change: np.ndarray) -> float:
        x = known.white(change).ravel().astype(float)
        along = numbers @ x
        return float(np.sqrt(max(x @ x - along @ np.linalg.solve(inner, along), 0.0)))

    found, changes = [], []
    for effect in effects_of(motion.setup):
        if effect.name not in CATALOGUE:
            continue
        most = largest(effect.name, effect.axis, machine)
        linear = effect.name not in _NOT_LINEAR
        if linear:  # the slope at 0
            effect = replace(effect, severity=_SLOPE * effect.severity)
        for _ in range(1 if linear else 6):
            change = _change(motion, effect, known.clean)
            reached = distance(change)
            if reached == 0.0 or abs(reached / wanted - 1) < _NEAR:
                break
            factor = float(np.clip(wanted / reached, 0.02, 20))
            if not linear:
                effect = replace(effect, severity=min(effect.severity * factor, most))
        factor = wanted / max(reached, 1e-9)
        severity = effect.severity * factor
        if severity <= most and (linear or abs(factor - 1) < _OFF):
            found.append(replace(effect, severity=severity))
            changes.append(change * factor)
    return replace(known, effects=found, changes=np.array(changes))


def _numbers(motion: _Motion) -> np.ndarray:
    """Change of the torque by a standard deviation of each number of a healthy robot."""
    setup, n = motion.setup, motion.setup.lab.machine.n_axes
    robot, nominal = setup.robot, setup.ideal
    error, repeat = float(setup.lab.factors["model_error"]), float(setup.lab.factors["repeat"])
    base = motion.torque(robot)
    columns = []
    for key in parameters(n):
        size = error * (2 if key[0] in ("STIFF", "DAMP") else 1)
        more, less = (motion.torque(perturbed(robot, {key: s * _SLIGHT})) for s in (1, -1))
        columns.append(size / (2 * _SLIGHT) * (more - less))
    days = []
    for axis in range(n):
        slow = [rows.copy() for rows in motion.slow]
        for rows in slow:
            rows[axis, :3] *= 1 + _SLIGHT
        days.append(repeat / _SLIGHT * (replace(motion, slow=slow).torque(robot) - base))
        speed = float(robot.column("SPEED")[axis])
        for name, usual, std in (
            ("REST", float(nominal.column("REST")[axis]), _REST),
            ("TANH", speed, _TANH),
            ("SMOOTH", 1.0, _SMOOTH),
        ):
            value = float(robot.column(name)[axis])
            step = 0.1 * std * usual
            step *= -1 if value > _SMOOTH and name == "SMOOTH" else 1
            changed = motion.torque(robot.changed(axis + 1, **{name: value + step}))
            columns.append(std * usual / step * (changed - base))
    columns += [OWN_SHARE * day for day in days] + [COMMON_SHARE * sum(days)]
    if setup.lab.factors["torque"] == "current":
        limit = setup.lab.machine.limit
        for one in np.eye(n):
            gain, zero = CURRENT[0] / np.sqrt(3) * one, CURRENT[1] / np.sqrt(3) * limit * one
            columns += [gain * base, np.broadcast_to(zero, base.shape)]
    return np.array(columns)

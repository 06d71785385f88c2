"""Friction that differs from the model's friction law.

Near zero speed and after a reversal, the friction of a real robot departs from LuGre and Stribeck
curves. The terms of this module describe the departure, so that it is not mistaken for an effect.
They are friction torques that depend on the recorded motion. Rotors on their measured positions
need just this torque more. Where the rotors follow commands, a simulation applies them, and the
servo reacts to them.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from joblib import delayed

from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.replay.sensitivities import kept_in, kept_runs
from faultgen.discovery.terms.candidates import FORM, Term
from faultgen.robot import COULOMB, STICTION, STRIBECK_VELOCITY, Robot

# Other exponents of the Stribeck curve than 2, as in the literature (Bittencourt et al.: 1.3);
# severity is a share of its height.
_EXPONENTS = ((1.2, 0.6), (2.8, 0.6))
# Departures near zero speed: widths in Stribeck velocities, as shares of Coulomb friction.
_SPEEDS = ((0.1, 0.3), (0.3, 0.2))
# Departures after a reversal, where the bristles turn over: lengths [rad, motor], likewise.
_ANGLES = ((0.01, 1.0), (0.03, 1.0), (0.1, 1.0), (0.3, 0.3))
_STEP = 0.1  # share of a shape that is put in
_PRIOR_STDS = tuple(size for _, size in (*_EXPONENTS, *_SPEEDS, *_ANGLES))  # assumed


def discrepancy_terms(robot: Robot) -> list[Term]:
    """List the terms for the departures of each axis' friction from the law."""
    return [
        Term(FORM, axis, 1.0, prior_std, (("shape", float(k)),))
        for axis in range(1, robot.n_axes + 1)
        for k, prior_std in enumerate(_PRIOR_STDS)
    ]


def discrepancy_sensitivities(
    replay: Replay,
    terms: list[Term],
    base: np.ndarray,
    *,
    workers: int = 1,
    cache: Path | None = None,
) -> np.ndarray:
    """Compute the torque that one unit of each term causes.

    Where the rotors follow commands, it is simulated in closed loop. All axes are disturbed at once
    then, and the effect of one axis on the others is ignored.

    Args:
        replay: The recording and the model.
        terms: Terms of `discrepancy_terms`.
        base: Torque of the unchanged model, shape (samples, n_axes).
        workers: Number of processes. It has no effect on the result.
        cache: Folder in which results are kept for the next recording of the same program.

    Returns:
        Shape (terms, samples, n_axes), in the unit of the recording's torque per unit of the term.
    """
    pushes = [-_STEP * shape for shape in shapes_of(replay)]
    if replay.measured:  # nothing moves
        runs = [replay.torque((), push) for push in pushes]
    else:
        runs = kept_runs(
            [kept_in(cache, replay, push.tobytes()) for push in pushes],
            [delayed(replay.torque)((), push) for push in pushes],
            workers,
        )
    out = np.zeros((len(terms), *base.shape), np.float32)
    for index, term in enumerate(terms):
        axis = term.axis - 1
        run = runs[int(dict(term.parameters)["shape"])]
        out[index, :, axis] = (run - base)[:, axis] / _STEP
    return out


def shapes_of(replay: Replay) -> np.ndarray:
    """Compute the friction torque on the rotors for each shape.

    Args:
        replay: The recording and the model.

    Returns:
        Shape (shapes, samples, n_axes), in [N m]; positive with forward motion.
    """
    recording, robot = replay.recording, replay.robot
    motor = robot.gearing.outputs(replay.wanted) * robot.gear_ratio
    friction = robot.model.actuator_biasprm[robot.ids("actuator", "friction")]
    coulomb = friction[:, COULOMB]
    height = friction[:, STICTION] - coulomb
    shapes = np.empty((len(_PRIOR_STDS), *motor.shape))
    for part in recording.parts:
        velocity = np.gradient(motor[part], recording.sample_period, axis=0)
        slow = np.abs(velocity) / friction[:, STRIBECK_VELOCITY]
        still = 0.01 * friction[:, STRIBECK_VELOCITY]
        direction, since = _since_reversal(motor[part], velocity, still)
        curve = np.exp(-(slow**2))
        made = [height * (np.exp(-(slow**exponent)) - curve) for exponent, _ in _EXPONENTS]
        made += [coulomb * np.exp(-((slow / width) ** 2)) for width, _ in _SPEEDS]
        made += [coulomb * np.exp(-since / length) for length, _ in _ANGLES]
        shapes[:, part] = direction * np.stack(made)
    return shapes


def _since_reversal(
    motor: np.ndarray, velocity: np.ndarray, still: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Last direction of motion, and angle turned since it changed; shape (samples, n_axes) each."""
    direction = np.where(np.abs(velocity) > still, np.sign(velocity), 0.0)
    since = np.zeros_like(motor)
    for axis in range(motor.shape[1]):
        moving = direction[:, axis] != 0
        # at rest the direction is the last one
        last = np.maximum.accumulate(np.where(moving, np.arange(len(motor)), 0))
        direction[:, axis] = direction[last, axis]
        changed = np.flatnonzero(np.diff(direction[:, axis], prepend=direction[0, axis]))
        starts = np.zeros(len(motor), int)
        starts[changed] = changed
        starts = np.maximum.accumulate(starts)
        since[:, axis] = np.abs(motor[:, axis] - motor[starts, axis])
    return direction, since

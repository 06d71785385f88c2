"""Forms that the friction of a real drive may have beside those of the model's law.

They span laws that depend on speed and on the angle since the last reversal: elastic bristles of
several lengths (Dahl 1968), falls from static to Coulomb friction over several speeds, and growth
with speed. A law of any usual form is close to a sum of them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import make_interp_spline

from faultgen.discovery.replay.formulas import Formulas
from faultgen.robot import BRISTLE_STIFFNESS, COULOMB, STRIBECK_VELOCITY

LENGTHS = (0.2, 0.5, 1.0, 2.0, 5.0, 20.0)
"""Lengths of bristles, over that of the model."""

USUAL = LENGTHS.index(1.0)
"""Form that is the deflection of the model's own bristles, from -1 to 1."""

FALLS = (0.25, 0.5, 1.0, 2.0, 4.0)
"""Speeds over which friction falls exponentially, over the model's Stribeck velocity."""

WIDTHS = (0.1, 0.3, 1.0)
"""Speeds over which friction without bristles turns its sign, over the Stribeck velocity."""

COUNT = len(LENGTHS) + len(FALLS) + 2 + len(WIDTHS) + 3
"""Number of forms."""

FALLING = slice(len(LENGTHS), len(LENGTHS) + len(FALLS) + 2)
"""Forms that are shares of the fall from static to Coulomb friction; the others are shares of
Coulomb friction."""


def without_level(forms: np.ndarray) -> np.ndarray:
    """Take from forms what a change of Coulomb or viscous friction alone would be.

    Args:
        forms: As from `friction_forms`.

    Returns:
        Shape (fewer forms, samples, n_axes): the other elastic and smooth reversals less the
        model's, the falls, and the curvature over speed.
    """
    elastic, falls = forms[: len(LENGTHS)], forms[FALLING]
    smooth, (linear, square, _) = forms[FALLING.stop : -3], forms[-3:]
    usual = elastic[USUAL]
    others = [one - usual for one in (*elastic, *smooth) if one is not usual]
    others = [one for one in others if one.any()]
    return np.array([*others, *falls, square - linear])


_FINER = 8  # steps in a sample in which bristles are integrated


def forms_of(formulas: Formulas) -> np.ndarray:
    """Compute the forms on the motion of a model.

    Args:
        formulas: The model, with its rotors on their measured positions.

    Returns:
        Shape (`COUNT`, samples, n_axes), as from `friction_forms`.
    """
    robot, motion = formulas.robot, formulas.motion
    rows = robot.ids("actuator", "friction")
    friction = robot.model.actuator_biasprm[rows]
    length = friction[:, COULOMB] / robot.model.actuator_dynprm[rows, BRISTLE_STIFFNESS]
    return friction_forms(
        motion.angle,
        motion.speed,
        formulas.replay.recording.parts,
        length,
        friction[:, STRIBECK_VELOCITY],
    )


def friction_forms(
    angle: np.ndarray,
    speed: np.ndarray,
    parts: Sequence[slice],
    length: np.ndarray,
    width: np.ndarray,
) -> np.ndarray:
    """Compute the forms on a motion.

    Args:
        angle: Of the motors, shape (samples, n_axes), in [rad].
        speed: Of the motors, same shape, in [rad/s].
        parts: Samples of each separate recording.
        length: Of the bristles of the model: Coulomb friction over their stiffness, shape
            (n_axes,), in [rad].
        width: Stribeck velocity of the model, shape (n_axes,), in [rad/s].

    Returns:
        Shape (`COUNT`, samples, n_axes), without unit; some 1 in fast forward motion, or where
        friction is largest.
    """
    lengths = np.array(LENGTHS)[:, None] * length
    bristles = np.zeros((len(LENGTHS), *angle.shape))
    for part in parts:
        bristles[:, part] = _bristles(angle[part], lengths)
    slow = np.abs(speed) / width
    usual, short = bristles[USUAL], bristles[0]
    made = [*bristles]
    made += [usual * np.exp(-slow / fall) for fall in FALLS]
    made += [short * np.exp(-slow / 0.5), usual * np.exp(-(slow**2))]
    made += [np.tanh(speed / (share * width)) for share in WIDTHS]
    fast = np.maximum(np.abs(speed).max(axis=0), 1e-300)
    made += [usual * np.abs(speed) / fast, usual * (speed / fast) ** 2, speed / fast]
    return np.array(made)


def _bristles(angle: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """Deflection of bristles along a motion, shape (lengths, samples, n_axes), from -1 to 1.

    In one direction it is known exactly, z = s + (z_0 - s) exp(-x / length) after a way x with the
    sign s (Dahl 1968), so that only the reversals are followed in turn.
    """
    count, n_axes = angle.shape
    finer = np.linspace(0, count - 1, _FINER * (count - 1) + 1)
    way = make_interp_spline(np.arange(count), angle)(finer)
    out = np.zeros((len(lengths), count, n_axes))
    for axis in range(n_axes):
        x, length = way[:, axis], lengths[:, axis, None]
        sign = np.sign(np.diff(x))
        moves = np.flatnonzero(sign)
        if not len(moves):  # it rests all the time
            continue
        turns = moves[1:][sign[moves[1:]] != sign[moves[:-1]]]
        state = np.zeros((len(lengths), 1))
        starts = [*moves[:1].tolist(), *turns.tolist()]
        for start, stop in zip(starts, [*starts[1:], len(x) - 1], strict=True):
            side = sign[start]
            samples = np.arange(start // _FINER + 1, stop // _FINER + 1)
            gone = np.abs(x[np.append(samples * _FINER, stop)] - x[start])
            after = side + (state - side) * np.exp(-gone / length)
            out[:, samples, axis] = after[:, :-1]
            state = after[:, -1:]
    return out

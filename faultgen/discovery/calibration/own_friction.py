"""Friction of a robot whose model has none, or has that of another robot.

Friction is what models know least: data sheets do not state it, and robots of one type differ. A
model that was built from a plain arm has assumed friction. An effect that is a change of friction
then has a wrong size, and the usual differences between two recordings look large. Discovery
therefore identifies the friction of such axes before it compares anything.

    robot, lines = with_own_friction(healthy, robot, healthy=True)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from faultgen.discovery.laws.friction_law import with_friction_law
from faultgen.discovery.rigid.drives import GAIN, NAMES, Drives, built
from faultgen.discovery.rigid.physical import Physical, Spread, fit
from faultgen.discovery.rigid.regression import Regression, possible_regression
from faultgen.discovery.terms.candidates import INERTIA
from faultgen.recordings.checks import without_friction
from faultgen.recordings.recording import Recording
from faultgen.robot import Robot

_FACTOR = 2.0  # ratio of friction from which the model is that of another robot: assumed
_ONE_WAY = 0.8  # mean direction of a motion above which friction looks like a constant torque


def with_own_friction(
    recording: Recording, robot: Robot, *, healthy: bool
) -> tuple[Robot, list[str]]:
    """Identify the friction of axes whose model has none. Nothing else is changed.

    If the recording is known to be healthy, the friction of an axis is also replaced if it differs
    from the identified one by more than a factor of two. Otherwise this may be the fault.

    Args:
        recording: A recording of the robot.
        robot: The model.
        healthy: Whether the recording is from before the change.

    Returns:
        The model with this friction, and one line for each axis whose friction was replaced. The
        given robot if there is nothing to change.
    """
    lacking = without_friction(robot)
    if recording.link or not (healthy or lacking.any()):  # behind the gearbox nobody sees friction
        return robot, []
    lawful = with_friction_law(robot, recording)
    regression = possible_regression(recording, lawful)
    numbers = range(len(regression.parts))
    fitted = _fitted(regression, numbers)
    ratio = _ratio(regression, fitted)
    own = lacking.copy()
    if healthy:
        halves = [_ratio(regression, _fitted(regression, numbers[k::2])) for k in (0, 1)]
        ratios = np.array([ratio, *halves])
        far = (ratios > _FACTOR).all(axis=0) | (ratios < 1 / _FACTOR).all(axis=0)
        own |= far & _moves_both_ways(regression)
    if not own.any():
        return robot, []
    before, after = Drives.of(lawful).named(), fitted.drives.named()
    drives = replace(
        Drives.of(lawful),
        coulomb=np.where(own, after["Coulomb"], before["Coulomb"]),
        viscous=np.where(own, after["viscous"], before["viscous"]),
        rise=np.where(own, fitted.drives.rise, Drives.of(lawful).rise),
    )
    made = built(lawful, drives)
    lines = [
        f"axis {axis + 1}: friction in the healthy recording is {_rounded(ratio[axis])} times that "
        "of the model and is used instead; severities are relative to it"
        for axis in np.flatnonzero(own & ~lacking).tolist()
    ]
    return made, lines


def _fitted(regression: Regression, numbers: Sequence[int]) -> Physical:
    """Friction and offsets identified from some blocks; all else as in the model."""
    spread = Spread(1.0, exclude=(INERTIA, GAIN, NAMES["rotor inertia"]), far=True)
    return fit(regression, regression.products.only(numbers), spread)


def _ratio(regression: Regression, fitted: Physical) -> np.ndarray:
    """RMS friction torque on the recorded motion over that of the model, shape (n_axes,)."""
    columns = np.stack([regression.drive(name) for name in ("Coulomb", "viscous")], axis=1)
    gram = regression.products.gram.sum(axis=0)

    def size(drives: Drives) -> np.ndarray:
        values = np.stack([drives.coulomb, drives.viscous], axis=1)
        squares = [
            value @ gram[axis][np.ix_(at, at)] @ value
            for axis, (at, value) in enumerate(zip(columns, values, strict=True))
        ]
        return np.sqrt(np.maximum(squares, 0.0))

    return np.asarray(size(fitted.drives) / np.maximum(size(Drives.of(fitted.given)), 1e-300))


def _moves_both_ways(regression: Regression) -> np.ndarray:
    """Axes whose motion can distinguish friction from a constant torque, shape (n_axes,)."""
    gram = regression.products.gram.sum(axis=0)
    coulomb, offset = regression.drive("Coulomb"), regression.drive("offset")
    axes = np.arange(len(coulomb))
    both = gram[axes, coulomb, coulomb] * gram[axes, offset, offset]
    mean = np.abs(gram[axes, coulomb, offset]) / np.sqrt(np.maximum(both, 1e-300))
    return np.asarray((both > 0) & (mean < _ONE_WAY))


def _rounded(value: float) -> str:
    """A number with two digits and without an exponent: 120 and not 1.2e+02."""
    return f"{float(f'{value:.2g}'):g}"

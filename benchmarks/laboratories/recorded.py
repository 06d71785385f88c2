"""A healthy recording as discovery and as the simulator see it, and how wide its numbers are.

scales = true_scales([number_products(one) for one in recorded])
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from laboratories.files import write_case
from laboratories.known import Known
from laboratories.setup import Setup

from faultgen.discovery.decision.arrays import Arrays, Posed, arrays_of
from faultgen.discovery.decision.numbers import KINDS
from faultgen.discovery.inputs import read_together
from faultgen.discovery.replay.elastic import STIFFNESS
from faultgen.discovery.signatures import for_fitting, signatures
from faultgen.inference.model import Group, Model
from faultgen.inference.products import Products
from faultgen.robot import Robot, load_robot

_DIRECT = ("friction", "rotor inertia", "damping", "stiffness")  # groups whose scales are known
_WIDE = 10.0  # factor by which the scale of another group may differ: the data should tell it


@dataclass(frozen=True, eq=False)
class Recorded:
    """A healthy recording, as discovery and as the simulator see it."""

    known: Known
    """The truth about it."""
    arrays: Arrays
    """As discovery sees it."""
    exact: Arrays
    """As discovery would see it if it knew the positions exactly, on the same samples."""


def as_recorded(
    known: Known, measured: Mapping[str, np.ndarray], robot: str, folder: Path
) -> Recorded:
    """Prepare a healthy recording as discovery does.

    Effects at one place, and waves of orders that a residual shows, are not among the hypotheses,
    because discovery simulates them for each recording.

    Args:
        known: The truth about it.
        measured: Its arrays, from `make.record`.
        robot: From `make.model_for`.
        folder: Where its files are written.
    """
    period = known.setup.period
    moved = {
        "motor_position": known.position,
        "motor_velocity": np.gradient(known.position, period, axis=0),
    }
    files = {"measured": measured, "exact": {**measured, **moved}}
    write_case(folder, robot, period, files, "alone")
    model = load_robot(str((folder / robot).resolve()) if robot.endswith(".xml") else robot)
    arrays, exact = (_arrays(known, model, folder / f"{name}.h5") for name in files)
    return Recorded(known, arrays, replace(exact, inside=arrays.inside))


def _arrays(known: Known, robot: Robot, path: Path) -> Arrays:
    """A recording as discovery sees it."""
    recording = read_together([path], robot).recording
    assert recording.torque.shape == known.clean.shape
    found = signatures(recording, robot)
    assert found.replay.measured, "the truth holds for measured motion"
    posed = Posed(
        found.replay,
        [*found.terms, *found.scanned],
        found.raw,
        found.base,
        recording.torque - found.base,
        for_fitting(recording, robot),
        moved=found.moved,
    )
    return arrays_of(posed)


def true_std(arrays: Arrays, setup: Setup) -> np.ndarray:
    """Standard deviations of discovery's numbers; those of the simulator, where it has the same.

    These are stiffness, damping, rotor inertia, Coulomb and viscous friction.

    Args:
        arrays: As discovery sees a recording.
        setup: The laboratory.

    Returns:
        Shape (numbers,).
    """
    error, repeat = (float(setup.lab.factors[key]) for key in ("model_error", "repeat"))
    numbers = arrays.numbers
    std = np.array(numbers.std)
    for k, (kind, which) in enumerate(zip(numbers.kinds, numbers.which, strict=True)):
        if kind == "friction":
            std[k] = np.hypot(error, repeat)
        elif kind == "rotor inertia":
            std[k] = error
        elif kind == "damping" or (which is not None and which[0] == STIFFNESS):
            std[k] = 2 * error
    return std


def number_products(one: Recorded) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Products of discovery's numbers of known form in units of `true_std`, with true noise.

    Args:
        one: The recording; positions are exact, because their noise is none of the torque's.

    Returns:
        Gram, product with the residual, and the group of each, for `true_scales`.
    """
    arrays, known = one.exact, one.exact.numbers.known
    white = one.known.white(arrays.columns[known]) * arrays.inside
    std = true_std(arrays, one.known.setup)[known]
    x = white.reshape(len(known), -1).astype(float) * std[:, None]
    target = (one.known.white(arrays.residual) * arrays.inside).ravel().astype(float)
    return x @ x.T, x @ target, arrays.numbers.group[known]


def true_scales(recordings: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> np.ndarray:
    """Logarithms of the scales of all groups of discovery's numbers beside `true_std`.

    The scale of a group that the simulator does not have is the one with the largest marginal
    likelihood, as the mean logarithm over the healthy recordings of the laboratory. Torques of no
    known form are not there.

    Args:
        recordings: From `number_products`, of each recording.

    Returns:
        Shape (groups,).
    """
    direct = np.array([name in _DIRECT for name in KINDS])
    groups = tuple(Group(name, _WIDE) for name in KINDS)
    logs = []
    for gram, right, group in recordings:
        known = direct[group]
        order = np.concatenate([np.flatnonzero(~known), np.flatnonzero(known)])
        products = Products(gram, right, 0.0, 0).only(order)  # the energy changes no scale
        ones, free = np.ones(len(right)), group[~known]
        model = Model(products, ones, 0 * ones, free, groups)
        # numbers whose widths are known stand as effects, which have no scale
        logs.append(model.fit(range(int(known.sum()))).log_scales)
    return np.asarray(np.mean(logs, axis=0))

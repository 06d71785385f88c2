"""Calibration of a model that is only roughly known. Use it before `discover` reports an effect.

    calibrated = calibrate(read_recording("measured.h5"), load_robot("model.xml"))
    Path("calibrated.xml").write_text(calibrated.robot.xml)

Two models are made from two thirds of the recording and judged on the rest:

1. Classical identification (`regression`), which needs no simulation and can be none.
2. The *physical* model (`physical`): the same regression, solved for links that can exist.

The physical model is made again from the whole recording. It gets more freedom until no axis is
worse than with classical identification (`freedom`); axes that are still worse get other numbers of
their drive (`weak_axes`). Cross-validation chooses how wide the priors are: parts of the recording
are left out of the fit, and the prior scale that predicts them best is used.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from faultgen.discovery.calibration.freedom import physical_model, spreads
from faultgen.discovery.calibration.held_out import HeldOut, judging
from faultgen.discovery.calibration.ranges import unphysical
from faultgen.discovery.calibration.result import (
    Calibrated,
    at_bound,
    per_axis,
    severities,
    weaknesses,
)
from faultgen.discovery.calibration.weak_axes import repaired, weak_axes, with_choices
from faultgen.discovery.laws.friction_law import with_friction_law
from faultgen.discovery.replay.own_servo import with_own_servo
from faultgen.discovery.rigid.base_parameters import held_out_error
from faultgen.discovery.rigid.drives import GAIN, Drives
from faultgen.discovery.rigid.physical import fit
from faultgen.discovery.rigid.regression import Coupling, Regression, possible_regression
from faultgen.discovery.terms.candidates import INERTIA, NUMBERS, check_names
from faultgen.effects.coupling import coupled_axes
from faultgen.errors import InputError, SimulationFailed
from faultgen.recordings.recording import Recording
from faultgen.robot import Robot
from faultgen.system.progress import Progress

PRIOR_SCALES = (1.0, 3.0, 10.0, 30.0, 100.0)
"""Prior scales that are tried, as multiples of the default prior standard deviations."""

_DIVERGES = "the fitted model diverges on the recorded motion: the given one is kept"
_REQUIRED = 0.7  # share of the error to which a coupling has to reduce it


def calibrate(
    recording: Recording,
    robot: Robot,
    *,
    prior_scales: Sequence[float] = PRIOR_SCALES,
    exclude: Collection[str] = (),
    known: Collection[str] = (),
    workers: int = 1,
) -> Calibrated:
    """Calibrate a model's friction, rotor and link inertias, offsets and torque constants.

    Args:
        recording: The measured data.
        robot: The model. Its axes may be without friction.
        prior_scales: Prior scales to choose from, as multiples of the default prior standard
            deviations.
        exclude: Numbers that are not changed.
        known: Numbers that keep their default prior standard deviations. Either the masses or the
            torque constants should be known, because motions can hardly distinguish the two.
        workers: Number of processes. It has no effect on the result.

    Returns:
        The calibrated model, and how well it predicts the parts that were left out.

    Raises:
        InputError: Too little of the recording can be used, or a name is not known.
        SimulationFailed: The model diverges on the recorded motion.
    """
    check_names("known", known, NUMBERS)
    check_names("exclude", exclude, NUMBERS)
    if recording.link:  # the drive's log is not compared
        exclude = {*exclude, GAIN}
    lawful = with_friction_law(robot, recording)
    own, servo = with_own_servo(recording, lawful)

    found = _calibrated(recording, (robot, lawful, own), prior_scales, exclude, known, workers)
    return replace(found, lacks=(servo, *found.lacks)) if servo else found


def _calibrated(
    recording: Recording,
    models: tuple[Robot, Robot, Robot],
    prior_scales: Sequence[float],
    exclude: Collection[str],
    known: Collection[str],
    workers: int,
) -> Calibrated:
    """Calibrate a model whose servo is chosen.

    The `models` are the given one, the same with the friction that it lacks, and that with the
    servo with which it is simulated. The other arguments are those of `calibrate`.
    """
    given, lawful, robot = models
    # torque of the model's motors, from which the recording differs by the given torque_gain
    modelled = replace(recording, torque=recording.torque * robot.torque_gain)
    regression = _regression(modelled, robot, exclude)
    held_out = HeldOut(recording, regression)
    if not held_out.is_possible:
        raise InputError(f"{recording.source}: too little of it moves to fit and judge a model")
    of_given = held_out.torque_of(lawful)
    errors = {"classical": held_out.classical, "given": held_out.error(of_given)}
    before = errors["given"] if robot is lawful else held_out.error_of(robot)
    with Progress("fitting the physical model", None):
        told = spreads(regression, held_out.fitting, prior_scales, known, exclude, workers)
        spread, physical, torque = physical_model(held_out, told)
    errors["physical"] = held_out.error(torque)
    if not np.isfinite(before) and not np.isfinite(errors["physical"]):
        raise SimulationFailed("the model diverges on the recorded motion")
    lacks: tuple[str, ...] = ()
    if not np.isfinite(errors["physical"]):
        physical, torque = robot, held_out.torque_of(robot)
        lacks = (_DIVERGES,)
    weak = weak_axes(held_out, torque, of_given)
    made = physical if lacks else fit(regression, regression.products, spread).robot
    if not np.isfinite(held_out.error_of(made)):
        made = physical
    torque, choices = repaired(held_out, torque, physical, lawful, weak)
    made = with_choices(held_out, made, lawful, choices)
    errors["calibrated"] = held_out.error(torque)
    compared = held_out.against_classical(torque)
    axes = per_axis(compared, held_out.against(of_given, of_given).error, choices)
    return Calibrated(
        robot=made,
        errors=errors,
        prior_scale=spread.scale,
        values=severities(given, made),
        parameters={
            name.replace(" ", "_").lower(): values.tolist()
            for name, values in Drives.of(made).named().items()
        },
        couplings=regression.couplings,
        lacks=lacks,
        findings=(
            *(() if INERTIA in spread.exclude else at_bound(spread.scale, prior_scales)),
            *unphysical(given, made),
            *weaknesses(axes, weak, compared.worse),
        ),
        per_axis=axes,
    )


def _regression(recording: Recording, robot: Robot, exclude: Collection[str]) -> Regression:
    """The regression, with the couplings of neighbouring axes that the recording requires.

    They are judged by blocks that were not fitted, so that a coupling that is not there is not
    found.
    """
    regression = possible_regression(recording, robot)
    fitting = [k for k in range(len(regression.parts)) if k not in judging(len(regression.parts))]
    if len(fitting) < 2 or "coulomb_friction" in exclude:
        return regression
    error = held_out_error(regression.products.only(fitting))
    for axis in coupled_axes(robot.n_axes):
        for ratio in (1.0, -1.0):
            couplings = (*regression.couplings, Coupling(axis, ratio))
            other = Regression(recording, robot, couplings=couplings, scaled=regression.scaled)
            new = held_out_error(other.products.only(fitting))
            if new < _REQUIRED * error:
                regression, error = other, new
                break
    return regression

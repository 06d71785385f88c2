"""Calibration of a model that is only roughly known. Use it before `discover` reports an effect.

    calibrated = calibrate(read_recording("measured.h5"), load_robot("model.xml"))
    Path("calibrated.xml").write_text(calibrated.robot.xml)

Three models are made from two thirds of the recording and judged on the rest:

1. Classical identification (`classical`), which needs no simulation.
2. The *physical* model (`physical`): the same regression, solved for links that can exist.
3. The *simulated* fit: it starts from the physical model, or from the given one if that predicts
   better, and changes the model's own numbers (`candidates.NUMBERS`) until its simulation in closed
   loop is as close to the recording as their priors allow.

The better of the last two is made again from the whole recording: the one that is worse than
classical identification on fewer axes (`compared`), and then the one with the smaller error. Axes
on which it is worse still get other numbers of their drive (`weak_axes`). Cross-validation chooses
how wide the priors are: parts of the recording are left out of the fit, and the prior scale that
predicts them best is used.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from faultgen.discovery.calibration.freedom import physical_model, rank, spreads
from faultgen.discovery.calibration.held_out import HeldOut, judging
from faultgen.discovery.calibration.ranges import unphysical
from faultgen.discovery.calibration.result import (
    Calibrated,
    at_bound,
    per_axis,
    severities,
    weaknesses,
)
from faultgen.discovery.calibration.simulated_fit import SimulatedFit
from faultgen.discovery.calibration.weak_axes import repaired, weak_axes, with_choices
from faultgen.discovery.laws.friction_law import with_friction_law
from faultgen.discovery.replay.own_servo import with_own_servo
from faultgen.discovery.rigid.classical import (
    Coupling,
    Regression,
    held_out_error,
    possible_regression,
)
from faultgen.discovery.rigid.drives import GAIN, Drives
from faultgen.discovery.rigid.physical import fit
from faultgen.discovery.terms.candidates import NUMBERS, check_names
from faultgen.effects.coupling import coupled_axes
from faultgen.errors import InputError, SimulationFailed
from faultgen.recordings.recording import Recording
from faultgen.robot import Robot
from faultgen.system.progress import Progress

PRIOR_SCALES = (1.0, 3.0, 10.0, 30.0, 100.0)
"""Prior scales that are tried, as multiples of the default prior standard deviations."""

_WHY = "with more of them its simulation diverges on the recorded motion"
_REQUIRED = 0.7  # share of the error to which a coupling has to reduce it


def calibrate(
    recording: Recording,
    robot: Robot,
    *,
    prior_scales: Sequence[float] = PRIOR_SCALES,
    exclude: Collection[str] = (),
    known: Collection[str] = (),
    workers: int = 1,
    cache: Path | None = None,
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
        cache: Folder in which sensitivities are kept.

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

    def made(model: Robot) -> Calibrated:
        return _calibrated(
            recording, (robot, lawful, model), prior_scales, exclude, known, workers, cache
        )

    found = made(own)
    if not servo:
        return found
    if found.method == "physical":  # simulated with this servo, the model is worse than a rigid arm
        other = made(lawful)
        if other.errors["calibrated"] < found.errors["calibrated"]:
            return other
    return replace(found, lacks=(servo, *found.lacks))


def _calibrated(
    recording: Recording,
    models: tuple[Robot, Robot, Robot],
    prior_scales: Sequence[float],
    exclude: Collection[str],
    known: Collection[str],
    workers: int,
    cache: Path | None,
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
        told = spreads(regression, held_out.fitting, prior_scales, known, exclude)
        spread, physical, torque = physical_model(held_out, told)
    torques = {"physical": torque}
    errors["physical"] = held_out.error(torque)
    if not np.isfinite(before) and not np.isfinite(errors["physical"]):
        raise SimulationFailed("the model diverges on the recorded motion")
    lacks: list[str] = []
    simulated = None
    try:
        simulated = SimulatedFit(
            recording,
            robot if before <= errors["physical"] else physical,
            held_out.scoring,
            prior_scales,
            spread.exclude,
            known,
            workers,
            cache,
        )
        torques["simulated"] = simulated.predicted()
        errors["simulated"] = held_out.error(torques["simulated"])
    except (InputError, SimulationFailed) as error:
        if not np.isfinite(errors["physical"]):
            raise
        errors["simulated"] = np.inf
        lacks.append(f"the fit of the simulation failed: {error}")
    best = min(reversed(torques), key=lambda name: rank(held_out, torques[name]))
    weak = weak_axes(held_out, torques[best], of_given)
    if simulated is not None and best == "simulated":
        tried = simulated.start
        made, share = simulated.model()
        if share < 1:
            lacks.append(f"the model has {share:.0%} of the fitted values: {_WHY}")
    else:
        tried, made = physical, fit(regression, regression.products, spread).robot
        lacks.append(
            "classical values, turned into links that can exist, predict better than the fit of "
            "the simulation and are used"
        )
        if not np.isfinite(held_out.error_of(made)):
            made = physical
    torque, choices = repaired(held_out, torques[best], tried, lawful, weak)
    made = with_choices(held_out, made, lawful, choices)
    errors["calibrated"] = held_out.error(torque)
    scale = simulated.prior_scale if simulated is not None and best == "simulated" else spread.scale
    compared = held_out.against_classical(torque)
    axes = per_axis(compared, held_out.against(of_given, of_given).error, choices)
    return Calibrated(
        robot=made,
        method=best,
        errors=errors,
        prior_scale=scale,
        held_out={} if simulated is None else simulated.held_out,
        values=severities(given, made),
        parameters={
            name.replace(" ", "_").lower(): values.tolist()
            for name, values in Drives.of(made).named().items()
        },
        couplings=regression.couplings,
        lacks=tuple(lacks),
        findings=(
            *at_bound(scale, prior_scales),
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

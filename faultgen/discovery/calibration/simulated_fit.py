"""Fit of a model's numbers in closed loop, and the model with the fitted changes.

fitted = SimulatedFit(recording, start, judged_blocks, scales=[1.0, 10.0])
robot, share = fitted.model()

The model's own numbers (`candidates.NUMBERS`) get the same columns as in discovery, and wider
priors. Cross-validation chooses the prior scale.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from faultgen.discovery.calibration.ranges import severities
from faultgen.discovery.fit.bounded import bounded_minimum
from faultgen.discovery.fit.evidence import FREE, Evidence
from faultgen.discovery.fit.regression import Problem, plain, pose, with_priors
from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.replay.sensitivities import sensitivities
from faultgen.discovery.rigid.drives import GAIN, edited
from faultgen.discovery.terms.candidates import (
    INERTIA,
    NUMBERS,
    Term,
    applied,
    effect_terms,
    with_model_scale,
)
from faultgen.discovery.terms.inertia import apply_inertia, inertia_terms
from faultgen.effects import get_effect
from faultgen.errors import InputError, SimulationFailed
from faultgen.recordings.recording import Recording
from faultgen.robot import Robot

SHARES = (1.0, 0.5, 0.25, 0.1)
"""Shares of the changes that are tried in turn if a model with all of them cannot be simulated."""

_STEPS = 16  # simulations of a fit at most, those for slopes not counted
_SETTLED = 1e-3  # share of the misfit that a step has to take off
_ANEW = 12  # terms whose slopes are taken anew at each step


class SimulatedFit:
    """The fit of the numbers of a model in closed loop."""

    def __init__(
        self,
        recording: Recording,
        start: Robot,
        scoring: list[int],
        prior_scales: Sequence[float],
        exclude: Collection[str],
        known: Collection[str],
        workers: int,
        cache: Path | None,
    ) -> None:
        """Simulate the model with each change, and choose the prior scale.

        Args:
            recording: The measured data.
            start: The model from which the fit starts.
            scoring: Blocks that are not fitted.
            prior_scales: Prior scales to choose from.
            exclude: Numbers that are not changed.
            known: Numbers that keep their default prior standard deviations.
            workers: Number of processes.
            cache: Folder in which sensitivities are kept.

        Raises:
            InputError: Too little of the recording can be used.
            SimulationFailed: The model diverges on the recorded motion.
        """
        self.recording = recording
        self.start = start
        replay = Replay(self.recording, start)
        terms = [t for t in effect_terms(start, exclude) if t.name in NUMBERS]
        terms += inertia_terms(start) if INERTIA not in exclude else []
        base, raw = sensitivities(replay, terms, workers=workers, cache=cache)
        residual = self.recording.torque - base
        try:
            problem = pose(
                replay,
                with_model_scale(terms, max(prior_scales), known),
                base,
                raw,
                residual,
                baseline=False,
            )
        except ValueError as error:
            raise InputError(f"{recording.source}: {error}") from None
        problem = replace(problem, scoring=scoring)
        count = max(int(problem.inside.sum()), 1)
        self.held_out: dict[float, float] = {}
        """Mean squared whitened error of blocks that were not fitted, by prior scale."""
        for scale in prior_scales:
            posed = with_priors(problem, with_model_scale(terms, scale, known))
            self.held_out[scale] = float(posed.evidence().held_out([]).sum()) / count
        self.prior_scale = min(self.held_out, key=lambda scale: self.held_out[scale])
        """The scale with the smallest error."""
        self.problem = with_priors(problem, with_model_scale(terms, self.prior_scale, known))

    def predicted(self) -> np.ndarray:
        """Torque with values that were fitted to the other parts, to first order.

        Returns:
            In the unit of the recording, shape (samples, n_axes).
        """
        problem = plain(self.problem)
        value, _, _ = problem.evidence().solve()
        scaled = value * np.array([t.prior_std for t in problem.terms])
        torque = problem.base + np.tensordot(scaled, problem.raw.astype(float), axes=1)
        return np.asarray(torque)

    def model(self) -> tuple[Robot, float]:
        """The model fitted to the whole recording, and the share of the changes that it has."""
        changes = refined(plain(replace(self.problem, scoring=[])))
        for share in SHARES:
            part = [(term, share * value) for term, value in changes]
            made = replaying(self.recording, self.start, part)
            if made is not None:
                return made, share
        return self.start, 0.0


def refined(problem: Problem, start: Sequence[tuple[Term, float]] = ()) -> list[tuple[Term, float]]:
    """Fit all terms together by the method of Levenberg and Marquardt, with new simulations.

    The slopes are those of the unchanged model. Only the terms that have moved furthest from it get
    new slopes.

    Args:
        problem: The residual and the terms.
        start: Effects without a prior, and the values from which they start. All other terms have
            their priors.

    Returns:
        Terms and values with the smallest misfit. Terms of `friction_discrepancy` are not included.
    """
    scale = np.array([term.prior_std for term in problem.terms])
    weight, value = np.ones(len(scale)), np.zeros(len(scale))
    form = np.array([not (t.is_effect or t.name == INERTIA) for t in problem.terms])
    low, high = np.array([severities(t) for t in problem.terms]).T / scale
    at = {(t.key, t.parameters): index for index, t in enumerate(problem.terms)}
    for term, severity in start:
        index = at[term.key, term.parameters]
        weight[index], value[index] = FREE, severity / scale[index]
        low[index], high[index] = -np.inf, np.inf

    def simulate(value: np.ndarray) -> np.ndarray | None:
        """Torque of all terms; forms of friction are not simulated."""
        change = problem.change_of_given(_possible(problem, value * scale, form))
        if change is None:
            return None
        return np.asarray(change + np.tensordot(value * scale * form, problem.raw, axes=1))

    best, damping = (np.inf, value), 0.0
    local: Evidence | None = None  # with slopes at the best values
    for _ in range(_STEPS):
        torque = simulate(value)
        misfit = np.inf
        if torque is not None:
            left = problem.evidence(problem.residual - torque)
            misfit = float(left.energy.sum() + (weight * value**2).sum())
        if torque is not None and misfit < best[0]:
            done = misfit > (1 - _SETTLED) * best[0]
            best, damping = (misfit, value), damping / 10
            if done:
                break
            far = [k for k in np.argsort(-np.abs(value * ~form))[:_ANEW] if abs(value[k]) >= 0.5]
            slopes = differences(simulate, value, torque, {int(k): -0.05 * value[k] for k in far})
            by_unit = {k: slope / scale[k] for k, slope in slopes.items()}
            local = problem.evidence(problem.residual - torque, by_unit)
        else:
            damping = max(10 * damping, 0.1)
        if local is None:
            break
        value = step_of(local, weight, best[1], damping, (low, high))
    return _possible(problem, best[1] * scale, form)


def step_of(
    evidence: Evidence,
    weight: np.ndarray,
    value: np.ndarray,
    damping: float,
    bounds: tuple[np.ndarray, np.ndarray],
) -> np.ndarray:
    """Take a step of Levenberg and Marquardt with values whose prior has mean zero.

    Args:
        evidence: Inner products with the residual that the values leave.
        weight: Weight of the square of each value, shape (terms,).
        value: The values, in prior standard deviations, shape (terms,).
        damping: Share by which the diagonal is raised.
        bounds: Lower and upper bounds of the values, shape (terms,) each.

    Returns:
        The new values, shape (terms,).
    """
    precision = evidence.gram.sum(axis=0) + np.diag(weight)
    precision[np.diag_indices_from(precision)] *= 1 + damping
    right = evidence.right.sum(axis=0) - weight * value
    low, high = bounds
    return np.clip(value + bounded_minimum(precision, right, low - value, high - value), low, high)


def _possible(problem: Problem, values: np.ndarray, form: np.ndarray) -> list[tuple[Term, float]]:
    """Changes, limited to the bounds of the effects."""
    changes = []
    for term, value, other in zip(problem.terms, values.tolist(), form, strict=True):
        if other or value == 0:
            continue
        if term.is_effect and not term.parameters:
            effect = get_effect(term.name)
            value = min(max(value, effect.smallest), effect.largest)
        changes.append((term, value))
    return changes


def changed(robot: Robot, changes: Sequence[tuple[Term, float]]) -> Robot:
    """Put changes into a model. A change of the torque constant goes into `torque_gain`.

    Args:
        robot: The model.
        changes: Terms and values. Effects that MJCF cannot express join the robot's `effects`.

    Returns:
        The changed model.

    Raises:
        SimulationFailed: MuJoCo cannot compile the changed model.
    """
    spec = robot.spec()
    apply_inertia(spec, robot, [change for change in changes if change[0].name == INERTIA])
    gain = robot.torque_gain.copy()
    effects = applied(changes)
    for one in sorted(effects, key=lambda one: get_effect(one.effect).last):
        if one.effect == GAIN:
            gain[one.axis - 1] *= 1 - one.severity
        elif get_effect(one.effect).in_mjcf:
            get_effect(one.effect).apply(spec, one.axis, one.severity, **one.parameters)
    beside = [one for one in effects if not (one.effect == GAIN or get_effect(one.effect).in_mjcf)]
    return edited(robot, spec, gain).with_effects(beside)


def replaying(
    recording: Recording, robot: Robot, changes: Sequence[tuple[Term, float]]
) -> Robot | None:
    """Put changes into a model, and check that the written model can move as the robot did.

    Where commanded positions were recorded, the servo of the model has to follow them.

    Args:
        recording: The measured data.
        robot: The model.
        changes: Terms and values.

    Returns:
        The changed model as it is written to a file, or None if it cannot replay the recording.
    """
    try:
        made = changed(robot, changes) if changes else robot
        torque = Replay(recording, made, measured=recording.reference_position is None).torque()
    except (InputError, SimulationFailed):
        return None
    return made if np.isfinite(torque).all() else None


def differences(
    simulate: Callable[[np.ndarray], np.ndarray | None],
    value: np.ndarray,
    change: np.ndarray,
    steps: Mapping[int, float],
) -> dict[int, np.ndarray]:
    """Compute slopes of a torque by finite differences, if they can be simulated.

    Args:
        simulate: Function from values to the torque. It returns None if the simulation diverges.
        value: Values at which the slopes are computed, shape (terms,).
        change: Torque at these values, shape (samples, n_axes).
        steps: Step of each value whose slope is wanted, by its index.

    Returns:
        Slopes by index, shape (samples, n_axes) each.
    """
    slopes = {}
    for k, step in steps.items():
        moved = value.copy()
        moved[k] += step
        run = simulate(moved)
        if run is not None:
            slopes[k] = (run - change) / step
    return slopes

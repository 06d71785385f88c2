"""How far the numbers of this robot are from those of its model, learned from the recording itself.

The prior standard deviations of `candidates` say how well a model's numbers are usually known. A
particular model may be much better than that, or worse. All its numbers of one kind show this
together: if the friction of five axes is right to within 0.5 %, then 10 % on the sixth is a change
of the robot and no error of the model.

    scales = learned_scales(problem)     # {"friction": 0.21, ...}
    problem = with_scales(problem, scales)

Each kind has one scale s, by which the prior standard deviations of its terms are multiplied. The
terms have Student's t distribution about zero with this scale, so that a few numbers that are far
off, such as a missing effect, hardly widen it. The scales are found by expectation maximisation
(Dempster, Laird and Rubin 1977; empirical Bayes, Bishop 2006, 3.5).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.linalg import cho_solve

from faultgen.discovery.fit.evidence import factored
from faultgen.discovery.fit.regression import Problem, with_priors
from faultgen.discovery.terms.candidates import FORM, INERTIA

FRICTION, LOW_SPEED = "friction", "friction at low speed"
ZERO, GAIN = "zero of the torque", "gain of the torque"

KINDS = {
    "coulomb_friction": FRICTION,
    "viscous_friction": FRICTION,
    "static_friction": LOW_SPEED,
    "stribeck_velocity": LOW_SPEED,
    FORM: "form of friction",
    "rotor_inertia": "inertia",
    INERTIA: "inertia",
    "payload_mass": "inertia",
    "gear_stiffness": "stiffness",
    "torque_offset": ZERO,
    "torque_constant": GAIN,
}
"""Kinds of numbers that are about equally well known. Each has its own scale: friction may have
been calibrated, and stiffness not. The form of friction may be another one at low speed. A torque
that was computed from a current may be off on all axes."""

_AT_LEAST_USUAL = (ZERO, GAIN)  # few motions show them well, so that small ones prove nothing

_TAILS = 4.0  # degrees of freedom of the t distribution: assumed
_USUAL = 1.0  # numbers of usual size that count beside the robot's own, so that none is exact
_LARGEST = 10.0  # scale beyond which a model has to be calibrated first
_ROUNDS = 60
_DONE = 0.01  # relative change of a scale at which the search ends


def learned_scales(problem: Problem) -> dict[str, float]:
    """Learn how well each kind of numbers is known.

    Args:
        problem: The residual and the terms, with the usual priors.

    Returns:
        Factor of the prior standard deviations by kind, at most 10. All friction has one factor
        if the numbers at low speed are as good as the others: small robots have few numbers.
    """
    apart = _learned(problem, KINDS)
    if LOW_SPEED not in apart or FRICTION not in apart:
        return apart
    pooled = {name: FRICTION if kind == LOW_SPEED else kind for name, kind in KINDS.items()}
    together = _learned(problem, pooled)
    if together[FRICTION] > apart[FRICTION]:
        return apart
    return together | {LOW_SPEED: together[FRICTION]}


def _learned(problem: Problem, kind_of: Mapping[str, str]) -> dict[str, float]:
    """The factors by kind, where each kind has its own."""
    evidence = problem.evidence()
    gram, right = evidence.gram.sum(axis=0), evidence.right.sum(axis=0)
    kinds = [kind_of.get(term.name) for term in problem.terms]
    members = {k: np.array([one == k for one in kinds]) for k in dict.fromkeys(kind_of.values())}
    members = {kind: which for kind, which in members.items() if which.any()}
    variance = np.ones(len(right))
    scales = dict.fromkeys(members, 1.0)
    for _ in range(_ROUNDS):
        precision = gram + np.diag(1 / variance)
        inverse = cho_solve(factored(precision), np.eye(len(right)))
        square = (inverse @ right) ** 2 + np.diag(inverse)
        change = 0.0
        for kind, which in members.items():
            weight = (_TAILS + 1) / (_TAILS + square[which] / scales[kind] ** 2)
            total = float(np.sum(weight * square[which])) + _USUAL
            least = 1.0 if kind in _AT_LEAST_USUAL else 0.0
            new = float(np.clip(np.sqrt(total / (which.sum() + _USUAL)), least, _LARGEST))
            change = max(change, abs(np.log(new / scales[kind])))
            scales[kind] = new
            variance[which] = new**2 / weight
        if change < _DONE:
            break
    return scales


def at_bound(scales: Mapping[str, float]) -> list[str]:
    """Tell which priors are as wide as they may be.

    Args:
        scales: From `learned_scales`.

    Returns:
        One line, or none.
    """
    kinds = [kind for kind, scale in scales.items() if scale >= (1 - _DONE) * _LARGEST]
    if not kinds:
        return []
    return [
        f"{' and '.join(kinds)}: the robot differs from its model by {_LARGEST:g} times as much as "
        "usual or more, so that effects of this kind can hardly be named; calibrate the model on a "
        "healthy recording, or state its numbers"
    ]


def with_scales(problem: Problem, scales: Mapping[str, float]) -> Problem:
    """Return the same problem with scaled prior standard deviations.

    Args:
        problem: The residual and the terms.
        scales: Factor by kind; kinds that are missing keep their prior standard deviations.
    """
    terms = [
        replace(term, prior_std=scales.get(KINDS.get(term.name, ""), 1.0) * term.prior_std)
        for term in problem.terms
    ]
    return with_priors(problem, terms)

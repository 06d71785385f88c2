"""Discovery problems of the small robot whose laws are straight: torque is columns times values."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from faultgen.discovery.regression import pose


def linear(problem, values=(), *, noise=1.0, seed=0, twin=None, terms=None, raw=None):
    """A problem with a gap that is known.

    Args:
        problem: What robot, recording, terms and columns are taken from.
        values: Values of terms by their index.
        noise: Deviation of white noise, over that of the problem's noise.
        seed: Of the noise.
        twin: Whether the gap is to a twin; default: as in the problem.
        terms: Other terms than the problem's.
        raw: Their columns.
    """
    terms = problem.terms if terms is None else terms
    raw = problem.raw if raw is None else raw
    rng = np.random.default_rng(seed)
    size = noise * problem.noise.deviation
    torque = problem.base + size * rng.standard_normal(problem.base.shape)
    residual = torque - problem.base
    for index, value in dict(values).items():
        residual = residual + value * raw[index]

    def simulate(changes=(), disturbance=None):
        total = problem.base.copy()
        for term, value in changes:
            total += value * raw[terms.index(term)]
        return total

    replay = SimpleNamespace(
        measured=problem.replay.measured,
        torque=simulate,
        recording=replace(problem.recording, torque=problem.base + residual),
        robot=problem.robot,
    )
    twin = problem.twin if twin is None else twin
    return pose(replay, terms, problem.base, raw, residual, twin=twin)

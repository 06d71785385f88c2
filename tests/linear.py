"""Discovery problems of the small robot whose laws are straight: torque is columns times values."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from faultgen.discovery.decision.difference import Difference
from faultgen.discovery.decision.hypotheses import Effects
from faultgen.discovery.decision.numbers import Numbers, is_number, kind_of
from faultgen.discovery.fit.fit import fit_at
from faultgen.discovery.fit.problem import Problem, division_of
from faultgen.inference.model import Model
from faultgen.inference.products import Products
from faultgen.recordings.noise import Autoregression
from faultgen.recordings.noise_level import Noise
from faultgen.recordings.recording import Recording


def straight(base, terms, columns):
    """A simulation whose torque is straight in the values, whatever the priors of the terms are."""
    place = {(term.key, term.parameters, term.step): k for k, term in enumerate(terms)}

    def simulate(changes=(), disturbance=None):
        total = base.copy()
        for term, value in changes:
            total += value * columns[place[term.key, term.parameters, term.step]]
        return total

    return simulate


def ridge(problem, free):
    """Values of all terms with their priors, but for those that are free; in their own units."""
    rows = problem.samples(problem.fitting)
    x = problem.whiten(problem.raw.astype(float))[:, rows].reshape(len(problem.terms), -1)
    y = problem.whiten(problem.residual)[rows].ravel()
    weight = np.array([term.prior_std**-2.0 for term in problem.terms])
    weight[list(free)] = 0.0
    precision = x @ x.T + np.diag(weight)
    return np.linalg.solve(precision, x @ y), np.linalg.inv(precision)


def least_squares(problem, groups=()):
    """A set of effects whose severities are those of a regression beside all other terms."""
    terms = [term for group in groups for term in group]
    value, covariance = ridge(problem, terms)
    return fit_at(problem, groups, value[terms], covariance[np.ix_(terms, terms)])


def white_noise(deviation, count):
    """White noise of each axis with a deviation."""
    colour = Autoregression(np.zeros((len(deviation), 0)), np.asarray(deviation, float))
    return Noise(colour, np.ones((count, len(deviation))))


def posed(replay, terms, base, raw, residual, noise, *, baseline):
    """The problem of a recording, divided as discovery does it."""
    division = division_of(replay, baseline=baseline)
    return Problem(
        **vars(division),
        replay=replay,
        commanded=None,
        given=replay,
        terms=list(terms),
        base=base,
        residual=residual,
        raw=raw,
        noise=noise,
        baseline=baseline,
        shared=np.zeros(base.shape[1], bool),
    )


def difference_between(problem, processes=()) -> Difference:
    """The problem as the inference sees it, with the noise of the problem.

    Args:
        problem: The residual and the terms, some of which are numbers of a model.
        processes: Torques of no known form: axis, variable, and torques of shape (torques, samples,
            n_axes). A healthy robot has a thousandth of each.
    """
    numbers = Numbers(problem.baseline)
    for term, column in zip(problem.terms, problem.raw, strict=True):
        if is_number(term) and (*term.key, term.parameters) not in numbers.which:
            numbers.add(column, term.prior_std, kind_of(term), (*term.key, term.parameters))
    for axis, over, torques in processes:
        for torque in torques:
            numbers.add(torque, 1e-3, f"process over {over}", ("process", axis, (over,)))
    effects = Effects(numbers)
    effects.add_catalogue(problem.terms, problem.raw)
    axes = range(1, problem.robot.n_axes + 1)
    effects.add_unknown(axis for axis in axes if axis not in problem.recording.left_out)
    inside = problem.inside & problem.samples(problem.fitting)[:, None]
    columns = np.array([*numbers.columns, *effects.columns], np.float32)
    columns = columns.reshape(-1, *problem.residual.shape)
    white = problem.noise.whiten(columns, problem.parts) * inside
    target = problem.noise.whiten(problem.residual, problem.parts) * inside
    model = Model(
        Products.of(white, target, int(inside.sum())),
        np.array([*numbers.std, *effects.std]),
        np.concatenate([np.zeros(len(numbers.std)), effects.mean]),
        numbers.group,
        numbers.groups,
    )
    others = problem.inside & ~problem.samples(problem.fitting)[:, None]
    held = [problem.noise.whiten(x, problem.parts) * others for x in (columns, problem.residual)]
    return Difference(
        model,
        Products.of(*held, int(others.sum())),
        numbers,
        numbers,
        effects.hypotheses,
        effects.groups,
        effects.over,
        problem.noise,
        inside,
        problem.inside,
        inside.astype(float),
        problem.residual,
        problem.residual,
        problem.parts,
        target,
    )


def linear(problem, values=(), *, noise=1.0, seed=0, baseline=None, terms=None, raw=None):
    """A problem with a gap that is known.

    Args:
        problem: What robot, recording, terms and columns are taken from.
        values: Values of terms by their index.
        noise: Deviation of white noise, over that of the problem's noise.
        seed: Of the noise.
        baseline: Whether the gap is to a baseline; default: as in the problem.
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

    replay = SimpleNamespace(
        measured=problem.replay.measured,
        torque=straight(problem.base, terms, raw),
        recording=replace(problem.recording, torque=problem.base + residual),
        robot=problem.robot,
        left_out=None,
        on=problem.replay.on,
    )
    baseline = problem.baseline if baseline is None else baseline
    white = white_noise(problem.noise.deviation, len(residual))
    return posed(replay, terms, problem.base, raw, residual, white, baseline=baseline)


PARTS = [slice(k, k + 100) for k in range(0, 600, 100)]
"""Motions of a problem that is written down; the last one is kept for scoring."""
COUNT = PARTS[-1].stop


def written_down(terms, columns, residual, *, baseline=False, torque=10.0, period=0.01):
    """A problem in which every number is given, and nothing is simulated.

    The noise is white with deviation 1 N m, so that whitened torques are torques. All axes move at
    the same speed all the time.

    Args:
        terms: What may explain the residual.
        columns: Torque per unit of each term, shape (terms, samples, n_axes).
        residual: Torque that is to be explained, shape (samples, n_axes).
        baseline: Whether the residual is the difference of two recordings.
        torque: Torque of the recording at every sample.
        period: Time between samples [s].
    """
    columns, residual = np.asarray(columns, np.float32), np.asarray(residual, float)
    n_axes = residual.shape[1]
    robot = SimpleNamespace(
        n_axes=n_axes,
        gear_ratio=np.ones(n_axes),
        stribeck_velocity=np.ones(n_axes),
        set_points=np.ones(3),
    )
    recording = Recording(
        source="written down",
        robot="",
        side="motor",
        sample_period=period,
        position=np.outer(np.arange(len(residual)) * period * 100, np.ones(n_axes)),
        torque=np.full(residual.shape, torque),
    )

    simulate = straight(np.zeros(residual.shape), terms, columns)
    replay = SimpleNamespace(
        torque=simulate, recording=recording, robot=robot, measured=True, left_out=None
    )
    return Problem(
        replay=replay,
        commanded=None,
        given=replay,
        terms=list(terms),
        base=np.zeros(residual.shape),
        residual=residual,
        inside=np.ones(residual.shape, bool),
        parts=PARTS,
        scoring=[len(PARTS) - 1],
        raw=columns,
        noise=white_noise(np.ones(n_axes), len(residual)),
        baseline=baseline,
        shared=np.zeros(n_axes, bool),
    )

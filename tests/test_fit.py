"""Fits of effects by re-simulation, on laws that are written down."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from faultgen.discovery.fit.fit import first_of, fit
from faultgen.discovery.fit.regression import Problem
from faultgen.discovery.terms.candidates import Term
from faultgen.recordings.noise import Autoregression

COUNT = 600
TERMS = [
    Term("payload_mass", 1, 1.0, 0.01),
    Term("rotor_inertia", 1, 1.0, 0.01),
    Term("coulomb_friction", 1, 1.0, 0.01),
]


@pytest.fixture
def pose():
    """A problem of white noise: how severities become torque, and a residual."""
    rng = np.random.default_rng(0)
    shapes = 20 * rng.normal(size=(len(TERMS), COUNT, 1))

    def make(law, true, terms=TERMS):
        """The law bends a severity; the gap is that of the true ones."""
        parts = [slice(0, 200), slice(200, 400), slice(400, COUNT)]

        def torque(changes):
            total = np.zeros((COUNT, 1))
            for term, value in changes:
                total += law(value) * shapes[terms.index(term)]
            return total

        raw = np.array([torque([(t, t.step)]) / t.step for t in terms], np.float32)
        residual = torque(list(zip(terms, true, strict=True))) + rng.normal(size=(COUNT, 1))
        ones = np.ones((COUNT, 1), bool)
        scale = np.array([t.prior_std for t in terms], np.float32)[:, None, None]
        noise = Autoregression(np.zeros((1, 1)), np.ones(1))
        replay = SimpleNamespace(torque=torque, recording=None, robot=None)
        problem = Problem(
            replay=replay,
            given=replay,
            terms=terms,
            base=np.zeros((COUNT, 1)),
            residual=residual,
            inside=ones,
            parts=parts,
            scoring=[2],
            raw=raw,
            noise=noise,
            trust=ones.astype(float),
            white=noise.whiten(raw, parts) * scale,
            baseline=True,
            shared=np.zeros(1, bool),
        )
        return problem

    return make


def test_a_straight_law_is_solved_at_once(pose):
    problem = pose(lambda v: v, (0.5, 0.0, 0.2))
    found = fit(problem, [(0,), (2,)])
    assert found.values == pytest.approx([0.5, 0.2], abs=4 * found.errors.max())
    (first, values, errors), _ = found.members()
    assert first == (0,) and values == found.values[:1] and errors == found.errors[:1]


def test_a_bent_law_gets_slopes_of_its_own(pose):
    """Probed at 1, the law says far too much of a severity of 0.3; the fit finds it all the same.

    Standard errors are those of the slope there: 1 / (|column| dlaw/dv).
    """
    problem = pose(lambda v: np.expm1(3 * v), (0.3, 0.0, 0.0))
    found = fit(problem, [(0,)])
    assert found.values[0] == pytest.approx(0.3, abs=4 * found.errors[0])
    slope = 3 * np.exp(0.9) * 20 * np.sqrt(400)
    assert found.errors[0] == pytest.approx(1 / slope, rel=0.1)


@pytest.mark.parametrize("start", [0.7, 0.9])
def test_a_first_step_that_is_too_long_is_shortened(pose, start):
    """Beyond 0.5 the law explodes, and the linear estimate lies beyond."""
    problem = pose(lambda v: 0.2 * v + 300 * max(v - 0.5, 0) ** 2, (0.4, 0.0, 0.0))
    found = fit(problem, [(0,)], np.array([start]))
    assert found.values[0] == pytest.approx(0.4, abs=5 * found.errors[0])


@pytest.mark.parametrize(
    ("true", "baseline"), [(2e-4, True), (1e-3, True), (3e-3, True), (3e-3, False)]
)
def test_a_play_is_found_beyond_a_barrier(pose, true, baseline):
    """Its torque is at another place for another severity, so that slopes lead nowhere."""
    x = np.linspace(0, 5e-3, COUNT)[:, None]

    def law(severity):
        return 0.3 * np.exp(-(((x - severity) / 3e-4) ** 2))

    term = Term("backlash", 1, 3e-4, 1.0)
    problem = replace(pose(law, [true], [term]), baseline=baseline)
    for start in (None, np.array([2.0 * true])):
        found = fit(problem, [(0,)], start)
        assert found.values == pytest.approx([true], abs=5e-5)
        slope = (problem.change([(term, true + 1e-6)]) - problem.change([(term, true)])) / 1e-6
        fitted = np.sqrt(np.sum(slope[:400] ** 2))
        assert found.errors[0] == pytest.approx(1 / fitted, rel=0.2)


def test_only_the_newest_effect_is_searched_for_if_the_others_are_known(pose):
    """A search tries many severities; a known play needs none."""
    terms = [Term("backlash", 1, 3e-4, 1.0), TERMS[1]]
    problem = pose(lambda v: 1000 * v, (4e-4, 2e-4), terms)
    tried = []
    torque = problem.replay.torque
    counted = SimpleNamespace(torque=lambda changes: (tried.append(changes), torque(changes))[1])
    object.__setattr__(problem, "replay", counted)
    for start, is_searched in ((None, True), (np.array([4e-4, 1e-4]), False)):
        tried.clear()
        found = fit(problem, [(0,), (1,)], start)
        assert found.values == pytest.approx([4e-4, 2e-4], abs=1e-5)
        assert (len(tried) > 10) is is_searched


@pytest.mark.parametrize("diverges", [False, True])
def test_the_first_effects_of_a_set_keep_their_severities(pose, diverges):
    """Their torque is simulated, or to first order where the simulation diverges."""
    problem = pose(lambda v: v + v**2, (0.5, 0.3, 0.2))
    found = fit(problem, [(0,), (1,), (2,)])
    torque = problem.replay.torque
    if diverges:
        torque = lambda changes: np.full((COUNT, 1), np.nan)  # noqa: E731
    object.__setattr__(problem, "replay", SimpleNamespace(torque=torque))
    first = first_of(problem, found, 2)
    assert first.groups == ((0,), (1,))
    assert first.values == pytest.approx(found.values[:2])
    assert first.errors == pytest.approx(found.errors[:2])
    bend = 2.0 if diverges else 1 + found.values[:2]  # the law at a severity of 1 is 2
    told = (bend * found.values[:2])[:, None, None] * problem.raw[:2] / 2
    assert first.change == pytest.approx(told.sum(axis=0), rel=1e-4, abs=1e-4)
    assert first_of(problem, found, 3) is found


def test_nothing_is_fitted_where_no_severity_explains_anything(pose):
    """The law turns its sign: whatever the linear estimate says, simulation is worse."""
    problem = pose(lambda v: v, (0.5, 0.0, 0.0))
    turned = SimpleNamespace(torque=lambda changes: -sum(v for _, v in changes) * problem.raw[0])
    object.__setattr__(problem, "replay", turned)
    assert fit(problem, [(0,)]) is None


def test_a_severity_at_its_bound_explains_nothing(pose):
    """A payload cannot lose more than its mass."""
    problem = pose(lambda v: v, (-3.0, 0.0, 0.0))
    assert fit(problem, [(0,)]) is None

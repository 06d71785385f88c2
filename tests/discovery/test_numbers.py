"""Columns of what may differ in a healthy robot, its groups, and torques of no known form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from faultgen.discovery.decision import arrays
from faultgen.discovery.decision.arrays import Posed, arrays_of, jumps
from faultgen.discovery.decision.difference import difference_of
from faultgen.discovery.decision.hypotheses import UNKNOWN
from faultgen.discovery.decision.numbers import (
    GENERIC,
    KINDS,
    Numbers,
    fixed_groups,
    is_number,
    kind_of,
    numbers_of,
)
from faultgen.discovery.decision.processes import OVER, processes
from faultgen.discovery.decision.whitening import noise_of, resolved
from faultgen.discovery.laws.friction_forms import forms_of
from faultgen.discovery.replay.bristles import DAMPED, EXPONENT, FRICTION, friction_columns
from faultgen.discovery.replay.elastic import STIFFNESS
from faultgen.discovery.replay.formulas import GEAR_DAMPING, Formulas
from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.replay.sensitivities import sensitivities
from faultgen.discovery.terms.candidates import PAYLOAD, Term, effect_terms, scanned_terms
from faultgen.effects import get_effect
from faultgen.mjcf.dcmotor import BRISTLE_DAMPING, COULOMB, STICTION


@pytest.fixture(scope="module")
def replay(measured, tiny_robot):
    return Replay(measured([], 1), tiny_robot)


@pytest.fixture(scope="module")
def signatures(replay, tiny_robot):
    """Terms, columns and torque of the model."""
    terms = [one for one in effect_terms(tiny_robot) if one.name != "delay"]
    terms += scanned_terms(tiny_robot)
    base, raw = sensitivities(replay, terms)
    return terms, raw, base


def numbers(replay, signatures, *, baseline=False) -> Numbers:
    terms, raw, base = signatures
    formulas = Formulas(replay)
    return numbers_of(formulas, forms_of(formulas), terms, raw, base, baseline=baseline)


def posed_for(replay, signatures, residual, **more) -> Posed:
    terms, raw, base = signatures
    return Posed(replay, terms, raw, base, residual, np.ones(len(base), bool), **more)


def only(found, kind, axis=None):
    """Columns of a group, of one axis if given."""
    return [
        column
        for column, own in zip(found.columns, found.kinds, strict=True)
        if own == kind and (axis is None or column[:, axis - 1].any())
    ]


def test_numbers_of_the_model_have_their_columns(replay, signatures):
    """Each once, with the usual deviation of its term."""
    found = numbers(replay, signatures)
    terms, raw, _ = signatures
    for term, column in zip(terms, raw, strict=True):
        which = (*term.key, term.parameters)
        if not is_number(term) or not column.any():
            continue
        at = found.which.index(which)
        assert found.which.count(which) == 1
        assert found.kinds[at] == kind_of(term)
        if found.kinds[at] == "gain":  # logs are less exact than drives
            assert found.std[at] > term.prior_std
        else:
            assert found.std[at] == term.prior_std
    friction = [k for k, t in enumerate(terms) if t.name == "coulomb_friction"]
    at = found.which.index(("coulomb_friction", 1, ()))
    np.testing.assert_array_equal(found.columns[at], raw[friction[0]])


@pytest.mark.parametrize("axis", [1, 2])
def test_damping_and_stiffness_of_gearboxes_are_those_of_the_simulation(tiny_robot, replay, axis):
    """A tenth more damping, and a hundredth less stiffness."""
    gearbox = tiny_robot.ids("tendon", "gearbox")[axis - 1]
    spec = tiny_robot.spec()
    spec.tendons[gearbox].damping[0] *= 1.1
    damped = tiny_robot.edited(spec)
    softer = tiny_robot.spec()
    get_effect(STIFFNESS).apply(softer, axis, 0.01)
    base = replay.torque()
    terms = [Term(GEAR_DAMPING, axis, 1.0, 1.0), Term(STIFFNESS, axis, 0.01, 1.0)]
    told = Formulas(replay).columns(terms)
    for term, robot, size in (
        (terms[0], damped, 0.1),
        (terms[1], tiny_robot.edited(softer), 0.01),
    ):
        change = (Replay(replay.recording, robot).torque() - base) / size
        error = np.sqrt(np.mean((told[term] - change) ** 2, axis=0))
        # the formula holds the inertia for 10 ms, and its steps are those of the simulation
        assert error[axis - 1] < 0.2 * np.sqrt(np.mean(change[:, axis - 1] ** 2))


def test_what_a_log_does_to_torques_has_columns(replay, signatures):
    """A lag of 1 ms is the torque of one millisecond before, to first order."""
    found = numbers(replay, signatures)
    base = signatures[2]
    late = np.sum(only(found, "lag of the log"), axis=0)
    period = replay.recording.sample_period
    expected = np.gradient(base, period, axis=0)
    np.testing.assert_allclose(late, expected, atol=1e-4 * np.abs(expected).max())
    exact = np.sum(only(found, "smoothing"), axis=0)
    rng = np.random.default_rng(0)
    noisy = replay.recording.position + 0.02 * rng.standard_normal(base.shape)
    rough = Replay(replace(replay.recording, position=noisy), replay.robot)
    smooth = only(numbers(rough, signatures), "smoothing")
    assert len(smooth) == 2 * 4  # inertial torque, a step and a pulse of friction, and its moment
    assert np.all(np.sum(smooth, axis=0).std(axis=0) > 3 * exact.std(axis=0))
    # smoothing takes from fast changes, and nothing from what is steady
    assert all(abs(one.mean()) < 0.05 * one.std() for one in np.sum(smooth, axis=0).T)


def test_two_days_of_a_robot_differ_less_than_robot_and_model(replay, signatures):
    """By the factor of each group; the groups' own scales are less well known."""
    of_model, of_days = (numbers(replay, signatures, baseline=one) for one in (False, True))
    both = [k for k, which in enumerate(of_days.which) if not which or which[0] != "friction"]
    assert len(of_days.which) - len(both) == replay.robot.n_axes  # all friction of each axis
    assert of_model.kinds == [of_days.kinds[k] for k in both] and set(of_model.kinds) <= set(KINDS)
    days = np.array([KINDS[kind].days for kind in of_model.kinds])
    np.testing.assert_allclose(np.array(of_days.std)[both], days * of_model.std)
    assert days.max() <= 1.0
    names = [one.name for one in of_days.groups]
    assert names == list(KINDS)
    assert of_days.groups[names.index("friction")].spread == KINDS["friction"].spread_of_days
    assert [names[g] for g in of_days.group] == of_days.kinds


def test_a_column_of_zeros_is_no_number():
    found = Numbers(False)
    found.add(np.zeros((10, 2)), 1.0, "offset")
    assert found.columns == [] and found.group.shape == (0,)


def test_a_given_scale_holds_for_the_numbers_of_the_model():
    """And not for torques of no known form."""
    groups = {one.name: one for one in fixed_groups(3.0)}
    for name in ("friction", "links", "form of friction"):
        assert groups[name].centre == 3.0
    assert groups["friction"].spread < 1.02
    for name in (*GENERIC, "lag of the log"):
        assert groups[name].centre == 1.0 and groups[name].spread == KINDS[name].spread


def test_points_of_a_payload_are_no_number():
    point = (("x", 0.1), ("y", 0.0), ("z", 0.0))
    assert is_number(Term(PAYLOAD, 1, 0.1, 0.1))
    assert not is_number(Term(PAYLOAD, 1, 0.1, 0.1, point))
    assert kind_of(Term("backlash", 1, 0.1, 0.1)) is None


def test_a_sensor_behind_the_gearbox_sees_no_friction(measured, tiny_robot, replay, signatures):
    """No form of friction, no rotor: the lag and the arm remain."""
    gear = np.concatenate([run.gear_torque for run in replay.cycles])
    steps = np.round(np.arange(len(signatures[2])) * 0.004 / 0.001).astype(int)
    torque = gear[np.minimum(steps, len(gear) - 1)]
    recording = replace(replay.recording, torque=torque, link=True, side="joint")
    recording = replace(recording, position=recording.position / tiny_robot.gear_ratio)
    link = Replay(recording, tiny_robot)
    terms = [Term(PAYLOAD, 2, 0.1, 0.1)]
    base, raw = sensitivities(link, terms)
    posed = Posed(link, terms, raw, base, torque - base, np.ones(len(base), bool))
    arrays = arrays_of(posed, only_numbers=True)
    found = arrays.numbers
    assert arrays.bristles is None
    assert not {"form of friction", "form on one axis", "friction"} & set(found.kinds)
    assert {"links", "lag of the log"} <= set(found.kinds)


def test_bristles_are_bent_in_the_direction_of_motion(replay, signatures):
    posed = posed_for(replay, signatures, 0 * signatures[2])
    bent = arrays_of(posed, only_numbers=True).bristles
    speed = Formulas(replay).motion.speed
    assert np.abs(bent).max() <= 1.0
    fast = np.abs(speed) > 0.5 * np.abs(speed).max(axis=0)
    assert np.all(bent[fast] * np.sign(speed[fast]) > 0.95)


def test_processes_are_bumps_along_variables_of_one_axis(replay):
    """Along a usual range they add up to 1, or to the direction."""
    motion = Formulas(replay).motion
    found = {one.key: one for one in processes(replay.recording, motion)}
    assert {key[2][0] for key in found} == set(OVER) and {key[1] for key in found} == {1, 2}
    for axis in (1, 2):
        whole = found["process", axis, ("joint angle",)].bumps
        np.testing.assert_allclose(whole.sum(axis=0), 1.0)
        turned = found["process", axis, ("joint angle, by direction",)].bumps
        np.testing.assert_allclose(turned.sum(axis=0), np.sign(motion.speed[:, axis - 1]))
        np.testing.assert_allclose(np.abs(turned), whole * (motion.speed[:, axis - 1] != 0))
    still = replace(motion, joint=0 * motion.joint)
    kinds = {one.over for one in processes(replay.recording, still)}
    assert "joint angle" not in kinds and "speed" in kinds


def test_hypotheses_share_the_forms_of_an_effect(replay, signatures):
    """All sizes of a play are one hypothesis; stiffness has the column of its number."""
    terms, raw, base = signatures
    difference = difference_of(posed_for(replay, signatures, replay.recording.torque - base))
    keys = [one.key for one in difference.hypotheses]
    assert len(set(keys)) == len(keys)
    (play,) = [one for one in difference.hypotheses if one.key == ("backlash", 2)]
    sizes = [difference.model.mean[difference.model.count + form[0]] for form in play.forms]
    expected = {t.step for t, c in zip(terms, raw, strict=True) if t.key == play.key and c.any()}
    assert sorted(sizes) == sorted(expected) and len(sizes) > 5
    others = [
        k
        for one in difference.hypotheses
        if one.key == ("payload_offset", 2)
        for form in one.forms
        for k in form
    ]
    assert not difference.model.mean[difference.model.count + np.array(others, int)].any()
    unknown = [one for one in difference.hypotheses if one.unknown]
    assert {one.key for one in unknown} == {(UNKNOWN, 1), (UNKNOWN, 2)}
    assert {difference.over[form[0]] for one in unknown for form in one.forms} == set(OVER)
    for one in unknown:
        assert all(difference.groups[form[0]] == () for form in one.forms)


def test_samples_at_rest_and_left_out_are_not_used(replay, signatures):
    """Nor those that were lost, nor those that are kept for scoring."""
    terms, raw, base = signatures
    used = np.arange(len(base)) < 1200
    lost = np.zeros(base.shape, bool)
    lost[300:350, 1] = True
    recording = replace(replay.recording, lost=lost)
    of = Replay(recording, replay.robot)
    posed = replace(posed_for(of, signatures, recording.torque - base), used=used)
    inside = difference_of(posed, only_numbers=True).inside
    speed = np.abs(Formulas(replay).motion.speed)
    assert inside.any(axis=0).all() and not inside[1200:].any()
    assert not inside[300:350, 1].any() and inside[300:350, 0].any()
    assert not inside[speed < 0.02 * speed.max(axis=0)].any()


def test_reversals_between_samples_are_not_used(replay, signatures, monkeypatch):
    """Where bristles turn over from one sample to the next; slow reversals are resolved."""
    bent = np.array([-1.0, -1.0, -0.6, -0.2, 0.1, 0.4, 0.4, -0.9, -1.0, -1.0])[:, None]
    found = jumps(bent, [slice(0, 6), slice(6, 10)])[:, 0]
    np.testing.assert_allclose(found, [0, 0.4, 0.4, 0.4, 0.4, 0.3, 1.3, 1.3, 1.3, 0.1], atol=1e-9)
    terms, raw, base = signatures
    posed = posed_for(replay, signatures, np.zeros(base.shape))
    before = arrays_of(posed, only_numbers=True)
    monkeypatch.setattr(arrays, "UNRESOLVED", 0.01)
    after = arrays_of(posed, only_numbers=True)
    quick = jumps(after.bristles, after.parts) >= 0.01
    assert (quick & before.comparable).any()
    assert (after.comparable == (before.comparable & ~quick)).all()


def test_the_noise_of_a_difference_is_found(measured, replay, signatures):
    """A healthy robot leaves white noise of variance 1, whatever its size."""
    base = signatures[2]
    for size in (1.0, 5.0):
        rng = np.random.default_rng(7)
        noise = size * 0.01 * np.abs(base).mean(axis=0) * rng.standard_normal(base.shape)
        found = difference_of(posed_for(replay, signatures, noise), only_numbers=True)
        rows = found.inside
        white = found.noise.whiten(noise, found.parts)
        assert [white[rows[:, k], k].std() for k in (0, 1)] == pytest.approx([1.0, 1.0], abs=0.1)
        level = np.sqrt(np.mean(noise**2, axis=0))
        told = [np.sqrt(np.mean(found.noise.of_samples()[rows[:, k], k] ** 2)) for k in (0, 1)]
        assert told == pytest.approx(level, rel=0.1)


def test_slow_noise_keeps_its_size_beside_many_numbers(replay, signatures):
    """What a fit of hundreds of columns takes of it is put back: below 2 Hz the variance is 1."""
    base, period = signatures[2], replay.recording.sample_period
    slow = np.fft.rfftfreq(len(base), period) < 2.0
    found = []
    for seed in range(6):
        white = np.random.default_rng(seed).standard_normal(base.shape)
        noise = 0.02 * np.abs(base).mean(axis=0) * lfilter([1.0], [1.0, -0.95], white, axis=0)
        told = difference_of(posed_for(replay, signatures, noise))
        left = told.noise.whiten(noise, told.parts) * told.inside
        power = np.abs(np.fft.rfft(left, axis=0)) ** 2 / told.inside.sum(axis=0)
        found.append(power[slow].mean())
    assert np.mean(found) == pytest.approx(1.0, abs=0.25)  # about three deviations of the mean


def test_values_that_the_model_was_moved_by_are_part_of_the_difference(replay, signatures):
    """The error of the given model counts, not that of the near one."""
    base = signatures[2]
    residual = 0.01 * np.random.default_rng(1).standard_normal(base.shape)
    plain = difference_of(posed_for(replay, signatures, residual), only_numbers=True)
    which = (STIFFNESS, 2, ())
    column = plain.numbers.columns[plain.numbers.which.index(which)]
    posed = posed_for(replay, signatures, residual, moved={which: 0.2, ("inertia", 9, ()): 1.0})
    moved = difference_of(posed, only_numbers=True)
    np.testing.assert_allclose(moved.residual, residual + 0.2 * column, rtol=1e-5, atol=1e-9)


def test_damping_of_bristles_is_that_of_a_robot_with_more_of_it(replay):
    """The column is the change of the torque by twice the damping, simulated."""
    robot = replay.robot
    spec = robot.spec()
    spec.actuator("friction1").dynprm[BRISTLE_DAMPING] *= 2
    change = replay.on(robot.edited(spec)).torque() - replay.torque()
    (column,) = Formulas(replay).columns([Term(DAMPED, 1, 1.0, 1.0)]).values()
    assert np.abs(change).max() > 0
    np.testing.assert_allclose(column, change, atol=1e-3 * np.abs(change).max())


def test_exponent_is_that_of_the_stribeck_curve(replay):
    """The closed form of sliding friction at a constant speed, per unit of the exponent over 2."""
    robot = replay.robot
    width, step = robot.stribeck_velocity[0], -0.25
    spec = robot.spec().actuator("friction1").biasprm
    fall = spec[STICTION] - spec[COULOMB]
    for speed in (0.3 * width, 0.9 * width, 1.5 * width):
        time = np.arange(4000) * robot.model.opt.timestep
        rotors = np.outer(time, speed * np.eye(robot.n_axes)[0])
        term = Term(EXPONENT, 1, step, 1.0)
        last = np.array([len(time) - 2])
        columns = friction_columns(robot, [term], rotors, last, np.zeros((1, robot.n_axes)))
        curves = [np.exp(-((speed / width) ** power)) for power in (2 * (1 + step), 2.0)]
        expected = fall * (curves[0] - curves[1]) / step
        assert columns[term][0, 0] == pytest.approx(expected, rel=1e-4)


def test_laws_of_friction_are_judged_only_where_the_motion_is_resolved(replay, signatures):
    """Where smoothing takes more than the noise, unless it cancels between two recordings."""
    base = signatures[2]
    left = 0.01 * np.random.default_rng(2).standard_normal(base.shape)
    found = arrays_of(posed_for(replay, signatures, left))
    rough = np.zeros(base.shape)
    rough[: len(base) // 2, 0] = 1.0
    found.numbers.add(rough, 1.0, "smoothing")
    noise = noise_of(found, left[None], None)
    takes = np.sqrt(np.sum(np.square(only(found.numbers, "smoothing")), axis=0))
    np.testing.assert_allclose(found.smoothing, takes, rtol=1e-5)
    unclear = takes >= noise.of_samples()
    assert unclear[rough > 0].all() and 0.1 < unclear.mean() < 0.9
    masked = resolved(found, noise)
    names = {h.key[0] for h in found.effects.hypotheses}
    assert {"stribeck_velocity", "gear_stiffness"} <= names
    for hypothesis in found.effects.hypotheses:
        for k in (k for form in hypothesis.forms for k in form):
            before, after = found.effects.columns[k], masked.effects.columns[k]
            if hypothesis.key[0] in FRICTION:
                assert not after[unclear].any()
                np.testing.assert_array_equal(after[~unclear], before[~unclear])
            else:
                assert after is before
    both = arrays_of(posed_for(replay, signatures, left, baseline=True))
    assert resolved(both, noise) is both

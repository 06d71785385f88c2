"""Factors of the laboratories that came later: logs, clocks, controllers, loads, real noise."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from laboratories import real_noise
from laboratories.arm import body_arrays, inverse
from laboratories.draw import ADDED, BASE, Laboratory, draw_cases, draw_laboratory
from laboratories.effects import Effect, apply
from laboratories.files import write_case
from laboratories.make import Session, record
from laboratories.noise import REAL, draw_noise
from laboratories.robots import STILL, machine_of, nominal, simulate, with_worn_forward
from laboratories.servo import with_servo
from laboratories.setup import Setup, beside, log_gain, set_up

from faultgen.discovery import read_recording

pytestmark = pytest.mark.slow  # its simulator has to be compiled


def laboratory(**factors: Any) -> Laboratory:
    """A short laboratory with one axis."""
    short = {"robot": "lift1", "seconds": 2.5, "segments": 1}
    return Laboratory("development2", 900, BASE | short | factors, ())


def recorded(setup: Setup) -> dict[str, np.ndarray]:
    """The healthy robot on an average day."""
    count = len(setup.motions)
    n = setup.lab.machine.n_axes
    day = Session(np.ones(n), np.full(count, 40.0), np.ones(count))
    return record(setup, [], day, range(setup.n_measured), np.random.default_rng(0))[0]


def test_first_sets_are_drawn_as_before() -> None:
    """Laboratories and cases of the first sets do not know the added factors."""
    drawn = []
    for number in range(40):
        lab = draw_laboratory("report", number)
        assert all(lab.factors[name] == BASE[name] for name in ADDED)
        older = {k: v for k, v in lab.factors.items() if k not in ADDED}
        drawn.append([older, [vars(plan) for plan in draw_cases(lab)]])
    digest = hashlib.sha256(json.dumps(drawn, default=str).encode()).hexdigest()
    # of the version before the factors were added
    assert digest.startswith("dc7161049e53d78c")


def test_new_sets_draw_what_was_added() -> None:
    """Eight laboratories of a new set have each added factor, real noise, and a load elsewhere."""
    for seeds in ("development2", "report2"):
        labs = [draw_laboratory(seeds, number) for number in range(8)]
        stressed = {name for lab in labs for name in lab.stressed}
        assert {*ADDED, "noise", "all"} <= stressed
        assert REAL in {lab.factors["noise"] for lab in labs}
        elsewhere = [
            plan
            for lab in labs
            for plan in draw_cases(lab)
            if plan.effect == "payload_mass" and plan.axis < lab.machine.n_axes
        ]
        assert elsewhere


def test_a_log_has_a_gain_error() -> None:
    """The logged torque is the true one times a gain of each axis, which the truth states."""
    right, wrong = (recorded(set_up(laboratory(log_gain=kind))) for kind in ("right", "axes"))
    lab = laboratory(log_gain="axes")
    gain = log_gain(lab)
    assert 0.03 <= abs(gain[0] - 1) <= 0.2
    assert np.allclose(wrong["motor_torque"], gain * right["motor_torque"], rtol=1e-12)
    (told,) = beside(lab, "alone")
    # a motor whose constant is lower by s needs 1 / (1 - s) times the current
    assert 1 / (1 - told["severity"]) == pytest.approx(gain[0])
    assert beside(lab, "twin") == [] and beside(laboratory(), "alone") == []
    every = log_gain(replace(lab, factors=lab.factors | {"robot": "arm7", "log_gain": "robot"}))
    assert len(every) == 7 and np.ptp(every) == 0 and every[0] != 1


@pytest.mark.parametrize("times", ["known", "unknown"])
def test_known_sample_times_are_written(times: str, tmp_path: Path) -> None:
    """A file has the true times if they are known, else only the period."""
    setup = set_up(laboratory(jitter=0.1, times=times))
    arrays = recorded(setup)
    off = arrays["time"] - setup.period * np.arange(len(arrays["time"]))
    assert 0.05 < off.std() / setup.period < 0.15
    period = None if times == "known" else setup.period
    write_case(tmp_path, "lift1", period, {"measured": arrays}, "both")
    with h5py.File(tmp_path / "measured.h5") as file:
        assert ("time" in file) == (times == "known") == ("sample_period" not in file.attrs)
        if times == "known":
            assert np.array_equal(file["time"][()], arrays["time"])
    read = read_recording(tmp_path / "measured.h5")
    assert read.sample_period == pytest.approx(setup.period, rel=0.01)


def test_a_controller_may_know_the_worn_friction() -> None:
    """With the worn friction in its feed-forward torque, a worn robot follows more closely."""
    setup = set_up(laboratory(servo="pd_ff", bandwidth=7.0))
    machine = setup.lab.machine
    worn = apply(Effect("viscous_friction", 1, 1.0), setup.robot, machine)
    slow, points = np.tile(STILL, (1, 1)), setup.points[0]
    told = with_worn_forward(points, machine, worn, slow)
    assert np.array_equal(told[:, :2], points[:, :2])
    errors = [
        np.sqrt(np.mean((simulate(worn, one)[::2, 0, 0] - points[:, 0, 0]) ** 2))
        for one in (points, told)
    ]
    assert errors[1] < 0.5 * errors[0]


def test_a_load_on_another_link_weighs_what_it_should() -> None:
    """It changes the torque of its joint by m g r at most, and no joint beyond it."""
    machine = machine_of("puma560")
    plant, _ = with_servo(nominal(machine), "model", 0.0, 1e-3)
    mass, axis = 2.0, 2
    loaded = apply(Effect("payload_mass", axis, mass), plant, machine).machine
    q = np.zeros((721, 6))
    q[:, axis - 1] = np.linspace(-np.pi, np.pi, 721)
    still = np.zeros_like(q)
    change = inverse(body_arrays(loaded), q, still, still)
    change -= inverse(body_arrays(machine), q, still, still)
    place = machine.place[axis] + np.array([0.01, -0.01, 0.015])
    around = machine.axis[axis - 1]
    radius = np.linalg.norm(place - around * (around @ place))
    assert np.abs(change[:, axis - 1]).max() == pytest.approx(mass * 9.81 * radius, rel=1e-4)
    assert np.abs(change[:, axis:]).max() < 1e-9
    assert loaded.loaded()[0].sum() == pytest.approx(machine.loaded()[0].sum() + mass)


@pytest.mark.skipif(not real_noise.available(), reason="needs ../shared/data")
def test_real_noise_is_that_of_a_machine() -> None:
    """It has the level asked for, comes from the residuals, and the same seed repeats it."""
    torque = np.ones((4000, 3))
    noise = [
        draw_noise(
            REAL,
            0.01,
            torque,
            torque,
            n_motions=1,
            sample_period=0.004,
            limit=np.ones(3),
            rng=np.random.default_rng(7),
        )
        for _ in range(2)
    ]
    scale = noise[0].scale(torque, torque, 0)
    drawn = [one.sample(scale, np.random.default_rng(1)) for one in noise]
    assert np.array_equal(*drawn)
    assert np.allclose(drawn[0].std(axis=0), noise[0].level, rtol=0.3)
    first = drawn[0][: noise[0].block, 0] / scale[0, 0]
    found = np.abs(np.lib.stride_tricks.sliding_window_view(noise[0].bank[0], len(first)))
    assert np.abs(found - np.abs(first)).max(axis=1).min() < 1e-9


def test_real_noise_needs_its_recordings(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where they are absent, a laboratory with this noise says what is missing."""
    monkeypatch.setattr(real_noise, "DATA", Path("/nowhere"))
    real_noise.residuals.cache_clear()
    with pytest.raises(FileNotFoundError, match="real noise needs the recordings in /nowhere"):
        set_up(laboratory(noise=REAL))
    real_noise.residuals.cache_clear()

"""A measured temperature: its part of the torque is learned, and is not taken for a fault."""

from dataclasses import replace

import numpy as np
import pytest
from recorded import record

from faultgen.recordings.recording import write_recording
from faultgen.system.arrays import read_arrays
from faultgen.twin.alignment import KnownMotion
from faultgen.twin.columns import Columns, Fault, Generated
from faultgen.twin.detector import Detector, load_detector
from faultgen.twin.folder import HEALTHY
from faultgen.twin.judge import Judge, line
from faultgen.twin.make import furnish
from faultgen.twin.program import as_recording, program_of
from faultgen.twin.train import learn
from faultgen.twin.warming import learn_warming, temperature_of

HEALTHY_AT = (34.0, 36.0, 38.0, 40.0, 42.0, 44.0)
"""Temperatures of the healthy recordings [deg C]."""


@pytest.fixture(scope="module")
def healthy(tiny_robot, tiny_task_path):
    return [
        record(tiny_robot, tiny_task_path, seed, temperature=one)
        for seed, one in enumerate(HEALTHY_AT, start=1)
    ]


@pytest.fixture(scope="module")
def known(healthy, tiny_robot):
    first = healthy[0]
    return KnownMotion(
        path=first.position / tiny_robot.gear_ratio,
        stretches=((0, len(first.position)),),
        sample_period=first.sample_period,
        gear_ratio=tiny_robot.gear_ratio,
    )


@pytest.fixture(scope="module")
def temperature(healthy):
    return np.array([temperature_of(one) for one in healthy])


def detector(robot, known, healthy, temperature):
    """A detector of friction wear, from its formula."""
    torque = np.stack([one.torque for one in healthy])
    nothing = np.zeros((1, *torque.shape[1:]))
    generated = [
        Generated(
            fault=Fault(effect="friction_wear", axes=(axis,), largest=0.3, unit="1"),
            change=nothing,
            severity=np.ones(1),
        )
        for axis in (1, 2)
    ]
    found = learn(robot, known, torque, generated, 0.01, 0, temperature)
    return Detector(
        robot="tiny",
        task="recorded",
        program=found.program,
        faults=found.faults,
        posterior=found.posterior,
        healthy=found.healthy,
        warming=found.warming,
        recordings_per_month=30.0,
        constants=None,
        torque_gain=robot.torque_gain,
        made={},
    )


@pytest.fixture(scope="module")
def folder(tiny_robot, known, healthy, temperature, tmp_path_factory):
    """A detector that was made with temperatures."""
    path = tmp_path_factory.mktemp("warm") / "detector"
    detector(tiny_robot, known, healthy, temperature).save(path)
    return path


def test_the_law_is_that_of_the_simulation(tiny_robot, tiny_task_path, known, temperature):
    """The torque of a warm robot less that of a cold one, without noise and differences of days."""
    cold, warm = (
        record(tiny_robot, tiny_task_path, 1, spread=0.0, noise=0.0, temperature=one)
        for one in (35.0, 42.0)
    )
    columns = Columns(as_recording(known, cold.torque, "tiny"), tiny_robot)
    law = columns.law_of_temperature(np.array([[35.0, 35.0], [42.0, 42.0]]))
    told = law.change(np.full(2, 42.0)) - law.change(np.full(2, 35.0))
    true = warm.torque - cold.torque
    for axis in range(2):
        # between bristles that bend and those that slide, they are not the same
        assert np.corrcoef(told[:, axis], true[:, axis])[0, 1] > 0.93
        assert told[:, axis].std() == pytest.approx(true[:, axis].std(), rel=0.2)


@pytest.mark.parametrize("follows", [0.4, 1.6])
def test_the_share_of_the_law_is_learned(follows, tiny_robot, known, healthy, temperature):
    """Viscous friction of axis 2 follows more or less of the law than the published joint."""
    torque = np.stack([one.torque for one in healthy])
    columns = Columns(as_recording(known, torque.mean(axis=0), "tiny"), tiny_robot)
    law = columns.law_of_temperature(temperature)
    program = program_of(known, torque, columns.numbers, columns.drivers)
    parts = np.array([law.parts(one)[2] * [0, 1] for one in temperature])
    found = learn_warming(
        law, columns.days(program), program, torque + (follows - 1) * parts, temperature
    )
    assert found.share[2, 1] == pytest.approx(follows, abs=0.2)


def test_a_warm_robot_is_healthy_and_its_wear_is_named(tiny_robot, tiny_task_path, folder):
    """With the temperature, wear is stated as it is; without it, the warmth is what is named."""
    made = load_detector(folder)
    wear = [("friction_wear", 2, 0.1)]
    warm, worn = (
        record(tiny_robot, tiny_task_path, 50 + len(effects), effects, temperature=45.0)
        for effects in ((), wear)
    )
    for one, verdict in ((warm, "healthy"), (worn, "fault")):
        answer = made.judge(made.scores([one.torque], temperature_of(one))[None])
        assert answer["verdict"] == verdict
    assert answer["effect"] == "friction_wear" and answer["axes"] == [2]
    assert answer["severity"] == pytest.approx(0.1, rel=0.4)
    without = made.judge(made.scores([warm.torque])[None])
    assert without["verdict"] != "healthy"


def test_doubts_are_told(tiny_robot, tiny_task_path, folder, tmp_path):
    """A recording without a temperature, and one far from those of the healthy recordings."""
    one = record(tiny_robot, tiny_task_path, 60, temperature=41.0)
    for name, values, doubt in (
        ("usual", 41.0, None),
        ("none", None, "has no temperature, which the healthy recordings have"),
        ("hot", 60.0, "axis 1 is at 60 deg C, and the healthy recordings are from 34 to 44"),
    ):
        path = tmp_path / f"{name}.h5"
        told = None if values is None else np.full(len(one.torque), values)
        write_recording(replace(one, temperature=told), path)
        answer = Judge(folder, tmp_path / f"{name}.sqlite").judge(path)
        if doubt is None:
            assert answer["warning"] is None and answer["temperature"] == [41.0, 41.0]
        else:
            assert doubt in answer["warning"] and doubt in line(answer)


def test_a_twin_keeps_temperatures_if_all_recordings_have_them(
    tiny_robot, healthy, temperature, tmp_path
):
    furnish(tiny_robot, healthy[:2], tmp_path / "all", compare=False)
    arrays, _ = read_arrays(tmp_path / "all" / HEALTHY)
    np.testing.assert_allclose(arrays["temperature"], temperature[:2])
    some = [healthy[0], replace(healthy[1], temperature=None)]
    furnish(tiny_robot, some, tmp_path / "some", compare=False)
    assert "temperature" not in read_arrays(tmp_path / "some" / HEALTHY)[0]

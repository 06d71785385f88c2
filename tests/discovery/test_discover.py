"""Naming effects from a recording and its baseline, on the small robot."""

import json
from dataclasses import replace

import numpy as np
import pytest

import faultgen
from faultgen.dataset.experiment import Experiment
from faultgen.discovery import Discovery, check_recording, read_recording, write_recording
from faultgen.discovery.inputs import read_together
from faultgen.discovery.replay.samples import rolling
from faultgen.errors import InputError
from faultgen.recordings.from_runs import recording_of
from faultgen.recordings.low_pass import low_passed
from faultgen.report import discovery_report
from faultgen.robot import load_robot


@pytest.fixture(scope="module")
def files(measured, tmp_path_factory):
    """Recordings on disk, by name."""
    folder = tmp_path_factory.mktemp("discover")
    cases = {
        "healthy": ([], 1),
        "clean": ([], 2),
        "worn": ([("viscous_friction", 2, 0.3)], 3),
        "two": ([("viscous_friction", 2, 0.3), ("torque_offset", 1, 0.02)], 4),
    }
    for name, (effects, seed) in cases.items():
        write_recording(measured(effects, seed), folder / f"{name}.h5")
    return folder


def discovered(files, robot, name, **more):
    return faultgen.discover(files / f"{name}.h5", robot, files / "healthy.h5", **more)


@pytest.mark.parametrize("name", ["out", "cache"])
def test_a_file_is_no_folder_for_results(name, tmp_path):
    """It is refused before anything is simulated."""
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=f"{name}: must be a folder"):
        faultgen.discover("nowhere.h5", "puma560", **{name: tmp_path / "file"})


def test_an_effect_is_named(files, tiny_robot_path, tmp_path):
    """The right effect, axis and severity; the gap closes; the files hold it."""
    result = discovered(files, tiny_robot_path, "worn", out=tmp_path)
    (one,) = result["effects"]
    assert (one["effect"], one["axis"]) == ("viscous_friction", 2)
    low, high = one["interval"]["severity"]
    assert low < 0.3 < high and high - low < 0.1
    assert one["parameters"]["severity"] == pytest.approx(0.3, rel=0.1)
    gap = result["gap"]
    assert gap["after"] < gap["before"] and gap["after"] < 1.15 * gap["floor"]
    assert json.loads((tmp_path / "discovery.json").read_text()) == result
    assert result["version"] == faultgen.__version__
    assert result.verdict == result["verdict"] and result.effects == [one]
    assert repr(result) == f"<Discovery: {result.verdict}. {result.summary}>"
    assert one["sentence"] in result._repr_html_()
    bars = result.plot().patches  # before, calibrated, after and floor of both axes
    assert [bar.get_height() for bar in bars[:2]] == pytest.approx(
        [100 * row["before"] for row in gap["per_axis"]]
    )
    robot, healthy = load_robot(tmp_path / "model.xml"), load_robot(tiny_robot_path)
    damping = [r.model.actuator_damping[r.ids("actuator", "friction")[1]] for r in (robot, healthy)]
    assert damping[0] / damping[1] == pytest.approx(1 + one["parameters"]["severity"], rel=1e-4)
    page = (tmp_path / "report.html").read_text()
    assert "viscous_friction" in page and "data:image/png;base64," in page


def test_a_clean_robot_has_no_missing_effect(files, tiny_robot_path, tmp_path):
    """Nothing is named, and the model is the robot's own."""
    result = discovered(files, tiny_robot_path, "clean", out=tmp_path)
    assert (result["verdict"], result["effects"]) == ("no missing effect", [])
    assert (tmp_path / "model.xml").read_text() == load_robot(tiny_robot_path).xml


@pytest.mark.slow
@pytest.mark.parametrize("baseline", [True, False])
def test_a_play_is_looked_for_at_every_size(measured, tiny_robot, baseline):
    """A play of 1 mrad. From the next smaller or larger probe but these, slopes lead nowhere."""
    healthy = measured([], 3) if baseline else None
    told = (
        Discovery(tiny_robot, laws=False).fit(measured([("backlash", 1, 1e-3)], 2), healthy).answer_
    )
    assert [(one.effect, one.axis) for one in told.effects] == [("backlash", 1)]
    assert told.effects[0].severity == pytest.approx(1e-3, rel=0.05)
    assert told.after < 1.1 * told.floor < told.before


@pytest.mark.slow
def test_two_effects(files, tiny_robot_path):
    result = discovered(files, tiny_robot_path, "two")
    named = {(one["effect"], one["axis"]) for one in result["effects"]}
    assert {("viscous_friction", 2), ("torque_offset", 1)} <= named


@pytest.mark.slow
def test_what_is_not_in_the_catalogue_is_not_named(measured, files, tiny_robot_path):
    """With its effect taken out of the catalogue, the gap stays unexplained.

    A weak motor is taken out, too: with a payload, it explains this recording to its noise.
    """
    path = files / "heavy.h5"
    write_recording(measured([("rotor_inertia", 2, 0.5)], 5), path)
    known = faultgen.discover(path, tiny_robot_path, files / "healthy.h5")
    assert [one["effect"] for one in known["effects"]] == ["rotor_inertia"]
    without = faultgen.discover(
        path,
        tiny_robot_path,
        files / "healthy.h5",
        exclude=["rotor_inertia", "torque_constant"],
    )
    assert without["verdict"] == "unknown effect"
    assert {(one["effect"], one["axis"]) for one in without["effects"]} == {("learned", 2)}
    assert without["unexplained"]


def test_what_cannot_be_used_is_refused(files, tiny_robot_path, measured, tmp_path):
    """A baseline of another length."""
    recording = measured([], 6)
    short = replace(
        recording,
        position=recording.position[:500],
        torque=recording.torque[:500],
        reference_position=recording.reference_position[:500],
    )
    write_recording(short, tmp_path / "short.h5")
    with pytest.raises(InputError, match="not the same motions"):
        faultgen.discover(files / "worn.h5", tiny_robot_path, tmp_path / "short.h5")


def test_a_recording_and_its_baseline_may_have_other_signs(files, tiny_robot, measured, tmp_path):
    """Each is brought to the sign of its positions before they are subtracted."""
    recording = measured([], 6)
    turned = replace(recording, torque=recording.torque * np.array([1, -1]))
    write_recording(turned, tmp_path / "turned.h5")
    given = read_together([tmp_path / "turned.h5"], tiny_robot, [files / "healthy.h5"])
    np.testing.assert_allclose(given.recording.torque, recording.torque, rtol=1e-6)
    apart = given.recording.torque - given.runs[0].torque
    assert np.all(apart.std(axis=0) < 0.1 * recording.torque.std(axis=0))
    (line,) = given.findings
    assert "turned.h5: corrected: axis 2: the torque has the opposite sign" in line


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ({"include": ["nonsense"]}, "include: unknown name 'nonsense'; choose low_speed_friction"),
        ({"exclude": ["nonsense"]}, "exclude: unknown name 'nonsense'; choose backlash"),
        ({"prior_scale": float("nan")}, "prior-scale: must be a positive number, not nan"),
        ({"low_pass": -3.0}, "low-pass: must be a positive number, not -3"),
    ],
)
def test_options_are_checked_first(files, tiny_robot_path, option, message):
    with pytest.raises(InputError, match=message):
        discovered(files, tiny_robot_path, "worn", **option)


def test_a_recording_that_would_be_simulated_for_days_is_refused(files, tiny_robot_path, tmp_path):
    long = replace(read_recording(files / "clean.h5"), sample_period=1.0)
    count = 3700
    arrays = ("position", "torque", "reference_position")
    long = replace(long, **{name: np.resize(getattr(long, name), (count, 2)) for name in arrays})
    write_recording(long, tmp_path / "long.h5")
    with pytest.raises(InputError, match="are 3700 s; give at most 3600 s"):
        faultgen.discover(tmp_path / "long.h5", tiny_robot_path)


def test_separate_recordings_may_be_short(tiny_robot, measured):
    """Masks have the shape of the recording, however few samples one of them has."""
    recording = replace(measured([], 1), segments=(0, 5, 12, 300))
    assert check_recording(recording, tiny_robot) is not None
    assert rolling(recording, tiny_robot).shape == recording.position.shape
    with pytest.raises(InputError, match="5 samples is too short for the low-pass filter"):
        low_passed(recording, 10.0)


@pytest.mark.slow
def test_the_order_of_the_catalogue_does_not_matter(files, tiny_robot_path, monkeypatch):
    """Candidates in reverse order give the same answer."""
    from faultgen.discovery import signatures

    forward = discovered(files, tiny_robot_path, "two")
    terms = signatures.effect_terms
    monkeypatch.setattr(signatures, "effect_terms", lambda *given: terms(*given)[::-1])
    backward = discovered(files, tiny_robot_path, "two")
    assert forward["verdict"] == backward["verdict"]
    assert [(one["effect"], one["axis"]) for one in forward["effects"]] == [
        (one["effect"], one["axis"]) for one in backward["effects"]
    ]
    for one, other in zip(forward["effects"], backward["effects"], strict=True):
        assert one["parameters"]["severity"] == pytest.approx(
            other["parameters"]["severity"], rel=2e-3
        )  # the search for scales ends within its tolerance


@pytest.mark.slow
def test_without_a_baseline(files, tiny_robot_path, measured, tmp_path):
    """A clean recording has no missing effect; a strong one is named against the model alone."""
    clean = faultgen.discover(files / "clean.h5", tiny_robot_path)
    assert (clean["verdict"], clean["effects"]) == ("no missing effect", [])
    path = tmp_path / "off.h5"
    write_recording(measured([("torque_offset", 1, 0.05)], 8), path)
    result = faultgen.discover(path, tiny_robot_path, out=tmp_path / "out")
    assert ("torque_offset", 1) in {(one["effect"], one["axis"]) for one in result["effects"]}
    gap = result["gap"]
    assert gap["after"] < 0.5 * gap["before"]
    assert result["where"][0]["axis"] == 1


@pytest.mark.slow
def test_sensitivities_are_kept(files, tiny_robot_path, tmp_path):
    """The second discovery reads what the first has simulated, unless it is damaged."""
    first = discovered(files, tiny_robot_path, "worn", cache=tmp_path)
    times = {kept: kept.stat().st_mtime_ns for kept in tmp_path.iterdir()}
    assert times
    assert discovered(files, tiny_robot_path, "worn", cache=tmp_path)["effects"] == first["effects"]
    assert {kept: kept.stat().st_mtime_ns for kept in tmp_path.iterdir()} == times
    for kept in tmp_path.iterdir():  # damaged files are not believed
        content = bytearray(kept.read_bytes())
        content[len(content) // 2] ^= 1
        kept.write_bytes(content)
    assert discovered(files, tiny_robot_path, "worn", cache=tmp_path)["effects"] == first["effects"]


@pytest.mark.slow
def test_names_of_files_and_robots_do_not_matter(files, tiny_robot_path, tmp_path):
    """What a file, its robot or the model is called says nothing of the effect."""
    plain = discovered(files, tiny_robot_path, "worn")
    recording = replace(read_recording(files / "worn.h5"), robot="backlash")
    write_recording(recording, tmp_path / "torque_offset_axis_1.h5")
    model = tmp_path / "coulomb_friction.xml"
    model.write_text(load_robot(tiny_robot_path).xml.replace('model="tiny"', 'model="healthy"'))
    other = faultgen.discover(
        tmp_path / "torque_offset_axis_1.h5", model, files / "healthy.h5", cache=tmp_path
    )
    named = [line for line in other["warnings"] if "the file says robot" in line]
    assert len(named) == 2  # of the robot's name, in either file
    assert len(other["warnings"]) == 3  # and of the friction of a robot with few axes
    for key in ("verdict", "effects", "alternatives", "gap", "where", "calibration"):
        assert other[key] == plain[key]


@pytest.fixture(scope="module")
def shared(measured, tmp_path_factory):
    """Recordings with the same noise as the healthy one, in torque and in position."""
    folder = tmp_path_factory.mktemp("shared")
    cases = {
        "healthy": ([], 1),
        "play": ([("backlash", 2, 0.008)], 1),
        "own_noise": ([("backlash", 2, 0.008)], 2),
        "worn": ([("viscous_friction", 2, 0.3)], 1),
    }
    for name, (effects, seed) in cases.items():
        recording = measured(effects, 1)
        clean = recording.torque - measured(effects, 2).torque
        z = [np.random.default_rng(k).standard_normal(clean.shape) for k in (1, 2)]
        scale = np.median(clean / (z[0] - z[1]), axis=0)
        rng = np.random.default_rng(seed)
        noise = rng.standard_normal((2, *clean.shape))
        recording = replace(
            recording,
            position=recording.position + 1e-4 * np.array([100.0, 50.0]) * noise[0],
            torque=recording.torque - scale * z[0] + 2e-3 * noise[1],
        )
        write_recording(recording, folder / f"{name}.h5")
    return folder


def against_healthy(shared, robot, name):
    result = faultgen.discover(shared / f"{name}.h5", robot, shared / "healthy.h5")
    return result, [(one["effect"], one["axis"]) for one in result["effects"]]


@pytest.mark.slow
def test_noise_that_two_recordings_share_is_reckoned_with(shared, tiny_robot_path):
    """Their difference has none of it; no effect is named, as with noise of their own.

    This play is too small to be told in the noise. A difference without any noise shows it, and
    small errors of simulation beside it, which made it an unknown effect.
    """
    own, none = against_healthy(shared, tiny_robot_path, "own_noise")
    result, effects = against_healthy(shared, tiny_robot_path, "play")
    assert (result["verdict"], effects) == ("no missing effect", [])
    assert none == []  # noise of the positions of its own makes the model not good enough
    assert any("how much friction differs from day to day" in one for one in own["warnings"])
    (warning,) = [one for one in result["warnings"] if "day to day" not in one]
    assert "axis 1, 2: the recording and its baseline differ by far less" in warning
    assert "paired = false" in warning


@pytest.mark.slow
def test_what_is_larger_than_shared_noise_is_named(shared, tiny_robot_path):
    result, effects = against_healthy(shared, tiny_robot_path, "worn")
    assert effects == [("viscous_friction", 2)]
    # one day may change all friction of an axis: Coulomb friction and wear are not excluded
    assert {one["axis"] for one in result["alternatives"]} <= {2}
    assert all("friction" in one["effect"] for one in result["alternatives"])
    low, high = result["effects"][0]["interval"]["severity"]
    assert low < 0.3 < high < 1.3 * low  # as if each had noise of its own


@pytest.mark.slow
def test_play_is_named_in_runs_of_a_paired_dataset(tmp_path):
    """Backlash of 2 mrad of a PUMA, whose healthy run has the same noise."""
    experiment = Experiment(
        robot=["puma560"],
        task=["pick_and_place", "spot_weld", "arc_weld"],
        axis=[[2]],
        effect=["backlash"],
        schedule=[0.002] * 2,
        cycles=2,
        sensors="thesis",
        seed=3,
        paired=True,
    )
    faultgen.generate(experiment, tmp_path / "data", workers=2, progress=False)
    runs = faultgen.open_dataset(tmp_path / "data").runs
    for name, worn in (("healthy", False), ("worn", True)):
        own = [run.path for run in runs if (int(run["axis"]) > 0) == worn]
        write_recording(recording_of(own), tmp_path / f"{name}.h5")
    result, effects = against_healthy(tmp_path, "puma560", "worn")
    assert (result["verdict"], effects) == ("named", [("backlash", 2)])
    assert result["effects"][0]["parameters"]["severity"] == pytest.approx(0.002, rel=0.02)


@pytest.mark.slow
def test_a_recording_is_its_own_healthy_baseline(shared, tiny_robot_path):
    """Nothing is missing between two equal recordings, though they have no noise apart."""
    result = faultgen.discover(shared / "healthy.h5", tiny_robot_path, shared / "healthy.h5")
    assert (result["verdict"], result["effects"]) == ("no missing effect", [])


@pytest.mark.slow
def test_gap_and_validation_are_the_same_on_the_same_motions(measured, tiny_robot_path, tmp_path):
    """The motion that is kept for scoring, and a file of that motion alone, without a baseline."""
    cycles = [measured([("torque_offset", 1, 0.05)], seed) for seed in (3, 4, 5)]
    count = len(cycles[0].torque)
    names = ("position", "torque", "reference_position")
    together = replace(
        cycles[0],
        **{name: np.concatenate([getattr(one, name) for one in cycles]) for name in names},
        segments=(0, count, 2 * count),
    )
    write_recording(together, tmp_path / "measured.h5")
    write_recording(cycles[-1], tmp_path / "other.h5")
    result = faultgen.discover(
        tmp_path / "measured.h5", tiny_robot_path, validate=tmp_path / "other.h5"
    )
    gap = result["gap"]
    assert [(one["effect"], one["axis"]) for one in result["effects"]] == [("torque_offset", 1)]
    # each is relative to the torque of its whole recording, of which the noise differs
    for name in ("before", "after"):
        assert gap["validation"][name] == pytest.approx(gap[name], rel=1e-3)
    assert gap["floor"] <= gap["after"] < 0.7 * gap["before"]


def test_a_gain_of_the_log_is_named_once(files, tiny_robot_path, tmp_path):
    """The equation of the servo finds it; the search that follows gets the corrected log."""
    clean = read_recording(files / "clean.h5")
    torque = clean.torque * [1.15, 1.0]
    write_recording(replace(clean, torque=torque), tmp_path / "gain.h5")
    result = faultgen.discover(
        tmp_path / "gain.h5", tiny_robot_path, files / "healthy.h5", tmp_path / "gain.h5"
    )
    (found,) = result["effects"]
    assert (found["effect"], found["axis"], result["verdict"]) == ("torque_constant", 1, "named")
    assert found["parameters"]["severity"] == pytest.approx(1 - 1 / 1.15, abs=3e-3)
    (line,) = (one for one in result["findings"] if "times what the servo makes" in one)
    assert "gain.h5: corrected: axis 1" in line and line in result["warnings"]
    gap = result["gap"]
    assert gap["after"] < 0.5 * gap["before"] and found["gap_after"] < 0.5 * gap["before"]
    assert gap["validation"]["after"] < 0.7 * gap["validation"]["before"]


@pytest.mark.slow
def test_what_was_found_is_kept_where_a_later_stage_fails(
    files, tiny_robot_path, tmp_path, monkeypatch
):
    """Motions that cannot be scored, and a page that cannot be drawn."""
    recording = read_recording(files / "clean.h5")
    still = {name: 0 * getattr(recording, name) for name in ("position", "reference_position")}
    write_recording(replace(recording, **still), tmp_path / "still.h5")
    result = discovered(files, tiny_robot_path, "worn", validate=tmp_path / "still.h5")
    assert result["gap"]["validation"] is None
    assert any("still.h5: not scored" in line for line in result["warnings"])

    def fails(*_):
        raise RuntimeError("no figure")

    monkeypatch.setattr(discovery_report, "discovery_page", fails)
    with pytest.raises(RuntimeError, match="no figure"):
        discovered(files, tiny_robot_path, "worn", out=tmp_path / "out")
    kept = json.loads((tmp_path / "out" / "discovery.json").read_text())
    assert kept["effects"] == result["effects"]
    assert load_robot(tmp_path / "out" / "model.xml").n_axes == 2

"""What loggers write beside numbers: other columns, footers, marks of missing values, turns."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from test_importing import COUNT, GENERIC, PERIOD, RUN, changed, check, generic, imported, write_csv

from faultgen.discovery import check_recording
from faultgen.errors import InputError
from faultgen.importing.oddities import dropouts


def rows_of(path):
    return path.read_text().splitlines()


@pytest.mark.parametrize(
    "text",
    ["24.11.2026 10:15:03", "11/24/2026 10:15 AM", "line 12 0x1 3 4", "10:15:03", "ready, 3 of 4"],
)
def test_a_text_in_a_column_that_nobody_reads_does_not_matter(tmp_path, text):
    """Dates and remarks, also if they have numbers and blanks."""
    log = write_csv(tmp_path / "log.csv", {"note": [text] * COUNT, **generic()}, separator=";")
    check(imported(log, GENERIC).recording, exact=True)


def test_more_switches_or_texts_than_numbers(tmp_path):
    """TRUE and FALSE are no words; and if words prevail in every row, the rows are still found."""
    switches = {f"s{k}": ["TRUE", "FALSE"] * (COUNT // 2) for k in range(9)}
    log = write_csv(tmp_path / "log.csv", {**switches, **generic()})
    check(imported(log, GENERIC).recording, exact=True)
    words = {f"w{k}": ["idle"] * COUNT for k in range(9)}
    log = write_csv(tmp_path / "log.csv", {**words, **generic()})
    check(imported(log, GENERIC).recording, exact=True)


def test_decimal_commas_within_quotes(tmp_path):
    """A comma is both the separator and the decimal sign, as some spreadsheets write it."""
    log = write_csv(tmp_path / "log.csv", generic(), separator=";", decimal=",")
    lines = [",".join(f'"{cell}"' for cell in line.split(";")) for line in rows_of(log)]
    log.write_text("\n".join(lines))
    check(imported(log, GENERIC).recording)


def test_lines_behind_the_numbers_are_left_out_and_told(tmp_path):
    """A summary, a mark of the end; but not a last row that is only incomplete."""
    log = write_csv(tmp_path / "log.csv", generic())
    log.write_text(log.read_text() + "\nRecorded 300 samples\nEOF\n")
    made = imported(log, GENERIC)
    check(made.recording, exact=True)
    told = "lines after the rows of numbers were left out: 2, 'Recorded 300 samples'"
    assert told in made.notes
    text = log.read_text().replace("\nEOF\n", "\n" + "x\n" * 25)
    log.write_text(text)
    with pytest.raises(InputError, match="which is no number|has 1 columns"):
        imported(log, GENERIC)


def test_lines_between_names_and_numbers(tmp_path):
    """Some programs write properties of the channels there, of which some are numbers."""
    log = write_csv(tmp_path / "log.csv", generic())
    names, *rows = rows_of(log)
    log.write_text(
        "\n".join([names, "Type,REAL,REAL,REAL,REAL", "Size,8,8,8,8", "On,1,1,1,1", *rows])
    )
    with pytest.raises(InputError, match="the line of the first row of numbers .first."):
        imported(log, changed(file={"header": 1}))
    check(imported(log, changed(file={"header": 1, "first": 5})).recording, exact=True)
    with pytest.raises(InputError, match="file.first is 900, but no row stands there"):
        imported(log, changed(file={"header": 1, "first": 900}))


def test_columns_of_one_name_are_numbered(tmp_path):
    """They do not matter where nobody reads them; the map can name each."""
    named = generic()
    log = write_csv(tmp_path / "log.csv", {"x": RUN.time, "y": RUN.time, **named})
    names, *rows = rows_of(log)
    log.write_text("\n".join([names.replace("y", "x"), *rows]))
    check(imported(log, GENERIC).recording, exact=True)
    again = changed(time={"column": "x (2)", "unit": "s"})
    check(imported(log, again).recording, exact=True)


def test_lists_in_cells_are_refused_with_the_reason(tmp_path):
    log = tmp_path / "log.csv"
    log.write_text("t;q\n" + "\n".join(f"{t};[0.1, 0.2, 0.3]" for t in range(9)))
    with pytest.raises(InputError, match="cells that hold lists of numbers; write one column for"):
        imported(log, GENERIC)


def test_a_row_for_each_joint_is_told(tmp_path):
    """Such a log would have one axis, with the numbers of all joints in turn."""
    named = {"t": np.repeat(RUN.time, 2), "q1": RUN.position.ravel(), "u1": RUN.torque.ravel()}
    log = write_csv(tmp_path / "log.csv", named)
    with pytest.raises(InputError, match="state the column that names the joint as axes.column"):
        imported(log, GENERIC)


# numbers that are none


def with_cells(values, column, rows, mark):
    changed = values.copy()
    changed[rows, column] = mark
    return changed


@pytest.mark.parametrize("mark", [-9999.0, 99999.0, 65535.0, -2147483648.0])
def test_usual_marks_of_missing_values_are_no_numbers(tmp_path, mark):
    """Such rows are missing, as rows with blank cells are; the mark and its place are told."""
    run = with_cells(RUN.torque, 1, [40, 41], mark)
    log = write_csv(tmp_path / "log.csv", {**generic(), "u2": run[:, 1]})
    made = imported(log, GENERIC)
    assert np.abs(made.recording.torque - RUN.torque).max() < 0.01  # interpolated there
    assert any(
        f"2 cells with {mark:g} count as missing, the first is line 42" in n for n in made.notes
    )
    if abs(mark) < 1e9:  # no recording has larger torques
        kept = imported(log, changed(file={"missing": []})).recording
        assert kept.torque[40, 1] == mark


def test_marks_that_could_be_numbers_are_numbers(tmp_path):
    """999 N m among 400 N m; unless the map says that it stands for a missing value."""
    big = 20 * RUN.torque
    log = write_csv(tmp_path / "log.csv", {**generic(), "u1": with_cells(big, 0, [9], 999.0)[:, 0]})
    assert imported(log, GENERIC).recording.torque[9, 0] == 999.0
    made = imported(log, changed(file={"missing": [999.0]}))
    assert made.recording.torque[9, 0] == pytest.approx(big[9, 0], rel=1e-3)


def test_rows_of_zeros_between_others_are_missing(tmp_path):
    """A logger that lost the connection; a robot that rests at zero is something else."""
    lost = {name: values.copy() for name, values in generic().items()}
    for name in ("q1", "q2", "u1", "u2"):
        lost[name][100:102] = 0.0
    made = imported(write_csv(tmp_path / "log.csv", lost), GENERIC)
    np.testing.assert_allclose(made.recording.position, RUN.position, atol=1e-4)
    assert any("rows in which every value is 0 were left out: 2" in note for note in made.notes)


def test_a_robot_that_rests_at_zero_is_no_dropout():
    """It gets there and leaves in steps like the others; more zeros than a fifth are believed."""
    time = np.linspace(0, 1, 400)
    position = np.clip(np.abs(time - 0.5) - 0.05, 0, None)[:, None]
    assert not dropouts([position, position]).any()
    position[200:] = 0.0
    assert not dropouts([position + (position > 0), position]).any()


@pytest.mark.parametrize("kept", ["0 to 360", "-180 to 180"])
def test_angles_that_start_again_are_continued(tmp_path, kept):
    """Within a turn, as many controllers log joints; the angle is the one closest to zero."""
    angle = RUN.position * 2.5 + [1.5, -1.0]  # the first passes 180 degrees, the second 0
    logged = np.degrees(angle) % 360
    if kept == "-180 to 180":
        logged = (logged + 180) % 360 - 180
    named = {**generic(), "q1": logged[:, 0], "q2": logged[:, 1]}
    log = write_csv(tmp_path / "log.csv", named)
    made = imported(log, changed(position={"columns": "q{axis}", "unit": "deg"}))
    np.testing.assert_allclose(made.recording.position, angle, atol=1e-9)
    assert sum("jumps by a whole turn" in note for note in made.notes) == 1


def test_other_jumps_are_left_to_the_checks(tmp_path):
    """A glitch of half a turn, and steps so large that a whole turn means nothing."""
    glitch = {**generic(), "q1": with_cells(RUN.position, 0, [50], 4.0)[:, 0]}
    made = imported(write_csv(tmp_path / "log.csv", glitch), GENERIC)
    assert made.recording.position[50, 0] == 4.0
    fast = {**generic(), "q1": 8 * np.sin(200 * RUN.time)}
    made = imported(write_csv(tmp_path / "log.csv", fast), GENERIC)
    np.testing.assert_array_equal(made.recording.position[:, 0], fast["q1"])
    assert made.recording.sample_period == pytest.approx(PERIOD)


@pytest.mark.parametrize(("turns", "told"), [(1, "-1 turn is added"), (-2, "+2 turn is added")])
def test_a_recording_a_turn_away_from_the_model_is_told(measured, tiny_robot, turns, told):
    """Recordings that were made without `import`: the turns are subtracted, and told."""
    recording = measured([], 1)
    assert not check_recording(recording, tiny_robot)
    position = recording.position + 2 * np.pi * turns * tiny_robot.gear_ratio * np.array([1, 0])
    moved = replace(recording, position=position, reference_position=None)
    (finding,) = (one for one in check_recording(moved, tiny_robot) if one.level == "corrected")
    assert told in finding.message


def test_a_wrapped_recording_is_told_to_be_one(measured, tiny_robot):
    """Not as a gap, which would need a new segment."""
    recording = measured([], 1)
    turn = 2 * np.pi * tiny_robot.gear_ratio * np.array([0, 1])
    position = recording.position + turn * (np.arange(len(recording.position)) > 500)[:, None]
    found = check_recording(replace(recording, position=position), tiny_robot)
    (one,) = found
    assert one.level == "corrected" and "starts again after a whole turn" in one.message


@pytest.mark.parametrize(
    ("form", "told"),
    [
        ("%d.%m.%Y %H:%M:%S.%f", "%d.%m.%Y %H:%M:%S.%f"),
        ("%m/%d/%Y %I:%M:%S.%f %p", "%m/%d/%Y %I:%M:%S.%f %p"),
        ("%d-%b-%Y %H:%M:%S,%f", "%d-%b-%Y %H:%M:%S.%f"),
        ("%H:%M:%S.%f", "hours:minutes:seconds"),
        ("%Y-%m-%d %H:%M:%S.%f", None),
    ],
)
def test_times_as_programs_and_countries_write_them(tmp_path, form, told):
    """Only the time since the first row counts, so that days and months may be exchanged."""
    start = pd.Timestamp("2026-11-24 09:59:59.500")
    times = [(start + pd.Timedelta(t, "s")).strftime(form) for t in RUN.time]
    log = write_csv(tmp_path / "log.csv", {**generic(), "t": times}, separator=";")
    made = imported(log, changed(time={"column": "t", "unit": "iso"}))
    check(made.recording)
    assert [n for n in made.notes if "times were read" in n] == (
        [f"the times were read as {told}"] if told else []
    )

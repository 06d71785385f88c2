"""Logs as people have them: rows for joints, several clocks, restarts, programs, LabVIEW, Scope.

Each is written in the form of its program, and must give the numbers that were written.
"""

import json

import numpy as np
import pytest
from conftest import faultgen_here
from test_importing import COUNT, GENERIC, PERIOD, RUN, changed, check, generic, imported, write_csv

from faultgen.discovery import read_recording
from faultgen.errors import InputError
from faultgen.importing import map_of
from faultgen.recordings.import_log import import_log

JOINTS = ("shoulder", "elbow")
LONG = {
    "side": "joint",
    "time": {"column": "time", "unit": "s"},
    "axes": {"column": "joint"},
    "position": {"columns": "position", "unit": "rad"},
    "torque": {"columns": "effort", "unit": "Nm"},
}


def rows_of_joints(late=0.0):
    """A row for each joint and time; the second joint may be later."""
    for k, time in enumerate(RUN.time.tolist()):
        for axis, joint in enumerate(JOINTS):
            yield {
                "time": time + late * axis,
                "joint": joint,
                "position": float(np.sin((2 + axis) * (time + late * axis))),
                "effort": float(RUN.torque[k, axis]),
            }


@pytest.mark.parametrize("kind", ["csv", "jsonl"])
def test_a_row_for_each_joint(tmp_path, kind):
    """The joints are in the order in which they appear, or in that of axes.names."""
    log = tmp_path / f"log.{kind}"
    if kind == "csv":
        named = {name: [row[name] for row in rows_of_joints()] for name in next(rows_of_joints())}
        named["joint"] = np.array(named["joint"], object)
        write_csv(log, named)
    else:
        log.write_text("\n".join(map(json.dumps, rows_of_joints())))
    made = imported(log, LONG)
    check(made.recording, exact=True)
    assert any("each joint has a row of its own" in note for note in made.notes)
    turned = imported(log, {**LONG, "axes": {"column": "joint", "names": ["elbow", "shoulder"]}})
    np.testing.assert_array_equal(turned.recording.position, RUN.position[:, ::-1])


def test_joints_with_times_of_their_own_are_interpolated(tmp_path):
    log = tmp_path / "log.jsonl"
    log.write_text("\n".join(map(json.dumps, rows_of_joints(late=0.001))))
    recording = imported(log, LONG).recording
    count = len(recording.position)
    assert count == COUNT - 1  # the second joint has no sample before the first one of the first
    np.testing.assert_allclose(recording.position, RUN.position[1:], atol=2e-5)


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ({"axes": {"column": "link"}}, r"no column 'link' for \[axes.column\]"),
        ({"axes": {"column": "joint", "names": ["wrist"]}}, "no row has the joint 'wrist'"),
        ({"position": {"columns": "q{axis}"}}, "position.columns: give the name of one column"),
        ({"axes": {}}, "lacks {axis}.* state the column that names the joint as axes.column"),
    ],
)
def test_wrong_maps_of_rows_for_joints(tmp_path, entries, message):
    log = tmp_path / "log.jsonl"
    log.write_text("\n".join(map(json.dumps, rows_of_joints())))
    with pytest.raises(InputError, match=message):
        imported(log, {**LONG, **entries})


@pytest.mark.parametrize(
    ("record", "position", "torque"),
    [
        (lambda q, u: {"state": {"q": q, "tau": u}}, "state.q_{axis}", "state.tau_{axis}"),
        (
            lambda q, u: {"joints": [{"q": a, "tau": b} for a, b in zip(q, u, strict=True)]},
            "joints_{axis}.q",
            "joints_{axis}.tau",
        ),
    ],
)
def test_nested_json_lines(tmp_path, record, position, torque):
    log = tmp_path / "log.jsonl"
    values = zip(RUN.time.tolist(), RUN.position.tolist(), RUN.torque.tolist(), strict=True)
    log.write_text("\n".join(json.dumps({"t": t, **record(q, u)}) for t, q, u in values))
    made = imported(log, changed(position={"columns": position}, torque={"columns": torque}))
    check(made.recording, exact=True)


# clocks that start again, and programs


def test_a_clock_that_starts_again_begins_a_segment(tmp_path):
    """A logger was restarted, and wrote the line of its names again."""
    named = generic()
    named["t"] = np.concatenate([RUN.time[:180], RUN.time[: COUNT - 180]])
    log = write_csv(tmp_path / "log.csv", named)
    made = imported(log, GENERIC)
    assert made.recording.segments == (0, 180) and made.gaps == ()
    np.testing.assert_array_equal(made.recording.position, RUN.position)
    assert any("the clock starts again once, first in line 182" in note for note in made.notes)
    lines = log.read_text().splitlines()
    log.write_text("\n".join([*lines[:181], lines[0], *lines[181:]]))
    again = imported(log, GENERIC)
    assert again.recording.segments == (0, 180)
    assert "the line of the names is repeated once, and was left out" in again.notes


def test_rows_that_are_not_sorted_are_refused(tmp_path):
    """Two rows that changed places, and rows in any order, are no restart."""
    order = np.arange(COUNT)
    order[[100, 101]] = [101, 100]
    for rows in (order, np.random.default_rng(0).permutation(COUNT)):
        named = {name: values[rows] for name, values in generic().items()}
        log = write_csv(tmp_path / "log.csv", named)
        with pytest.raises(InputError, match="the time goes back in line .*; sort the log"):
            imported(log, GENERIC)


def test_programs_of_one_file(tmp_path):
    """All rows with a segment for each visit, or those of one program."""
    program = np.where(np.arange(COUNT) // 75 % 2, "PickB", "MainA").astype(object)
    log = write_csv(tmp_path / "log.csv", {"prog": program, **generic()})
    content = changed(program="prog")
    whole = imported(log, content)
    assert whole.recording.segments == (0, 75, 150, 225)
    assert any("2 programs: MainA (150 rows), PickB (150 rows)" in note for note in whole.notes)
    one = import_log(log, map_of(content), "PickB").recording
    assert one.segments == (0, 75)
    np.testing.assert_array_equal(one.position, RUN.position[program == "PickB"])
    with pytest.raises(InputError, match="no row has the program 'C'; there are 'MainA', 'PickB'"):
        import_log(log, map_of(content), "C")
    with pytest.raises(InputError, match="--program C: state the column with the name of the"):
        import_log(log, map_of(GENERIC), "C")
    (tmp_path / "map.toml").write_text(
        'side = "joint"\nprogram = "prog"\ntime = {column = "t", unit = "s"}\n'
        'position = {columns = "q{axis}", unit = "rad"}\ntorque = {columns="u{axis}", unit="Nm"}\n'
    )
    options = ("--map", "map.toml", "--program", "MainA", "-o", "a.h5")
    done = faultgen_here("import", "log.csv", *options, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert len(read_recording(tmp_path / "a.h5").position) == 150


@pytest.mark.parametrize(
    ("unit", "factor"), [("%", 100), ("permille", 1000), ("0.1 %", 1000), ("‰", 1000)]
)
def test_shares_of_a_rated_torque(tmp_path, unit, factor):
    rated = np.array([40.0, 25.0])
    named = generic() | {f"u{k + 1}": factor * RUN.torque[:, k] / rated[k] for k in range(2)}
    log = write_csv(tmp_path / "log.csv", named)
    made = imported(log, changed(torque={"unit": unit, "rated": rated.tolist()}))
    check(made.recording)
    with pytest.raises(InputError, match=r"state torque.rated in the map, which is 100 % in"):
        imported(log, changed(torque={"unit": unit}))


# LabVIEW


def write_lvm(path, x_columns="One", decimal=".", blocks=2, apart=0.6):
    """A measurement file as LabVIEW writes it, with blocks that begin some seconds apart."""
    count = COUNT // blocks
    lines = [
        "LabVIEW Measurement\t",
        *("Writer_Version\t2", "Reader_Version\t2", "Separator\tTab"),
        f"Decimal_Separator\t{decimal}",
        *("Multi_Headings\tYes", f"X_Columns\t{x_columns}", "Time_Pref\tAbsolute"),
        *("Date\t2026/03/05", "Time\t10:11:12.5", "***End_of_Header***\t", "\t"),
        *("***Start_Special***\t", "Note\t3\t4", "***End_Special***\t"),
    ]
    channels = np.hstack([RUN.position, RUN.torque])
    names = ["q1", "q2", "u1", "u2"]
    for block in range(blocks):
        second = f"{12.5 + apart * block:.7f}".replace(".", decimal)
        for key, value in (
            ("Channels", "4"),
            ("Samples", count),
            ("Date", "2026/03/05"),
            ("Time", f"10:11:{second}"),
            ("X_Dimension", "Time"),
            ("X0", "0.0E+0".replace(".", decimal)),
            ("Delta_X", str(PERIOD).replace(".", decimal)),
        ):
            # each value stands above the column of its channel
            between = "\t\t" if x_columns == "Multi" else "\t"
            several = between.join([str(value)] * (1 if key == "Channels" else 4))
            lines.append(f"{key}\t{several}\t")
        lines.insert(-3, "Y_Unit_Label\t" + between.join(["rad", "rad", "Nm", "Nm", ""]))
        lines.append("***End_of_Header***\t\t\t\t\t")
        if x_columns == "Multi":
            lines.append("\t".join([cell for name in names for cell in ("X_Value", name)]))
        else:
            lines.append("\t".join(["X_Value" if x_columns == "One" else "", *names, "Comment"]))
        for k in range(count):
            clock = repr(round(PERIOD * k, 6))
            values = [repr(float(one)) for one in channels[block * count + k]]
            if x_columns == "Multi":
                cells = [cell for value in values for cell in (clock, value)]
            else:
                cells = [clock if x_columns == "One" else "", *values, ""]
            lines.append("\t".join(cells).replace(".", decimal))
        lines.append("")
    path.write_text("\r\n".join(lines))
    return path


LVM = {
    "side": "joint",
    "time": {"column": "X_Value"},
    "position": {"columns": "q{axis}"},
    "torque": {"columns": "u{axis}"},
}


@pytest.mark.parametrize("x_columns", ["One", "Multi", "No"])
@pytest.mark.parametrize("decimal", [".", ","])
def test_labview(tmp_path, x_columns, decimal):
    """Units and times come from the headers of the blocks, which follow each other here."""
    log = write_lvm(tmp_path / "log.lvm", x_columns, decimal)
    made = imported(log, LVM)
    check(made.recording)
    assert made.recording.segments == (0,)
    even = imported(log, {**LVM, "time": {"sample_period": PERIOD}})
    check(even.recording)
    apart = imported(write_lvm(tmp_path / "log.lvm", x_columns, decimal, apart=1.0), LVM)
    assert apart.recording.segments == (0, 150) and apart.gaps == pytest.approx([0.404])


def test_units_behind_the_names_of_structured_logs(tmp_path):
    """Maps name columns without their units, whatever the kind of the file."""
    log = write_lvm(tmp_path / "log.lvm")
    text = log.read_text().replace("Y_Unit_Label", "Nothing")
    for name, unit in (("q1", "rad"), ("q2", "rad"), ("u1", "Nm"), ("u2", "N·m")):
        text = text.replace(f"\t{name}", f"\t{name} [{unit}]")
    log.write_text(text)
    check(imported(log, LVM).recording)
    rows = zip(RUN.time.tolist(), RUN.position.tolist(), RUN.torque.tolist(), strict=True)
    log = tmp_path / "log.jsonl"
    named = {"q1 [rad]": (1, 0), "q2 [rad]": (1, 1), "u1 [Nm]": (2, 0), "u2 [Nm]": (2, 1)}
    log.write_text(
        "\n".join(
            json.dumps({"X_Value [s]": row[0]} | {k: row[i][j] for k, (i, j) in named.items()})
            for row in rows
        )
    )
    check(imported(log, LVM).recording, exact=True)


@pytest.mark.parametrize(
    ("harm", "message"),
    [
        (lambda text: text[: text.index("Channels")], "without the header of a block"),
        (lambda text: "\n".join(text.splitlines()[:25]), "has no rows of numbers"),
        (lambda text: text.replace("q2\tu1", "u1\tu1", 1), "two channels have the same name"),
        (lambda text: text.replace("0.02", "x.02"), "block 1 has cells that are no numbers"),
        (lambda text: "q3".join(text.rsplit("q2", 1)), "block 2 has other channels"),
    ],
)
def test_damaged_labview_files(tmp_path, harm, message):
    log = write_lvm(tmp_path / "log.lvm")
    log.write_text(harm(log.read_text()))
    with pytest.raises(InputError, match=message) as error:
        imported(log, LVM)
    assert "\n" not in str(error.value)


# TwinCAT Scope

SCOPE = {
    "side": "joint",
    "time": {"column": "Time"},
    "position": {"columns": "Axis{axis}.ActPos", "unit": "rad"},
    "torque": {"columns": "Axis{axis}.ActTorque", "unit": "Nm"},
}


def write_scope(path, timelines="All", separator="\t", decimal=".", full=False):
    """An export with torques that are sampled twice as often as positions, and begin 6 ms later."""
    fine = PERIOD / 2 * np.arange(2 * COUNT) + 0.006
    rate = np.array([2.0, 3.0])
    torque = np.array([20.0, -8.0]) * np.cos(rate * fine[:, None]) + [1.0, 2.0]
    channels = [
        *[(f"Axis{k + 1}.ActPos", 4, RUN.time, RUN.position[:, k]) for k in range(2)],
        *[(f"Axis{k + 1}.ActTorque", 2, fine, torque[:, k]) for k in range(2)],
    ]
    shared = timelines == "For each sampletime"
    has_clock = [not (shared and k % 2) for k in range(4)]

    def clock(time):
        return str(133_500_000_000_000_000 + round(1e7 * time)) if full else f"{1000 * time:g}"

    lines = ["Name\tProject", "File\tC:\\arm.svdx", "Starttime of export\t1\tMonday", ""]
    for title, values in (
        ("Name", [one[0] for one in channels]),
        ("SymbolComment", [""] * 4),
        ("Data-Type", ["REAL64"] * 4),
        ("SampleTime[ms]", [str(one[1]) for one in channels]),
    ):
        cells = [[title, v] if c else [v] for v, c in zip(values, has_clock, strict=True)]
        lines.append("\t".join(sum(cells, [])))
    lines.append("")
    for row in range(2 * COUNT):
        cells = []
        for (_, _, time, values), own in zip(channels, has_clock, strict=True):
            there = row < len(time)
            value = [repr(float(values[row])).replace(".", decimal) if there else ""]
            cells += [clock(time[row]).replace(".", decimal) if there else "", *value][not own :]
        lines.append("\t".join(cells))
    path.write_text("\n".join([*lines, "EOF", ""]).replace("\t", separator))
    return path


@pytest.mark.parametrize("timelines", ["All", "For each sampletime"])
@pytest.mark.parametrize(("separator", "decimal"), [("\t", "."), (";", ","), (",", ".")])
@pytest.mark.parametrize("full", [False, True])
def test_twincat_scope(tmp_path, timelines, separator, decimal, full):
    """The torque is interpolated at the times of the positions, without an entry of the map."""
    log = write_scope(tmp_path / "log.csv", timelines, separator, decimal, full)
    made = imported(log, SCOPE)
    recording = made.recording
    assert recording.sample_period == pytest.approx(PERIOD)
    rows = slice(2, None)  # from the first torque on
    np.testing.assert_allclose(recording.position, RUN.position[rows], atol=1e-9)
    np.testing.assert_allclose(recording.torque, RUN.torque[rows], atol=1e-3)
    assert any("torque has times of its own" in note for note in made.notes)


def test_twincat_scope_with_a_short_header_and_names_that_repeat(tmp_path):
    """The header may have the names only; where they repeat, those of the symbols are used."""
    log = write_scope(tmp_path / "log.csv")
    lines = log.read_text().splitlines()
    log.write_text("\n".join([*lines[:5], *lines[8:]]))
    assert imported(log, SCOPE).recording.n_axes == 2
    short = lines[4].replace("Axis1.", "").replace("Axis2.", "")
    symbols = lines[4].replace("Name", "SymbolName")
    log.write_text("\n".join([*lines[:4], short, symbols, *lines[5:]]))
    assert imported(log, SCOPE).recording.n_axes == 2


def test_twincat_scope_without_times(tmp_path):
    log = write_scope(tmp_path / "log.csv")
    lines = log.read_text().splitlines()
    rows = ["\t".join(line.split("\t")[1::2]) for line in lines[9:]]
    log.write_text("\n".join([*lines[:9], *rows]))
    with pytest.raises(InputError, match="without columns of times .*; export it with Timelines"):
        imported(log, SCOPE)

"""A watched folder: no recording is lost, whatever happens to files and disks meanwhile."""

import errno
import inspect
import multiprocessing
from contextlib import suppress
from pathlib import Path

import h5py
import numpy as np
import pytest

import faultgen.twin.judge as judging
import faultgen.twin.state as states
from faultgen.cli.twin import judge
from faultgen.discovery import Recording, write_recording
from faultgen.errors import InputError, StorageFailed
from faultgen.recordings.read import is_complete, read_recording
from faultgen.twin.judge import Judge
from faultgen.twin.state import State, StateFailed
from faultgen.twin.watching import PAUSE, SETTLED, Watch

HEAD = "time,joint_position_1,joint_torque_1\n"


@pytest.fixture
def whole(tmp_path):
    """Bytes of an HDF5 recording with a checksum."""
    values = np.random.default_rng(0).normal(size=(400, 1))
    recording = Recording(
        source="new", robot="arm", side="joint", sample_period=0.01, position=values, torque=values
    )
    write_recording(recording, tmp_path / "whole.h5")
    return (tmp_path / "whole.h5").read_bytes()


class Inbox:
    """A watched folder whose recordings are only read, and what was told of it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir()
        self.told: list[tuple[str, float]] = []
        self.complaints: list[str] = []
        self.watch = Watch(
            lambda path: self.judge(path),
            folder,
            lambda one: self.told.append(one["told"]),
            self.complaints.append,
        )

    def judge(self, path):
        """Read a recording."""
        torque = read_recording(path).torque
        return {"again": False, "told": (path.name, float(torque[-1, 0]), len(torque))}

    def look(self, times=1):
        """Look into the folder."""
        for _ in range(times):
            self.watch.look()


@pytest.fixture
def inbox(tmp_path):
    return Inbox(tmp_path / "inbox")


LOOKS = int(SETTLED / PAUSE) + 1
"""Looks until a file that does not change is judged."""


def table(rows):
    return HEAD + "".join(f"{k / 100},{k},{k}\n" for k in range(rows))


def test_a_complete_recording_is_judged_at_once(inbox, whole):
    """Its checksum shows that nothing is missing, so it need not wait."""
    (inbox.folder / "new.h5").write_bytes(whole)
    inbox.look()
    assert [one[0] for one in inbox.told] == ["new.h5"]
    inbox.look(10)
    assert len(inbox.told) == 1 and not inbox.complaints


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.999])
def test_a_copy_that_pauses_is_judged_when_it_is_complete(inbox, whole, share):
    """A pause of two looks is no end; after a longer one, the file is tried again."""
    path = inbox.folder / "new.h5"
    for pause in (2, 8):
        path.write_bytes(whole[: int(share * len(whole))])
        inbox.look(1 + pause)
        assert not inbox.told and len(inbox.complaints) == (pause == 8)
    path.write_bytes(whole)
    inbox.look()
    assert len(inbox.told) == 1


def test_a_table_that_pauses_is_not_judged_truncated(inbox):
    """90 % of the rows, a pause of two looks, and the rest: one answer, about all rows."""
    path = inbox.folder / "new.csv"
    path.write_text(table(90))
    inbox.look(3)
    with path.open("a") as file:
        file.write(table(100)[len(table(90)) :])
    inbox.look(LOOKS)
    assert inbox.told == [("new.csv", 99.0, 100)] and not inbox.complaints


def test_a_preallocated_file_is_judged_when_it_is_filled(inbox, whole):
    """Zeros of the final size, and then the content with the same size."""
    path = inbox.folder / "new.h5"
    path.write_bytes(bytes(len(whole)))
    inbox.look(LOOKS)
    assert len(inbox.complaints) == 1 and "new.h5" in inbox.complaints[0]
    with path.open("r+b") as file:
        file.write(whole[: len(whole) // 2])
        file.flush()
        inbox.look()
        file.write(whole[len(whole) // 2 :])
    inbox.look()
    assert len(inbox.told) == 1


def test_a_recording_of_another_program_waits(inbox, whole):
    """Without a checksum, a file is judged when it has not changed for the stated time."""
    path = inbox.folder / "own.h5"
    path.write_bytes(whole)
    with h5py.File(path, "r+") as file:
        del file.attrs["content_sha256"]
    inbox.look(LOOKS - 1)
    assert not inbox.told
    inbox.look()
    assert len(inbox.told) == 1


def test_a_new_recording_under_the_same_name_is_judged(inbox):
    """Also if it has the same size; one that is removed and comes back counts as new."""
    path = inbox.folder / "latest.csv"
    for last in (3, 5, 7):
        path.write_text(table(8) + f"0.08,9,{last}\n")
        inbox.look(LOOKS)
    path.unlink()
    inbox.look()
    path.write_text(table(8) + "0.08,9,8\n")
    inbox.look(LOOKS)
    assert [one[1] for one in inbox.told] == [3.0, 5.0, 7.0, 8.0]


def test_a_file_that_cannot_be_read_is_told_once_and_tried_again(inbox):
    """A line for each content that is wrong, and none for looks in between."""
    path = inbox.folder / "bad.csv"
    path.write_text("time,x\n1,2\n")
    inbox.look(3 * LOOKS)
    assert len(inbox.complaints) == 1
    path.write_text(table(20))
    inbox.look(LOOKS)
    assert inbox.told == [("bad.csv", 19.0, 20)]


def test_failing_disks_are_told_and_tried_again(inbox, whole, monkeypatch):
    """The folder, a read and the state fail for a while; each is one line, and nothing is lost."""
    (inbox.folder / "new.h5").write_bytes(whole)
    usual, judge = Path.iterdir, inbox.judge
    failing = OSError(errno.EIO, "Input/output error")

    def fails(*_):
        raise failing

    monkeypatch.setattr(Path, "iterdir", fails)
    inbox.look(5)
    assert inbox.complaints == [
        f"{inbox.folder}: cannot be read (Input/output error); trying again"
    ]
    monkeypatch.setattr(Path, "iterdir", usual)
    for error in (StorageFailed("state.json: cannot be written (disk full)"), StateFailed("busy")):
        inbox.complaints.clear()

        def full(_, error=error):
            raise error

        inbox.judge = full
        inbox.look(3)
        assert inbox.complaints == [f"{error}; trying again"]
    inbox.judge = judge
    inbox.look()
    assert len(inbox.told) == 1


def test_a_failing_read_is_a_failing_disk(whole, tmp_path, monkeypatch):
    """An error of the disk in HDF5 is told from a damaged file."""
    path = tmp_path / "new.h5"
    path.write_bytes(whole)

    def fails(*_):
        raise OSError(errno.EIO, "Can't read data (file read failed: errno = 5)")

    monkeypatch.setattr("faultgen.recordings.read.read_hdf5", fails)
    with pytest.raises(StorageFailed, match=r"new.h5: cannot be read \(Input/output error\)"):
        read_recording(path)
    assert not is_complete(path)


ANSWER = {"verdict": "healthy", "sha256": "0" * 64}


def keep(state, sha256, date=0.0):
    """Add a recording."""
    with state.held() as stream:
        stream.keep(sha256, date, np.array([date]), {**ANSWER, "sha256": sha256})


def answers(state):
    with state.held() as stream:
        return stream.answers()


def test_what_fails_while_a_state_is_held_changes_nothing(tmp_path):
    """So that the same recording can be judged again."""
    state = State(tmp_path / "state.sqlite", "key", 1)
    keep(state, "a")
    with pytest.raises(RuntimeError), state.held() as stream:
        stream.keep("b", 1.0, np.zeros(1), ANSWER)
        raise RuntimeError
    assert [one["sha256"] for one in answers(state)] == ["a"]


def test_a_state_that_cannot_be_written_says_so(tmp_path):
    with pytest.raises(StorageFailed, match=r"state.sqlite: cannot be written"):
        keep(State(tmp_path / "missing" / "state.sqlite", "key", 1), "a")


def test_a_repair_is_known_from_its_date_on(tmp_path):
    state = State(tmp_path / "state.sqlite", "key", 1)
    for day in range(6):
        keep(state, str(day), float(day))
    with state.held() as stream:
        stream.repaired(2.5)
        for until, first in ((2.0, 0), (4.0, 3), (5.0, 3)):
            dates, scores = stream.since_repair(until)
            assert dates.tolist() == list(range(first, int(until) + 1))
            assert scores[:, 0].tolist() == dates.tolist()


def _keep_many(path, first):
    for number in range(20):
        keep(State(path, "key", 1), str(first + number))


def test_two_processes_on_one_state_lose_no_answer(tmp_path):
    """Each adds 20 answers at the same time; all 40 are there."""
    context = multiprocessing.get_context("fork")
    path = tmp_path / "state.sqlite"
    both = [context.Process(target=_keep_many, args=(path, first)) for first in (0, 100)]
    for one in both:
        one.start()
    for one in both:
        one.join()
        assert one.exitcode == 0
    told = {answer["sha256"] for answer in answers(State(path, "key", 1))}
    assert told == {str(first + k) for first in (0, 100) for k in range(20)}


def test_a_state_that_is_held_for_too_long_says_so(tmp_path, monkeypatch):
    """A line, and not a wait without end."""
    monkeypatch.setattr(states, "PATIENCE", 0.1)
    path = tmp_path / "state.sqlite"
    with State(path, "key", 1).held():
        with pytest.raises(StateFailed, match="another process has held it"):
            with State(path, "key", 1).held():
                pass


def test_robots_share_a_file(tmp_path):
    """Each with its own recordings, and a detector of its own."""
    path = tmp_path / "state.sqlite"
    first, second = State(path, "key", 1, "one"), State(path, "other", 1, "two")
    keep(first, "a")
    keep(second, "a")
    assert len(answers(first)) == len(answers(second)) == 1
    with pytest.raises(StateFailed, match="belongs to another detector"):
        answers(State(path, "other", 1, "one"))


def test_no_changed_bit_of_a_state_is_used(tmp_path):
    """At many places: refused with one line that says what to do, or no answer is another one."""
    state = State(tmp_path / "state.sqlite", "key", 1)
    for day in range(3):
        keep(state, str(day), float(day))
    before, content = answers(state), state.path.read_bytes()
    rng = np.random.default_rng(0)
    for at in rng.integers(len(content), size=400).tolist():
        changed = bytearray(content)
        changed[at] ^= 1 << int(rng.integers(8))
        state.path.write_bytes(changed)
        with suppress(StateFailed, StorageFailed):
            found = answers(state)
            assert all(one in before for one in found)
    state.path.write_bytes(content)
    assert answers(state) == before


def test_a_recording_that_changes_while_it_is_read_is_not_judged(whole, tmp_path, monkeypatch):
    """Otherwise an answer would belong to a content that no file ever had."""
    path = tmp_path / "new.h5"
    path.write_bytes(whole)
    reading = read_recording

    def slow(path):
        recording = reading(path)
        path.write_bytes(whole + b"more")
        return recording

    monkeypatch.setattr(judging, "read_recording", slow)
    with pytest.raises(InputError, match="changed while it was read"):
        Judge.judge(None, path)  # type: ignore[arg-type]


@pytest.mark.parametrize("settled", [-1.0, float("nan"), float("inf")])
def test_a_time_that_is_none_is_refused(tmp_path, settled):
    """With it, no file would ever be judged, or each before it is complete."""
    with pytest.raises(InputError, match="settled: must be a number of seconds from 0 on"):
        judging.watch(None, tmp_path, print, print, lambda seconds: False, settled)


def test_the_command_waits_as_long_as_the_function():
    """The command knows the default without importing the function."""
    assert inspect.signature(judge).parameters["settled"].default == SETTLED

"""Judging recordings one after another, with a memory on disk.

judge = Judge(Path("detector"))
answer = judge.judge("new1.h5")
answer["verdict"], answer["probability"]
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from faultgen.errors import InputError, StorageFailed
from faultgen.recordings.rates import SAME_RATE
from faultgen.recordings.read import read_recording
from faultgen.recordings.recording import Recording
from faultgen.system.dates import in_words
from faultgen.system.files import file_sha256
from faultgen.twin.alignment import find_cycles
from faultgen.twin.detector import FORM, Detector, load_detector
from faultgen.twin.state import State
from faultgen.twin.warming import temperature_of
from faultgen.twin.watching import PAUSE, SETTLED, Watch, check_settled, paused

STATE = "state.sqlite"
"""File with the memory, in the detector's folder unless another one is named."""


class Judge:
    """A detector with its memory. What it has answered is kept, so that nothing counts twice.

    Several processes may use one memory: each of them holds it while it judges a recording.
    """

    def __init__(
        self,
        folder: Path,
        state: Path | None = None,
        robot: str = "",
        program: str = "",
        detector: Detector | None = None,
    ) -> None:
        """Read the detector.

        Args:
            folder: Folder of the detector.
            state: File of the memory. Default: `STATE` in this folder.
            robot: Name of the robot, if the memory holds several.
            program: Name of its program.
            detector: The detector, if it was read before.

        Raises:
            InputError: A file is missing or damaged, or the memory is that of another detector.
        """
        self.detector = detector or load_detector(folder)
        self.state = state or folder / STATE
        """File of the memory."""
        size = self.detector.posterior.effects.columns.shape[0]
        self._state = State(self.state, file_sha256(folder / FORM), size, robot, program)
        if self.state.exists():
            with self._state.held():
                pass
        self._newest = -np.inf

    @property
    def answers(self) -> list[dict[str, Any]]:
        """All answers so far, by the dates of their recordings."""
        if not self.state.exists():
            return []
        with self._state.held() as stream:
            return stream.answers()

    def latest(self) -> dict[str, Any] | None:
        """Return the answer to the recording with the latest date; None if there is none."""
        if not self.state.exists():
            return None
        with self._state.held() as stream:
            return stream.latest()

    def history(self) -> tuple[np.ndarray, np.ndarray]:
        """Return what was recorded since the last repair.

        Returns:
            Dates, shape (recordings,), in [s since 1970], and scores, shape (recordings, scores).
        """
        with self._state.held() as stream:
            return stream.since_repair(1e300)

    def judge(self, path: str | Path) -> dict[str, Any]:
        """Judge a recording with all that came before it, and remember it.

        Args:
            path: The recording (HDF5 or CSV). Its date is that which it states, or else that of the
                file. Without dates of their own, recordings that are judged one after another count
                as recorded in this order.

        Returns:
            The answer. A recording with the same content as an earlier one gets that answer again,
            with `again` set.

        Raises:
            InputError: The file is no recording of the task, or changed while it was read.
            StateFailed: The memory cannot be used now.
            StorageFailed: A file cannot be read or written. Nothing is remembered then.
        """
        path = Path(path)
        recording, digest = _read(path)
        date = self._date(path, recording)
        with self._state.held() as stream:
            known = stream.known(digest)
            if known is not None:
                return {**known, "recording": str(path), "again": True}
            _check_rate(recording, self.detector)
            cycles = find_cycles(self.in_torque(recording), self.detector.motion)
            temperature, warming = temperature_of(recording), self.detector.warming
            scores = self.detector.scores(cycles, temperature)
            dates, before = stream.since_repair(date)
            answer = self.detector.judge(np.concatenate([before, scores[None]]))
            dates = np.append(dates, date)
            answer = {
                "recording": str(path),
                "date": in_words(date),
                "cycles": len(cycles),
                "temperature": None if temperature is None else temperature.tolist(),
                **answer,
                "since": in_words(dates[answer["since"]]) if answer["alarm"] else None,
                "warning": None if warming is None else warming.doubt(temperature),
                "sha256": digest,
            }
            stream.keep(digest, date, scores, answer)
        return {**answer, "again": False}

    def repaired(self, date: float) -> None:
        """Forget what was recorded before a repair.

        Args:
            date: Of the repair [s since 1970].

        Raises:
            StateFailed: The memory cannot be used now.
            StorageFailed: It cannot be written.
        """
        with self._state.held() as stream:
            stream.repaired(date)

    def _date(self, path: Path, recording: Recording) -> float:
        if recording.date is not None:
            return recording.date
        self._newest = max(path.stat().st_mtime, self._newest)
        return self._newest

    def in_torque(self, recording: Recording) -> Recording:
        """Return a recording with the torque that the log of the model has.

        Args:
            recording: The recording, with torques or currents.

        Raises:
            InputError: It has another quantity than the detector was made from.
        """
        detector = self.detector
        if recording.link:
            raise InputError(
                f"{recording.source}: its torque sensor is behind the gearbox; the detector judges "
                "the torque of the motors"
            )
        constants = detector.constants
        if recording.current != (constants is not None):
            wanted, has = "motor_current", "torque"
            if recording.current:
                wanted, has = has, wanted
            raise InputError(
                f"{recording.source}: has {has}, but the detector was made from {wanted}"
            )
        if constants is None:
            return recording
        _check_axes(recording, detector)
        torque = constants.constant * (recording.torque - constants.offset) / detector.torque_gain
        if recording.side == "joint":
            torque = torque * detector.motion.gear_ratio
        return replace(recording, torque=torque, current=False)


def _check_rate(recording: Recording, detector: Detector) -> None:
    """Refuse a recording that lacks so many samples that this would look like a fault."""
    own, made = recording.sample_period, detector.motion.sample_period
    if own > SAME_RATE * made:
        raise InputError(
            f"{recording.source}: has {1 / own:.4g} Hz, but the detector was made at "
            f"{1 / made:.4g} Hz, and would take the samples that are missing for a fault; record "
            f"at {1 / made:.4g} Hz, or make a twin and a detector from healthy recordings at "
            f"{1 / own:.4g} Hz"
        )


def _check_axes(recording: Recording, detector: Detector) -> None:
    n_axes = len(detector.motion.gear_ratio)
    if recording.n_axes != n_axes:
        raise InputError(
            f"{recording.source}: has {recording.n_axes} axes, but the detector's robot has "
            f"{n_axes}"
        )


def _read(path: Path) -> tuple[Recording, str]:
    """A recording and the checksum of its file, which is the same before and after it is read."""
    digest = _checksum(path) if path.is_file() else ""
    recording = read_recording(path)  # which says so if there is no such file
    if _checksum(path) != digest:
        raise InputError(f"{path}: changed while it was read; judge it when it is complete")
    return recording, digest


def _checksum(path: Path) -> str:
    try:
        return file_sha256(path)
    except OSError as error:
        raise StorageFailed(f"{path}: cannot be read ({error.strerror})") from None


def watch(
    one: Judge,
    folder: Path,
    tell: Callable[[dict[str, Any]], None],
    complain: Callable[[str], None],
    pause: Callable[[float], bool] | None = None,
    settled: float = SETTLED,
    seen: Callable[[], None] | None = None,
) -> None:
    """Judge recordings as they appear in a folder; `faultgen.twin.watching` says which and when.

    Args:
        one: The judge.
        folder: The folder.
        tell: Called with each answer.
        complain: Called with a line for each file that cannot be judged, and for a disk that fails.
        pause: Waits for some seconds, and returns whether to go on. Default: it waits, and goes on.
        settled: How long a file without a checksum must not change before it is judged [s].
        seen: Called after each look in which a recording was judged.

    Raises:
        InputError: There is no such folder, or the time is none.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder to watch")
    check_settled(settled)
    pause = pause or paused
    watched = Watch(one.judge, folder, tell, complain, settled)
    while True:
        if watched.look() and seen is not None:
            seen()
        if not pause(PAUSE):
            return


def line(answer: dict[str, Any]) -> str:
    """Return an answer as one line of text."""
    name = Path(answer["recording"]).name
    count = answer["recordings"]
    after = f" ({count} recordings)" if count > 1 else ""
    again = " (judged before)" if answer.get("again") else ""
    since = f", since {answer['since'][:10]}" if answer["alarm"] and count > 1 else ""
    where = "+".join(map(str, answer["axes"]))
    if answer["severity"] is not None:
        low, high = answer["interval"]
        unit = "" if answer["unit"] == "1" else f" {answer['unit']}"
        size = f"{answer['severity']:.3g} [{low:.3g}, {high:.3g}]{unit}"
    if answer["verdict"] == "fault":
        told = f"{answer['effect']} on axis {where}, severity {size}"
    elif answer["verdict"] == "other temperature":
        told = f"friction of all axes as at another temperature, {size} warmer"
    elif answer["verdict"] == "unknown change":
        told = f"unknown change of axis {where}"
    else:
        told = "healthy"
    told += f", probability {answer['probability']:.2f}{since}"
    others = ", ".join(
        f"{one['effect']} on axis {'+'.join(map(str, one['axes']))} ({one['probability']:.2f})"
        for one in answer["alternatives"]
    )
    doubt = f"; {name} {answer['warning']}" if answer.get("warning") else ""
    return f"{name}: {told}{f'; also possible: {others}' if others else ''}{after}{again}{doubt}"

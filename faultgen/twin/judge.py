"""Judging recordings one after another, with a memory on disk.

judge = Judge(Path("detector"))
answer = judge.judge("new1.h5")
answer["verdict"], answer["probability"]
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from faultgen.discovery.read import read_recording
from faultgen.discovery.recording import Recording
from faultgen.errors import InputError
from faultgen.system.files import file_sha256, write_text
from faultgen.system.reading import read_text
from faultgen.twin.alignment import find_cycles
from faultgen.twin.detector import FORM, Detector, Memory, load_detector

STATE = "state.json"
"""File with the memory, in the detector's folder unless another one is named."""

ENDINGS = (".h5", ".hdf5", ".csv")
"""Endings of the files that are recordings."""

_PAUSE = 2.0  # between two looks into a watched folder [s]


class Judge:
    """A detector with its memory. What it has answered is kept, so that nothing counts twice."""

    def __init__(self, folder: Path, state: Path | None = None) -> None:
        """Read the detector and its memory.

        Args:
            folder: Folder of the detector.
            state: File of the memory. Default: `STATE` in this folder.

        Raises:
            InputError: A file is missing or damaged, or the memory is that of another detector.
        """
        self.detector = load_detector(folder)
        self._key = file_sha256(folder / FORM)
        self.state = state or folder / STATE
        self.memory, self.answers = Memory.empty(), list[dict[str, Any]]()
        if self.state.is_file():
            self._read()

    def _read(self) -> None:
        try:
            told = json.loads(read_text(self.state, "state file"))
            if told["detector_sha256"] != self._key:
                raise InputError(
                    f"state file {self.state}: belongs to another detector; give another --state, "
                    "or delete the file to begin anew"
                )
            self.memory = Memory(int(told["count"]), tuple(float(x) for x in told["mean"]))
            self.answers = list(told["answers"])
            wrong = self.memory.count and len(self.memory.mean) != len(self.detector.classes.basis)
            if wrong or not np.isfinite(self.memory.mean).all():
                raise ValueError("mean")
        except InputError:
            raise
        except (ValueError, KeyError, TypeError) as error:
            raise InputError(
                f"state file {self.state}: damaged ({error}); delete it to begin anew"
            ) from None

    def judge(self, path: str | Path) -> dict[str, Any]:
        """Judge a recording, and remember it.

        Args:
            path: The recording (HDF5 or CSV).

        Returns:
            The answer. A recording with the same content as an earlier one gets that answer again,
            with `again` set.

        Raises:
            InputError: The file is no recording of the task.
        """
        recording = read_recording(path)
        digest = file_sha256(Path(path))
        for answer in self.answers:
            if answer["sha256"] == digest:
                return {**answer, "recording": str(path), "again": True}
        cycles = find_cycles(self._in_torque(recording), self.detector.motion)
        answer, memory = self.detector.judge(cycles, self.memory)
        answer = {"recording": str(path), "cycles": len(cycles), **answer, "sha256": digest}
        self.memory, self.answers = memory, [*self.answers, answer]
        told = {"detector_sha256": self._key, **asdict(memory), "answers": self.answers}
        write_text(self.state, json.dumps(told, indent=1) + "\n")
        return {**answer, "again": False}

    def _in_torque(self, recording: Recording) -> Recording:
        """The recording with the torque that the log of the model has."""
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


def _check_axes(recording: Recording, detector: Detector) -> None:
    n_axes = len(detector.motion.gear_ratio)
    if recording.n_axes != n_axes:
        raise InputError(
            f"{recording.source}: has {recording.n_axes} axes, but the detector's robot has "
            f"{n_axes}"
        )


def watch(
    one: Judge,
    folder: Path,
    tell: Callable[[dict[str, Any]], None],
    complain: Callable[[str], None],
    pause: Callable[[float], bool] | None = None,
) -> None:
    """Judge recordings as they appear in a folder.

    A file is read when its size has not changed between two looks. A file that is no recording of
    the task is reported once, and passed over.

    Args:
        one: The judge.
        folder: The folder.
        tell: Called with each answer.
        complain: Called with a line for each file that cannot be judged.
        pause: Waits for some seconds, and returns whether to go on. Default: it waits, and goes on.

    Raises:
        InputError: There is no such folder.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder to watch")
    pause = pause or _wait
    sizes: dict[Path, int] = {}
    done: set[Path] = set()
    while True:
        for path in sorted(folder.iterdir(), key=_by_age):
            if path in done or path.suffix.lower() not in ENDINGS or path.name.startswith("."):
                continue
            size = path.stat().st_size if path.is_file() else -1
            if sizes.get(path) != size:
                sizes[path] = size
                continue
            done.add(path)
            try:
                answer = one.judge(path)
            except InputError as error:
                complain(str(error))
                continue
            if not answer["again"]:
                tell(answer)
        if not pause(_PAUSE):
            return


def _by_age(path: Path) -> tuple[float, str]:
    try:
        return path.stat().st_mtime, path.name
    except OSError:  # removed in between
        return 0.0, path.name


def _wait(seconds: float) -> bool:
    time.sleep(seconds)
    return True


def line(answer: dict[str, Any]) -> str:
    """Return an answer as one line of text."""
    name = Path(answer["recording"]).name
    count = answer.get("recordings", 1)  # answers of an older version do not tell
    mean = f" (running mean of {count} recordings)" if count > 1 else ""
    again = " (judged before)" if answer.get("again") else ""
    if answer["verdict"] == "fault":
        axes = "+".join(map(str, answer["axes"]))
        low, high = answer["interval"]
        unit = "" if answer["unit"] == "1" else f" {answer['unit']}"
        told = (
            f"{answer['effect']} on axis {axes}, severity {answer['severity']:.3g} "
            f"[{low:.3g}, {high:.3g}]{unit}, probability {answer['probability']:.2f}"
        )
    elif answer["verdict"] == "healthy":
        told = f"healthy, probability {answer['probability']:.2f}"
    else:
        told = f"unknown change, {max(answer['over_limit'].values()):.2g} times the limit"
    others = ", ".join(
        f"{one['effect']} on axis {'+'.join(map(str, one['axes']))} ({one['probability']:.2f})"
        for one in answer["alternatives"]
    )
    relation = "also possible" if answer["verdict"] == "fault" else "it resembles"
    return f"{name}: {told}{f'; {relation}: {others}' if others else ''}{mean}{again}"

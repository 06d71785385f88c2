"""Files with recordings, read and checked for discovery and calibration.

given = read_together(["monday.h5", "tuesday.h5"], robot)
given.recording, given.warnings
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from faultgen.discovery.accept import accepted, current_signs
from faultgen.discovery.calibration.motor_current import constants_of, in_torque
from faultgen.errors import InputError
from faultgen.recordings.log_faults import new_faults, repaired
from faultgen.recordings.low_pass import low_passed
from faultgen.recordings.read import read_recording
from faultgen.recordings.recording import OPTIONAL, LogFault, Recording, TorqueConstants
from faultgen.recordings.several import (
    check_distinct,
    check_own_noise,
    check_same_motion,
    with_healthy,
)
from faultgen.recordings.smoothing import is_rough, smoothed
from faultgen.robot import Robot

LONGEST = 3600.0
"""Longest recording that can be used [s]. It is simulated again for every term."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """What a discovery considers, and how; `faultgen.discover` explains each."""

    workers: int = 1
    """Number of processes."""
    exclude: Collection[str] = ()
    """Names of effects that are not considered."""
    include: Collection[str] = ()
    """Names of effects that are considered only on request."""
    prior_scale: float | None = None
    """How uncertain the model's parameters are, as a multiple of the default."""
    white_noise: bool = False
    """Whether long-lasting errors get full weight."""
    low_pass: float | None = None
    """Cut-off frequency of a low-pass filter [Hz]."""
    trust_log: bool = False
    """Whether the recordings are taken as they are."""
    cache: str | Path | None = None
    """Folder that keeps simulated sensitivities."""


USUAL = Options()
"""The defaults."""


@dataclass(frozen=True, eq=False)
class Given:
    """Recordings that can be used."""

    recording: Recording
    """The measured recordings as one."""
    runs: list[Recording]
    """Healthy recordings of the same motions."""
    constants: TorqueConstants | None
    """Torque constants of the first file with motor currents; None if there is none."""
    warnings: list[str]
    """One line for each thing that the user should know."""
    findings: tuple[str, ...] = ()
    """Those of them that tell what the tests of the recordings found, with what was corrected."""
    faults: tuple[LogFault, ...] = ()
    """Faults of the log that the healthy recordings do not have."""


def read_together(
    measured: Sequence[str | Path],
    robot: Robot,
    healthy: Sequence[str | Path] = (),
    low_pass: float | None = None,
    *,
    trust_log: bool = False,
) -> Given:
    """Read recordings of one robot, and the healthy ones of the same motions.

    Args:
        measured: Files of the robot as it is, at least one. They are used together.
        robot: The model.
        healthy: Files from before the change, in any order: for each measured file equally many
            of the same motions, or none.
        low_pass: Cut-off frequency [Hz] of a filter, used if there is no reference.
        trust_log: Whether the files are taken as they are, without tests and corrections.

    Returns:
        The recordings.

    Raises:
        InputError: A file or the cut-off frequency cannot be used, or the files do not belong
            together. The message is one line.
    """
    read = read_all([*healthy, *measured], robot, low_pass, trust_log=trust_log)
    found, warnings = read.recordings, read.warnings
    own = found[len(healthy) :]
    check_distinct(own)
    recording, runs = with_healthy(own, found[: len(healthy)])
    _check_length(recording)
    for name in OPTIONAL:
        lacking = [one.source for one in own if getattr(one, name) is None]
        if lacking and len(lacking) < len(own):
            warnings.append(f"{name} is not used, because it is missing in {', '.join(lacking)}")
    for run in runs:
        check_same_motion(recording, run)
    check_own_noise(runs)
    constants = next((one.constants for one in found if one.constants is not None), None)
    lost = [one.lost for one in (recording, *runs) if one.lost is not None]
    if lost:
        recording = replace(recording, lost=np.any(lost, axis=0))
    faults = new_faults(recording, runs, robot)
    return Given(recording, runs, constants, warnings, read.findings, faults)


@dataclass(frozen=True, eq=False)
class Read:
    """Recordings that were read one by one."""

    recordings: list[Recording]
    """In the order of the files."""
    warnings: list[str]
    """One line for each thing that the user should know."""
    findings: tuple[str, ...]
    """Those of them that the tests found."""


def read_all(
    paths: Sequence[str | Path],
    robot: Robot,
    low_pass: float | None = None,
    *,
    trust_log: bool = False,
    known: Recording | None = None,
) -> Read:
    """Read recordings of one robot, and test them together.

    Motor currents are converted with the torque constants of the first recording that has them.

    Args:
        paths: The files.
        robot: The model.
        low_pass: Cut-off frequency [Hz] of a filter, used if there is no reference.
        trust_log: Whether the files are taken as they are, without tests and corrections.
        known: A recording of the same sensors that was accepted before.

    Returns:
        The recordings.

    Raises:
        InputError: A file or the cut-off frequency cannot be used. The message is one line.
    """
    if low_pass is not None:
        check_positive("low-pass", low_pass)
    recordings: list[Recording] = []
    warnings: list[str] = []
    constants = None if known is None else known.constants
    for path in paths:
        one, more = _in_torque(path, robot, low_pass, constants, trust_log)
        constants = constants or one.constants
        recordings.append(one)
        warnings += more
    made, findings = accepted(recordings, robot, trust_log=trust_log, known=known)
    lines = tuple(
        f"{path}: {finding}"
        for path, found in zip(paths, findings, strict=True)
        for finding in found
    )
    return Read(made, [*warnings, *lines], lines)


def usable(
    path: str | Path,
    robot: Robot,
    low_pass: float | None = None,
    known: Recording | None = None,
    *,
    trust_log: bool = False,
) -> tuple[Recording, list[str]]:
    """Read one recording, and make it usable; see `read_all`.

    Args:
        path: The file.
        robot: The model.
        low_pass: Cut-off frequency [Hz] of a filter, used if there is no reference.
        known: A recording of the same sensors that was accepted before, if there is one.
        trust_log: Whether the file is taken as it is, without tests and corrections.

    Returns:
        The recording, and one line for each warning.

    Raises:
        InputError: The file or the cut-off frequency cannot be used. The message is one line.
    """
    read = read_all([path], robot, low_pass, trust_log=trust_log, known=known)
    return read.recordings[0], read.warnings


def _in_torque(
    path: str | Path,
    robot: Robot,
    low_pass: float | None,
    constants: TorqueConstants | None,
    trust_log: bool,
) -> tuple[Recording, list[str]]:
    """Read a recording; it is filtered if asked, and motor currents are converted to torque."""
    recording = repaired(read_recording(path))
    _check_length(recording)
    recording, found = _with_smooth_reference(recording, robot)
    if low_pass is not None and recording.reference_position is None:
        recording = low_passed(recording, low_pass)
    if robot.gearing.coupled.any() and recording.n_axes == robot.n_axes:
        recording = recording.on_motor_side(robot)
    if recording.current and recording.n_axes == robot.n_axes:
        if constants is None:
            constants = constants_of(recording, robot)
            turned = np.ones(robot.n_axes)
            if not trust_log:
                turned = current_signs(in_torque(recording, robot, constants), robot)
            if np.any(turned < 0):
                # with the sign that is corrected below, so that other files get the same constants
                again = constants_of(replace(recording, torque=recording.torque * turned), robot)
                constants = replace(again, offset=again.offset * turned)
            found += [str(constants)]
        recording = in_torque(recording, robot, constants)
    return recording, found


def _with_smooth_reference(recording: Recording, robot: Robot) -> tuple[Recording, list[str]]:
    """Smooth commanded positions whose speeds and accelerations are spoilt by noise of the log.

    Args:
        recording: The measured data.
        robot: The model. A servo that is given the position only needs neither.

    Returns:
        The recording, and a line if any axis was smoothed.
    """
    if recording.reference_position is None or not robot.set_points[1:].any():
        return recording, []
    reference = recording.reference_position.copy()
    rough = []
    for axis in range(reference.shape[1]):
        for part in recording.parts:
            if is_rough(reference[part, axis], recording.sample_period):
                reference[part, axis] = smoothed(reference[part, axis])
                rough.append(axis + 1)
    if not rough:
        return recording, []
    axes = ", ".join(map(str, sorted(set(rough))))
    return replace(recording, reference_position=reference), [
        f"{recording.source}: axis {axes}: reference_position has noise, as if it was logged at "
        "uneven times, and is smoothed; log it without noise if you can"
    ]


def _check_length(recording: Recording) -> None:
    """Refuse a recording that is longer than can be simulated."""
    seconds = len(recording.position) * recording.sample_period
    if seconds > LONGEST:
        raise InputError(
            f"{recording.source}: {len(recording.position)} samples of "
            f"{recording.sample_period:g} s are {seconds:.0f} s; give at most {LONGEST:g} s"
        )


def check_positive(what: str, value: float) -> None:
    """Refuse a number that is not positive and finite.

    Args:
        what: Name of the option, for the message.
        value: The number.

    Raises:
        InputError: The number is not positive, or not finite.
    """
    if not 0 < value < np.inf:
        raise InputError(f"{what}: must be a positive number, not {value:g}")

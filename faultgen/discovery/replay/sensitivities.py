"""How each term changes the measured torque: by formula, or by a simulation with the term.

Terms have a formula (see `formulas`), unless the model's friction follows the temperature. Then
terms of friction are simulated. Robots of one type that run one program share what is simulated,
which can be kept in a folder.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from joblib import delayed

from faultgen.discovery.replay.formulas import Formulas
from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.terms.candidates import Term
from faultgen.effects.temperature import friction_ratios
from faultgen.errors import InputError, SimulationFailed
from faultgen.provenance import provenance
from faultgen.system.arrays import read_arrays, write_arrays
from faultgen.system.parallel import in_parallel
from faultgen.system.progress import follow

TEMPERATURE = "temperature_friction"
"""Effect whose column is computed from others, so that it does not depend on the time of
recording."""

FOLLOWS = ("static_friction", "stribeck_velocity", "viscous_friction")
"""Effects that change what follows the temperature, in the order of `friction_ratios`."""

LEAST_RANGE = 2.0
"""Range of the temperature in a recording from which its effect on friction can be seen [K]:
assumed."""


def sensitivities(
    replay: Replay,
    terms: Sequence[Term],
    base: np.ndarray | None = None,
    *,
    workers: int = 1,
    cache: Path | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Simulate the torque of the model and its change with each term.

    Args:
        replay: The recording and the model.
        terms: Terms to probe, each with its own step.
        base: Torque of the unchanged model, shape (samples, n_axes). None: it is simulated.
        workers: Number of processes. It has no effect on the result.
        cache: Folder in which results are kept for the next recording of the same program.

    Returns:
        Torque of the unchanged model, shape (samples, n_axes), and its change per unit of each
        term, shape (terms, samples, n_axes). If the simulation with a term diverges, its column is
        zero.

    Raises:
        SimulationFailed: The unchanged model diverged.
    """
    by_term = Formulas.of(replay).columns(terms)
    simulated = [t for t in terms if t.name != TEMPERATURE and t not in by_term]
    if base is None:
        base, *moved = _runs(replay, [None, *simulated], workers, cache)
    else:
        moved = _runs(replay, simulated, workers, cache)
    if not np.isfinite(base).all():
        raise SimulationFailed("the model diverges on the recorded motion")
    for term, run in zip(simulated, moved, strict=True):
        if np.isfinite(run).all():
            by_term[term] = (run - base) / term.step
    return base, _in_order(replay, terms, by_term)


def impossible(replay: Replay, terms: Sequence[Term], raw: np.ndarray) -> list[str]:
    """Say which candidates drop out because the model cannot have them.

    Args:
        replay: The replay in which the terms were probed.
        terms: The terms.
        raw: Their columns, shape (terms, samples, n_axes). Only columns of zeros are looked at.

    Returns:
        One line for each effect and axis, with the reason.
    """
    told = {}
    for term, column in zip(terms, raw, strict=True):
        if term.is_effect and term.key not in told and not column.any():
            reason = replay.refusal([(term, term.step)])
            if reason:
                name, axis = term.key
                told[term.key] = f"{name} of axis {axis} is no candidate: {reason}"
    return list(told.values())


def _in_order(replay: Replay, terms: Sequence[Term], known: dict[Term, np.ndarray]) -> np.ndarray:
    """Column of each term; 0 if it could not be simulated. Shape (terms, samples, n_axes)."""
    shape = replay.recording.torque.shape
    out = np.zeros((len(terms), *shape), np.float32)
    for k, term in enumerate(terms):
        if term.name == TEMPERATURE:
            out[k] = _by_temperature(replay, term.axis, known)
        elif term in known:
            out[k] = known[term]
    return out


def _runs(
    replay: Replay, terms: Sequence[Term | None], workers: int, cache: Path | None
) -> list[np.ndarray]:
    """Torque of the model with each term in it; with none for None."""
    keys = [
        repr(term and (term.name, term.axis, term.step, term.parameters)).encode() for term in terms
    ]
    return kept_runs(
        [kept_in(cache, replay, key) for key in keys],
        [delayed(_one)(replay, term) for term in terms],
        workers,
    )


def kept_runs(files: Sequence[Path | None], calls: Sequence[Any], workers: int) -> list[np.ndarray]:
    """Compute results, or read them from files if they exist. New results are written to the files.

    Args:
        files: File of each result; None if a result is not kept.
        calls: Delayed calls (joblib), each of which returns an array.
        workers: Number of processes. It has no effect on the result.

    Returns:
        The array of each call, with the shape that the call returns, in the order of the calls.
    """
    known: dict[int, np.ndarray] = {}
    for k, file in enumerate(files):
        if file is not None and file.is_file():
            with suppress(InputError):  # a damaged file is replaced
                known[k] = read_arrays(file)[0]["torque"]
    todo = [k for k in range(len(calls)) if k not in known]
    if todo:
        done = in_parallel([calls[k] for k in todo], min(workers, len(todo)))
        shown = follow(done, "simulating candidates", len(todo), "replay")
        for k, result in zip(todo, shown, strict=True):
            known[k] = result
            file = files[k]
            if file is not None:
                write_arrays(file, {"torque": result}, {})
    return [known[k] for k in range(len(calls))]


def _by_temperature(replay: Replay, axis: int, known: dict[Term, np.ndarray]) -> np.ndarray:
    """Friction that follows the temperature, to first order, from the columns of its three laws.

    It is 0 if the temperature hardly changes: other friction and friction at another temperature
    are then the same.
    """
    change = np.zeros_like(replay.recording.torque)
    temperature = replay.recording.axis_temperature
    if temperature is None or np.ptp(temperature[:, axis - 1]) < LEAST_RANGE:
        return change
    told, inverse = np.unique(np.round(temperature[:, axis - 1], 1), return_inverse=True)
    reference = replay.robot.friction_temperature
    ratios = np.array([friction_ratios(float(t), reference) for t in told])
    of_sample = np.log(np.maximum(ratios, 1e-3))[inverse]
    for name, logarithm in zip(FOLLOWS, of_sample.T, strict=True):
        steps = [term for term in known if term.key == (name, axis)]
        if steps:
            change += logarithm[:, None] * known[min(steps, key=lambda term: term.step)]
    return change


def _one(replay: Replay, term: Term | None) -> np.ndarray:
    try:
        return replay.torque([(term, term.step)] if term else ())
    except SimulationFailed:
        return np.full_like(replay.recording.torque, np.nan)


def kept_in(folder: Path | None, replay: Replay, what: bytes) -> Path | None:
    """Return the file in which a result of simulating a model on a motion is kept.

    Args:
        folder: Folder of such files, or None.
        replay: The recording and the model.
        what: Description of what is simulated.

    Returns:
        Path whose name is a hash of all that the result depends on; None without a folder.
    """
    if folder is None:
        return None
    recording = replay.recording
    made_by = provenance("faultgen.discovery.replay.sensitivities").key
    content = hashlib.sha256(replay.robot.sha256.encode() + made_by.encode())
    content.update(np.ascontiguousarray(replay.wanted).tobytes())
    of = (recording.segments, recording.sample_period, recording.side, replay.measured)
    content.update(repr(of).encode())
    if recording.link:
        content.update(b"link")
    if replay.by_temperature(()):
        content.update(np.asarray(recording.temperature, float).tobytes())
    content.update(what)
    return folder / f"{content.hexdigest()[:32]}.h5"

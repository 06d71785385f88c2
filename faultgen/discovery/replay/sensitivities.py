"""How each term changes the measured torque: by formula, or by a simulation with the term.

Where the rotors are on their measured positions, terms have a formula (see `formulas`). Where
they follow commands, the servo reacts to an effect, and its reaction is part of the measurement:
there, every term is simulated in closed loop. Robots of one type that run one program share their
sensitivities, which can be kept in a folder.
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
from faultgen.effects import get_effect
from faultgen.effects.prior import Prior
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
    by_term = _by_formula(replay, terms)
    simulated = [(t,) for t in terms if t.name != TEMPERATURE and t not in by_term]
    if base is None:
        base, *moved = _runs(replay, [(), *simulated], workers, cache)
    else:
        moved = _runs(replay, simulated, workers, cache)
    if not np.isfinite(base).all():
        raise SimulationFailed("the model diverges on the recorded motion")
    for (term,), run in zip(simulated, moved, strict=True):
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


def are_alone(replay: Replay, terms: Sequence[Term]) -> list[bool]:
    """Tell which terms change the torque of their own axis only, so that axes share a simulation.

    If the rotors follow measured positions, whatever acts on a rotor is answered by its own servo,
    and no other axis notices. Periodic effects hardly move other axes in any case.

    Args:
        replay: The recording and the model.
        terms: Terms to probe.

    Returns:
        Whether each term may go to `own_sensitivities`.
    """
    alone = []
    for term in terms:
        prior = get_effect(term.name).prior if term.is_effect else Prior()
        of_rotor = prior.at_motor and prior.own_axis_only or term.name == TEMPERATURE
        of_turn = prior.use == "periodic" and prior.own_axis_only
        alone.append(replay.measured and of_rotor or of_turn)
    return alone


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


def own_sensitivities(
    replay: Replay,
    terms: Sequence[Term],
    base: np.ndarray,
    *,
    workers: int = 1,
    cache: Path | None = None,
) -> np.ndarray:
    """Simulate the change of the torque with terms that hardly change any axis but their own.

    Terms that differ only in the axis are simulated together: the first of each axis, the second,
    and so on, if an axis has several with the same parameters.

    Args:
        replay: The recording and the model.
        terms: Terms to probe.
        base: Torque of the unchanged model, shape (samples, n_axes).
        workers: Number of processes. It has no effect on the result.
        cache: Folder as in `sensitivities`.

    Returns:
        Shape (terms, samples, n_axes), per unit of each term. Only the term's own axis is not zero.
    """
    known = _by_formula(replay, terms)
    of_axis: dict[tuple, list[Term]] = {}
    for term in terms:
        if term.name != TEMPERATURE and term not in known:
            of_axis.setdefault((term.key, term.parameters), []).append(term)
    together: dict[tuple, list[Term]] = {}
    for alike in of_axis.values():
        for place, term in enumerate(alike):
            together.setdefault((term.name, term.parameters, place), []).append(term)
    groups = [tuple(group) for group in together.values()]
    for group, run in zip(groups, _runs(replay, groups, workers, cache), strict=True):
        runs = [run] * len(group)
        if not np.isfinite(run).all():  # perhaps because of one axis
            runs = _runs(replay, [(term,) for term in group], workers, cache)
        for term, own in zip(group, runs, strict=True):
            axis = term.axis - 1
            if np.isfinite(own).all():
                known[term] = np.zeros(base.shape, np.float32)
                known[term][:, axis] = (own - base)[:, axis] / term.step
    return _in_order(replay, terms, known)


def _by_formula(replay: Replay, terms: Sequence[Term]) -> dict[Term, np.ndarray]:
    """Columns that need no simulation of their own."""
    return Formulas(replay).columns(terms) if replay.measured else {}


def _runs(
    replay: Replay, groups: Sequence[tuple[Term, ...]], workers: int, cache: Path | None
) -> list[np.ndarray]:
    """Torque of the model with each group of terms in it."""
    keys = [
        repr([(term.name, term.axis, term.step, term.parameters) for term in group]).encode()
        for group in groups
    ]
    return kept_runs(
        [kept_in(cache, replay, key) for key in keys],
        [delayed(_one)(replay, group) for group in groups],
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


def _one(replay: Replay, terms: Sequence[Term]) -> np.ndarray:
    try:
        return replay.torque([(term, term.step) for term in terms])
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

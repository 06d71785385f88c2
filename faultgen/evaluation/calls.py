"""Calls of isolators and detectors, which may be the code of users.

Errors in their code become one line that names the method, and their answers are checked.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from traceback import extract_tb

import numpy as np

from faultgen.analysis.isolation import Answer
from faultgen.errors import InputError, MethodFailed, what_it_says
from faultgen.evaluation.features import Features
from faultgen.evaluation.methods import (
    Detector,
    Isolator,
    LabelledRun,
    M,
    Method,
    Setting,
    class_name,
)


@contextmanager
def _named(method: type[Method], doing: str, *expected: type[Exception]) -> Iterator[None]:
    """Name a method, and where its code fails, in errors that it does not raise on purpose.

    Args:
        method: Class of the method.
        doing: Name of the function that is called.
        expected: Types of errors that mean something to the caller, besides `InputError`.

    Raises:
        MethodFailed: The code in the context raised another error.
    """
    try:
        yield
    except Exception as error:  # whatever the code of a user raises
        if isinstance(error, (InputError, *expected)):
            raise
        own = getattr(sys.modules.get(method.__module__), "__file__", None)
        lines = [one.lineno for one in extract_tb(error.__traceback__) if one.filename == own]
        place = f" ({own}, line {lines[-1]})" if lines else ""
        raise MethodFailed(
            f"{class_name(method)}: {doing} raised {what_it_says(error)}{place}"
        ) from error


def create(kind: type[M], setting: Setting) -> M:
    """Make a method.

    Args:
        kind: Its class.
        setting: What is known before there are data.

    Returns:
        The method.

    Raises:
        MethodFailed: Its code fails.
    """
    with _named(kind, "__init__"):
        return kind(setting)


def learn(method: Method, runs: Sequence[LabelledRun]) -> None:
    """Let a supervised method learn.

    Args:
        method: The method.
        runs: Runs of the training part.

    Raises:
        ValueError: The method cannot learn from these runs.
        MethodFailed: Its code fails.
    """
    with _named(type(method), "learn", ValueError):
        method.learn(runs)


def fit(method: Method, healthy: Sequence[Features]) -> None:
    """Let a method learn.

    Args:
        method: The method.
        healthy: Healthy series.

    Raises:
        ValueError: The method cannot learn from these series.
        MethodFailed: Its code fails.
    """
    with _named(type(method), "fit", ValueError):
        method.fit(*([series[name] for series in healthy] for name in method.features))


def isolate(isolator: Isolator, seen: Features, cycles: int | None = None) -> int | Answer:
    """Ask an isolator, and check its answer.

    Args:
        isolator: The isolator.
        seen: Features of consecutive cycles.
        cycles: Number of cycles that it sees, from the first. Default: all.

    Returns:
        Its answer, see `Isolator.isolate`.

    Raises:
        InputError: The answer is neither an axis nor an answer for every axis.
        MethodFailed: Its code fails.
    """
    with _named(type(isolator), "isolate"):
        found = isolator.isolate(*(seen[name][:cycles] for name in isolator.features))
    n_axes = isolator.setting.n_axes
    if isinstance(found, Answer):
        shapes = {"worn": (n_axes,), "severity": (n_axes,), "interval": (n_axes, 2), "z": (n_axes,)}
        for name, shape in shapes.items():
            if np.shape(getattr(found, name)) != shape:
                raise InputError(
                    f"{class_name(type(isolator))}: isolate must return {name} of shape {shape}, "
                    f"not {np.shape(getattr(found, name))}"
                )
        return found
    whole = isinstance(found, (int, np.integer)) and not isinstance(found, bool)
    if not whole or not -1 <= found < n_axes:
        shown = f"an array of shape {found.shape}" if isinstance(found, np.ndarray) else repr(found)
        raise InputError(
            f"{class_name(type(isolator))}: isolate must return an axis from 0 to {n_axes - 1}, -1 "
            f"for none, or an Answer, not {shown}"
        )
    return int(found)


def axis_of(answer: int | Answer) -> int:
    """Return the axis that an answer names, from 0; -1 for none."""
    return answer.axis if isinstance(answer, Answer) else answer


def score(detector: Detector, seen: Features) -> np.ndarray:
    """Ask a detector, and check its answer.

    Args:
        detector: The detector.
        seen: Features of consecutive cycles.

    Returns:
        Its score of each cycle, shape (cycles,).

    Raises:
        InputError: The score has another shape, or is nan.
        MethodFailed: Its code fails.
    """
    given = [seen[name] for name in detector.features]
    with _named(type(detector), "score"):
        found = np.asarray(detector.score(*given))
    return _checked(detector, "score", found, len(given[0]))


def blame(detector: Detector, seen: Features) -> np.ndarray | None:
    """Ask a detector for the axis that is least normal, and check its answer.

    Args:
        detector: The detector.
        seen: Features of consecutive cycles.

    Returns:
        Axis from 0, shape (cycles,); None if the detector cannot tell.

    Raises:
        InputError: The answer has another shape.
        MethodFailed: Its code fails.
    """
    given = [seen[name] for name in detector.features]
    with _named(type(detector), "blame"):
        found = detector.blame(*given)
    return None if found is None else _checked(detector, "blame", np.asarray(found), len(given[0]))


def alarms(detector: Detector, seen: Features) -> np.ndarray:
    """Find the cycles in alarm, those with a score above the detector's own limit.

    Args:
        detector: The detector, fitted.
        seen: Features of consecutive cycles.

    Returns:
        Whether each cycle is in alarm, shape (cycles,).

    Raises:
        InputError: The detector has no limit, or its score has another shape or is nan.
    """
    limit = getattr(detector, "limit_", None)
    if not isinstance(limit, (int, float)) or np.isnan(limit):
        raise InputError(
            f"{class_name(type(detector))}: fit must set limit_ to a number, not {limit!r}"
        )
    return score(detector, seen) > limit


def _checked(detector: Detector, what: str, found: np.ndarray, rows: int) -> np.ndarray:
    if found.shape != (rows,):
        raise InputError(
            f"{class_name(type(detector))}: {what} must return shape ({rows},), not {found.shape}"
        )
    if np.isnan(found).any():
        raise InputError(f"{class_name(type(detector))}: {what} must not return nan")
    return found

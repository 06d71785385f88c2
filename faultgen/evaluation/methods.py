"""What an isolator and a detector are.

Each is one class. It states its name, the features that it needs, and whether it learns. Features
are the numbers of each cycle that `FEATURES` lists: what monitoring stores, or the signals
themselves. A method gets them as plain arrays, in the order in which it names them:

    class LargestChange(Isolator):
        name = "largest change"
        idea = "the axis whose mean |torque| has changed by most"
        features = ("mean_abs_torque",)

        def fit(self, torque):  # a list of arrays, one for each healthy series
            self.healthy = np.vstack(torque).mean(axis=0)

        def isolate(self, torque):  # shape (cycles, n_axes)
            return int(np.argmax(np.abs(torque[-1] - self.healthy)))

`faultgen.evaluation.isolators` and `faultgen.evaluation.detectors` list all methods, and
docs/extending.md shows how to add one.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, TypeVar

import numpy as np

from faultgen.analysis.isolation import Answer
from faultgen.errors import InputError
from faultgen.evaluation.features import FEATURES, HOURLY_FEATURES, Features
from faultgen.evaluation.wear_model import Directions
from faultgen.plugins import added

CYCLES, HOURS = "cycles", "hours"
"""What a row of the features stands for: a cycle of a dataset, or an hour of study `detection`."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Setting:
    """What a method may know before it sees data: facts of the robot's model and its task."""

    n_axes: int
    """Number of axes."""
    samples: int = 0
    """Number of torque samples in a cycle."""
    temperature_varies: bool = False
    """Whether the temperature is measured and varies."""
    reference_temperature: float = 0.0
    """Gearbox temperature at which the model's friction holds [deg C]."""
    directions: Mapping[str, Directions] = field(default_factory=dict)
    """Change of features with the severity of friction wear of each axis, by name of the
    feature."""
    turning: np.ndarray | None = None
    """Axes that turn, and whose friction can therefore be observed, shape (n_axes,). None: all."""


@dataclass(frozen=True, eq=False, kw_only=True)
class LabelledRun:
    """A run of the training part of a division, with its true labels."""

    features: Features
    """Features of all its cycles, by name."""
    severity: np.ndarray
    """Severity of the fault in each cycle, in the unit of the effect, shape (cycles,)."""
    axes: tuple[int, ...]
    """Axes on which the fault acts, from 0; empty for a healthy run."""
    effect: str
    """Name of the effect; 'healthy' if there is none."""


class Method(ABC):
    """Common part of isolators and detectors."""

    name: ClassVar[str]
    """Name in tables and figures."""
    idea: ClassVar[str] = ""
    """What the method does, in one line."""
    features: ClassVar[tuple[str, ...]]
    """Names of the features that it needs, of `FEATURES`."""
    learns: ClassVar[bool] = True
    """Whether `fit` needs healthy cycles. If not, it gets empty lists."""
    supervised: ClassVar[bool] = False
    """Whether it learns from labelled runs, by `learn`, instead of from healthy cycles, by `fit`.
    All methods are then asked only about runs of the test part of a division."""

    def __init__(self, setting: Setting) -> None:
        """Store what is known before there are data."""
        self.setting = setting

    @abstractmethod
    def fit(self, *healthy: Sequence[np.ndarray]) -> object:
        """Learn from healthy cycles.

        Args:
            healthy: One list for each feature, with one array for each uninterrupted series.

        Raises:
            ValueError: The cycles are too few. The method is then left out, with this message.
        """

    def learn(self, runs: Sequence[LabelledRun]) -> None:
        """Learn from labelled runs, if the method is supervised.

        Args:
            runs: Runs of the training part. They have all features that the method needs.

        Raises:
            ValueError: The runs are too few. The method is then left out, with this message.
        """
        raise NotImplementedError(f"{class_name(type(self))} has no method 'learn'")


class Isolator(Method):
    """Names the worn axis."""

    @abstractmethod
    def isolate(self, *features: np.ndarray) -> int | Answer:
        """Determine which axis is worn now.

        Args:
            features: Each feature of the cycles up to now, see `FEATURES`.

        Returns:
            The axis from 0, or -1 for none. An isolator that estimates the severity, and that can
            name several axes, returns an `Answer` instead.
        """

    def smallest(self) -> np.ndarray | None:
        """Predict the wear that would be found in 95 of 100 cases, from healthy cycles alone.

        Returns:
            Severity of each axis, shape (n_axes,), inf if wear of an axis cannot be found; None if
            the isolator cannot tell.
        """
        return None


class Detector(Method):
    """Says how little a cycle looks like the healthy ones."""

    rows: ClassVar[tuple[str, ...]] = (CYCLES, HOURS)
    """What the rows may stand for: `faultgen detect` judges cycles, study `detection` hours."""
    limit_: float
    """Set by `fit`: a higher score is an alarm. It is meant for one false alarm in 1000 rows; study
    `detection` ignores it, because it sets equal rates of false alarms for all detectors."""

    @abstractmethod
    def score(self, *features: np.ndarray) -> np.ndarray:
        """Score consecutive cycles.

        Args:
            features: Each feature of the cycles, see `FEATURES`.

        Returns:
            Shape (cycles,). A higher score is less normal; -inf says that there is no answer.
        """

    def blame(self, *features: np.ndarray) -> np.ndarray | None:
        """Name the axis that is least normal in each cycle.

        Args:
            features: Each feature of the cycles, see `FEATURES`.

        Returns:
            Axis from 0, shape (cycles,); None if the detector cannot tell.
        """
        return None


M = TypeVar("M", bound=Method)


def registered(kind: type[M], group: str, own: Sequence[type[M]]) -> dict[str, type[M]]:
    """List the methods of one kind: our own, and those of installed packages.

    Args:
        kind: `Isolator` or `Detector`.
        group: Group of the entry points of packages that add such methods.
        own: Our own methods, in the order of the tables.

    Returns:
        The classes by name. Those of packages come last.

    Raises:
        InputError: A class lacks something, or a name exists. The message names the class.
    """
    what = f"a subclass of faultgen.evaluation.{kind.__name__}"
    others: Iterable[tuple[str, type[M]]] = added(
        group, lambda one: isinstance(one, type) and issubclass(one, kind), what
    )
    return _checked_table([*(("", one) for one in own), *others])


def with_methods(
    table: Mapping[str, type[M]], kind: type[M], more: Sequence[type[M]]
) -> dict[str, type[M]]:
    """Add methods to a table of methods.

    Args:
        table: Methods by name.
        kind: `Isolator` or `Detector`.
        more: Further methods of this kind.

    Returns:
        All methods by name.

    Raises:
        InputError: A class is of another kind or lacks something, or a name exists.
    """
    for one in more:
        if not (isinstance(one, type) and issubclass(one, kind)):
            raise InputError(
                f"method {getattr(one, '__qualname__', repr(one))}: must be a subclass of "
                f"faultgen.evaluation.{kind.__name__}"
            )
    return _checked_table([*(("", one) for one in table.values()), *(("", one) for one in more)])


def _checked_table(methods: Iterable[tuple[str, type[M]]]) -> dict[str, type[M]]:
    """Check methods, each with the place that named it, and list them by name."""
    found: dict[str, type[M]] = {}
    known = (*FEATURES, *HOURLY_FEATURES)
    for where, method in methods:
        before = f"{where}: " if where else ""
        name = getattr(method, "name", None)
        missing = sorted(getattr(method, "__abstractmethods__", ()))
        if missing:
            raise InputError(f"{before}{class_name(method)} has no method '{missing[0]}'")
        if not isinstance(name, str) or not name:
            raise InputError(f"{before}{class_name(method)} has no name")
        if method.supervised and method.learn is Method.learn:
            raise InputError(f"{before}{class_name(method)} has no method 'learn'")
        features = getattr(method, "features", None)
        if not isinstance(features, tuple) or not features:
            raise InputError(
                f"{before}{class_name(method)}: features must be a tuple of names, not {features!r}"
            )
        for feature in features:
            if feature not in known:
                raise InputError(
                    f"{before}{class_name(method)}: there is no feature {feature!r}: choose "
                    f"{', '.join(known)}"
                )
        if name in found:
            raise InputError(f"{before}{class_name(method)}: the name '{name}' exists")
        found[name] = method
    return found


def class_name(method: type) -> str:
    """Return the name of a class with that of its module."""
    return f"{method.__module__}.{method.__qualname__}"


def needed(methods: Iterable[Method]) -> set[str]:
    """Return the names of all features that some methods need."""
    return {name for method in methods for name in method.features}

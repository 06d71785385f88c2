"""What a robot may have beside its numbers: effects of the catalogue, and one that is unknown.

A hypothesis is an effect on an axis. Its forms, such as a play of several sizes, have columns.

effects = Effects(numbers)
effects.add_catalogue(terms, raw)
effects.hypotheses, effects.columns
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from faultgen.discovery.decision.numbers import Numbers, is_number
from faultgen.discovery.decision.processes import OVER
from faultgen.discovery.replay.elastic import STIFFNESS
from faultgen.discovery.terms.candidates import INERTIA, PAYLOAD, Term
from faultgen.effects import EFFECTS, get_effect
from faultgen.inference.hypotheses import Hypothesis

UNKNOWN = "unknown"
"""Name of the hypothesis that an effect of no catalogue acts on an axis."""

PLAY_SPREAD = 0.15
"""Prior standard deviation of a play about the size of its column, over it: neighbours are 25 %
apart."""

Group = tuple[int, ...]
"""Numbers of the terms of one form of a hypothesis."""

_SIZES = {
    "friction_wear": 0.5,
    "coulomb_friction": 0.5,
    "static_friction": 0.5,
    "viscous_friction": 0.5,
    "quadratic_viscous_friction": 0.5,
    "stribeck_velocity": 0.5,
    "friction_asymmetry": 0.3,
    "load_friction": 0.1,
    "rotor_inertia": 0.3,
    "torque_constant": 0.2,
    STIFFNESS: 0.4,
    "stiffness_hardening": 1.0,
    "encoder_offset": 0.03,
    "payload_offset": 0.1,
}
"""Standard deviations of severities that matter in a plant, in units of the effects: assumed. A
size that is too large by a factor of 3 costs an effect only the logarithm of 3; one that is too
small may cost it everything."""
_UNKNOWN_SIZE = 0.1  # of unknown effects, over the RMS torque of their axis


class Effects:
    """Columns of all forms of all hypotheses."""

    def __init__(self, numbers: Numbers) -> None:
        """Start without any.

        Args:
            numbers: Numbers of a healthy robot.
        """
        self._numbers = numbers
        self.columns: list[np.ndarray] = []
        """Change of the torque per unit of each effect, shape (samples, n_axes)."""
        self.std: list[float] = []
        """Size of each."""
        self.mean: list[float] = []
        """Prior mean of each; 0 but for plays."""
        self.groups: list[Group] = []
        """Terms of each form by its first column; () for other columns."""
        self.over: dict[int, str] = {}
        """Variable of each form of an unknown effect by its first column."""
        self.unknown: list[bool] = []
        """Whether each column is of an unknown effect."""
        self._forms: dict[tuple, list[tuple[int, ...]]] = {}

    @property
    def hypotheses(self) -> list[Hypothesis]:
        """The hypotheses, in the order in which they were added."""
        return [
            Hypothesis(
                key, key[0], tuple(own), key[1], key[0] == UNKNOWN, _kin(key[0]), self._same(key)
            )
            for key, own in self._forms.items()
        ]

    def _same(self, key: tuple) -> tuple[int, ...]:
        """Numbers of the law that an effect changes on its axis."""
        kin = _kin(key[0])
        known = [self._numbers.which[k] for k in self._numbers.known] if kin else []
        own = [k for k, which in enumerate(known) if which is not None and which[1] == key[1]]
        return tuple(k for k in own if _kin((known[k] or key)[0]) == kin)

    def _add(self, key: tuple, columns: Sequence[np.ndarray], group: Group) -> int:
        first = len(self.columns)
        self._forms.setdefault(key, []).append(tuple(range(first, first + len(columns))))
        self.columns += columns
        self.unknown += [key[0] == UNKNOWN] * len(columns)
        self.groups += [group, *[()] * (len(columns) - 1)]
        return first

    def add_catalogue(self, terms: Sequence[Term], raw: np.ndarray) -> None:
        """Add the effects of the catalogue.

        Args:
            terms: What may differ.
            raw: Change of the torque per unit of each, shape (terms, samples, n_axes).
        """
        for group in groups_of(terms):
            if not raw[list(group)].any() or not _is_first(terms, group[0]):
                continue
            columns = [raw[k] for k in group]
            term = terms[group[0]]
            which = (STIFFNESS, term.axis, ())
            if term.name == STIFFNESS and which in self._numbers.which:
                # one column for a number and for its change by a fault
                columns = [self._numbers.columns[self._numbers.which.index(which)]]
            self._add(_key(term), columns, group)
            for k in group:
                std, mean = size_of(terms[k])
                self.std.append(std)
                self.mean.append(mean)

    def add_unknown(self, axes: Iterable[int]) -> None:
        """Add effects that no catalogue has: processes of one axis that are large.

        Args:
            axes: On which they may be, from 1.
        """
        numbers = self._numbers
        for axis in axes:
            for over in OVER:
                key = ("process", axis, (over,))
                own = [numbers.columns[k] for k, one in enumerate(numbers.which) if one == key]
                if not own:
                    continue
                first = self._add((UNKNOWN, axis), own, ())
                self.over[first] = over
                self.std += [_UNKNOWN_SIZE] * len(own)
                self.mean += [0.0] * len(own)


def groups_of(terms: Sequence[Term]) -> list[Group]:
    """List the candidates. Sine and cosine, like the points of a payload, make one candidate.

    Args:
        terms: What may differ.
    """
    groups: dict[tuple, list[int]] = {}
    for index, term in enumerate(terms):
        if not term.is_effect or term.nuisance:
            continue
        order = dict(term.parameters).get("order")
        key: tuple = (index,) if order is None else (term.name, term.axis, order)
        if term.name == PAYLOAD and term.parameters:
            key = term.key
        groups.setdefault(key, []).append(index)
    return [tuple(group) for group in groups.values()]


def number_terms(terms: Sequence[Term]) -> list[int]:
    """Choose the terms that are numbers of a model, each once, by their places.

    Args:
        terms: What may differ.
    """
    numbers = [k for k, term in enumerate(terms) if is_number(term)]
    return [k for k in numbers if terms[k].name == INERTIA or _is_first(terms, k)]


def size_of(term: Term) -> tuple[float, float]:
    """Prior standard deviation and mean of the severity of an effect.

    Args:
        term: The effect.

    Returns:
        Both in the unit of the effect.
    """
    prior = get_effect(term.name).prior
    if prior.play:
        return PLAY_SPREAD * term.step, term.step
    is_point = term.name == PAYLOAD and term.parameters
    usual = term.step if prior.steps_in_std or is_point else 3 * term.step
    return _SIZES.get(term.name, usual), 0.0


def _kin(name: str) -> str:
    """Effects that change the same law."""
    return get_effect(name).prior.group if name in EFFECTS else ""


def _key(term: Term) -> tuple:
    """What a hypothesis is, whatever the severity with which it is probed."""
    parameters = dict(term.parameters)
    if term.name == PAYLOAD:
        return term.key
    parameters.pop("phase", None)
    return (*term.key, *parameters.items())


def _is_first(terms: Sequence[Term], index: int) -> bool:
    """Whether a term is that of a play, or the first one with its effect, axis and parameters."""
    term = terms[index]
    which = (term.key, term.parameters, term.commanded)
    same = [(one.key, one.parameters, one.commanded) == which for one in terms[:index]]
    return get_effect(term.name).prior.play or term.name == "stribeck_velocity" or not any(same)

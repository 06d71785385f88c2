"""A difference between a recording and its model, or its baseline, ready for `faultgen.inference`.

difference = difference_of(posed)
difference.model, difference.hypotheses
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from faultgen.discovery.decision.numbers import (
    GENERIC,
    Numbers,
    bristles,
    is_number,
    numbers_of,
)
from faultgen.discovery.decision.processes import OVER
from faultgen.discovery.replay.elastic import STIFFNESS
from faultgen.discovery.replay.formulas import Formulas
from faultgen.discovery.replay.replay import Replay, settled
from faultgen.discovery.replay.samples import for_noise
from faultgen.discovery.terms.candidates import INERTIA, PAYLOAD, Term
from faultgen.effects import get_effect
from faultgen.inference.model import Group as Kind
from faultgen.inference.model import Model
from faultgen.inference.products import Products
from faultgen.inference.search import Hypothesis
from faultgen.recordings.noise_level import Noise, levelled

FALL = 18.0
"""Fall of minus two times the log-likelihood from which an effect may be named: twice the logarithm
of odds of 100 to 1 in favour of one of 100 effects and axes."""

UNKNOWN = "unknown"
"""Name of the hypothesis that an effect of no catalogue acts on an axis."""

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
_MEMORY = 0.08  # of the noise [s]: a period of the slowest arm that rings behind its gearboxes
_ORDERS = (8, 40)  # least and largest order of the autoregression
_DECAYS = (0.03, 0.1)  # of the error of friction after a reversal [s]
_REST = 0.02  # speed of an axis at rest, over its largest
_ROUNDS = 3
_TAILS = 5.0  # degrees of freedom of the noise (Student)
_EXACT = 1e-5  # noise over torque that simulations and columns are not exact enough to go below
_PLAY_SPREAD = 0.15  # of a play about the size of its column: neighbours are 25 % apart


@dataclass(frozen=True, eq=False)
class Posed:
    """A recording and what may differ. Arrays have shape (samples, n_axes)."""

    replay: Replay
    """The recording and the model at which columns were taken."""
    terms: Sequence[Term]
    """What may differ."""
    raw: np.ndarray
    """Change of the torque per unit of each term, shape (terms, samples, n_axes)."""
    base: np.ndarray
    """Torque of the model."""
    residual: np.ndarray
    """Torque that is to be explained: of the recording less that of the model or the baseline."""
    used: np.ndarray
    """Samples that may be used, shape (samples,)."""
    baseline: bool = False
    """Whether the residual is the difference of two recordings."""
    moved: Mapping[tuple, float] = field(default_factory=dict)
    """By how much numbers of the model differ from the given one, by name, axis and parameters."""
    warmer: np.ndarray | None = None
    """Change of the torque that the other temperature of a baseline should make."""
    groups: tuple[Kind, ...] | None = None
    """Groups of numbers with what is known of their scales; None: what is usual."""
    own_noise: Noise | None = None
    """Noise on axes on which two recordings share theirs, so that their difference has none."""
    shared: np.ndarray | None = None
    """These axes, a mask of shape (n_axes,)."""
    white: bool = False
    """Whether errors that last get full weight, as if the noise were white."""


@dataclass(frozen=True, eq=False)
class Difference:
    """The difference, and what may explain it."""

    model: Model
    """Numbers and effects."""
    numbers: Numbers
    """The numbers."""
    hypotheses: list[Hypothesis]
    """What may be there."""
    groups: list[Group]
    """Terms of each form of each hypothesis by its first column; () for other columns."""
    over: dict[int, str]
    """Variable of each form of an unknown effect by its first column."""
    noise: Noise
    """The noise."""
    inside: np.ndarray
    """Samples that are used, shape (samples, n_axes)."""
    comparable: np.ndarray
    """The same, also on motions that must not be used."""
    weight: np.ndarray
    """Weight of each sample, same shape."""
    residual: np.ndarray
    """Torque that is to be explained, same shape."""
    parts: list[slice]
    """Samples of each separate recording."""
    variance: np.ndarray
    """Mean square of the whitened residual of each axis, shape (n_axes,)."""

    def whiten(self, x: np.ndarray) -> np.ndarray:
        """Whiten, mask and weight torques.

        Args:
            x: Shape (..., samples, n_axes), in the unit of the recording's torque.

        Returns:
            Same shape, in standard deviations of the noise.
        """
        return self.noise.whiten(x, self.parts) * self.weight.astype(x.dtype)

    def beside(
        self,
        columns: np.ndarray,
        terms: Sequence[Term],
        values: np.ndarray | None,
        scales: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Compute the posterior of effects beside the numbers.

        Scales are not found again: a column that holds for one severity only could lose what the
        effect explains to a group that widens.

        Args:
            columns: Change of the torque per unit of each term, shape (terms, samples, n_axes).
            terms: Terms of the effects.
            values: Values near which the columns hold, shape (terms,); None if they are not known.
            scales: Logarithm of the scale of each group.

        Returns:
            Severities, shape (terms,), and their covariance.
        """
        numbers = self.numbers.known
        every = np.array([*(self.numbers.columns[k] for k in numbers), *columns], np.float32)
        sizes, means = np.array([_size(term) for term in terms]).T
        if values is not None:
            means = np.where(means != 0, values, means)
            sizes = np.where(means != 0, _PLAY_SPREAD * np.abs(values), sizes)
        model = Model(
            Products.of(self.whiten(every), self.whiten(self.residual), int(self.inside.sum())),
            np.concatenate([np.array(self.numbers.std)[numbers], sizes]),
            np.concatenate([np.zeros(len(numbers)), means]),
            self.numbers.group[numbers],
            self.model.groups,
        )
        value, covariance = model.at(scales, range(len(terms)))
        own = slice(len(numbers), None)
        return value[own], covariance[own, own]


def groups_of(terms: Sequence[Term]) -> list[Group]:
    """List the candidates. Sine and cosine, like the points of a payload, make one candidate."""
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


def difference_of(posed: Posed, *, only_numbers: bool = False) -> Difference:
    """Prepare a difference.

    Args:
        posed: The recording and what may differ.
        only_numbers: Whether there are no hypotheses.
    """
    recording = posed.replay.recording
    numbers = numbers_of(posed.replay, posed.terms, posed.raw, posed.base, baseline=posed.baseline)
    if posed.warmer is not None:
        numbers.add(posed.warmer, 1.0, "temperature")
    effects = Effects(posed, numbers)
    if not only_numbers:
        effects.add_catalogue()
        effects.add_unknown()
    residual = posed.residual.copy()
    for which, value in posed.moved.items():
        if which in numbers.which:  # otherwise it changes nothing
            residual += value * numbers.columns[numbers.which.index(which)]
    comparable, speed = _inside(posed)
    inside = for_noise(comparable & posed.used[:, None], comparable, recording.parts)[0]
    columns = np.array([*numbers.columns, *effects.columns], np.float32)
    std = np.array([*numbers.std, *effects.std])
    known = ~np.array([*np.isin(numbers.kinds, GENERIC), *effects.unknown], bool)
    noise, white, left = _whitened(posed, residual, columns, std, known, inside, speed)
    weight = np.sqrt((_TAILS + 1) / (_TAILS + left**2)) * inside
    target = noise.whiten(residual, recording.parts) * weight
    white *= weight.astype(np.float32)
    products = Products.of(white, target, int(inside.sum()))
    mean = np.concatenate([np.zeros(len(numbers.std)), effects.mean])
    model = Model(products, std, mean, numbers.group, posed.groups or numbers.groups)
    used = np.maximum(inside.sum(axis=0), 1)
    return Difference(
        model,
        numbers,
        effects.hypotheses,
        effects.groups,
        effects.over,
        noise,
        inside,
        comparable,
        weight,
        residual,
        recording.parts,
        (left**2 * inside).sum(axis=0) / used,
    )


class Effects:
    """Columns of all forms of all hypotheses."""

    def __init__(self, posed: Posed, numbers: Numbers) -> None:
        """Start without any.

        Args:
            posed: The recording and what may differ.
            numbers: Numbers of a healthy robot.
        """
        self.posed = posed
        self._numbers = numbers
        self.columns: list[np.ndarray] = []
        self.std: list[float] = []
        self.mean: list[float] = []
        self.groups: list[Group] = []
        self.over: dict[int, str] = {}
        self.unknown: list[bool] = []
        self._forms: dict[tuple, list[tuple[int, ...]]] = {}

    @property
    def hypotheses(self) -> list[Hypothesis]:
        """The hypotheses, in the order in which they were added."""
        return [
            Hypothesis(key, key[0], tuple(own), key[1], key[0] == UNKNOWN)
            for key, own in self._forms.items()
        ]

    def _add(self, key: tuple, columns: Sequence[np.ndarray], group: Group) -> int:
        first = len(self.columns)
        self._forms.setdefault(key, []).append(tuple(range(first, first + len(columns))))
        self.columns += columns
        self.unknown += [key[0] == UNKNOWN] * len(columns)
        self.groups += [group, *[()] * (len(columns) - 1)]
        return first

    def add_catalogue(self) -> None:
        """Add the effects of the catalogue."""
        terms, raw = self.posed.terms, self.posed.raw
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
                std, mean = _size(terms[k])
                self.std.append(std)
                self.mean.append(mean)

    def add_unknown(self) -> None:
        """Add effects that no catalogue has: processes of one axis that are large."""
        for axis in range(1, self.posed.base.shape[1] + 1):
            if axis in self.posed.replay.recording.left_out:
                continue
            for over in OVER:
                key = ("process", axis, (over,))
                numbers = self._numbers
                own = [numbers.columns[k] for k, one in enumerate(numbers.which) if one == key]
                if not own:
                    continue
                first = self._add((UNKNOWN, axis), own, ())
                self.over[first] = over
                self.std += [_UNKNOWN_SIZE] * len(own)
                self.mean += [0.0] * len(own)


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
    same = [one.key == term.key and one.parameters == term.parameters for one in terms[:index]]
    return get_effect(term.name).prior.play or term.name == "stribeck_velocity" or not any(same)


def _size(term: Term) -> tuple[float, float]:
    """Prior standard deviation and mean of the severity of an effect."""
    prior = get_effect(term.name).prior
    if prior.play:
        return _PLAY_SPREAD * term.step, term.step
    usual = 1.0 if term.name == PAYLOAD and term.parameters else 3 * term.step
    usual = term.step if prior.steps_in_std else usual
    return _SIZES.get(term.name, usual), 0.0


def number_terms(terms: Sequence[Term]) -> list[int]:
    """Choose the terms that are numbers of a model, each once, by their places."""
    numbers = [k for k, term in enumerate(terms) if is_number(term)]
    return [k for k in numbers if terms[k].name == INERTIA or _is_first(terms, k)]


def _inside(posed: Posed) -> tuple[np.ndarray, np.ndarray]:
    """Samples that can be used, and the speed of the motors; shape (samples, n_axes) each."""
    replay = posed.replay
    recording = replay.recording
    speed = Formulas(replay).motion.speed
    inside = settled(recording, replay.robot)
    if recording.lost is not None:
        inside &= ~recording.lost
    if replay.left_out is not None:
        inside &= ~replay.left_out
    inside &= np.abs(speed) > _REST * np.abs(speed).max(axis=0)
    return inside, speed


def _whitened(
    posed: Posed,
    residual: np.ndarray,
    columns: np.ndarray,
    std: np.ndarray,
    known: np.ndarray,
    inside: np.ndarray,
    speed: np.ndarray,
) -> tuple[Noise, np.ndarray, np.ndarray]:
    """Find the noise that numbers and effects of known form and usual sizes leave.

    Its level may grow with speed, load and jumps of friction, and after reversals, where the
    friction of a real robot and the smoothed motion are not exact.

    Returns:
        The noise, the whitened columns, and the whitened residual, shape (samples, n_axes).
    """
    recording, parts = posed.replay.recording, posed.replay.recording.parts
    period = recording.sample_period
    drivers = [np.abs(speed), np.abs(recording.torque)]
    if not recording.link:
        drivers.append(_jumps(bristles(posed.replay), parts))
    for decay in _DECAYS:
        late = [np.exp(-_since_reversal(speed[part]) * period / decay) for part in parts]
        drivers.append(np.concatenate(late))
    order = int(np.clip(round(_MEMORY / period), *_ORDERS))
    used = np.maximum(inside.sum(axis=0), 1)
    size = np.sqrt((residual**2 * inside).sum(axis=0) / used)
    size = np.where(size > 0, size, 1.0)
    least = _EXACT * np.sqrt(np.mean(recording.torque**2, axis=0)) + 1e-12
    seen = np.where(inside.any(axis=0), inside, True)  # an axis without samples has some noise
    white = columns / size.astype(np.float32) * inside
    target = residual / size * inside
    left = residual
    for _ in range(_ROUNDS):
        products = Products.of(white[known], target, 0).scaled(std[known])
        value = products.ridge() * std[known]
        left = residual - np.tensordot(value.astype(np.float32), columns[known], axes=1)
        noise = levelled(left, seen, parts, drivers, order).at_least(least)
        if posed.own_noise is not None and posed.shared is not None:
            noise = noise.replaced(posed.own_noise.of_order(order), posed.shared)
        if posed.white:
            noise = noise.plain()
        white = noise.whiten(columns, parts) * inside
        target = noise.whiten(residual, parts) * inside
    return noise, white, noise.whiten(left, parts)


def _jumps(bent: np.ndarray, parts: Sequence[slice]) -> np.ndarray:
    """Change of the friction from sample to sample, the largest of neighbours."""
    out = np.zeros_like(bent)
    for part in parts:
        change = np.abs(np.diff(bent[part], axis=0, prepend=bent[part][:1]))
        wide = np.pad(change, ((1, 1), (0, 0)))
        out[part] = np.maximum(np.maximum(wide[:-2], wide[2:]), change)
    return out


def _since_reversal(speed: np.ndarray) -> np.ndarray:
    """Samples since each axis last turned back, shape (samples, n_axes); many before that."""
    turned = np.zeros(speed.shape, bool)
    turned[1:] = speed[1:] * speed[:-1] <= 0
    number = np.arange(len(speed))[:, None]
    last = np.maximum.accumulate(np.where(turned, number, -(10**6)), axis=0)
    return number - last

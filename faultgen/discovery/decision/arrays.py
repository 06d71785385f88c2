"""A recording and what may explain it, as arrays that are not whitened yet.

arrays = arrays_of(posed)
arrays.residual, arrays.columns
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from faultgen.discovery.decision.hypotheses import Effects
from faultgen.discovery.decision.numbers import GENERIC, SMOOTHING, Numbers, numbers_of
from faultgen.discovery.decision.posterior import Posterior
from faultgen.discovery.laws.friction_forms import USUAL, forms_of
from faultgen.discovery.replay.formulas import Formulas
from faultgen.discovery.replay.position_noise import position_noise
from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.replay.samples import PRESLIDING, counted, enough, runs
from faultgen.discovery.terms.candidates import Term
from faultgen.inference.limits import UNRESOLVED
from faultgen.inference.model import Group as Kind
from faultgen.recordings.noise_level import Noise
from faultgen.recordings.recording import Recording
from faultgen.recordings.varying_noise import VaryingNoise

REST = 0.02
"""Speed of an axis at rest, over its largest."""


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
    steady: bool = False
    """Whether the noise is taken as of one colour, whatever positions bring in."""
    posterior: Posterior | None = None
    """What recordings of the healthy robot tell of the numbers of its model."""


@dataclass(frozen=True, eq=False)
class Arrays:
    """Columns of numbers and effects beside a residual. Arrays have shape (samples, n_axes)."""

    posed: Posed
    """The recording and what may differ."""
    of_model: Numbers
    """Numbers of a healthy robot, as its model has them."""
    numbers: Numbers
    """The same, as other recordings of the healthy robot leave them."""
    effects: Effects
    """Effects that it may have."""
    from_model: np.ndarray
    """Torque that is to be explained, with what is linear in the values of `posed.moved`."""
    residual: np.ndarray
    """The same less what other recordings of the healthy robot tell."""
    comparable: np.ndarray
    """Samples that can be compared."""
    inside: np.ndarray
    """Those of them that may be used, on axes of which there are enough."""
    speed: np.ndarray
    """Of the motors [rad/s]."""
    resting: np.ndarray
    """Samples at which each axis is at rest."""
    bristles: np.ndarray | None
    """Deflection of the model's bristles, from -1 to 1; None for torques without friction."""

    @property
    def parts(self) -> list[slice]:
        """Samples of each separate recording."""
        return self.posed.replay.recording.parts

    @cached_property
    def columns(self) -> np.ndarray:
        """Change of the torque per unit of each number, then of each effect.

        Returns:
            Shape (columns, samples, n_axes).
        """
        columns = np.array([*self.numbers.columns, *self.effects.columns], np.float32)
        return columns.reshape(-1, *self.residual.shape)

    @cached_property
    def acts(self) -> np.ndarray:
        """Whether each column changes the torque of each axis, shape (columns, n_axes)."""
        return np.asarray(self.columns.any(axis=1))

    @cached_property
    def smoothing(self) -> np.ndarray:
        """Torque that smoothing of positions may take: large where an axis turns back.

        Returns:
            Root of the sum of squares of its columns, shape (samples, n_axes), in the unit of the
            residual. What they do not describe is as large as what they do.
        """
        kinds = self.numbers.kinds
        columns = [
            c for c, kind in zip(self.numbers.columns, kinds, strict=True) if kind == SMOOTHING
        ]
        squares = (column.astype(float) ** 2 for column in columns)
        return np.sqrt(sum(squares, np.zeros(self.residual.shape)))

    def of_positions(self, order: int) -> VaryingNoise | None:
        """Compute the noise that measured positions bring in; see `position_noise`.

        Args:
            order: Of the autoregression.
        """
        return None if self.posed.steady else position_noise(self.posed.replay, order)

    @property
    def std(self) -> np.ndarray:
        """Standard deviation of each number, and size of each effect, shape (columns,)."""
        return np.array([*self.numbers.std, *self.effects.std])

    @property
    def mean(self) -> np.ndarray:
        """Prior mean of each, shape (columns,)."""
        return np.concatenate([np.zeros(len(self.numbers.std)), self.effects.mean])

    @property
    def of_known_form(self) -> np.ndarray:
        """Whether each is a torque of known form, shape (columns,)."""
        return ~np.array([*np.isin(self.numbers.kinds, GENERIC), *self.effects.unknown], bool)


def arrays_of(posed: Posed, *, only_numbers: bool = False) -> Arrays:
    """Compute the columns of all numbers and effects.

    Args:
        posed: The recording and what may differ.
        only_numbers: Whether there are no hypotheses.
    """
    recording = posed.replay.recording
    formulas = Formulas.of(posed.replay)
    forms = None if recording.link else forms_of(formulas)
    resting, comparable = at_rest(formulas.motion.speed), _comparable(posed.replay)
    rests = None
    # both recordings have the same commands, so that rotors come to rest in the same way
    if posed.baseline and not posed.replay.measured and forms is not None:
        rests = comparable & _long(resting, recording)
    comparable &= ~resting if rests is None else ~resting | rests
    numbers = numbers_of(
        formulas,
        forms,
        posed.terms,
        posed.raw,
        posed.base,
        baseline=posed.baseline,
        resting=rests,
    )
    if posed.warmer is not None:
        numbers.add(posed.warmer, 1.0, "temperature")
    effects = Effects(numbers)
    if not only_numbers:
        effects.add_catalogue(posed.terms, posed.raw)
        axes = range(1, posed.base.shape[1] + 1)
        effects.add_unknown(axis for axis in axes if axis not in recording.left_out)
    from_model = posed.residual.copy()
    for which, value in posed.moved.items():
        if which in numbers.which:  # otherwise it changes nothing
            from_model += value * numbers.columns[numbers.which.index(which)]
    left, residual = numbers, from_model
    if posed.posterior is not None:
        left, told = posed.posterior.given_to(numbers)
        residual = from_model - told
    bristles = None if forms is None else forms[USUAL]
    if bristles is not None:
        comparable &= jumps(bristles, recording.parts) < UNRESOLVED
    inside = enough(comparable & posed.used[:, None], recording.parts)
    return Arrays(
        posed,
        numbers,
        left,
        effects,
        from_model,
        residual,
        comparable,
        inside,
        formulas.motion.speed,
        resting,
        bristles,
    )


def at_rest(speed: np.ndarray) -> np.ndarray:
    """Find the samples at which axes are at rest.

    Args:
        speed: Of the motors, shape (samples, n_axes).

    Returns:
        Mask of the same shape.
    """
    return np.asarray(np.abs(speed) < REST * np.abs(speed).max(axis=0))


def _long(resting: np.ndarray, recording: Recording) -> np.ndarray:
    """Samples of rests, not of reversals: of at least `PRESLIDING`, shape (samples, n_axes)."""
    least = round(PRESLIDING / recording.sample_period)
    out = np.zeros_like(resting)
    for part in recording.parts:
        for axis, own in enumerate(resting[part].T):
            for run in runs(own):
                out[part][run, axis] = run.stop - run.start >= least
    return out


def jumps(bent: np.ndarray, parts: Sequence[slice]) -> np.ndarray:
    """Find by how much friction changes from one sample to the next, or from the one before.

    Args:
        bent: Deflection of bristles, shape (samples, n_axes).
        parts: Samples of each separate recording.

    Returns:
        The largest of these changes and those of the neighbours, same shape.
    """
    out = np.zeros_like(bent)
    for part in parts:
        change = np.abs(np.diff(bent[part], axis=0, prepend=bent[part][:1]))
        wide = np.pad(change, ((1, 1), (0, 0)))
        out[part] = np.maximum(np.maximum(wide[:-2], wide[2:]), change)
    return out


def _comparable(replay: Replay) -> np.ndarray:
    """Samples that can be compared, shape (samples, n_axes)."""
    inside = counted(replay.recording, replay.robot, baseline=True)
    return inside if replay.left_out is None else inside & ~replay.left_out

"""What may differ in a healthy robot: numbers, their columns, and how far they usually differ.

The numbers are those of the model, the form of its friction, and what a log does to all torques: a
time lag, and accelerations that smoothing has made smaller. They come in groups. One recording
shows how much better or worse than usual all numbers of a group are known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from faultgen.discovery.decision.processes import OVER, processes
from faultgen.discovery.laws.friction_forms import COUNT, FALLING, USUAL, without_level
from faultgen.discovery.replay.bristles import DAMPED, EXPONENT
from faultgen.discovery.replay.elastic import STIFFNESS
from faultgen.discovery.replay.formulas import GEAR_DAMPING, Formulas
from faultgen.discovery.replay.samples import runs
from faultgen.discovery.terms.candidates import INERTIA, PAYLOAD, Term
from faultgen.effects.spreads import SPREADS
from faultgen.inference.model import Group
from faultgen.recordings.recording import Recording
from faultgen.recordings.smoothing import required, smoothed_with
from faultgen.robot import COULOMB, STICTION


@dataclass(frozen=True)
class Kind:
    """A group of numbers. Without a named source, its figures are assumed."""

    spread: float
    """Factor by which all of them may be better or worse known than usual: one standard deviation
    of its logarithm."""
    days: float
    """Standard deviation between two days of one robot, over that between a robot and its model."""
    spread_of_days: float = 3.0
    """As `spread`, between two days."""


KINDS = {
    "links": Kind(1.1, 0.01, 1.5),  # a wider one would hide a payload
    # 2 % from day to day, half of its variance in all friction of an axis; a UR10e has 0.5 to 5 %
    "friction": Kind(1.4, 0.35, 2.0),
    "friction at low speed": Kind(1.4, 0.5, 2.0),
    "friction between motions": Kind(2.0, 1.0, 2.0),
    "form of friction": Kind(1.7, 0.1, 1.7),
    "form on one axis": Kind(3.0, 0.04, 1.5),
    "rotor inertia": Kind(1.2, 0.01, 1.5),
    "gain": Kind(3.0, 0.2, 2.0),
    "offset": Kind(1.7, 1.0, 1.7),
    "zero": Kind(1.7, 0.02, 1.5),
    "stiffness": Kind(1.2, 0.05, 1.5),
    "hardening": Kind(3.0, 0.0035, 1.5),  # 0.07 x 0.05: as much as the stiffness
    "damping": Kind(1.7, 0.1, 1.5),
    "damping of bristles": Kind(1.7, 0.1, 1.5),
    "Stribeck exponent": Kind(1.7, 0.1, 1.5),
    "lag of the log": Kind(3.0, 1.0),
    "smoothing": Kind(1.7, 1.0, 2.0),
    "temperature": Kind(1.4, 1.0, 2.0),
    "load at the flange": Kind(1.1, 1.0),  # of a sequence of recordings, which shows how much
    **{f"process over {over}": Kind(3.0, 0.3) for over in OVER},
}
"""Groups of numbers by name."""

AT_REST = Kind(3.0, 1.0)
"""Friction at rest, between days only: a group for each axis."""

GENERIC = tuple(f"process over {over}" for over in OVER)
"""Groups of torques of no known form."""

SMOOTHING = "smoothing"
"""Group of what smoothing of positions takes from accelerations."""

GEARS = ("stiffness", "hardening", "damping")
"""Groups of numbers of the gearboxes."""

_OF = {
    INERTIA: "links",
    "payload_mass": "links",
    "payload_offset": "links",
    "coulomb_friction": "friction",
    "viscous_friction": "friction",
    "static_friction": "friction at low speed",
    "stribeck_velocity": "friction at low speed",
    "rotor_inertia": "rotor inertia",
    "torque_constant": "gain",
    "torque_offset": "offset",
    "encoder_offset": "zero",
    "stiffness_hardening": "hardening",
}
ALL_FRICTION = "friction"
"""Name of the number that is all friction of an axis between two days."""

PARTS_OF_FRICTION = ("coulomb_friction", "static_friction", "viscous_friction")
"""Terms that make it up."""

_COMMON, _SINGLE = 0.1, 0.01  # forms, over Coulomb friction: of all axes, and of one
# gain of the log of a torque: some drives state currents times a rounded constant; assumed
_GAIN = 0.005
_ONLY = 0.05  # the same of an axis without others, in which a form could not be told from a fault
_BETWEEN, _MOTIONS = 0.003, 8  # friction between motions of one recording, and how many at most
_RESTING = 0.02  # friction at rest between two days, over Coulomb friction: as in motion; assumed
_LOW = 0.3  # fall of friction of a model without any, over Coulomb friction
_DAMPING = 1.0  # of gearboxes and bristles, as a share: models hardly know it
# of the Stribeck curve, as a share of 2. Published are 0.5 to 2: Armstrong-Helouvry et al. 1994,
# doi 10.1016/0005-1098(94)90209-7
_EXPONENT = 0.25
_SOFTER = 0.04  # share of the stiffness for a second derivative
_STIFF, _CURVED = 0.07, 0.004  # stiffness, and half the square of what is left after its fit
_PROCESS = 5e-4  # torque of no known form, over the RMS torque of its axis
_FIXED = 1.01  # factor by which a scale that is given may differ
_LAG = 3e-4  # [s]
_SMOOTHED = 1.0  # what smoothing takes, over what it would take again; and samples [1]


@dataclass(eq=False)
class Numbers:
    """The numbers of one comparison."""

    baseline: bool
    """Whether two recordings of one robot are compared, and not a recording with the model."""
    columns: list[np.ndarray] = field(default_factory=list)
    """Change of the torque per unit of each, shape (samples, n_axes)."""
    std: list[float] = field(default_factory=list)
    """Usual standard deviation of each."""
    kinds: list[str] = field(default_factory=list)
    """Group of each, one of `KINDS` or from `at_rest_of`."""
    which: list[tuple | None] = field(default_factory=list)
    """Name, axis and parameters of each; None for those that no model has."""

    def add(self, column: np.ndarray, std: float, kind: str, which: tuple | None = None) -> None:
        """Add a number.

        Args:
            column: Change of the torque per unit, shape (samples, n_axes).
            std: Standard deviation between a robot and its model.
            kind: One of `KINDS`, or from `at_rest_of`.
            which: Name, axis and parameters.
        """
        if not column.any():
            return
        self.columns.append(column.astype(np.float32))
        self.std.append(std * (KINDS.get(kind, AT_REST).days if self.baseline else 1.0))
        self.kinds.append(kind)
        self.which.append(which)

    @property
    def known(self) -> list[int]:
        """Places of those of known form: the numbers of a model without `GENERIC`, in its order."""
        return [k for k, kind in enumerate(self.kinds) if kind not in GENERIC]

    @property
    def groups(self) -> tuple[Group, ...]:
        """All groups, in the order of `KINDS`, then friction at rest of each axis."""
        return tuple(
            Group(name, kind.spread_of_days if self.baseline else kind.spread)
            for name, kind in self._all_kinds.items()
        )

    @property
    def _all_kinds(self) -> dict[str, Kind]:
        """Groups of numbers by name."""
        return {**KINDS, **{kind: AT_REST for kind in self.kinds if kind not in KINDS}}

    @property
    def group(self) -> np.ndarray:
        """Number of the group of each, shape (numbers,)."""
        names = list(self._all_kinds)
        return np.array([names.index(kind) for kind in self.kinds], int)


def at_rest_of(axis: int) -> str:
    """Name the group of friction at rest of an axis.

    Args:
        axis: Axis, from 1.
    """
    return f"friction at rest of axis {axis}"


def fixed_groups(scale: float) -> tuple[Group, ...]:
    """Return the groups with a scale that is given for all numbers of the model.

    Args:
        scale: Over the usual scale.
    """
    of_model = {*_OF.values(), "form of friction", "form on one axis", "stiffness"}
    return tuple(
        Group(name, _FIXED, scale) if name in of_model else Group(name, kind.spread)
        for name, kind in KINDS.items()
    )


def kind_of(term: Term) -> str | None:
    """Name the group of a term; None if it is no number of a model.

    Args:
        term: Any term.
    """
    return _OF[term.name] if is_number(term) else None


def is_number(term: Term) -> bool:
    """Tell whether a term is a number that every model has.

    Args:
        term: Any term.
    """
    is_point = term.name == PAYLOAD and bool(term.parameters)
    return term.name in _OF and not (is_point or term.commanded)


def numbers_of(
    formulas: Formulas,
    forms: np.ndarray | None,
    terms: Sequence[Term],
    raw: np.ndarray,
    base: np.ndarray,
    *,
    baseline: bool,
    resting: np.ndarray | None = None,
) -> Numbers:
    """Compute the columns of all numbers of a healthy robot.

    Args:
        formulas: The recording and the model.
        forms: Forms of friction, as from `forms_of`; None if the torque has no friction in it.
        terms: What may differ, among them the numbers of the model.
        raw: Change of the torque per unit of each term, shape (terms, samples, n_axes).
        base: Torque of the model, shape (samples, n_axes).
        baseline: As in `Numbers`.
        resting: Samples at rest that are compared, shape (samples, n_axes); None if none are.

    Returns:
        The numbers.
    """
    recording = formulas.replay.recording
    out = Numbers(baseline)
    steps: dict[tuple, float] = {}  # the smallest with which each is simulated
    for term in terms:
        which = (*term.key, term.parameters)
        steps[which] = min(abs(term.step), steps.get(which, np.inf))
    seen = set()
    shared: dict[str, np.ndarray] = {}
    whole: dict[int, np.ndarray] = {}
    for term, column in zip(terms, raw, strict=True):
        which = (*term.key, term.parameters)
        kind = kind_of(term)
        if kind is None or which in seen or abs(term.step) > steps[which]:
            continue
        seen.add(which)
        std = max(term.prior_std, _GAIN) if kind == "gain" else term.prior_std
        out.add(column, std, kind, which)
        if kind == "friction":
            _add_by_motion(out, column, recording.parts)
        if kind.startswith("friction"):
            shared[term.name] = shared.get(term.name, 0.0) + column
        if term.name in PARTS_OF_FRICTION and baseline:
            whole[term.axis] = whole.get(term.axis, 0.0) + column
    for axis, column in whole.items():  # warmth and lubricant change all friction of an axis
        std = SPREADS["coulomb_friction"].std
        out.add(column, std, "friction", (ALL_FRICTION, axis, ()))
    for column in shared.values():
        out.add(column, _common(recording), "form of friction")
    _add_gears(out, formulas)
    if forms is not None:
        _add_forms(out, formulas, forms)
    if resting is not None:
        _add_rests(out, formulas, resting)
    _add_log(out, formulas, base, forms)
    size = np.sqrt(np.mean(base**2, axis=0))
    for process in processes(recording, formulas.motion):
        for bump in process.bumps:
            column = np.zeros_like(base)
            column[:, process.axis - 1] = bump * size[process.axis - 1]
            out.add(column, _PROCESS, f"process over {process.over}", process.key)
    return out


def _common(recording: Recording) -> float:
    """Standard deviation of forms of friction of all axes, over Coulomb friction."""
    used = np.any(recording.torque != 0, axis=0)
    used[[axis - 1 for axis in recording.left_out]] = False
    return _COMMON if used.sum() > 1 else _ONLY


def _add_by_motion(out: Numbers, column: np.ndarray, parts: Sequence[slice]) -> None:
    """Add differences of friction between separate motions, whose mean is no difference."""
    if not 2 <= len(parts) <= _MOTIONS:
        return
    for part in parts:
        own = np.zeros_like(column)
        own[part] = column[part]
        out.add(own, _BETWEEN, "friction between motions")


def _add_gears(out: Numbers, formulas: Formulas) -> None:
    """Add stiffness and damping of the gearboxes, damping of the bristles, and exponents."""
    axes = range(1, formulas.robot.n_axes + 1)
    softer = [Term(STIFFNESS, axis, side * _SOFTER, 1.0) for axis in axes for side in (1, -1)]
    damped = [Term(GEAR_DAMPING, axis, 1.0, 1.0) for axis in axes]
    bristles = [Term(DAMPED, axis, 1.0, 1.0) for axis in axes]
    exponents = [Term(EXPONENT, axis, -_EXPONENT, 1.0) for axis in axes]
    of = formulas.columns([*softer, *damped, *bristles, *exponents])
    for axis in axes:
        less, more = of[softer[2 * axis - 2]], of[softer[2 * axis - 1]]
        out.add((less + more) / 2, _STIFF, "stiffness", (STIFFNESS, axis, ()))
        out.add((less - more) / (2 * _SOFTER), _CURVED, "stiffness")
        out.add(of[damped[axis - 1]], _DAMPING, "damping")
        if bristles[axis - 1] in of:
            out.add(of[bristles[axis - 1]], _DAMPING, "damping of bristles")
            out.add(of[exponents[axis - 1]], _EXPONENT, "Stribeck exponent")


def _add_forms(out: Numbers, formulas: Formulas, forms: np.ndarray) -> None:
    """Add forms of friction that the model's law does not have."""
    robot, recording = formulas.robot, formulas.replay.recording
    friction = robot.model.actuator_biasprm[robot.ids("actuator", "friction")]
    coulomb = friction[:, COULOMB]
    side = 1.0 if recording.side == "motor" else robot.gear_ratio
    height = np.tile(coulomb, (COUNT, 1))
    height[FALLING] = np.maximum(friction[:, STICTION] - coulomb, _LOW * coulomb)
    for form, size in zip(forms * side, height, strict=True):
        out.add(form * size, _common(recording), "form of friction")
    for form in without_level(forms) * side * coulomb:
        for axis in range(robot.n_axes):
            own = np.zeros_like(form)
            own[:, axis] = form[:, axis]
            out.add(own, _SINGLE, "form on one axis")


def _add_rests(out: Numbers, formulas: Formulas, resting: np.ndarray) -> None:
    """Add friction at each rest: it depends on how the axis came to rest, and on its real law."""
    robot, recording = formulas.robot, formulas.replay.recording
    side = 1.0 if recording.side == "motor" else robot.gear_ratio
    size = robot.model.actuator_biasprm[robot.ids("actuator", "friction"), COULOMB] * side
    for part in recording.parts:
        for axis in range(robot.n_axes):
            for run in runs(resting[part, axis]):
                column = np.zeros(resting.shape)
                column[part][run, axis] = size[axis]
                out.add(column, _RESTING, at_rest_of(axis + 1))


def _add_log(out: Numbers, formulas: Formulas, base: np.ndarray, forms: np.ndarray | None) -> None:
    """Add a time lag of each torque, and what smoothing took from its motion.

    Smoothed positions lack quick accelerations. They are those of the inertial torque, and those
    that friction makes where it turns its sign: a step of the acceleration, where the servo does
    not answer at once, and a pulse, where a controller that knows the friction answers a little
    early or late. Friction itself may turn a little early or late, too.
    """
    robot, recording = formulas.robot, formulas.replay.recording
    motion = formulas.motion
    side = 1.0 if recording.side == "motor" else robot.gear_ratio
    rotor = robot.model.dof_M0[list(robot.motors)]
    inertial = (motion.gear / robot.gear_ratio + rotor * motion.acceleration) * side
    if recording.link:
        inertial = motion.gear
    causes = [inertial]
    if forms is not None:
        rows = robot.ids("actuator", "friction")
        friction = forms[USUAL] * robot.model.actuator_biasprm[rows, COULOMB] * side
        turning = _change(friction, recording.parts)  # from one sample to the next
        causes += [friction, turning]
    for axis in range(robot.n_axes):
        late, early = np.zeros_like(base), np.zeros_like(base)
        taken = np.zeros((len(causes), *base.shape))
        for part in recording.parts:
            late[part, axis] = np.gradient(base[part, axis], recording.sample_period)
            penalty = required(recording.position[part, axis])
            if penalty is None:
                continue
            for column, cause in zip(taken, causes, strict=True):
                own = cause[part, axis]
                column[part, axis] = own - smoothed_with(own, penalty)
            if forms is not None:
                early[part, axis] = turning[part, axis]
        out.add(late, _LAG, "lag of the log")
        for column in (*taken, early):
            out.add(column, _SMOOTHED, SMOOTHING)


def _change(x: np.ndarray, parts: Sequence[slice]) -> np.ndarray:
    """Mean change from one sample to the next, before and after each; shape (samples, n_axes)."""
    out = np.zeros_like(x)
    for part in parts:
        out[part] = np.gradient(x[part], axis=0)
    return out

"""What may differ between a robot and its model: effects, and parameters with a wrong value.

Each term is one number that is zero in the model. Its prior standard deviation is the standard
deviation of this number among healthy robots. An effect is missing if its term is further from zero
than that.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from faultgen.building.doubts import moving_mass
from faultgen.building.elements import PAYLOAD_SHARE
from faultgen.effects import EFFECTS, Applied
from faultgen.effects.structure import MASSLESS, is_loaded
from faultgen.errors import InputError
from faultgen.robot import Robot

INERTIA = "inertia"
"""Name of the terms of a link's mass, centre of mass and inertia."""

FORM = "friction_form"
"""Name of the terms for friction near zero speed that differs from the model's law. These terms are
not simulated as changes of the model."""

ORDERS = (1.0, 2.0, 4.0, 6.0)
"""Orders at which periodic effects are always probed, in cycles per motor turn. They are typical of
rotors, pole pairs and wave generators. Other orders are probed if they are found in a recording."""

NUMBERS = (*(one.name for one in EFFECTS.values() if one.prior.in_every_model), INERTIA)
"""Parameters that every model has. In a model that is only roughly known, their errors are
larger."""

PAYLOAD = "payload_mass"
"""Effect that consists of four terms, the masses of four points, on every link on which the model
has no payload with a mass."""

MASSES = (PAYLOAD, "payload_offset")
"""Effects that change nothing but the mass and the centre of mass of links. They load all axes
before their own as well."""

HIDDEN_BEHIND_GEARS = tuple(one.name for one in EFFECTS.values() if one.prior.at_motor)
"""Effects that a torque sensor behind the gearbox does not see."""

ARM = 0.1
"""Distance of the points of `payload_terms` from the first one [m]."""

FREE_GAINS = {"torque_constant": 150.0, "torque_offset": 500.0}
"""Effects that an unknown torque constant and offset imitate, and the factor of their prior
standard deviations then: 30 % of the constant, and 10 % of the torque limit (assumed)."""


@dataclass(frozen=True)
class Term:
    """One number that may differ between the robot and the model."""

    name: str
    """An effect of the catalogue, `INERTIA` or `FORM`."""
    axis: int
    """Axis, from 1. For inertias it is the number of the link, and the payload is the last one."""
    step: float
    """Severity with which the effect is probed."""
    prior_std: float
    """Standard deviation of the severity among healthy robots: assumed."""
    parameters: tuple[tuple[str, float], ...] = ()
    """Further parameters of the effect."""
    nuisance: bool = False
    """Whether it is only allowed for. It is then never part of an answer."""
    commanded: bool = False
    """Whether its change of the torque is that of a robot whose servo follows the commands, while
    others are taken on the measured motion."""

    @property
    def key(self) -> tuple[str, int]:
        """Effect and axis, as they appear in an answer."""
        return self.name, self.axis

    @property
    def is_effect(self) -> bool:
        """Whether the term can be part of an answer."""
        return self.name not in (INERTIA, FORM)


_POINTS = 0.02  # mass of a payload that the model says is none [kg]: assumed
_NEGLIGIBLE = 0.1  # standard deviation of a term that is allowed for elsewhere, over that term's


def names_by_use(use: str) -> list[str]:
    """List the effects of the catalogue with one kind of use, see `Prior.use`."""
    return [effect.name for effect in EFFECTS.values() if effect.prior.use == use]


def check_names(what: str, given: Collection[str], known: Collection[str]) -> None:
    """Refuse unknown names.

    Args:
        what: Name of the option, for the message.
        given: Names to check.
        known: Names that are allowed.

    Raises:
        InputError: A name is not known.
    """
    for name in given:
        if name not in known:
            raise InputError(f"{what}: unknown name '{name}'; choose {', '.join(sorted(known))}")


def effect_terms(
    robot: Robot, exclude: Collection[str] = (), include: Collection[str] = ()
) -> list[Term]:
    """List the terms of every effect of the catalogue, for every axis on which it can act.

    Args:
        robot: The robot.
        exclude: Effects that are not considered.
        include: Effects with the use "on request" that are considered.

    Returns:
        The terms, with their prior standard deviations.
    """
    terms = []
    for effect in EFFECTS.values():
        name, prior = effect.name, effect.prior
        if name in exclude or not (prior.use == "always" or name in include):
            continue
        for axis in effect.axes_on(robot):
            if name in MASSES and not is_loaded(robot, axis):
                # the centre of mass of a link without a payload is a number of its inertia
                terms += payload_terms(robot, axis) if name == PAYLOAD else []
                continue
            terms += [
                Term(name, axis, step, prior.std_on(robot, axis), tuple(parameters.items()))
                for step in prior.steps_on(robot, axis)
                for parameters in prior.variants_on(robot, axis)
            ]
    return terms


def scanned_terms(robot: Robot, exclude: Collection[str] = ()) -> list[Term]:
    """List terms for the effects that are looked for at many severities, see `Prior.scan`.

    Args:
        robot: The robot.
        exclude: Effects that are not considered.

    Returns:
        The terms. Healthy robots do not have them: their prior standard deviations are negligible.
    """
    return [
        Term(effect.name, axis, step, _NEGLIGIBLE * effect.prior.std_on(robot, axis))
        for effect in EFFECTS.values()
        if effect.name not in exclude
        for step in effect.prior.scan
        for axis in effect.axes(robot.n_axes)
    ]


def payload_terms(robot: Robot, axis: int) -> list[Term]:
    """Terms for a load of unknown mass and place: four point masses that make one candidate.

    Weight and first moment are linear in the four masses. One of the masses may be negative,
    because only their sum and their common centre are used: together they are again one point mass.

    Args:
        robot: The robot, whose usual payload is probed.
        axis: Number of the joint that carries the link on which the load is.
    """
    usual = PAYLOAD_SHARE * moving_mass(robot.model)
    places = np.vstack([np.zeros(3), ARM * np.eye(3)])
    return [
        Term(PAYLOAD, axis, usual, _POINTS, tuple(zip("xyz", place.tolist(), strict=True)))
        for place in places
    ]


def payload_of(
    masses: Sequence[float] | np.ndarray, places: np.ndarray
) -> tuple[float, np.ndarray]:
    """Combine point masses into one payload.

    Args:
        masses: Mass of each point [kg]. Shape (points,).
        places: Position of each point [m]. Shape (points, 3).

    Returns:
        Mass [kg], and position of the centre of mass [m], shape (3,), limited to 1 m in each
        direction. Both are 0 if there is practically no mass.
    """
    mass = float(np.sum(masses))
    if mass < MASSLESS:
        return 0.0, np.zeros(3)
    return mass, np.clip(np.asarray(masses) @ places / mass, -1.0, 1.0)


def applied(changes: Sequence[tuple[Term, float]]) -> list[Applied]:
    """List the effects among changes, ready for simulation. The points on a link become one."""
    effects = [change for change in changes if change[0].is_effect]
    points = [(t, v) for t, v in effects if t.name == PAYLOAD and t.parameters]
    made = [
        Applied(t.name, t.axis, v, dict(t.parameters)) for t, v in effects if (t, v) not in points
    ]
    for axis in dict.fromkeys(t.axis for t, _ in points):
        own = [(t, v) for t, v in points if t.axis == axis]
        places = np.array([[value for _, value in t.parameters] for t, _ in own])
        mass, place = payload_of([v for _, v in own], places)
        made.append(Applied(PAYLOAD, axis, mass, dict(zip("xyz", place.tolist(), strict=True))))
    return made


def periodic_terms(robot: Robot, name: str, axis: int, order: float) -> tuple[Term, Term]:
    """Return the sine and the cosine term of a periodic effect at one order.

    Args:
        robot: The robot.
        name: Effect with the use "periodic".
        axis: Axis, from 1.
        order: Cycles per motor turn.

    Returns:
        Two terms whose phases differ by a quarter of a cycle.
    """
    prior = EFFECTS[name].prior
    (step,), size = prior.steps_on(robot, axis), prior.std_on(robot, axis)

    def one(phase: float) -> Term:
        return Term(name, axis, step, size, (("order", order), ("phase", phase)))

    return one(0.0), one(np.pi / 2)


def with_free_gains(terms: Sequence[Term]) -> list[Term]:
    """Return the same terms with torque constants and offsets that may have any value.

    Args:
        terms: All terms.

    Returns:
        New terms in the same order. No answer contains those of `FREE_GAINS`.
    """
    return [
        replace(term, prior_std=FREE_GAINS[term.name] * term.prior_std, nuisance=True)
        if term.name in FREE_GAINS
        else term
        for term in terms
    ]

"""Friction of rotors that move as they were measured, without a simulation.

The bristles of LuGre friction see nothing but the speed w of their rotor, which is known:

    friction = s0 z + s1 dz/dt,        dz/dt = w - s0 |w| z / g(w)
    g(w) = coulomb + (static - coulomb) exp(-|w / width|^exponent)

The exponent is 2 in every model; other machines have others.

While the speed is constant, this is linear in the deflection z. Each step of a simulation is such a
time, so that z follows exactly as in MuJoCo, for any number of laws at once. The equation and its
symbols are those of docs/physics.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from faultgen.discovery.replay.prescribed import speeds_of
from faultgen.discovery.terms.candidates import Term
from faultgen.effects import get_effect
from faultgen.errors import InputError
from faultgen.mjcf.dcmotor import (
    BRISTLE_DAMPING,
    BRISTLE_STIFFNESS,
    COULOMB,
    OFFSET,
    STICTION,
    STRIBECK_VELOCITY,
)
from faultgen.robot import Robot

LOAD, SHARED = "load_friction", "wrist_coupling_friction"

DAMPED = "bristle_damping"
"""Term of the damping of the bristles, a fraction of that of the model. It is no effect."""

EXPONENT = "stribeck_exponent"
"""Term of the exponent of the Stribeck curve, a fraction of 2. It is no effect."""

FRICTION = (
    "friction_wear",
    "coulomb_friction",
    "static_friction",
    "stribeck_velocity",
    "friction_asymmetry",
    "low_speed_friction",
    LOAD,
    SHARED,
    DAMPED,
    EXPONENT,
)
"""Terms of which the friction is computed here. They change nothing else."""

_PLACES = {DAMPED: 1, EXPONENT: -1}
"""Places of what is no effect among the numbers of a law."""
_GAUSSIAN = 2.0  # exponent of the Stribeck curve in MuJoCo
_CHUNK = 4000  # steps of which all laws are in memory
_NOTHING = 1e-12  # friction that counts as none, in order to divide by it [N m]


@dataclass(frozen=True, eq=False)
class _Law:
    """LuGre friction on a sum of motor speeds, and a constant torque."""

    numbers: np.ndarray
    """Bristle stiffness [N m/rad] and damping [N m s/rad], Coulomb and static friction [N m],
    Stribeck velocity [rad/s], the constant torque against forward motion [N m], and the exponent of
    the Stribeck curve."""
    lever: np.ndarray
    """Speed that it acts on, over the speed of each motor; shape (n_axes,)."""

    @staticmethod
    def of(element: mujoco.MjsActuator, lever: np.ndarray) -> _Law:
        """Read the law of an element."""
        bias, state = np.array(element.biasprm), np.array(element.dynprm)
        stiffness, damping = state[[BRISTLE_STIFFNESS, BRISTLE_DAMPING]]
        # cogging without poles is a constant torque
        constant = -bias[OFFSET] * np.sin(bias[OFFSET + 2])
        sliding = bias[[COULOMB, STICTION, STRIBECK_VELOCITY]]
        return _Law(np.array([stiffness, damping, *sliding, constant, _GAUSSIAN]), lever)


def friction_columns(
    robot: Robot, terms: Sequence[Term], rotors: np.ndarray, at: np.ndarray, gear: np.ndarray
) -> dict[Term, np.ndarray]:
    """Compute the change of the motor torque per unit of terms of friction.

    Args:
        robot: The model. Its friction must not depend on the temperature in the recording.
        terms: Terms with a name of `FRICTION`.
        rotors: Position of the rotors at every step, shape (steps, n_axes), in [rad].
        at: Steps of the samples, shape (samples,).
        gear: Torque of the gearboxes at the samples, shape (samples, n_axes), in [N m].

    Returns:
        Shape (samples, n_axes) for each term that the model can have, in [N m] at the motor.
    """
    own, changed = _laws(robot, terms)
    used = [*own, *changed.values()]
    torque = _friction(used, rotors, at, robot.model.opt.timestep)
    out = {}
    for k, (term, law) in enumerate(changed.items(), start=len(own)):
        axis = term.axis - 1
        if term.name == LOAD:
            change = torque[:, k] * np.abs(gear[:, axis] / robot.gear_ratio[axis])
        elif term.name == SHARED:
            change = torque[:, k] / term.step
        else:
            change = (torque[:, k] - torque[:, axis]) / term.step
        out[term] = change[:, None] * law.lever / robot.torque_gain
    return out


def _laws(robot: Robot, terms: Sequence[Term]) -> tuple[list[_Law], dict[Term, _Law]]:
    """The law of each axis of the model, and that with each term that the model can have."""
    spec = robot.spec()
    for one in robot.effects:
        effect = get_effect(one.effect)
        effect.apply(spec, one.axis, one.severity, **one.parameters)
    before = {actuator.name for actuator in spec.actuators}
    unit = np.eye(robot.n_axes)
    own = [_Law.of(spec.actuator(f"friction{k + 1}"), unit[k]) for k in range(robot.n_axes)]
    changed = {}
    for term in terms:
        law = own[term.axis - 1]
        if term.name == LOAD:
            stiffness, damping, coulomb, _, width, _, exponent = law.numbers
            if coulomb > 0:  # bristles as those of the axis, for each N m that they hold
                held = [stiffness / coulomb, damping / coulomb, 1.0, 1.0, width, 0.0, exponent]
                changed[term] = _Law(np.array(held), law.lever)
            continue
        if term.name in _PLACES:
            numbers = law.numbers.copy()
            numbers[_PLACES[term.name]] *= 1 + term.step
            changed[term] = _Law(numbers, law.lever)
            continue
        edited, effect = spec.copy(), get_effect(term.name)
        try:
            effect.apply(edited, term.axis, term.step, **dict(term.parameters))
        except InputError:  # the model cannot have it
            continue
        if term.name == SHARED:
            (element,) = [one for one in edited.actuators if one.name not in before]
            turns = {wrap.target.name: wrap.coef for wrap in edited.tendon(element.target).path}
            lever = np.array([turns.get(f"motor{k + 1}", 0.0) for k in range(robot.n_axes)])
            changed[term] = _Law.of(element, lever)
        else:
            changed[term] = _Law.of(edited.actuator(f"friction{term.axis}"), law.lever)
    return own, changed


def _friction(
    laws: Sequence[_Law], rotors: np.ndarray, at: np.ndarray, timestep: float
) -> np.ndarray:
    """Torque that overcomes the friction of each law at some steps, shape (samples, laws)."""
    speeds, before = speeds_of(rotors, timestep)
    stiffness, damping, coulomb, static, width, constant, exponent = np.stack(
        [law.numbers for law in laws], axis=1
    )
    damping = np.where(stiffness > 0, damping, 0.0)  # without bristles there is no friction
    width = np.where(width > 0, width, 1.0)
    levers = np.stack([law.lever for law in laws], axis=1)
    out = np.empty((len(at), len(laws)))
    wanted, done = at + before, 0
    bent = np.zeros(len(laws))
    for start in range(0, len(speeds), _CHUNK):
        speed = speeds[start : start + _CHUNK] @ levers
        holds = coulomb + (static - coulomb) * np.exp(-(np.abs(speed / width) ** exponent))
        rate = stiffness * np.abs(speed) / np.maximum(holds, _NOTHING)
        bends, bent = _bends(speed, rate, bent, timestep)
        torque = stiffness * bends + damping * (speed - rate * bends) + constant
        last = int(np.searchsorted(wanted, start + len(speed)))
        out[done:last] = torque[wanted[done:last] - start]
        done = last
    return out


def _bends(
    speed: np.ndarray, rate: np.ndarray, bent: np.ndarray, timestep: float
) -> tuple[np.ndarray, np.ndarray]:
    """Deflections before each step, shape (steps, laws), and the one after the last step."""
    stays = np.exp(-rate * timestep)
    comes = speed * np.where(rate > 0, -np.expm1(-rate * timestep), timestep)
    comes /= np.where(rate > 0, rate, 1.0)
    bends = np.empty_like(speed)
    for k in range(len(speed)):
        bends[k] = bent
        bent = stays[k] * bent + comes[k]
    return bends, bent


@dataclass(frozen=True, eq=False)
class Bending:
    """Friction of the model about a motion, linear in small changes of the speed.

    Arrays have shape (steps, n_axes). With the deflection u of the bristles before a step of
    length h, and the change v of the speed at its end, a backward step gives

        u' = (u + h gain v) / (1 + h rate),     friction = damping v + stiffness u
    """

    gain: np.ndarray
    """Rate of the deflection per change of the speed."""
    rate: np.ndarray
    """Rate at which a deflection is lost [1/s]."""
    damping: np.ndarray
    """[N m s/rad]."""
    stiffness: np.ndarray
    """[N m/rad]."""


def bending(robot: Robot, rotors: np.ndarray, every: int) -> Bending:
    """Linearize the friction of a model about the motion of its rotors.

    Args:
        robot: The model.
        rotors: Position of the rotors at every step of the simulation, shape (steps, n_axes), in
            [rad].
        every: Steps of the simulation in a step of the result.
    """
    laws, _ = _laws(robot, ())
    s0, s1, coulomb, static, width, _, exponent = np.stack([law.numbers for law in laws], axis=1)
    s1, width = np.where(s0 > 0, s1, 0.0), np.where(width > 0, width, 1.0)
    timestep = robot.model.opt.timestep
    speed = np.gradient(rotors, timestep, axis=0)
    share = np.exp(-(np.abs(speed / width) ** exponent))
    holds = np.maximum(coulomb + (static - coulomb) * share, _NOTHING)
    rate = s0 * np.abs(speed) / holds
    bends, _ = _bends(speed, rate, np.zeros(len(laws)), timestep)
    # d(|w| / g) / dw
    slope = -(static - coulomb) * share * exponent * np.abs(speed / width) ** (exponent - 1) / width
    of_speed = np.sign(speed) * (1 - np.abs(speed) * slope / holds) / holds
    gain = (1 - s0 * bends * of_speed)[::every]
    rate, h = rate[::every], every * timestep
    viscous = robot.model.actuator_damping[robot.ids("actuator", "friction")]
    share = (s0 - s1 * rate) / (1 + h * rate)
    return Bending(gain, rate, share * h * gain + s1 * gain + viscous, share)

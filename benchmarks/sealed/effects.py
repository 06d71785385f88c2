"""Effects in other functional forms than the catalogue's.

Severity is in the catalogue's unit, of the nominal robot. The amplitude of each form is the one
that fits the catalogue's law best, in the least-squares sense over the nominal robot's protocol.

    worn, slow = apply_effect(Effect("backlash", 3, 1e-3), physics, context, slow)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from scipy.optimize import minimize_scalar
from sealed.motions import protocol
from sealed.physics import Physics, constant, nominal_physics, set_points, simulate

from faultgen.robot import load_robot

Slow = list[np.ndarray]
"""What changes with time, by motion, as in `dynamics.SLOWLY`."""


@dataclass(frozen=True)
class Effect:
    """An effect on an axis (from 1), with what was drawn beside its severity."""

    name: str
    axis: int
    severity: float
    details: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Context:
    """The nominal robot on its protocol: what forms are fitted over."""

    nominal: Physics
    points: tuple[np.ndarray, ...]
    """Set points by motion."""
    runs: tuple[np.ndarray, ...]
    """By motion, shape (samples, n_axes, channels)."""

    def axis(self, axis: int) -> Nominal:
        """What the nominal robot does on an axis, counted from 1."""
        run = np.concatenate(self.runs)[:, axis - 1]
        p = {name: float(self.nominal.column(name)[axis - 1]) for name in _NEEDED}
        return Nominal(w=run[:, 1], torque=run[:, 2], gear=run[:, 4], q=run[:, 5], **p)


_NEEDED = ("N", "J", "K", "FC", "FS", "VS", "FV", "LIMIT")


@dataclass(frozen=True, kw_only=True)
class Nominal:
    """One axis of the nominal robot: parameters, and channels of shape (samples,)."""

    w: np.ndarray
    torque: np.ndarray
    gear: np.ndarray
    q: np.ndarray
    N: float
    J: float
    K: float
    FC: float
    FS: float
    VS: float
    FV: float
    LIMIT: float

    @property
    def twist(self) -> np.ndarray:
        """Twist of the gearbox by its stiffness [rad], shape (samples,)."""
        return self.gear / self.K


@lru_cache
def context(robot: str) -> Context:
    """The context of a robot that comes with the package."""
    nominal = nominal_physics(load_robot(robot))
    points = tuple(set_points(nominal, motion) for motion in protocol(robot))
    return Context(
        nominal=nominal, points=points, runs=tuple(simulate(nominal, one) for one in points)
    )


def matched(law: np.ndarray, form: np.ndarray) -> float:
    """Find the factor with which the form fits the law best.

    Args:
        law: Values of the law.
        form: Values of the other form, same shape.

    Returns:
        The factor.
    """
    return float(law @ form / (form @ form))


def _coulomb(x: Nominal, s: float) -> dict[str, float]:
    w1 = 0.3 * x.VS
    factor = matched(np.sign(x.w), np.sign(x.w) * np.abs(x.w) / (np.abs(x.w) + w1))
    return {"COULOMB": s * x.FC * factor, "COULOMB_W": w1}


def _static(x: Nominal, s: float) -> dict[str, float]:
    speed = np.abs(x.w) / x.VS
    moving = speed > 0.01
    factor = matched(np.exp(-(speed[moving] ** 2)), np.exp(-(speed[moving] ** 1.4)))
    return {"STATIC": s * (x.FS - x.FC) * factor, "STATIC_EXP": 1.4}


def _stribeck(x: Nominal, s: float) -> dict[str, float]:
    speed = np.abs(x.w) / x.VS
    law = np.exp(-((speed / (1 + s)) ** 2)) - np.exp(-(speed**2))

    def miss(t: float) -> float:
        form = np.exp(-((speed / (1 + t)) ** 1.5)) - np.exp(-(speed**1.5))
        return float(np.sum((form - law) ** 2))

    best = minimize_scalar(miss, bounds=(0.2 * s, 4 * s), method="bounded").x
    return {"STRIBECK": float(best), "STRIBECK_EXP": 1.5}


def _viscous(x: Nominal, s: float) -> dict[str, float]:
    factor = matched(x.FV * x.w, np.sign(x.w) * np.abs(x.w) ** 0.9)
    return {"VISCOUS": s * factor, "VISCOUS_EXP": 0.9}


def _quadratic(x: Nominal, s: float) -> dict[str, float]:
    law = x.FC * np.sign(x.w) * (x.w / 100.0) ** 2
    return {
        "QUADRATIC": s * matched(law, np.sign(x.w) * np.abs(x.w) ** 1.8),
        "QUADRATIC_EXP": 1.8,
    }


def _asymmetry(x: Nominal, s: float) -> dict[str, float]:
    moving = np.abs(x.w) > 0.01 * x.VS
    form = 0.5 * (1 + np.tanh(x.w / x.VS))
    factor = matched((x.w > 0)[moving].astype(float), form[moving])
    return {"ASYMMETRY": s * x.FC * factor, "ASYMMETRY_W": x.VS}


def _load(x: Nominal, s: float) -> dict[str, float]:
    load = np.abs(x.gear / x.N)
    return {"LOAD": s * matched(load, load**0.9), "LOAD_EXP": 0.9}


def _backlash(x: Nominal, s: float) -> dict[str, float]:
    return {"PLAY": s / 2, "PLAY_SOFT": 0.08 * s}


def _stiffness(x: Nominal, s: float) -> dict[str, float]:
    twist = x.twist
    half = 3 * float(np.sqrt(np.mean(twist**2)))
    return {"SOFT": s * matched(twist, twist / (1 + np.abs(twist) / half)), "SOFT_TWIST": half}


def _hardening(x: Nominal, s: float) -> dict[str, float]:
    twist = x.twist
    start = 0.4 * float(np.quantile(np.abs(twist), 0.98))
    form = np.sign(twist) * np.maximum(np.abs(twist) - start, 0)
    factor = matched(x.K * twist * (twist / 1e-3) ** 2, form)
    return {"HARD": s * factor, "HARD_FROM": start}


def _constant(x: Nominal, s: float) -> dict[str, float]:
    slope = 0.4
    form = x.torque * (1 - slope + slope * np.abs(x.torque) / x.LIMIT)
    return {"CONSTANT": s * matched(x.torque, form), "CONSTANT_SLOPE": slope}


def _spring(x: Nominal, s: float) -> dict[str, float]:
    rate = 0.5
    return {"SPRING": s * matched(x.q, np.sin(rate * x.q)), "SPRING_RATE": rate}


def _coupling(x: Nominal, s: float) -> dict[str, float]:
    return {"COUPLING": s, "COUPLING_W": 0.5 * x.VS / abs(x.N)}


_FORMS: dict[str, tuple[Callable[[Nominal, float], dict[str, float]], ...]] = {
    "friction_wear": (_coulomb, _static),
    "coulomb_friction": (_coulomb,),
    "static_friction": (_static,),
    "stribeck_velocity": (_stribeck,),
    "viscous_friction": (_viscous,),
    "quadratic_viscous_friction": (_quadratic,),
    "friction_asymmetry": (_asymmetry,),
    "load_friction": (_load,),
    "backlash": (_backlash,),
    "gear_stiffness": (_stiffness,),
    "stiffness_hardening": (_hardening,),
    "torque_constant": (_constant,),
    "gravity_spring": (_spring,),
    "wrist_coupling_friction": (_coupling,),
}

# temperature: ratios to 40 deg C of the catalogue's law (Bittencourt et al.) ...
_FITTED = np.linspace(30, 55, 26)


def _ratios(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Viscous, Stribeck height and Stribeck velocity over those at 40 deg C, by Bittencourt."""

    def viscous(x: np.ndarray | float) -> np.ndarray:
        return 1.3e-4 + 1.32e-3 * np.exp(-np.asarray(x) / 20.7)

    height = (-0.025 + 0.0016 * t) / (-0.025 + 0.0016 * 40)
    return viscous(t) / viscous(40.0), height, (-24.8 + 0.98 * t) / (-24.8 + 0.98 * 40)


_Form = Callable[[np.ndarray, float], np.ndarray]
_OTHERS: tuple[tuple[_Form, tuple[float, float]], ...] = (
    (lambda t, rate: np.exp(rate * (1 / (t + 273.15) - 1 / 313.15)), (0.0, 8000.0)),
    (lambda t, rate: (t / 40) ** rate, (0.0, 5.0)),
    (lambda t, rate: np.exp(rate * (t - 40)), (0.0, 0.2)),
)


def _other_ratios(t: np.ndarray) -> np.ndarray:
    """... and ours: Arrhenius, a power, an exponential, one fitted number each."""
    ratios = []
    for law, (form, bounds) in zip(_ratios(_FITTED), _OTHERS, strict=True):

        def miss(rate: float, law: np.ndarray = law, form: _Form = form) -> float:
            return float(np.sum((form(_FITTED, rate) - law) ** 2))

        ratios.append(form(t, float(minimize_scalar(miss, bounds=bounds, method="bounded").x)))
    return np.stack(ratios, axis=-1)


def apply_effect(
    effect: Effect,
    physics: Physics,
    where: Context,
    slow: Slow,
    temperatures: Sequence[np.ndarray],
) -> tuple[Physics, Slow]:
    """Put an effect into a robot. Those of the torque sensor alone are in `unlisted`.

    Args:
        effect: The effect.
        physics: The robot, perhaps off.
        where: The nominal robot, in whose units severity is.
        slow: What changes with time so far; not changed.
        temperatures: By motion, shape (samples,), in [deg C].

    Returns:
        The changed robot and what changes with time.
    """
    axis, s, row = effect.axis, effect.severity, effect.axis - 1
    x = where.axis(axis)
    own = {name: float(physics.column(name)[row]) for name in ("J", "K")}
    if effect.name in _FORMS:
        values: dict[str, float] = {}
        for form in _FORMS[effect.name]:
            values |= form(x, s)
        if "SOFT" in values:
            values["SOFT"] *= x.K / own["K"]
        return physics.changed(axis, **values), slow
    order, phase = effect.details.get("order", 2.0), effect.details.get("phase", 0.0)
    chain = physics.chain
    if effect.name == "transmission_error":
        physics = physics.changed(axis, WAVE=1.05 * s, WAVE_ORDER=order, WAVE_PHASE=phase)
    elif effect.name == "torque_ripple":
        physics = physics.changed(axis, RIPPLE=s, RIPPLE_ORDER=order, RIPPLE_PHASE=phase)
    elif effect.name == "rotor_inertia":
        physics = physics.changed(axis, J=own["J"] + s * x.J)
    elif effect.name == "delay":
        physics = physics.changed(axis, DELAY=s)
    elif effect.name == "encoder_offset":
        physics = physics.changed(axis, ENCODER=s)
    elif effect.name == "payload_mass":
        # a larger body of the same density and shape
        mass, inertia = chain.mass.copy(), chain.inertia.copy()
        factor = 1 + s * where.nominal.chain.mass[-1] / mass[-1]
        mass[-1] *= factor
        inertia[-1] *= factor ** (5 / 3)
        physics = replace(physics, chain=replace(chain, mass=mass, inertia=inertia))
    elif effect.name == "payload_offset":
        # not quite along the flange's x
        com = chain.com.copy()
        across = np.cross(chain.payload_x, chain.com[-1])
        com[-1] += s * (chain.payload_x + 0.12 * across / np.linalg.norm(across))
        physics = replace(physics, chain=replace(chain, com=com))
    elif effect.name == "torque_offset":
        slow = [part.copy() for part in slow]
        total = sum(len(part) for part in slow)
        drift = s * (1 + 0.15 * np.sin(2 * np.pi * np.arange(total) / total))
        for part, values_of in zip(slow, _split(drift, slow), strict=True):
            part[:, row, 4] += values_of
    elif effect.name == "temperature_friction":
        slow = [part.copy() for part in slow]
        for part, temperature in zip(slow, temperatures, strict=True):
            part[:, row, :3] *= 1 + s * (_other_ratios(temperature) - 1)
    else:
        raise ValueError(f"no form of effect '{effect.name}'")
    return physics, slow


def _split(values: np.ndarray, like: Slow) -> list[np.ndarray]:
    """Values of a whole recording by motion."""
    return np.split(values, np.cumsum([len(part) for part in like])[:-1])


def unchanging(where: Context) -> Slow:
    """Nothing changes with time."""
    return [constant(*run.shape[:2]) for run in where.runs]


CATALOGUE = (
    *_FORMS,
    "transmission_error",
    "torque_ripple",
    "rotor_inertia",
    "delay",
    "encoder_offset",
    "payload_mass",
    "payload_offset",
    "torque_offset",
    "temperature_friction",
)
"""Names of the catalogue that have a form here. `brake_drag` is `coulomb_friction` in [N m]."""


def axes_of(name: str, n_axes: int) -> tuple[int, ...]:
    """Return the axes on which an effect can act.

    Args:
        name: Name of the effect.
        n_axes: Number of axes.

    Returns:
        Axes, from 1.
    """
    if name.startswith("payload"):
        return (n_axes,)
    if name == "wrist_coupling_friction":
        return (n_axes - 1, n_axes)
    return tuple(range(1, n_axes + 1))

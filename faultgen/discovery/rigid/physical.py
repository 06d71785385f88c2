"""A model that can exist, with the parameters that a recording determines.

Classical identification yields combinations of parameters, and nothing prevents a negative mass.
Here the same regression is solved for the links themselves. Their pseudo-inertia is changed as in
`inertia`, so that every link can exist, and it stays near that of the given model as far as the
recording leaves it open. Rotor inertia, friction and offsets are free, but not negative.

    fitted = fit(regression, regression.products, Spread(10.0))
    robot = fitted.robot
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from faultgen.discovery.fit.bounded import bounded_minimum
from faultgen.discovery.rigid.base_parameters import Products, axis_weights, identify
from faultgen.discovery.rigid.drives import GAIN, NAMES, Drives, built
from faultgen.discovery.rigid.regression import DRIVE, Regression
from faultgen.discovery.terms.candidates import INERTIA, Term
from faultgen.discovery.terms.inertia import (
    PAIRS,
    inertia_terms,
    inertial_bodies,
    main_frame,
    parameters_of,
    pseudo_inertia,
)
from faultgen.discovery.terms.regressor import PER_LINK, link_parameters
from faultgen.effects import get_effect
from faultgen.effects.spreads import SPREADS
from faultgen.robot import Robot
from faultgen.simulation.arm import Arm

_LEAST = 1e-3  # smallest rotor inertia, as a share of the given one
_QUICK = 0.5  # largest time step times frequency of a rotor on its gearbox
_LOOSE = 30.0  # prior standard deviation of free parameters, in units of their size
_STIFF = 1e-4  # the same of excluded parameters, in units of their default standard deviation
_NOTHING = 1e-4  # smallest Coulomb friction, as a share of the RMS torque
_KNOWN = 0.01  # Coulomb friction over RMS torque from which a model states its friction: assumed
_STEPS = 100  # of the search at most
_SETTLED = 1e-5  # share of the misfit that a step has to take off


@dataclass(frozen=True)
class Spread:
    """How far the parameters of a robot may be from those of the model."""

    scale: float
    """Prior standard deviation of links and torque constants, as a multiple of the default."""
    known: Collection[str] = ()
    """Parameters (`candidates.NUMBERS`) that keep their default prior standard deviation."""
    exclude: Collection[str] = ()
    """Parameters that are not changed."""
    far: bool = False
    """Whether numbers of the drives may be further from the model than those of another unit of its
    type (`SPREADS`)."""

    def of(self, name: str, default: float, free: float) -> float:
        """Return the prior standard deviation of a parameter.

        Args:
            name: Name of the parameter.
            default: Its default prior standard deviation.
            free: The standard deviation with which the data alone decide.
        """
        if name in self.exclude:
            return _STIFF * max(default, 1e-12)
        return default if name in self.known and default > 0 else free


@dataclass(frozen=True, eq=False)
class Physical:
    """A model whose parameters were fitted to a regression."""

    given: Robot
    """The model before the fit."""
    links: list[tuple[Term, float]]
    """Changes of the links."""
    drives: Drives
    """Parameters of the drives."""
    couplings: list[tuple[int, float, np.ndarray]]
    """Axis, ratio and parameters (`COUPLING`) of each coupling."""
    gain: np.ndarray
    """Motor torque over the torque of the given model's log, shape (n_axes,)."""
    value: np.ndarray = field(repr=False)
    """All parameters of the regression."""

    def squares(self, products: Products) -> np.ndarray:
        """Compute the squared errors of blocks, as `Products.squares`.

        Args:
            products: Inner products of the blocks.

        Returns:
            Shape (blocks, n_axes), in [(N m)^2].
        """
        return products.squares(self.value, 1 / self.gain)

    @cached_property
    def robot(self) -> Robot:
        """The model with these parameters.

        Raises:
            SimulationFailed: MuJoCo cannot compile it.
        """
        return built(self.given, self.drives, self.links, self.couplings, self.gain)


class _Links:
    """Parameters of the links as functions of the changes of their pseudo-inertia."""

    def __init__(self, robot: Robot) -> None:
        spec = robot.spec()
        self.terms = inertia_terms(robot)
        self.nominal = link_parameters(Arm(robot))
        self._frames = []
        for body in inertial_bodies(spec, robot)[: len(self.nominal) // PER_LINK]:
            self._frames.append((main_frame(body), pseudo_inertia(body)))

    def parameters(self, change: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Parameters, shape (parameters,), and their slopes, shape (parameters, terms)."""
        value, slope = self.nominal.copy(), np.zeros((len(self.nominal), len(self.terms)))
        for link, (frame, own) in enumerate(self._frames, start=1):
            at = [k for k, term in enumerate(self.terms) if term.axis == link]
            if not at:
                continue
            units = np.zeros((len(at), 4, 4))
            for unit, k in zip(units, at, strict=True):
                unit[PAIRS[int(dict(self.terms[k].parameters)["component"])]] = 1.0
            factor = np.eye(4) + np.tensordot(change[at], units, axes=1)
            rows = slice(PER_LINK * (link - 1), PER_LINK * link)
            value[rows] = parameters_of(frame @ factor @ own @ factor.T @ frame.T)
            turned = frame @ units @ own @ factor.T @ frame.T
            slope[rows, at] = parameters_of(turned + turned.swapaxes(1, 2)).T
        return value, slope


def fit(
    regression: Regression, products: Products, spread: Spread, start: Physical | None = None
) -> Physical:
    """Fit the parameters of the model to blocks of a recording.

    Args:
        regression: The regression, which has the model and the meaning of the columns.
        products: Inner products of the blocks to fit.
        spread: How far the parameters may be from those of the model.
        start: A similar fit, from which the search starts.

    Returns:
        The fitted parameters.
    """
    robot, n = regression.robot, regression.robot.n_axes
    links, before = _Links(robot), Drives.of(robot)
    weight = axis_weights(products, identify(products))
    samples = np.maximum(products.count.sum(axis=0), 1)
    rms = np.sqrt(np.maximum(products.torque.sum(axis=0) / samples, 1e-12))
    # columns of the unknowns: links, then all others as they are in the regression, then gains
    first, last = len(links.nominal), regression.size
    count = len(links.terms)
    centre, std = np.zeros(count + last - first + n), np.empty(count + last - first + n)
    low, high = np.full(len(std), -np.inf), np.full(len(std), np.inf)
    scale = spread.of(INERTIA, 1.0, spread.scale)
    std[:count] = [scale * term.prior_std for term in links.terms]
    lightest = np.minimum(np.maximum(_LEAST * before.inertia, _lightest(robot)), before.inertia)
    speed = np.sqrt(np.einsum("baii->ai", products.gram).T / samples)  # RMS of each column
    known = before.coulomb > _KNOWN * rms
    for name, value in before.named().items():
        columns = regression.drive(name)
        at = columns - first + count
        effect = get_effect(NAMES[name])
        for k in range(n):
            size = value[k]
            default = effect.prior.std_on(robot, k + 1) * (1.0 if name == "offset" else size)
            free = _LOOSE * (
                size if name == "rotor inertia" else rms[k] / max(speed[columns[k], k], 1e-9)
            )
            centre[at[k]], std[at[k]] = size, spread.of(effect.name, default, free)
            least = {"rotor inertia": lightest[k], "Coulomb": _NOTHING * rms[k], "offset": -np.inf}
            low[at[k]] = least.get(name, 0.0)
            factor = SPREADS[effect.name].factor
            if not spread.far and factor and size > 0 and (name == "rotor inertia" or known[k]):
                low[at[k]], high[at[k]] = max(low[at[k]], size / factor), size * factor
    for number, coupling in enumerate(regression.couplings):
        columns = regression.coupling(number)
        at = columns - first + count
        std[at] = (
            _LOOSE * rms[coupling.axis - 1] / np.maximum(speed[columns, coupling.axis - 1], 1e-9)
        )
        low[at] = 0.0
    default = get_effect(GAIN).prior.std_on(robot, 1)
    std[-n:] = spread.of(GAIN, default, spread.scale * default)
    low[-n:] = -0.5

    grams = products.gram.sum(axis=0)
    rights, energy = products.right.sum(axis=0), products.energy.sum(axis=0)

    def cost(scaled: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Misfit, half its gradient, and the matrix of Gauss and Newton."""
        unknown = scaled * std
        own, slope = links.parameters(unknown[:count])
        value = np.concatenate([own, unknown[count:-n]])
        jacobian = np.zeros((last, len(std)))  # of the regression's parameters
        jacobian[:first, :count], jacobian[first:, count:-n] = slope, np.eye(last - first)
        away = scaled - centre / std
        total, gradient, matrix = float(away @ away), away.copy(), np.eye(len(std))
        for k in range(n):
            factor = 1 + unknown[k - n]
            turned = factor * jacobian
            turned[:, k - n] += value
            right = grams[k] @ (factor * value) - rights[k]
            total += weight[k] * float(factor * value @ (right - rights[k]) + energy[k])
            gradient += weight[k] * std * (turned.T @ right)
            matrix += weight[k] * np.outer(std, std) * (turned.T @ grams[k] @ turned)
        return total, gradient, matrix

    begin = centre if start is None else _unknowns(start)
    unknown = std * _bounded(cost, begin / std, low / std, high / std)
    own, _ = links.parameters(unknown[:count])
    value = np.concatenate([own, unknown[count:-n]])
    inertia, coulomb, viscous, offset = (value[regression.drive(name)] for name in DRIVE)
    scaled = regression.scaled
    rise = before.rise * np.where(scaled, coulomb / np.where(scaled, before.coulomb, 1.0), 1.0)
    return Physical(
        given=robot,
        links=list(zip(links.terms, unknown[:count].tolist(), strict=True)),
        drives=Drives(inertia, coulomb, viscous, offset, rise),
        couplings=[
            (coupling.axis, coupling.ratio, value[regression.coupling(number)])
            for number, coupling in enumerate(regression.couplings)
        ],
        gain=1 / (1 + unknown[-n:]),
        value=value,
    )


def _lightest(robot: Robot) -> np.ndarray:
    """Smallest inertia of each rotor with which its gearbox can be simulated [kg m^2]."""
    model, gearbox = robot.model, robot.ids("tendon", "gearbox")
    step = model.opt.timestep
    spring = model.tendon_stiffness[gearbox] * (step / _QUICK) ** 2
    damper = model.tendon_damping[gearbox] * step / _QUICK
    return np.asarray((spring + damper) / robot.gear_ratio**2)


def _unknowns(start: Physical) -> np.ndarray:
    """The unknowns of an earlier fit."""
    first = len(link_parameters(Arm(start.given)))
    changes = [value for _, value in start.links]
    return np.concatenate([changes, start.value[first:], 1 / start.gain - 1])


def _bounded(
    cost: Callable[[np.ndarray], tuple[float, np.ndarray, np.ndarray]],
    begin: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
) -> np.ndarray:
    """Minimise a sum of squares within bounds (Levenberg and Marquardt)."""
    at, damping = np.clip(begin, low, high), 1e-3
    total, gradient, matrix = cost(at)
    for _ in range(_STEPS):
        system = matrix.copy()
        system[np.diag_indices_from(system)] *= 1 + damping
        new = np.clip(at + bounded_minimum(system, -gradient, low - at, high - at), low, high)
        told = cost(new)
        if told[0] > total:
            damping = 10 * damping
            if damping > 1e8:
                break
            continue
        done = total - told[0] < _SETTLED * total
        at, damping = new, damping / 10
        total, gradient, matrix = told
        if done:
            break
    return at

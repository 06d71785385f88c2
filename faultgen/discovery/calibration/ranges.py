"""Where the numbers of a robot stop being physical.

A calibration moves a number of the drives by a factor of three at most, which is what units of one
type differ by (`SPREADS`). Static friction is the height of the Stribeck curve above Coulomb
friction, so that it is never less than that.

    low, high = severities(term)         # bounds of a fit
    lines = unphysical(given, made)      # what the user has to know about a model
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from faultgen.discovery.rigid.drives import Drives
from faultgen.discovery.rigid.regression import STATIC
from faultgen.discovery.terms.candidates import Term
from faultgen.effects.spreads import SPREADS, TORQUE_CONSTANT
from faultgen.recordings.checks import without_friction
from faultgen.robot import COULOMB, STICTION, STRIBECK_VELOCITY, Robot

_BOUND = 0.999  # share of a limit at which a number stands at it


def severities(term: Term) -> tuple[float, float]:
    """Return the severities that a calibration may give to a number, beside those of its effect.

    Args:
        term: A number of the model.

    Returns:
        Smallest and largest severity; infinite where no spread from unit to unit is known.
    """
    spread = SPREADS.get(term.name) if term.is_effect and not term.parameters else None
    if spread is None or not spread.factor:
        return -np.inf, np.inf
    return 1 / spread.factor - 1, spread.factor - 1


def unphysical(given: Robot, made: Robot) -> list[str]:
    """Find numbers of a calibrated model that no robot of this type should have.

    Args:
        given: The model before calibration. Where it has no friction, its friction is not compared.
        made: The calibrated model.

    Returns:
        One line for each kind of number that is out of its range on some axis.
    """
    lines = list(_ratios(given, made))
    friction = made.model.actuator_biasprm[made.ids("actuator", "friction")]
    coulomb, static = friction[:, COULOMB], friction[:, STICTION]
    least = static < coulomb * (1 - 1e-9)
    if least.any():
        lines.append(f"static friction is less than Coulomb friction on {_axes(least)}")
    most = static > STATIC * np.maximum(coulomb, 1e-300)
    if most.any():
        lines.append(
            f"static friction is more than {STATIC:g} times Coulomb friction on {_axes(most)}"
        )
    change = made.torque_gain / given.torque_gain - 1
    far = np.abs(change) > TORQUE_CONSTANT
    if far.any():
        lines.append(
            f"torque constant of {_axes(far)} differs from the log by {_listed(100 * change[far])} "
            f"%, where data sheets of motors allow {100 * TORQUE_CONSTANT:.0f} %"
        )
    return lines


def _ratios(given: Robot, made: Robot) -> Iterator[str]:
    before, after = _numbers(given), _numbers(made)
    known = ~without_friction(given)
    for name, (label, old) in before.items():
        new, factor = after[name][1], SPREADS[name].factor
        ratio = new / np.where(old > 0, old, np.nan)
        compared = known if "friction" in label or "Stribeck" in label else np.ones_like(known)
        limit = 1 + (factor - 1) * _BOUND
        far = compared & np.isfinite(ratio) & ((ratio > limit) | (ratio < 1 / limit))
        if far.any():
            yield (
                f"{label} of {_axes(far)} is {_listed(ratio[far])} times that of the model: robots "
                f"of one type differ by a factor of {factor:g} at most"
            )


def _numbers(robot: Robot) -> dict[str, tuple[str, np.ndarray]]:
    """Numbers that are compared, by their effect; each with its name and values, (n_axes,)."""
    drives = Drives.of(robot)
    friction = robot.model.actuator_biasprm[robot.ids("actuator", "friction")]
    return {
        "coulomb_friction": ("Coulomb friction", drives.coulomb),
        "viscous_friction": ("viscous friction", drives.viscous),
        "static_friction": ("static friction above Coulomb friction", drives.rise),
        "stribeck_velocity": ("Stribeck velocity", friction[:, STRIBECK_VELOCITY]),
        "rotor_inertia": ("rotor inertia", drives.inertia),
        "gear_stiffness": (
            "gearbox stiffness",
            robot.model.tendon_stiffness[robot.ids("tendon", "gearbox")],
        ),
    }


def _axes(which: np.ndarray) -> str:
    axes = [str(k + 1) for k in np.flatnonzero(which)]
    return f"axis {axes[0]}" if len(axes) == 1 else f"axes {', '.join(axes)}"


def _listed(values: np.ndarray) -> str:
    return ", ".join(f"{float(f'{value:.2g}'):g}" for value in values)

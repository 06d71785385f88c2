"""A calibrated model, its errors on motions that were not fitted, and what is unusual about it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from faultgen.discovery.calibration.compared import BAD, Compared
from faultgen.discovery.calibration.weak_axes import AGAIN, GIVEN
from faultgen.discovery.rigid.drives import GAIN, NAMES, Drives
from faultgen.discovery.rigid.regression import Coupling
from faultgen.robot import Robot

_ROUNDING = 1e-9  # relative change of a number that a file may cause


@dataclass(frozen=True, eq=False)
class Calibrated:
    """A model whose parameters were fitted to a recording."""

    robot: Robot
    """The model. A changed torque constant is its `torque_gain`."""
    errors: dict[str, float]
    """Relative RMS torque error on motions that were not fitted, of the model as it was `given`, of
    `classical` identification, of the `physical` model, and of the model with the numbers of
    single drives that were changed after it (`calibrated`)."""
    prior_scale: float
    """The chosen scale, as a multiple of the default prior standard deviations."""
    values: dict[str, dict[int, float]]
    """Severity of each fitted number by name and axis, without the inertias. Friction that the
    given model lacks has no severity."""
    parameters: dict[str, list[float]]
    """Rotor inertia, friction and offset of each axis of the model, motor side, in SI units."""
    couplings: tuple[Coupling, ...] = ()
    """Couplings of neighbouring axes that the recording requires and the model now has."""
    lacks: tuple[str, ...] = ()
    """One line for each thing that the model does not have."""
    findings: tuple[str, ...] = ()
    """One line for each number that no robot should have, each axis that is worse than classical
    identification or than before, and for priors that are as wide as they may be."""
    per_axis: tuple[dict[str, Any], ...] = ()
    """For each axis the relative RMS torque errors on motions that were not fitted: of the `given`
    model, of `classical` identification and of this model (`calibrated`), the 95 % interval of the
    difference of the last two, and where the `numbers` of its drive come from: 'fit', 'again' (once
    more, to this axis alone) or 'given'."""

    def report(self) -> dict[str, Any]:
        """Return all but the model itself, ready for JSON. What is not finite becomes None."""
        return {
            "errors": {k: v if np.isfinite(v) else None for k, v in self.errors.items()},
            "prior_scale": self.prior_scale,
            "values": self.values,
            "parameters": self.parameters,
            "torque_gain": self.robot.torque_gain.tolist(),
            "couplings": [asdict(one) for one in self.couplings],
            "lacks": list(self.lacks),
            "findings": list(self.findings),
            "per_axis": list(self.per_axis),
        }


def per_axis(
    compared: Compared, given: np.ndarray, choices: Mapping[int, str]
) -> tuple[dict[str, Any], ...]:
    """List the errors of each axis, ready for JSON. What is not finite becomes None.

    Args:
        compared: The model against classical identification.
        given: Error of the given model, shape (n_axes,).
        choices: Where the numbers of a drive come from, by axis from 0, if not from the fit.

    Returns:
        The content of `Calibrated.per_axis`.
    """

    def plain(value: float) -> float | None:
        return float(value) if np.isfinite(value) and value < BAD else None

    return tuple(
        {
            "axis": k + 1,
            "given": plain(given[k]),
            "classical": plain(compared.other[k]),
            "calibrated": plain(compared.error[k]),
            "interval": [plain(compared.low[k]), plain(compared.high[k])],
            "numbers": choices.get(k, "fit"),
        }
        for k in range(len(given))
    )


def at_bound(scale: float, prior_scales: Sequence[float]) -> list[str]:
    """Tell whether priors are as wide as they may be.

    Args:
        scale: The chosen prior scale.
        prior_scales: Those that were tried.

    Returns:
        One line, or none.
    """
    if len(prior_scales) < 2 or scale < max(prior_scales):
        return []
    return [
        f"the prior scale stands at the largest that was tried ({scale:g}): the given model is so "
        "far from the robot that single numbers of this one mean little"
    ]


def weaknesses(axes: Sequence[dict[str, Any]], weak: np.ndarray, worse: np.ndarray) -> list[str]:
    """Tell which axes have other numbers of the drive, and which predict worse.

    Args:
        axes: The content of `Calibrated.per_axis`.
        weak: Axes on which the fit was worse than classical identification or the given model.
        worse: Axes on which the model is worse than classical identification at last.

    Returns:
        One line for each.
    """
    lines = []
    for one in axes:
        k = one["axis"] - 1
        if one["numbers"] == GIVEN:
            lines.append(
                f"axis {k + 1} keeps friction, rotor inertia and offset of the given model, "
                "because the fitted ones predict worse"
            )
        elif one["numbers"] == AGAIN:
            lines.append(
                f"axis {k + 1}: friction, rotor inertia and offset were fitted once more to this "
                "axis alone, because it had become worse than before or than classical "
                "identification"
            )
        if worse[k]:
            low, high = (100 * x for x in one["interval"])
            lines.append(
                f"axis {k + 1} predicts worse than classical identification: error "
                f"{100 * one['calibrated']:.1f} instead of {100 * one['classical']:.1f} % "
                f"(difference {low:.1f} to {high:.1f} %, 95 % interval)"
            )
        elif weak[k] and one["numbers"] == "fit":
            lines.append(f"axis {k + 1} predicts worse than the given model")
    return lines


def severities(given: Robot, made: Robot) -> dict[str, dict[int, float]]:
    """Compute by how much each number of a model differs from the given one.

    Args:
        given: The given model.
        made: The other one.

    Returns:
        Severity of each number that differs, by name and axis. Friction that the given model lacks
        has none.
    """
    values: dict[str, dict[int, float]] = {}
    after = Drives.of(made).named()
    for name, before in Drives.of(given).named().items():
        if name == "offset":
            change = before - after[name]
        else:
            change = after[name] / np.where(before > 0, before, np.nan) - 1
        told = {k + 1: float(x) for k, x in enumerate(change) if np.isfinite(x) and x != 0}
        if told:
            values[NAMES[name]] = told
    heights = (Drives.of(given).rise, Drives.of(made).rise)
    told = {
        k + 1: float(new / old - 1)
        for k, (old, new) in enumerate(zip(*heights, strict=True))
        if old > 0 and abs(new / old - 1) > _ROUNDING
    }
    if told:
        values["static_friction"] = told
    lost = 1 - made.torque_gain / given.torque_gain
    if np.any(lost != 0):
        values[GAIN] = {k + 1: float(x) for k, x in enumerate(lost)}
    return values

"""A damaged tooth: while it is in mesh, once per turn, the gearbox leads by an angle."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from faultgen.effects.base import Effect
from faultgen.effects.elements import add_cogging, add_tendon, gear_ratio
from faultgen.effects.hooks import Place
from faultgen.effects.prior import Prior, Search, Seen
from faultgen.effects.ripple import motor_order, with_error
from faultgen.errors import InputError

if TYPE_CHECKING:
    from faultgen.simulation.cycle import Cycle

_SMALL = 1e-4  # of the peak: harmonics that are left out


def sharpness(width: float) -> int:
    """Return the power m of the pulse cos(x / 2)^(2 m), from its width [rad] at half its height."""
    if not 0.1 <= width <= 1:
        raise InputError(f"width: must be from 0.1 to 1 rad, not {width}")
    return round(np.log(0.5) / (2 * np.log(np.cos(width / 4))))


def pulse(angle: np.ndarray, phase: float, width: float) -> np.ndarray:
    """Compute the pulse cos(x / 2)^(2 m), once per turn, x from the phase.

    Args:
        angle: Angle of the shaft, any shape, in [rad].
        phase: Angle at which the pulse is 1 [rad].
        width: Width at half its height [rad].

    Returns:
        Same shape as the angle, without unit, from 0 to 1.
    """
    return np.cos((np.asarray(angle) - phase) / 2) ** (2 * sharpness(width))


def harmonics(width: float) -> np.ndarray:
    """Compute the amplitudes a of `pulse` as a sum of a_k cos(k x), k = 0, 1, ...

    They are binomials: the powers of cos(x / 2) = (exp(i x / 2) + exp(-i x / 2)) / 2. The last
    ones, which sum to less than `_SMALL`, are omitted.

    Args:
        width: Width of the pulse at half its height [rad].

    Returns:
        Shape (harmonics,), without unit.
    """
    from scipy.stats import binom  # takes a second, so only when needed

    m = sharpness(width)
    amplitudes = 2 * binom.pmf(m - np.arange(m + 1), 2 * m, 0.5)
    amplitudes[0] /= 2
    return amplitudes[: np.searchsorted(np.cumsum(amplitudes), 1 - _SMALL) + 1]


def add_tooth_damage(
    spec: mujoco.MjSpec, axis: int, severity: float, *, per: str, phase: float, width: float
) -> None:
    """Add an error e to the twist of the gearbox, e = severity times `pulse`.

    As with a transmission error, the elastic energy is k (twist + e)^2 / 2. It gives

        on the joint   k e
        on the rotor   -k e / n  -  k twist de/dq_m

    in addition to the healthy gearbox. Tendons of length q_m + b q and q_m - b q carry the sum and
    the difference of the first two terms. The difference of their lengths gives the last term. The
    term of second order, -k e de/dq_m, is ignored, and damping is that of the twist.

    Args:
        spec: The robot, edited in place.
        axis: Axis, from 1.
        severity: Height of the pulse [rad, joint side].
        per: 'motor' or 'joint': the shaft that turns the tooth.
        phase: Angle of the shaft at the middle of the pulse [rad].
        width: Width of the pulse at half its height [rad].
    """
    ratio = gear_ratio(spec, axis)
    order = motor_order(1.0, per, ratio)
    amplitudes = harmonics(width)
    force = float(spec.tendon(f"gearbox{axis}").stiffness[0]) * severity
    # small, so that the phase on the tendon is that of the motor up to the last harmonic
    b = 1.0 / max(1.0, abs(order) * (len(amplitudes) - 1))
    name = f"tooth_damage{axis}"
    for side in (b, -b):
        tendon = add_tendon(spec, name, {f"motor{axis}": 1.0, f"joint{axis}": side})
        share = force / 2 * (1 / side - 1 / ratio)
        seen = order / (1 + side / ratio)  # turns of the shaft a turn of the tendon
        for k, amplitude in enumerate(amplitudes.tolist()):
            add_cogging(spec, name, tendon, share * amplitude, k * seen, np.pi / 2 - k * phase)


def log_tooth_damage(truth: Cycle, logged: Cycle, place: Place) -> Cycle:
    """Add the torque of the pulse to the logged torque of the gearbox.

    Args:
        truth: The cycle as it was simulated.
        logged: The cycle as it is logged so far.
        place: Where the effect acts, and its severity.

    Returns:
        The cycle with the changed channel.
    """
    given, i = place.parameters, place.axis - 1
    turned = truth.motor_position[:, i] * motor_order(1.0, given["per"], place.robot.gear_ratio[i])
    error = place.severity * pulse(turned, given["phase"], given["width"])
    return with_error(logged, place, error)


def _lead(seen: Seen, parameters: Mapping[str, Any]) -> np.ndarray:
    """Error of the gearbox of a pulse of 1 rad."""
    shaft = seen.motor if parameters["per"] == "motor" else seen.joint
    return pulse(shaft, parameters["phase"], parameters["width"])


EFFECTS = (
    Effect(
        name="tooth_damage",
        description="a tooth is chipped or pitted: the gearbox leads while it is in mesh, "
        "once a turn of the motor or of the joint",
        unit="rad, joint side, at the peak",
        units="rad",
        slide_units="m",
        signature="a short pulse and its ringing at one angle of the shaft, once a turn",
        element="tooth_damage{i}, two passive dcmotors with cogging for each harmonic of the pulse",
        prior=Prior(
            use="searched",
            search=(
                Search(
                    parameter="phase",
                    spacing=0.1,
                    others={"per": "motor"},
                    cause=_lead,
                    twists=True,
                ),
                Search(
                    parameter="phase",
                    spacing=0.1,
                    within_motion=True,
                    others={"per": "joint"},
                    cause=_lead,
                    twists=True,
                ),
            ),
        ),
        source="displacement of a damaged tooth as a local transmission error; its form, "
        "cos(x / 2)^(2 m), and width at half height [rad of the shaft] are assumed",
        largest=0.01,
        step=3e-5,
        parameters={"per": "motor", "phase": 0.0, "width": 0.5},
        edit=add_tooth_damage,
        last=True,
        log=log_tooth_damage,
    ),
)
"""Effects of this family."""

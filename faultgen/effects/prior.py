"""What discovery assumes about an effect before it has seen any data.

Every effect has such a record. It states whether the effect is a candidate, how large the effect is
in healthy robots, and with which severities it is probed. The standard deviations of the catalogue
stand in one table with their reasons and sources, `spreads`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import mujoco
import numpy as np

from faultgen.effects.spreads import CENTRE, LINKS, SPREADS, TURNED
from faultgen.errors import InputError
from faultgen.mjcf.dcmotor import COULOMB, OFFSET

if TYPE_CHECKING:
    from faultgen.robot import Robot

OnAxis: TypeAlias = "Callable[[Robot, int], float]"
"""Function of a robot and an axis (from 1)."""

Variants: TypeAlias = "Callable[[Robot, int], Sequence[Mapping[str, Any]]]"
"""Function of a robot and an axis (from 1) that lists sets of parameters."""

LINK_STD = SPREADS[LINKS].std
"""How far the mass, size and place of links may be off, as a fraction."""


@dataclass(frozen=True, eq=False)
class Seen:
    """Motion of one axis, as an effect sees it. Arrays have shape (samples,)."""

    robot: Robot
    """The unchanged model."""
    axis: int
    """From 1."""
    joint: np.ndarray
    """Position of the joint [rad], or [m]."""
    motor: np.ndarray
    """Position of the motor [rad]."""
    velocity: np.ndarray
    """Speed of the motor [rad/s]."""
    torque: np.ndarray
    """Torque of the motor of the unchanged model [N m]."""


@dataclass(frozen=True, kw_only=True)
class Search:
    """How the place at which an effect acts is searched for."""

    parameter: str
    """Parameter of the effect that is the place, an angle in [rad]; [m] for a joint that slides."""
    spacing: float
    """Distance between the places that are tried."""
    cause: Callable[[Seen, Mapping[str, Any]], np.ndarray]
    """What severity 1 does, as a function of the motion and all parameters: a torque on the rotor
    [N m], or with `twists` an error of the gearbox [rad, joint side]; shape (samples,)."""
    twists: bool = False
    """Whether the cause is an error of the gearbox, and not a torque."""
    within_motion: bool = False
    """Whether places are angles of the joint. Those of the motion are tried. Otherwise, places are
    phases, and a whole turn is tried."""
    others: Mapping[str, Any] = field(default_factory=dict)
    """Other parameters, if they differ from the defaults of the effect."""


@dataclass(frozen=True, kw_only=True)
class Prior:
    """What discovery assumes about one effect."""

    use: Literal["always", "on request", "periodic", "searched", "never"] = "always"
    """When the effect is a candidate. A periodic effect is probed at many orders, and its phase is
    fitted. A searched one acts at one place, which `search` says how to find."""
    reason: str = ""
    """Why it is a candidate only on request, or never."""
    std: float | OnAxis = 0.0
    """Standard deviation of the severity among healthy robots, in the unit of the effect."""
    steps: tuple[float, ...] = ()
    """Severities with which the effect is probed; several for an effect that is far from linear in
    its severity."""
    steps_in_std: float = 0.0
    """The same as a multiple of the standard deviation, for an effect that is linear in its
    severity. Give either this or `steps`."""
    play: bool = False
    """Whether the shape of the torque changes so much with the severity that slopes lead nowhere.
    A fit then tries severities over a wide range."""
    scan: tuple[float, ...] = ()
    """Further severities at which a play is looked for, on all axes in one simulation."""
    variants: Variants | None = None
    """Sets of parameters of the effect. Each of them is a candidate. None: the defaults."""
    search: tuple[Search, ...] = ()
    """How the place of a searched effect is found; the best place of all searches counts."""
    group: str = ""
    """Candidates of one group on one axis can imitate each other's laws together: two of them are
    named on one axis only if both are large."""
    in_every_model: bool = False
    """Whether the severity changes a number that every model has. Calibration fits these."""
    own_axis_only: bool = False
    """Whether the effect changes the torque of other axes so little that it is probed on all axes
    in one simulation: by less than 10 % of its change of all torques, except at low speed."""
    at_motor: bool = False
    """Whether the effect acts on the rotors. A torque sensor behind the gearbox sees only how the
    servo corrects it, which depends on the real servo more than on the effect."""

    def problem(self) -> str:
        """State what is wrong with the record in one line; empty if nothing is."""
        if self.use == "never":
            return "" if self.reason else "use = 'never' needs a reason"
        if (self.use == "searched") != bool(self.search):
            return "give search with use = 'searched', and only then"
        if self.use == "searched":
            return ""
        if self.use == "on request" and not self.reason:
            return "use = 'on request' needs a reason"
        if not callable(self.std) and not self.std > 0:
            return "std must be positive: the standard deviation among healthy robots"
        if bool(self.steps) == (self.steps_in_std > 0):
            return "give either steps or steps_in_std"
        return ""

    def std_on(self, robot: Robot, axis: int) -> float:
        """Return the standard deviation of the severity on one axis.

        Args:
            robot: The robot.
            axis: Axis, from 1.

        Returns:
            Standard deviation among healthy robots, in the unit of the effect.
        """
        return float(self.std(robot, axis) if callable(self.std) else self.std)

    def steps_on(self, robot: Robot, axis: int) -> tuple[float, ...]:
        """Return the severities with which the effect is probed on one axis.

        Args:
            robot: The robot.
            axis: Axis, from 1.

        Returns:
            Severities, in the unit of the effect.
        """
        return self.steps or (self.steps_in_std * self.std_on(robot, axis),)

    def variants_on(self, robot: Robot, axis: int) -> list[dict[str, Any]]:
        """Return the sets of parameters with which the effect is probed on one axis.

        Args:
            robot: The robot.
            axis: Axis, from 1.

        Returns:
            The parameters that differ from the defaults of the effect, at least one set.
        """
        if self.variants is None:
            return [{}]
        return [dict(one) for one in self.variants(robot, axis)]


def check_prior(name: str, prior: Prior | None) -> None:
    """Refuse an effect that does not state what discovery assumes about it.

    Args:
        name: Name of the effect.
        prior: Its record.

    Raises:
        InputError: There is no record, or it is incomplete. The message names the effect.
    """
    if prior is None:
        raise InputError(
            f"effect {name}: has no prior, which states what discovery assumes about it; give "
            "prior=Prior(std=..., steps=(...,)), or Prior(use='never', reason='...')"
        )
    if not isinstance(prior, Prior):
        raise InputError(f"effect {name}: prior must be a Prior, not {type(prior).__name__}")
    if problem := prior.problem():
        raise InputError(f"effect {name}: prior: {problem}")


def of_motor_torque(share: float) -> OnAxis:
    """Standard deviation of a severity that is a torque on the rotor.

    Args:
        share: Share of the motor's torque limit. A motor without a limit counts as one of 20 times
            its Coulomb friction.

    Returns:
        Function that returns the torque, motor side [N m].
    """

    def std(robot: Robot, axis: int) -> float:
        friction = robot.ids("actuator", "friction")[axis - 1]
        assumed = 20 * float(robot.model.actuator_biasprm[friction, COULOMB])
        return share * min(float(robot.motor_torque_limit[axis - 1]), assumed)

    return std


def of_joint_torque(share: float) -> OnAxis:
    """Standard deviation of a severity that is a torque on the joint.

    Args:
        share: Share of the motor's torque limit times the gear ratio.

    Returns:
        Function that returns the torque, joint side [N m].
    """

    def std(robot: Robot, axis: int) -> float:
        return of_motor_torque(share)(robot, axis) * abs(float(robot.gear_ratio[axis - 1]))

    return std


def of_gearbox_angle(share: float) -> OnAxis:
    """Standard deviation of a severity that is an angle between the two sides of the gearbox.

    Args:
        share: Share of the motor's torque limit that this angle costs in a stiff gearbox.

    Returns:
        Function that returns the angle, joint side [rad].
    """

    def std(robot: Robot, axis: int) -> float:
        gearbox = robot.ids("tendon", "gearbox")[axis - 1]
        stiffness = float(robot.model.tendon_stiffness[gearbox])
        return of_joint_torque(share)(robot, axis) / stiffness

    return std


def torque_offset_std(robot: Robot, axis: int) -> float:
    """Standard deviation of a torque offset: a small one of any motor, and a share of its own.

    Args:
        robot: The robot.
        axis: Axis, from 1.

    Returns:
        The torque, motor side [N m].
    """
    friction = robot.model.actuator_biasprm[robot.ids("actuator", "friction")[axis - 1]]
    own = friction[OFFSET] * np.sin(friction[OFFSET + 2])
    return float(
        np.hypot(of_motor_torque(SPREADS["torque_offset"].std)(robot, axis), LINK_STD * own)
    )


def encoder_zero_std(robot: Robot, axis: int) -> float:
    """Standard deviation of an encoder's zero.

    It covers errors of mastering, and errors of the centre of mass. A centre of mass that is
    shifted across the arm looks like another zero, and more so if it is near the axis. On the last
    axis it covers the angle at which the payload is mounted.

    Args:
        robot: The robot.
        axis: Axis, from 1.

    Returns:
        The angle [rad].
    """
    if axis == robot.n_axes:
        return SPREADS[TURNED].std
    model = robot.model
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    joint = model.joint(f"joint{axis}").id
    lever = data.subtree_com[model.jnt_bodyid[joint]] - data.xanchor[joint]
    across = SPREADS[CENTRE].std
    turned = across / max(float(np.linalg.norm(lever)), across)
    return float(np.hypot(SPREADS["encoder_offset"].std, turned))

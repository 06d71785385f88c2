"""The drives of a model as numbers: rotor inertia, friction, offset, and a model with others.

drives = Drives.of(robot)
rougher = built(robot, replace(drives, coulomb=2 * drives.coulomb))
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from faultgen.discovery.laws.friction_law import set_bristles
from faultgen.discovery.rigid.regression import DRIVE
from faultgen.discovery.terms.candidates import Term
from faultgen.discovery.terms.inertia import apply_inertia
from faultgen.effects.coupling import add_coupling_friction
from faultgen.effects.friction import add_offset
from faultgen.effects.motor import scale_rotor_inertia
from faultgen.errors import SimulationFailed, one_line
from faultgen.mjcf.edit import set_numeric
from faultgen.mjcf.rotors import nest_rotor
from faultgen.robot import COULOMB, OFFSET, STICTION, Robot

NAMES = dict(
    zip(
        DRIVE,
        ("rotor_inertia", "coulomb_friction", "viscous_friction", "torque_offset"),
        strict=True,
    )
)
"""Effect that changes each parameter of the drives."""

GAIN = "torque_constant"
"""Effect for which MJCF has no element. The robot's `torque_gain` represents it."""

_NEW = 3.0  # growth of friction from which the model's bristles do not fit it any more


@dataclass(frozen=True, eq=False)
class Drives:
    """Parameters of the drives as the model has them. Arrays of shape (n_axes,), motor side."""

    inertia: np.ndarray
    """Inertia of the rotor [kg m^2]."""
    coulomb: np.ndarray
    """Coulomb friction [N m]."""
    viscous: np.ndarray
    """Viscous friction [N m s/rad]."""
    offset: np.ndarray
    """Torque that the motor needs in addition [N m]."""
    rise: np.ndarray
    """Static friction above Coulomb friction [N m]."""

    @staticmethod
    def of(robot: Robot) -> Drives:
        """Read them from a model."""
        model, friction = robot.model, robot.ids("actuator", "friction")
        bias = model.actuator_biasprm[friction]
        constant = bias[:, OFFSET + 1] == 0  # a ripple without poles
        return Drives(
            model.dof_M0[list(robot.motors)].copy(),
            bias[:, COULOMB].copy(),
            model.actuator_damping[friction].copy(),
            np.where(constant, -bias[:, OFFSET] * np.sin(bias[:, OFFSET + 2]), 0.0),
            bias[:, STICTION] - bias[:, COULOMB],
        )

    def named(self) -> dict[str, np.ndarray]:
        """Return the arrays by the names of `DRIVE`.

        Returns:
            Arrays of shape (n_axes,).
        """
        return dict(
            zip(DRIVE, (self.inertia, self.coulomb, self.viscous, self.offset), strict=True)
        )


def built(
    given: Robot,
    drives: Drives,
    links: Sequence[tuple[Term, float]] = (),
    couplings: Sequence[tuple[int, float, np.ndarray]] = (),
    gain: np.ndarray | None = None,
) -> Robot:
    """Give a model other drives, links and couplings.

    Args:
        given: The model.
        drives: Its new drives.
        links: Changes of its links.
        couplings: Axis, ratio and parameters (`COUPLING`) of each new coupling.
        gain: Motor torque over the torque of the given model's log, shape (n_axes,). None: as it
            is.

    Returns:
        The model with these parameters.

    Raises:
        SimulationFailed: MuJoCo cannot compile it.
    """
    spec = given.spec()
    apply_inertia(spec, given, links)
    before = Drives.of(given)
    for k in range(given.n_axes):
        scale_rotor_inertia(spec, k + 1, drives.inertia[k] / before.inertia[k] - 1)
        friction = spec.actuator(f"friction{k + 1}")
        friction.biasprm[COULOMB] = drives.coulomb[k]
        friction.biasprm[STICTION] = drives.coulomb[k] + drives.rise[k]
        friction.damping[0] = drives.viscous[k]
        if drives.coulomb[k] > _NEW * before.coulomb[k]:  # bristles for another order of size
            set_bristles(spec, k + 1, drives.coulomb[k], drives.inertia[k], spec.option.timestep)
        if drives.offset[k] != before.offset[k]:
            add_offset(spec, k + 1, before.offset[k] - drives.offset[k])
    for axis, ratio, (inertia, coulomb, viscous) in couplings:
        add_coupling_friction(spec, axis, coulomb, ratio=ratio)
        spec.actuators[-1].damping[0] = viscous
        spec.tendons[-1].armature = inertia
        nest_rotor(spec, axis)
    return edited(given, spec, given.torque_gain * (1.0 if gain is None else gain))


def edited(robot: Robot, spec: mujoco.MjSpec, torque_gain: np.ndarray) -> Robot:
    """Compile an edited model, and make a robot of it.

    Args:
        robot: The robot before the edit.
        spec: Its specification with the edit. It is changed and compiled.
        torque_gain: Torque of the motors over the torque that is logged, shape (n_axes,).

    Returns:
        The robot with the edited model.

    Raises:
        SimulationFailed: MuJoCo cannot compile it.
    """
    if np.any(torque_gain != 1):
        set_numeric(spec, "torque_gain", torque_gain.tolist())
    try:
        spec.compile()
    except ValueError as error:
        line = one_line(error)
        raise SimulationFailed(f"MuJoCo cannot compile the changed model: {line}") from None
    return robot.edited(spec)

"""How the motors of a robot turn with its joints.

Usually a gearbox turns with its own joint alone: q_motor = n q_joint. In coupled wrists and
parallelograms it also turns with another joint: q_motor = n (q_joint + c q_other). The tendon of
such a gearbox then has a third joint with the coefficient -c.

    gearing = robot.gearing
    gearing.outputs(q) * robot.gear_ratio  # angles of the motors
"""

from __future__ import annotations

from functools import cached_property

import mujoco
import numpy as np


def tendon_coefficients(model: mujoco.MjModel, tendon: int) -> np.ndarray:
    """Read how the length of a fixed tendon changes with the joints.

    Args:
        model: The compiled model.
        tendon: Id of the tendon.

    Returns:
        Its coefficient on each degree of freedom, shape (nv,).
    """
    length = np.zeros(model.nv)
    start = model.tendon_adr[tendon]
    for wrap in range(start, start + model.tendon_num[tendon]):
        if model.wrap_type[wrap] == int(mujoco.mjtWrap.mjWRAP_JOINT):
            length[model.jnt_dofadr[model.wrap_objid[wrap]]] = model.wrap_prm[wrap]
    return length


class Gearing:
    """The gearboxes of a robot as matrices.

    Args:
        model: The compiled model.
        tendons: Id of each gearbox, shape (n_axes,).
        motors: Index of each rotor's degree of freedom, shape (n_axes,).
        joints: Index of each arm joint's degree of freedom, shape (n_axes,).
        ratio: Rotor turns per joint turn, shape (n_axes,).
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        tendons: np.ndarray,
        motors: np.ndarray,
        joints: np.ndarray,
        ratio: np.ndarray,
    ) -> None:
        length = np.stack([tendon_coefficients(model, tendon) for tendon in tendons])
        self.ratio = ratio
        """Rotor turns per joint turn, shape (n_axes,)."""
        self.matrix = -np.linalg.solve(length[:, motors], length[:, joints])
        """R of motor angles = R joint angles, shape (n_axes, n_axes)."""
        own = np.diag(np.diag(self.matrix))
        self.coupled = (self.matrix != own).any(axis=1)
        """Whether a gearbox also turns with another joint, shape (n_axes,)."""

    @cached_property
    def _turns(self) -> np.ndarray | None:
        """C of gearbox outputs = C joint angles; None where it is the identity."""
        return self.matrix / self.ratio[:, None] if self.coupled.any() else None

    def outputs(self, joint: np.ndarray) -> np.ndarray:
        """Compute how the outputs of the gearboxes turn with the joints.

        Args:
            joint: Position, velocity or acceleration of the joints, shape (..., n_axes).

        Returns:
            The same of the outputs, same shape. Times the gear ratio, it is that of the motors.
        """
        return joint if self._turns is None else joint @ self._turns.T

    def joints(self, motor: np.ndarray, twist: np.ndarray | None = None) -> np.ndarray:
        """Compute the joints' positions or velocities from those of the motors.

        Args:
            motor: Position or velocity of the motors, shape (..., n_axes).
            twist: Twist of the gearboxes or its rate, same shape. Default: none.

        Returns:
            Position or velocity of the joints, same shape.
        """
        output = motor / self.ratio
        if twist is not None:
            output = output - twist
        return output if self._turns is None else np.linalg.solve(self._turns, output.T).T

    def torque(self, load: np.ndarray) -> np.ndarray:
        """Compute the torque that the gearboxes must transmit.

        Args:
            load: Torque on the joints, shape (..., n_axes), in [N m].

        Returns:
            Torque of the gearboxes at their outputs, same shape.
        """
        return load if self._turns is None else np.linalg.solve(self._turns.T, load.T).T

"""From the motor side of the gearboxes to the joint side, by the gearing that a model states.

The model couples rotors and joints by fixed tendons ``gearbox1``, ``gearbox2``, … of the length
``a q_motor + c q_joint``, which is zero if the gearbox does not twist. A tendon may contain further
joints, as in coupled wrists.

    gearing = Gearing.of(model)
    gearing.joint_positions(motor_positions)
"""

from __future__ import annotations

from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np

from faultgen.errors import InputError


@dataclass(frozen=True, eq=False)
class Gearing:
    """How the rotors turn with the joints, if no gearbox twists."""

    motor_per_joint: np.ndarray
    """Rotor turns of each axis (row) per turn of each joint (column), shape (n_axes, n_axes)."""

    @classmethod
    def of(cls, model: str) -> Gearing:
        """Read the gearing of a model.

        Args:
            model: The MJCF text of a robot, as in the array ``/model`` of a run.

        Returns:
            Its gearing.

        Raises:
            InputError: The text is no model of a robot with gearboxes.
        """
        try:
            root = ElementTree.fromstring(model)
        except ElementTree.ParseError as error:
            raise InputError(f"model: is no XML ({error})") from None
        boxes = {one.get("name", ""): one for one in root.iterfind(".//tendon/fixed")}
        n_axes = sum(name.startswith("gearbox") for name in boxes)
        motors, joints = np.zeros((n_axes, n_axes)), np.zeros((n_axes, n_axes))
        for axis in range(n_axes):
            for part in boxes.get(f"gearbox{axis + 1}", ()):
                name, coefficient = part.get("joint", ""), float(part.get("coef", "nan"))
                for kind, matrix in (("motor", motors), ("joint", joints)):
                    if name.startswith(kind) and name[len(kind) :].isdigit():
                        matrix[axis, int(name[len(kind) :]) - 1] = coefficient
        try:
            return cls(-np.linalg.solve(motors, joints))
        except np.linalg.LinAlgError:
            raise InputError("model: its gearboxes do not couple each rotor to a joint") from None

    def joint_positions(self, motor: np.ndarray) -> np.ndarray:
        """Convert positions or velocities of the rotors.

        Args:
            motor: Positions [rad] or velocities [rad/s] of the rotors, shape (samples, n_axes).

        Returns:
            Those of the joints, same shape and unit.
        """
        found: np.ndarray = np.linalg.solve(self.motor_per_joint, motor.T).T
        return found

    def motor_positions(self, joint: np.ndarray) -> np.ndarray:
        """Convert positions or velocities of the joints.

        Args:
            joint: Positions [rad] or velocities [rad/s] of the joints, shape (samples, n_axes).

        Returns:
            Those of the rotors, same shape and unit.
        """
        found: np.ndarray = joint @ self.motor_per_joint.T
        return found

    def joint_torques(self, motor: np.ndarray) -> np.ndarray:
        """Convert torques so that their power is the same on both sides.

        Args:
            motor: Torques of the motors [N m], shape (samples, n_axes).

        Returns:
            Torques on the joints [N m], same shape.
        """
        found: np.ndarray = motor @ self.motor_per_joint
        return found

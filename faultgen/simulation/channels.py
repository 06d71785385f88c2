"""The channels of a simulated cycle (positions, velocities, torques), from MuJoCo's records."""

from __future__ import annotations

import mujoco
import numpy as np

from faultgen.effects.elements import ONE_WAY
from faultgen.mjcf.gearbox import Gearbox
from faultgen.robot import BRISTLE_STIFFNESS, Robot
from faultgen.simulation.cycle import Cycle

RECORD = ("actuator_length", "actuator_velocity", "actuator_force", "ten_length", "ten_velocity")
"""Names of the recorded fields of MuJoCo. All of them describe the state before the step."""


class Channels:
    """The places of a robot's channels in the recorded fields of one of its models.

    Args:
        robot: The healthy robot.
        model: The model that is simulated, which may have faults.
    """

    def __init__(self, robot: Robot, model: mujoco.MjModel) -> None:
        self.robot = robot
        self.model = model
        self.drive = model.actuator_outadr[robot.ids("actuator", "drive", model)]
        self.friction = robot.ids("actuator", "friction", model)
        self.tendon = robot.ids("tendon", "gearbox", model)
        self.gearbox = Gearbox(model, self.tendon)
        self.extra = _further_friction(robot, model)

    def cycle(self, kept: dict[str, np.ndarray], damping: np.ndarray) -> Cycle:
        """Compute the channels of a cycle from its recorded fields.

        Args:
            kept: Recorded fields by name, each of shape (samples, elements), in SI units.
            damping: Viscous friction of each axis, shape (samples, n_axes), in [N m s/rad].

        Returns:
            The cycle.
        """
        model = self.model
        position = kept["actuator_length"][:, self.drive]
        velocity = kept["actuator_velocity"][:, self.drive]
        twist = kept["ten_length"][:, self.tendon]
        twist_rate = kept["ten_velocity"][:, self.tendon]
        # MuJoCo applies an actuator's damping apart from its force
        viscous = -damping * velocity
        for power, coefficient in enumerate(model.actuator_dampingpoly[self.friction].T, start=1):
            viscous = viscous - coefficient * velocity * np.abs(velocity) ** power
        force = kept["actuator_force"]
        friction = force[:, model.actuator_outadr[self.friction]] + viscous
        for output, on_rotors in self.extra:
            friction = friction + force[:, [output]] * on_rotors
        return Cycle(
            motor_position=position,
            motor_velocity=velocity,
            motor_torque=force[:, self.drive] / self.robot.torque_gain,
            friction_torque=friction,
            gear_torque=self.gearbox.torque(twist, twist_rate),
            joint_position=self.robot.gearing.joints(position, twist),
            joint_velocity=self.robot.gearing.joints(velocity, twist_rate),
        )


def _further_friction(robot: Robot, model: mujoco.MjModel) -> list[tuple[int, np.ndarray]]:
    """Outputs of the friction elements that effects added, and their lever arms on the rotors."""
    own = set(robot.ids("actuator", "friction", model).tolist())
    lugre = model.actuator_dynprm[:, BRISTLE_STIFFNESS] * (
        model.actuator_dyntype == mujoco.mjtDyn.mjDYN_DCMOTOR
    )
    for k in range(model.nactuator):
        if model.actuator(k).name.startswith(ONE_WAY):
            lugre[k] = 1.0
    found = []
    for k in (k for k in np.flatnonzero(lugre).tolist() if k not in own):
        on_joint = np.zeros(model.njnt)
        target = model.actuator_trnid[k, 0]
        if model.actuator_trntype[k] == mujoco.mjtTrn.mjTRN_TENDON:
            start = model.tendon_adr[target]
            wraps = slice(start, start + model.tendon_num[target])
            on_joint[model.wrap_objid[wraps]] = model.wrap_prm[wraps]
        elif model.actuator_trntype[k] == mujoco.mjtTrn.mjTRN_JOINT:
            on_joint[target] = 1.0
        motors = [model.joint(f"motor{i + 1}").id for i in range(robot.n_axes)]
        found.append((int(model.actuator_outadr[k]), on_joint[motors]))
    return found

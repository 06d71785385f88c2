"""Parameters of a dcmotor in MuJoCo's parameter arrays."""

from __future__ import annotations

import mujoco

# in mjModel.actuator_gainprm
POSITION_GAIN, INTEGRAL_GAIN, VELOCITY_GAIN = 4, 5, 6
# in mjModel.actuator_biasprm
OFFSET, COULOMB, STICTION, STRIBECK_VELOCITY = 0, 3, 4, 5
# in mjModel.actuator_dynprm
BRISTLE_STIFFNESS, BRISTLE_DAMPING = 5, 6


def set_servo(drive: mujoco.MjsActuator, position: float, integral: float, velocity: float) -> None:
    """Give a drive other gains. Its integral is a state of the model only if it has a gain.

    Args:
        drive: The dcmotor, edited in place.
        position: Gain of the position error [N m/rad].
        integral: Gain of its integral [N m/(rad s)].
        velocity: Gain of the velocity error [N m s/rad].
    """
    drive.gainprm[[POSITION_GAIN, INTEGRAL_GAIN, VELOCITY_GAIN]] = position, integral, velocity
    drive.actdim = int(integral != 0)

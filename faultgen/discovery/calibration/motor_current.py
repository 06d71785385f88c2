"""Recordings of the motor current, whose torque constant and offset are not known.

The current of an axis is its motor torque over a torque constant, plus an offset of the sensor.
Both are found from a recording of a robot that the model describes:

    constants = constants_of(recording, robot)
    in_torque(recording, robot, constants).torque  # in [N m]

The start is a least-squares fit of each axis. The physical model (`physical.fit`) is then fitted
with free friction and masses within their priors: weight and inertia determine the constants, and
friction, which changes most in a robot, does not shift them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from faultgen.discovery.laws.friction_law import with_friction_law
from faultgen.discovery.rigid.drives import GAIN, Drives
from faultgen.discovery.rigid.physical import Spread, fit
from faultgen.discovery.rigid.regression import Regression
from faultgen.discovery.terms.candidates import INERTIA
from faultgen.effects import get_effect
from faultgen.errors import InputError
from faultgen.recordings.recording import Recording, TorqueConstants
from faultgen.robot import Robot
from faultgen.simulation.arm import Arm, motor_torque

_WIDE = 0.5  # prior standard deviation of a torque constant, as a share of it: assumed
_ROUNDS = 5  # in which the constants are found at most, each from those of the round before
_SETTLED = 1e-3  # change of a constant at which they are found
_KNOWN = (INERTIA, "rotor_inertia")  # friction changes more than masses do


def constants_of(recording: Recording, robot: Robot) -> TorqueConstants:
    """Find the torque constants and offsets with which a model explains the currents.

    Args:
        recording: A recording of motor currents.
        robot: The model. Friction that it lacks is found as well.

    Returns:
        The constants. An axis whose current does not change gets 1 N m/A.

    Raises:
        InputError: Too little of the recording moves.
    """
    current = recording.torque
    q, qd, qdd = recording.derivatives(recording.joint_position(robot))
    needed = motor_torque(Arm(robot), q, qd, qdd)
    size = np.ptp(current, axis=0)
    constant = np.ones(robot.n_axes)
    for axis in np.flatnonzero(size > 0):
        columns = np.stack([current[:, axis], np.ones(len(current))], axis=1)
        slope = abs(float(np.linalg.lstsq(columns, needed[:, axis])[0][0]))
        constant[axis] = slope or 1.0
    spread = Spread(_WIDE / get_effect(GAIN).prior.std_on(robot, 1), _KNOWN, far=True)
    offset = np.zeros(robot.n_axes)
    for _ in range(_ROUNDS):
        motor = replace(
            recording,
            side="motor",
            position=recording.motor_position(robot),
            velocity=None,
            torque=constant * current,
        )
        lawful = with_friction_law(robot, motor)
        regression = Regression(motor, lawful)
        if not regression.products.count.sum():
            raise InputError(
                f"{recording.source}: too little of it moves to find the torque constants; give a "
                "longer recording, or motor_torque instead of motor_current"
            )
        fitted = fit(regression, regression.products, spread)
        gain = np.where(size > 0, fitted.gain, 1.0)
        constant = constant * gain
        offset = (fitted.drives.offset - Drives.of(lawful).offset) / constant
        if np.abs(gain - 1).max() < _SETTLED:
            break
    return TorqueConstants(constant, np.where(size > 0, offset, 0.0), recording.source)


def in_torque(recording: Recording, robot: Robot, constants: TorqueConstants) -> Recording:
    """Convert motor currents to torque.

    Args:
        recording: A recording of motor currents.
        robot: The model.
        constants: Torque constants and offsets.

    Returns:
        The recording with the torque that the log of the model has, on the side of its positions.
    """
    torque = constants.constant * (recording.torque - constants.offset) / robot.torque_gain
    if recording.side == "joint":
        torque = torque * robot.gear_ratio
    return replace(recording, torque=torque, current=False, constants=constants)

"""What the drives of arms usually have: laws that were fitted to arms whose drives are known.

The arms, with their sources, stand in known_drives.toml; benchmarks/real_robots/known_drives.py
fits the laws and shows how far they are off on each arm when they are fitted to the others.

    usual_torque(weight_torque=1.5, largest=60.0)  # of a wrist axis [N m]
"""

from __future__ import annotations

TORQUE, TORQUE_AT = 1.66, 150.0
"""Torque limit of the strongest axis over the weight torque of the arm, where that is 150 N m."""
TORQUE_SIZE, TORQUE_SHARE = -0.21, 0.42
"""How this ratio falls with the weight torque of the arm, and how the torque limit of an axis falls
with its own share of the weight torque: exponents."""
LEAST_SHARE = 3e-3
"""Smallest share of the weight torque with which an axis counts: that of the known arms."""
HOLD = 1.5
"""Smallest torque limit that is assumed, over the torque against gravity. Motions use up to 85 % of
the limit, so that about a fifth is left in the worst pose, also where the model lacks the balancer
of the real arm. Assumed; the known arms have 0.96, with a balancer, to 3.3 on axis 2."""
RUN_UP, RUN_UP_AT, RUN_UP_SIZE = 0.024, 100.0, 0.28
"""Time in which a motor without load reaches its speed limit at its torque limit [s] where the
torque limit of the joint is 100 N m, and how it grows with the torque limit: exponent."""
MOTOR_SPEED = 280.0
"""Speed of a motor at the speed limit of its joint [rad/s]."""
COULOMB = 0.056
"""Coulomb friction over the torque limit."""
VISCOUS = 2.5
"""Viscous friction at the speed limit over Coulomb friction."""
WIND_UP = 3.2e-3
"""Twist of a gearbox at its torque limit [rad]."""


def usual_torque(weight_torque: float, largest: float, gravity: float = 0.0) -> float:
    """Return the torque limit that drives of such an arm usually have.

        T = 1.66 G (G / 150 N m)^-0.21 (L / G)^0.42, and at least 1.5 times what gravity asks for

    The wrist of an arm is stronger than its own load asks for, and large arms have less to spare
    than small ones.

    Args:
        weight_torque: L, the largest torque of the weight of all that the axis carries, if the axis
            lay horizontally [N m].
        largest: G, the largest one of all axes of the arm [N m].
        gravity: Torque that holds the arm against gravity [N m].

    Returns:
        Torque limit at the joint [N m].
    """
    scale = TORQUE * (largest / TORQUE_AT) ** TORQUE_SIZE
    share = max(weight_torque / largest, LEAST_SHARE)
    return max(scale * largest * share**TORQUE_SHARE, HOLD * gravity)


def run_up_time(torque_limit: float) -> float:
    """Return the time in which the motor of an axis usually reaches its speed limit without load.

    Args:
        torque_limit: Torque limit at the joint [N m].

    Returns:
        Time [s].
    """
    return RUN_UP * (torque_limit / RUN_UP_AT) ** RUN_UP_SIZE

"""Columns of the parameter table of a robot: one row an axis, SI units, motor side if not said.

`dynamics` reads them by number inside numba; `physics` and `effects` write them by the same names.
"""

from __future__ import annotations

NAMES = (
    # gearbox, rotor, servo
    "N",  # gear ratio, signed
    "J",  # rotor inertia [kg m^2]
    "K",  # gearbox stiffness, joint side [N m/rad]
    "D",  # gearbox damping, joint side [N m s/rad]
    "KP",  # servo gain [N m/rad]
    "KD",  # servo gain [N m s/rad]
    "LIMIT",  # motor torque limit [N m]
    # friction of the healthy robot
    "MODE",  # 0 LuGre, 1 three elastic-plastic elements, 2 steep tanh
    "FC",  # Coulomb [N m]
    "FS",  # static [N m]
    "VS",  # Stribeck velocity [rad/s]
    "EXPONENT",  # Stribeck exponent
    "FV",  # viscous [N m s/rad]
    "F0",  # constant torque on the rotor [N m]
    "S0",  # bristle stiffness [N m/rad]
    "S1",  # bristle damping, LuGre only [N m s/rad]
    "W0",  # speed of the tanh [rad/s]
    # effects, 0 is off
    "COULOMB",  # level [N m]
    "COULOMB_W",  # speed at which half of it is there [rad/s]
    "STATIC",  # height at rest [N m]
    "STATIC_EXP",  # its exponent
    "STRIBECK",  # relative change of the Stribeck velocity
    "STRIBECK_EXP",  # exponent of the curve that changes
    "VISCOUS",  # torque = VISCOUS |w|^VISCOUS_EXP
    "VISCOUS_EXP",
    "QUADRATIC",  # torque = QUADRATIC |w|^QUADRATIC_EXP
    "QUADRATIC_EXP",
    "ASYMMETRY",  # level where the motor turns forward [N m]
    "ASYMMETRY_W",  # speed of the transition [rad/s]
    "LOAD",  # level = LOAD |gear torque / n|^LOAD_EXP
    "LOAD_EXP",
    "PLAY",  # half of the backlash, joint side [rad]
    "PLAY_SOFT",  # softness of its corners [rad]
    "HARD",  # second stiffness [N m/rad], beyond
    "HARD_FROM",  # this twist [rad]
    "SOFT",  # share of stiffness that is lost at rest
    "SOFT_TWIST",  # twist at which the loss has fallen by half [rad]
    "WAVE",  # transmission error, joint side [rad]
    "WAVE_ORDER",  # waves a motor turn
    "WAVE_PHASE",  # [rad]
    "RIPPLE",  # torque ripple [N m]
    "RIPPLE_ORDER",  # waves a motor turn
    "RIPPLE_PHASE",  # [rad]
    "CONSTANT",  # share of the motor torque that is lost
    "CONSTANT_SLOPE",  # part of the loss that grows with |torque| / limit
    "SPRING",  # joint torque = -SPRING sin(SPRING_RATE q) [N m]
    "SPRING_RATE",
    "COUPLING",  # friction between this axis and the one before, joint side [N m]
    "COUPLING_W",  # its speed [rad/s], joint side
    "DELAY",  # set points late [s]
    "ENCODER",  # joint angle minus logged angle [rad]
    # effects that no catalogue has
    "SPOT",  # seizing spot: level [N m]
    "SPOT_AT",  # joint angle [rad]
    "SPOT_WIDTH",  # [rad]
    "TOOTH",  # damaged tooth: kick [N m], once a motor turn
    "TOOTH_AT",  # motor angle [rad]
    "TOOTH_WIDTH",  # [rad]
    "PERIODIC",  # friction level that comes and goes with the motor angle [N m]
    "PERIODIC_ORDER",
    "LAG",  # friction level with the sign of acceleration [N m]
    "LAG_TIME",  # [s]
    "LAG_W",  # [rad/s]
    "CLIP",  # share of the torque limit that is lost at CLIP_W, linear with speed
    "CLIP_W",  # [rad/s]
)
INDEX = {name: number for number, name in enumerate(NAMES)}
"""Number of each column."""

# the same numbers as constants, for numba
# fmt: off
(
    N, J, K, D, KP, KD, LIMIT, MODE, FC, FS, VS, EXPONENT, FV, F0, S0, S1, W0, COULOMB,
    COULOMB_W, STATIC, STATIC_EXP, STRIBECK, STRIBECK_EXP, VISCOUS, VISCOUS_EXP, QUADRATIC,
    QUADRATIC_EXP, ASYMMETRY, ASYMMETRY_W, LOAD, LOAD_EXP, PLAY, PLAY_SOFT, HARD, HARD_FROM,
    SOFT, SOFT_TWIST, WAVE, WAVE_ORDER, WAVE_PHASE, RIPPLE, RIPPLE_ORDER, RIPPLE_PHASE, CONSTANT,
    CONSTANT_SLOPE, SPRING, SPRING_RATE, COUPLING, COUPLING_W, DELAY, ENCODER, SPOT, SPOT_AT,
    SPOT_WIDTH, TOOTH, TOOTH_AT, TOOTH_WIDTH, PERIODIC, PERIODIC_ORDER, LAG, LAG_TIME, LAG_W,
    CLIP, CLIP_W,
) = range(len(NAMES))
# fmt: on

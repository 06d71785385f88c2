"""Columns of the table of one axis' drivetrain, its effects and its servo; SI, motor side.

`plant` reads them by number inside numba; `robots`, `servo` and `effects` write them by name.
"""

from __future__ import annotations

NAMES = (
    # drivetrain
    "RATIO",  # turns of the rotor over motion of the joint, signed
    "ROTOR",  # inertia [kg m^2]
    "STIFF",  # gearbox, joint side [N m/rad]
    "DAMP",  # gearbox, joint side [N m s/rad]
    "LIMIT",  # [N m]
    "OFFSET",  # constant torque on the rotor [N m]
    # friction of the healthy robot: Coulomb + rise exp(-|w| / speed), viscous
    "COULOMB",  # [N m]
    "RISE",  # static minus Coulomb [N m]
    "SPEED",  # [rad/s]
    "VISCOUS",  # [N m s/rad]
    "REST",  # Dahl's stiffness at rest [N m/rad]
    "SMOOTH",  # share of the level that is a tanh of speed and not of displacement
    "TANH",  # its speed [rad/s]
    # effects; 0 is off
    "X_COULOMB",  # level at the speed X_REF [N m]; a weak power of speed
    "X_STATIC",  # Lorentzian at low speed [N m]
    "X_STRIBECK",  # relative change of SPEED
    "X_VISCOUS",  # relative change of VISCOUS; thins with speed
    "X_QUADRATIC",  # level at the speed X_REF [N m]; power 2.2
    "X_ONE_WAY",  # level where the motor turns forward [N m]
    "X_LOAD",  # level over the gearbox's torque at the load X_LOAD_REF; power 1.1
    "X_PLAY",  # backlash, joint side, all of it [rad]
    "X_SOFT",  # share of the stiffness that is lost
    "X_HARD",  # hardening: relative rise of stiffness at 1 mrad of twist
    "X_WAVE",  # transmission error, joint side [rad]
    "X_RIPPLE",  # [N m]
    "X_ORDER",  # waves a motor turn of both
    "X_PHASE",  # [rad]
    "X_CONSTANT",  # share of the torque that is lost
    "X_TORQUE",  # constant torque on the rotor that drifts [N m]
    "X_SPRING",  # joint torque over angle, falls off a little [N m/rad]
    "X_WRIST",  # friction between this joint and the one before [N m]
    "X_DELAY",  # of the set points [s]
    "X_ENCODER",  # joint angle minus logged angle [rad]
    "X_REF",  # RMS motor speed [rad/s]
    "X_LOAD_REF",  # RMS torque of the gearbox over the ratio [N m]
    "X_TWIST_REF",  # RMS twist [rad]
    # effects that no catalogue has
    "U_LAG",  # friction level that follows the acceleration [N m]
    "U_HOSE",  # torque of a dress pack with hysteresis, joint side [N m]
    "U_HOSE_WIDTH",  # joint angle over which it turns [rad]
    "U_WARM",  # friction level that decays within the recording [N m]
    "U_PLACE",  # friction level that depends on the joint angle [N m]
    "U_GAIN",  # share of the servo's gains that is lost
    "U_CLIP",  # torque limit over LIMIT that is left at high speed; 0 is off
    # servo
    "TYPE",  # of `servo.TYPES`
    "PERIOD",  # [s]
    "KP",  # PD: [N m/rad]; cascade: [1/s]
    "KD",  # PD: [N m s/rad]; cascade: speed loop [N m s/rad]
    "KI",  # PD: [N m/(rad s)]; cascade: [N m/rad]
    "FORWARD",  # share of the feed-forward torque
    "FORWARD_SPEED",  # share of the velocity set point
)
INDEX = {name: number for number, name in enumerate(NAMES)}
"""Number of each column."""
# fmt: off
(
    RATIO, ROTOR, STIFF, DAMP, LIMIT, OFFSET, COULOMB, RISE, SPEED, VISCOUS, REST, SMOOTH, TANH,
    X_COULOMB, X_STATIC, X_STRIBECK, X_VISCOUS, X_QUADRATIC, X_ONE_WAY, X_LOAD, X_PLAY, X_SOFT,
    X_HARD, X_WAVE, X_RIPPLE, X_ORDER, X_PHASE, X_CONSTANT, X_TORQUE, X_SPRING, X_WRIST, X_DELAY,
    X_ENCODER, X_REF, X_LOAD_REF, X_TWIST_REF, U_LAG, U_HOSE, U_HOSE_WIDTH, U_WARM, U_PLACE,
    U_GAIN, U_CLIP, TYPE, PERIOD, KP, KD, KI, FORWARD, FORWARD_SPEED,
) = range(len(NAMES))
# fmt: on

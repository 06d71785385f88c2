"""Indices of the parameters of a dcmotor in MuJoCo's parameter arrays."""

# in mjModel.actuator_gainprm
POSITION_GAIN, VELOCITY_GAIN = 4, 6
# in mjModel.actuator_biasprm
OFFSET, COULOMB, STICTION, STRIBECK_VELOCITY = 0, 3, 4, 5
# in mjModel.actuator_dynprm
BRISTLE_STIFFNESS, BRISTLE_DAMPING = 5, 6

"""How far healthy robots differ from their models: one table, each value with reason and source.

The standard deviations are those of a robot whose model was made for it, from one day to the next
or after a calibration. From unit to unit of a type, friction differs ten times as much: discovery
learns from the recording how many times wider all numbers of one kind are, and `calibrate` chooses
it by cross-validation. The limits say where a number stops being physical.

    SPREADS["viscous_friction"].std       # 0.05
    SPREADS["viscous_friction"].assumed   # False: it was published
"""

from __future__ import annotations

from dataclasses import dataclass

_FRANKA = (
    "Gaz et al. 2019, doi 10.1109/LRA.2019.2931248: friction of the seven joints of a Franka Panda"
)
_MOTORS = "Kollmorgen AKMH manual, definition of the technical data: tolerance of +-10 %"
_WARM = (
    "Raviola et al. 2021, doi 10.3390/robotics10030083: viscous friction of a UR3 and a UR5 falls "
    "by 20 and 17 % while they warm up"
)
_UR10E = (
    "own measurement, benchmarks/real_robots/reference_ur10e.py: "
    "0.5 to 5 % between recordings of a UR10e"
)
_ABSENT = "healthy robots do not have it: what is left is too small to be seen"


@dataclass(frozen=True)
class Spread:
    """How far one number of a healthy robot is from its model."""

    std: float
    """Standard deviation, in the unit of the effect or as `of` says."""
    reason: str
    """Why it is this value."""
    source: str = ""
    """Where the figures come from; empty if there is none."""
    of: str = ""
    """What `std` is a share of, if not of the number itself."""
    factor: float = 0.0
    """Largest ratio of the number to that of the model, and of the model to it, in a robot of the
    same type; 0 where nothing is known."""

    @property
    def assumed(self) -> bool:
        """Whether no source states the value."""
        return not self.source


LINKS = "inertia"
"""Name of the spread of masses, sizes and places of links."""
CENTRE = "encoder_offset by the centre of mass"
"""Name of the spread of centres of mass across the arm, which look like another zero."""
TURNED = "encoder_offset of the payload"
"""Name of the spread of the angle of the payload about the last axis."""

UNIT_TO_UNIT = 0.4
"""Standard deviation of friction from unit to unit of one type of joint, as a share. Source:
`_FRANKA`: the Coulomb level phi1 of joints 1 to 4, which have the same drive, has a mean of 0.835
and a standard deviation of 0.33 N m (39 %); joints 5 to 7 have 47 %."""

_FACTOR = 3.0
"""Three standard deviations of a log-normal spread of 40 % from unit to unit: exp(3 x 0.37) = 3.
The spread is published, but three of them, and the rule when `calibrate` goes further, were chosen
while the errors of the TX40 and the Gen3 were looked at (benchmarks/real_robots/real_arms.py):
those errors are no independent test of this limit. That rotor inertia and stiffness have it too is
assumed."""

TORQUE_CONSTANT = 0.1
"""Largest error of a torque constant on a data sheet, as a share. Source: `_MOTORS`."""

SPREADS = {
    "coulomb_friction": Spread(
        0.035, "between days of one robot, after warming up", _UR10E, factor=_FACTOR
    ),
    "viscous_friction": Spread(
        0.05,
        "uniform over the 17 to 20 % of a warm-up: 0.18 / sqrt(12)",
        _WARM,
        factor=_FACTOR,
    ),
    "static_friction": Spread(
        0.05,
        "as the friction above it: the same surfaces and lubricant",
        factor=_FACTOR,
    ),
    "stribeck_velocity": Spread(
        0.05,
        "as viscous friction: the minimum of the Stribeck curve is at one Hersey number, viscosity "
        "times speed over load, so that the velocity goes with the inverse of the viscosity",
        _WARM,
        factor=_FACTOR,
    ),
    "rotor_inertia": Spread(
        0.035, "a tolerance of 10 % as three standard deviations", _MOTORS, factor=_FACTOR
    ),
    "torque_constant": Spread(
        0.002,
        "the drive's log is taken for calibrated; 0.2 % is a magnet that is 1 or 2 K warmer. "
        "Constants of data sheets, +-10 %, come in only with a current instead of a torque",
    ),
    "torque_offset": Spread(2e-4, "zero of a drive's current sensor", of="torque limit"),
    "gear_stiffness": Spread(
        0.1,
        "catalogues of harmonic drives state averages of tests without a tolerance",
        factor=_FACTOR,
    ),
    "stiffness_hardening": Spread(
        1.0, "every gearbox of this kind is stiffer under load, and models often leave it out"
    ),
    "payload_mass": Spread(0.035, "a load that was weighed with its screws and cables left out"),
    "payload_offset": Spread(2e-3, "place of a load of which a drawing exists [m]"),
    "friction_wear": Spread(0.002, _ABSENT),
    "quadratic_viscous_friction": Spread(3e-4, _ABSENT),
    "friction_asymmetry": Spread(3e-4, _ABSENT),
    "load_friction": Spread(3e-5, _ABSENT),
    "temperature_friction": Spread(5e-4, _ABSENT),
    "wrist_coupling_friction": Spread(1e-5, _ABSENT, of="torque limit"),
    "gravity_spring": Spread(4e-6, _ABSENT, of="torque limit per rad"),
    "viscous_asymmetry": Spread(0.01, "lubricant that is thicker on one side: a usual machine"),
    "low_speed_friction": Spread(0.01, "another form of the Stribeck curve"),
    "backlash": Spread(2e-6, "less than a gearbox of a robot has when it is new [rad]"),
    "loose_tool": Spread(1e-5, _ABSENT),
    "torque_ripple": Spread(2e-5, "what is left after the drive compensated it", of="torque limit"),
    "transmission_error": Spread(
        2e-5, "what is left after the drive compensated it", of="torque limit, in a stiff gearbox"
    ),
    "encoder_offset": Spread(2e-4, "mastering of an axis [rad]"),
    CENTRE: Spread(3e-4, "as seen on healthy development robots of this project [m]"),
    TURNED: Spread(0.02, "a load that is bolted to the flange is turned by some 1 degree [rad]"),
    LINKS: Spread(
        0.03,
        "masses and sizes of links by CAD, without cables and screws; centres of mass twice as "
        "much of their distance from the joint",
    ),
    "delay": Spread(6e-4, "part of a cycle of a bus of 1 kHz [s]"),
}
"""Spread of each effect by its name, and of three things that effects resemble."""

"""Robots that are off: every parameter 1 to 5 % wrong, and friction of another form.

The same list of parameters serves as what a discovery without a healthy twin has to calibrate
(`limits`): `baseline` names them, `perturbed` changes one.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from sealed.chain import Chain
from sealed.columns import INDEX
from sealed.dynamics import STEP
from sealed.physics import Physics

OFF = (0.01, 0.05)
"""Relative size of a parameter's error; its sign is random."""
DRIVETRAIN = ("FC", "FS", "VS", "FV", "F0", "J", "K", "D")
"""Columns that are off; FS means the height of the Stribeck curve above FC."""
EXPONENTS = ((1.2, 1.9), (2.1, 2.6))
"""Stribeck exponents of the robots; the model has 2."""
ELASTIC_PLASTIC, TANH = 1, 2
"""Friction at rest: three elastic-plastic elements, or a steep tanh."""
SHARE_TANH = 0.25
"""Share of the robots with the latter: under it an axis creeps where it should rest."""

Parameter = tuple[str, int, int]
"""Kind, link or axis from 0, component."""


def baseline(physics: Physics) -> list[Parameter]:
    """Every parameter that is off; the Stribeck exponent comes last for each axis."""
    axes = physics.chain.n_axes
    bodies = range(axes + 1)
    names: list[Parameter] = [("mass", b, 0) for b in bodies]
    names += [("com", b, c) for b in bodies for c in range(3)]
    names += [("inertia", b, c) for b in bodies for c in range(3)]
    names += [(column, a, 0) for column in DRIVETRAIN for a in range(axes)]
    names += [("EXPONENT", a, 0) for a in range(axes)]
    return names


def length_scale(chain: Chain) -> np.ndarray:
    """Compute the lengths of which centres of mass are off by a share.

    They are twice the distance of the centre of mass from the link's frame, at least 5 cm.

    Args:
        chain: The links.

    Returns:
        Lengths [m], shape (n_axes + 1,).
    """
    return np.maximum(2 * np.linalg.norm(chain.com, axis=1), 0.05)


def perturbed(physics: Physics, changes: dict[Parameter, float]) -> Physics:
    """Change parameters.

    Args:
        physics: The robot.
        changes: Relative change of each; of centres of mass as a share of `length_scale`, of the
            Stribeck exponent absolute.

    Returns:
        The changed robot.
    """
    chain, table = physics.chain, physics.table.copy()
    mass, com = chain.mass.copy(), chain.com.copy()
    frames = [np.linalg.eigh(tensor) for tensor in chain.inertia]
    moments = np.array([values for values, _ in frames])
    scale = length_scale(chain)
    for (kind, index, component), change in changes.items():
        if kind == "mass":
            mass[index] *= 1 + change
            moments[index] *= 1 + change
        elif kind == "com":
            com[index, component] += change * scale[index]
        elif kind == "inertia":
            moments[index, component] *= 1 + change
        elif kind == "EXPONENT":
            table[index, INDEX[kind]] += change
        elif kind == "FS":
            coulomb, static = table[index, INDEX["FC"]], table[index, INDEX["FS"]]
            table[index, INDEX["FS"]] = static + change * (static - coulomb)
        elif kind == "FC":
            growth = change * table[index, INDEX["FC"]]
            table[index, INDEX["FC"]] += growth
            table[index, INDEX["FS"]] += growth
        else:
            table[index, INDEX[kind]] *= 1 + change
    inertia = np.array(
        [axes @ np.diag(values) @ axes.T for values, (_, axes) in zip(moments, frames, strict=True)]
    )
    return Physics(chain=replace(chain, mass=mass, com=com, inertia=inertia), table=table)


def steepest_tanh(physics: Physics) -> np.ndarray:
    """Speed of the steepest tanh that the step still follows, shape (n_axes,), in [rad/s]."""
    return physics.column("FS") * STEP / (1.5 * physics.column("J"))


def other_forms(nominal: Physics) -> list[Physics]:
    """The nominal robot with friction that is another at rest, axis by axis.

    Elastic-plastic elements, the same 1.2 times as stiff, and the tanh, on each axis in turn.
    """
    steepest = steepest_tanh(nominal)
    forms = []
    for row in range(len(nominal.table)):
        stiffer = 1.2 * float(nominal.column("S0")[row])
        forms += [
            nominal.changed(row + 1, MODE=ELASTIC_PLASTIC),
            nominal.changed(row + 1, MODE=ELASTIC_PLASTIC, S0=stiffer),
            nominal.changed(row + 1, MODE=TANH, W0=2 * float(steepest[row])),
        ]
    return forms


def random_robot(nominal: Physics, rng: np.random.Generator) -> Physics:
    """A healthy robot unlike the model: parameters off, another friction law.

    Args:
        nominal: The robot of the MJCF.
        rng: Source of randomness.

    Returns:
        The robot.
    """
    names = [name for name in baseline(nominal) if name[0] != "EXPONENT"]
    sizes = rng.uniform(*OFF, len(names)) * rng.choice([-1.0, 1.0], len(names))
    robot = perturbed(nominal, dict(zip(names, sizes.tolist(), strict=True)))
    table = robot.table
    axes = len(table)
    mode = TANH if rng.uniform() < SHARE_TANH else ELASTIC_PLASTIC
    table[:, INDEX["MODE"]] = mode
    for axis in range(axes):
        table[axis, INDEX["EXPONENT"]] = rng.uniform(*EXPONENTS[int(rng.integers(2))])
    table[:, INDEX["S0"]] *= rng.uniform(0.7, 1.4, axes)
    table[:, INDEX["W0"]] = steepest_tanh(robot) * rng.uniform(1.0, 1.5, axes)
    return robot

"""Write puma560_reference.json from Peter Corke's Robotics Toolbox for Python.

The toolbox is only needed to regenerate the file, not to run the tests::

    python3 -m venv rtbenv
    rtbenv/bin/pip install roboticstoolbox-python==1.5.0
    rtbenv/bin/python tests/data/make_puma560_reference.py

Conventions of the written values (SI units, joint side, standard DH):

* ``gravity_vector`` is the acceleration of free fall in the base frame, whose z axis points up.
  Toolbox 1.5.0 defaults to ``[0, 0, -9.81]``; passing ``[0, 0, 9.81]`` to it negates ``gravity``.
* ``tau_*`` and ``gravity`` are the torques the actuators must supply.
* ``friction`` is ``link.friction(qd)``: the torque friction exerts on the joint, opposing ``qd``.
  So ``tau_full = tau_motor_inertia - friction``.
* ``Tc`` is ``[Tc+, Tc-]`` at the motor, chosen by the sign of the *joint* velocity.
* ``r`` and ``I`` are in the frame at the end of the link, ``I`` about the centre of mass.
"""

from __future__ import annotations

import json
import re
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import roboticstoolbox as rtb
from numpy.typing import NDArray

Array = NDArray[np.float64]

OUTPUT = Path(__file__).with_name("puma560_reference.json")
SEED = 560
STATES = 40
INERTIA_STATES = 5
GRAVITY = (0.0, 0.0, -9.81)
TOLERANCE = 1e-9


def make_robot(*, motor_inertia: bool, friction: bool) -> Any:
    """Build a Puma 560 with the chosen drive effects.

    Args:
        motor_inertia: Keep the motor inertia Jm of the toolbox.
        friction: Keep the viscous and Coulomb friction of the toolbox.

    Returns:
        The toolbox robot.
    """
    robot = rtb.models.DH.Puma560()
    robot.gravity = list(GRAVITY)
    for link in robot.links:
        if not motor_inertia:
            link.Jm = 0.0
        if not friction:
            link.B = 0.0
            link.Tc = [0.0, 0.0]
    return robot


def inverse_dynamics(robot: Any, q: Array, qd: Array, qdd: Array) -> Array:
    """Evaluate the recursive Newton-Euler algorithm for many states.

    Args:
        robot: Toolbox robot.
        q: Joint angles, one state a row.
        qd: Joint velocities.
        qdd: Joint accelerations.

    Returns:
        Joint torques, one state a row.
    """
    return np.array([robot.rne(*state) for state in zip(q, qd, qdd, strict=True)])


def describe_link(link: Any) -> dict[str, Any]:
    """Read the parameters of one link from the toolbox object.

    Args:
        link: Toolbox DH link.

    Returns:
        DH parameters, inertial parameters and drive parameters.
    """
    names = ("d", "a", "alpha", "offset", "m", "Jm", "G", "B")
    values: dict[str, Any] = {name: float(getattr(link, name)) for name in names}
    return values | {name: getattr(link, name).tolist() for name in ("r", "I", "Tc", "qlim")}


def check(name: str, actual: Array, expected: Array) -> None:
    """Print the largest difference of two arrays and refuse a large one.

    Args:
        name: What is compared.
        actual: First array.
        expected: Second array.

    Raises:
        ValueError: If the arrays differ by more than the tolerance.
    """
    error = float(np.max(np.abs(actual - expected)))
    print(f"{name:45s} {error:.2e}")
    if not error <= TOLERANCE:
        raise ValueError(f"{name}: difference {error:.3g}")


def build() -> dict[str, Any]:
    """Compute and cross-check the reference values.

    Returns:
        The content of the JSON file.
    """
    rigid = make_robot(motor_inertia=False, friction=False)
    geared = make_robot(motor_inertia=True, friction=False)
    full = make_robot(motor_inertia=True, friction=True)

    rng = np.random.default_rng(SEED)
    lower, upper = np.asarray(full.qlim, dtype=np.float64)
    q = rng.uniform(lower, upper, size=(STATES, 6))
    qd = rng.uniform(-2.0, 2.0, size=q.shape)
    qdd = rng.uniform(-5.0, 5.0, size=q.shape)
    zero = np.zeros_like(q)

    robots = {"tau_rigid": rigid, "tau_motor_inertia": geared, "tau_full": full}
    tau = {name: inverse_dynamics(robot, q, qd, qdd) for name, robot in robots.items()}
    friction = np.array(
        [[link.friction(v) for link, v in zip(full.links, row, strict=True)] for row in qd]
    )
    gravity = np.array([rigid.gravload(row) for row in q])
    inertia = np.array([rigid.inertia(row) for row in q])
    velocity = np.array([rigid.coriolis(x, v) @ v for x, v in zip(q, qd, strict=True)])
    reflected = np.array([link.G**2 * link.Jm for link in full.links])

    for name, robot in robots.items():
        check(f"{name}, C against Python", tau[name], robot.rne_python(q, qd, qdd))
    check("tau_full - tau_motor_inertia", tau["tau_full"] - tau["tau_motor_inertia"], -friction)
    check(
        "tau_motor_inertia - tau_rigid",
        tau["tau_motor_inertia"] - tau["tau_rigid"],
        reflected * qdd,
    )
    check("tau_rigid at rest", inverse_dynamics(rigid, q, zero, zero), gravity)
    check(
        "M qdd + C qd + g",
        np.einsum("kij,kj->ki", inertia, qdd) + velocity + gravity,
        tau["tau_rigid"],
    )

    return {
        "toolbox": {"name": "roboticstoolbox-python", "version": version("roboticstoolbox-python")},
        "model": "roboticstoolbox.models.DH.Puma560",
        "seed": SEED,
        "d1": float(full.links[0].d),
        "base": full.base.A.tolist(),
        "tool": full.tool.A.tolist(),
        "gravity_vector": full.gravity.tolist(),
        "friction_sign": "opposes qd: tau_full = tau_motor_inertia - friction",
        "links": [describe_link(link) for link in full.links],
        "q": q.tolist(),
        "qd": qd.tolist(),
        "qdd": qdd.tolist(),
        **{name: values.tolist() for name, values in tau.items()},
        "gravity": gravity.tolist(),
        "friction": friction.tolist(),
        "inertia_matrix": inertia[:INERTIA_STATES].tolist(),
        "inertia_matrix_states": list(range(INERTIA_STATES)),
        "fkine": [full.fkine(row).A.tolist() for row in q],
        "named": {
            name: {
                "q": full.configs[name].tolist(),
                "fkine": full.fkine(full.configs[name]).A.tolist(),
            }
            for name in ("qz", "qr")
        },
    }


def main() -> None:
    """Write the reference file."""
    text = json.dumps(build(), indent=1)
    # One innermost list a line keeps the file readable; the numbers keep all 17 digits.
    text = re.sub(r"\[[^\[\]{}]*\]", lambda match: " ".join(match[0].split()), text)
    OUTPUT.write_text(text + "\n", encoding="utf-8")
    print(f"wrote {OUTPUT}")


if __name__ == "__main__":
    main()

"""Does discovery learn laws that no effect of the catalogue describes?

The PUMA performs three tasks, with and without a law on one axis, and 1 % of noise. The last of the
tasks is used neither for fitting nor for choosing. Laws are learned from the difference of the two
recordings. Without a law, nothing should be learned.

    python -m benchmarks.discovery.learned_laws
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import typer

from faultgen.discovery.fit.problem import Problem, division_of
from faultgen.discovery.laws.learned_law import learn
from faultgen.discovery.replay.replay import Replay
from faultgen.discovery.replay.sensitivities import sensitivities
from faultgen.discovery.terms.candidates import effect_terms
from faultgen.effects import EFFECTS, Applied
from faultgen.effects.learned import NAME
from faultgen.recordings.noise import Autoregression
from faultgen.recordings.noise_level import Noise
from faultgen.recordings.recording import Recording
from faultgen.robot import Robot, load_robot
from faultgen.simulation.motion import plan
from faultgen.tasks import load_task

TASKS = ("pick_and_place", "spot_weld", "arc_weld")
PERIOD = 0.004  # of the samples [s]
NOISE = 0.01  # of the RMS torque
SIZE = 0.06  # of a law, over the RMS torque
AXES = (2, 3)
_KNOWN = ("coulomb_friction", "viscous_friction", "torque_offset", "rotor_inertia")
_TURN = np.linspace(0, 2 * np.pi, 33)


def laws(size: float, low: float, high: float) -> dict[str, dict[str, Any]]:
    """Laws by name.

    Args:
        size: Size of the torque [N m].
        low: Lowest joint angle of the axis [rad].
        high: Highest joint angle [rad].
    """
    middle, quarter = (low + high) / 2, (high - low) / 4
    places = [middle - quarter, middle, middle + quarter]
    return {
        "friction that varies once a motor turn": {
            "over": "motor_turn",
            "scale": 2 * np.pi,
            "times": "direction",
            "knots": _TURN.tolist(),
            "values": (size * np.cos(_TURN)).tolist(),
        },
        "friction by acceleration": {
            "over": "push",
            "times": "direction",
            "knots": [-50.0, 50.0],
            "values": [-size, size],
        },
        "torque that lags by 30 ms": {
            "over": "torque_lag",
            "scale": 0.03,
            "knots": [-1.0, 1.0],
            "values": [0.2, -0.2],
        },
        "friction about one joint angle": {
            "over": "joint_angle",
            "times": "direction",
            "knots": places,
            "values": [0.0, 2 * size, 0.0],
        },
        "hysteresis": {
            "over": "hysteresis",
            "scale": 1.0,
            "knots": [-1.0, 1.0],
            "values": [-size, size],
        },
    }


def recorded(robot: Robot) -> Recording:
    """Three tasks of a robot, without torque."""
    parts = []
    for name in TASKS:
        motion = plan(load_task(robot.name, name), robot)
        parts.append(motion(np.arange(0, motion.period, PERIOD))[0])
    return Recording.planned(robot, parts, PERIOD)


def main(draws: int = 5) -> None:
    """Print a table with a row for each law and axis.

    Args:
        draws: Number of pairs of recordings without a law.
    """
    robot = load_robot("puma560")
    recording = recorded(robot)
    base = Replay(recording, robot).torque()
    replay = Replay(replace(recording, torque=base), robot)
    terms = effect_terms(robot, [name for name in EFFECTS if name not in _KNOWN])
    _, raw = sensitivities(replay, terms)
    deviation = NOISE * np.sqrt(np.mean(base**2, axis=0))
    white = Autoregression(np.zeros((robot.n_axes, 0)), np.sqrt(2) * deviation)
    rng = np.random.default_rng(0)

    def posed(change: np.ndarray | float) -> Problem:
        noise = deviation * rng.standard_normal((2, *base.shape))
        worn = replace(recording, torque=base + change + noise[0])
        own = Replay(worn, robot)
        return Problem(
            **vars(division_of(own, baseline=True)),
            replay=own,
            given=own,
            terms=terms,
            base=base,
            residual=change + noise[0] - noise[1],
            raw=raw,
            noise=Noise(white, np.ones(base.shape)),
            baseline=True,
            shared=np.zeros(robot.n_axes, bool),
        )

    print("| law | axis | learned |\n| --- | --- | --- |")
    for number in range(draws):
        problem = posed(0.0)
        found = learn(problem, problem.residual)
        told = "; ".join(f"{one.sentence}: {one.formula}" for one in found) or "nothing"
        print(f"| none, draw {number + 1} | | {told} |", flush=True)
    for axis in AXES:
        angle = recording.reference_position[:, axis - 1]  # type: ignore[index]
        size = SIZE * float(np.sqrt(np.mean(base[:, axis - 1] ** 2)))
        for name, law in laws(size, float(angle.min()), float(angle.max())).items():
            faulty = robot.with_effects([Applied(NAME, axis, 1.0, {"law": [law]})])
            problem = posed(Replay(recording, faulty).torque() - base)
            found = learn(problem, problem.residual)
            told = "; ".join(f"{one.sentence}: `{one.formula}`" for one in found) or "nothing"
            print(f"| {name} | {axis} | {told} |", flush=True)


if __name__ == "__main__":
    typer.run(main)

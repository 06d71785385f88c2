"""Which safe motion would distinguish the explanations that a recording cannot distinguish?"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import tomli_w

from faultgen.discovery.decision.choice import Choice
from faultgen.discovery.fit.fit import Group
from faultgen.discovery.fit.problem import Problem
from faultgen.discovery.replay.replay import Replay, settled
from faultgen.discovery.replay.sensitivities import sensitivities
from faultgen.errors import InputError, SimulationFailed
from faultgen.recordings.recording import Recording
from faultgen.robot import Robot
from faultgen.simulation.motion import plan
from faultgen.tasks import Task, load_task, task_names, task_text

_LONGEST = 20.0  # time of a motion that is looked at [s]


@dataclass(frozen=True)
class Experiment:
    """A motion that distinguishes two explanations."""

    task: str
    """Name of the task."""
    toml: str
    """Content of the task file."""
    separates: tuple[tuple[str, int], tuple[str, int]]
    """Effect and axis of the two explanations that are hardest to distinguish."""
    distance: float
    """Their distance on this motion after refitting, in standard deviations of the noise."""
    now: float
    """The same distance on the recording."""


def next_experiment(problem: Problem, choice: Choice) -> Experiment | None:
    """Choose a motion for an ambiguous answer.

    The candidates are the motions that come with the robot, and three motions within the joint
    angles and speeds of the recording. The chosen motion is the one whose closest pair of
    explanations is furthest apart (Hunter and Reiner 1965, with refitted severities).

    Args:
        problem: The residual and the terms.
        choice: The answer and its rivals.

    Returns:
        The best motion. None if there are no rivals, or if no motion is better than the recording.
    """
    pairs = []
    members = list(choice.best.members())
    for place, rival, share in choice.rivals:
        own, values, _ = members[place]
        # two hypotheses apart by d have a likelihood ratio of exp(d^2 / 2)
        ratio = choice.shares[place] / max(share, 1e-300)
        pairs.append((own, values, rival, 2 * np.log(max(ratio, 1.0))))
    used = sorted({t for own, _, rival, _ in pairs for t in (*own, *rival)})
    best: Experiment | None = None
    for name, toml in library(problem) if pairs else ():
        try:
            columns = _columns(problem, planned_recording(problem, name, toml), used)
        except (InputError, SimulationFailed):
            continue
        distances = [_distance(columns, own, values, rival) for own, values, rival, _ in pairs]
        k = int(np.argmin(distances))
        if best is None or distances[k] > best.distance:
            keys = problem.terms[pairs[k][0][0]].key, problem.terms[pairs[k][2][0]].key
            best = Experiment(name, toml, keys, distances[k], float(np.sqrt(pairs[k][3])))
    return best


def _columns(problem: Problem, recording: Recording, used: Sequence[int]) -> dict[int, np.ndarray]:
    """Whitened change of the torque per unit of some terms on a motion, shape (values,) each."""
    replay = Replay(recording, problem.robot)
    _, raw = sensitivities(replay, [problem.terms[t] for t in used])
    inside = settled(recording, problem.robot)
    white = problem.noise.colour.whiten(raw, recording.parts) * inside
    return {t: own.ravel().astype(float) for t, own in zip(used, white, strict=True)}


def _distance(
    columns: Mapping[int, np.ndarray], own: Group, values: np.ndarray, rival: Group
) -> float:
    """Whitened distance of two effects on a motion after the rival's severity was fitted again."""
    target = np.sum([v * columns[t] for t, v in zip(own, values, strict=True)], axis=0)
    others = np.stack([columns[t] for t in rival], axis=1)
    answer, *_ = np.linalg.lstsq(others, target, rcond=None)
    return float(np.linalg.norm(target - others @ answer))


def planned_recording(problem: Problem, name: str, toml: str) -> Recording:
    """Plan a motion, as a recording whose torque is not yet known.

    Args:
        problem: The recording whose side, sample period and mean temperature are taken over.
        name: Name of the task.
        toml: Content of the task file.

    Returns:
        The recording, with a torque of 0.

    Raises:
        InputError: The robot cannot do the task.
    """
    robot = problem.robot
    task = Task(**{"name": name, "robot": robot.name, **tomllib.loads(toml)})
    motion = plan(task, robot)
    period = problem.recording.sample_period
    times = np.arange(int(min(motion.period, _LONGEST) / period)) * period
    reference = motion(times)[0]
    motor = problem.recording.side == "motor"
    temperature = problem.recording.temperature
    return replace(
        problem.recording,
        source=name,
        position=robot.gearing.outputs(reference) * robot.gear_ratio if motor else reference,
        torque=np.zeros_like(reference),
        velocity=None,
        reference_position=reference,
        temperature=None
        if temperature is None
        else temperature.mean(axis=0) + np.zeros((len(times), *temperature.shape[1:])),
        segments=(0,),
    )


def library(problem: Problem) -> Iterator[tuple[str, str]]:
    """Names and task files of safe motions: those of the robot, and three within the recording."""
    robot = problem.robot
    for name in task_names(robot.name, robot.tasks):
        load_task(robot.name, name, robot.tasks)
        yield name, task_text(robot.name, name, robot.tasks)
    yield from _own(problem, robot)


def _own(problem: Problem, robot: Robot) -> Iterator[tuple[str, str]]:
    """Moves between joint angles that lie within the range of the recording."""
    recording = problem.recording
    joints = robot.to_degrees(recording.joint_position(robot))
    low, middle, high = np.quantile(joints, [0.15, 0.5, 0.85], axis=0)

    def task(text: str, moves: list[tuple[np.ndarray, float, float]]) -> str:
        content = {
            "description": text,
            "start": {"joints": _rounded(middle)},
            "move": [
                {"joints": _rounded(pose), "speed": speed, "dwell": dwell}
                for pose, speed, dwell in [*moves, (middle, 0.5, 0.2)]
            ],
        }
        return tomli_w.dumps(content)

    slow = middle + 0.2 * (high - low)
    yield (
        "slow_reversals",
        task("Slow moves that turn round", [(slow, 0.1, 0.5), (middle, 0.1, 0.5)] * 2),
    )
    ladder = [(pose, speed, 0.0) for speed in (0.1, 0.3, 0.6, 1.0) for pose in (high, low)]
    yield "speed_ladder", task("The same way at four speeds", ladder)
    corners = [np.where(np.arange(len(low)) % 2 == k, low, high) for k in (0, 1)]
    poses = [(pose, 0.7, 0.6) for pose in (low, corners[0], high, corners[1])]
    yield "poses", task("Rests in poses of different load, reached from both sides", poses * 2)


def _rounded(values: np.ndarray) -> list[float]:
    return [round(float(value), 3) for value in values]

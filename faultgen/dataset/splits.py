"""Fixed divisions of the runs of a dataset into a training, a validation and a test part.

A method that learns from labels must be tested on other runs than those from which it has learned.
The validation part is for whoever chooses a method or its settings: a choice that looks at the test
part makes the result of the test too good. Methods without such choices learn from both.
If all users of a dataset divide it in the same way, their results can be compared. The divisions
are therefore drawn once, from the seed of the experiment, and stored in ``runs.json``. They never
divide a run, because the cycles of a run share the robot, the fault and a drifting temperature.

    splits = make_splits(manifest.runs, seed=0)
    splits["run"]["test"]                       # ids of the runs on which methods are tested
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from faultgen.errors import InputError

SCHEMES = {
    "run": "whole runs, and all runs that share a seed together",
    "axis": "axes: no axis that wears in the test part wears in the training part",
    "robot": "robots, which may be instances of one model that differ in their parameters",
    "task": "tasks",
}
"""What each division holds apart, by its name."""

TRAIN, VALIDATION, TEST, UNUSED = "train", "validation", "test", "unused"
"""Parts of a division. A run is unused if it shares its seed with runs of the other part. Datasets
of older versions have no validation part; its runs are in the training part."""

PARTS = (TRAIN, VALIDATION, TEST, UNUSED)
"""All parts, in the order of tables."""

LEARNED_FROM = (TRAIN, VALIDATION)
"""Parts from which a method may learn that chooses nothing by the validation part."""

RunParts = dict[str, dict[str, list[str]]]
"""Ids of the runs by division and part."""

_TEST_SHARE = 0.3
"""Share of the test part; of the rest, the validation part has the same share."""

K = TypeVar("K", bound=Hashable)

_Runs = Mapping[str, Mapping[str, Any]]


def make_splits(runs: _Runs, seed: int) -> RunParts:
    """Draw all divisions that a dataset allows.

    About 30 % of the runs, axes, robots or tasks become the test part. The division by runs
    represents every robot, task and fault in both parts if it has several runs. In every division,
    the validation part has about 30 % of the other runs. It is drawn by runs, so that it has the
    robots, tasks and axes of the training part, never those that are held out. It never has the
    last training run of an effect on an axis, and may be empty.

    Args:
        runs: Parameters of every run by id, as in ``runs.json``.
        seed: Seed of the experiment.

    Returns:
        The divisions. One that is impossible is left out, such as that by tasks if the dataset has
        a single task.
    """
    chosen = {"run": _by_run(runs, _generator(seed, "run"))}
    in_test = chosen["run"]
    validated = _validated(runs, in_test, _generator(seed, VALIDATION))
    paired = len({run["seed"] for run in runs.values()}) < len(runs)
    for scheme, keys_of in _KEYS.items():
        keys = list(dict.fromkeys(key for run in runs.values() for key in keys_of(run)))
        held_out = drawn(keys, _generator(seed, scheme))
        chosen[scheme] = {
            i: bool(held_out & set(keys_of(run))) if keys_of(run) else in_test[i]
            for i, run in runs.items()
        }
    found: RunParts = {}
    for scheme, tested in chosen.items():
        parts: dict[str, list[str]] = {part: [] for part in PARTS}
        for i in runs:
            # twins share their noise: they must not stand on both sides
            twins = paired and tested[i] != in_test[i]
            learned = VALIDATION if i in validated else TRAIN
            parts[UNUSED if twins else TEST if tested[i] else learned].append(i)
        if parts[TRAIN] and parts[TEST]:
            found[scheme] = parts
    # without a worn axis on each side, a division by axes is none
    sides = [found.get("axis", {}).get(part, []) for part in (TRAIN, TEST)]
    if not all(any(runs[i]["axes"] for i in side) for side in sides):
        found.pop("axis", None)
    return found


def _robot(run: Mapping[str, Any]) -> list[tuple[str, str | None]]:
    return [(Path(run["robot"]).stem, run.get("model_sha256"))]


def check_division(splits: RunParts, part: str | None, by: str, where: Path) -> None:
    """Refuse a division or a part that a dataset does not have.

    Args:
        splits: Ids of the runs of each part, by division.
        part: "train", "validation" or "test"; None for all runs.
        by: Name of the division.
        where: Place of the dataset, for messages.

    Raises:
        InputError: There is no such division or part.
    """
    if part not in (None, TRAIN, VALIDATION, TEST):
        raise InputError(f"split: must be '{TRAIN}', '{VALIDATION}' or '{TEST}', not '{part}'")
    if by not in SCHEMES:
        raise InputError(f"there is no division by '{by}': choose {', '.join(SCHEMES)}")
    if part is not None and by not in splits:
        known = ", ".join(splits) or "none"
        raise InputError(
            f"{where}: has no division by {by}, because all of its runs would be on one "
            f"side, or because it is of an older version; it has: {known}"
        )
    if part == VALIDATION and not splits[by].get(VALIDATION):
        raise InputError(
            f"{where}: its division by {by} has no validation runs, because it has fewer "
            "than three runs of each fault or is of an older version; hold out some of the "
            f"groups of its '{TRAIN}' part, or generate a dataset with --repetitions 3"
        )


def robot_instance(run: Mapping[str, Any]) -> str:
    """Name a robot so that instances of one model that differ in their parameters differ in name.

    Args:
        run: Parameters of a run as in ``runs.json``, or the attributes of its file.

    Returns:
        The name of the model, and the first eight digits of the hash of the model.
    """
    name, model = _robot(run)[0]
    return f"{name}-{model[:8]}" if model else name


_KEYS: dict[str, Callable[[Mapping[str, Any]], Sequence[Hashable]]] = {
    "axis": lambda run: run["axes"],
    "robot": _robot,
    "task": lambda run: [Path(run["task"]).stem],
}
"""What is held apart; a run without any, which is healthy, is divided as by runs."""


def _generator(seed: int, scheme: str) -> np.random.Generator:
    """A stream of its own for each division, so that a further one leaves the others unchanged."""
    return np.random.default_rng([seed, *scheme.encode()])


def drawn(units: Sequence[K], rng: np.random.Generator) -> set[K]:
    """Draw the units of the test part: none of a single one, else some but not all.

    Args:
        units: What is divided.
        rng: Source of randomness.

    Returns:
        About 30 % of them.
    """
    count = int(_TEST_SHARE * len(units) + 0.5)
    count = min(max(count, 1), len(units) - 1) if len(units) > 1 else 0
    return {units[k] for k in rng.permutation(len(units))[:count].tolist()}


def _by_run(runs: _Runs, rng: np.random.Generator) -> dict[str, bool]:
    """Whether each run belongs to the test part of the division by runs."""
    by_seed: dict[int, list[str]] = {}
    for i, run in runs.items():
        by_seed.setdefault(run["seed"], []).append(i)
    groups: dict[Hashable, list[int]] = {}
    if len(by_seed) < len(runs):
        groups["paired"] = list(by_seed)
    else:
        for run in runs.values():
            fault = (run["effect"], tuple(run["axes"]), run["severity"])
            groups.setdefault((_robot(run)[0], run["task"], fault), []).append(run["seed"])
        # kinds of runs that occur only once are drawn from together, healthy and worn ones apart
        for key in [key for key, seeds in groups.items() if len(seeds) == 1]:
            (seed,) = groups.pop(key)
            single = "worn" if runs[by_seed[seed][0]]["axes"] else "healthy"
            groups.setdefault(single, []).append(seed)
    tested: set[Hashable] = set()
    for seeds in groups.values():
        tested |= drawn(seeds, rng)
    return {i: run["seed"] in tested for i, run in runs.items()}


def _validated(runs: _Runs, in_test: Mapping[str, bool], rng: np.random.Generator) -> set[str]:
    """Draw the validation part of the runs that the division by runs does not test."""
    left = {i: run for i, run in runs.items() if not in_test[i]}
    if len({run["seed"] for run in runs.values()}) < len(runs):
        seeds = drawn(list(dict.fromkeys(run["seed"] for run in left.values())), rng)
        return {i for i, run in left.items() if run["seed"] in seeds}
    groups: dict[Hashable, list[str]] = {}
    for i, run in left.items():
        groups.setdefault((*_place_and_fault(run), run["severity"]), []).append(i)
    # faults of one severity that are left once are drawn from those on the same axis
    for key in [key for key, ids in groups.items() if len(ids) == 1]:
        (i,) = groups.pop(key)
        groups.setdefault(_place_and_fault(runs[i]), []).append(i)
    return set().union(*(drawn(ids, rng) for ids in groups.values()))


def _place_and_fault(run: Mapping[str, Any]) -> tuple[Hashable, ...]:
    return _robot(run)[0], run["task"], run["effect"], tuple(run["axes"])

"""Cases of the laboratories, of the sealed simulator and of own data, made in batches.

for batch in planned("development", cache):
    entries = make(batch, trial)        # writes recordings, returns the truth
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from discovery.own_wear import CASES as OWN_CASES
from discovery.own_wear import write_case
from laboratories.draw import draw_cases, draw_laboratory
from laboratories.make import make_laboratory
from scoring import real
from sealed.cases import make_case
from sealed.effects import Effect
from sealed.limits import DETECTED, Limits
from sealed.plan import ROBOTS, Case, plan_cases

from faultgen.robot import load_robot

SETS = ("development", "report")
"""What is tuned is tuned on the first; the other is for one frozen version."""
LABORATORIES = 8
"""They cover all robots and factors that were added last; four robots each, in two modes."""
SEEDS = {"development": "development2", "report": "report8"}
SEALED_SEEDS = {"development": "development", "report": "report13"}
OTHER_SEEDS = {"development": 100, "report": 800}
"""Of own data, and of logs of the sealed simulator with 4900 more."""
SEALED = {"single": 8, "clean": 2}
"""Cases of each mode. Those whose effect the catalogue has to leave out cannot be asked for by the
public command; the laboratories have unlisted effects."""
SEALED_MULTIPLES = (2.0, 5.0)
LOGS = (
    ("torque_constant", 1, 0.03),
    ("torque_constant", 2, 0.15),
    ("torque_constant", 3, -0.2),
    ("delay", 2, 1e-3),
    ("torque_offset", 3, 0.05),
)
"""Of the sealed simulator, with a healthy recording: what only a log or a servo shows. Severities
in the unit of the catalogue; the torque offset is a share of the torque limit."""
OWN = ("friction_wear", "backlash", "torque_constant", "payload_mass", "delay", "")
"""Effects of the own data, of those in `own_wear.CASES`; the last robot is healthy."""
GROUPS = {
    "laboratory": ("laboratories, with baseline", "laboratories, alone"),
    "sealed": ("sealed, with baseline", "sealed, alone"),
    "own": ("own data, with baseline", "own data, alone"),
    "real": ("real machines", "real machines"),
}
"""Groups of the table by kind of batch: with a baseline, which is an earlier recording, and
without one."""

Batch = dict[str, Any]
"""`name` and `kind` (of `GROUPS`); `what` is all that its truth is drawn from, for JSON."""


def planned(which: str, cache: Path) -> list[Batch]:
    """All batches of a set.

    Args:
        which: Of `SETS`.
        cache: Folder for the sensitivities of the sealed simulator, on which its severities rest.
    """
    batches: list[Batch] = []
    for number in range(LABORATORIES):
        lab = draw_laboratory(SEEDS[which], number)
        drawn = {"laboratory": lab.as_dict(), "cases": [asdict(plan) for plan in draw_cases(lab)]}
        batches.append({"name": lab.name, "kind": "laboratory", "what": drawn})
    limits = {robot: Limits(robot, cache) for robot in ROBOTS}
    sealed: list[Case] = []
    for mode in ("twin", "alone"):
        sealed += plan_cases(SEALED_SEEDS[which], mode, limits, SEALED, SEALED_MULTIPLES)
    sealed = [_rounded(case) for case in sealed] + _logs(which, limits)
    batches += [{"name": case.name, "kind": "sealed", "what": case.as_dict()} for case in sealed]
    for number, name in enumerate(OWN):
        (case,) = (one for one in OWN_CASES if one[0] == name)
        seed = OTHER_SEEDS[which] + number
        own = {"effect": list(case), "seed": seed}
        batches.append({"name": f"own_{name or 'healthy'}", "kind": "own", "what": own})
    batches += [{"name": name, "kind": "real", "what": {}} for name in real.MACHINES]
    return batches


def _rounded(case: Case) -> Case:
    """The case with four digits of its severities, so that a plan is the same on any machine."""
    effects = (replace(e, severity=float(f"{e.severity:.4g}")) for e in case.effects)
    return replace(case, effects=tuple(effects))


def answers(planned: Sequence[Batch]) -> int:
    """Number of answers of some batches."""
    return sum(_answers(batch) for batch in planned)


def _answers(batch: Batch) -> int:
    """Number of answers of a batch."""
    if batch["kind"] == "laboratory":
        missing = batch["what"]["laboratory"]["factors"]["model_friction"] == "missing"
        return len(batch["what"]["cases"]) * (1 if missing else 2)
    return 2 if batch["kind"] == "own" else 1


def has(batch: Batch, only: Sequence[str]) -> bool:
    """Whether a batch may have a case whose group or name contains one of some texts."""
    groups = GROUPS[batch["kind"]]
    return not only or any(
        text in f"{group} {batch['name']}" or text.startswith(batch["name"])
        for text in only
        for group in groups
    )


def _logs(which: str, limits: Mapping[str, Limits]) -> list[Case]:
    """Cases of `LOGS`, on the two robots in turn."""
    cases = []
    for number, (name, axis, severity) in enumerate(LOGS):
        robot = ROBOTS[number % len(ROBOTS)]
        if name == "torque_offset":
            severity *= float(limits[robot].where.nominal.column("LIMIT")[axis - 1])
        seed = 4900 + OTHER_SEEDS[which] + number
        effect = Effect(name, axis, severity, {})
        cases.append(
            Case(f"log_{number + 1}", "twin", robot, "single", 0.01, seed, (effect,), (), ())
        )
    return cases


def make(batch: Batch, trial: Path) -> list[dict[str, Any]]:
    """Make the recordings of a batch, and say what is in them.

    Args:
        batch: From `planned`.
        trial: Folder of the trial.

    Returns:
        An entry for each answer, see `judging.judge` and `answering.answer`. One with `skipped`
        cannot be made here, and says why.
    """
    makers: dict[str, Callable[[Batch, Path], list[dict[str, Any]]]] = {
        "laboratory": _laboratory,
        "sealed": _sealed,
        "own": _own,
        "real": lambda batch, trial: real.make(batch["name"], trial),
    }
    try:
        entries = makers[batch["kind"]](batch, trial)
    except FileNotFoundError as missing:
        return [{"name": batch["name"], "skipped": str(missing)}]
    for entry in entries:
        entry["group"] = GROUPS[batch["kind"]][entry.pop("mode") == "alone"]
    return entries


def asked(robot: str, folder: str, mode: str, validate: bool) -> list[str]:
    """Arguments of a discovery.

    Args:
        robot: A name, or a path that begins with './' in the folder of the trial.
        folder: That of the recordings, in the folder of the trial.
        mode: 'twin' or 'alone'.
        validate: Whether there is a recording of other motions.
    """
    words = [f"./{folder}/measured.h5", "--robot", robot]
    words += ["--healthy", f"./{folder}/healthy.h5"] if mode == "twin" else []
    return words + (["--validate", f"./{folder}/validate.h5"] if validate else [])


def _laboratory(batch: Batch, trial: Path) -> list[dict[str, Any]]:
    told = batch["what"]["laboratory"]
    lab = draw_laboratory(told["seeds"], told["number"])
    entries = []
    for entry in make_laboratory(lab, trial):
        folder, robot = entry.pop("folder"), entry["robot"]
        entries.append(entry | {"discover": case_words(trial, folder, robot, entry["mode"])})
    return entries


def case_words(trial: Path, folder: str, robot: str, mode: str) -> list[str]:
    """Arguments for a folder of `cases`, whose robot may be a file beside it."""
    own = next(trial.glob(f"robots/*/{robot}.xml"), None)
    named = robot if own is None else f"./{own.relative_to(trial)}"
    validate = (trial / "cases" / folder / "validate.h5").is_file()
    return asked(named, f"cases/{folder}", mode, validate)


_KINDS = {"single": "single", "clean": "healthy", "unknown": "unlisted"}


def _sealed(batch: Batch, trial: Path) -> list[dict[str, Any]]:
    told = dict(batch["what"])
    told["effects"] = tuple(Effect(**effect) for effect in told["effects"])
    told |= {name: tuple(told[name]) for name in ("multiples", "exclude")}
    make_case(Case(**told), trial / "cases")
    return [sealed_entry(batch["what"])]


def sealed_entry(case: Mapping[str, Any]) -> dict[str, Any]:
    """The entry of a case of the sealed simulator: a multiple is d' over that of the limit."""
    return {
        "name": case["name"],
        "mode": case["mode"],
        "kind": _KINDS[case["kind"]],
        "effects": list(case["effects"]),
        "d_prime": DETECTED * min(case["multiples"]) if case["multiples"] else None,
        "separation": None,
        "factors": {"robot": case["robot"], "level": case["level"]},
        "discover": asked(case["robot"], f"cases/{case['name']}", case["mode"], False),
    }


def _own(batch: Batch, trial: Path) -> list[dict[str, Any]]:
    effect, axis, size = batch["what"]["effect"]
    folder, seed = trial / "cases" / batch["name"], batch["what"]["seed"]
    entries = write_case(load_robot("puma560"), (effect, axis, size), seed, "thesis", folder)
    return [
        entry
        | {"discover": asked(entry["robot"], f"cases/{entry['folder']}", entry["mode"], False)}
        for entry in entries
    ]

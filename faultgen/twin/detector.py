"""A detector: what it knows, its answer to a recording, and its files.

    detector = load_detector(Path("detector"))
    answer, memory = detector.judge(cycles, Memory.empty())

A detector is a folder with ``detector.json`` and ``arrays.npz``. The arrays are plain numbers; no
code is stored. The first file contains a checksum of its content and one of the second file.
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from faultgen.effects import get_effect
from faultgen.errors import InputError
from faultgen.recordings.recording import TorqueConstants
from faultgen.system.files import write_bytes, write_text
from faultgen.system.reading import LARGEST_TEXT, read_bytes
from faultgen.system.sealed_json import damage, sealed, unsealed
from faultgen.twin.alignment import KnownMotion
from faultgen.twin.classes import Belief, Classes, believe
from faultgen.twin.features import KINDS, features_of

FORM, ARRAYS = "detector.json", "arrays.npz"
"""Names of the two files."""

FORMAT = 1
"""Version of the files."""

FORGETTING = 0.2
"""Weight of the newest recording in the running mean."""

_OLDER = (  # entries before there was a checksum
    "format robot task features faults stretches sample_period baselines "
    "false_alarms_per_recording limits made arrays_sha256"
).split()
_LARGEST = 256 * 2**20
_UNEXPLAINED = 1.5  # size of what no fault explains over that of the best fault, of unknown changes
_LIKELY = 0.1  # probability from which another fault is named as well


@dataclass(frozen=True, kw_only=True)
class Fault:
    """An effect on some axes, which the detector can name."""

    effect: str
    """Name in the catalogue."""
    axes: tuple[int, ...]
    """From 1."""
    largest: float
    """Largest severity in the data, in the unit of the effect."""
    unit: str
    """SI unit of severity, "1" for a fraction."""

    @property
    def name(self) -> str:
        """Effect and axes as text."""
        axes = " and ".join(map(str, self.axes))
        return f"{self.effect} on {'axis' if len(self.axes) == 1 else 'axes'} {axes}"


@dataclass(frozen=True)
class Memory:
    """Running mean over recordings."""

    count: int
    """Number of recordings so far."""
    mean: tuple[float, ...]
    """Mean place, weighted towards the newest recording; empty before the first one."""

    @classmethod
    def empty(cls) -> Memory:
        """The memory before the first recording."""
        return cls(0, ())

    def after(self, place: np.ndarray) -> Memory:
        """Return the memory with one more recording."""
        count = self.count + 1
        weight = newest_weight(count)
        before = np.array(self.mean) if self.mean else np.zeros_like(place)
        return Memory(count, tuple((before + weight * (place - before)).tolist()))


def newest_weight(count: int) -> float:
    """Weight of the newest recording in the running mean.

    The first recordings have equal weights, until each of them has that of the long run.

    Args:
        count: Number of recordings, with the newest one.
    """
    return max(FORGETTING, 1 / count)


def baseline_variance(baselines: int) -> float:
    """Variance of the mean of healthy recordings of variance 1.

    Args:
        baselines: Number of these recordings; 0 if the mean is exact.
    """
    return 1 / baselines if baselines else 0.0


def memory_variance(count: int) -> float:
    """Variance of the running mean of independent recordings of variance 1.

    Args:
        count: Number of recordings.
    """
    variance = 0.0
    for k in range(1, min(count, 200) + 1):
        weight = newest_weight(k)
        variance = (1 - weight) ** 2 * variance + weight**2
    return variance


@dataclass(frozen=True, eq=False, kw_only=True)
class Detector:
    """What a detector knows."""

    robot: str
    """Name of the robot."""
    task: str
    """Name of the task."""
    motion: KnownMotion
    """The motion that it judges."""
    kind: str
    """Its features, a name of `features.KINDS`."""
    faults: tuple[Fault, ...]
    """Faults that it can name."""
    classes: Classes
    """Model of its features."""
    baselines: int
    """Number of healthy recordings from which the data's mean was learned; 0 if it was not."""
    false_alarms: float
    """Rate of false alarms that its limits allow, per recording."""
    limits: Mapping[str, float]
    """Limits of the gain of one recording ("single") and of the running mean ("running"), and of
    what no fault explains ("rest")."""
    constants: TorqueConstants | None
    """Torque constants with which currents were converted; None if torques were recorded."""
    torque_gain: np.ndarray
    """Torque of the motors over that which the drives log, shape (n_axes,)."""
    made: Mapping[str, Any]
    """Provenance: data, versions, and the results on validation runs."""
    is_sealed: bool = True
    """Whether its file has a checksum. Older versions wrote none."""

    def variance(self, count: int) -> float:
        """Variance of the running mean of healthy recordings, with that of the baseline."""
        return memory_variance(count) + baseline_variance(self.baselines)

    def judge(self, cycles: Sequence[np.ndarray], memory: Memory) -> tuple[dict[str, Any], Memory]:
        """Judge a recording.

        Args:
            cycles: Torque of the motors in its cycles, shape (samples, n_axes) each, in [N m].
            memory: The running mean before it.

        Returns:
            The answer, ready for JSON, and the memory after it.
        """
        x = features_of(self.kind, np.stack(cycles), self.motion).mean(axis=0, keepdims=True)
        place, outside = self.classes.place(x)
        after = memory.after(place[0])
        running = np.array(after.mean)
        one = believe(self.classes, place[0], self.variance(1))
        many = believe(self.classes, running, self.variance(after.count))
        over = {
            "single": one.gain / self.limits["single"],
            "running": many.gain / self.limits["running"],
        }
        source = "running" if over["running"] >= over["single"] else "single"
        belief = many if source == "running" else one
        rest = float(outside[0])
        over["rest"] = rest / self.limits["rest"]
        strange = over["rest"] > 1
        alarm = over[source] > 1
        # beyond what healthy robots show, a fault may leave as much as it explains, and half more
        excess = max(rest - self.limits["rest"], 0.0)
        explained = not strange or excess < _UNEXPLAINED * max(one.explained, belief.explained)
        answer = self._answer(belief, alarm, strange, explained, over, source, after.count)
        return answer, after

    def _answer(
        self,
        belief: Belief,
        alarm: bool,
        strange: bool,
        explained: bool,
        over: Mapping[str, float],
        source: str,
        count: int,
    ) -> dict[str, Any]:
        order = np.argsort(belief.faults)[::-1]
        named = [self._named(belief, int(k)) for k in order]
        told: dict[str, Any] = {
            "verdict": "healthy",
            "probability": belief.healthy,
            "alarm": bool(alarm or strange),
            "effect": None,
            "axes": [],
            "severity": None,
            "interval": None,
            "unit": None,
            "alternatives": [],
            "over_limit": {k: float(v) for k, v in over.items()},
            "based_on": source,
            "recordings": count if source == "running" else 1,
        }
        if alarm and explained:
            likely = [one for one in named[1:] if one["probability"] > _LIKELY]
            return {**told, "verdict": "fault", **named[0], "alternatives": likely}
        if alarm or strange:
            likely = [one for one in named if alarm and one["probability"] > _LIKELY]
            told |= {"verdict": "unknown change", "probability": None}
            return {**told, "alternatives": likely}
        return told

    def _named(self, belief: Belief, number: int) -> dict[str, Any]:
        fault = self.faults[number]
        return {
            "effect": fault.effect,
            "axes": list(fault.axes),
            "probability": float(belief.faults[number]),
            "severity": float(fault.largest * belief.severity[number]),
            "interval": (fault.largest * belief.interval[number]).tolist(),
            "unit": fault.unit,
        }

    def save(self, folder: Path) -> None:
        """Write the detector into a folder, which is created if it does not exist.

        Raises:
            StorageFailed: A file cannot be written.
        """
        arrays = {
            "path": self.motion.path.astype(np.float32),
            "gear_ratio": self.motion.gear_ratio,
            "torque_gain": self.torque_gain,
            "centre": self.classes.centre,
            "whitener": self.classes.whitener.astype(np.float32),
            "basis": self.classes.basis.astype(np.float32),
            "curves": self.classes.curves,
            "rest": self.classes.rest,
        }
        if self.constants is not None:
            arrays["current_constant"] = self.constants.constant
            arrays["current_offset"] = self.constants.offset
        buffer = io.BytesIO()
        np.savez_compressed(buffer, allow_pickle=False, **arrays)
        content = buffer.getvalue()
        told = {
            "format": FORMAT,
            "robot": self.robot,
            "task": self.task,
            "features": self.kind,
            "faults": [
                {"effect": f.effect, "axes": f.axes, "largest": f.largest, "unit": f.unit}
                for f in self.faults
            ],
            "stretches": self.motion.stretches,
            "sample_period": self.motion.sample_period,
            "baselines": self.baselines,
            "false_alarms_per_recording": self.false_alarms,
            "limits": dict(self.limits),
            "made": dict(self.made),
            "arrays_sha256": hashlib.sha256(content).hexdigest(),
        }
        folder.mkdir(parents=True, exist_ok=True)
        write_bytes(folder / ARRAYS, content)
        write_text(folder / FORM, sealed(told))


def load_detector(folder: Path) -> Detector:
    """Read a detector from the folder that `Detector.save` wrote.

    Args:
        folder: The folder.

    Returns:
        The detector.

    Raises:
        InputError: The folder holds no detector, or a file is damaged.
    """
    if not (folder / FORM).is_file():
        raise InputError(
            f"{folder}: holds no {FORM}; give a folder that 'faultgen train' has written"
        )
    content = read_bytes(folder / ARRAYS, "detector file", _LARGEST)
    try:
        told, is_sealed = unsealed(read_bytes(folder / FORM, "detector file", LARGEST_TEXT), _OLDER)
        if told["format"] != FORMAT:
            raise InputError(
                f"{folder / FORM}: has format {told['format']}, but this version of faultgen reads "
                f"format {FORMAT}"
            )
        if hashlib.sha256(content).hexdigest() != told["arrays_sha256"]:
            raise InputError(
                f"detector file {folder / ARRAYS}: damaged (it differs from its checksum in "
                f"{FORM}); copy both files or train again"
            )
        with np.load(io.BytesIO(content), allow_pickle=False) as stored:
            arrays = {name: stored[name].astype(float) for name in stored.files}
        if told["features"] not in KINDS:
            raise InputError(f"{folder / FORM}: unknown features '{told['features']}'")
        constants = None
        if "current_constant" in arrays:
            constants = TorqueConstants(
                arrays["current_constant"], arrays["current_offset"], str(folder)
            )
        return Detector(
            robot=told["robot"],
            task=told["task"],
            motion=KnownMotion(
                path=arrays["path"],
                stretches=tuple((int(a), int(b)) for a, b in told["stretches"]),
                sample_period=float(told["sample_period"]),
                gear_ratio=arrays["gear_ratio"],
            ),
            kind=told["features"],
            faults=tuple(
                Fault(
                    effect=get_effect(one["effect"]).name,
                    axes=tuple(one["axes"]),
                    largest=float(one["largest"]),
                    unit=str(one["unit"]),
                )
                for one in told["faults"]
            ),
            classes=Classes(
                **{k: arrays[k] for k in ("centre", "whitener", "basis", "curves", "rest")}
            ),
            baselines=int(told["baselines"]),
            false_alarms=float(told["false_alarms_per_recording"]),
            limits={name: float(told["limits"][name]) for name in ("single", "running", "rest")},
            constants=constants,
            torque_gain=arrays["torque_gain"],
            made=told["made"],
            is_sealed=is_sealed,
        )
    except InputError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(
            f"detector file {folder / FORM}: damaged ({damage(error)}); copy it or train again"
        ) from None

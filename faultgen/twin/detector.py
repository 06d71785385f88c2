"""A detector: what it knows, its answer to a sequence of recordings, and its files.

    detector = load_detector(Path("detector"))
    scores = [detector.scores(cycles)]      # of each recording since the robot was healthy
    detector.judge(np.array(scores))        # what they tell, after the last one

A detector is a folder with ``detector.json`` and ``arrays.npz``. The arrays are plain numbers; no
code is stored. The first file contains a checksum of its content and one of the second file.
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from faultgen.analysis import Cause, Days, Effects, FittedPosterior, Form, Judgement
from faultgen.effects import get_effect
from faultgen.errors import InputError
from faultgen.recordings.noise import Autoregression
from faultgen.recordings.noise_level import Noise
from faultgen.recordings.recording import TorqueConstants
from faultgen.system.files import write_bytes, write_text
from faultgen.system.reading import LARGEST_TEXT, read_bytes
from faultgen.system.sealed_json import damage, sealed, unsealed
from faultgen.twin.alignment import KnownMotion, mean_cycle
from faultgen.twin.columns import TEMPERATURE, UNKNOWN, Fault, unknown_axis
from faultgen.twin.naming import verdict_of, widened
from faultgen.twin.program import Program
from faultgen.twin.warming import Warming

FORM, ARRAYS = "detector.json", "arrays.npz"
"""Names of the two files."""

FORMAT = 2
"""Version of the files."""

_LARGEST = 512 * 2**20


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Detector:
    """What a detector knows."""

    robot: str
    """Name of the robot."""
    task: str
    """Name of the task."""
    program: Program
    """The motion that it judges, and the noise of its torque."""
    faults: tuple[Fault, ...]
    """Faults that it can name."""
    posterior: FittedPosterior
    """What it has learned from healthy recordings, with all causes. A fault's name is the label of
    its cause."""
    recordings_per_month: float
    """Recordings for which the rate of false alarms was stated."""
    constants: TorqueConstants | None
    """Torque constants with which currents were converted; None if torques were recorded."""
    torque_gain: np.ndarray
    """Torque of the motors over that which the drives log, shape (n_axes,)."""
    healthy: np.ndarray
    """Mean torque of a healthy robot and its standard deviation, with noise and differences from
    day to day, at the places that are compared, shape (2, places, n_axes), in [N m]."""
    made: Mapping[str, Any]
    """Provenance, and what was measured while it was made."""
    warming: Warming | None = None
    """How the torque follows a measured temperature; None if it was not measured."""

    def __repr__(self) -> str:
        faults = len(self.faults)
        return f"<Detector of {self.robot} at {self.task}: {faults} faults, format {FORMAT}>"

    @property
    def motion(self) -> KnownMotion:
        """The motion that it judges."""
        return self.program.motion

    def torque(
        self, cycles: Sequence[np.ndarray], temperature: np.ndarray | None = None
    ) -> np.ndarray:
        """Compute the torque of a recording that is compared with the healthy one.

        Args:
            cycles: As for `scores`.
            temperature: As for `scores`.

        Returns:
            At the mean temperature of the healthy recordings, where temperatures were measured;
            shape (places, n_axes), in [N m].
        """
        torque = mean_cycle(cycles)[self.motion.compared]
        if self.warming is None or temperature is None:
            return np.asarray(torque)
        return np.asarray(torque - self.warming.change(temperature))

    def scores(
        self, cycles: Sequence[np.ndarray], temperature: np.ndarray | None = None
    ) -> np.ndarray:
        """Reduce a recording to the numbers that are judged.

        Args:
            cycles: Torque of the motors in its cycles, shape (samples, n_axes) each, in [N m].
            temperature: Of the gearboxes, shape (n_axes,), in [deg C]; None if it was not measured.

        Returns:
            Shape (columns,).
        """
        torque = self.torque(cycles, temperature)
        return self.posterior.transform(self.program.whiten(torque)[None])[0]

    def fault(self, effect: str, axes: Sequence[int]) -> Fault:
        """Find a fault that it can name.

        Args:
            effect: Name of its effect.
            axes: Its axes, from 1.
        """
        return next(f for f in self.faults if (f.effect, f.axes) == (effect, tuple(axes)))

    def severities(self, scores: np.ndarray, effect: str, axes: Sequence[int]) -> np.ndarray:
        """Estimate the severity of a fault in each recording alone.

        Args:
            scores: Shape (recordings, columns).
            effect: Name of its effect.
            axes: Its axes, from 1.

        Returns:
            Quantiles 0.025, 0.5 and 0.975, shape (recordings, 3), in the unit of the effect.
        """
        labels = [cause.label for cause in self.posterior.effects.causes]
        return self.posterior.severity_path(scores, labels.index(self.fault(effect, axes).name))

    def judge(self, scores: np.ndarray) -> dict[str, Any]:
        """Judge a robot by its recordings since it was known to be healthy.

        Args:
            scores: Of all these recordings, in the order of time, shape (recordings, columns).

        Returns:
            The answer after the last of them, ready for JSON; docs/twin.md lists its entries.
        """
        told = self.posterior.judge(scores)
        named = self._named(told)
        answer: dict[str, Any] = {
            "verdict": "healthy",
            "alarm": False,
            "probability": told.healthy,
            "effect": None,
            "axes": [],
            "severity": None,
            "interval": None,
            "unit": None,
            "alternatives": [],
            "log_odds": float(told.statistic),
            "limit": float(self.posterior.limit_),
            "recordings": len(scores),
            "since": int(told.since),
        }
        if not told.alarm:
            return answer
        return answer | verdict_of(named)

    def causes(self) -> list[tuple[str, list[int], str]]:
        """Return effect, axes and unit of the severity of each cause of `posterior`."""
        by_name = {fault.name: fault for fault in self.faults}
        found = []
        for cause in self.posterior.effects.causes:
            axis = unknown_axis(cause.label)
            if axis is not None:
                found.append((UNKNOWN, [axis], ""))
            elif cause.label == TEMPERATURE:
                found.append((TEMPERATURE, list(range(1, len(self.torque_gain) + 1)), "K"))
            else:
                fault = by_name[cause.label]
                found.append((fault.effect, list(fault.axes), fault.unit))
        return found

    def _named(self, told: Judgement) -> list[dict[str, Any]]:
        """Effects and axes that may be there, most probable first; unknown changes by axis."""
        found: dict[tuple, dict[str, Any]] = {}
        for k, (effect, axes, unit) in enumerate(self.causes()):
            severity, (low, high) = float(told.severities[k]), told.intervals[k]
            one = {
                "effect": effect,
                "axes": axes,
                "probability": float(told.probabilities[k]),
                "log_odds": float(told.log_odds[k]),
                "severity": severity,
                "interval": list(widened(effect, severity, float(low), float(high))),
                "unit": unit,
            }
            known = found.setdefault((effect, *axes), one)
            if known is not one:
                known["probability"] += one["probability"]
                known["log_odds"] = max(known["log_odds"], one["log_odds"])
        return sorted(found.values(), key=lambda one: -one["probability"])

    def save(self, folder: Path) -> None:
        """Write the detector into a folder, which is created if it does not exist.

        Raises:
            StorageFailed: A file cannot be written.
        """
        learned, program = self.posterior, self.program
        arrays = {
            "path": self.motion.path.astype(np.float32),
            "gear_ratio": self.motion.gear_ratio,
            "torque_gain": self.torque_gain,
            "noise_coefficients": program.noise.colour.coefficients,
            "noise_innovation": program.noise.colour.innovation,
            "noise_level": program.noise.level.astype(np.float32),
            "healthy": self.healthy.astype(np.float32),
            "effects": learned.effects.columns.astype(np.float32),
            "days": learned.days.columns.astype(np.float32),
            "day_stds": learned.days.stds,
            "day_groups": learned.days.groups,
            "day_spreads": learned.days.spreads,
            **{f"learned_{name}": value for name, value in learned.state().items()},
        }
        if self.constants is not None:
            arrays["current_constant"] = self.constants.constant
            arrays["current_offset"] = self.constants.offset
        if (warming := self.warming) is not None:
            arrays |= {f"warming_{name}": value for name, value in vars(warming).items()}
        buffer = io.BytesIO()
        np.savez_compressed(buffer, allow_pickle=False, **arrays)
        content = buffer.getvalue()
        told = {
            "format": FORMAT,
            "robot": self.robot,
            "task": self.task,
            "faults": [asdict(fault) for fault in self.faults],
            "causes": [asdict(cause) for cause in learned.effects.causes],
            "stretches": self.motion.stretches,
            "sample_period": self.motion.sample_period,
            "window": program.window,
            "false_alarms_per_recording": learned.false_alarms,
            "recordings_per_month": self.recordings_per_month,
            "days_unlike": learned.days.unlike,
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
        text = read_bytes(folder / FORM, "detector file", LARGEST_TEXT)
        told = unsealed(text)
        if told["format"] != FORMAT:
            raise InputError(
                f"{folder / FORM}: has format {told['format']}, but this version of faultgen reads "
                f"format {FORMAT}; train again on the same dataset"
            )
        if hashlib.sha256(content).hexdigest() != told["arrays_sha256"]:
            raise InputError(
                f"detector file {folder / ARRAYS}: damaged (it differs from its checksum in "
                f"{FORM}); copy both files or train again"
            )
        with np.load(io.BytesIO(content), allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
        return _detector(told, arrays, str(folder))
    except InputError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(
            f"detector file {folder / FORM}: damaged ({damage(error)}); copy it or train again"
        ) from None


def _detector(told: dict[str, Any], arrays: dict[str, np.ndarray], folder: str) -> Detector:
    """Put a detector together from the content of its files."""
    arrays = {k: v if v.dtype.kind == "i" else v.astype(float) for k, v in arrays.items()}
    constants = None
    if "current_constant" in arrays:
        constants = TorqueConstants(arrays["current_constant"], arrays["current_offset"], folder)
    warming = None
    if "warming_reference" in arrays:
        named = {field.name: arrays[f"warming_{field.name}"] for field in fields(Warming)}
        reference = float(named.pop("reference"))
        warming = Warming(reference=reference, **named)
    motion = KnownMotion(
        path=arrays["path"],
        stretches=tuple((int(a), int(b)) for a, b in told["stretches"]),
        sample_period=float(told["sample_period"]),
        gear_ratio=arrays["gear_ratio"],
    )
    colour = Autoregression(arrays["noise_coefficients"], arrays["noise_innovation"])
    causes = tuple(
        Cause(
            label=str(one["label"]),
            family=str(one["family"]),
            forms=tuple(
                Form(
                    tuple(int(k) for k in form["columns"]),
                    tuple(float(s) for s in form["sizes"]),
                    float(form["mean"]),
                )
                for form in one["forms"]
            ),
            positive=bool(one["positive"]),
        )
        for one in told["causes"]
    )
    days = Days(
        arrays["days"],
        arrays["day_stds"],
        arrays["day_groups"],
        arrays["day_spreads"],
        float(told["days_unlike"]),
    )
    learned = {k.removeprefix("learned_"): v for k, v in arrays.items() if k.startswith("learned_")}
    posterior = FittedPosterior(
        Effects(arrays["effects"], causes),
        days,
        false_alarms=float(told["false_alarms_per_recording"]),
    ).restore(learned)
    return Detector(
        robot=told["robot"],
        task=told["task"],
        program=Program(motion, Noise(colour, arrays["noise_level"]), int(told["window"])),
        faults=tuple(
            Fault(
                effect=get_effect(one["effect"]).name,
                axes=tuple(one["axes"]),
                largest=float(one["largest"]),
                unit=str(one["unit"]),
            )
            for one in told["faults"]
        ),
        posterior=posterior,
        recordings_per_month=float(told["recordings_per_month"]),
        constants=constants,
        torque_gain=arrays["torque_gain"],
        healthy=arrays["healthy"],
        made=told["made"],
        warming=warming,
    )

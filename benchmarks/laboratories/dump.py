"""Recordings and true signatures of some laboratories as arrays: work on discovery without runs.

    python -m laboratories.dump DIR [--only scara4_b]       # in the folder benchmarks

Each laboratory gets a folder with its cases, the truth, and `signatures.npz` in closed loop and
`prescribed.npz` for a prescribed motion; see `signatures`. A file that exists is not made again.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Parallel, delayed
from laboratories.draw import BASE, Laboratory
from laboratories.effects import (
    CATALOGUE,
    UNLISTED,
    WAVES,
    Effect,
    apply,
    axes_of,
    logged_torque,
    unit,
)
from laboratories.files import read_truth, write_truth
from laboratories.make import make_laboratory
from laboratories.robots import (
    Plant,
    parameters,
    perturbed,
    robot_file,
    rotor_motion,
    sample_times,
    sampled,
    simulate,
)
from laboratories.setup import Setup, set_up

LABORATORIES: dict[str, dict[str, Any]] = {
    "lift1_a": {"robot": "lift1"},
    "lift1_b": {"robot": "lift1", "servo": "cascade_ff", "level": 0.002, "jitter": 0.02},
    "scara4_a": {"robot": "scara4", "level": 0.002},
    "scara4_b": {"robot": "scara4", "servo": "pd", "level": 0.01, "jitter": 0.1, "rate": 500},
    "puma560_a": {"robot": "puma560"},
    "puma560_b": {
        "robot": "puma560",
        "servo": "cascade_ff",
        "bandwidth": 7.0,
        "servo_period": 1e-3,
        "level": 0.002,
        "jitter": 0.02,
        "noise": "by_motion",
    },
    "arm7_a": {"robot": "arm7"},
    "arm7_b": {"robot": "arm7", "servo": "pid_ff", "noise": "by_load", "level": 0.01},
}
"""Laboratories by name: what differs from an easy one. They have one, four, six and seven axes."""
_FIRST = 100  # number of the first one among the development seeds
_DIFFERENCE = 0.01  # of parameters: small enough for a derivative
_SMALL = 0.2  # of `effects.unit`: small against the limits of the linear range


def laboratory(name: str) -> Laboratory:
    """One of `LABORATORIES`."""
    number = _FIRST + list(LABORATORIES).index(name)
    return Laboratory("development", number, BASE | LABORATORIES[name], ("all",))


def _runs(
    setup: Setup,
    plant: Plant,
    effects: Sequence[Effect] = (),
    follow: Sequence[np.ndarray] | None = None,
) -> np.ndarray:
    """Channels of `plant.CHANNELS` at the even sample times of all measured motions."""
    parts = []
    for motion, points in enumerate(setup.points[: setup.n_measured]):
        run = simulate(plant, points, follow=None if follow is None else follow[motion])
        seen = sampled(run, sample_times(len(points), setup.period))
        seen[:, :, 2] = logged_torque(effects, seen[:, :, 2], setup.period)
        parts.append(seen)
    return np.concatenate(parts)


def effects_of(setup: Setup) -> list[Effect]:
    """Every effect on every axis, with a severity for a difference; waves are four rows each.

    Args:
        setup: The laboratory.
    """
    machine, out = setup.lab.machine, []
    for name in (*CATALOGUE, *UNLISTED):
        # these laboratories have one temperature
        axes = () if name == "temperature_friction" else axes_of(name, machine.n_axes)
        waves = [(o, f) for o in (2.0, 4.0) for f in (0.0, 0.5 * np.pi)]
        for axis in axes:
            # clipping begins at a size of its own
            size = unit(name, axis, machine) * (1.0 if name in UNLISTED else _SMALL)
            for order, phase in waves if name in WAVES else [(0.0, 0.0)]:
                details = {"order": order, "phase": phase} if order else {}
                out.append(Effect(name, axis, size, details))
    return out


def signatures(setup: Setup, prescribed: bool) -> dict[str, np.ndarray]:
    """What the simulator itself says about a laboratory, on the motions of its recording.

    Args:
        setup: The laboratory.
        prescribed: The rotors move as they did without the change, and torque is what that needs.
            Otherwise the command is the same, and the servo answers the change.

    Returns:
        Arrays by name, motor side, SI units, at even times (without the jitter of a recording).
        `time` (samples,), starting anew with each of `segments`. For `model` (the file with the
        laboratory's servo) and `robot` (the healthy robot of the cases): `<of>_run` (samples, axes,
        5) with motor position, motor speed, motor torque, gear torque (joint side) and joint
        position; `<of>_torque` (effects, samples, axes), the change per unit of severity. Row k is
        the effect `effect[k]` on `axis[k]` (from 1), taken as the difference at `severity[k]`, with
        `order[k]` and `phase[k]` of waves. The parameters of the model: `parameter` (its name) on
        `parameter_axis` (from 1; n + 1 is the payload), and `parameter_torque`, the change per
        relative change (centres of mass: per `robots.length_scale`). `parameter_error`: the
        standard deviation of each in the robots. `noise_scale` (samples, axes) [N m],
        `noise_share`, `noise_memory` (from sample to sample), `noise_step`, `gain`, `zero` (axes,).
        In closed loop also `<of>_position` and `parameter_position`, the changes of the motor
        position. A delay or another gain of the servo changes nothing if the motion is prescribed.
    """
    machine, measured = setup.lab.machine, setup.points[: setup.n_measured]
    lengths = [len(sample_times(len(points), setup.period)) for points in measured]
    effects = effects_of(setup)
    out: dict[str, Any] = {
        "time": np.concatenate([setup.period * np.arange(length) for length in lengths]),
        "segments": np.cumsum([0, *lengths[:-1]]),
        "effect": np.array([effect.name for effect in effects]),
        "axis": np.array([effect.axis for effect in effects]),
        "severity": np.array([effect.severity for effect in effects]),
        "order": np.array([effect.details.get("order", 0.0) for effect in effects]),
        "phase": np.array([effect.details.get("phase", 0.0) for effect in effects]),
    }

    def put(name: str, changes: list[np.ndarray]) -> None:
        columns = np.array(changes, np.float32)
        out[f"{name}_torque"] = columns[..., 2]
        if not prescribed:
            out[f"{name}_position"] = columns[..., 0]

    for of, plant in (("robot", setup.robot), ("model", setup.ideal)):
        follow = [rotor_motion(plant, points) for points in measured] if prescribed else None
        base = out[f"{of}_run"] = _runs(setup, plant, (), follow)
        changes = [
            (_runs(setup, apply(effect, plant, machine), [effect], follow) - base) / effect.severity
            for effect in effects
        ]
        put(of, changes)
    # the last of the two is the model
    names, error = parameters(machine.n_axes), float(setup.lab.factors["model_error"])
    changes = [
        (_runs(setup, perturbed(plant, {key: _DIFFERENCE}), (), follow) - base) / _DIFFERENCE
        for key in names
    ]
    put("parameter", changes)
    twice = [2 if name in ("STIFF", "DAMP") else 1 for name, _ in names]
    parts = np.split(out["robot_run"], out["segments"][1:])
    scale = [setup.noise.scale(part[:, :, 2], part[:, :, 1], k) for k, part in enumerate(parts)]
    return out | {
        "parameter": np.array([name for name, _ in names]),
        "parameter_axis": np.array([index + 1 for _, index in names]),
        "parameter_error": error * np.array(twice),
        "noise_scale": np.concatenate(scale),
        "noise_share": setup.noise.share,
        "noise_memory": setup.noise.memory,
        "noise_step": setup.noise.step,
        "gain": setup.gain,
        "zero": setup.zero,
    }


def dump(name: str, folder: Path) -> str:
    """Write the cases and the signatures of one of `LABORATORIES`.

    Args:
        name: Of the laboratory.
        folder: Its folder is made in here.

    Returns:
        The name.
    """
    lab, own = laboratory(name), folder / name
    truth = own / "truth" / f"{lab.name}.json"
    if not truth.is_file():
        write_truth(make_laboratory(lab, own), truth)
    (own / "model.xml").write_text(robot_file(lab.factors["robot"]).read_text())
    for target in (own / "prescribed.npz", own / "signatures.npz"):
        if not target.is_file():
            part = target.with_suffix(".part.npz")
            found = signatures(set_up(lab), target.stem == "prescribed")
            np.savez_compressed(part, **found)  # type: ignore[arg-type]
            part.replace(target)
    return name


def main() -> None:
    """Write all laboratories, or some."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", nargs="*", choices=list(LABORATORIES), default=LABORATORIES)
    parser.add_argument("--workers", type=int, default=1)
    told = parser.parse_args()
    from laboratories.dump import dump as imported  # processes cannot read __main__

    made = Parallel(n_jobs=told.workers, return_as="generator")(
        delayed(imported)(name, told.folder) for name in told.only
    )
    for name in made:
        for entry in read_truth(told.folder / name).values():
            effects = [(e["name"], e["axis"], e["severity"]) for e in entry["effects"]]
            print(name, entry["name"], effects, entry["d_prime"], flush=True)


if __name__ == "__main__":
    main()

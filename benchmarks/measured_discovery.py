"""Discovery on measured data of real machines: what is found, and what it is worth held out.

    python benchmarks/measured_discovery.py emps --data ../shared/data/measured -o out

Tables are printed as Markdown; reports and models are written to the folder.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import matplotlib

matplotlib.use("Agg")  # no display needed

import matplotlib.pyplot as plt
import numpy as np
from faultgen.analysis.plots import COLOURS, style
from measured_data import (
    EXAMPLES,
    joined,
    read_emps,
    read_ur10e,
    read_xl330,
    xl330_model,
    xl330_runs,
)
from scipy.signal import butter, decimate, filtfilt

from faultgen.discovery import Recording, Replay, investigate
from faultgen.discovery.calibration.calibrate import calibrate
from faultgen.discovery.calibration.model_edit import changed
from faultgen.discovery.fit.fit import changes_of
from faultgen.discovery.replay.replay import Changes, settled
from faultgen.discovery.replay.samples import rolling
from faultgen.discovery.terms.candidates import INERTIA, PAYLOAD, Term, payload_of
from faultgen.errors import SimulationFailed
from faultgen.report.discovery_report import write_discovery
from faultgen.robot import Robot, load_robot

EMPS_CUT_OFF = 100.0
"""Low-pass on the position [Hz], as published."""
EMPS_BORDER, EMPS_EDGE = 49, 5
"""Samples, and decimated samples at both ends, that are not scored, as in reference_emps.py."""


EMPS_OPTIONAL = ("viscous_asymmetry", "low_speed_friction")
EMPS_KNOWN = ("torque_constant",)
"""Nothing but forces is measured: a torque constant cannot be told from all others together."""


def emps_followed(recording: Recording) -> Recording:
    """Without a reference, the position filtered as published: a replay follows it.

    Butterworth, 4th order, 100 Hz, forward and back.
    """
    b, a = butter(4, 2 * EMPS_CUT_OFF * recording.sample_period)
    position = filtfilt(b, a, recording.position, axis=0)
    return replace(recording, position=position, reference_position=None)


def emps_error(recording: Recording, robot: Robot, changes: Changes = ()) -> float:
    """Compute the force error on the measured motion, decimated by 10 as published.

    Args:
        recording: The measured data.
        robot: The model.
        changes: Changes of the model: terms and values.

    Returns:
        Relative error [%].
    """
    followed = emps_followed(recording)
    torque = Replay(followed, robot).torque(changes)
    pair = [
        decimate(x[EMPS_BORDER:, 0], 10, zero_phase=True)[EMPS_EDGE:-EMPS_EDGE]
        for x in (followed.torque, torque)
    ]
    return float(100 * np.linalg.norm(pair[0] - pair[1]) / np.linalg.norm(pair[0]))


def emps_closed_loop(
    recording: Recording, robot: Robot, changes: Changes = ()
) -> tuple[float, float]:
    """Compute errors in closed loop with the recorded reference, at 1 kHz.

    The delay of the log relative to the motion is not simulated.

    Args:
        recording: The measured data.
        robot: The model.
        changes: Changes of the model: terms and values.

    Returns:
        Relative errors of force and position [%].
    """
    changes = [(term, value) for term, value in changes if term.name != "delay"]
    replay = Replay(recording, robot, measured=False)
    pairs = (
        (recording.torque, replay.torque(changes)),
        (recording.position, replay.position(changes)),
    )
    force, position = (100 * np.linalg.norm(x - y) / np.linalg.norm(x) for x, y in pairs)
    return float(force), float(position)


def emps(data: Path, out: Path) -> None:
    """Effects from the closed loop, values on the measured motion; scored on the pulses.

    Args:
        data: Folder with the recordings.
        out: Folder for the results.
    """
    robot = load_robot(EXAMPLES / "emps" / "emps.xml")
    train, test = (read_emps(data / "emps", name) for name in ("identification", "validation"))
    asked = {"include": EMPS_OPTIONAL, "exclude": EMPS_KNOWN}
    found = investigate(train, robot, **asked)  # type: ignore[arg-type]
    print("learned scales:", {name: round(one, 2) for name, one in found.prior_scales.items()})
    best = found.choice.best
    print("verdict:", found.answer.verdict)
    effects = changes_of(found.problem, best)
    errors = np.sqrt(np.diag(best.covariance))
    for (term, value), error in zip(effects, errors, strict=True):
        print(f"- {term.name} {value:.4g} +- {error:.2g} {dict(term.parameters)}")
    print("\n| model | train | test | closed loop, train | position | test | position |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    changes: Changes = found.answer.changes
    steps = (("published symmetric", ()), ("effects alone", effects), ("all found", changes))
    for name, own in steps:
        row = [emps_error(one, robot, own) for one in (train, test)]
        row += [x for one in (train, test) for x in emps_closed_loop(one, robot, own)]
        print(f"| {name} | " + " | ".join(f"{x:.3g}" for x in row) + " |", flush=True)
    model = changed(robot, changes)
    large = [(t, v) for t, v in changes if abs(v) > 0.5 * t.prior_std]
    told = ", ".join(f"{t.name} {v:.4g}" for t, v in large)
    print("\nlast, off by more than half the prior_std:", told)
    out.mkdir(parents=True, exist_ok=True)
    (out / "emps_model.xml").write_text(model.xml)
    result = found.answer.contract() | {"warnings": [], "seconds": 0.0}
    write_discovery(out / "emps", result, found)
    emps_picture(train, test, robot, changes, out / "emps.png")


def emps_picture(
    train: Recording, test: Recording, robot: Robot, changes: Changes, path: Path
) -> None:
    """Force error before and after, along the speed and in time.

    Args:
        train: Recording for fitting.
        test: Recording for scoring.
        robot: The model.
        changes: Changes of the model: terms and values.
        path: Picture to write.
    """
    with style():
        figure, grid = plt.subplots(1, 2, figsize=(9, 3.2))
        pairs = [(one, emps_followed(one)) for one in (train, test)]
        for axes, (_, one) in zip(grid, pairs, strict=True):
            speed = np.gradient(one.position[:, 0], one.sample_period)
            edges = np.linspace(-0.15, 0.15, 31)
            at = np.digitize(speed, edges)
            for k, (label, what) in enumerate((("symmetric model", ()), ("with effects", changes))):
                error = (one.torque - Replay(one, robot).torque(what))[:, 0]
                mean = [
                    error[at == b].mean() if (at == b).sum() > 20 else np.nan for b in range(32)
                ]
                middle = np.concatenate([[np.nan], (edges[1:] + edges[:-1]) / 2, [np.nan]])
                axes.plot(1000 * middle, mean, marker=".", color=COLOURS[k], label=label)
            axes.set(xlabel="speed [mm/s]", ylabel="mean force left [N]")
        grid[0].set_title("identification (fitted)")
        grid[1].set_title("pulses (held out)")
        grid[0].legend()
        figure.savefig(path, dpi=110)


UR10E_LEFT_OUT = ("transmission_error", "torque_ripple")
"""Waves of the motor are above half the sample rate."""


def ur10e_errors(recording: Recording, robot: Robot, changes: Changes = ()) -> np.ndarray:
    """Compute the torque error of each axis while it moves.

    Args:
        recording: The measured data.
        robot: The model.
        changes: Changes of the model: terms and values.

    Returns:
        Relative errors [%], shape (n_axes,).
    """
    left = recording.torque - Replay(recording, robot).torque(changes)
    inside = settled(recording, robot) & rolling(recording, robot)
    squares = [(np.where(inside, x, 0.0) ** 2).sum(axis=0) for x in (left, recording.torque)]
    return np.asarray(100 * np.sqrt(squares[0] / squares[1]))


def ur10e(data: Path, out: Path) -> None:
    """Calibrated without payload; the payload found; held out on the other pair.

    Args:
        data: Folder with the recordings.
        out: Folder for the results.
    """
    folder, cache = data / "ur10e", out / "cache"
    robot = load_robot(EXAMPLES / "ur10e" / "ur10e.xml")

    told_errors: dict[str, np.ndarray] = {}

    def row(name: str, errors: np.ndarray) -> None:
        told_errors[name] = errors
        print(f"| {name} | " + " | ".join(f"{x:.1f}" for x in errors) + " |", flush=True)

    train = read_ur10e(folder, "unloaded_14harm_feb19")
    found = calibrate(train, robot, known=(INERTIA,))
    model = found.robot
    out.mkdir(parents=True, exist_ok=True)
    (out / "ur10e_calibrated.xml").write_text(model.xml)
    print("prior scale:", found.prior_scale)
    print("gains:", np.round(model.torque_gain, 3))
    for run in ("unloaded_14harm_feb19", "unloaded_15harm_feb19", "test_50s_feb12"):
        recording = read_ur10e(folder, run)
        row(f"{run}, published", ur10e_errors(recording, robot))
        row(f"{run}, calibrated", ur10e_errors(recording, model))
    for run in ("loaded_14harm_feb19", "loaded_15harm_feb19"):
        recording = read_ur10e(folder, run)
        for width in (1.0, 0.3, 0.1):
            result = investigate(
                recording,
                model,
                prior_scale=width,
                white_noise=True,
                exclude=UR10E_LEFT_OUT,
                cache=cache,
            )
            told, best = result.answer, result.choice.best
            print(f"\n{run}, width {width}: {told.verdict}; alternatives {told.alternatives}")
            problem = result.problem
            for one in told.effects:
                print("-", one.effect, one.axis, f"{one.severity:.4g}", one.parameters)
            effects = changes_of(problem, best)
            payload = [(t, v) for t, v in effects if t.name == PAYLOAD]
            if payload:
                places = np.array([[x for _, x in t.parameters] for t, _ in payload])
                mass, place = payload_of([v for _, v in payload], places)
                print(f"payload {mass:.3f} kg at {np.round(place, 3)}")
            row(f"{run}, calibrated", ur10e_errors(read_ur10e(folder, run), model))
            row(f"{run}, with effects", ur10e_errors(read_ur10e(folder, run), model, effects))
            if width == 0.3:
                summary = told.contract() | {"warnings": [], "seconds": 0.0}
                write_discovery(out / run, summary, result)

    ur10e_picture(told_errors, out / "ur10e.png")


def ur10e_picture(errors: dict[str, np.ndarray], path: Path) -> None:
    """Torque error of each axis: without payload, with one, and with the one that was found.

    Args:
        errors: Errors of each axis by name [%], shape (n_axes,) each.
        path: Picture to write.
    """
    with style():
        figure, grid = plt.subplots(1, 2, figsize=(9, 3.2), sharey=True)
        for axes, pair in zip(grid, ("14harm", "15harm"), strict=True):
            bars = (
                (f"unloaded_{pair}_feb19, calibrated", "no payload, calibrated"),
                (f"loaded_{pair}_feb19, calibrated", "payload, calibrated without"),
                (f"loaded_{pair}_feb19, with effects", "payload found"),
            )
            for k, (name, label) in enumerate(bars):
                at = np.arange(1, 7) + 0.27 * (k - 1)
                axes.bar(at, errors[name], width=0.25, color=COLOURS[k], label=label)
            axes.set(xlabel="axis", title=pair)
        grid[0].set(ylabel="torque error / torque [%]")
        grid[0].legend()
        figure.savefig(path, dpi=110)


XL330_LEFT_OUT = ("transmission_error", "torque_ripple", "torque_constant")


LOAD = Term("load_friction", 1, 0.0, 0.0)
XL330_TRAIN, XL330_TEST = (100, 200, 800), 400


def xl330_recording(folder: Path, gain: int) -> Recording:
    """Join all runs with a gain to one recording.

    Args:
        folder: Folder with the runs.
        gain: Gain of the firmware.

    Returns:
        The recording.
    """
    runs = [name for name, row in xl330_runs(folder).items() if int(row["kp"]) == gain]
    return joined([read_xl330(folder, run) for run in runs])


def xl330_error(recording: Recording, robot: Robot, changes: Changes = ()) -> float:
    """Compute the error of the simulated position in closed loop.

    The step is a fifth of the model's, because strong load friction needs it.

    Args:
        recording: The measured data.
        robot: The model.
        changes: Changes of the model: terms and values.

    Returns:
        Mean absolute error [rad]; nan if the simulation diverges.
    """
    spec = robot.spec()
    spec.option.timestep /= 5
    spec.compile()
    fine = Robot(robot.name, spec.to_xml())
    try:
        simulated = Replay(recording, fine, measured=False).position(changes)
    except SimulationFailed:
        return float("nan")
    return float(np.abs(recording.position - simulated).mean())


def xl330(data: Path, out: Path) -> None:
    """What is named at each gain of the firmware; position error held out on another gain.

    Args:
        data: Folder with the recordings.
        out: Folder for the results.
    """
    out.mkdir(parents=True, exist_ok=True)
    folder = data / "bam_xl330"
    models = {}
    for gain in (*XL330_TRAIN, XL330_TEST):
        path = out / f"xl330_kp{gain}.xml"
        path.write_text(xl330_model(gain))
        models[gain] = load_robot(path)
    test = xl330_recording(folder, XL330_TEST)
    print(
        f"published: position error at gain {XL330_TEST} "
        f"{xl330_error(test, models[XL330_TEST]):.4f} rad"
    )
    loads: list[tuple[float, float]] = []
    for gain in XL330_TRAIN:
        recording = xl330_recording(folder, gain)
        found = investigate(
            recording,
            models[gain],
            prior_scale=10.0,
            white_noise=True,
            include=("low_speed_friction",),
            exclude=XL330_LEFT_OUT,
        )
        print(f"gain {gain}: {found.answer.verdict}", flush=True)
        best = found.choice.best
        named = changes_of(found.problem, best)
        with_errors = zip(named, np.sqrt(np.diag(best.covariance)).tolist(), strict=True)
        load = [(value, error) for (t, value), error in with_errors if t.name == LOAD.name]
        loads += load
        tuned: dict[str, Changes] = {
            "load friction alone": [(LOAD, value) for value, _ in load],
            "all found": found.answer.changes,
        }
        for label, changes in tuned.items():
            errors = [
                xl330_error(recording, models[gain], changes),
                xl330_error(test, models[XL330_TEST], changes),
            ]
            print(
                f"  {label}: position error {errors[0]:.4f} rad, at gain {XL330_TEST} "
                f"{errors[1]:.4f} rad",
                flush=True,
            )
    values, deviations = np.array(loads).reshape(-1, 2).T
    for label, weight in (("plain", np.ones(len(values))), ("by standard error", deviations**-2.0)):
        value = float(np.average(values, weights=weight))
        error = xl330_error(test, models[XL330_TEST], [(LOAD, value)])
        print(
            f"mean load friction of the gains, {label}: {value:.3f}, at gain {XL330_TEST} "
            f"{error:.4f} rad"
        )


RUNS = {"emps": emps, "ur10e": ur10e, "xl330": xl330}


def main() -> None:
    """Run one machine."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("machine", choices=RUNS)
    parser.add_argument("--data", type=Path, required=True, help="folder with emps, ur10e, ...")
    parser.add_argument("-o", "--out", type=Path, default=Path("measured-out"))
    args = parser.parse_args()
    RUNS[args.machine](args.data, args.out)


if __name__ == "__main__":
    main()

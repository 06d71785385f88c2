"""Public measured data as recordings for `faultgen discover`.

    python -m benchmarks.real_robots.measured_data --data ../shared/data/measured -o recordings

writes an HDF5 file for each recording of the EMPS, the UR10e and the XL330 pendulum, and the model
of the pendulum for each gain of its firmware. The models are in docs/examples. All joint side.
"""

from __future__ import annotations

import argparse
import csv
import json
from pathlib import Path

import numpy as np
from scipy.signal import butter, filtfilt

from faultgen.recordings.recording import Recording, write_recording

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"

EMPS_FILES = {
    "identification": "emps_identification.csv",
    "validation": "emps_validation_pulses.csv",
}
EMPS_FORCE = 35.15065188
"""Force of the motor [N/V]."""
EMPS_GAIN = 160.18 * 243.45
"""Position gain of the controller, kp kv [V/m]."""
EMPS_PULSE = 1.0138
"""Volts in the controller's output for 1 of the column of pulses, from the recording."""

UR10E_PERIOD = 0.01
"""Even sample period [s]; recorded unevenly, at about 94 Hz."""
UR10E_LOW_PASS = 10.0
"""Cut-off of the low-pass on angle and current [Hz]: Butterworth, 4th order, forward and back."""
UR10E_CUTS = {"unloaded_15harm_feb19": (120, 5049), "loaded_15harm_feb19": (202, 5131)}
"""First and last sample with a joint faster than 0.02 rad/s, where no cut is published."""

XL330_PERIOD = 0.005
"""Even sample period [s]."""
XL330_KT, XL330_R, XL330_VOLTS = 0.3867, 4.017, 7.4
"""Torque constant [N m/A] and resistance [ohm], joint side, as published; nominal supply [V]."""
XL330_COUNTS = 4096 / (2 * np.pi) / 256 / 885
"""Duty for 1 rad of error and firmware gain 1."""


def read_emps(folder: Path, name: str) -> Recording:
    """A recording of the EMPS at 1 kHz, as it is: position [m] and motor force [N].

    The pulses that were added to the controller's output in the validation recording are part of
    the force; the reference has the shift that makes the same controller give them.

    Args:
        folder: The data set's folder.
        name: 'identification' or 'validation'.
    """
    table = np.loadtxt(folder / EMPS_FILES[name], delimiter=",", skiprows=1)
    reference = table[:, 1] + EMPS_PULSE * table[:, 5] / EMPS_GAIN
    return Recording(
        source=f"emps {name}",
        robot="emps",
        side="joint",
        sample_period=1e-3,
        position=table[:, 2:3],
        torque=table[:, 4:5],
        reference_position=reference[:, None],
    )


def ur10e_runs(folder: Path) -> list[str]:
    """Names of the UR10e's recordings."""
    return sorted(path.stem for path in folder.glob("*.npz"))


def read_ur10e(folder: Path, run: str, low_pass: float = UR10E_LOW_PASS) -> Recording:
    """A recording of the UR10e at 100 Hz within its cuts: angle [rad] and gain x current [N m].

    Args:
        folder: The data set's folder.
        run: Name of the recording.
        low_pass: Cut-off [Hz] of the filter on angles, speeds and currents.
    """
    published = json.loads((folder / "published_parameters.json").read_text())
    with np.load(folder / f"{run}.npz") as raw:
        time = raw["t"]
        even = np.arange(time[0], time[-1], UR10E_PERIOD)
        b, a = butter(4, low_pass * 2 * UR10E_PERIOD)

        def resampled(name: str) -> np.ndarray:
            columns = [np.interp(even, time, column) for column in raw[name].T]
            return filtfilt(b, a, np.stack(columns, axis=1), axis=0)

        position, velocity, current = resampled("q"), resampled("qd"), resampled("i")
    first, last = UR10E_CUTS.get(run) or published["cut_idx"].get(run) or (0, len(time) - 1)
    inside = (even >= time[first]) & (even <= time[min(last, len(time) - 1)])
    return Recording(
        source=f"ur10e {run}",
        robot="ur10e",
        side="joint",
        sample_period=UR10E_PERIOD,
        position=position[inside],
        torque=current[inside] * np.array(published["drive_gain_Nm_per_A"]),
        velocity=velocity[inside],
        payload_mass=(
            published["payload_mass_kg_loaded_14harm"] if run.startswith("loaded") else None
        ),
    )


def xl330_runs(folder: Path) -> dict[str, dict[str, str]]:
    """Rows of the data set's list for the XL330, by file name without suffix."""
    with (folder / "index.csv").open() as file:
        rows = list(csv.DictReader(file))
    return {row["file"].removesuffix(".csv"): row for row in rows if row["motor"] == "xl330"}


def read_xl330(folder: Path, run: str) -> Recording:
    """A recording of the XL330 pendulum at 200 Hz, until its motor is released.

    The torque is estimated from duty, supply and speed with the published torque constant and
    resistance.

    Args:
        folder: The data set's folder.
        run: Name of the recording.
    """
    table = np.loadtxt(folder / f"{run}.csv", delimiter=",", skiprows=1)
    released = np.flatnonzero(table[:, 7] < 0.5)
    table = table[: released[0]] if len(released) else table
    time, goal, q, qd, duty, volts, temperature, _ = table.T
    even = np.arange(time[0], time[-1], XL330_PERIOD)
    torque = XL330_KT / XL330_R * (duty * volts - XL330_KT * qd)

    def resampled(values: np.ndarray) -> np.ndarray:
        return np.interp(even, time, values)[:, None]

    gain = int(xl330_runs(folder)[run]["kp"])
    return Recording(
        source=f"xl330 {run}",
        robot=f"xl330_kp{gain}",
        side="joint",
        sample_period=XL330_PERIOD,
        position=resampled(q),
        torque=resampled(torque),
        velocity=resampled(qd),
        reference_position=resampled(goal),
        temperature=resampled(temperature)[:, 0],
    )


def xl330_model(gain: int) -> str:
    """MJCF of the pendulum with another gain of the firmware."""
    text = (EXAMPLES / "xl330" / "xl330.xml").read_text()
    before, _, rest = text.partition('controller="')
    kp, _, rest = rest.partition(" ")
    scaled = f'{before}controller="{float(kp) * gain / 400:.6g} {rest}'
    return scaled.replace("firmware gain 400", f"firmware gain {gain}")


def joined(recordings: list[Recording]) -> Recording:
    """Recordings of one robot as segments of one."""
    first = recordings[0]
    starts = np.cumsum([0] + [len(r.position) for r in recordings[:-1]])

    def stacked(name: str) -> np.ndarray | None:
        parts = [getattr(r, name) for r in recordings]
        return None if any(part is None for part in parts) else np.concatenate(parts)

    position, torque = stacked("position"), stacked("torque")
    assert position is not None and torque is not None
    return Recording(
        source=first.source,
        robot=first.robot,
        side=first.side,
        sample_period=first.sample_period,
        position=position,
        torque=torque,
        velocity=stacked("velocity"),
        reference_position=stacked("reference_position"),
        temperature=stacked("temperature"),
        segments=tuple(int(start) for start in starts),
        payload_mass=first.payload_mass,
    )


def main() -> None:
    """Write all recordings."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="folder with emps, ur10e, ...")
    parser.add_argument("-o", "--out", type=Path, required=True)
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    for name in EMPS_FILES:
        write_recording(read_emps(args.data / "emps", name), args.out / f"emps_{name}.h5")
    for run in ur10e_runs(args.data / "ur10e"):
        write_recording(read_ur10e(args.data / "ur10e", run), args.out / f"ur10e_{run}.h5")
    folder = args.data / "bam_xl330"
    for gain in (100, 200, 400, 800):
        runs = [name for name, row in xl330_runs(folder).items() if int(row["kp"]) == gain]
        together = joined([read_xl330(folder, run) for run in runs])
        write_recording(together, args.out / f"xl330_kp{gain}.h5")
        (args.out / f"xl330_kp{gain}.xml").write_text(xl330_model(gain))


if __name__ == "__main__":
    main()

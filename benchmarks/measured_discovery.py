"""Discovery on measured data of real machines: what is found, and what it is worth held out.

    python benchmarks/measured_discovery.py emps --data ../shared/data/measured -o out

Tables are printed as Markdown; reports and models are written to the folder.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from measured_data import EXAMPLES, read_emps
from scipy.signal import butter, decimate, filtfilt

from faultgen.discovery import Recording, Replay, investigate
from faultgen.discovery.recording import low_passed
from faultgen.discovery.replay import Changes
from faultgen.robot import Robot, load_robot

EMPS_CUT_OFF = 40.0
"""Low-pass on position and force [Hz]: what the published decimation by 10 leaves."""
EMPS_PUBLISHED_CUT_OFF = 100.0
"""Low-pass on the position before that, as published [Hz]."""
EMPS_BORDER, EMPS_EDGE = 49, 5
"""Samples, and decimated samples at both ends, that are not scored, as in reference_emps.py."""


def followed(recording: Recording) -> Recording:
    """The same without a reference: a replay then follows the measured position."""
    return replace(recording, reference_position=None)


def emps_error(recording: Recording, robot: Robot, changes: Changes = ()) -> float:
    """Relative error of the force on the measured motion, filtered as published [%].

    Butterworth, 4th order, 100 Hz, forward and back, on the position; decimation of both by 10.
    """
    b, a = butter(4, 2 * EMPS_PUBLISHED_CUT_OFF * recording.sample_period)
    position = filtfilt(b, a, recording.position, axis=0)
    recording = replace(recording, position=position, reference_position=None)
    torque = Replay(recording, robot).torque(changes)
    pair = [
        decimate(x[EMPS_BORDER:, 0], 10, zero_phase=True)[EMPS_EDGE:-EMPS_EDGE]
        for x in (recording.torque, torque)
    ]
    return float(100 * np.linalg.norm(pair[0] - pair[1]) / np.linalg.norm(pair[0]))

"""Where simulation and measurement disagree, and why: stages that can each be used alone.

recording = read_recording("measured.h5")
for finding in check_recording(recording, load_robot("puma560")):
    print(finding)
gap = recording.torque - replay(recording, robot)
"""

from faultgen.discovery.check import Finding, check_recording
from faultgen.discovery.recording import Recording, read_recording, write_recording
from faultgen.discovery.replay import replay, settled
from faultgen.discovery.screen import Rank, candidates, screen, sensitivities
from faultgen.discovery.workflow import discover

__all__ = [
    "Finding",
    "Rank",
    "Recording",
    "candidates",
    "check_recording",
    "discover",
    "read_recording",
    "replay",
    "screen",
    "sensitivities",
    "settled",
    "write_recording",
]

"""Discovery finds where a simulation and a measurement disagree, and which effect explains it.

Each stage can be used alone:

recording = read_recording("measured.h5")
for finding in check_recording(recording, load_robot("puma560")):
    print(finding)
residual = recording.torque - replay(recording, robot)
"""

from faultgen.discovery.checks import Finding, check_recording
from faultgen.discovery.read import read_recording
from faultgen.discovery.recording import Recording, write_recording
from faultgen.discovery.replay import Replay, replay, settled
from faultgen.discovery.workflow import Discovery, investigate

__all__ = [
    "Discovery",
    "Finding",
    "Recording",
    "Replay",
    "check_recording",
    "investigate",
    "read_recording",
    "replay",
    "settled",
    "write_recording",
]

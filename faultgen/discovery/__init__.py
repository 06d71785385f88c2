"""Discovery finds where a simulation and a measurement disagree, and which effect explains it.

Each stage can be used alone:

recording = read_recording("measured.h5")
for finding in check_recording(recording, load_robot("puma560")):
    print(finding)
residual = recording.torque - replay(recording, robot)
"""

from typing import TYPE_CHECKING

from faultgen.system.lazy import lazily

if TYPE_CHECKING:
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

# the import of a log needs none of the modules that simulate
lazily(
    __name__,
    {
        "Discovery": "faultgen.discovery.workflow",
        "Finding": "faultgen.discovery.checks",
        "Recording": "faultgen.discovery.recording",
        "Replay": "faultgen.discovery.replay",
        "check_recording": "faultgen.discovery.checks",
        "investigate": "faultgen.discovery.workflow",
        "read_recording": "faultgen.discovery.read",
        "replay": "faultgen.discovery.replay",
        "settled": "faultgen.discovery.replay",
        "write_recording": "faultgen.discovery.recording",
    },
)

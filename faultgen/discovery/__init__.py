"""Discovery finds where a simulation and a measurement disagree, and which effect explains it.

Each stage can be used alone:

recording = read_recording("measured.h5")
for finding in check_recording(recording, load_robot("puma560")):
    print(finding)
residual = recording.torque - Replay(recording, robot).torque()
"""

from typing import TYPE_CHECKING

from faultgen.system.lazy import lazily

if TYPE_CHECKING:
    from faultgen.discovery.accept import check_recording
    from faultgen.discovery.discover import Discovery
    from faultgen.discovery.replay.replay import Replay, settled
    from faultgen.recordings.finding import Finding
    from faultgen.recordings.read import read_recording
    from faultgen.recordings.recording import Recording, write_recording

__all__ = [
    "Discovery",
    "Finding",
    "Recording",
    "Replay",
    "check_recording",
    "read_recording",
    "settled",
    "write_recording",
]

# the import of a log needs none of the modules that simulate
lazily(
    __name__,
    {
        "Discovery": "faultgen.discovery.discover",
        "Finding": "faultgen.recordings.finding",
        "Recording": "faultgen.recordings.recording",
        "Replay": "faultgen.discovery.replay.replay",
        "check_recording": "faultgen.discovery.accept",
        "read_recording": "faultgen.recordings.read",
        "settled": "faultgen.discovery.replay.replay",
        "write_recording": "faultgen.recordings.recording",
    },
)

"""ROS 2 bags (sqlite3 and mcap) with joint states. They need the package rosbags.

Columns are ``stamp`` [ns], and ``position/NAME``, ``velocity/NAME`` and ``effort/NAME`` for each
joint. Source of the message: sensor_msgs/msg/JointState of ROS 2.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from faultgen.errors import InputError, one_line
from faultgen.importing.column_map import File
from faultgen.importing.table import Table

TYPE = "sensor_msgs/msg/JointState"
FIELDS = ("position", "velocity", "effort")
STAMP = "stamp"
"""Column with the time in the header of the messages, as whole numbers [ns]."""


def read_bag(path: Path, file: File) -> Table:
    """Read the joint states of a bag.

    Args:
        path: Folder of the bag, or its .db3 or .mcap file.
        file: What the map says: the topic.

    Returns:
        The columns. The axes are the joints, in the order of the first message.

    Raises:
        InputError: The package rosbags is not installed, or the bag has no such messages, or
            several topics with them.
    """
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise InputError(
            "ROS 2 bags need the package rosbags (the extra ros2); install it: pip install rosbags"
        ) from None
    folder = path.parent if path.is_file() and (path.parent / "metadata.yaml").is_file() else path
    try:
        with AnyReader([folder], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            topics = {one.topic for one in reader.connections if one.msgtype == TYPE}
            topic = _topic(path, topics, file.topic)
            wanted = [one for one in reader.connections if one.topic == topic]
            messages: list[Any] = [
                reader.deserialize(raw, one.msgtype) for one, _, raw in reader.messages(wanted)
            ]
    except (AnyReaderError, OSError, ValueError, KeyError) as error:
        line = one_line(error)
        raise InputError(f"{path}: cannot be read as a ROS 2 bag ({line})") from None
    if not messages:
        raise InputError(f"{path}: topic '{topic}' has no messages")
    names = list(messages[0].name)
    order = ", ".join(names)
    notes = [f"topic {topic}; the joints are, in the order of its first message, {order}"]
    used = [one for one in messages if set(names) <= set(one.name)]
    if len(used) < len(messages):
        notes.append(f"{len(messages) - len(used)} messages with other joints were left out")
    stamps = np.array(
        [one.header.stamp.sec * 1_000_000_000 + one.header.stamp.nanosec for one in used], np.int64
    )
    sequence = np.argsort(stamps, kind="stable")
    columns = {STAMP: stamps[sequence]}
    for field in FIELDS:
        if all(len(getattr(one, field)) == len(one.name) for one in used):
            values = np.array(
                [
                    [getattr(one, field)[list(one.name).index(name)] for name in names]
                    for one in used
                ]
            )
            for k, name in enumerate(names):
                columns[f"{field}/{name}"] = values[sequence, k]
    return Table(source=str(path), columns=columns, axes=tuple(names), notes=tuple(notes))


def _topic(path: Path, topics: set[str], given: str | None) -> str:
    listed = ", ".join(sorted(topics))
    if not topics:
        raise InputError(f"{path}: has no topic of type {TYPE}")
    if given is not None and given not in topics:
        raise InputError(f"{path}: no topic '{given}' with joint states; there are {listed}")
    if given is None and len(topics) > 1:
        raise InputError(f"{path}: several topics have joint states; state file.topic: {listed}")
    return given or next(iter(topics))

"""ROS 1 bags (.bag) and ROS 2 bags (sqlite3 and mcap) with joint states, read with rosbags.

Columns are ``stamp`` [ns], and ``position/NAME``, ``velocity/NAME`` and ``effort/NAME`` for each
joint. Source of the message: sensor_msgs/msg/JointState of ROS 2, sensor_msgs/JointState of ROS 1.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from faultgen.errors import InputError, one_line
from faultgen.importing.column_map import Axes, File
from faultgen.importing.table import Table, listed

TYPE = "sensor_msgs/msg/JointState"
FIELDS = ("position", "velocity", "effort")
STAMP = "stamp"
"""Column with the time in the header of the messages, as whole numbers [ns]; with that of receipt
if the header has none, or if the map says so."""
RECEIVED = "received"
"""Column with the time at which the bag received the messages, as whole numbers [ns]."""

MOST_MESSAGES = 400_000
"""Most messages that are read. Each takes about 1 kB with seven joints."""

_MOST_EQUAL = 0.2  # share of the messages that may have the stamp of another one
_FEW = 0.1  # messages of a set of joints over those of the most frequent one, to be the robot's
_FAR = 4.0  # largest usual steps by which another program's positions are other ones: assumed


def read_bag(path: Path, file: File, axes: Axes | None = None) -> Table:
    """Read the joint states of a bag.

    Args:
        path: Folder of the bag, or its .bag, .db3 or .mcap file.
        file: What the map says: the topic, and which times.
        axes: What the map says: the names of the joints.

    Returns:
        The columns. The axes are the joints, in the order of the first message.

    Raises:
        InputError: The package rosbags is not installed, or the bag has no such messages, or
            several topics with them, or the headers have no times although they are asked for.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise InputError(
            "ROS bags need the package rosbags (the extra ros2); install it: pip install rosbags"
        ) from None
    folder = path.parent if path.is_file() and (path.parent / "metadata.yaml").is_file() else path
    try:
        with AnyReader([folder], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            topics = {one.topic for one in reader.connections if one.msgtype == TYPE}
            topic = _topic(path, topics, file.topic)
            wanted = [one for one in reader.connections if one.topic == topic]
            messages = [
                _Message.of(reader.deserialize(raw, one.msgtype), received, one)
                for one, received, raw in _limited(path, reader.messages(wanted))
            ]
    except InputError:
        raise
    except Exception as error:  # a damaged bag can make the reader raise anything
        line = one_line(error)
        raise InputError(f"{path}: cannot be read as a ROS bag ({line})") from None
    if not messages:
        raise InputError(f"{path}: topic '{topic}' has no messages")
    names = _joints(path, messages, axes.names if axes is not None else None)
    notes = [
        f"topic {topic}; the joints are, in the order of its first message, {', '.join(names)}"
        if axes is None or axes.names is None
        else f"topic {topic}"
    ]
    used = [one for one in messages if set(names) <= set(one.names)]
    if len(used) < len(messages):
        notes.append(f"{len(messages) - len(used)} messages with other joints were left out")
    used = _with_fields(path, used, notes)
    fields = [name for name in FIELDS if all(name in one.values for one in used)]
    times, used = _in_time(path, used, file.stamp, notes)
    arrays = {field: np.array([one.of_joints(field, names) for one in used]) for field in fields}
    kept = _of_one_publisher(used, times, arrays["position"], notes)
    columns = {STAMP: times[kept], RECEIVED: np.array([one.received for one in used])[kept]}
    for field, values in arrays.items():
        for k, name in enumerate(names):
            columns[f"{field}/{name}"] = values[kept, k]
    return Table(source=str(path), columns=columns, axes=names, notes=tuple(notes))


@dataclass(frozen=True)
class _Message:
    """What is used of a message."""

    received: int
    stamp: int
    frame: str
    publisher: str
    names: tuple[str, ...]
    values: dict[str, np.ndarray]

    @property
    def kind(self) -> tuple[Any, ...]:
        """In what the messages of programs differ that publish on one topic."""
        return self.publisher, self.names, self.frame, tuple(self.values)

    @classmethod
    def of(cls, message: Any, received: int, connection: Any) -> _Message:
        stamp = message.header.stamp
        count = len(message.name)
        return cls(
            received=received,
            stamp=stamp.sec * 1_000_000_000 + stamp.nanosec,
            frame=str(message.header.frame_id),
            # ROS 1 writes the name of the program; ROS 2 has one connection for a topic
            publisher=sys.intern(str(getattr(connection.ext, "callerid", "") or connection.id)),
            names=tuple(map(sys.intern, message.name)),
            values={
                name: np.array(getattr(message, name), float)
                for name in FIELDS
                if count and len(getattr(message, name)) == count
            },
        )

    def of_joints(self, field: str, names: Sequence[str]) -> list[float]:
        """Values of a field in the order of joints."""
        place = {name: k for k, name in enumerate(self.names)}
        return [float(self.values[field][place[name]]) for name in names]


def _joints(
    path: Path, messages: Sequence[_Message], given: Sequence[str | int] | None
) -> tuple[str, ...]:
    """The joints of the robot: those that the map names, or the largest usual set of them."""
    sets = Counter(frozenset(one.names) for one in messages)
    if given is not None:
        names = tuple(map(str, given))
        if not any(set(names) <= one for one in sets):
            each = "; ".join(", ".join(sorted(one)) for one in sets)
            raise InputError(
                f"{path}: no message has all of the joints {listed(names)}; its messages have: "
                f"{each}; correct axes.names in the map"
            )
        return names
    (_, most), *_ = sets.most_common(1)
    with_effort = {frozenset(one.names) for one in messages if "effort" in one.values}
    usual = [one for one, count in sets.items() if count >= _FEW * most]
    best = max(usual, key=lambda one: (one in with_effort, len(one), sets[one]))
    return next(one.names for one in messages if frozenset(one.names) == best)


def _limited(path: Path, messages: Iterable[Any]) -> Iterator[Any]:
    """Messages, up to the most that are read."""
    for count, one in enumerate(messages):
        if count == MOST_MESSAGES:
            raise InputError(
                f"{path}: more than {MOST_MESSAGES:,} messages, the most that are read; cut the bag"
                " into shorter ones (ros2 bag convert), or record fewer joints"
            )
        yield one


def _with_fields(path: Path, messages: list[_Message], notes: list[str]) -> list[_Message]:
    """Messages that have positions and, if any has, efforts."""
    for field in ("position", "effort"):
        having = [one for one in messages if field in one.values]
        if not having and field == "position":
            raise InputError(f"{path}: none of its {len(messages)} messages has positions")
        if having and len(having) < len(messages):
            notes.append(
                f"{len(messages) - len(having)} of {len(messages)} messages have no {field}, and "
                "were left out"
            )
            messages = having
    speeds = sum("velocity" in one.values for one in messages)
    if 0 < speeds < len(messages):
        notes.append(
            f"velocity was left out, because {len(messages) - speeds} of {len(messages)} messages "
            "have none"
        )
    return messages


def _in_time(
    path: Path, messages: Sequence[_Message], asked: str, notes: list[str]
) -> tuple[np.ndarray, list[_Message]]:
    """Times [ns] and messages in their order; times of receipt if the header has none."""
    stamps = np.array([one.stamp for one in messages], np.int64)
    received = np.array([one.received for one in messages], np.int64)
    unset = int((stamps == 0).sum())
    repeated = sum(
        int((np.diff(np.sort(stamps[of_kind])) == 0).sum()) for _, of_kind in _by_kind(messages)
    )
    if asked == "header" and unset:
        raise InputError(
            f"{path}: header.stamp is 0 in {unset} of {len(messages)} messages; take the times at "
            "which the bag received them: --time receive"
        )
    if asked == "receive":
        notes.append("the times are those at which the bag received the messages, as asked")
        stamps = received
    elif (
        asked == "auto" and len(messages) > 1 and (unset or repeated > _MOST_EQUAL * len(messages))
    ):
        why = (
            f"header.stamp is 0 in {unset} of {len(messages)} messages"
            if unset
            else f"{repeated} of {len(messages)} messages have the header.stamp of another one"
        )
        notes.append(
            f"{why}: the times of receipt are used, which scatter more; set the stamp in the driver"
        )
        stamps = received
    order = np.argsort(stamps, kind="stable")
    return stamps[order], [messages[k] for k in order.tolist()]


def _by_kind(messages: Sequence[_Message]) -> list[tuple[tuple[Any, ...], np.ndarray]]:
    """Kinds of messages, the most frequent first, and which messages are of each."""
    kinds = [one.kind for one in messages]
    return [
        (kind, np.array([one == kind for one in kinds])) for kind, _ in Counter(kinds).most_common()
    ]


def _of_one_publisher(
    messages: Sequence[_Message], times: np.ndarray, position: np.ndarray, notes: list[str]
) -> np.ndarray:
    """Which messages agree with those of the program that publishes most of them.

    Programs that publish on one topic differ in the order of the joints, the frame, or the fields
    that they fill in.

    Returns:
        Shape (messages,).
    """
    kept = np.ones(len(messages), bool)
    (_, of_most), *others = _by_kind(messages)
    clock = (times - times[0]).astype(float)
    for (publisher, names, *_), of_other in others:
        count = int(of_other.sum())
        told = f"another program publishes on this topic ({', '.join(names)}"
        told += ")" if publisher.isdigit() else f"; {publisher})"
        told += f"; {count} of {len(messages)} messages are its, "
        if np.isin(times[of_other], times[of_most]).mean() > 0.5:
            kept &= ~of_other
            notes.append(f"{told}have the times of other messages, and were left out")
            continue
        moves = np.abs(np.diff(position[of_most], axis=0)).max(axis=0, initial=0.0)
        expected = np.stack(
            [np.interp(clock[of_other], clock[of_most], column[of_most]) for column in position.T],
            axis=1,
        )
        far = np.abs(position[of_other] - expected) > _FAR * moves + 1e-9
        if far.any(axis=1).mean() > 0.5:
            kept &= ~of_other
            notes.append(f"{told}say other positions, and were left out")
    return kept


def _topic(path: Path, topics: set[str], given: str | None) -> str:
    listed = ", ".join(sorted(topics))
    if not topics:
        raise InputError(f"{path}: has no topic of type {TYPE}")
    if given is not None and given not in topics:
        raise InputError(f"{path}: no topic '{given}' with joint states; there are {listed}")
    if given is None and len(topics) > 1:
        raise InputError(f"{path}: several topics have joint states; state file.topic: {listed}")
    return given or next(iter(topics))

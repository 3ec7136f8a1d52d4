"""Bags of ROS 2, an MCAP file, an SQLite file, or rosbag2's folder: messages out, joint states in as columns."""

import functools
import json
import re
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from twolink.errors import TwolinkError, import_extra
from twolink.io.files import write_atomic

EXTRA = "mcap"  # of twolink, which installs rosbags
BAGS = (".mcap", ".db3")
NOTES, STATES, DESCRIPTION = "/twolink", "/joint_states", "/robot_description"  # topics
JOINTS, BODY, NUMBER, TEXT = (
    "sensor_msgs/msg/JointState", "nav_msgs/msg/Odometry", "std_msgs/msg/Float64", "std_msgs/msg/String",
)  # fmt: skip
TOPICS = "topics"  # the note of columns by topic
WALL_CLOCK = 10**18  # ns: a later stamp is one of a clock, and counts from the first


@functools.cache
def _types() -> Any:
    """ROS 2's messages."""
    typesys = import_extra("rosbags.typesys", EXTRA)
    return typesys.get_typestore(typesys.Stores.LATEST)


def message(kind: str, *fields: Any) -> Any:
    """A message of a kind such as "std_msgs/msg/String", of its fields in order."""
    return _types().types[kind](*fields)


def stamp(t: int) -> Any:
    """A time, ns, as messages have it."""
    return message("builtin_interfaces/msg/Time", *divmod(t, 10**9))


def topic_of(name: str, taken: Iterable[str]) -> str:
    """A name as that of a topic: letters, digits, _ and /, other than those taken."""
    parts = re.sub(r"[^\w.]+", "_", name, flags=re.ASCII).split(".")
    topic = "".join(f"/{'_' * part[0].isdigit()}{part}" for part in parts if part)
    while topic in taken:
        topic += "_"
    return topic


def is_bag(path: Path) -> bool:
    """True if a path is that of a bag: a file, or rosbag2's folder."""
    return path.is_dir() or path.suffix.lower() in BAGS


def write_bag(path: Path, messages: Iterable[tuple[int, str, Any]]) -> Path:
    """Write messages (time in ns, topic, message) to an .mcap file, compressed, or to a .db3 file (SQLite).

    Raises
    ------
    TwolinkError
        The file cannot be written (code "not-writable"), or rosbags is not installed.
    """
    rosbag2 = import_extra("rosbags.rosbag2", EXTRA)
    suffix, connections = path.suffix.lower(), dict[str, Any]()
    plugin = rosbag2.StoragePlugin.MCAP if suffix == ".mcap" else rosbag2.StoragePlugin.SQLITE3
    with tempfile.TemporaryDirectory() as folder:
        bag = rosbag2.Writer(Path(folder) / "bag", version=9, storage_plugin=plugin)
        if suffix == ".mcap":
            bag.set_compression(rosbag2.CompressionMode.STORAGE, rosbag2.CompressionFormat.ZSTD)
        with bag:
            for t, topic, content in messages:
                kind = content.__msgtype__
                if topic not in connections:
                    qos = [_kept()] if topic in (NOTES, DESCRIPTION) else []
                    connections[topic] = bag.add_connection(topic, kind, typestore=_types(), offered_qos_profiles=qos)
                bag.write(connections[topic], t, _types().serialize_cdr(content, kind))
        with (Path(folder) / "bag" / f"bag{suffix}").open("rb") as made:
            return write_atomic(path, lambda file: shutil.copyfileobj(made, file))


def _kept() -> Any:
    """The quality of service of what is sent once, and kept for those who come later."""
    given = import_extra("rosbags.interfaces", EXTRA)
    never = given.QosTime(2**63 // 10**9, (2**63 - 1) % 10**9)
    return given.Qos(given.QosHistory.KEEP_LAST, 1, given.QosReliability.RELIABLE, given.QosDurability.TRANSIENT_LOCAL,
                     never, never, given.QosLiveliness.AUTOMATIC, never, False)  # fmt: skip


def read_bag(path: Path) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """The states of joints in a bag as columns t, q.JOINT, v.JOINT and tau.JOINT, of one that is ours with all others.

    Joint states are those of the topic "/joint_states", or of the only one; odometry is the motion of a free base,
    "root_joint". Stamps of a clock count from the first.

    Raises
    ------
    TwolinkError
        The bag has no joint states, several of them, or topics with other times (code "no-joint-states").
    """
    highlevel = import_extra("rosbags.highlevel", EXTRA)
    with highlevel.AnyReader([path], default_typestore=_types()) as bag:
        notes: dict[str, str] = {}
        for content in _messages(bag, [c for c in bag.connections if c.topic == NOTES and c.msgtype == TEXT]):
            notes = json.loads(content[1].data)
        ours = json.loads(notes.pop(TOPICS, "{}"))
        states = {c.topic: c for c in bag.connections if c.msgtype == JOINTS and c.msgcount}
        bodies = {c.topic: c for c in bag.connections if c.msgtype == BODY and c.msgcount}
        if not (states or bodies or ours):
            raise _no_states("it has no sensor_msgs/msg/JointState", path)
        parts = []
        if states:
            parts.append(_joint_states(bag, _only(states, path), path))
        for connection in ([bodies[topic] for topic in ours if topic in bodies] if ours
                           else [_only(bodies, path)] if bodies else []):  # fmt: skip
            parts.append(_odometry(bag, connection, ours.get(connection.topic, "root_joint")))
        for connection in bag.connections:
            if connection.msgtype == NUMBER and connection.topic in ours:
                numbers = [(t, content.data) for t, content in _messages(bag, [connection])]
                times, values = np.array(numbers, dtype=object).T
                parts.append((times.astype(np.int64), {ours[connection.topic]: values.astype(float)}))
    times = parts[0][0]
    if any(not np.array_equal(other, times) for other, _ in parts):
        raise _no_states(
            "its joint states and odometry have other times",
            path,
            "resample one at the times of the other, or leave it out",
        )
    start = times[0] if times[0] > WALL_CLOCK else 0
    columns = {"t": (times - start) / 1e9}
    for _, part in parts:
        columns |= part
    return columns, notes


def _only(found: dict[str, Any], path: Path) -> Any:
    """The connection of joint states, or the only one."""
    if STATES not in found and len(found) > 1:
        raise _no_states(
            f"it has several such topics: {', '.join(sorted(found))}", path, f"name one {STATES}, or keep one"
        )
    return found.get(STATES) or next(iter(found.values()))


def _messages(bag: Any, connections: list[Any]) -> Iterator[tuple[int, Any]]:
    """(time of writing in ns, message)."""
    for connection, t, raw in bag.messages(connections) if connections else ():
        yield t, bag.deserialize(raw, connection.msgtype)


def _stamped(rows: list[tuple[int, Any]]) -> np.ndarray:
    """The stamps (n,), ns; where there are none, the times of writing."""
    stamps = np.array([m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for _, m in rows], dtype=np.int64)
    return stamps if stamps.any() else np.array([t for t, _ in rows], dtype=np.int64)


def _joint_states(bag: Any, connection: Any, path: Path) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    rows = list(_messages(bag, [connection]))
    names = list(rows[0][1].name)
    columns: dict[str, np.ndarray] = {}
    for letter, field in (("q", "position"), ("v", "velocity"), ("tau", "effort")):
        if all(len(getattr(m, field)) == 0 for _, m in rows):
            continue
        values = np.empty((len(rows), len(names)))
        for k, (_, m) in enumerate(rows):
            given = dict(zip(m.name, getattr(m, field), strict=False))
            if given.keys() != set(names):
                what = f"message {k} of {connection.topic} has {field} of other joints than the first has"
                raise _no_states(what, path, "record joint states that hold all joints")
            values[k] = [given[name] for name in names]
        columns |= {f"{letter}.{name}": column for name, column in zip(names, values.T, strict=True)}
    return _stamped(rows), columns


def _odometry(bag: Any, connection: Any, joint: str) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """The pose and the velocity of a free body, the latter along its own axes."""
    rows = list(_messages(bag, [connection]))
    q = [[*_vector(m.pose.pose.position), *_vector(m.pose.pose.orientation), m.pose.pose.orientation.w]
         for _, m in rows]  # fmt: skip
    v = [[*_vector(m.twist.twist.linear), *_vector(m.twist.twist.angular)] for _, m in rows]
    columns = {f"{letter}.{joint}.{k}": column for letter, table in (("q", q), ("v", v))
               for k, column in enumerate(np.array(table).T)}  # fmt: skip
    return _stamped(rows), columns


def _vector(given: Any) -> list[float]:
    return [given.x, given.y, given.z]


def _no_states(what: str, path: Path, remedy: str = "record the topic of joint states") -> TwolinkError:
    return TwolinkError(what, where=str(path), remedy=remedy, code="no-joint-states")

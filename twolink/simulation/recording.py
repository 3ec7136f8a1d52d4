"""A trajectory in files: tables, recordings of Rerun, and bags of messages of ROS 2, which Foxglove, PlotJuggler and
RViz know unaided.
"""

import json
import logging
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from twolink.dynamics.robot_record import link_frames, link_poses, robot_notes
from twolink.errors import SceneError
from twolink.io import bags
from twolink.io.bags import message, stamp, topic_of
from twolink.io.tables import SUFFIXES, require_format, write_table
from twolink.robots.joint_layout import JointLayout, counted_on
from twolink.simulation import trajectory_tables as tables

SAVED = (*SUFFIXES, ".mat", *bags.BAGS, ".rrd")
SHOWN = ".html", ".mp4", ".webm", ".gif"  # a playback, and films

INFO = 20  # of rcl_interfaces/msg/Log


log = logging.getLogger("twolink")


def save_run(run: Any, path: Path) -> Path:
    """Write a Trajectory; see its `save`."""
    suffix = require_format(path, (*SAVED, *SHOWN))
    if suffix in SHOWN:
        shown: Path = run.playback(path) if suffix == ".html" else run.video(path)
        return shown
    if suffix == ".rrd":
        return _save_rrd(run, path)
    notes = {**robot_notes(run.robot), "title": run.title, "bound": run.bound,
             **tables.mark_notes(run.events or (), run.accuracy)}  # fmt: skip
    if suffix in bags.BAGS:
        return _save_bag(run, path, notes)
    return write_table(path, {**run.columns(), **tables.mark_columns(run.contacts, run.wrenches_on_links)}, notes)


def log_skipped(names: list[str]) -> None:
    """Say in the log which shapes are not drawn."""
    log.warning("not drawn: %s", ", ".join(names))


def _save_rrd(run: Any, path: Path) -> Path:
    from twolink.show.rerun_file import write_rrd

    robot, links = run.robot, {i: run.robot.model.frames[i].name for i in link_frames(run.robot)}
    curves = {tuple(name.split(".", 1)): values for name, values in run.columns().items() if name != "t"}
    visible = robot.model, robot.visual_model(tree=False)
    skipped = write_rrd(path, run.title or robot.name, visible, links, run.t, link_poses(robot, run.q), curves)
    if skipped:
        log_skipped(skipped)
    return path


def _save_bag(run: Any, path: Path, notes: Mapping[str, str]) -> Path:
    for joint in run.robot.joints:
        if joint.kind in ("planar", "quaternion"):
            raise SceneError(f"a bag has no place for a {joint.kind} joint", where=f"joint {joint.name!r}",
                             remedy="save it as .npz", code="not-in-format")  # fmt: skip
    times = np.rint(run.t * 1e9).astype(np.int64)
    if np.any(np.diff(times) <= 0):
        raise SceneError("samples are closer than a nanosecond, the unit of time of a bag", where=str(path),
                         remedy="save it as .npz", code="not-in-format")  # fmt: skip
    return bags.write_bag(path, _messages(run, times.tolist(), notes))


def _messages(run: Any, times: list[int], notes: Mapping[str, str]) -> Iterator[tuple[int, str, Any]]:
    """(time in ns, topic, message) in the order of time."""
    numbers, free = _numbers(run), _free_joints(run)
    columns = {topic: name for topic, (name, _) in numbers.items()} | {topic: j.name for topic, j in free.items()}
    yield times[0], bags.NOTES, message(bags.TEXT, json.dumps({**notes, bags.TOPICS: json.dumps(columns)}))
    yield times[0], bags.DESCRIPTION, message(bags.TEXT, run.robot.visuals.text)
    events = [(round(event.t * 1e9), event) for event in run.events or ()]
    states, places, wrenches = _joint_states(run), link_poses(run.robot, run.q), _wrenches(run, numbers)
    frames = [run.robot.model.frames[k] for k in reversed(link_frames(run.robot))]
    carried = {frame.parentJoint: frame.name for frame in frames}  # the first link of each joint
    links, ground = run.robot.frame_names, "universe" if "world" in run.robot.frame_names else "world"

    def until(t: float) -> Iterator[tuple[int, str, Any]]:
        while events and events[0][0] <= t:
            at, event = events.pop(0)
            yield at, "/rosout", message("rcl_interfaces/msg/Log", stamp(at), INFO, event.kind, event.text, "", "", 0)

    for k, t in enumerate(times):
        yield from until(t)
        header = message("std_msgs/msg/Header", stamp(t), ground)
        if states[0]:
            yield t, bags.STATES, message(bags.JOINTS, header, states[0], *(values[k] for values in states[1:]))
        yield t, "/tf", message("tf2_msgs/msg/TFMessage", [
            message("geometry_msgs/msg/TransformStamped", header, link,
                    message("geometry_msgs/msg/Transform", _vector(pose[:3]), _quaternion(pose[3:])))
            for link, pose in zip(links, places[k], strict=True)])  # fmt: skip
        for topic, joint in free.items():
            yield t, topic, _odometry(header, carried[joint.index], run.q[k, joint.q], run.v[k, joint.v])
        for topic, (_, values) in numbers.items():
            yield t, topic, message(bags.NUMBER, float(values[k]))
        for topic, values in wrenches.items():
            wrench = message("geometry_msgs/msg/Wrench", _vector(values[k, :3]), _vector(values[k, 3:]))
            yield t, topic, message("geometry_msgs/msg/WrenchStamped", header, wrench)
    yield from until(math.inf)


def _joint_states(run: Any) -> tuple[list[str], *tuple[np.ndarray, ...]]:
    """Names, positions, velocities and torques of the joints with one degree of freedom; angles go on beyond a turn."""
    joints = [joint for joint in run.robot.joints if joint.kind in ("vector", "cos-sin")]
    q = [counted_on(np.arctan2(run.q[:, j.q.stop - 1], run.q[:, j.q.start]), run.t, run.v[:, j.v.start])
         if j.kind == "cos-sin" else run.q[:, j.q.start] for j in joints]  # fmt: skip
    columns = [joint.v.start for joint in joints]
    n = len(run.t)
    known = run.solution is not None or run.recorded_tau is not None
    tau = run.tau[:, columns] if known else np.empty((n, 0))
    rows = (np.column_stack([np.empty((n, 0)), *q]), run.v[:, columns], tau)
    return [j.name for j in joints], *map(np.ascontiguousarray, rows)


def _free_joints(run: Any) -> dict[str, JointLayout]:
    """The joints of free bodies by topic."""
    found: dict[str, JointLayout] = {}
    for joint in run.robot.joints:
        if joint.kind == "free-flyer":
            found[topic_of(f"odometry.{joint.name}", found)] = joint
    return found


def _numbers(run: Any) -> dict[str, tuple[str, np.ndarray]]:
    """Energy, error bar and states of effects by topic: their columns' names, and values (n,)."""
    found = {"/energy": ("energy", run.energy)}
    if run.error is not None:
        found["/error_bar"] = ("error", run.error)
    for name, values in run.states.items():
        found[topic_of(f"states.{name}", found)] = (f"z.{name}", values)
    return found


def _wrenches(run: Any, taken: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Forces and moments about the world's origin (n, 6) by topic, of contacts and of effects on links."""
    found: dict[str, np.ndarray] = {}
    for kind, marks in (("contacts", run.contacts), ("forces", run.wrenches_on_links)):
        for name, (points, forces, *own) in marks.items():
            moments = sum(own, np.cross(points, forces))
            wrench = np.concatenate([np.nansum(forces, axis=1), np.nansum(moments, axis=1)], axis=1)
            found[topic_of(f"{kind}.{name}", {**found, **taken})] = wrench
    return found


def _odometry(header: Any, link: str, q: np.ndarray, v: np.ndarray) -> Any:
    pose = message("geometry_msgs/msg/Pose", message("geometry_msgs/msg/Point", *q[:3].tolist()), _quaternion(q[3:]))
    twist = message("geometry_msgs/msg/Twist", _vector(v[:3]), _vector(v[3:]))
    unknown = np.zeros(36)
    return message(bags.BODY, header, link, message("geometry_msgs/msg/PoseWithCovariance", pose, unknown),
                   message("geometry_msgs/msg/TwistWithCovariance", twist, unknown))  # fmt: skip


def _vector(values: np.ndarray) -> Any:
    return message("geometry_msgs/msg/Vector3", *values.tolist())


def _quaternion(values: np.ndarray) -> Any:
    return message("geometry_msgs/msg/Quaternion", *values.tolist())

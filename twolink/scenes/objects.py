"""Robots and objects that a scene has beside its robot."""

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeGuard

import pinocchio as pin

from twolink.dynamics import Robot
from twolink.errors import RobotError, TwolinkError
from twolink.io.mesh_files import SUFFIXES
from twolink.robots.catalogue import catalogue_entry, catalogue_names
from twolink.robots.collisions import Shape
from twolink.robots.joining import body_of, free_name, joined, pose_of
from twolink.scenes.file_format import ObjectEntry, RobotEntry


def is_mesh(source: object) -> TypeGuard[str]:
    """True if the source of an object is the path of a mesh."""
    return isinstance(source, str) and source.lower().endswith(SUFFIXES)


def with_objects(robot: Robot, objects: Sequence[ObjectEntry], load: Callable[[RobotEntry], Robot]) -> Robot:
    """The robot joined with objects.

    Parameters
    ----------
    robot : Robot
    objects : sequence of ObjectEntry
    load : callable
        Gives the robot of an entry.

    Raises
    ------
    TwolinkError
        As `Scene.with_object`; `where` is the place among the objects.
    """
    parts = list[tuple[Robot, str, pin.SE3, bool]]()
    names = {*robot.joint_names, *robot.frame_names}
    for number, entry in enumerate(objects):
        try:
            part, free, pose = *_part(entry, number + len(robot.joints), load), pose_of(entry.pose)
        except TwolinkError as error:
            raise error.at(f"objects[{number}]{f', {error.where}' if error.where else ''}") from None
        name = entry.name or free_name(part.name, names)
        names.add(name)
        parts.append((part, name, pose, free))
    return joined(robot, parts) if parts else robot


def _part(entry: ObjectEntry, number: int, load: Callable[[RobotEntry], Robot]) -> tuple[Robot, bool]:
    """An object as a robot, and whether it is free."""
    source = os.fspath(entry.source) if isinstance(entry.source, os.PathLike) else entry.source
    if is_mesh(source):
        source = Path(source)
    if isinstance(source, (Shape, Path)):
        free = entry.mass is not None if entry.root is None else entry.root == "free"
        return body_of(Robot, source, entry.mass, number), free
    if entry.mass is not None:
        raise RobotError("a robot has masses of its own", argument="mass", remedy="leave it out")
    part = source if isinstance(source, Robot) else load(RobotEntry(source))
    usual = catalogue_entry(source).usual_root if source in catalogue_names() else part.root
    return part, (entry.root or ("free" if not part.joints else usual)) == "free"

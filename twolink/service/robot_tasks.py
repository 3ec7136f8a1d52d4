"""What worker processes do with robots: receive an upload, load one that was kept, and draw it."""

from __future__ import annotations

import functools
import pickle
import re
from pathlib import Path
from typing import Any, Literal

import msgspec

from twolink.dynamics import Robot, load_robot
from twolink.dynamics.robot_record import robot_record
from twolink.errors import RobotError
from twolink.robots.catalogue import catalogue_names
from twolink.service.uploads import check_files, choose_urdf, local_urdf, unpack
from twolink.service.visuals import visuals_of

OPTIONS = "options.json"
URDF = "robot.urdf"
FILES = "files"
UPLOADED = re.compile(r"u-[0-9a-f]{20}")  # an uploaded robot's id


class RobotOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """How a robot is loaded, as load_robot takes it. source: a name of the catalogue, in place of a URDF.

    urdf: which file of a zip is the robot.
    """

    source: str = ""
    urdf: str = ""
    root: Literal["fixed", "free"] = "fixed"
    lock: dict[str, float | list[float]] = {}
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    mimic: bool = False
    unphysical: Literal["refuse", "report"] = "refuse"


def receive(*, folder: str, kind: str, options: dict[str, Any], most: dict[str, Any], **_: Any) -> dict[str, Any]:
    """Check and load what was uploaded into `folder` (as "body"), and leave there what is needed to load it again."""
    place, chosen = Path(folder), msgspec.convert(options, RobotOptions)
    body = place / "body"
    if kind != "source":
        files = place / FILES
        files.mkdir()
        names: list[str] = []
        if kind == "zip":
            names = unpack(body, files, most_bytes=most["bytes"], most_files=most["files"])
            urdf = choose_urdf(names, chosen.urdf)
            data = (files / urdf).read_bytes()
        else:
            urdf, data = "robot.urdf", body.read_bytes()
        check_files(files, names)
        (place / URDF).write_text(local_urdf(_text(data, urdf), urdf, names), encoding="utf-8")
        body.unlink()
    (place / OPTIONS).write_bytes(msgspec.json.encode(chosen))
    robot = read(folder)
    if robot.nv > most["nv"]:
        what = f"{robot.nv} degrees of freedom, the service takes up to {most['nv']}"
        raise RobotError(what, where=robot.name, remedy="lock some joints, or start it with a larger quota")
    return {"robot": pickle.dumps(robot), "description": robot_record(robot)}


def _text(data: bytes, name: str) -> str:
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise RobotError("it is not UTF-8 text", where=name, remedy="save the URDF as UTF-8") from None


@functools.lru_cache(16)
def read(folder: str) -> Robot:
    """The robot that was received into this folder."""
    place = Path(folder)
    chosen = msgspec.json.decode((place / OPTIONS).read_bytes(), type=RobotOptions)
    if chosen.source:
        if chosen.source not in catalogue_names():  # a path would be read
            raise RobotError(f"{chosen.source[:80]!r} is not in the catalogue", where="source",
                             remedy="GET /v1/robots lists the names")  # fmt: skip
        source = chosen.source
    else:
        source = (place / URDF).read_text(encoding="utf-8")
        if "<" not in source:  # else it would be taken for a name or a path
            raise RobotError("not XML: no element", where="URDF text", remedy="send a URDF")
    return load_robot(
        source, package_dirs=[place / FILES], root=chosen.root, lock=chosen.lock, gravity=chosen.gravity,
        mimic=chosen.mimic, unphysical=chosen.unphysical,
    )  # fmt: skip


def find(key: str, robots: str) -> Robot:
    """A robot by its id: of the catalogue, or of the folder of those received."""
    if key in catalogue_names():
        return _of_catalogue(key)
    if not UPLOADED.fullmatch(key) or not (Path(robots) / key).is_dir():
        raise RobotError(f"there is no robot {key[:80]!r}", where="robot", remedy="GET /v1/robots lists them")
    return read(str(Path(robots) / key))


@functools.lru_cache(16)
def _of_catalogue(name: str) -> Robot:
    return load_robot(name)


def load(*, folder: str, **_: Any) -> bytes:
    """A robot that was received before, pickled."""
    return pickle.dumps(read(folder))


def draw(*, key: str, robots: str, target: str, **_: Any) -> int:
    """Write what a robot looks like into a file. Returns its size, bytes."""
    content = visuals_of(find(key, robots))
    Path(target).write_bytes(content)
    return len(content)

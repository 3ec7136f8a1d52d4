"""Tasks of worker processes about robots: receive an upload, load one that was kept, draw it, and answer queries."""

import gzip
from pathlib import Path
from typing import Annotated, Any, BinaryIO, Literal

import msgspec
import numpy as np

from twolink.dynamics import Robot, load_robot
from twolink.dynamics.robot_record import link_frames, robot_record
from twolink.errors import RobotError
from twolink.io.text import decode
from twolink.parts.service.problems import JSON, Problem, encode, error_from, kept
from twolink.parts.service.settings import Quotas
from twolink.parts.service.store.archives import (
    GZIP_LEVEL,
    RobotCache,
    choose_urdf,
    read_npz,
    save_npz,
    unpack,
    upload_folders,
    write_robot,
)
from twolink.parts.service.store.data_folder import UPLOADED
from twolink.parts.service.work.query_requests import (
    QUERIES,
    answer_query,
    arguments_from_json,
    arguments_from_npz,
    count_of,
    require_size,
)
from twolink.parts.service.work.worker import Ask
from twolink.robots import load_model
from twolink.robots.catalogue import catalogue_entry, catalogue_names
from twolink.scenes.file_format import RobotEntry, scene_content
from twolink.scenes.urdf_scene import scene_of
from twolink.show.meshcat_scene import scene_nodes
from twolink.show.viewer_data import place_on_link, robot_data

_OPTIONS, _URDF, _FILES = "options.json", "robot.urdf", "files"  # in the folder of an uploaded robot
_robots = RobotCache(64)  # of this process


def visuals_of(robot: Robot) -> bytes:
    """JSON: {"links": [name], "objects": [object], "pieces": [piece], "tips": [name], "direction", "skipped": [name]}.

    object: three.js JSON as meshcat's viewer reads it, typed arrays as `show.viewer_data` has them. piece: {"name",
    "link": the link it is fixed to, or null for the world, "placement": position [m] and quaternion (x y z w) in the
    link's frame, "box": two corners of it there, m, "object": its number}. tips: links without a child. direction: from
    a robot that moves in a plane to the camera, else null. skipped: pieces that cannot be drawn.
    """
    geometry = robot.visual_model(tree=False)
    nodes, skipped = scene_nodes(geometry)
    links = set(link_frames(robot))
    drawn = robot_data(robot.model, geometry, nodes, lambda item: place_on_link(robot.model, links, item))
    return msgspec.json.encode({"links": robot.frame_names, **drawn, "skipped": skipped})


class RobotOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """A robot and how it is loaded, as load_robot takes it.

    source: a name of the catalogue. text: a URDF, in JSON without a source. urdf: which file of a zip is the robot.
    """

    source: str = ""
    text: str = ""
    urdf: str = ""
    root: Literal["fixed", "free"] = "fixed"
    lock: dict[str, float | str | Annotated[list[float], msgspec.Meta(max_length=7)]] = {}
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    mimic: bool = False
    unphysical: Literal["refuse", "report"] = "refuse"
    foreign: Literal["refuse", "report"] = "refuse"


class ReceivedRobot(msgspec.Struct):
    """A robot that a worker has loaded: pickled, and as a record."""

    robot: bytes
    description: dict[str, Any]


def receive(*, folder: str, kind: str, options: RobotOptions, quotas: Quotas, ask: Ask) -> ReceivedRobot:
    """Check and load what was uploaded into `folder` (as "body"), and leave there what is needed to load it again.

    ask: for room on the disk, bytes; answered by a problem where there is none.
    """
    place = Path(folder)

    def room(count: int) -> None:
        if refused := ask(count):
            raise error_from(msgspec.convert(refused, Problem))

    body, files = place / "body", place / _FILES
    if kind != "source":
        files.mkdir()
        names = unpack(body, files, quotas, room) if kind == "zip" else []
        urdf = choose_urdf(names, options.urdf) if kind == "zip" else _URDF
        text = decode((files / urdf if kind == "zip" else body).read_bytes(), Path(urdf), RobotError)
        room(len(text.encode()))
        (place / _URDF).write_text(text, encoding="utf-8")
        options = msgspec.structs.replace(options, urdf=urdf)
    body.unlink()
    (place / _OPTIONS).write_bytes(msgspec.json.encode(options))
    robot = _load(folder)
    if robot.nv > quotas.moving_joints:
        what = f"{robot.nv} degrees of freedom, the service takes up to {quotas.moving_joints}"
        raise RobotError(what, where=robot.name, remedy="lock some joints, or start it with a larger quota")
    return ReceivedRobot(write_robot(robot), robot_record(robot))


def _load(folder: str) -> Robot:
    """The robot that was received into this folder."""
    place = Path(folder)
    chosen = msgspec.json.decode((place / _OPTIONS).read_bytes(), type=RobotOptions)
    source = chosen.source or (place / _URDF).read_text(encoding="utf-8")
    if chosen.source and source not in catalogue_names():  # a path would be read
        what = f"{source[:80]!r} is not in the catalogue"
        raise RobotError(what, argument="source", remedy="GET /v1/robots lists the names")
    if not chosen.source and "<" not in source:  # it would be taken for a name or a path
        raise RobotError("not XML: no element", where="URDF text", remedy="send a URDF")
    try:
        return load_model(
            Robot, source, root=chosen.root, lock=chosen.lock, gravity=chosen.gravity, mimic=chosen.mimic,
            unphysical=chosen.unphysical, foreign=chosen.foreign,
            meshes=None if chosen.source else upload_folders(place / _FILES, chosen.urdf),
        )  # fmt: skip
    except RobotError as error:
        if chosen.urdf in ("", _URDF):
            raise
        raise error.at(error.where.replace("URDF text", chosen.urdf)) from None


def robot_by_id(key: str, robots: str) -> Robot:
    """A robot of the catalogue, or of the folder of uploaded robots."""
    return _robots.get(key) or _robots.put(key, load_robot(key) if key in catalogue_names() else _uploaded(key, robots))


def _uploaded(key: str, robots: str) -> Robot:
    if not UPLOADED.fullmatch(key) or not (Path(robots) / key).is_dir():
        raise RobotError(f"there is no robot {key[:80]!r}", argument="robot", remedy="GET /v1/robots lists them")
    with kept(f"robot {key!r}", "delete it, and upload it again"):
        return _load(str(Path(robots) / key))


def load(*, key: str, robots: str) -> bytes:
    """A robot, pickled."""
    return write_robot(robot_by_id(key, robots))


def draw(*, key: str, robots: str, path: str) -> None:
    """Write what a robot looks like into a file, as JSON by gzip."""
    Path(path).write_bytes(gzip.compress(visuals_of(robot_by_id(key, robots)), GZIP_LEVEL))


def robot_scene(*, key: str, robots: str) -> bytes:
    """A scene with all that a robot's file says, as JSON that simulations take; with the ground under a free base.

    A robot of the catalogue that is meant to move about has a free base.
    """
    root = catalogue_entry(key).usual_root if key in catalogue_names() else "fixed"
    robot = load_robot(key, root=root) if root == "free" else robot_by_id(key, robots)
    scene = scene_of(robot, contact=robot.root == "free")
    entry = RobotEntry(key, root)
    content = scene_content(entry, robot, scene.q, scene.v, scene.effects, scene.duration, scene.title)
    return msgspec.json.encode(content)


def query(*, key: str, what: str, sent: str, reply: str, robots: str, quotas: Quotas, exchange: BinaryIO) -> int:
    """Answer the query in the file `exchange` by what is written into it, and return the number of states.

    sent, reply: the media types of the body and of the answer. robots: the folder of uploaded robots.
    """
    robot, asked = robot_by_id(key, robots), QUERIES[what]
    if sent == JSON:
        arguments = arguments_from_json(asked, exchange.read())
    else:
        arguments = arguments_from_npz(asked, read_npz(exchange, int(quotas.upload_mb * 2**20)))
    count, numbers = count_of(robot, asked, arguments)
    require_size(count, numbers, quotas, reply == JSON)
    result = answer_query(robot, asked, arguments, count)
    exchange.seek(0)
    exchange.truncate()
    if reply == JSON:
        exchange.write(encode(result))
    else:
        save_npz(exchange, {name: np.asarray(value) for name, value in result.items()})
    return count


TASKS = {task.__name__: task for task in (load, query)}

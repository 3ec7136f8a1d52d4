"""What a robot looks like, as three.js objects in JSON: one a piece, fixed to a link."""

from typing import Any

import msgspec
import pinocchio as pin

from twolink.dynamics import Robot
from twolink.dynamics.robot_record import link_frames
from twolink.show.meshcat_scene import scene_nodes
from twolink.show.meshcat_shapes import as_json


def visuals_of(robot: Robot) -> bytes:
    """JSON: {"links": [name], "pieces": [{name, link, placement, object}], "skipped": [name]}.

    link: the link it is fixed to, or null for the world. placement: position [m] and quaternion (x y z w) in the link's
    frame, 7 numbers. object: three.js JSON as meshcat's viewer reads it, typed arrays as {"$array": their class,
    "base64": their bytes, little-endian}. skipped: pieces that cannot be drawn.
    """
    geometry = robot.visual_model()
    nodes, skipped = scene_nodes(geometry)
    links = set(link_frames(robot))
    pieces = []
    for node in nodes:
        item = geometry.geometryObjects[node.index]
        frame, placement = _link(robot.model, links, item)
        pieces.append(
            {
                "name": node.name,
                "link": None if frame is None else robot.model.frames[frame].name,
                "placement": pin.SE3ToXYZQUAT(placement).tolist(),
                "object": node.object,
            }
        )
    return msgspec.json.encode({"links": robot.frame_names, "pieces": as_json(pieces), "skipped": skipped})


def _link(model: pin.Model, links: set[int], item: Any) -> tuple[int | None, Any]:
    """The link a piece is fixed to, and its place there: Pinocchio places it relative to the joint."""
    frame = int(item.parentFrame)
    if frame >= model.nframes or frame not in links or model.frames[frame].parentJoint != item.parentJoint:
        frame = min((i for i in links if model.frames[i].parentJoint == item.parentJoint), default=-1)
        if frame < 0:
            return None, item.placement
    return frame, model.frames[frame].placement.inverse() * item.placement

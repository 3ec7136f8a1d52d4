"""What a robot looks like, as three.js objects in JSON: one a piece, fixed to a link."""

from typing import Any

import msgspec
import pinocchio as pin

from twolink.dynamics import Robot
from twolink.dynamics.robot_record import link_frames
from twolink.show.meshcat_scene import scene_nodes
from twolink.show.viewer_data import Place, robot_data


def visuals_of(robot: Robot) -> bytes:
    """JSON: {"links": [name], "objects": [object], "pieces": [piece], "tips": [name], "direction", "skipped": [name]}.

    object: three.js JSON as meshcat's viewer reads it, typed arrays as `show.viewer_data` has them. piece: {"name",
    "link": the link it is fixed to, or null for the world, "placement": position [m] and quaternion (x y z w) in the
    link's frame, "box": two corners of it there, m, "object": its number}. tips: links without a child. direction: from
    a robot that moves in a plane to the camera, else null. skipped: pieces that cannot be drawn.
    """
    geometry = robot.visual_model()
    nodes, skipped = scene_nodes(geometry)
    links = set(link_frames(robot))
    drawn = robot_data(robot.model, geometry, nodes, lambda item: _link(robot.model, links, item))
    return msgspec.json.encode({"links": robot.frame_names, **drawn, "skipped": skipped})


def _link(model: pin.Model, links: set[int], item: Any) -> Place:
    """The link a piece is fixed to, and its place there: Pinocchio places it relative to the joint."""
    frame = int(item.parentFrame)
    if frame >= model.nframes or frame not in links or model.frames[frame].parentJoint != item.parentJoint:
        frame = min((i for i in links if model.frames[i].parentJoint == item.parentJoint), default=-1)
        if frame < 0:
            return None, item.placement
    return model.frames[frame].name, model.frames[frame].placement.inverse() * item.placement

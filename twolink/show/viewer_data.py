"""What the viewer (`viewer/*.js`) draws, as JSON: a robot's pieces and frames, and a motion.

Typed arrays are {"$array": JavaScript's class, "base64": bytes, little-endian}; with "below_new" each number is how far
it is below the next one that no number before it has reached.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from twolink.show.meshcat_scene import Node, plane_direction
from twolink.show.meshcat_shapes import Floats, Json, packed

_SAMPLES = 12  # configurations that tell whether a robot moves in a plane
Place = tuple[str | None, Any]  # the link that a piece is fixed to, or None for the world, and its pin.SE3 there
# A pair's contacts (n, k, 3): points m and forces N, NaN where it is apart.
Contacts = Mapping[str, tuple[Floats, Floats]]


def robot_data(model: Any, visuals: Any, nodes: Sequence[Node], place: Callable[[Any], Place] | None = None) -> Json:
    """A robot as the viewer draws it.

    Parameters
    ----------
    model, visuals : pin.Model, pin.GeometryModel
        The robot.
    nodes : sequence of Node
        The pieces to draw.
    place : callable, optional
        Of a pin.GeometryObject, the link that moves it; by default the joint before it stands for its links.

    Returns
    -------
    dict
        objects: three.js JSON, each once. pieces: name, link, placement (position [m] and quaternion x y z w in the
        link's frame), box (two corners in the piece's frame, m), and the number of its object. tips: the links without
        a child. direction: from a robot that moves in a plane to the camera, else None.
    """
    objects, pieces, numbers = list[Json](), list[Json](), dict[int, int]()
    for node in nodes:
        item = visuals.geometryObjects[node.index]
        link, placement = place(item) if place else (_body(model, item.parentJoint), item.placement)
        if id(node.object) not in numbers:
            numbers[id(node.object)] = len(objects)
            objects.append(node.object)
        pieces.append(
            {
                "name": node.name,
                "link": link,
                "placement": pin.SE3ToXYZQUAT(placement).tolist(),
                "box": [*node.corners.min(axis=0).tolist(), *node.corners.max(axis=0).tolist()],
                "object": numbers[id(node.object)],
            }
        )
    return {"objects": objects, "pieces": pieces, "tips": _tips(model), "direction": _front(model)}


def joint_frames(model: Any) -> list[Json]:
    """The links' frames, each with its name, the joint that moves it, and its placement behind that joint."""
    return [
        {
            "name": frame.name,
            "link": _body(model, frame.parentJoint),
            "placement": pin.SE3ToXYZQUAT(frame.placement).tolist(),
        }
        for frame in model.frames
        if frame.type == pin.FrameType.BODY and frame.parentJoint > 0
    ]


def motion_data(model: Any, t: Floats, q: Floats) -> Json:
    """A motion with the poses of all joints, (n, joints, 7), and the centre of mass (n, 3)."""
    placed, centre = _joint_poses(model, q)
    return {
        "t": packed(t, "Float64Array"),
        "links": list(model.names)[1:],
        "poses": packed(placed),
        "centre_of_mass": packed(centre) if sum(inertia.mass for inertia in model.inertias) else None,
        "direction": plane_direction(placed),
    }


def sample_before(t: Floats, shown: Floats) -> NDArray[np.intp]:
    """The number of the last sample (at times t) before each time shown."""
    return np.clip(np.searchsorted(t, shown, side="right") - 1, 0, len(t) - 1)


def contact_data(t: Floats, contacts: Contacts, shown: Floats) -> list[Json]:
    """The contacts (at times t) of each pair, at the times shown: of the last sample before them."""
    rows = sample_before(t, shown)
    return [
        {"pair": pair, "points": packed(points[rows, k]), "forces": packed(forces[rows, k])}
        for pair, (points, forces) in contacts.items()
        for k in range(points.shape[1])
    ]


def _joint_poses(model: Any, q: Floats) -> tuple[Floats, Floats]:
    """The poses (n, joints, 7) of all joints at configurations (n, nq), and the centre of mass (n, 3), m."""
    data, count = model.createData(), model.njoints - 1
    placed, centre = np.empty((len(q), count, 7)), np.empty((len(q), 3))
    for i, configuration in enumerate(q):
        centre[i] = pin.centerOfMass(model, data, configuration)  # with the joints' placements
        for k in range(count):
            placed[i, k] = pin.SE3ToXYZQUAT(data.oMi[k + 1])
    return placed, centre


def _front(model: Any) -> list[float] | None:
    """The direction to the camera from a robot whose links all move in one plane; None for others."""
    if not model.nv:
        return None
    start, rng = pin.neutral(model), np.random.default_rng(0)
    q = np.array([pin.integrate(model, start, rng.uniform(-1.0, 1.0, model.nv)) for _ in range(_SAMPLES)])
    return plane_direction(_joint_poses(model, q)[0])


def _tips(model: Any) -> list[str]:
    """The links without a child; a link's frame is the parent of the joints and fixed joints behind it."""
    bodies = {k: f.name for k, f in enumerate(model.frames) if f.type == pin.FrameType.BODY and f.parentJoint > 0}
    parents = set()
    for frame in model.frames:
        if frame.type in (pin.FrameType.JOINT, pin.FrameType.FIXED_JOINT):
            parents.add(frame.parentFrame)
    return [name for k, name in bodies.items() if k not in parents]


def _body(model: Any, joint: int) -> str | None:
    """The name of a joint, which stands for all links that it moves; None for the world."""
    return model.names[joint] if joint else None

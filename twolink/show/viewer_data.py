"""A motion as data: its samples, checked and interpolated, and what the viewer (`viewer/*.js`) draws, as JSON.

Typed arrays are {"$array": JavaScript's class, "base64": bytes, little-endian}; with "below_new" each number is how far
it is below the next one that no number before it has reached.
"""

import itertools
import math
from collections.abc import Callable, Container, Mapping, Sequence
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from twolink.errors import ShowError
from twolink.show.meshcat_scene import Node, plane_direction
from twolink.show.meshcat_shapes import Floats, Json, packed


def check_motion(model: Any, t: ArrayLike, q: ArrayLike, speed: float) -> tuple[Floats, Floats]:
    """Check the samples of a motion.

    Parameters
    ----------
    model : pin.Model
        The robot.
    t : array_like (n,)
        Times in s, increasing.
    q : array_like (n, nq)
        Configurations.
    speed : float
        Simulated seconds per second of playing, above 0.

    Returns
    -------
    t : array (n,)
    q : array (n, nq)

    Raises
    ------
    ShowError
        When shapes do not match, a number is not finite, or t does not increase.
    """
    times, configurations = np.atleast_1d(np.asarray(t, float)), np.atleast_2d(np.asarray(q, float))
    if configurations.shape != (*times.shape, model.nq) or not len(times):
        expected = f"(n,) and (n, {model.nq}), n >= 1"
        what = f"t is {times.shape} and q is {configurations.shape}, expected {expected}"
        raise ShowError(what, where="playback", remedy="give one configuration for each time", argument="q")
    for name, values in (("t", times), ("q", configurations)):
        if not np.all(np.isfinite(values)):
            row = int(np.argwhere(~np.isfinite(values))[0][0])
            remedy = "show the part before it" if row else "nothing before it can be shown"
            raise ShowError(f"{name} is not finite at sample {row}", where="playback", remedy=remedy, argument=name)
    if np.any(np.diff(times) <= 0.0):
        row = int(np.argmax(np.diff(times) <= 0.0)) + 1
        what = f"t does not increase at sample {row} ({times[row - 1]:g} s, then {times[row]:g} s)"
        raise ShowError(what, where="playback", remedy="sort the samples and drop repeated times", argument="t")
    if not (isinstance(speed, float | int | np.number) and 0.0 < speed < math.inf):
        what = f"speed is {speed!r:.60}, expected a number above 0"
        raise ShowError(what, where="playback", remedy="1 is true speed", argument="speed")
    return times, configurations


def time_digits(shown: Floats) -> int:
    """Digits after the point that tell apart the times shown (n,), s; at least 2."""
    span = float(np.ptp(shown))
    return max(2, math.ceil(2.0 - math.log10(span))) if span else 2


def usual_speed(seconds: float) -> float:
    """The speed at which to play a motion of so many seconds: 1, and for one below 1 s less, so that it takes 2 to 5 s.

    That is 1, 2 or 5 times a power of ten.
    """
    if not 0.0 < seconds < 1.0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(seconds / 2.0))
    return max(factor * power for factor in (1.0, 2.0, 5.0) if factor * power <= seconds / 2.0)


def resample(
    model: Any, t: Floats, q: Floats, at: Floats, v: Floats | None = None, jumps: Sequence[float] = ()
) -> Floats:  # fmt: skip
    """Interpolate configurations on the manifold.

    Parameters
    ----------
    model : pin.Model
        The robot.
    t, q : array (n,), (n, nq)
        The samples; t in s, increasing.
    at : array (m,)
        Times in s. Before the first sample and after the last one the motion stands still.
    v : array (n, nv), optional
        The velocities there: then by cubics (de Casteljau's construction), else along straight lines.
    jumps : sequence of float
        Times in s at which the velocity jumps: straight lines across them.

    Returns
    -------
    array (m, nq)
    """
    left = np.clip(np.searchsorted(t, at, side="right") - 1, 0, max(len(t) - 2, 0))
    if len(t) == 1:
        return np.repeat(q, len(at), axis=0)
    steps, straight = np.diff(t), set(np.searchsorted(t, jumps) - 1)
    share = np.clip((at - t[left]) / steps[left], 0.0, 1.0)
    # Quaternions from a file with few digits are not quite of unit length, so normalise what is interpolated.
    unit = {i: pin.normalize(model, q[i]) for i in {*left.tolist(), *(left + 1).tolist()}}

    def between(i: int, s: float) -> Floats:
        points = [unit[i], unit[i + 1]]
        if v is not None and i not in straight:
            points[1:1] = [
                pin.integrate(model, unit[k], sign * steps[i] / 3.0 * v[k]) for k, sign in ((i, 1), (i + 1, -1))
            ]
        while len(points) > 1:
            points = [pin.interpolate(model, a, b, s) for a, b in itertools.pairwise(points)]
        return np.asarray(points[0])

    return np.array([between(i, s) for i, s in zip(left.tolist(), share, strict=True)])


_SAMPLES = 12  # configurations that tell whether a robot moves in a plane
Place = tuple[str | None, Any]  # the link that a piece is fixed to, or None for the world, and its pin.SE3 there
# A pair's contacts (n, k, 3): points m and forces N, NaN where it is apart.
Contacts = Mapping[str, tuple[Floats, Floats]]


def place_on_link(model: pin.Model, links: Container[int], item: Any) -> Place:
    """The link a piece is fixed to, and its place there: Pinocchio places it relative to the joint.

    links: indices of the links' frames.
    """
    frame = int(item.parentFrame)
    if frame not in links or model.frames[frame].parentJoint != item.parentJoint:
        own = (i for i, f in enumerate(model.frames) if i in links and f.parentJoint == item.parentJoint)
        frame = next(own, -1)
        if frame < 0:
            return None, item.placement
    return model.frames[frame].name, model.frames[frame].placement.inverse() * item.placement


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
        pieces.append({
            "name": node.name, "link": link, "placement": pin.SE3ToXYZQUAT(placement).tolist(),
            "box": [*node.corners.min(axis=0).tolist(), *node.corners.max(axis=0).tolist()],
            "object": numbers[id(node.object)],
        })  # fmt: skip
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

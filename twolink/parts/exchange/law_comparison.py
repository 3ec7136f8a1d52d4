"""Differences, by joints, of the springs, loops and constant forces that two robots' files state besides a URDF."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pinocchio as pin

from twolink.dynamics import Robot
from twolink.robots.model import COMPENSATION

Law = tuple[str, tuple[str, ...]]


def law_differences(a: Robot, b: Robot, tolerance: float) -> Iterator[tuple[str, str, Any, Any, str]]:
    """Differences: name, place, the numbers of both, and the cause of each; couplings are not looked at."""
    ours, theirs = _laws(a), _laws(b)
    for law in {**ours, **theirs}:
        x, y = ours.get(law), theirs.get(law)
        if x is None or y is None or x.shape != y.shape or not np.allclose(x, y, rtol=tolerance, atol=tolerance):
            cause = "left out in b" if y is None else "not in a" if x is None else "other numbers"
            yield law[0], " and ".join(f"joint {joint!r}" for joint in law[1]), x, y, cause


def _laws(robot: Robot) -> dict[Law, np.ndarray]:
    """The numbers of each, by kind and joints; points and directions in the frames of the joints that carry them."""
    found: dict[Law, np.ndarray] = {}
    key: Law
    for kind, given in robot.visuals.laws.effects:
        if kind == "joint-spring":
            found |= {(kind, (joint,)): np.array([k, given["rest"].get(joint, 0.0)])
                      for joint, k in given["stiffness"].items()}  # fmt: skip
        elif kind == COMPENSATION:
            joint, _, point = _placed(robot, given["frame"], given["point"])
            key = (kind, (joint,))
            found[key] = found.get(key, 0.0) + given["mass"] * np.append(point, 1.0)
        elif kind != "coupling":
            key, numbers = _loop(robot, kind, given)
            found[key] = np.append(found.get(key, ()), numbers)  # two bodies may have several
    return found


def _loop(robot: Robot, kind: str, given: Mapping[str, Any]) -> tuple[Law, np.ndarray]:
    """A loop: two points, and the orientation of the joints' frames to one another."""
    first, a, at = _placed(robot, given["a"], given["point_a"])
    second, b, there = _placed(robot, given["b"], given["point_b"])
    turned = b.rotation @ pin.rpy.rpyToMatrix(*given["rpy"]) @ a.rotation.T if "rpy" in given else np.empty(0)
    return (kind, (first, second)), np.concatenate([at, there, np.ravel(turned)])


def _placed(robot: Robot, link: str, point: tuple[float, ...]) -> tuple[str, pin.SE3, np.ndarray]:
    """The joint that carries a link, the link's frame there, and a point of the link there."""
    model = robot.model
    frame = model.frames[model.getFrameId(link, pin.FrameType.BODY)]
    return model.names[frame.parentJoint], frame.placement, frame.placement.act(np.array(point))

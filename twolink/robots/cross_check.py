"""A second reading of the same URDF by yourdfpy, held against Pinocchio's.

What yourdfpy reads is the URDF as our own XML reader wrote it out for drawing: joints, inertias and visuals as in the
file, before any joint is locked. From there on the two share no code: yourdfpy's own parser and forward kinematics
against Pinocchio's parser and model. What our XML reader itself would misread, this cannot show.
"""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pinocchio as pin

from twolink.robots.model import RobotModel

TOLERANCE = 1e-9


def compare(robot: RobotModel, configurations: int = 5) -> dict[str, Any]:
    """The largest difference of any link's frame (m, or entries of the rotation), and of the mass, kg; and a verdict.

    They agree when frames at random configurations differ by at most 1e-9, and the mass by at most 1e-9 of itself.
    """
    import yourdfpy  # 1.7 s: only where it is asked for

    visuals = robot.visuals
    text = io.BytesIO(visuals.text.encode())
    second = yourdfpy.URDF.load(text, build_scene_graph=True, load_meshes=False, force_mesh=False)
    model, rng = visuals.model, np.random.default_rng(7)
    data = model.createData()
    simple = [n for n in second.actuated_joint_names if model.existJointName(n)]
    worst = 0.0
    for _ in range(configurations):
        q, angles = pin.neutral(model), {}
        for name in simple:
            index = model.getJointId(name)
            angles[name] = rng.uniform(-1, 1)
            start = model.idx_qs[index]
            pair = [np.cos(angles[name]), np.sin(angles[name])]
            q[start : start + model.nqs[index]] = pair if model.nqs[index] == 2 else angles[name]
        _follow_mimics(second, model, q, angles)
        second.update_cfg(angles)
        pin.framesForwardKinematics(model, data, q)
        for frame, placement in zip(model.frames, data.oMf, strict=True):
            if frame.type == pin.FrameType.BODY and frame.name in second.link_map:
                other = second.get_transform(frame.name)
                worst = max(worst, float(np.abs(placement.homogeneous - other).max()))
    masses = [k.inertial.mass or 0.0 for k in second.robot.links if k.inertial is not None]
    ours = sum(inertia.mass for inertia in model.inertias)
    difference = abs(ours - sum(masses))
    agree = worst <= TOLERANCE and difference <= TOLERANCE * abs(ours)
    links = len(second.robot.links)
    return {
        "agree": agree,
        "frames": worst,
        "mass": difference,
        "links": links,
        "text": f"{'agree' if agree else 'DIFFER'}: {links} links; frames to {worst:.1e}, mass to {difference:.1e} kg",
    }


def _follow_mimics(second: Any, model: pin.Model, q: np.ndarray, angles: dict[str, float]) -> None:
    """yourdfpy couples mimic joints, to 0 where they mimic one that does not move; give Pinocchio's the same values."""
    for joint in second.robot.joints:
        if joint.mimic is not None and model.existJointName(joint.name):
            value = joint.mimic.multiplier * angles.get(joint.mimic.joint, 0.0) + joint.mimic.offset
            index = model.getJointId(joint.name)
            if model.nqs[index] == 1:
                q[model.idx_qs[index]] = value

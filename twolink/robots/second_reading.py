"""A second, independent reading of the same URDF by yourdfpy, held against Pinocchio's.

It shares no code with Pinocchio's parser: frames at random configurations and the total mass must agree.
"""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pinocchio as pin

from twolink.robots.model import RobotModel


def compare(robot: RobotModel, configurations: int = 5) -> dict[str, Any]:
    """The largest difference of any link's frame (m, or entries of the rotation), and of the mass, kg."""
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
    text_out = f"{len(second.robot.links)} links; frames agree to {worst:.1e}, mass to {difference:.1e} kg"
    return {"frames": worst, "mass": difference, "links": len(second.robot.links), "text": text_out}


def _follow_mimics(second: Any, model: pin.Model, q: np.ndarray, angles: dict[str, float]) -> None:
    """yourdfpy couples mimic joints; give Pinocchio's independent ones the same values."""
    for joint in second.robot.joints:
        if joint.mimic is not None and model.existJointName(joint.name) and joint.mimic.joint in angles:
            value = joint.mimic.multiplier * angles[joint.mimic.joint] + joint.mimic.offset
            index = model.getJointId(joint.name)
            if model.nqs[index] == 1:
                q[model.idx_qs[index]] = value

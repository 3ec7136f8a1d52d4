"""The same URDF read by yourdfpy, compared with what Pinocchio read.

yourdfpy reads the URDF that our XML reader wrote for drawing: joints and inertias of the file, with its
numbers in their shortest exact form, before any joint is locked. From there on the two share no code: yourdfpy's parser
and forward kinematics against Pinocchio's parser and model. What our XML reader itself would misread, this comparison
cannot show.
"""

import io
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from twolink.robots.joint_layout import joint_layouts
from twolink.robots.model import RobotModel

TOLERANCE = 1e-9


def compare(robot: RobotModel, configurations: int = 5) -> dict[str, Any]:
    """Compare link frames at random configurations, and the mass, with yourdfpy's.

    Parameters
    ----------
    robot : RobotModel
        The robot.
    configurations : int
        How many random configurations.

    Returns
    -------
    dict
        frames: the largest difference of an entry of any link's frame (m, or entries of the rotation); mass: the
        difference [kg]; links: their number; agree: frames to 1e-9 and mass to 1e-9 of itself; text: all that in words.
    """
    import yourdfpy  # 1.7 s: only where it is asked for

    root = ElementTree.fromstring(robot.visuals.text)
    for link in root.iter("link"):  # yourdfpy refuses capsules
        for shape in link.findall("visual") + link.findall("collision"):
            link.remove(shape)
    urdf = io.BytesIO(ElementTree.tostring(root))
    second = yourdfpy.URDF.load(urdf, build_scene_graph=True, load_meshes=False, force_mesh=False)
    model, rng = robot.visuals.model, np.random.default_rng(7)
    data, layouts = model.createData(), {joint.name: joint for joint in joint_layouts(model)}
    largest = 0.0
    for _ in range(configurations):
        q = pin.neutral(model)
        angles = {name: rng.uniform(-1, 1) for name in second.actuated_joint_names if name in layouts}
        # yourdfpy couples mimic joints, to 0 where they mimic one that does not move.
        coupled = {j.name: j.mimic for j in second.robot.joints if j.mimic is not None and j.name in layouts}
        values = {name: m.multiplier * angles.get(m.joint, 0.0) + m.offset for name, m in coupled.items()}
        for name, angle in (angles | values).items():
            q[layouts[name].q] = layouts[name].configuration(angle)
        second.update_cfg(angles)
        pin.framesForwardKinematics(model, data, q)
        for frame, placement in zip(model.frames, data.oMf, strict=True):
            if frame.type == pin.FrameType.BODY and frame.name in second.link_map:
                difference = placement.homogeneous - second.get_transform(frame.name)
                largest = max(largest, float(np.abs(difference).max()))
    masses = [k.inertial.mass or 0.0 for k in second.robot.links if k.inertial is not None]
    mass = sum(inertia.mass for inertia in model.inertias)
    lacking, links = abs(mass - sum(masses)), len(second.robot.links)
    agree = largest <= TOLERANCE and lacking <= TOLERANCE * abs(mass)
    verdict = "agree" if agree else "DIFFER"
    text = f"{verdict}: {links} links; frames to {largest:.1e}, mass to {lacking:.1e} kg"
    return {"agree": agree, "frames": largest, "mass": lacking, "links": links, "text": text}

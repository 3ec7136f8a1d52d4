"""The model that Pinocchio built, compared with the checked values of the URDF."""

import math

import numpy as np
import pinocchio as pin

from twolink.errors import RobotError
from twolink.robots.tree import Tree

TOLERANCE = 1e-9


def check_agreement(model: pin.Model, tree: Tree, label: str, root: str) -> None:
    """Compare the joints, the mass and the limits of Pinocchio's model with those of the tree.

    This catches anything that Pinocchio's parser drops or misreads without a message, such as numbers under a locale
    with a decimal comma. Raises RobotError.
    """
    remedy = "report it to us, with the locale in force"
    reserved = ("universe", "root_joint") if root == "free" else ("universe",)
    different = {name for name in model.names if name not in reserved} ^ {j.name for j in tree.moving}
    if different:
        what = f"Pinocchio's joints differ from the file's: {', '.join(sorted(different)[:5])}"
        raise RobotError(what, where=label, remedy="report it to us")
    mass = sum(inertia.mass for inertia in model.inertias)
    written = sum(link.mass for link in tree.links.values())
    if not math.isfinite(written):
        raise RobotError("the masses add up to more than a double holds", where=label, remedy="correct them")
    if not abs(mass - written) <= TOLERANCE * written:
        raise RobotError(f"Pinocchio read {mass} kg, the file says {written} kg", where=label, remedy=remedy)
    for joint in tree.moving:
        index = model.getJointId(joint.name)
        start = model.idx_qs[index]
        if joint.limits is not None and model.nqs[index] == 1:
            read = (model.lowerPositionLimit[start], model.upperPositionLimit[start])
            if not np.allclose(read, joint.limits, rtol=TOLERANCE, atol=TOLERANCE):
                what = f"Pinocchio read the limits {read}, the file says {joint.limits}"
                raise RobotError(what, where=joint.where, remedy=remedy)

"""The model that Pinocchio built, compared with the checked values of the URDF."""

from __future__ import annotations

import math

import pinocchio as pin

from twolink.errors import RobotError
from twolink.robots.tree import Tree


def check_agreement(model: pin.Model, tree: Tree, label: str, root: str) -> None:
    """Compare the joints, the mass and the limits of Pinocchio's model with those of the tree.

    This catches anything that Pinocchio's parser drops or misreads without a message, such as numbers under a locale
    with a decimal comma. Raises RobotError.
    """
    reserved = ("universe", "root_joint") if root == "free" else ("universe",)
    built = {name for name in model.names if name not in reserved}
    expected = {j.name for j in tree.moving}
    if built != expected:
        odd = ", ".join(sorted(built ^ expected)[:5])
        raise RobotError(f"Pinocchio's joints differ from the file's: {odd}", where=label, remedy="report it to us")
    remedy = "report it to us, with the locale in force"
    mass = sum(inertia.mass for inertia in model.inertias)
    written = sum(link.mass for link in tree.links.values())
    if not math.isfinite(written):
        raise RobotError("the masses add up to more than a double holds", where=label, remedy="correct them")
    if not abs(mass - written) <= 1e-9 * written:
        raise RobotError(f"Pinocchio read {mass} kg, the file says {written} kg", where=label, remedy=remedy)
    for joint in tree.moving:
        index = model.getJointId(joint.name)
        if joint.limits is None or model.nqs[index] != 1:
            continue
        start = model.idx_qs[index]
        read = (model.lowerPositionLimit[start], model.upperPositionLimit[start])
        if any(abs(r - w) > 1e-9 * max(1, abs(w)) for r, w in zip(read, joint.limits, strict=True)):
            what = f"Pinocchio read the limits {read}, the file says {joint.limits}"
            raise RobotError(what, where=joint.where, remedy=remedy)

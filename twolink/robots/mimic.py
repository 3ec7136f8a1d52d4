"""Which joints can follow which: Pinocchio drops, or refuses in words of its own, what it cannot couple."""

from collections.abc import Mapping

import pinocchio as pin

from twolink.errors import RobotError, nearest
from twolink.robots.tree import Tree
from twolink.robots.urdf import Mimic, UrdfJoint

_APART = "or load it with mimic=False"


def check_mimic(tree: Tree, uncoupled: pin.Model) -> None:
    """Require that every mimic joint can follow its joint.

    Parameters
    ----------
    tree : Tree
        The robot.
    uncoupled : pin.Model
        Its model, in which mimic joints move on their own.

    Raises
    ------
    RobotError
        Code "mimic-joints": the joint that is followed does not exist, does not move, follows another one itself, comes
        after its follower, or has coordinates of another kind.
    """
    joints = {joint.name: joint for joint in tree.joints}
    for joint in tree.moving:
        if joint.mimic is None:
            continue
        what, remedy = _fault(joint, joint.mimic, joints)
        names = list(uncoupled.names)
        if not what and names.index(joint.mimic.joint) > names.index(joint.name):
            what = f"it mimics {joint.mimic.joint!r}, which comes after it in Pinocchio's order"
            remedy = f"let {joint.mimic.joint!r} mimic {joint.name!r} by the inverse relation, {_APART}"
        if what:
            raise RobotError(what, where=joint.where, remedy=remedy, code="mimic-joints")


def _fault(joint: UrdfJoint, mimic: Mimic, joints: Mapping[str, UrdfJoint]) -> tuple[str, str]:
    """Why a joint cannot follow the one it names, and the remedy; two empty texts where it can."""
    target = joints.get(mimic.joint)
    if target is None or target is joint:
        others = [name for name in joints if name != joint.name]
        return f"it mimics {mimic.joint!r}, which is not another joint", nearest(mimic.joint, others)
    if target.type == "fixed":
        return f"it mimics {target.name!r}, which is fixed", f"give it the type fixed, {_APART}"
    if target.mimic is not None:
        return _chain(joint, mimic, joints)
    kinds = {joint.type, target.type}
    what = f"a {joint.type} joint cannot mimic the {target.type} joint {target.name!r}"
    if not kinds <= {"revolute", "continuous", "prismatic"}:
        return what, f"couple joints of one coordinate, {_APART}"
    if "continuous" in kinds and len(kinds) > 1:  # an angle, and its cosine and sine
        return what, f"make both continuous, or give both limits, {_APART}"
    return "", ""


def _chain(joint: UrdfJoint, mimic: Mimic, joints: Mapping[str, UrdfJoint]) -> tuple[str, str]:
    """The fault of a joint that follows a follower; the remedy is the relation to the joint that leads both."""
    seen = {joint.name}
    while mimic.joint not in seen and (target := joints.get(mimic.joint)) is not None and target.mimic is not None:
        seen.add(target.name)
        first = target.mimic
        mimic = Mimic(first.joint, mimic.multiplier * first.multiplier, mimic.multiplier * first.offset + mimic.offset)
    if mimic.joint in seen:
        return f"joints mimic one another in a circle: {', '.join(map(repr, sorted(seen)))}", "let one of them lead"
    relation = f'<mimic joint="{mimic.joint}" multiplier="{mimic.multiplier!r}" offset="{mimic.offset!r}"/>'
    return f"it mimics a joint that mimics {mimic.joint!r} itself", f"write {relation}, {_APART}"


def check_lock(tree: Tree, lock: Mapping[str, object]) -> None:
    """Require that no coupled joint is locked. Raises RobotError (code "mimic-joints")."""
    for joint in tree.moving:
        if joint.mimic is not None and not {joint.name, joint.mimic.joint}.isdisjoint(lock):
            what = f"it mimics {joint.mimic.joint!r}, and one of them is locked"
            remedy = "load it with mimic=False and lock both"
            raise RobotError(what, where=joint.where, argument="lock", remedy=remedy, code="mimic-joints")

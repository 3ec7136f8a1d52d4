"""Checks of a loaded robot: inertias of real bodies, a mass matrix that can be inverted, mimic joints, and what
Pinocchio and yourdfpy read in the same URDF.

yourdfpy reads the URDF that our XML reader wrote for drawing: joints and inertias of the file, with its
numbers in their shortest exact form, before any joint is locked. From there on the two share no code: yourdfpy's parser
and forward kinematics against Pinocchio's parser and model. What our XML reader itself would misread, this comparison
cannot show.
"""

import io
import math
from collections.abc import Mapping
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from twolink.errors import RobotError, nearest
from twolink.io.fingerprints import trees_of
from twolink.robots.joint_layout import joint_layouts
from twolink.robots.model import ROOT, RobotModel
from twolink.robots.tree import Tree
from twolink.robots.urdf import Mimic, UrdfJoint, UrdfLink

# Relative to the largest principal moment; URDFs carry six or so digits.
_ROUNDING = 1e-6
# Below m * (1 micrometre)^2 a moment of inertia is rounding noise of the file.
_NOISE_LENGTH_SQUARED = 1e-12
TOLERANCE = 1e-9
_APART = "or load it with mimic=False"


def _defects(inertia: np.ndarray, mass: float) -> tuple[float, float, float]:
    """Defects of the principal moments I1 <= I2 <= I3 against those of a real body, (0, 0, 0) within rounding.

    First -I1 [kg m^2] where it is below zero; then (I3 - I1 - I2) / max(I3, -I1) where that is above zero. Every
    distribution of positive mass obeys the triangle inequality: I1 + I2 - I3 = 2 * integral of z^2 dm. Last I3
    [kg m^2] where there is no mass.
    """
    i1, i2, i3 = np.linalg.eigvalsh(inertia).tolist()
    rounding, excess = _ROUNDING * i3 + _NOISE_LENGTH_SQUARED * mass, i3 - i1 - i2
    unequal = excess / max(i3, -i1) if excess > rounding else 0.0
    return -i1 if -i1 > rounding else 0.0, unequal, i3 if mass <= 0 < i3 else 0.0


def check_bodies(tree: Tree, model: pin.Model, unphysical: str) -> list[str]:
    """Refuse a body whose inertia no real body has. Returns the links whose own inertia no real body has.

    A body is a link with all links fixed to it: only their sum enters the equations of motion. Files often give
    sensors and covers impossible inertias; judged alone they would refuse half of the published robots.
    """
    if not all(np.isfinite(inertia.inertia).all() for inertia in model.inertias):
        raise RobotError("inertia is not finite: numbers are too large", where=tree.name, remedy="check the units")
    if unphysical == "refuse" and (impossible := impossible_bodies(tree, model)):
        raise impossible_inertia(impossible[0])
    return [link.name for link in tree.links.values() if is_impossible(link.inertia, link.mass)]


def impossible_bodies(tree: Tree, model: pin.Model) -> list[UrdfLink]:
    """The worst link of each body whose inertia no real body has."""
    return [_culprit(tree, model, joint) for joint, inertia in enumerate(model.inertias)
            if is_impossible(inertia.inertia, inertia.mass)]  # fmt: skip


def is_impossible(inertia: np.ndarray, mass: float) -> bool:
    """True if no body has this inertia (3, 3) [kg m^2] about its centre of mass."""
    return any(_defects(inertia, mass))


def impossible_inertia(link: UrdfLink) -> RobotError:
    """The error for the link whose inertia makes a body impossible."""
    moments = ", ".join(f"{m:.6g}" for m in np.linalg.eigvalsh(link.inertia))
    tail = 'correct it, or load it as it is with unphysical="report"'
    negative, unequal, _ = _defects(link.inertia, link.mass)
    if negative:
        what = f"inertia is not positive semi-definite: principal moments ({moments}) kg m^2"
        remedy = f"give the inertia about the centre of mass of a real body; {tail}"
    elif unequal:
        what = f"inertia breaks the triangle inequality: no body has the principal moments ({moments}) kg m^2"
        remedy = f"the two smaller ones must add up to the largest at least; {tail}"
    else:
        what = f"inertia without mass: no body of {link.mass:g} kg has the principal moments ({moments}) kg m^2"
        remedy = f"give its mass, or moments of 0; {tail}"
    return RobotError(what, where=link.where, remedy=remedy, code="impossible-inertia")


def _culprit(tree: Tree, model: pin.Model, joint: int) -> UrdfLink:
    """The link to blame for a body: the part that is worst."""
    parts = [f.name for f in model.frames if f.parentJoint == joint and f.type == pin.FrameType.BODY]
    links = [tree.links[name] for name in parts if name in tree.links]
    return max(links, key=lambda k: _defects(k.inertia, k.mass))


def weightless_joints(model: pin.Model) -> tuple[str, ...]:
    """The joints that move no inertia, whatever the configuration.

    The pivots of L^T D L, taken from the last joint to the first, are what the articulated-body algorithm divides
    by: D_i = S_i^T I^A_i S_i (Featherstone 2008, eq. 7.44). A pivot that is zero next to M_ii in every one of
    several configurations belongs to a massless leaf, or to links without inertia about the joint's axis.
    """
    smallest = np.concatenate([_smallest_pivots(tree.model) for tree in trees_of(model)])
    bad = np.flatnonzero(smallest <= 1e-15 * model.nv)
    owners = [j for j in range(1, model.njoints) for i in bad if model.idx_vs[j] <= i < model.idx_vs[j] + model.nvs[j]]
    return tuple(dict.fromkeys(model.names[j] for j in owners))


def without_inertia(tree: Tree, model: pin.Model, names: tuple[str, ...]) -> RobotError:
    """The error for a robot with weightless joints."""
    name = names[-1]
    moved = next((j for j in tree.joints if j.name == name), None)
    link = tree.root if moved is None else moved.child
    massless = model.inertias[model.getJointId(name)].mass == 0
    why = "the link it moves has no mass" if massless else "what it moves has no inertia about its axis"
    what = f"joint {name!r} cannot be accelerated: {why}, so its acceleration is not determined"
    lock = {joint.name: 0 if joint.v.stop - joint.v.start == 1 else pin.neutral(model)[joint.q].astype(int).tolist()
            for joint in joint_layouts(model) if joint.name in names}  # fmt: skip
    held = 'load it with root="fixed"' if ROOT in names else f"hold such joints with lock={lock}"
    remedy = f"give link {link!r} a mass and an inertia, or {held}"
    what += ' (purpose="kinematics" or purpose="identification" takes that)'
    return RobotError(what, where=tree.links[link].where, remedy=remedy, code="no-inertia")


def _smallest_pivots(model: pin.Model) -> np.ndarray:
    """The relative pivots (nv,), each where it is largest of several configurations."""
    weightless, smallest = model.copy(), np.zeros(model.nv)
    weightless.gravity.linear = np.zeros(3)
    data = model.createData()
    mass_matrix = mass_matrix_by_columns if any("Mimic" in joint.shortname() for joint in model.joints) else pin.crba
    for q in _configurations(model):
        smallest = np.maximum(smallest, _relative_pivots(mass_matrix(weightless, data, q)))
    return smallest


def mass_matrix_by_columns(model: pin.Model, data: pin.Data, q: np.ndarray) -> np.ndarray:
    """M(q) (nv, nv) by the Newton-Euler algorithm: M e_k = tau(q, 0, e_k) - tau(q, 0, 0) for each unit vector e_k.

    For mimic joints: Pinocchio 4.1's composite-rigid-body algorithm drops the couplings of branches that follow
    different joints of one degree of freedom.
    """
    zero = np.zeros(model.nv)
    weight = pin.rnea(model, data, q, zero, zero)
    columns = [pin.rnea(model, data, q, zero, unit) - weight for unit in np.eye(model.nv)]
    matrix = np.reshape(columns, (model.nv, model.nv))
    return np.asarray((matrix + matrix.T) / 2)


def _configurations(model: pin.Model) -> list[np.ndarray]:
    """The neutral configuration and three fixed, generic ones (tangent steps from it: limits do not matter)."""
    rng = np.random.default_rng(20)
    neutral = pin.neutral(model)
    return [neutral, *(pin.integrate(model, neutral, rng.uniform(-1, 1, model.nv)) for _ in range(3))]


def _relative_pivots(matrix: np.ndarray) -> np.ndarray:
    """D_i / M_ii of M = L^T D L, 0 where there is nothing to divide by."""
    work = matrix.copy()
    diagonal = np.diag(matrix)
    pivots = np.zeros(len(work))
    for i in range(len(work) - 1, -1, -1):
        if not (diagonal[i] > 0 and work[i, i] > 1e-300):
            continue
        pivots[i] = work[i, i] / diagonal[i]
        row = work[i, :i].copy()
        work[:i, :i] -= np.outer(row, row / work[i, i])  # in this order large numbers do not overflow
    return pivots


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


def check_mimic(tree: Tree, uncoupled: pin.Model, lock: Mapping[str, object]) -> None:
    """Require that every mimic joint can follow its joint, and that none of both is locked.

    Parameters
    ----------
    tree : Tree
        The robot.
    uncoupled : pin.Model
        Its model, in which mimic joints move on their own.
    lock : mapping
        The joints that are locked.

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
        what, remedy = mimic_fault(joint, joint.mimic, joints)
        names = list(uncoupled.names)
        if not what and names.index(joint.mimic.joint) > names.index(joint.name):
            what = f"it mimics {joint.mimic.joint!r}, which comes after it in Pinocchio's order"
            remedy = f"let {joint.mimic.joint!r} mimic {joint.name!r} by the inverse relation, {_APART}"
        if what:
            raise RobotError(what, where=joint.where, remedy=remedy, code="mimic-joints")
        if not {joint.name, joint.mimic.joint}.isdisjoint(lock):
            what = f"it mimics {joint.mimic.joint!r}, and one of them is locked"
            remedy = "load it with mimic=False and lock both"
            raise RobotError(what, where=joint.where, argument="lock", remedy=remedy, code="mimic-joints")


def mimic_fault(joint: UrdfJoint, mimic: Mimic, joints: Mapping[str, UrdfJoint]) -> tuple[str, str]:
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
    for joint in root.iter("joint"):
        if joint.get("type") in ("floating", "spherical"):  # yourdfpy cannot move them: they stay at zero
            joint.set("type", "fixed")
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
            q[layouts[name].q] = layouts[name].entries("q", angle)
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

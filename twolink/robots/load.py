"""Loading a robot: source -> elements of a URDF -> tree -> pin.Model -> checks -> RobotModel and load report."""

import functools
import os
import threading
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Literal, TypeVar, get_args

import numpy as np
import pinocchio as pin

from twolink.errors import RobotError, require_known
from twolink.io.fingerprints import trees_of
from twolink.io.text import Table
from twolink.robots import load_report
from twolink.robots.catalogue import catalogue_entry, catalogue_names, examples_share, open_source
from twolink.robots.checks import check_agreement, check_bodies, check_mimic, weightless_joints, without_inertia
from twolink.robots.formats import describe
from twolink.robots.joint_layout import (
    NO_LIMIT,
    Lock,
    beyond_limits,
    gravity_field,
    lock_configuration,
    urdf_limits,
    without_joints,
)
from twolink.robots.load_report import LoadReport
from twolink.robots.meshes import MeshFolders, drawable_urdf, mesh_folders, missing_meshes
from twolink.robots.model import RobotModel, Visuals, mimic_joint, mimics
from twolink.robots.srdf import srdf_beside
from twolink.robots.suspicions import between_joints, suspicious
from twolink.robots.tree import Tree, canonical, read_tree

Purpose = Literal["dynamics", "kinematics", "identification"]
Policy = Literal["refuse", "report"]
Xacro = Literal["expand", "ignore"]
_WORDS = {"root": ("fixed", "free"), "unphysical": get_args(Policy), "foreign": get_args(Policy),
          "xacro": get_args(Xacro),
          "purpose": get_args(Purpose)}  # fmt: skip
R = TypeVar("R", bound=RobotModel)

# A pin.Data holds tensors of nv^3 numbers (second derivatives): 0.9 GB at nv = 300, 32 GB at nv = 1,000.
MAX_FREEDOM = 300
_OF_JOINTS = ("lowerEffortLimit", "upperEffortLimit", "lowerVelocityLimit", "upperVelocityLimit", "lowerPositionLimit",
              "upperPositionLimit", "positionLimitMargin", "lowerDryFrictionLimit", "upperDryFrictionLimit",
              "damping")  # as pin.Model.addJoint takes them  # fmt: skip
_STACK_BYTES = 64 * 2**20
_stack_size_lock = threading.Lock()
_NO_ROOM = "limits of joints that follow others, which leave those no room"
EARTH = (0.0, 0.0, -9.81)  # m/s^2
COLUMNS = ("name", "from", "root", "nq", "nv", "mass", "refused")


def load_model(
    kind: type[R],
    source: str | os.PathLike[str],
    *,
    package_dirs: Sequence[str | os.PathLike[str]] = (),
    root: Literal["fixed", "free"] = "fixed",
    lock: Lock | None = None,
    gravity: Sequence[float] | None = None,
    mimic: bool = False,
    unphysical: Policy = "refuse",
    foreign: Policy = "refuse",
    purpose: Purpose = "dynamics",
    xacro: Xacro = "expand",
    xacro_arguments: Mapping[str, object] | None = None,
    meshes: MeshFolders | None = None,
) -> R:
    """A robot of class `kind` from a name, a path, or the text of a URDF or MJCF.

    Parameters
    ----------
    kind : type
        RobotModel or a subclass with the same constructor.
    source, package_dirs, root, lock, gravity, mimic, unphysical, foreign, purpose, xacro, xacro_arguments
        As in `twolink.load_robot`.
    meshes : MeshFolders, optional
        Where meshes are looked for, in place of `package_dirs` and the folders of the URDF, which is a stranger's: no
        other files are opened.

    Returns
    -------
    kind
        The robot, with its load report.

    Raises
    ------
    RobotError
        The URDF is refused, or an argument is wrong; it names the file, line, link or joint, and what to do.
    """
    for name, word in zip(_WORDS, (root, unphysical, foreign, xacro, purpose), strict=True):
        require_known(word, _WORDS[name], RobotError, argument=name)
    urdf, packages = open_source(source), _folders(package_dirs)
    said = describe(urdf, foreign, root, xacro_arguments or {}, packages, trusted=meshes is None, xacro=xacro)
    tree = read_tree(said.robot, urdf.label, foreign, xacro)
    full, narrowed = _whole(tree, urdf.label, root, lock or {}, mimic)
    locked, reference = lock_configuration(full, lock or {})
    model = without_joints(full, locked, reference)
    model.gravity.linear = gravity_field(gravity if gravity is not None else said.gravity or EARTH, RobotError)
    odd_inertias = check_bodies(tree, full, unphysical)
    if (weightless := weightless_joints(model)) and purpose == "dynamics":
        raise without_inertia(tree, model, weightless)
    folders = meshes or mesh_folders(packages, urdf.path, examples_share())
    srdf = said.srdf if said.srdf.file else srdf_beside(urdf.path if meshes is None else None, tree.links)
    missing, beyond = missing_meshes(tree.element, folders), beyond_limits(full, locked, reference)
    report = LoadReport(urdf.label, (
        load_report.summary(tree, model, len(urdf.data)),
        *load_report.content_findings(tree, mimic=mimic, odd_inertias=odd_inertias, unphysical=unphysical,
                                      missing=missing,
                                      said=[*suspicious(tree, full), *between_joints(tree, full)]),
        *said.findings, *narrowed,
        *load_report.findings("read", {"pairs that do not touch, and states": [srdf.file] * bool(srdf.file)}),
        *load_report.findings("assumed", {"joints that move no inertia: dynamics is refused": weightless}),
        *load_report.choice_findings(tree, root=root, usual_root=urdf.entry.usual_root if urdf.entry else None,
                                     gravity=model.gravity.linear, locked=tuple(lock or ()), beyond=beyond),
    ))  # fmt: skip
    text, visual_meshes, collision_meshes = drawable_urdf(tree.element, folders)
    visuals = Visuals(text, visual_meshes, full, locked, reference, collision_meshes, said.laws, srdf=srdf)
    robot = kind(urdf.entry.name if urdf.entry else tree.name or urdf.label, model, report, visuals)
    robot.weightless = weightless
    return robot


def _whole(tree: Tree, label: str, root: str, lock: Lock, mimic: bool) -> tuple[pin.Model, list[load_report.Finding]]:
    """The model with all joints, and the limits that were narrowed. Raises RobotError."""
    apart = build(tree, label, root, mimic=False) if mimic else None
    if apart is not None:
        check_mimic(tree, apart, lock)
    full = _small(build(tree, label, root, mimic), label)
    check_agreement(full, tree, label, root)
    return full, [] if apart is None else _narrowed(full, tree, apart)


def _narrowed(model: pin.Model, tree: Tree, apart: pin.Model) -> list[load_report.Finding]:
    """Narrow the limits of joints that others follow: which ones, and followers that leave these no room.

    apart: the model in which followers move on their own.
    """
    narrowed, crowded, speed = list[str](), list[str](), model.velocityLimit
    for joint in tree.moving:
        if joint.mimic is None:
            continue
        leader = model.getJointId(joint.mimic.joint)
        entry, dof = model.idx_qs[leader], model.idx_vs[leader]
        if joint.mimic.multiplier:
            own = apart.velocityLimit[apart.idx_vs[apart.getJointId(joint.name)]]
            most = own / abs(joint.mimic.multiplier)
            if 0.0 < own < NO_LIMIT and not 0.0 < speed[dof] <= most:
                speed[dof] = most
                narrowed.append(joint.mimic.joint)
        if joint.limits is None:
            continue
        limits = urdf_limits(model, entry)
        ends = joint.mimic.within(limits, joint.limits)
        if ends is None:
            crowded.append(joint.name)
        elif ends != limits:
            narrowed.append(joint.mimic.joint)
            model.lowerPositionLimit[entry], model.upperPositionLimit[entry] = ends
    model.lowerVelocityLimit = -speed  # Pinocchio's parser has the old speed here, and locks no joint where it is above
    said = {"limits of joints that others follow, narrowed to those of these": list(dict.fromkeys(narrowed))}
    return load_report.findings("assumed", said) + load_report.findings("ignored", {_NO_ROOM: crowded})


def _small(model: pin.Model, label: str) -> pin.Model:
    """The model; refused where its largest part that only the ground connects would fill the memory."""
    largest = max(part.model.nv for part in trees_of(model))
    if largest > MAX_FREEDOM:
        what = f"{largest} degrees of freedom in joints that hang together, the limit is {MAX_FREEDOM}"
        remedy = "Pinocchio needs memory in proportion to their cube: load a smaller robot"
        raise RobotError(what, where=label, remedy=remedy, code="urdf")
    return model


def build(tree: Tree, label: str, root: str, mimic: bool) -> pin.Model:
    """Pinocchio's model, built on a thread whose stack holds the deepest tree that `read_tree` accepts."""
    names = {j.name for j in tree.joints}
    for reserved in ("universe", "root_joint") if root == "free" else ("universe",):
        if reserved in names:
            what = f"Pinocchio keeps the joint name {reserved!r} for itself"
            raise RobotError(what, where=label, remedy="rename the joint")
    if "universe" in tree.links and (tree.root != "universe" or root == "free"):
        what = "the ground is called 'universe', and this link is not the ground"
        raise RobotError(what, where=tree.links["universe"].where, remedy="rename the link")
    arguments = [canonical(tree), *([pin.JointModelFreeFlyer()] if root == "free" else []), mimic]
    with ThreadPoolExecutor(1, "twolink-load") as pool, _stack_size_lock:
        before = threading.stack_size(_STACK_BYTES)
        try:
            build = pool.submit(pin.buildModelFromXML, *arguments)  # starts the thread
        finally:
            threading.stack_size(before)
    try:
        return _completed(build.result(), tree)
    except Exception as error:  # Pinocchio raises errors of any type
        what = f"Pinocchio refuses it: {' '.join(str(error).split())}"
        remedy = "the messages of its parser are on stderr"
        raise RobotError(what, where=label, remedy=remedy, code="pinocchio") from None


def _completed(model: pin.Model, tree: Tree) -> pin.Model:
    """The model with what Pinocchio's parser leaves out: ball joints, armature, and damping of joints of many axes.

    The armature of a joint that follows another at k times its rate is k^2 times as large at that one.
    """
    balls = [joint.name for joint in tree.moving if joint.type == "spherical"]
    model = _with_balls(model, balls) if balls else model
    armature, damping, followers = np.zeros(model.nv), model.damping.copy(), set(model.mimicking_joints)
    for joint in tree.moving:
        index = model.getJointId(joint.name)
        if joint.mimic and index in followers:
            armature[model.idx_vs[index]] += joint.mimic.multiplier**2 * joint.armature
        else:
            dofs = slice(model.idx_vs[index], model.idx_vs[index] + model.nvs[index])
            armature[dofs] += joint.armature
            damping[dofs] = joint.damping
    model.armature, model.damping = armature, damping
    return model


def _with_balls(model: pin.Model, balls: Sequence[str]) -> pin.Model:
    """The model with ball joints in place of some free ones."""
    out = pin.Model()
    out.name = model.name
    followers = {one[0]: one[1:] for one in mimics(model)}
    for j in range(1, model.njoints):
        place = (model.jointPlacements[j], model.names[j])
        if model.names[j] in balls:
            out.addJoint(model.parents[j], pin.JointModelSpherical(), *place)
        else:
            q = slice(model.idx_qs[j], model.idx_qs[j] + model.nqs[j])
            v = slice(model.idx_vs[j], model.idx_vs[j] + model.nvs[j])
            numbers = [getattr(model, name)[q if "osition" in name else v] for name in _OF_JOINTS]
            joint = mimic_joint(out, *followers[j]) if j in followers else model.joints[j]
            out.addJoint(model.parents[j], joint, *place, *numbers)
    out.inertias[0] = model.inertias[0]
    for j in range(1, model.njoints):
        out.inertias[j] = model.inertias[j]
    for frame in model.frames.tolist()[1:]:
        out.addFrame(frame, False)
    return out


def _folders(package_dirs: Sequence[str | os.PathLike[str]]) -> list[Path]:
    try:
        if isinstance(package_dirs, (str, os.PathLike)):
            return [Path(package_dirs)]
        return [Path(d) for d in package_dirs]
    except TypeError:
        what = f"expected folders, got {package_dirs!r:.60}"
        raise RobotError(what, argument="package_dirs", remedy='such as ["/opt/ros/share"]') from None


@functools.cache
def robots() -> Table:
    """The robots that `load_robot` knows by name. Each is loaded once, some seconds in all.

    Returns
    -------
    Table
        Columns name, from (the package it comes from), root (the one it is meant to have), nq and nv with that root,
        mass [kg], and refused (why it cannot be loaded).
    """
    rows: list[tuple[object, ...]] = []
    for name in catalogue_names():
        entry = catalogue_entry(name)
        try:
            robot = load_model(RobotModel, name, root=entry.usual_root)
            rows.append((name, entry.origin, entry.usual_root, robot.nq, robot.nv, robot.mass, None))
        except RobotError as error:
            rows.append((name, entry.origin, entry.usual_root, None, None, None, str(error)))
    return Table(COLUMNS, tuple(rows))

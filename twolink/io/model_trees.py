"""The trees of a model: its parts that only the ground connects, each as a model of its own.

A pin.Data takes about nv^3 numbers. That of many bodies in one model fills any memory; those of the bodies do not.
"""

from typing import NamedTuple

import numpy as np
import pinocchio as pin


class Tree(NamedTuple):
    """A part of a model. q, v: its entries of the whole's. joints: the numbers of its joints there."""

    model: pin.Model
    q: slice
    v: slice
    joints: range


def trees_of(model: pin.Model) -> tuple[Tree, ...]:
    """The trees of a model, in the order of its joints; the model itself where it is one, or has mimic joints."""
    root = list(range(model.njoints))
    for j in range(1, model.njoints):
        root[j] = root[model.parents[j]] or j
    starts = sorted(set(root[1:]))
    if len(starts) < 2 or root != sorted(root) or len(model.mimicking_joints):
        return (Tree(model, slice(0, model.nq), slice(0, model.nv), range(1, model.njoints)),)
    ends = [*starts[1:], model.njoints]
    return tuple(_tree(model, range(start, end)) for start, end in zip(starts, ends, strict=True))


def _tree(model: pin.Model, joints: range) -> Tree:
    """The joints of a tree and their bodies as a model, without frames and limits."""
    out, first, last = pin.Model(), joints[0], joints[-1]
    for j in joints:
        parent = int(model.parents[j])
        k = out.addJoint(parent and parent - first + 1, model.joints[j], model.jointPlacements[j], model.names[j])
        out.appendBodyToJoint(k, model.inertias[j], pin.SE3.Identity())
    q = slice(model.idx_qs[first], model.idx_qs[last] + model.nqs[last])
    v = slice(model.idx_vs[first], model.idx_vs[last] + model.nvs[last])
    out.armature, out.gravity = model.armature[v], model.gravity
    return Tree(out, q, v, joints)


def joint_poses(model: pin.Model, q: np.ndarray) -> list[pin.SE3]:
    """Where the joints are at a configuration (nq,), the ground first, without a pin.Data."""
    poses = [pin.SE3.Identity()]
    for j in range(1, model.njoints):
        data = model.joints[j].createData()
        model.joints[j].calc(data, q)
        poses.append(poses[model.parents[j]] * model.jointPlacements[j] * data.M)
    return poses

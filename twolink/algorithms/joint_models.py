"""Joints over plain arithmetic: the pose they make, and the motions they allow.

Featherstone 2008, chapter 4. The motion subspace S of every joint here is constant in the joint's
own (child) frame, so its apparent derivative is zero. Configurations are laid out as in Pinocchio.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pinocchio as pin

from twolink.algorithms import spatial as sp
from twolink.algorithms.spatial import ZERO, Inertia, Mat, Pose, Scalar, Spatial, Vec
from twolink.errors import QueryError

Kind = Literal["revolute", "continuous", "prismatic", "planar", "spherical", "free-flyer"]

_X, _Y, _Z = sp.IDENTITY
_PLANAR: tuple[Spatial, ...] = ((_X, ZERO), (_Y, ZERO), (ZERO, _Z))
_TURNS: tuple[Spatial, ...] = ((ZERO, _X), (ZERO, _Y), (ZERO, _Z))
_SHIFTS: tuple[Spatial, ...] = ((_X, ZERO), (_Y, ZERO), (_Z, ZERO))


@dataclass(frozen=True)
class JointKinematics:
    """One joint: q[entries] and v[dofs] are its own, or for a mimic joint those of the joint it follows.

    axis (3,): of revolute, continuous and prismatic joints, unit, in the joint's frame.
    ratio, offset: the position of a mimic joint is ratio q + offset; 1 and 0 for other joints.
    """

    kind: Kind
    axis: Vec
    entries: tuple[int, ...]
    dofs: tuple[int, ...]
    mimic: bool = False
    ratio: float = 1.0
    offset: float = 0.0

    @property
    def subspace(self) -> tuple[Spatial, ...]:
        """The columns of S: the motions (linear, angular) of unit velocities, in the joint's frame."""
        if self.kind == "planar":
            return _PLANAR
        if self.kind == "spherical":
            return _TURNS
        if self.kind == "free-flyer":
            return _SHIFTS + _TURNS
        axis = sp.scale(self.ratio, self.axis)
        return ((axis, ZERO),) if self.kind == "prismatic" else ((ZERO, axis),)

    def motion(self, v: Sequence[Scalar]) -> Spatial:
        """S v, from the whole robot's v (or accelerations)."""
        return sp.spatial_add(*(sp.spatial_scale(v[k], s) for k, s in zip(self.dofs, self.subspace, strict=True)))

    def pose(self, q: Sequence[Scalar], xp: Any) -> Pose:
        """The pose of the child's frame in the joint's fixed frame, from the whole robot's q."""
        x = [q[k] for k in self.entries]
        if self.kind == "planar":
            return Pose((axis_rotation(_Z, x[2], x[3]),), (x[0], x[1], 0.0))
        if self.kind == "spherical":
            return Pose((quaternion_rotation(x),), ZERO)
        if self.kind == "free-flyer":
            return Pose((quaternion_rotation(x[3:]),), (x[0], x[1], x[2]))
        if self.kind == "continuous" and not self.mimic:
            return Pose((axis_rotation(self.axis, x[0], x[1]),), ZERO)
        at = x[0] if len(x) == 1 else xp.atan2(x[1], x[0])
        at = sp.plus(sp.times(self.ratio, at), self.offset)
        if self.kind == "prismatic":
            return Pose((sp.IDENTITY,), sp.scale(at, self.axis))
        return Pose((axis_rotation(self.axis, xp.cos(at), xp.sin(at)),), ZERO)

    def passed_on(self, body: Inertia) -> Inertia:
        """The part of the body's inertia that moves the same when it is fixed before the joint instead.

        About a revolute axis u that is any mass, first moment and second moment along u: points of the axis. The
        turn does not move them, so the robot's motion and energy are the same wherever they are counted (the "base
        parameters" of Gautier and Khalil 1990). Entries that become zero here are never computed again. Behind a
        prismatic joint it is the rotational inertia; in a ball joint the mass, a point at its centre.
        """
        if self.kind == "free-flyer" or not all(map(sp.constant, (body.mass, *body.first, *body.second))):
            return sp.NO_INERTIA
        if self.kind == "spherical":
            return Inertia(body.mass, ZERO, sp.NO_INERTIA.second)
        if self.kind == "prismatic":
            return Inertia(0.0, ZERO, body.second)
        u = _Z if self.kind == "planar" else self.axis
        return _points_on_axis(u, body, shifts=self.kind == "planar")


def _points_on_axis(u: Vec, body: Inertia, *, shifts: bool) -> Inertia:
    """Mass, first and second moment on the axis u that leave a body with none of its own along u.

    A joint that also shifts the axis sideways passes the second moment on, but not the mass or the first moment.
    """
    xx, xy, xz, yy, yz, zz = body.second
    x, y, z = u
    along = x * x * xx + y * y * yy + z * z * zz + 2 * (x * y * xy + x * z * xz + y * z * yz)
    h = body.first[0] * x + body.first[1] * y + body.first[2] * z
    second = (along * x * x, along * x * y, along * x * z, along * y * y, along * y * z, along * z * z)
    return Inertia(0.0, ZERO, second) if shifts else Inertia(body.mass, (h * x, h * y, h * z), second)


def axis_rotation(u: Vec, c: Scalar, s: Scalar) -> Mat:
    """The rotation about the unit axis u with cosine c and sine s, Rodrigues: u u^T + (1 - u u^T) c + [u x] s."""

    def entry(i: int, j: int) -> Scalar:
        if i == j:
            return sp.plus(u[i] * u[i], sp.times(1.0 - u[i] * u[i], c))
        sign = 1.0 if (j - i) % 3 == 2 else -1.0
        return sp.plus(sp.minus(u[i] * u[j], sp.times(u[i] * u[j], c)), sp.times(sign * u[3 - i - j], s))

    return tuple(tuple(entry(i, j) for j in range(3)) for i in range(3))  # type: ignore[return-value]


def quaternion_rotation(quaternion: Sequence[Scalar]) -> Mat:
    """The rotation of a unit quaternion (x, y, z, w)."""
    x, y, z, w = quaternion
    x2, y2, z2 = x + x, y + y, z + z
    return (
        (1.0 - (y * y2 + z * z2), x * y2 - w * z2, x * z2 + w * y2),
        (x * y2 + w * z2, 1.0 - (x * x2 + z * z2), y * z2 - w * x2),
        (x * z2 - w * y2, y * z2 + w * x2, 1.0 - (x * x2 + y * y2)),
    )


_KINDS: dict[str, Kind] = {
    "JointModelPlanar": "planar",
    "JointModelSpherical": "spherical",
    "JointModelFreeFlyer": "free-flyer",
}


def read_joint(model: pin.Model, index: int) -> JointKinematics:
    """Joint `index` of a model. Raises QueryError for other kinds."""
    joint = model.joints[index]
    name, q, v = joint.shortname(), joint.idx_q, joint.idx_v
    if name in _KINDS:
        return JointKinematics(_KINDS[name], ZERO, tuple(range(q, q + joint.nq)), tuple(range(v, v + joint.nv)))
    if "Mimic" in name:
        return _read_mimic(model, joint.extract(), _subspace(model, index), index)
    kinds: dict[str, Kind] = {"RUB": "continuous", "RevoluteUnb": "continuous", "P": "prismatic", "R": "revolute"}
    kind = next((k for prefix, k in kinds.items() if name.removeprefix("JointModel").startswith(prefix)), None)
    if kind is None or joint.nv != 1:
        raise _unknown(model, index, name)
    subspace = _subspace(model, index)
    return JointKinematics(kind, _axis(subspace, kind), tuple(range(q, q + joint.nq)), (v,))


def _subspace(model: pin.Model, index: int) -> np.ndarray:
    """S (6,) of a joint with one degree of freedom, which is constant."""
    data = model.joints[index].createData()
    model.joints[index].calc(data, pin.neutral(model))
    return np.asarray(data.S).reshape(-1)


def _read_mimic(model: pin.Model, joint: Any, subspace: np.ndarray, index: int) -> JointKinematics:
    if joint.scaling == 0.0 or not subspace.any():
        raise _unknown(model, index, "a mimic joint with multiplier 0")
    kind: Kind = "prismatic" if subspace[:3].any() else "revolute"
    followed = next(j for j in model.joints if j.nv and j.idx_v == joint.idx_v)
    entries = 2 if followed.nq == 2 else 1
    axis = _axis(subspace / joint.scaling, kind)
    q, v = joint.idx_q, joint.idx_v
    return JointKinematics(
        kind, axis, tuple(range(q, q + entries)), (v,), True, float(joint.scaling), float(joint.offset)
    )


def _axis(subspace: np.ndarray, kind: Kind) -> Vec:
    # Adding 0 turns -0.0 into 0.0; both fold, but only one prints well.
    x, y, z = (subspace[:3] if kind == "prismatic" else subspace[3:]) + 0.0
    return float(x), float(y), float(z)


def _unknown(model: pin.Model, index: int, what: str) -> QueryError:
    return QueryError(
        f"{what} cannot be compiled", where=f"joint {model.names[index]!r}", remedy='use engine="pinocchio"'
    )


def velocity_product(joint: JointKinematics, turned: Vec, motion: Spatial) -> Spatial:
    """The accelerations that velocities alone give a child: ((2 w_p + w) x v, w_p x w), in its frame.

    turned is the parent's angular velocity w_p there, motion = (v, w) the joint's own. The first part is Coriolis'
    term of the classical acceleration.
    """
    linear, angular = motion
    if joint.kind in ("revolute", "continuous", "spherical"):
        return ZERO, sp.cross(turned, angular)
    return sp.cross(sp.add(sp.scale(2.0, turned), angular), linear), sp.cross(turned, angular)
